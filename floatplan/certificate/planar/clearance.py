"""The links' shapes in flight, and distances between them and obstacles, (19) to (23), for all times.

Everything is expressed in the frame that turns with the base about the centre of mass. A point seen from a segment
has the components x along it and y across it; its distance from the segment of length L is ``|y|`` where
0 <= x <= L, and the distance from the nearer end elsewhere. Two segments that are disjoint at one instant stay disjoint
as long as no end of one comes to lie on the other, so that four distances between points and segments prove a distance
between segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeAlias

import flint
import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.certificate.branch_and_bound import ROUGH, Items, bernstein, lower, may_be_least, upper
from floatplan.certificate.cells import ORDER, ComplexBalls, Vectors, join_vectors
from floatplan.certificate.enclosure import PRECISION, ROUND, Balls, Taylor, up
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot, Point

LinkShape: TypeAlias = tuple[str, Sequence[float], Sequence[float], float]


@dataclass(frozen=True)
class Shape:
    """All points within ``radius`` (m) of the segment between two points of a link."""

    link: str
    start: Point
    end: Point
    radius: float


@dataclass(frozen=True, eq=False)
class ShapeWeights:
    """Shapes as constants: ``points`` (3 shapes, m) are the weights of all starts, all ends and all directions."""

    shapes: tuple[Shape, ...]
    points: ComplexBalls
    length: Balls


@lru_cache(maxsize=8)
def shape_weights(robot: PlanarRobot, link_shapes: tuple[LinkShape, ...] | None) -> ShapeWeights:
    """Shapes from (link, start, end, radius); None stands for the paper's links.

    These are the segments from each link's origin to its children's joints, with radius 0.
    """
    shapes: list[Shape] = []
    if link_shapes is None:
        for link, pairs in robot.segments.items():
            shapes += [Shape(link, start, end, 0.0) for start, end in pairs]
    else:
        if any(not 0.0 <= float(radius) < float("inf") for *_, radius in link_shapes):
            raise ValueError("the radius of a shape is negative")
        for link, start, end, radius in link_shapes:
            shape = Shape(link, robot.link_point(link, start), robot.link_point(link, end), float(radius))
            shapes.append(shape)
    count = len(robot.weights)
    rows = []
    lengths = []
    with flint.ctx.workprec(PRECISION):
        for shape in shapes:
            rows += robot.weights_of(shape.start)
        for shape in shapes:
            rows += robot.weights_of(shape.end)
        for shape in shapes:
            along = shape.end.local - shape.start.local
            lengths.append(abs(along))
            row = [flint.acb(0)] * count
            # below 1e-9 m a segment has no direction: its ends count as two points
            row[shape.start.body] = along / lengths[-1] if lengths[-1] > 1e-9 else flint.acb(1)
            rows += row
        points = ComplexBalls.from_acb(rows, (3 * len(shapes), count))
        return ShapeWeights(tuple(shapes), points, Balls.from_arb(lengths, (len(shapes),)))


@dataclass(frozen=True, eq=False)
class Bars:
    """Segments with a radius, seen from the frame that turns with the base about the centre of mass.

    ``start``, ``end`` and ``direction``, of unit length, are models (K, cells, bars) or (K, cells, 1) for all;
    ``length`` and ``radius`` (bars,), m.
    """

    start: Vectors
    end: Vectors
    direction: Vectors
    length: Balls
    radius: Balls

    def __getitem__(self, index: Sequence[int]) -> Bars:
        """Some of the bars, maybe repeatedly."""
        chosen = list(index)
        start = self.start.items(chosen)
        end = self.end.items(chosen)
        direction = self.direction.items(chosen)
        return Bars(start, end, direction, self.length[chosen], self.radius[chosen])


def shapes_in_base(flight: FlightEnclosure, weights: ShapeWeights) -> Bars:
    """Where the shapes are at all times."""
    count = len(weights.shapes)
    placed = weights.points.times(flight.joints.cos, flight.joints.sin)
    start = placed[..., :count]
    end = placed[..., count : 2 * count]
    direction = placed[..., 2 * count :]
    return Bars(start, end, direction, weights.length, Balls.exact([shape.radius for shape in weights.shapes]))


@dataclass(frozen=True, eq=False)
class PointSegments:
    """Pairs of a point and a segment, in the base frame.

    ``point``, ``start`` and ``direction`` (K, cells, pairs, or 1 for all) are where the point and the segment are;
    ``length`` and ``radius`` (pairs,) the segment's length and the sum of both radii, m. Where pairs belong to couples
    of bars, ``couples`` (c, 4) are the pairs of start and end of the one bar, and of those of the other.
    """

    point: Vectors
    start: Vectors
    direction: Vectors
    length: Balls
    radius: Balls
    couples: IntArray = field(default_factory=lambda: np.empty((0, 4), dtype=np.int64))

    @classmethod
    def of_points(cls, points: Vectors, radius: Balls, bars: Bars) -> PointSegments:
        """Pairs of points with a radius and bars; one of either stands for all."""
        both = bars.radius + radius
        return cls(points, bars.start, bars.direction, bars.length.broadcast(both.mid.shape), both)

    @classmethod
    def of_bars(cls, first: Bars, second: Bars) -> PointSegments:
        """Pairs of the ends of each bar with the bar of the same number; one of either stands for all."""
        couples = ((first, second), (second, first))
        sets = []
        for one, other in couples:
            sets.append(cls.of_points(one.start, one.radius, other))
            sets.append(cls.of_points(one.end, one.radius, other))
        pairs = cls.joined(sets)
        return replace(pairs, couples=np.arange(len(pairs.radius.mid)).reshape(4, -1).T)

    @classmethod
    def joined(cls, sets: Sequence[PointSegments]) -> PointSegments:
        """The pairs of several sets, as of an obstacle made of several pieces."""
        counts = [len(pairs.radius.mid) for pairs in sets]
        point = join_vectors([pairs.point for pairs in sets], counts)
        start = join_vectors([pairs.start for pairs in sets], counts)
        direction = join_vectors([pairs.direction for pairs in sets], counts)
        length = Balls.joined([pairs.length for pairs in sets])
        radius = Balls.joined([pairs.radius for pairs in sets])
        firsts = np.cumsum([0, *counts[:-1]])
        couples = np.concatenate([pairs.couples + first for pairs, first in zip(sets, firsts, strict=True)])
        return cls(point, start, direction, length, radius, couples)

    def along_and_across(self, cell: IntArray, pair: IntArray) -> Vectors:
        """The points' components (K, items) along and across their segments, from the segments' starts."""
        point = self.point.on(cell, pair)
        start = self.start.on(cell, pair)
        direction = self.direction.on(cell, pair)
        return (point - start).turned_back(direction)

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms of x, y and the squared distances from both ends, where the smallest distance may be."""
        cell, pair = self._possible(cells)
        point = self.along_and_across(cell, pair)
        length = self.length[pair]
        near = point.x * point.x + point.y * point.y
        square = length.mid * length.mid
        squared = Balls(square, up(2.0 * ROUND * square + (2.0 * length.mid + length.rad) * length.rad))
        far = near - point.x.times(Balls(2.0 * length.mid, 2.0 * length.rad)) + Taylor.constant(squared, ORDER)
        return Items.on_cells(list(map(bernstein, (point.x, point.y, near, far))), cell, pair)

    def _possible(self, cells: IntArray) -> tuple[IntArray, IntArray]:
        """Cells and pairs that may hold the smallest distance.

        The distance in the middle of a cell changes over the cell by no more than the point, the segment's start, and
        its direction times the length do. What is then still farther than some pair's distance in a middle is left
        out.
        """
        point_x, point_y, point_radius, point_spread = _in_middle(self.point, cells)
        start_x, start_y, start_radius, start_spread = _in_middle(self.start, cells)
        cos, sin, rotation_radius, rotation_spread = _in_middle(self.direction, cells)
        x = point_x - start_x
        y = point_y - start_y
        along = cos * x + sin * y
        across = cos * y - sin * x
        length = self.length.mid + self.length.rad
        distance = np.hypot(np.maximum(0.0, np.maximum(-along, along - length)), across) - self.radius.mid
        reach = np.hypot(x, y) + length
        radius = ROUGH * (1.0 + reach) + point_radius + start_radius + 4.0 * reach * rotation_radius + self.length.rad
        change = point_spread + start_spread + length * rotation_spread
        return may_be_least(distance - radius - change, distance + radius, cells)

    def below(self, forms: Taylor, pair: IntArray) -> Array:
        """Lower bound on the distance between the surfaces over the items."""
        (left, low_y, near, far) = lower(forms)
        (right, high_y) = upper(forms[:2])
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
        x = values[0]
        y = values[1]
        length = self.length[pair]
        radius = self.radius[pair]
        beyond = np.maximum(0.0, np.maximum(-x.mid, x.mid - length.mid))
        distance = np.hypot(beyond, y.mid)
        uncertainty = x.rad + y.rad + length.rad + radius.rad
        rounding = 8.0 * ROUND * (distance + np.abs(x.mid) + length.mid + radius.mid)
        return np.asarray(distance - radius.mid + up(uncertainty + rounding))

    def apart_at_start(self, cell: int) -> tuple[BoolArray, BoolArray]:
        """Whether each bar of a couple lies apart from the other, and whether it is across its line: (couples, 2).

        That is at the start of a cell. Apart is a bar whose ends are both strictly on one side of the other's segment,
        or both beyond the same end of it; across is one whose ends are strictly on different sides. Two segments cross
        where each is across the other's line, and neither apart.
        """
        pair = self.couples.ravel()
        point = self.along_and_across(np.full(len(pair), cell), pair)
        length = self.length[pair]
        x = point.x.at_end(-1.0)
        y = point.y.at_end(-1.0)
        beyond = x.mid - x.rad > (length.mid + length.rad) * (1.0 + 2.0 * ROUND)
        left = (y.mid > y.rad).reshape(-1, 2, 2)
        right = (y.mid < -y.rad).reshape(-1, 2, 2)
        before = (x.mid < -x.rad).reshape(-1, 2, 2)
        after = beyond.reshape(-1, 2, 2)
        apart = left.all(axis=2) | right.all(axis=2) | before.all(axis=2) | after.all(axis=2)
        return np.asarray(apart), np.asarray(left.any(axis=2) & right.any(axis=2))


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Points of the shapes and their heights above a half-plane: ``normal . point + offset - radius``.

    ``point`` (K, cells, points), ``normal`` and ``offset`` (K, cells, 1) are in the base frame; ``radius`` is
    (points,).
    """

    point: Vectors
    normal: Vectors
    offset: Taylor
    radius: Balls

    @classmethod
    def of_bars(cls, bars: Bars, normal: Vectors, offset: Taylor) -> PlanePoints:
        """Both ends of all bars."""
        count = len(bars.radius.mid)
        points = join_vectors([bars.start, bars.end], [count, count])
        return cls(points, normal, offset, Balls.joined([bars.radius, bars.radius]))

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms of the heights, where the smallest may be."""
        cell, index = self._possible(cells)
        point = self.point.on(cell, index)
        normal = self.normal.on(cell, index)
        offset = self.offset[cell, 0] - Taylor.constant(self.radius[index], ORDER)
        return Items.on_cells([bernstein(normal.x * point.x + normal.y * point.y + offset)], cell, index)

    def _possible(self, cells: IntArray) -> tuple[IntArray, IntArray]:
        x, y, point_radius, point_spread = _in_middle(self.point, cells)
        cos, sin, rotation_radius, rotation_spread = _in_middle(self.normal, cells)
        offset = self.offset[cells]
        height = cos * x + sin * y + offset.c[0] - self.radius.mid
        reach = np.hypot(x, y)
        uncertainty = ROUGH * (1.0 + reach + np.abs(offset.c[0])) + 2.0 * point_radius + 2.0 * reach * rotation_radius
        spread = np.abs(offset.c[1:]).sum(axis=0)
        change = spread + 2.0 * point_spread * (1.0 + rotation_spread) + reach * rotation_spread
        return may_be_least(height - uncertainty - offset.e - change, height + uncertainty + offset.e, cells)

    def least_at_start(self) -> float:
        """The smallest height at the beginning, to within rounding."""
        point, normal = (vectors[0] for vectors in (self.point, self.normal))
        height = (normal.x * point.x + normal.y * point.y + self.offset[0]).at_end(-1.0)
        return float((height.mid - self.radius.mid).min())

    def below(self, forms: Taylor, point: IntArray) -> Array:
        """Lower bound over the items."""
        return lower(forms[0])

    def at_point(self, values: Balls, point: IntArray) -> Array:
        """Upper bound at a point."""
        height = values[0]
        return np.asarray(height.mid + up(height.rad + 2.0 * ROUND * np.abs(height.mid)))


def _in_middle(vectors: Vectors, cells: IntArray) -> tuple[Array, Array, Array, Array]:
    """Vectors (cells, items) in the middle of cells, their radius there, and how far from there they get."""
    x = vectors.x[cells]
    y = vectors.y[cells]
    radius = x.e + y.e
    return x.c[0], y.c[0], radius, np.abs(x.c[1:]).sum(axis=0) + np.abs(y.c[1:]).sum(axis=0) + radius
