"""Many plans in one process, to be run in one of its own: what of them stays in memory, and what a fork answers.

``python load.py PLANS ROBOTS`` prints what :func:`measured` finds as JSON.
"""

import ctypes
import gc
import json
import os
import random
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from places import ROOT

import floatplan as fp

QUICK = ("new_configuration", "somersault")
ALL = (*QUICK, "torque_limited", "obstacle", "falling_cat")
THREADS = 8
PAGE = os.sysconf("SC_PAGE_SIZE")  # bytes


def differing_problems(names: tuple[str, ...]) -> Iterator[fp.Problem]:
    """Problems of a few robots, no two alike, without end."""
    rng = random.Random(0)
    known = [fp.load_problem(ROOT / "problems" / f"{name}.toml") for name in names]
    while True:
        for problem in known:
            duration = problem.flight.duration * rng.uniform(0.95, 1.05)
            yield replace(problem, flight=replace(problem.flight, duration=duration))


def growth(plans: int, names: tuple[str, ...]) -> float:
    """MB by which the process grows with so many plans, after a fourth as many."""
    problems = differing_problems(names)
    for _ in range(plans // 4):
        _use(next(problems))
    before = _resident()
    for _ in range(plans):
        _use(next(problems))
    return (_resident() - before) / 1e6


def _use(problem: fp.Problem) -> None:
    plan = fp.plan(problem, budget=1.0)
    plan.at([0.0, 0.1, plan.duration])
    plan.record.to_json()


def _resident() -> int:
    """Bytes of this process in memory, after the allocator gave back what it holds for later."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE


def robots_kept(robots: int) -> int:
    """How many robots stay in memory after a plan with each of so many different ones."""
    text = (ROOT / "urdf" / "gymnast.urdf").read_text(encoding="utf-8")
    postures = fp.Posture(0.0, [0.0, 0.0]), fp.Posture(0.3, [0.2, 0.1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        for number in range(robots):
            path.write_text(text.replace('<mass value="', f'<mass value="{number + 1}'), encoding="utf-8")
            fp.plan(fp.Problem(fp.Robot.from_urdf(path), *postures, fp.Flight(duration=1.0)))
    gc.collect()
    return sum(type(each) is fp.Robot and each.path == path for each in gc.get_objects())


def fork_agrees() -> bool:
    """Whether a fork of a process that has threads finds what the process found, alone and in all of its threads."""
    problem = next(differing_problems(QUICK))

    def found(_: int = 0) -> bytes:
        return fp.plan(problem).coefficients.tobytes()

    expected = found()
    with ThreadPoolExecutor(THREADS) as pool:
        answers = set(pool.map(found, range(2 * THREADS)))
        child = os.fork()
        if child == 0:
            os._exit(0 if found() == expected else 1)
        return answers == {expected} and os.waitpid(child, 0)[1] == 0


def measured(plans: int, robots: int) -> dict[str, float]:
    """All of the above."""
    agrees = fork_agrees()
    grown = growth(plans, QUICK if plans < 500 else ALL)
    return {"MB grown": grown, "robots kept": robots_kept(robots), "fork agrees": agrees}


if __name__ == "__main__":
    print(json.dumps(measured(*map(int, sys.argv[1:]))))
