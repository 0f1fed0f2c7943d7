"""Distances between links and obstacles, (19) to (23), for all times.

Everything is expressed in the frame that turns with the base about the centre of mass. A point seen from a segment
has the components x along it and y across it; its distance from the segment of length L is ``|y|`` where
0 <= x <= L, and the distance from the nearer end elsewhere. Two segments that are disjoint at one instant stay disjoint
as long as no end of one comes to lie on the other, so that four distances between points and segments prove a distance
between segments.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.bernstein import bernstein, lower, upper
from floatplan.certificate.branch_and_bound import Items
from floatplan.certificate.cells import ORDER
from floatplan.certificate.enclosure import PRECISION, ROUND, Balls, Taylor, up
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.shapes import PlacedShapes
from floatplan.certificate.vectors import Vectors, join_vectors

ROUGH = 1e-9  # [m] more than the rounding of a distance in the first look at all cells


@dataclass(frozen=True, eq=False)
class PointSegments:
    """Pairs of a point and a segment, in the base frame.

    ``point``, ``start`` and ``direction`` (K, cells, pairs, or 1 for all) are where the point and the segment are;
    ``length`` and ``radius`` (pairs,) the segment's length and the sum of both radii, m.
    """

    point: Vectors
    start: Vectors
    direction: Vectors
    length: Balls
    radius: Balls

    def place(self, cell: IntArray, pair: IntArray) -> Vectors:
        """The points' components (K, items) along and across their segments, from the segments' starts."""
        point, start, direction = (part.picked(cell, pair) for part in (self.point, self.start, self.direction))
        return (point - start).turned_back(direction)

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms of x, y and the squared distances from both ends, where the smallest distance may be."""
        cell, pair = self._possible(cells)
        place, length = self.place(cell, pair), self.length[pair]
        near = place.x * place.x + place.y * place.y
        square = length.mid * length.mid
        squared = Balls(square, up(2.0 * ROUND * square + (2.0 * length.mid + length.rad) * length.rad))
        far = near - place.x.times(Balls(2.0 * length.mid, 2.0 * length.rad)) + Taylor.constant(squared, ORDER)
        return Items.on_cells([bernstein(model) for model in (place.x, place.y, near, far)], cell, pair)

    def _possible(self, cells: IntArray) -> tuple[IntArray, IntArray]:
        """Cells and pairs that may hold the smallest distance.

        The distance in the middle of a cell changes over the cell by no more than the point, the segment's start, and
        its direction times the length do. What is then still farther than some pair's distance in a middle is left
        out.
        """
        points, starts, directions = (part.on(cells) for part in (self.point, self.start, self.direction))
        x, y = points.x - starts.x, points.y - starts.y
        along, across = directions.x * x + directions.y * y, directions.x * y - directions.y * x
        length = self.length.mid + self.length.rad
        distance = np.hypot(np.maximum(0.0, np.maximum(-along, along - length)), across) - self.radius.mid
        reach = np.hypot(x, y) + length
        known = (
            ROUGH * (1.0 + reach) + points.radius + starts.radius + 4.0 * reach * directions.radius + self.length.rad
        )
        change = points.spread + starts.spread + length * directions.spread
        return _may_be_least(distance - known - change, distance + known, cells)

    def below(self, forms: Taylor, pair: IntArray) -> Array:
        """Lower bound on the distance between the surfaces over the items."""
        (left, low_y, near, far), (right, high_y) = lower(forms), upper(forms[:2])
        length = self.length[pair]
        across = np.maximum(0.0, np.maximum(low_y, -high_y))
        beyond = np.maximum(0.0, np.maximum(-right, left - (length.mid + length.rad) * (1.0 + 4.0 * ROUND)))
        distance = np.hypot(beyond, across) * (1.0 - 4.0 * ROUND)
        ends = np.where(right <= 0.0, near, np.where(beyond > 0.0, far, 0.0))
        distance = np.maximum(distance, np.sqrt(np.maximum(ends, 0.0)) * (1.0 - 4.0 * ROUND))
        radius = self.radius[pair]
        bound = distance - radius.mid - radius.rad
        return np.asarray(bound - 4.0 * ROUND * (distance + radius.mid))

    def at_point(self, values: Balls, pair: IntArray) -> Array:
        """Upper bound on the distance between the surfaces where x and y have these values."""
        x, y, length, radius = values[0], values[1], self.length[pair], self.radius[pair]
        beyond = np.maximum(0.0, np.maximum(-x.mid, x.mid - length.mid))
        distance = np.hypot(beyond, y.mid)
        known = x.rad + y.rad + length.rad + radius.rad
        rounding = 8.0 * ROUND * (distance + np.abs(x.mid) + length.mid + radius.mid)
        return np.asarray(distance - radius.mid + up(known + rounding))


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Points of the shapes and their heights above a half-plane: ``normal . point + offset - radius``.

    ``point`` (K, cells, points), ``normal`` and ``offset`` (K, cells, 1) are given in the base frame; ``radius`` is
    (points,).
    """

    point: Vectors
    normal: Vectors
    offset: Taylor
    radius: Balls

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms of the heights, where the smallest may be."""
        cell, index = self._possible(cells)
        point, normal = self.point.picked(cell, index), self.normal.picked(cell, index)
        offset = self.offset[cell, 0] - Taylor.constant(self.radius[index], ORDER)
        return Items.on_cells([bernstein(normal.x * point.x + normal.y * point.y + offset)], cell, index)

    def _possible(self, cells: IntArray) -> tuple[IntArray, IntArray]:
        points, normals = self.point.on(cells), self.normal.on(cells)
        offset = self.offset[cells]
        height = normals.x * points.x + normals.y * points.y + offset.c[0] - self.radius.mid
        reach = np.hypot(points.x, points.y)
        known = ROUGH * (1.0 + reach + np.abs(offset.c[0])) + 2.0 * points.radius + 2.0 * reach * normals.radius
        change = (
            np.abs(offset.c[1:]).sum(axis=0) + 2.0 * points.spread * (1.0 + normals.spread) + reach * normals.spread
        )
        return _may_be_least(height - known - offset.e - change, height + known + offset.e, cells)

    def least_at_start(self) -> float:
        """The smallest height at the beginning, to within rounding."""
        point, normal = (Vectors(part.x[0], part.y[0]) for part in (self.point, self.normal))
        height = (normal.x * point.x + normal.y * point.y + self.offset[0]).at_end(-1.0)
        return float((height.mid - self.radius.mid).min())

    def below(self, forms: Taylor, point: IntArray) -> Array:
        """Lower bound over the items."""
        return lower(forms[0])

    def at_point(self, values: Balls, point: IntArray) -> Array:
        """Upper bound at a point."""
        height = values[0]
        return np.asarray(height.mid + up(height.rad + 2.0 * ROUND * np.abs(height.mid)))


