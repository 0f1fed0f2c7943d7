"""Capsules in space around the links' solids: tight ones, of which a solid has up to four where that is much tighter.

They hold the solids, so that a clearance of the capsules is one of the link. Those of a ball or a capsule are itself; a
link without ``<collision>`` is the segments between its joints, of radius 0.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from floatplan.arrays import Array, IntArray
from floatplan.robot.planar.tree import SAME
from floatplan.robot.shapes.solids import LinkSolid, SolidCapsule, evenly

DIRECTIONS = 16  # [-] over half of all, in which the axis of a capsule around many points may lie
# the 24 corners of a polygon around the unit disc, which is 0.9 % larger
AROUND = np.exp(2j * np.pi * np.arange(24) / 24) / np.cos(np.pi / 24)


def solid_capsules(solids: Sequence[LinkSolid]) -> tuple[SolidCapsule, ...]:
    """Return the capsules around solids, in their order; of one link those inside another are left out."""
    capsules: list[SolidCapsule] = []
    for _, own in itertools.groupby(solids, key=lambda solid: solid.link):
        fitted = []
        for solid in own:
            points, grown_by = _rounded(solid)
            fitted += [SolidCapsule(solid.link, solid.body, *ends) for ends in fit(points, grown_by)]
        capsules += _outermost(fitted)
    return tuple(capsules)


Ends = tuple[Array, Array, float]  # start (3,), end (3,), radius, m


def _rounded(solid: LinkSolid) -> tuple[Array, float]:
    """Points (k, 3) and a radius, m, whose convex hull, grown by the radius, is the solid or holds it."""
    lengths = np.linalg.norm(solid.axes, axis=0)
    order = np.argsort(lengths)
    least, middle, most = lengths[order].tolist()
    if most - least < SAME:
        return solid.points, most
    if least < SAME:  # a cylinder's disc
        rim = AROUND.real[:, None] * solid.axes[:, order[1]] + AROUND.imag[:, None] * solid.axes[:, order[2]]
        return (solid.points[:, None] + rim).reshape(-1, 3), 0.0
    # An ellipsoid is in the capsule along its longest axis that is as thick as the next one, and as long as it.
    spine = (most - middle) / most * solid.axes[:, order[2]]
    return np.concatenate((solid.points - spine, solid.points + spine)), middle


def fit(points: Array, radius: float, splits: int = 2) -> list[Ends]:
    """Return capsules that contain the convex hull of points (k, 3), grown by a radius, m."""
    whole = _fit_one(points, radius)
    start, end, _ = whole
    length = float(np.linalg.norm(end - start))
    least = 0.75 * _volume(whole)  # two capsules replace one where they cover at most 3/4 of its volume
    if splits == 0 or length < SAME or len(points) < 4:
        return [whole]
    points, edges, volume = _hull(points)
    if volume > least:
        return [whole]
    direction = (end - start) / length
    along = points @ direction
    best = list[Array]()
    for cut in (1 / 3, 1 / 2, 2 / 3):  # of the length
        halves = _halves(points, edges, direction, float(along.min() + cut * np.ptp(along)))
        volume = sum(_volume(_fit_one(half, radius)) for half in halves)
        if volume < least:
            least = volume
            best = halves
    capsules = []
    for half in best:
        capsules += fit(half, radius, splits - 1)
    return capsules or [whole]


def _volume(capsule: Ends) -> float:
    return SolidCapsule("", 0, *capsule).volume


def _fit_one(points: Array, radius: float) -> Ends:
    """A capsule of nearly least volume that holds balls of a radius around points (k, 3)."""
    spread = points - points.mean(axis=0)
    if len(points) <= 2 or np.abs(spread).max() < SAME:
        return points[0], points[-1], radius
    directions = _directions(points, spread)
    # Two unit vectors across each direction; a point is then a height along it and a complex number across.
    across = np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    height = directions @ points.T  # (directions, points)
    projected = across @ points.T + 1j * (np.cross(directions, across) @ points.T)
    middle = _middles(projected)
    offset = np.abs(projected - middle[:, None])
    least = offset.max(axis=1)
    most = np.hypot(least, np.ptp(height, axis=1) / 2)
    # nine radii for each axis, from the least that holds the points to half their diagonal
    grown = least[:, None] + np.linspace(0.0, 1.0, 9) * (most - least)[:, None]  # (directions, radii)
    reach = np.sqrt(np.maximum(grown[:, :, None] ** 2 - offset[:, None] ** 2, 0.0))
    high = (height[:, None] - reach).max(axis=2)
    low = (height[:, None] + reach).min(axis=2)
    volume = (grown + radius) ** 2 * (np.maximum(high - low, 0.0) + 4 / 3 * (grown + radius))
    row, column = np.unravel_index(int(volume.argmin()), volume.shape)
    lowest = float(low[row, column])
    highest = float(high[row, column])
    if highest - lowest < SAME:  # a ball: below zero, any centre between them holds all points
        lowest = highest = (lowest + highest) / 2
    axis = directions[row]
    aside = across[row]
    center = middle[row].real * aside + middle[row].imag * np.cross(axis, aside)
    start = center + lowest * axis
    end = center + highest * axis
    outside = -SolidCapsule("", 0, start, end, 0.0).depth(points)
    return start, end, float(outside.max()) + radius


def _directions(points: Array, spread: Array) -> Array:
    """Unit vectors (d, 3) in which the axis of a capsule may lie: principal axes, some in all directions, edges."""
    principal: Array = np.linalg.eigh(spread.T @ spread)[1].T
    candidates = [principal, evenly(2 * DIRECTIONS)[:DIRECTIONS]]
    # of few points differences are tried as axes too: edges and diagonals of a box are among them
    if len(points) <= 16:
        first, second = np.triu_indices(len(points), 1)
        edges = points[second] - points[first]
        lengths = np.linalg.norm(edges, axis=1)
        candidates.append(edges[lengths > SAME] / lengths[lengths > SAME, None])
    return np.asarray(np.concatenate(candidates))


def _middles(places: Array) -> Array:
    """Middles (d,) of nearly the least circles around complex points (d, k).

    From the middle of the box around them steps go to the point that is farthest away, ever shorter: M. Badoiu and
    K. L. Clarkson, Smaller core-sets for balls, SODA 2003.
    """
    rows = np.arange(len(places))
    middle = (places.real.max(axis=1) + places.real.min(axis=1)) / 2 + 0j
    middle += 1j * (places.imag.max(axis=1) + places.imag.min(axis=1)) / 2
    best = middle.copy()
    least = np.full(len(places), np.inf)
    for step in range(40):  # 40 steps leave 2 % of the radius
        offset = np.abs(places - middle[:, None])
        farthest = offset.argmax(axis=1)
        nearer = offset[rows, farthest] < least
        best[nearer], least[nearer] = middle[nearer], offset[rows, farthest][nearer]
        middle = middle + (places[rows, farthest] - middle) / (step + 2)
    return np.asarray(best)


def _hull(points: Array) -> tuple[Array, IntArray, float]:
    """Corners (c, 3) of the convex hull of points, its edges (e, 2), and its volume, m^3; points that are flat stay."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        return points, np.stack(np.triu_indices(len(points), 1), axis=1), 0.0
    number = np.zeros(len(points), np.int64)
    number[hull.vertices] = np.arange(len(hull.vertices))
    sides = hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    return points[hull.vertices], np.unique(np.sort(number[sides], axis=1), axis=0), float(hull.volume)


def _halves(points: Array, edges: IntArray, direction: Array, level: float) -> list[Array]:
    """Points of both parts of a convex hull of corners and edges, on either side of a plane across a direction."""
    height = points @ direction - level
    first, second = edges[height[edges[:, 0]] * height[edges[:, 1]] < 0].T
    share = (height[first] / (height[first] - height[second]))[:, None]
    cut = points[first] * (1 - share) + points[second] * share
    return [np.concatenate((half, cut)) for half in (points[height >= 0], points[height <= 0])]


def _outermost(capsules: list[SolidCapsule]) -> list[SolidCapsule]:
    """Capsules less those inside another; of two that are the same, the first stays."""
    outermost: list[SolidCapsule] = []
    for number, one in enumerate(capsules):
        ends = np.stack((one.start, one.end))
        inside = False
        for position, other in enumerate(capsules):
            depth = other.depth(ends).min() - one.radius
            inside |= position != number and bool(depth > SAME or (depth >= -SAME and position < number))
        if not inside:
            outermost.append(one)
    return outermost
