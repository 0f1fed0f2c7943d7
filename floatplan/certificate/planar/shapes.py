"""The links' shapes as the certificate sees them, with the models of where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import flint

from floatplan.certificate.enclosure import PRECISION, Balls
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot, Point
from floatplan.certificate.vectors import ComplexBalls, Vectors

LinkShape: TypeAlias = tuple[str, Sequence[float], Sequence[float], float]
MOST = 8  # sets of shapes kept
SHORTEST = 1e-9  # [m] below this a segment has no direction: its ends count as two points


@dataclass(frozen=True)
class Shape:
    """All points within ``radius`` (m) of the segment between two points of a link."""

    link: str
    start: Point
    end: Point
    radius: float


@dataclass(frozen=True, eq=False)
class PlacedShapes:
    """Shapes in the frame that turns with the base about the centre of mass; ``direction`` is of unit length."""

    shapes: tuple[Shape, ...]
    start: Vectors
    end: Vectors
    direction: Vectors
    length: Balls
    radius: Balls

    def only(self, index: Sequence[int]) -> PlacedShapes:
        """Return some of the shapes."""
        chosen = list(index)
        return PlacedShapes(
            tuple(self.shapes[i] for i in chosen),
            self.start.chosen(chosen),
            self.end.chosen(chosen),
            self.direction.chosen(chosen),
            self.length[chosen],
            self.radius[chosen],
        )


@dataclass(frozen=True, eq=False)
class ShapeWeights:
    """Shapes as constants: ``points`` (3 shapes, m) are the weights of all starts, all ends and all directions."""

    shapes: tuple[Shape, ...]
    points: ComplexBalls
    length: Balls
    radius: Balls


@lru_cache(maxsize=MOST)
def urdf_shapes(robot: PlanarRobot) -> ShapeWeights:
    """The segments from each link's origin to its children's joints, with radius 0: the paper's links."""
    return _weighed(
        robot, tuple(Shape(link, start, end, 0.0) for link, pairs in robot.segments.items() for start, end in pairs)
    )


@lru_cache(maxsize=MOST)
def given_shapes(robot: PlanarRobot, shapes: tuple[LinkShape, ...]) -> ShapeWeights:
    """Shapes from (link, start, end, radius)."""
    if any(not 0.0 <= float(radius) < float("inf") for *_, radius in shapes):
        raise ValueError("the radius of a shape is negative")
    return _weighed(
        robot,
        tuple(
            Shape(link, robot.link_point(link, start), robot.link_point(link, end), float(radius))
            for link, start, end, radius in shapes
        ),
    )


def _weighed(robot: PlanarRobot, shapes: tuple[Shape, ...]) -> ShapeWeights:
    count = len(robot.weights)
    directions, lengths = [], []
    with flint.ctx.workprec(PRECISION):
        for shape in shapes:
            along = shape.end.local - shape.start.local
            length = abs(along)
            row = [flint.acb(0)] * count
            row[shape.start.body] = along / length if length > SHORTEST else flint.acb(1)
            directions += row
            lengths.append(flint.arb(length))
        along = ComplexBalls.from_acb(directions, (len(shapes), count))
        length = Balls.from_arb(lengths, (len(shapes),))
    ends = robot.point_weights([*(shape.start for shape in shapes), *(shape.end for shape in shapes)])
    return ShapeWeights(shapes, ends.joined(along), length, Balls.exact([shape.radius for shape in shapes]))


def place_shapes(flight: FlightEnclosure, weights: ShapeWeights) -> PlacedShapes:
    """Where the shapes are at all times."""
    count = len(weights.shapes)
    placed = weights.points.times(flight.joints.cos, flight.joints.sin)
    start, end, direction = (
        Vectors(placed.x[..., first : first + count], placed.y[..., first : first + count])
        for first in (0, count, 2 * count)
    )
    return PlacedShapes(weights.shapes, start, end, direction, weights.length, weights.radius)
