"""The tightest capsules around a set of points in the plane. Points are complex numbers, horizontal + i vertical."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray, distinct

MOST_SPLITS = 2  # [-] one after the other: at most four capsules
OUTSIDE = 1e-3  # [m] by which a polygon of fewer corners may reach beyond a convex hull


@dataclass(frozen=True)
class PlaneCapsule:
    """All points within ``radius`` of the segment from ``start`` to ``end``."""

    start: complex
    end: complex
    radius: float

    @property
    def area(self) -> float:
        """Area, m^2."""
        return float(np.pi * self.radius**2 + 2.0 * self.radius * abs(self.end - self.start))

    def depth(self, points: ComplexArray) -> Array:
        """How far inside the capsule each point is (points,), m; negative outside."""
        along = self.end - self.start
        fraction = np.zeros(len(points))
        if along != 0:
            fraction = np.clip(((points - self.start) * np.conj(along)).real / abs(along) ** 2, 0.0, 1.0)
        return np.asarray(self.radius - abs(points - self.start - fraction * along), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Outline:
    """A shape: all points within ``radius`` of the convex pieces that ``points`` (k,) and ``edges`` (e, 2) span."""

    points: ComplexArray
    edges: IntArray
    radius: float = 0.0

    @classmethod
    def convex(cls, points: ComplexArray, radius: float = 0.0) -> Outline:
        """The convex hull of ``points``, grown by ``radius``."""
        hull = convex_hull(points)
        count = np.arange(len(hull))
        return cls(hull, np.stack([count, np.roll(count, -1)], axis=1), radius)


def fit(outline: Outline, splits: int = MOST_SPLITS) -> list[PlaneCapsule]:
    """Return capsules that cover the outline: one, or more where these are much tighter."""
    whole = fit_capsule(outline.points, outline.radius)
    if splits == 0 or whole.start == whole.end:
        return [whole]
    direction = (whole.end - whole.start) / abs(whole.end - whole.start)
    along = (outline.points * np.conj(direction)).real
    least = 0.75 * whole.area  # two capsules have to be that much tighter than one
    best = []
    for cut in (1 / 3, 1 / 2, 2 / 3):  # of the length
        halves = _halves(outline, direction, float(along.min() + cut * np.ptp(along)))
        area = sum(fit_capsule(half.points, half.radius).area for half in halves)
        if area < least:
            least = area
            best = halves
    return [capsule for half in best for capsule in fit(half, splits - 1)] or [whole]


def fit_capsule(points: ComplexArray, radius: float = 0.0) -> PlaneCapsule:
    """Return a capsule of nearly least area that covers every disc of ``radius`` around ``points``."""
    hull = convex_hull(points)
    if len(hull) == 1:
        return PlaneCapsule(complex(hull[0]), complex(hull[0]), radius)
    sides = np.roll(hull, -1) - hull
    longest = sides[np.argsort(-abs(sides))[:64]]
    uniform = np.exp(1j * np.pi * np.arange(24) / 24)  # over half a rotation, besides those of the hull's edges
    directions = np.concatenate([longest / abs(longest), uniform])
    radii = np.linspace(0.0, 1.0, 9)  # fractions, from half the width to half the diagonal
    # of a hull of thousands of corners some directions at a time: a million numbers in an array at most
    block = max(1, 1_000_000 // (len(radii) * len(hull)))
    blocks = [directions[first : first + block] for first in range(0, len(directions), block)]
    candidates = [_tightest(hull, block_of_directions, radii, radius) for block_of_directions in blocks]
    _, direction, middle, low_end, high_end = min(candidates, key=lambda candidate: candidate[0])
    start = complex(direction * (low_end + 1j * middle))
    end = complex(direction * (high_end + 1j * middle))
    return PlaneCapsule(start, end, float(-PlaneCapsule(start, end, 0.0).depth(hull).min() + radius))


def _tightest(
    hull: ComplexArray, directions: ComplexArray, radii: Array, radius: float
) -> tuple[float, complex, float, float, float]:
    """The least area, m^2, of capsules along some directions; its direction, and its middle and both ends along it, m.

    They are those around a hull's corners, grown by ``radius``; ``radii`` are fractions of their range that are tried.
    """
    rotated = hull * np.conj(directions)[:, None]  # (directions, points): the capsule's axis becomes the real one
    along = rotated.real
    across = rotated.imag
    middle = (across.max(axis=1) + across.min(axis=1)) / 2
    offset = across - middle[:, None]
    least = abs(offset).max(axis=1)
    most = np.hypot(least, np.ptp(along, axis=1) / 2)
    grown = least[:, None] + radii * (most - least)[:, None]  # (directions, radii)
    reach = np.sqrt(np.maximum(grown[:, :, None] ** 2 - offset[:, None, :] ** 2, 0.0))
    high = (along[:, None, :] - reach).max(axis=2)
    low = (along[:, None, :] + reach).min(axis=2)
    length = np.maximum(high - low, 0.0)
    area = np.pi * (grown + radius) ** 2 + 2.0 * (grown + radius) * length
    row, column = np.unravel_index(int(area.argmin()), area.shape)
    low_end = low[row, column]
    high_end = high[row, column]
    # a disc: below zero, any centre between them covers all points
    if high_end - low_end < 1e-9 * most[row]:
        low_end = high_end = (low_end + high_end) / 2
    return float(area[row, column]), complex(directions[row]), float(middle[row]), float(low_end), float(high_end)


def convex_hull(points: ComplexArray) -> ComplexArray:
    """Corners of the convex hull, counter-clockwise; A. M. Andrew, Information Processing Letters 9 (1979), p. 216."""
    candidates = distinct(_outer(points))
    if len(candidates) <= 2:
        return candidates
    corners: list[complex] = []
    for ordered in (candidates.tolist(), candidates[::-1].tolist()):
        chain: list[complex] = []
        for point in ordered:
            while len(chain) > 1 and ((chain[-1] - chain[-2]).conjugate() * (point - chain[-2])).imag <= 0.0:
                chain.pop()
            chain.append(point)
        corners += chain[:-1]
    return np.array(corners, dtype=np.complex128)


def with_fewer_corners(outline: Outline) -> Outline:
    """Return a polygon about a convex outline, no farther from it than ``OUTSIDE``: some of its own sides, prolonged.

    What rests on one of these sides rests as it does on the outline itself.
    """
    corners = outline.points
    count = len(corners)
    if count < 4:
        return outline
    sides = np.roll(corners, -1) - corners
    first = side = int(abs(sides).argmax())
    remaining: list[complex] = []
    while side < first + count:
        next_side = side + 1
        corner = complex(corners[(side + 1) % count])
        while next_side < first + count:
            beyond = _meeting(corners, sides, side, next_side + 1)
            if beyond is None:
                break
            next_side += 1
            corner = beyond
        remaining.append(corner)
        side = next_side
    return Outline.convex(np.array(remaining), outline.radius)


def _meeting(corners: ComplexArray, sides: ComplexArray, side: int, other: int) -> complex | None:
    """Where two sides of a polygon, counted around it, meet when prolonged; None where that is too far outside."""
    count = len(corners)
    own = sides[side % count]
    next_ = sides[other % count]
    slope = (own.conjugate() * next_).imag
    if not slope > 1e-9 * abs(own) * abs(next_):  # parallel, or half a rotation and more from one another
        return None
    reach = ((corners[other % count] - corners[side % count]).conjugate() * next_).imag / slope
    meeting = corners[side % count] + reach * own
    between = np.arange(side + 1, other) % count
    depths = [PlaneCapsule(corners[i], corners[i] + sides[i], 0.0).depth(np.array([meeting])) for i in between]
    return complex(meeting) if np.max(depths) >= -OUTSIDE else None


def _outer(points: ComplexArray) -> ComplexArray:
    """Points less those strictly inside the polygon of a few extreme ones: a mesh has thousands of these."""
    for count in (8, 32, 96):  # corners of the polygon
        if len(points) < 2 * count:
            break
        around = np.exp(2j * np.pi * np.arange(count) / count)
        extreme = [int((points * np.conj(direction)).real.argmax()) for direction in around]  # few arrays at a time
        corners = points[np.unique(extreme)]
        corners = corners[np.argsort(np.angle(corners - corners.mean()))]
        sides = np.roll(corners, -1) - corners
        inside = np.ones(len(points), dtype=bool)
        for corner, side in zip(corners, sides, strict=True):
            inside &= ((points - corner) * np.conj(side)).imag > 0.0
        points = points[~inside]
    return points


def _halves(outline: Outline, direction: complex, level: float) -> list[Outline]:
    """The outline on either side of the line whose component along a unit vector is ``level``.

    An edge that crosses the line is cut there, and leaves a point on the line, on both sides. The cross-section inside
    the shape is covered by the whole line between these points, so that both halves contain it.
    """
    rotated = outline.points * np.conj(direction)
    along = rotated.real
    begin, finish = outline.edges.T
    crossing = (along[begin] - level) * (along[finish] - level) < 0.0
    begin = begin[crossing]
    finish = finish[crossing]
    fraction = (level - along[begin]) / (along[finish] - along[begin])
    height = rotated.imag[begin] + fraction * (rotated.imag[finish] - rotated.imag[begin])
    on_line = np.concatenate([np.flatnonzero(along == level), len(along) + np.arange(len(height))])
    points = np.concatenate([outline.points, direction * (level + 1j * height)])
    line = on_line[np.argsort((points[on_line] * np.conj(direction)).imag)]
    halves = []
    for side in (along <= level, along >= level):
        whole_edges = outline.edges[side[outline.edges].all(axis=1)]
        shortened = np.stack([np.where(side[begin], begin, finish), len(along) + np.arange(len(height))], axis=1)
        edges = np.concatenate([whole_edges, shortened, np.stack([line[:-1], line[1:]], axis=1)])
        members = np.concatenate([np.flatnonzero(side), len(along) + np.arange(len(height))])
        index = np.zeros(len(points), dtype=np.int64)
        index[members] = np.arange(len(members))
        halves.append(Outline(points[members], index[edges], outline.radius))
    return halves
