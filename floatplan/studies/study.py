"""A study: run or resumed, then looked at."""

from __future__ import annotations

import platform
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from functools import cached_property
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arguments import flag, function, optional, outline, positive, text, whole
from floatplan.arguments import path as as_path
from floatplan.errors import InputError
from floatplan.export.formats import format_of
from floatplan.jumps.jump import Jump
from floatplan.jumps.model import casadi
from floatplan.planning.options import JOBS
from floatplan.plans.plan import Plan
from floatplan.plans.plans import SOLVED
from floatplan.studies.driver import Engine, Progress, StudyRun, processors, started
from floatplan.studies.file import LARGER_IS_BETTER, StudyFile, load_study_file, versions
from floatplan.studies.folder import ResultFile, Shard, StudyFolder, arrow, naming_the_folder, words
from floatplan.studies.motions import row_jump, row_plan, write_motions
from floatplan.studies.rows import row_check
from floatplan.tables import Range

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_MOTIONS = 100_000  # [-] of a study, as files


class Study:
    """The results of a study: what :func:`floatplan.study` returns.

    Attributes
    ----------
    folder : Path
        The folder of its files.
    table : pyarrow.Table
        A row for each problem, in the order of their index: the keys that vary, in the units of the problem file, and
        the results; missing ones are null. A column's unit is in its field's metadata.
    files : list of Path
        The table, and the maps where there is one.
    """

    def __init__(self, file: StudyFile, folder: StudyFolder, table: Any) -> None:
        self._file = file
        self.folder = folder.path
        self.table = table
        self.files = [folder.results] if folder.results.exists() else []

    def __len__(self) -> int:
        return len(self.table)

    def __repr__(self) -> str:
        """Where it is, how many rows it has by status, what varies, and its columns."""
        rows = [
            ("folder", str(self.folder)),
            ("rows", ", ".join(f"{count} {status}" for status, count in self.statuses.items())),
            ("varied", ", ".join(self._file.paths)),
            ("columns", ", ".join(self.table.column_names)),
        ]
        return outline(f"Study({self._file.name!r}, {len(self)} rows)", rows)

    @cached_property
    def statuses(self) -> dict[str, int]:
        """Number of rows by status."""
        names, status = words(self.table, "status")
        return dict(zip(names, np.bincount(status).tolist(), strict=True))

    def heatmap(self, x: str, y: str, z: str = "torque_peak") -> Figure:
        """Draw a map.

        Where more keys vary than two, each cell shows its best row: the one of least ``z`` (for clearance the largest).

        Parameters
        ----------
        x, y : str
            Keys that vary.
        z : str
            A column of numbers, or "status".

        Raises
        ------
        InputError
            There is no such key or column.
        """
        from floatplan.studies.maps import heatmap, study_map

        return heatmap(study_map(self._file, self.table, text(x, "x"), text(y, "y"), text(z, "z")))

    def best(self, k: int = 1, by: str = "objective") -> Any:
        """Return the k best rows that hold a plan, as a table: least ``by`` first, of clearance the largest.

        Raises
        ------
        InputError
            There is no such column of numbers.
        """
        pa, _ = arrow()
        k = whole(Range(0, 2**63 - 1, ""))(k, "k")
        by = text(by, "by")
        kind = self.table.schema.field(by).type if by in self.table.column_names else pa.null()
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise InputError("is no column of numbers", element=f"by {by!r}")
        values = self.table[by].to_numpy().astype(np.float64)
        solved = np.isin(self.table["status"].to_numpy(), SOLVED) & ~np.isnan(values)
        rows = np.flatnonzero(solved)
        order = np.argsort(-values[rows] if by in LARGER_IS_BETTER else values[rows], kind="stable")
        return self.table.take(pa.array(rows[order][:k]))

    def plan(self, index: int) -> Plan:
        """Return a row's plan, rebuilt from the table and proved; the nearest motion where there is none.

        Raises
        ------
        InputError
            The row's problem is wrong, or it has no motion.
        """
        index = self._row(index)
        return row_plan(self._file, self.table.slice(index, 1).to_pylist()[0])

    def jump(self, index: int) -> Jump:
        """Plan a row's whole jump once more: a study saves measures of jumps, not the jumps themselves.

        Raises
        ------
        InputError
            The row's problem is wrong.
        """
        return row_jump(self._file, self._row(index))

    def export(
        self,
        form: str,
        rate: float | None = None,
        *,
        model: str | Path | None = None,
        jobs: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Path:
        """Write the motion of each row that holds a plan or a jump into a folder of the study; return its index.

        The folder has the format's name. ``index.json`` lists ``row``, ``values`` of the keys that vary, ``file``,
        ``status``, ``verdict`` and ``proved`` (of a jump, of its flight), ``sha256``. Existing files stay. Jumps are
        planned once more, which takes as long as the study did. ``jobs`` are as of :func:`study`, all others as of
        :meth:`Plan.export`; ``progress`` is called with the number that are done, and of all.

        Raises
        ------
        InputError
            There are more than ``MOST_MOTIONS``; another run is at work; or as of :meth:`Plan.export`.
        """
        format_of(text(form, "format"))  # so that no other folder is made
        options = {"form": form, "rate": optional(positive(unit="Hz"))(rate, "rate"), "model": model and str(model)}
        solved = self.table.filter(np.isin(self.table["status"].to_numpy(), SOLVED))
        if len(solved) > MOST_MOTIONS:
            raise InputError(f"{len(solved)} rows hold a motion, more than {MOST_MOTIONS}", element="export")
        count = optional(JOBS)(jobs, "jobs") or processors()
        progress = optional(function)(progress, "progress")
        with StudyFolder(self.folder, (0, len(self))).locked():
            return write_motions(self._file, solved.to_pylist(), self.folder / form, options, count, progress)

    def _row(self, index: int) -> int:
        """A row's index from 0."""
        count = len(self)
        return int(whole(Range(-count, count - 1, ""))(index, "index")) % count


def facts(file: StudyFile) -> dict[str, Any]:
    """The record of a study in its folder, without the hash."""
    others = {"python": platform.python_version(), **{name: version(name) for name in ("numpy", "pyarrow", "pin")}}
    return {
        "name": file.name,
        "problem": file.base.name,
        "rows": len(file),
        "vary": file.paths,
        "begun": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": {**versions(), **others},
    }


def study(
    path: str | Path,
    *,
    folder: str | Path | None = None,
    restart: bool = False,
    engine: str = "processes",
    scheduler: str | None = None,
    jobs: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    executor: Executor | None = None,
) -> Study:
    """Run a study, or go on with one: the rows that its folder has are not planned again.

    Parameters
    ----------
    path : path
        The study file.
    folder : path, optional
        Where results go; left out, as the file says, from the working directory.
    restart : bool
        Whether to discard what the folder has.
    engine : "processes" or "dask"
    scheduler : str, optional
        Address of dask's scheduler; left out, a cluster on this machine.
    jobs : int, optional
        Processes, as many as processors where left out; 1 is this one. In a script, more need
        ``if __name__ == "__main__":``. Of an executor, how many tasks it does at a time.
    progress : callable, optional
        Called after each chunk with the progress.
    executor : concurrent.futures.Executor, optional
        Plans the rows instead of an engine: of processes, of threads, of a cluster. It is not shut down.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        The study file, its problem or the folder is wrong; or pyarrow, or dask, is not installed.
    FloatplanError
        No process can be started, or the executor takes no more; the same call goes on from there.
    """
    chosen = started(text(engine, "engine"), jobs, optional(text)(scheduler, "scheduler"), executor)
    directory = optional(as_path)(folder, "folder")
    progress = optional(function)(progress, "progress")
    return planned_study(as_path(path, "path"), directory, flag(restart, "restart"), chosen, progress)


def planned_study(
    path: Path,
    folder: Path | None,
    restart: bool,
    engine: AbstractContextManager[Engine],
    progress: Callable[[Progress], None] | None,
    shard: str | None = None,
) -> Study:
    """Plan the rows that a study's folder lacks, or those of a shard, such as "3/64", in a folder of its own.

    Of a shard the table has its rows, and no file; all others are as of :func:`study`.
    """
    arrow()
    file = load_study_file(path)
    if file.plan.jump:
        casadi()
    study_folder = StudyFolder(folder or file.folder, (0, len(file)))
    of_shard = {}
    if shard is not None:
        which = Shard.parse(shard, len(file))
        of_shard = {"shard": [which.number, which.count]}
        study_folder = StudyFolder(
            study_folder.path / ResultFile.SHARDS / str(which).replace("/", "-of-"), which.rows(len(file))
        )
    with study_folder.locked():
        study_folder.open(file.digest(), facts(file) | of_shard, restart)
        gaps = study_folder.missing(row_check(file))
        if file.map and not of_shard:  # while others plan
            threading.Thread(target=import_module, args=("floatplan.studies.maps",), daemon=True).start()
        if gaps:
            with engine as chosen:
                StudyRun(file, study_folder, chosen, progress).fill(gaps)
        done = Study(file, study_folder, study_folder.table() if of_shard else study_folder.merge())
        if file.map and not of_shard:
            from floatplan.studies import maps

            with naming_the_folder(study_folder.path):
                done.files += maps.write_maps(file, done.table, study_folder.path)
    return done
