"""The links' shapes as the certificate sees them, with the models of where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import flint

from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import ComplexBalls, PlanarRobot, Point
from floatplan.certificate.vectors import Vectors

LinkShape: TypeAlias = tuple[str, Sequence[float], Sequence[float], float]
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


def urdf_shapes(robot: PlanarRobot) -> tuple[Shape, ...]:
    """The segments from each link's origin to its children's joints, with radius 0: the paper's links."""
    return tuple(Shape(link, start, end, 0.0) for link, pairs in robot.segments.items() for start, end in pairs)


def given_shapes(robot: PlanarRobot, shapes: Sequence[LinkShape]) -> tuple[Shape, ...]:
    """Shapes from (link, start, end, radius)."""
    if any(not 0.0 <= float(radius) < float("inf") for *_, radius in shapes):
        raise ValueError("the radius of a shape is negative")
    return tuple(
        Shape(link, robot.link_point(link, start), robot.link_point(link, end), float(radius))
        for link, start, end, radius in shapes
    )


def turned(weights: ComplexBalls, cos: Taylor, sin: Taylor) -> Vectors:
    """``sum_b w_b zeta_b`` for weights (items, m)."""
    return Vectors(
        cos.linear(weights.re) - sin.linear(weights.im),
        cos.linear(weights.im) + sin.linear(weights.re),
    )


def place_shapes(robot: PlanarRobot, flight: FlightEnclosure, shapes: tuple[Shape, ...]) -> PlacedShapes:
    """Where the shapes are at all times."""
    cos, sin = flight.joints.cos, flight.joints.sin
    start = turned(robot.point_weights([shape.start for shape in shapes]), cos, sin)
    end = turned(robot.point_weights([shape.end for shape in shapes]), cos, sin)
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
        weights = ComplexBalls.from_acb(directions, (len(shapes), count))
        length = Balls.from_arb(lengths, (len(shapes),))
    radius = Balls.exact([shape.radius for shape in shapes])
    return PlacedShapes(shapes, start, end, turned(weights, cos, sin), length, radius)
