"""A first flight whose links overlap is searched for again, with what keeps them apart.

Neighbours are kept apart by a narrower range of the joint between them, from the reference posture to where they first
meet; other links by a pair of ``[[self_clearance]]``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.plans.overlaps import allowance, overlaps
from floatplan.problem.parts import SelfClearance
from floatplan.problem.problem import Problem
from floatplan.robot.link_pairs import link_pairs
from floatplan.robot.robot import Robot

MOST_PAIRS = 2  # [-] that are not neighbours: a search that keeps many apart takes minutes
STEP = math.radians(1)  # of a joint, at which links are looked at; ranges end at whole degrees


def kept_apart(problem: Problem, positions: Callable[[Array], Array], duration: float) -> Problem | None:
    """Return a problem that keeps apart the links which a motion brings into one another.

    None where the motion does not, or where nothing is left to ask: more than ``MOST_PAIRS`` pairs that are not
    neighbours are arms beside legs, which no distance in the plane keeps apart.

    Parameters
    ----------
    problem : Problem
    positions : planned positions (N, n), rad, at times (N,), s, from 0 to ``duration``
    duration : s
    """
    robot = problem.robot
    kept = [frozenset(pair.links) for pair in problem.self_clearances]
    found = overlaps(robot, positions, duration, kept)
    apart = [SelfClearance(overlap.links, link_pairs(robot).thickness) for overlap in found if overlap.joint is None]
    ranges = dict[str, tuple[float, float]]()
    if any(overlap.joint is not None for overlap in found):  # another motion may fold other joints
        for index, joint in enumerate(robot.joints):
            narrow = open_range(problem, index)
            if narrow != tuple(problem.position_limits[index].tolist()):
                ranges[joint] = narrow
    if len(apart) > MOST_PAIRS or not (ranges or apart):
        return None
    known = problem.limits.position
    position = {**(known if isinstance(known, Mapping) else {}), **ranges} or known
    return replace(
        problem,
        limits=replace(problem.limits, position=position),
        self_clearances=(*problem.self_clearances, *apart),
    )


def open_range(problem: Problem, index: int) -> tuple[float, float]:
    """Return the range of a planned joint, rad, about its reference position in which no neighbours overlap."""
    robot, pairs = problem.robot, link_pairs(problem.robot)
    low, high = problem.position_limits[index].tolist()
    angles = STEP * np.arange(math.ceil(low / STEP), math.floor(high / STEP) + 1)
    sampled = np.tile(robot.resting, (len(angles), 1))
    sampled[:, index] = angles
    neighbours = [
        number
        for number, pair in enumerate(pairs.pairs)
        if pair.joint is not None and _planned_index(robot, pair.joint) == index
    ]
    chosen = np.array(neighbours, dtype=np.int64)
    at_rest = np.minimum(pairs.distances(robot.resting[None], chosen), 0.0)
    free = (pairs.distances(sampled, chosen) >= at_rest - allowance(pairs)).all(axis=1)
    below, above = angles <= robot.resting[index], angles >= robot.resting[index]
    closed_below, closed_above = np.flatnonzero(below & ~free), np.flatnonzero(above & ~free)
    return (
        float(angles[closed_below[-1] + 1]) if closed_below.size else low,
        float(angles[closed_above[0] - 1]) if closed_above.size else high,
    )


def _planned_index(robot: Robot, joint: str) -> int:
    """Index of the planned joint that a joint which moves is, or follows."""
    return robot.joints.index(robot.coupled[joint].leader if joint in robot.coupled else joint)
