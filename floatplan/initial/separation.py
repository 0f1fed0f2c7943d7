"""A first flight whose links overlap is searched for again, with limits that separate them.

Neighbours are separated by a narrower range of the joint between them, from the reference posture to where they first
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

MOST_PAIRS = 2  # [-] that are not neighbours: a search that separates many takes minutes
STEP = math.radians(1)  # of a joint, at which links are compared; ranges end at whole degrees


def separated(problem: Problem, positions: Callable[[Array], Array], duration: float) -> Problem | None:
    """Return a problem with limits that separate the links which overlap in a motion.

    None where none do, or where no limit helps: more than ``MOST_PAIRS`` pairs that are not neighbours are arms next to
    legs, which no distance in the plane separates.

    Parameters
    ----------
    problem : Problem
    positions : planned positions (N, n), rad, at times (N,), s, from 0 to ``duration``
    duration : s
    """
    robot = problem.robot
    separated_pairs = [frozenset(pair.links) for pair in problem.self_clearances]
    in_motion = overlaps(robot, positions, duration, separated_pairs)
    thickness = link_pairs(robot).thickness
    pairs = [SelfClearance(overlap.links, thickness) for overlap in in_motion if overlap.joint is None]
    ranges = dict[str, tuple[float, float]]()
    if len(pairs) < len(in_motion):  # neighbours do, of which another motion may fold other joints
        for index, joint in enumerate(robot.joints):
            narrow = open_range(problem, index)
            if narrow != tuple(problem.position_limits[index].tolist()):
                ranges[joint] = narrow
    if len(pairs) > MOST_PAIRS or not (ranges or pairs):
        return None
    own = problem.limits.position
    position = {**(own if isinstance(own, Mapping) else {}), **ranges} or own
    return replace(
        problem,
        limits=replace(problem.limits, position=position),
        self_clearances=(*problem.self_clearances, *pairs),
    )


def open_range(problem: Problem, index: int) -> tuple[float, float]:
    """Return the range of a planned joint, rad, about its reference position in which no neighbours overlap."""
    robot = problem.robot
    pairs = link_pairs(robot)
    low, high = problem.position_limits[index].tolist()
    angles = STEP * np.arange(math.ceil(low / STEP), math.floor(high / STEP) + 1)
    postures = np.tile(robot.resting, (len(angles), 1))
    postures[:, index] = angles
    neighbours = []
    for number, pair in enumerate(pairs.pairs):
        if pair.joint is not None and _planned_index(robot, pair.joint) == index:
            neighbours.append(number)
    chosen = np.array(neighbours, dtype=np.int64)
    in_reference = np.minimum(pairs.distances(robot.resting[None], chosen), 0.0)
    overlap = ~(pairs.distances(postures, chosen) >= in_reference - allowance(pairs)).all(axis=1)
    overlap_below = np.flatnonzero(overlap & (angles <= robot.resting[index]))
    overlap_above = np.flatnonzero(overlap & (angles >= robot.resting[index]))
    if overlap_below.size:
        low = float(angles[overlap_below[-1] + 1])
    if overlap_above.size:
        high = float(angles[overlap_above[0] - 1])
    return low, high


def _planned_index(robot: Robot, joint: str) -> int:
    """Index of the planned joint that a joint which moves is, or follows."""
    return robot.joints.index(robot.coupled[joint].leader if joint in robot.coupled else joint)
