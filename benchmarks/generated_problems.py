"""Problems drawn at random, seeds fixed: for the benchmark and for the tests."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from make_chain import Body, chain_urdf

import floatplan as fp


def random_chain(rng: np.random.Generator, joints: int) -> fp.Robot:
    """Return a chain of links with random lengths, masses and inertias, about as long and heavy as a person."""
    bodies = [
        Body(
            f"body{index}",
            l=float(length * share),
            r=float(length * (1 - share)),
            m=float(mass),
            I=float(mass * length**2 * rng.uniform(0.06, 0.12)),
        )
        for index, (length, share, mass) in enumerate(
            zip(
                rng.uniform(0.6, 1.4, joints + 1) * 1.5 / (joints + 1),
                rng.uniform(0.35, 0.65, joints + 1),
                rng.uniform(0.5, 2.0, joints + 1) * 10 / (joints + 1),
                strict=True,
            )
        )
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(chain_urdf("chain", bodies), encoding="utf-8")
        return fp.Robot.from_urdf(path)


def random_problem(seed: int, joints: int, *, moving: bool = False) -> fp.Problem:
    """Return a flight between random states inside the ranges, by the shorter turn; ``moving`` joints there or not."""
    rng = np.random.default_rng([seed, joints, int(moving)])

    def posture() -> fp.Posture:
        rates = rng.uniform(-0.5, 0.5, (2, joints)) if moving else np.zeros((2, joints))
        return fp.Posture(
            orientation=float(rng.uniform(-math.pi, math.pi)),
            positions=rng.uniform(-0.85 * math.pi, 0.85 * math.pi, joints),
            velocities=rates[0],
            accelerations=rates[1],
        )

    robot, start, goal = random_chain(rng, joints), posture(), posture()
    turn = math.remainder(goal.angle - start.angle, 2 * math.pi)
    return fp.Problem(
        robot=robot,
        start=start,
        goal=replace(goal, orientation=start.angle + turn),
        flight=fp.Flight(duration=float(rng.uniform(0.8, 1.6))),
        name=f"random_{joints}_{seed}",
    )


SIZES = (2, 3, 4, 6, 10)  # joints


def mixed_problem(seed: int) -> fp.Problem:
    """Return a problem: with ``SIZES`` of joints in turn, every third one moving at its ends."""
    return random_problem(seed, SIZES[seed % len(SIZES)], moving=seed % 3 == 0)


def random_problems(count: int) -> list[fp.Problem]:
    """Return ``count`` mixed problems."""
    return [mixed_problem(seed) for seed in range(count)]
