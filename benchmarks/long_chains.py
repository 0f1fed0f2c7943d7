"""Plans flights of chains of 5 to 50 joints without limits, and prints how the time grows. Run it from anywhere.

Usage: ``python benchmarks/long_chains.py [JOINTS ...]``
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from make_chain import Body, chain_urdf

import floatplan as fp

JOINTS = (5, 10, 20, 50)
LENGTH, MASS = 2.0, 10.0  # m and kg of the whole chain
SEED = 0


def main(counts: Sequence[int]) -> None:
    print("| joints | planned in, s | iterations |\n| ---: | ---: | ---: |")
    times = []
    fp.plan(chain_problem(2))  # loads what is loaded once
    for joints in counts:
        problem = chain_problem(joints)
        began = time.perf_counter()
        plan = fp.plan(problem)
        times.append(time.perf_counter() - began)
        if not plan.ok:
            raise SystemExit(f"{joints} joints: {plan.explanation}")
        print(f"| {joints} | {times[-1]:.2f} | {plan.solver['iterations']} |")
    if len(counts) > 1:
        slope = np.polyfit(np.log(counts), np.log(times), 1)[0]
        print(f"time grows about as n^{slope:.1f}")


def chain_problem(joints: int) -> fp.Problem:
    """A gently curled chain that turns and uncurls, at random."""
    half, mass = LENGTH / (joints + 1) / 2, MASS / (joints + 1)
    bodies = [Body(f"body{i}", l=half, r=half, m=mass, I=mass * half**2 / 3) for i in range(joints + 1)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(chain_urdf(f"chain{joints}", bodies))
        robot = fp.Robot.from_urdf(path)
    curls = np.random.default_rng(SEED).uniform(-1.0, 1.0, (2, joints)) / joints
    return fp.Problem(
        robot,
        start=fp.Posture(0.2, list(2.0 * curls[0])),
        goal=fp.Posture(1.0, list(4.0 * curls[1])),
        flight=fp.Flight(duration=0.8, takeoff=fp.Takeoff("foot")),
    )


if __name__ == "__main__":
    main([int(count) for count in sys.argv[1:]] or JOINTS)
