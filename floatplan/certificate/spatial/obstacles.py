"""Clearance in space to every obstacle, between links and over the ground: from the plan file's tables to findings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import flint
import numpy as np

from floatplan.certificate.branch_and_bound import Items, Minimum
from floatplan.certificate.cells import ORDER, recentred
from floatplan.certificate.clearance import existing_cells, least_distance, shapes_of_pair, window_within
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor
from floatplan.certificate.spatial.clearance import (
    Capsules,
    CapsuleShape,
    FaceDistances,
    Heights,
    SegmentPairs,
    Segments,
    Solid,
    SolidShape,
)
from floatplan.certificate.spatial.flight import SpatialEnclosure
from floatplan.certificate.spatial.models import Matrices
from floatplan.certificate.spatial.robot import SpatialRobot
from floatplan.errors import InputError
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding

SpatialDistances: TypeAlias = SegmentPairs | Heights | FaceDistances

STILL = (0.0, 0.0, 0.0)  # [m/s]
UPWARDS = (0.0, 0.0, 1.0)


class Surroundings:
    """The flight and the links' shapes in it: what every obstacle is compared with.

    Positions are in the base's axes from the centre of mass, unless said otherwise.

    Parameters
    ----------
    capsules : of the links, in their axes; None stands for the segments from their origins to their children's joints
    solids : by which links are as high over the ground as they are; None stands for the capsules
    """

    def __init__(
        self,
        robot: SpatialRobot,
        record: PlanRecord,
        flight: SpatialEnclosure,
        capsules: Sequence[CapsuleShape] | None,
        solids: Sequence[SolidShape] | None,
    ) -> None:
        if capsules is None and robot.with_collision:
            reason = f'link "{min(robot.with_collision)}" has a <collision> element, so its shape has to be given'
            raise InputError(reason, element="shapes")
        self.record = record
        self.flight = flight
        self.cells = np.arange(len(flight.cells))
        self.carriers = robot.carriers
        self.rotations = flight.motion.rotations
        self.origins = self.rotations.of_blocks(robot.origins)
        self.to_base = flight.attitude.attitudes.transposed
        self.capsules = Capsules.of(robot, capsules)
        self.solids = Solid.of_capsules(self.capsules) if solids is None else Solid.all_of(robot, solids)

    @cached_property
    def segments(self) -> Segments:
        """The links' capsules at all times."""
        return self.capsules.placed(self.rotations, self.origins)

    def obstacle_finding(self, index: int, obstacle: Mapping[str, Any]) -> tuple[Finding, Minimum]:
        """Clearance of all links to one obstacle while it exists."""
        distances = SPATIAL_SEPARATIONS[obstacle["kind"]](self, obstacle, obstacle.get("velocity") or STILL)
        items = self._items_of_window(distances, obstacle)
        margin = float(obstacle.get("margin") or 0.0)
        subject = (index, str(obstacle["kind"]))
        return least_distance("obstacle", subject, distances, items, margin, self.flight.cells)

    def self_finding(self, pair: Mapping[str, Any]) -> Finding:
        """Clearance between two links."""
        first, second = shapes_of_pair(self.capsules.links, pair)
        one = np.repeat(first, len(second))
        other = np.tile(second, len(first))
        distances = SegmentPairs.of(self.segments[one.tolist()], self.segments[other.tolist()])
        margin = float(pair.get("margin") or 0.0)
        items = distances.items(self.cells)
        return least_distance("self_clearance", tuple(pair["links"]), distances, items, margin, self.flight.cells)[0]

    def ground_finding(self) -> Finding:
        """Height of all links over the level of the lowest point of the link that takes off, at t = 0."""
        takeoff = self.record.problem["flight"]["takeoff"]
        level = float(takeoff["position"][2])
        for carrier in self.carriers[takeoff["frame"]]:
            feet = [solid for solid in self.solids if solid.link == carrier]
            if feet:
                level = self.heights(feet, UPWARDS, STILL, STILL).least_at_start()
                break
        distances = self.heights(self.solids, UPWARDS, (0.0, 0.0, level), STILL)
        return least_distance("ground", (), distances, distances.items(self.cells), 0.0, self.flight.cells)[0]

    def heights(self, solids: Sequence[Solid], normal: Any, point: Any, velocity: Any) -> Heights:
        """Heights of solids over a plane that moves, whose normal may have any length."""
        with flint.ctx.workprec(PRECISION):
            parts = [flint.arb(float(part)) for part in normal]
            length = sum((part * part for part in parts), start=flint.arb(0)).sqrt()
            unit = [part / length for part in parts]
            path = self._path_from_com(point, velocity)
            distance = -sum((part * of_axis for part, of_axis in zip(unit, path, strict=True)), flint.arb_poly([0]))
        offset = self._models([distance])
        normal_in_base = self.direction_in_base(unit)
        heights = (normal_in_base.transposed @ self.origins).scalars() + offset
        bodies = [solid.body for solid in solids]
        return Heights(solids, self.rotations[bodies].transposed @ normal_in_base, heights[:, bodies])

    def from_com_in_base(self, point: Any, velocity: Any) -> Matrices:
        """A moving point from the centre of mass: one vector."""
        return self.to_base @ self.from_com_in_world(point, velocity)

    def from_com_in_world(self, point: Any, velocity: Any) -> Matrices:
        """The same in the world's axes."""
        with flint.ctx.workprec(PRECISION):
            models = self._models(self._path_from_com(point, velocity))
        c = np.ascontiguousarray(models.c.transpose(1, 0, 2))[:, None, :, :, None]
        return Matrices.of(c, models.e[:, None, :, None])

    def direction_in_base(self, vector: Sequence[Any]) -> Matrices:
        """A constant vector (three arb) of the world: one vector."""
        return self.to_base @ Matrices.constant(Balls.from_arb(vector, (1, 3, 1)), len(self.cells))

    def _path_from_com(self, point: Any, velocity: Any) -> list[Any]:
        """A moving point from the centre of mass, in the world's axes: polynomials of t."""
        com = self.record.com
        half_gravity = flint.arb(com["gravity"]) / 2
        path = []
        for axis, fall in enumerate((0, 0, half_gravity)):
            start = flint.arb(float(point[axis])) - flint.arb(float(com["position0"][axis]))
            rate = flint.arb(float(velocity[axis])) - flint.arb(float(com["velocity0"][axis]))
            path.append(flint.arb_poly([start, rate, fall]))
        return path

    def _models(self, polynomials: Sequence[Any]) -> Taylor:
        """Models (K, cells, polynomials) of polynomials in t of degree 2 at most."""
        balls = recentred(polynomials, self.flight.cells, 3)
        return Taylor.polynomial(balls.mid, balls.rad, ORDER)

    def _items_of_window(self, distances: SpatialDistances, obstacle: Mapping[str, Any]) -> Items:
        """The items on the cells during which an obstacle exists; of a window of one instant, those at a cell's end."""
        cells = self.flight.cells
        first, last = window_within(obstacle, self.record.duration)
        if first != last:
            return distances.items(existing_cells(cells, obstacle))
        at_start = first <= cells.low[0]
        cell = 0 if at_start else int(np.flatnonzero(cells.high == first)[0])
        members = np.arange(distances.count)
        return distances.forms(np.full_like(members, cell), members).at_end(-1.0 if at_start else 1.0)


