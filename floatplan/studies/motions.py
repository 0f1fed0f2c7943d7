"""The motions of a study's rows: rebuilt, proved, and written as files for other programs, with an index."""

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.certificate.certificate import certify
from floatplan.errors import InputError
from floatplan.export.formats import format_of
from floatplan.files import check_readable, is_file, read_json, read_regular, write_atomically
from floatplan.jumps.jump import Jump
from floatplan.jumps.planner import jump
from floatplan.planning.kernel_input.numbers import is_unconstrained_family
from floatplan.planning.repair import judged
from floatplan.plans.plan import Plan
from floatplan.plans.plans import GOAL_MET, SOLVED, PlanEntry
from floatplan.pool import in_order, processes
from floatplan.studies.file import StudyFile
from floatplan.studies.rows import row_seed

Row = Mapping[str, Any]  # of a study's table


def row_plan(study: StudyFile, row: Row, prove: bool = True) -> Plan:
    """Return a row's plan, rebuilt, and proved; errors as of :meth:`floatplan.studies.study.Study.plan`."""
    index = row["index"]
    family = study.family(index, index + 1)
    seed = row_seed(study.samples.seed, index)
    if row["coefficients"] is None:
        advice = "call jump, which plans it once more" if study.plan.jump else None
        raise InputError(row["explanation"], element=f"row {index}", advice=advice)
    solved = row["status"] in SOLVED
    answer = PlanEntry(
        status=row["status"],
        objective=row["objective"] if solved else np.nan,
        angular_momentum=row["angular_momentum"],
        coefficients=np.array(list(zip_longest(*row["coefficients"], fillvalue=0.0))).T,
        starts=row["starts"],
        message="" if row["explanation"] == GOAL_MET else row["explanation"],
    )
    plan = answer.plan(family[0], study.samples.seed if is_unconstrained_family(family) else seed)
    return judged(plan, certify(plan)) if solved and prove else plan


def row_jump(study: StudyFile, index: int) -> Jump:
    """Plan a row's whole jump once more; InputError where its problem is wrong."""
    problem = study.family(index, index + 1)[0]
    seed = row_seed(study.samples.seed, index)
    return jump(problem, seed=seed, starts=study.plan.starts, helps=False)


def write_motions(
    study: StudyFile, rows: list[Row], folder: Path, options: Mapping[str, Any], jobs: int, progress: Any
) -> Path:
    """Write the motions of rows into a folder of theirs, and their index, which is returned; existing files stay.

    Each of ``rows`` has a plan or a jump; ``options`` are ``form``, ``rate`` and ``model`` of :meth:`Plan.export`;
    ``progress`` is called with the number that are done, and of all, or is None.
    """
    about = {"format": "floatplan.motions/1", "study": study.digest(), **options, "units": study.units}
    about["model"] = _sha256(options["model"]) if options["model"] else None
    index = folder / "index.json"
    name = "{:07d}" + Path(format_of(options["form"]).file).suffix
    entries = _entries(index, about)
    done = {row: entry for row, entry in entries.items() if entry["sha256"] == _sha256(folder / name.format(row))}
    files = [path for path in folder.glob(name.replace("{:07d}", "[0-9]" * 7)) if path.is_file()]
    left_over = [path for path in files if int(path.stem) not in done]  # of another study, or without an entry
    for path in left_over:
        check_readable(path, "is not replaced")
    for path in left_over:
        path.unlink()
    waiting = [(row,) for row in rows if row["index"] not in done]
    writing = (study, folder, name, options)
    written = time.monotonic()
    took = 0.0
    try:
        with processes(jobs, (__name__,), _writer, *writing) if min(jobs, len(waiting)) > 1 else nullcontext() as pool:
            for entry in in_order(pool, waiting, _writer(*writing)):
                if entry:
                    done[entry["row"]] = entry
                if progress is not None:
                    progress(len(done), len(rows))
                # the index is written every 5 s; less often where that takes more than a twentieth of the time
                start = time.monotonic()
                if start - written > max(5.0, 20 * took):
                    _write_index(index, about, done)
                    written = time.monotonic()
                    took = written - start
    finally:
        _write_index(index, about, done)
    return index


def _writer(study: StudyFile, folder: Path, name: str, options: Mapping[str, Any]) -> Callable[[Row], Any]:
    """Return a function that writes the file of a row and returns its entry in the index, None without a motion."""

    def write(row: Row) -> dict[str, Any] | None:
        index = row["index"]
        verdict = row["verdict"] if study.plan.prove and not study.plan.jump else ""
        motion = row_jump(study, index) if study.plan.jump else row_plan(study, row, not verdict)
        flight = motion.flight if isinstance(motion, Jump) else motion
        if not motion.ok or flight is None:
            return None
        if not verdict:
            verdict = (flight.certificate or certify(flight)).verdict
        try:
            path = motion.export(path=folder / name.format(index), **options)
        except InputError as error:
            raise error.within(element=f"row {index}") from None
        return {
            "row": index,
            "values": {key: row[key] for key in study.paths},
            "file": path.name,
            "status": row["status"],
            "verdict": verdict,
            "proved": verdict == "proved",
            "sha256": _sha256(path),
        }

    return write


def _sha256(path: str | Path) -> str | None:
    """Of a file; None where there is none. InputError where it cannot be read."""
    if not is_file(Path(path)):
        return None
    return hashlib.sha256(read_regular(path, 1_000_000_000, "a motion")).hexdigest()


def _entries(index: Path, about: Mapping[str, Any]) -> dict[int, dict[str, Any]]:
    """Entries by row of an index that was begun in the same way; none of another, or where there is none.

    Raises
    ------
    InputError
        The index cannot be read: then nobody can tell which files are its motions, and all of them stay.
    """
    check_readable(index, "and the motions beside it are not replaced")
    with suppress(ValueError, KeyError, TypeError, AttributeError):
        content = read_json(index, 500_000_000, "an index of motions")
        if {key: content[key] for key in about} == about:
            entries = {}
            for entry in content["motions"]:
                if entry["sha256"]:
                    entries[int(entry["row"])] = entry
            return entries
    return {}


def _write_index(index: Path, about: Mapping[str, Any], done: Mapping[int, Mapping[str, Any]]) -> None:
    content = {**about, "motions": [done[row] for row in sorted(done)]}
    write_atomically(index, json.dumps(content, indent=1, allow_nan=False))
