"""What a study adds to the planning of its rows: chunks, table, maps; and the memory that it takes."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
from measuring import PROBLEMS, Counts, heading, stopwatch, table

import floatplan as fp
from floatplan.studies import maps, rows
from floatplan.studies.file import load_study_file
from floatplan.studies.folder import StudyFolder

ASKED = f"""
problem = "{PROBLEMS / "somersault.toml"}"
[vary]
"flight.angular_momentum" = {{ from = 2.8, to = 4.4, count = COUNT }}
"flight.duration" = {{ from = 0.9, to = 1.4, count = 250 }}
"""
CALL = 16_384  # rows
WORDS = ("optimal", "not_found", "impossible")


def studies(counts: Counts) -> None:
    """Study beside ``plan_many`` alone for the same rows, in one process; then the command."""
    heading(f"studies: {250 * counts.across} somersaults over h and T, one core")
    with tempfile.TemporaryDirectory() as made:
        asked, folder = Path(made) / "asked.toml", Path(made) / "out"
        asked.write_text(ASKED.replace("COUNT", str(counts.across)), encoding="utf-8")
        study = load_study_file(asked)
        family = study.family(0, len(study))
        turns = [_turn(asked, folder, family) for _ in range(counts.slow_turns)]
        command = [sys.executable, "-m", "floatplan", "study", str(asked), "-o", str(folder), "--restart", "-q"]
        began = time.perf_counter()
        subprocess.run(command, check=True)
        seconds = time.perf_counter() - began
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024  # [MB] of the largest process
    medians = np.median([turn.shares() for turn in turns], axis=0).tolist()
    header = ["overhead %", "inside %", "of this maps %", "peaks %", "rows/s", "command s", "largest process MB"]
    rate = len(study) / np.median([turn.whole for turn in turns])
    table(header, [[*(f"{share:.1f}" for share in medians), f"{rate:.0f}", f"{seconds:.1f}", f"{memory:.0f}"]])
    print("  in processor time; the command, with all of its start, on all processors by the clock;")
    print("  overhead: study without peaks of torque, less plan_many alone for the same rows, over that;")
    print("  inside: all of a study but planning and peaks, over its own planning in chunks\n")
    header = ["study with limits", "rows", *WORDS, "rows per s of processor", "ms of a row that is solved"]
    table(header, [_with_limits(name, counts.across) for name in ("pole", "weak_motors")])
    print("  planned and measured in this process, without table and map; the best of three\n")


def _with_limits(name: str, most: int) -> list[str]:
    """Rows of a study with obstacles or limits: how many end in which way, and how many a second of the processor."""
    study = load_study_file(PROBLEMS / "studies" / f"{name}.toml")
    count, content = min(len(study), 4 * most), rows.packed(study)
    family = study.family(0, count)
    status = fp.plan_many(family).status
    solved = np.flatnonzero(np.isin(status, WORDS[0]))

    def seconds(run: Callable[[], object]) -> float:
        spent = []
        for _ in range(3):
            began = time.process_time()
            run()
            spent.append(time.process_time() - began)
        return min(spent)

    whole = seconds(lambda: rows.planned_rows(content, 0, study.samples.values(0, count)))
    easy = fp.Family(family.base, {path: values[solved] for path, values in family.arrays.items()})
    ended = [str(int(np.isin(status, word).sum())) for word in WORDS]
    of_solved = 1e3 * seconds(lambda: fp.plan_many(easy)) / max(len(solved), 1)
    return [name, str(count), *ended, f"{count / whole:.0f}", f"{of_solved:.2f}"]


@dataclass(frozen=True)
class _Turn:
    """Seconds of the processor: of ``plan_many`` alone, and of a study and parts of it."""

    alone: float
    inside: float
    peaks: float
    maps: float
    whole: float

    def shares(self) -> list[float]:
        """Of what is planned, in percent."""
        rest = self.whole - self.peaks
        against_alone = (rest - self.alone) / self.alone
        parts = against_alone, *(part / self.inside for part in (rest - self.inside, self.maps, self.peaks))
        return [100 * part for part in parts]


def _turn(asked: Path, folder: Path, family: fp.Family) -> _Turn:
    """Time a study and ``plan_many`` for its rows in processor time: what else the machine does is no part of either.

    They take turns of about a second, so that a machine which changes its speed changes it for both.
    """
    clock = time.process_time
    timed = ((rows, ["plan_batches"]), (rows, ["many_peaks"]), (maps, ["write_maps"]))
    with ExitStack() as stack:
        inside, peaks, drawn = (stack.enter_context(stopwatch(*each, clock)) for each in timed)
        alone = stack.enter_context(_alone(family))
        began = clock()
        fp.study(asked, folder=folder, restart=True, jobs=1)
        whole = clock() - began - alone["seconds"]
    return _Turn(alone["seconds"], inside["seconds"], peaks["seconds"], drawn["seconds"], whole)


@contextmanager
def _alone(family: fp.Family) -> Iterator[dict[str, float]]:
    """Plan a study's rows once more in few calls, as far as it has come; add up their seconds of the processor."""
    total = {"seconds": 0.0}
    keep = StudyFolder.save
    planned = 0

    def keep_and_plan(folder: StudyFolder, first: int, stop: int, content: bytes) -> None:
        nonlocal planned
        keep(folder, first, stop, content)
        began = time.process_time()
        while planned + CALL <= stop or planned < stop == len(family):
            fp.plan_many(family[planned : planned + CALL])
            planned = min(planned + CALL, stop)
        total["seconds"] += time.process_time() - began

    with patch.object(StudyFolder, "save", keep_and_plan):
        yield total
