"""Where a robot's own links are in one another along a motion, and how deep."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.robot.link_pairs import LinkPairs, link_pairs
from floatplan.robot.robot import Robot


@dataclass(frozen=True)
class Overlap:
    """Two links that are in one another during a motion, deeper than in the reference posture.

    Attributes
    ----------
    links : both
    depth : m, by which one would have to move for them to separate; between the convex hulls of meshes
    reference_depth : m, the same in the robot's reference posture; 0 where they are apart
    instant : s, when they are deepest
    joint : the joint between them where they are parts of neighbours, of which then the halves away from it count
    """

    links: tuple[str, str]
    depth: float
    reference_depth: float
    instant: float
    joint: str | None


def overlaps(
    robot: Robot, positions: Callable[[Array], Array], duration: float, aside: Collection[frozenset[str]] = ()
) -> tuple[Overlap, ...]:
    """Return which links a motion brings into one another, the worst first.

    Of each two bodies those that are deepest, and in a plane of all bodies that move as these.

    Parameters
    ----------
    robot : Robot
    positions : planned positions (N, n), rad, at times (N,), s, from 0 to ``duration``
    duration : s
    aside : pairs of links that are not looked at

    Raises
    ------
    InputError
        As of :attr:`Robot.shapes`.
    """
    pairs = link_pairs(robot)
    times = np.linspace(0.0, duration, 65)
    sampled = positions(times)
    chosen = _near(pairs, sampled, aside)
    if not len(chosen):
        return ()
    resting = np.minimum(pairs.distances(robot.resting[None], chosen)[0], 0.0)
    slight = allowance(pairs)

    depths_left = pairs.distances(sampled, chosen) - resting
    step = np.abs(np.diff(depths_left, axis=0)).max(axis=0)
    lowest = depths_left.argmin(axis=0)
    when = times[lowest]
    least = depths_left.min(axis=0)
    for column in np.flatnonzero(least < step).tolist():  # below zero, or perhaps between the instants
        # 17 instants from the one before to the next
        around = np.clip(when[column] + times[1] * np.linspace(-1.0, 1.0, 17), 0.0, duration)
        closer = pairs.distances(positions(around), chosen[[column]])[:, 0] - resting[column]
        if closer.min() < least[column]:
            when[column], least[column] = around[closer.argmin()], closer.min()
    worst: dict[frozenset[str] | frozenset[bytes], Overlap] = {}
    for column in np.argsort(least).tolist():
        pair = int(chosen[column])
        alike = _moving_alike(robot, pairs.pairs[pair].bodies)
        if least[column] >= -slight or alike in worst:
            continue
        deep = np.flatnonzero(depths_left[:, column] < -slight)
        deepest = times[deep[np.argsort(depths_left[deep, column])]]
        looked_at = [float(when[column]), *deepest[:8].tolist()]  # meshes take time: at the eight deepest instants
        instant = _confirmed(pairs, pair, positions, looked_at)
        if instant is None:
            continue
        depth = -float(pairs.distances(positions(np.array([instant])), chosen[[column]])[0, 0])
        worst[alike] = Overlap(
            links=pairs.links(pair),
            depth=depth,
            reference_depth=abs(float(resting[column])),
            instant=instant,
            joint=pairs.pairs[pair].joint,
        )
    return tuple(worst.values())


def _moving_alike(robot: Robot, bodies: tuple[str, str]) -> frozenset[str] | frozenset[bytes]:
    """What two bodies share with two others that move as they do: in a plane legs left and right that follow."""
    if robot.in_plane is None:
        return frozenset(bodies)
    turns = robot.tree.turns
    return frozenset(turns[robot.layout.body_of[link]].tobytes() for link in bodies)


def allowance(pairs: LinkPairs) -> float:
    """By how much deeper than in the reference posture links may overlap before that is reported, m."""
    # 5 mm, or 1 % of a smaller robot: shapes of files are no truer than that
    return min(5e-3, 0.01 * pairs.size)


def _near(pairs: LinkPairs, sampled: Array, aside: Collection[frozenset[str]]) -> IntArray:
    """Indices of the pairs that may meet at positions (K, n) sampled along a motion, or between them."""
    bounds = pairs.least_distances(sampled)
    step = np.abs(np.diff(bounds, axis=0)).max(axis=0, initial=0.0)
    near = np.flatnonzero(bounds.min(axis=0, initial=np.inf) < step)
    indices = [index for index in near.tolist() if frozenset(pairs.links(index)) not in aside]
    return np.array(indices, dtype=np.int64)


def _confirmed(pairs: LinkPairs, pair: int, positions: Callable[[Array], Array], instants: list[float]) -> float | None:
    """The first of some instants at which a pair overlaps: of meshes the surfaces have to meet, not only the hulls."""
    if not pairs.is_mesh(pair):
        return instants[0]
    for time in instants:
        if pairs.meet(pair, positions(np.array([time]))[0]):
            return time
    return None
