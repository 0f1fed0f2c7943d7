"""Hulls of what moves as one, by whose corners heights over the ground are measured: far fewer than each link's own."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from floatplan.arrays import ComplexArray
from floatplan.robot.parts import LinkCapsule
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.shapes.capsules import Outline, with_fewer_corners

POSTURES = 3  # [-] in which bodies that are in one place always are
SAME = 1e-9  # [m] points that are nowhere farther apart are one


def moving_hulls(
    tree: PlanarTree, hulls: Mapping[str, Sequence[LinkCapsule]], apart: Collection[str], bodies: Collection[int]
) -> tuple[LinkCapsule, ...]:
    """Return capsules whose ends reach as far as the links in every direction.

    Parameters
    ----------
    tree : PlanarTree
    hulls : link -> capsules whose ends are the corners of its own hull
    apart : links that keep all of these
    bodies : those taken exactly; others reach up to a millimetre farther
    """
    place = _places(tree)
    exact = {place[body] for body in bodies}
    own = [each for link in apart for each in hulls[link]]
    kept: dict[tuple[int, float], list[LinkCapsule]] = {}
    for each in (each for hull in hulls.values() for each in hull):
        kept.setdefault((place[each.body], each.radius), []).append(each)
    others = (
        capsule
        for (body, _), each in kept.items()
        for capsule in _together(each, [one for one in own if place[one.body] == body], body in exact)
    )
    return (*own, *others)


def _together(members: list[LinkCapsule], known: list[LinkCapsule], exact: bool) -> Iterator[LinkCapsule]:
    """The hull of capsules of one radius, from corner to corner, less the corners that are known."""
    radius = members[0].radius
    around = Outline.convex(_ends(members), radius)
    corners = around.points if exact else with_fewer_corners(around).points
    if known:
        distance = abs(corners[:, None] - _ends([each for each in known if each.radius == radius])[None, :])
        corners = corners[distance.min(axis=1, initial=np.inf) > SAME]
    for first in range(0, len(corners), 2):
        start, end = complex(corners[first]), complex(corners[min(first + 1, len(corners) - 1)])
        nearest = members[int(abs(_ends(members) - start).argmin()) % len(members)]
        yield LinkCapsule(nearest.link, nearest.body, start, end, radius)


def _ends(capsules: Sequence[LinkCapsule]) -> ComplexArray:
    return np.array([*(each.start for each in capsules), *(each.end for each in capsules)], dtype=np.complex128)


def _places(tree: PlanarTree) -> list[int]:
    """Of each body the first that always is where it is, turned as it is: legs that are coupled left to right."""
    count = len(tree.mass)
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, tree.turns.shape[1]))
    rotations = tree.rotations(tree.absolute_angles(np.zeros(POSTURES), postures))
    bodies = np.repeat(np.arange(count), 2)
    weights = tree.point_weights(bodies, np.tile(np.array([0j, 1 + 0j]), count))
    where = (rotations @ weights.T).reshape(POSTURES, count, 2)
    apart = abs(where[:, :, None] - where[:, None, :]).max(axis=(0, 3))
    return [int(np.flatnonzero(row <= SAME)[0]) for row in apart]