def _sphere(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> SegmentPairs:
    center = surroundings.from_com_in_base(obstacle["center"], velocity)
    no_length = Matrices.constant(Balls.exact(np.zeros((1, 3, 1))), len(surroundings.cells))
    return SegmentPairs.of(surroundings.segments, Segments(center, no_length, np.array([float(obstacle["radius"])])))


def _bar(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> SegmentPairs:
    start = surroundings.from_com_in_base(obstacle["start"], velocity)
    with flint.ctx.workprec(PRECISION):
        ends = zip(obstacle["start"], obstacle["end"], strict=True)
        along = surroundings.direction_in_base([flint.arb(float(last)) - float(first) for first, last in ends])
    return SegmentPairs.of(surroundings.segments, Segments(start, along, np.array([float(obstacle["radius"])])))


def _half_space(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> Heights:
    solids = Solid.of_capsules(surroundings.capsules)
    return surroundings.heights(solids, obstacle["normal"], obstacle["point"], velocity)


def _box(surroundings: Surroundings, obstacle: Mapping[str, Any], velocity: Any) -> FaceDistances:
    to_world = surroundings.to_base.transposed
    segments = surroundings.segments
    start = to_world @ segments.start - surroundings.from_com_in_world(obstacle["center"], velocity)
    half = np.array(obstacle["size"], dtype=np.float64) / 2.0
    return FaceDistances(Segments(start, to_world @ segments.along, segments.radius), half)


SPATIAL_SEPARATIONS: dict[str, Callable[[Surroundings, Mapping[str, Any], Any], SpatialDistances]] = {
    "sphere": _sphere,
    "capsule": _bar,
    "half-space": _half_space,
    "box": _box,
}
