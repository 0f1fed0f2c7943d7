"""Clearance to every obstacle and between links: from the tables of the plan file to findings."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import flint
import numpy as np

from floatplan.arrays import IntArray, indices_of
from floatplan.certificate.branch_and_bound import Minimum
from floatplan.certificate.cells import ORDER, Vectors, recentred
from floatplan.certificate.clearance import existing_cells, least_distance, shapes_of_pair
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.planar.clearance import Bars, PlanePoints, PointSegments, ShapeWeights, shapes_in_base
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.certificate.planar.limits import com_polynomials
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject, Verdict

STILL = (0.0, 0.0)  # [m/s]


class Surroundings:
    """The flight and the links' shapes in it: what every obstacle is compared with.

    ``links`` are the names of the links that the bars ``shapes`` belong to, ``cells`` all cells of time. ``standing``
    are the shapes by which links are as high over the ground as they are; None stands for these.
    """

    def __init__(
        self,
        robot: PlanarRobot,
        record: PlanRecord,
        flight: FlightEnclosure,
        weights: ShapeWeights,
        standing: ShapeWeights | None,
    ) -> None:
        self.record = record
        self.flight = flight
        self.cells = np.arange(len(flight.cells))
        self.sigma = robot.sigma
        self.carriers = robot.carriers
        self.standing = standing
        self.links = [shape.link for shape in weights.shapes]
        self.shapes = shapes_in_base(flight, weights)

    def seen(self, position: Any, velocity: Any) -> Vectors:
        """A moving point, relative to the centre of mass, in the base frame: one item."""
        with flint.ctx.workprec(PRECISION):
            x, y = (-polynomial for polynomial in self._com_from(position, velocity))
        both = self._path([x, y])
        return Vectors(both[:, :1], both[:, 1:]).turned_back(self.flight.direction)

    def direction(self, vector: Any) -> Vectors:
        """A constant vector (two arb) of the mirrored plane, in the base frame."""
        shape = (len(self.flight.cells), 1)
        x, y = (Taylor.constant(Balls.from_arb([component], (1,)).broadcast(shape), ORDER) for component in vector)
        return Vectors(x, y).turned_back(self.flight.direction)

    def height_offset(self, point: Any, velocity: Any, normal: Any) -> Taylor:
        """``normal . (centre of mass - point)``, with a normal of two arb in the mirrored plane."""
        with flint.ctx.workprec(PRECISION):
            x, y = self._com_from(point, velocity)
            return self._path([x * normal[0] + y * normal[1]])

    def bar(self, start: Any, end: Any, radius: float, velocity: Any) -> Bars:
        """A moving bar in the base frame: one item."""
        with flint.ctx.workprec(PRECISION):
            x, y = (flint.arb(float(last)) - float(first) for first, last in zip(start, end, strict=True))
            y *= self.sigma
            length = (x * x + y * y).sqrt()
            along = (x / length, y / length) if length > 0 else (flint.arb(1), flint.arb(0))
            extent = Balls.from_arb([length], (1,))
        first_end, last_end = (self.seen(position, velocity) for position in (start, end))
        return Bars(first_end, last_end, self.direction(along), extent, Balls.exact([radius]))

    def _com_from(self, position: Any, velocity: Any) -> tuple[Any, Any]:
        """The centre of mass relative to a moving point of the plane, in its mirror image: polynomials of t."""
        com_x, com_y = com_polynomials(self.record, self.sigma)
        x = com_x - flint.arb_poly([float(position[0]), float(velocity[0])])
        return x, com_y - flint.arb_poly([self.sigma * float(position[1]), self.sigma * float(velocity[1])])

    def _path(self, polynomials: Sequence[Any]) -> Taylor:
        """Model (K, cells, polynomials) of polynomials in t of degree 2 at most."""
        balls = recentred(polynomials, self.flight.cells, 3)
        return Taylor.polynomial(balls.mid, balls.rad, ORDER)

    def obstacle_finding(self, index: int, obstacle: Mapping[str, Any]) -> tuple[Finding, Minimum]:
        """Clearance of all links to one obstacle while it exists."""
        distances = SEPARATIONS[obstacle["kind"]](self, obstacle, obstacle.get("velocity") or STILL)
        existing = existing_cells(self.flight.cells, obstacle)  # a window of one instant is a cell
        margin = float(obstacle.get("margin") or 0.0)
        return _finding(self, "obstacle", (index, obstacle["kind"]), distances, existing, margin)

    def ground_finding(self) -> Finding:
        """Height of all links over the level of the lowest point of the link that takes off, at t = 0."""
        hulls = self.shapes
        links = self.links
        if self.standing is not None:
            hulls = shapes_in_base(self.flight, self.standing)
            links = [shape.link for shape in self.standing.shapes]
        takeoff = self.record.problem["flight"]["takeoff"]
        level = takeoff["position"][1]
        with flint.ctx.workprec(PRECISION):
            up = (flint.arb(0), flint.arb(self.sigma))

        def above(level: float, bars: Bars) -> PlanePoints:
            offset = self.height_offset((0.0, level), STILL, up)
            return PlanePoints.of_bars(bars, self.direction(up), offset)

        for carrier in self.carriers[takeoff["frame"]]:
            if carrier in links:
                level = above(0.0, hulls[indices_of(carrier, links)]).least_at_start()
                break
        return _finding(self, "ground", (), above(level, hulls), self.cells, 0.0)[0]

    def self_finding(self, pair: Mapping[str, Any]) -> Finding:
        """Clearance between two links."""
        first, second = shapes_of_pair(self.links, pair)
        one = np.repeat(first, len(second))
        other = np.tile(second, len(first))
        distances = PointSegments.of_bars(self.shapes[one.tolist()], self.shapes[other.tolist()])
        margin = float(pair.get("margin") or 0.0)
        return _finding(self, "self_clearance", tuple(pair["links"]), distances, self.cells, margin)[0]


def _circle(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> PointSegments:
    center = surroundings.seen(obstacle["center"], velocity)
    return PointSegments.of_points(center, Balls.exact([float(obstacle["radius"])]), surroundings.shapes)


def _half_plane(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> PlanePoints:
    with flint.ctx.workprec(PRECISION):
        x, y = (flint.arb(float(component)) for component in obstacle["normal"])
        length = (x * x + y * y).sqrt()
        normal = (x / length, surroundings.sigma * y / length)
    offset = surroundings.height_offset(obstacle["point"], velocity, normal)
    return PlanePoints.of_bars(surroundings.shapes, surroundings.direction(normal), offset)


def _bar(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> PointSegments:
    bar = surroundings.bar(obstacle["start"], obstacle["end"], float(obstacle["radius"]), velocity)
    return PointSegments.of_bars(bar, surroundings.shapes)


SEPARATIONS: dict[str, Callable[[Surroundings, Mapping[str, Any], Any], PointSegments | PlanePoints]] = {
    "circle": _circle,
    "half-plane": _half_plane,
    "capsule": _bar,
}


def _finding(
    surroundings: Surroundings,
    kind: Kind,
    subject: Subject,
    distances: PointSegments | PlanePoints,
    cells: IntArray,
    margin: float,
) -> tuple[Finding, Minimum]:
    """The verdict on the least of some distances, and that distance.

    Segments are apart where none cross at the first instant, and afterwards no end comes to lie on another.
    """
    times = surroundings.flight.cells
    finding, least = least_distance(kind, subject, distances, distances.items(cells), margin, times)
    if finding.verdict != "proved" or not len(cells) or isinstance(distances, PlanePoints):
        return finding, least
    apart, across = distances.apart_at_start(int(cells[0]))
    crossed = (across & ~apart).all(axis=1).any()
    clear = least.bound + float((distances.radius.mid - distances.radius.rad).min()) > 0.0
    if not crossed and ((clear and apart.any(axis=1).all()) or not len(apart)):
        return finding, least
    crossing = Minimum(-math.inf, 0.0, float(times.low[cells[0]]), 0)
    verdict: Verdict = "refuted" if crossed else "undecided"
    return Finding(kind, subject, verdict, 0.0, crossing.instant, margin, margin), crossing
