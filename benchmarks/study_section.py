"""What a study adds to the planning of its rows: chunks, table, maps; and the memory that it takes."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from measuring import PROBLEMS, Counts, heading, stopwatch, table

import floatplan as fp
from floatplan.studies import page, rows
from floatplan.studies.file import load_study_file

ASKED = f"""
problem = "{PROBLEMS / "somersault.toml"}"
[vary]
"flight.angular_momentum" = {{ from = 2.8, to = 4.4, count = COUNT }}
"flight.duration" = {{ from = 0.9, to = 1.4, count = 250 }}
"""


def studies(counts: Counts) -> None:
    """Study beside ``plan_many`` for the same rows, taking turns, in one process."""
    heading(f"studies: {250 * counts.across} somersaults over h and T, one core")
    with tempfile.TemporaryDirectory() as made:
        asked, folder = Path(made) / "asked.toml", Path(made) / "out"
        asked.write_text(ASKED.replace("COUNT", str(counts.across)), encoding="utf-8")
        study = load_study_file(asked)
        turns: list[tuple[float, ...]] = []
        for _ in range(counts.slow_turns):
            began = time.perf_counter()
            fp.plan_many(study.family(0, len(study)))
            planning = time.perf_counter() - began
            parts = stopwatch(rows, ["plan_many"]), stopwatch(rows, ["many_peaks"]), stopwatch(page, ["write_maps"])
            with parts[0] as inside, parts[1] as peaks, parts[2] as maps:
                began = time.perf_counter()
                fp.study(asked, folder=folder, restart=True, jobs=1)
                whole = time.perf_counter() - began
            turns.append((planning, inside["seconds"], peaks["seconds"], maps["seconds"], whole))
        command = [sys.executable, "-m", "floatplan", "study", str(asked), "-o", str(folder), "--restart", "-q"]
        subprocess.run(command, check=True)
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024  # [MB] of the largest process
    medians = np.median([_shares(*turn) for turn in turns], axis=0).tolist()
    rate = len(study) / np.median([turn[-1] for turn in turns])
    header = ["rows/s", "overhead %", "inside %", "of this maps %", "peaks %", "largest process MB"]
    table(header, [[f"{rate:.0f}", *(f"{share:.1f}" for share in medians), f"{memory:.0f}"]])
    print("  overhead: study without peaks of torque, less plan_many for the same rows in one call, over that;")
    print("  inside: all of a study but planning and peaks, over its own planning in chunks\n")


def _shares(planning: float, inside: float, peaks: float, maps: float, whole: float) -> list[float]:
    rest = whole - peaks
    shares = (rest - planning) / planning, (rest - inside) / inside, maps / inside, peaks / inside
    return [100 * share for share in shares]
