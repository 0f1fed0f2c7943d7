"""Problems without inequalities, drawn at random: chains and trees, coupled joints, mirrored planes, mixed degrees."""

import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from generated_problems import random_chain
from robot_samples import RandomTree

import floatplan as fp

PLANES = (("xz", "y"), ("zx", "y"), ("zy", "x"), ("yz", "x"))


@cache
def random_robot(seed: int, joints: int) -> fp.Robot:
    """A chain for even seeds; for odd ones a tree, every third with a coupled joint. Out of plane trees are skipped."""
    if seed % 2 == 0:
        return random_chain(np.random.default_rng(seed), joints)
    plane, normal = PLANES[seed // 2 % len(PLANES)]
    for attempt in range(1000):
        tree = RandomTree(1000 * seed + attempt, normal, joints)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "tree.urdf"
            path.write_text(tree.text, encoding="utf-8")
            coupled = {"joint2": fp.Coupling("joint1", -0.7, 0.4)} if seed % 3 == 0 else None
            try:
                robot = fp.Robot.from_urdf(path, plane=plane, locked=tree.locked, coupled=coupled)
                problem_of(robot, np.random.default_rng(0))
            except fp.InputError:
                continue
            return robot
    raise AssertionError("no tree stays in its plane")


def problem_of(robot: fp.Robot, rng: np.random.Generator) -> fp.Problem:
    """A flight between random states inside the ranges, by the shorter turn; at rest at its ends, or not."""
    n = len(robot.joints)
    low, high = np.where(np.isfinite(robot.position_limits), robot.position_limits, [-math.pi, math.pi]).T
    moving = float(rng.integers(2))

    def posture(orientation: float) -> fp.Posture:
        rates = moving * rng.uniform(-0.5, 0.5, (2, n))
        middle, half = (low + high) / 2, (high - low) / 2
        return fp.Posture(orientation, middle + 0.8 * half * rng.uniform(-1, 1, n), rates[0], rates[1])

    start = float(rng.uniform(-math.pi, math.pi))
    return fp.Problem(
        robot=robot,
        start=posture(start),
        goal=posture(start + float(rng.uniform(-1.5, 1.5))),
        flight=fp.Flight(duration=float(rng.uniform(0.7, 1.6))),
        motion=fp.Motion(degree=[int(degree) for degree in rng.integers(6, 9, n)]),
    )


def plain_problems(count: int) -> list[fp.Problem]:
    """Problems of robots with 1 to 12 joints, several of each robot; some h are given, at a tenth of the rest's."""
    found = []
    for number in range(count):
        rng = np.random.default_rng([5, number])
        problem = problem_of(random_robot(number // 8, 1 + number // 8 % 12), rng)
        if number % 5 == 0:
            flight = replace(problem.flight, angular_momentum=float(rng.uniform(-0.1, 0.1)))
            problem = replace(problem, flight=flight)
        found.append(problem)
    return found
