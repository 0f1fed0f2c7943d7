"""Clearance to every obstacle and between links: from the tables of the plan file to findings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np

from floatplan.arrays import IntArray
from floatplan.certificate.branch_and_bound import Goal, Minimum, smallest
from floatplan.certificate.cells import ORDER, path
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.findings import at_least
from floatplan.certificate.planar.boundary import com_polynomials
from floatplan.certificate.planar.clearance import (
    PlanePoints,
    PointSegments,
    apart_at_start,
    heights,
    join_pairs,
    only_pairs,
    points_to_shapes,
    shapes_to_segment,
    to_base_frame,
)
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.certificate.planar.shapes import PlacedShapes
from floatplan.certificate.vectors import Vectors
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject, Verdict
from floatplan.tables import CLEARANCE

CLEARANCE_GAP = 2e-6  # [m] how sharply a clearance is bounded


@dataclass(frozen=True, eq=False)
class Separation:
    """Distances whose smallest is one clearance.

    ``crossings`` are the sets of pairs that show, at one instant, that no two segments cross.
    """

    pairs: PointSegments | PlanePoints
    crossings: tuple[tuple[PointSegments, PointSegments], ...] = ()


@dataclass(frozen=True)
class Surroundings:
    """The flight, the placed shapes and the mirror sign: what every obstacle is compared with."""

    record: PlanRecord
    flight: FlightEnclosure
    shapes: PlacedShapes
    sigma: float

    def seen(self, place: Any, velocity: Any) -> Vectors:
        """A moving point, relative to the centre of mass, in the base frame: one item."""
        with flint.ctx.workprec(PRECISION):
            com_x, com_y = com_polynomials(self.record, self.sigma)
            x = flint.arb_poly([float(place[0]), float(velocity[0])]) - com_x
            y = flint.arb_poly([self.sigma * float(place[1]), self.sigma * float(velocity[1])]) - com_y
        both = path([x, y], self.flight.cells)
        return to_base_frame(self.flight, Vectors(both[:, :1], both[:, 1:]))

    def direction(self, vector: Any) -> Vectors:
        """A constant vector (two arb) of the mirrored plane, in the base frame."""
        balls = Balls.from_arb(vector, (2,))
        shape = (len(self.flight.cells), 1)
        x, y = (
            Taylor.constant(Balls(np.full(shape, balls.mid[k]), np.full(shape, balls.rad[k])), ORDER) for k in (0, 1)
        )
        return to_base_frame(self.flight, Vectors(x, y))

    def height_offset(self, point: Any, velocity: Any, normal: Any) -> Taylor:
        """``normal . (centre of mass - point)``, with a normal of two arb in the mirrored plane."""
        with flint.ctx.workprec(PRECISION):
            com_x, com_y = com_polynomials(self.record, self.sigma)
            x = com_x - flint.arb_poly([float(point[0]), float(velocity[0])])
            y = com_y - flint.arb_poly([self.sigma * float(point[1]), self.sigma * float(velocity[1])])
            return path([x * normal[0] + y * normal[1]], self.flight.cells)


def obstacle_finding(surroundings: Surroundings, index: int, obstacle: Mapping[str, Any]) -> tuple[Finding, Minimum]:
    """Clearance of all links to one obstacle while it exists."""
    for key in ("radius", "margin"):
        if not 0.0 <= float(obstacle.get(key) or 0.0) < math.inf:
            raise ValueError(f"obstacles[{index}].{key} is negative")
    separation = SEPARATIONS[obstacle["kind"]](surroundings, obstacle, obstacle.get("velocity") or (0.0, 0.0))
    window = obstacle.get("window")
    margin = float(obstacle.get("margin") or 0.0)
    return _finding(
        surroundings, "obstacle", (index, obstacle["kind"]), separation, _existing(surroundings, window), margin
    )


def ground_finding(surroundings: Surroundings, robot: PlanarRobot, hulls: PlacedShapes) -> Finding:
    """Height of all links over the horizontal line through the lowest point of the link that takes off, at t = 0."""
    with flint.ctx.workprec(PRECISION):
        up = (flint.arb(0), flint.arb(surroundings.sigma))

    def above(level: float, shapes: PlacedShapes) -> PlanePoints:
        return heights(shapes, surroundings.direction(up), surroundings.height_offset((0.0, level), (0.0, 0.0), up))

    frame = surroundings.record.problem["flight"]["takeoff"]["frame"]
    standing = _standing(hulls, robot.carriers[frame])
    level = surroundings.record.problem["flight"]["takeoff"]["position"][1]
    if standing:
        level = above(0.0, hulls.only(standing)).least_at_start()
    return _finding(
        surroundings,
        "ground",
        (),
        Separation(above(level, hulls)),
        np.arange(len(surroundings.flight.cells)),
        0.0,
    )[0]


def _standing(shapes: PlacedShapes, carriers: Sequence[str]) -> list[int]:
    """The shapes of the first of some links that has any."""
    found = ([i for i, shape in enumerate(shapes.shapes) if shape.link == link] for link in carriers)
    return next((indices for indices in found if indices), [])


def self_finding(surroundings: Surroundings, pair: Mapping[str, Any]) -> Finding:
    """Clearance between two links."""
    first, second = (
        surroundings.shapes.only([i for i, shape in enumerate(surroundings.shapes.shapes) if shape.link == link])
        for link in pair["links"]
    )
    if not first.shapes or not second.shapes:
        raise ValueError(f"self_clearance: one of the links {pair['links']} has no shape")
    sets: list[PointSegments] = []
    crossings: list[tuple[PointSegments, PointSegments]] = []
    for i in range(len(first.shapes)):
        for j in range(len(second.shapes)):
            ends = (_ends_to(first.only([i]), second.only([j])), _ends_to(second.only([j]), first.only([i])))
            sets += ends
            crossings.append(ends)
    cells = np.arange(len(surroundings.flight.cells))
    separation = Separation(join_pairs(sets), tuple(crossings))
    return _finding(
        surroundings, "self_clearance", tuple(pair["links"]), separation, cells, float(pair.get("margin") or 0.0)
    )[0]


def _ends_to(one: PlacedShapes, other: PlacedShapes) -> PointSegments:
    """Both ends of one shape with the segment of another."""
    radius = float(one.radius.mid[0])
    return join_pairs([points_to_shapes(points, other, radius) for points in (one.start, one.end)])


def _circle(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> Separation:
    center = surroundings.seen(obstacle["center"], velocity)
    return Separation(points_to_shapes(center, surroundings.shapes, float(obstacle["radius"])))


def _half_plane(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> Separation:
    with flint.ctx.workprec(PRECISION):
        x, y = (flint.arb(float(part)) for part in obstacle["normal"])
        length = (x * x + y * y).sqrt()
        normal = (x / length, surroundings.sigma * y / length)
    offset = surroundings.height_offset(obstacle["point"], velocity, normal)
    return Separation(heights(surroundings.shapes, surroundings.direction(normal), offset))


def _bar(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> Separation:
    radius, count = float(obstacle["radius"]), len(surroundings.shapes.shapes)
    with flint.ctx.workprec(PRECISION):
        first, last = ([flint.arb(float(part)) for part in obstacle[end]] for end in ("start", "end"))
        along = (last[0] - first[0], surroundings.sigma * (last[1] - first[1]))
        length = (along[0] * along[0] + along[1] * along[1]).sqrt()
        unit = (along[0] / length, along[1] / length) if length > 0 else (flint.arb(1), flint.arb(0))
    start, end = (surroundings.seen(obstacle[name], velocity) for name in ("start", "end"))
    of_start, of_end = (points_to_shapes(point, surroundings.shapes, radius) for point in (start, end))
    of_shapes = shapes_to_segment(surroundings.shapes, start, surroundings.direction(unit), length, radius)
    crossings = tuple(
        (join_pairs([only_pairs(of_start, [i]), only_pairs(of_end, [i])]), only_pairs(of_shapes, [i, count + i]))
        for i in range(count)
    )
    return Separation(join_pairs([of_start, of_end, of_shapes]), crossings)


def together(separations: Sequence[Separation]) -> Separation:
    """Return what separates from an obstacle made of several pieces, none of which is a half-plane."""
    pairs = [each.pairs for each in separations if isinstance(each.pairs, PointSegments)]
    assert len(pairs) == len(separations), "half-planes have no ends"
    return Separation(join_pairs(pairs), tuple(crossing for each in separations for crossing in each.crossings))


SEPARATIONS: dict[str, Callable[[Surroundings, Mapping[str, Any], Any], Separation]] = {
    "circle": _circle,
    "half-plane": _half_plane,
    "capsule": _bar,
}


def _existing(surroundings: Surroundings, window: Any) -> IntArray:
    """Cells in which an obstacle exists: cells end where windows do, and a window of one instant is one."""
    cells = surroundings.flight.cells
    if window is None:
        return np.arange(len(cells))
    first, last = float(window[0]), float(window[1])
    if not first <= last:
        raise ValueError(f"the window {window} ends before it begins")
    return np.flatnonzero((cells.low >= first) & (cells.high <= last))


def _finding(
    surroundings: Surroundings, kind: Kind, subject: Subject, separation: Separation, cells: IntArray, margin: float
) -> tuple[Finding, Minimum]:
    pairs = separation.pairs
    members = len(pairs.radius.mid)
    goal = Goal(np.array([CLEARANCE_GAP]), np.array([margin - CLEARANCE]))
    groups = np.zeros(members, dtype=np.int64)
    least = smallest(pairs.items(cells), groups, pairs.below, pairs.at_point, goal, surroundings.flight.cells)[0]
    finding = at_least(kind, subject, least.bound, least.attained, margin, CLEARANCE, least.instant)
    if finding.verdict != "proved" or len(cells) == 0:
        return finding, least
    verdict = _uncrossed(separation, int(cells[0]), least)
    if verdict == "proved":
        return finding, least
    crossing = Minimum(-math.inf, 0.0, float(surroundings.flight.cells.low[cells[0]]), 0)
    return Finding(kind, subject, verdict, 0.0, crossing.instant, margin, margin), crossing


def _uncrossed(separation: Separation, cell: int, least: Minimum) -> Verdict:
    """Whether no two segments cross: none at the first instant, and afterwards no end comes to lie on the other."""
    if not isinstance(separation.pairs, PointSegments) or not separation.crossings:
        return "proved"
    seen = [tuple(apart_at_start(ends, cell) for ends in both) for both in separation.crossings]
    if any(both == (False, False) for both in seen):
        return "refuted"
    radius = separation.pairs.radius
    touching = not least.bound + float((radius.mid - radius.rad).min()) > 0.0
    return "undecided" if touching or not all(any(both) for both in seen) else "proved"