def to_base_frame(flight: FlightEnclosure, vectors: Vectors) -> Vectors:
    """Turn vectors (K, cells, items) of the world back by the orientation."""
    return vectors.turned_back(flight.direction)


def points_to_shapes(points: Vectors, shapes: PlacedShapes, radius: float) -> PointSegments:
    """Pairs of one point, given in the base frame with a radius, with every shape."""
    return PointSegments(points, shapes.start, shapes.direction, shapes.length, _added(shapes.radius, radius))


def shapes_to_segment(
    shapes: PlacedShapes, start: Vectors, direction: Vectors, length: Any, radius: float
) -> PointSegments:
    """Pairs of both ends of every shape with one segment, given in the base frame: all starts, then all ends."""
    count = 2 * len(shapes.shapes)
    with flint.ctx.workprec(PRECISION):
        lengths = Balls.from_arb([length] * count, (count,))
    return PointSegments(_ends(shapes), start, direction, lengths, _added(_doubled(shapes.radius), radius))


def heights(shapes: PlacedShapes, normal: Vectors, offset: Taylor) -> PlanePoints:
    """Heights of both ends of every shape, in the base frame."""
    return PlanePoints(_ends(shapes), normal, offset, _doubled(shapes.radius))


def join_pairs(parts: list[PointSegments]) -> PointSegments:
    """All pairs of several sets."""
    counts = [len(part.length.mid) for part in parts]
    point, start, direction = (
        join_vectors([getattr(part, name).repeated(count) for part, count in zip(parts, counts, strict=True)])
        for name in ("point", "start", "direction")
    )
    lengths, radii = (
        Balls(np.concatenate([ball.mid for ball in balls]), np.concatenate([ball.rad for ball in balls]))
        for balls in ([part.length for part in parts], [part.radius for part in parts])
    )
    return PointSegments(point, start, direction, lengths, radii)


def only_pairs(pairs: PointSegments, index: list[int]) -> PointSegments:
    """Some of the pairs."""
    point, start, direction = (part.chosen(index) for part in (pairs.point, pairs.start, pairs.direction))
    return PointSegments(point, start, direction, pairs.length[index], pairs.radius[index])


def apart_at_start(of_ends: PointSegments, cell: int) -> bool | None:
    """Whether a segment lies apart from another, whose ends are pairs 0 and 1, at the start of a cell.

    True if both ends are strictly on one side of the segment's line, or both beyond the same end of it; False if they
    are strictly on different sides; None otherwise. Two segments cross where both see the other's ends on different
    sides.
    """
    place = of_ends.place(np.array([cell, cell]), np.array([0, 1]))
    x, y, length = place.x.at_end(-1.0), place.y.at_end(-1.0), of_ends.length
    same_side = (y.mid > y.rad).all() or (y.mid < -y.rad).all()
    before = (x.mid < -x.rad).all()
    after = (x.mid - x.rad > (length.mid + length.rad) * (1.0 + 2.0 * ROUND)).all()
    if same_side or before or after:
        return True
    beside = (np.abs(y.mid) > y.rad).all() and np.sign(y.mid[0]) != np.sign(y.mid[1])
    return False if beside else None


def _may_be_least(low: Array, high: Array, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Cells and members, among (cells, members), that the smallest value of all may belong to; unknowns included."""
    row, member = np.nonzero(~(low > np.fmin.reduce(high, axis=None, initial=np.inf)))
    return cells[row], member


def _ends(shapes: PlacedShapes) -> Vectors:
    return join_vectors([shapes.start, shapes.end])


def _doubled(balls: Balls) -> Balls:
    return Balls(np.tile(balls.mid, 2), np.tile(balls.rad, 2))


def _added(radii: Balls, radius: float) -> Balls:
    total = radii.mid + radius
    return Balls(total, up(radii.rad + ROUND * np.abs(total)))
