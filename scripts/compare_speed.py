"""Times ``floatplan.plan`` in this checkout against another: ``scripts/compare_speed.py OTHER [PROBLEM...]``.

Processes of both checkouts take turns, a few plans each, with the interpreter that runs this script; processor time.
Printed are the median of the ratios new / old with its quartiles, and the ratio of the sums. A checkout compared with
itself tells how much of that is noise. A problem is a file's path below ``problems/`` without its ending.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEFAULT = ("new_configuration", "handstand", "obstacle", "obstacle_hard", "torque_limited", "somersault_motors")
STARTED = 10  # pairs of processes: how fast one runs depends on where its memory lies
TURNS = 24  # of each pair
LONG = 0.008  # s, that a turn takes at least

WORKER = """
import sys, time, dataclasses
import floatplan as fp
problem = fp.load_problem(sys.argv[1])
fp.plan(dataclasses.replace(problem))
print(flush=True)
for line in sys.stdin:
    problems = [dataclasses.replace(problem) for _ in range(int(line))]
    began = time.process_time()
    for each in problems:
        fp.plan(each)
    print(time.process_time() - began, flush=True)
"""


class Worker:
    """A process that plans one problem in one checkout."""

    def __init__(self, checkout: Path, problem: str) -> None:
        command = [sys.executable, "-c", WORKER, str(ROOT / "problems" / f"{problem}.toml")]
        environment = {**os.environ, "PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=checkout, env=environment
        )
        self._read()

    def seconds(self, plans: int) -> float:
        """Processor time of so many plans."""
        assert self._process.stdin is not None
        print(plans, file=self._process.stdin, flush=True)
        return float(self._read())

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _read(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("a process ended early; what it said stands above")
        return line


def compare(other: Path, problem: str) -> str:
    """One line about a problem."""
    pairs: list[tuple[float, float]] = []
    plans = 1
    for _ in range(STARTED):
        workers = [Worker(other, problem), Worker(ROOT, problem)]
        plans = max(plans, round(LONG / max(workers[0].seconds(1), 1e-6)))
        for turn in range(TURNS):
            order = (0, 1) if turn % 2 else (1, 0)
            seconds = {index: workers[index].seconds(plans) for index in order}
            pairs.append((seconds[0], seconds[1]))
        for worker in workers:
            worker.close()
    low, middle, high = statistics.quantiles([new / old for old, new in pairs], n=4)
    old, new = (statistics.median(side) / plans * 1e3 for side in zip(*pairs, strict=True))
    sums = sum(new for _, new in pairs) / sum(old for old, _ in pairs)
    return f"{problem:28s} {middle:.3f} ({low:.3f} to {high:.3f}), sums {sums:.3f}; {old:.3g} ms, now {new:.3g} ms"


def main() -> None:
    """Compare all."""
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    other = Path(sys.argv[1]).resolve()
    if not (other / "floatplan").is_dir():
        raise SystemExit(f"{other} is no checkout of floatplan")
    for problem in sys.argv[2:] or DEFAULT:
        print(compare(other, problem), flush=True)


if __name__ == "__main__":
    main()
