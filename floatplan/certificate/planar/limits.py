"""Joint ranges, velocities, torques, motors and the orientation rate, for all times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.bernstein import bernstein, magnitude
from floatplan.certificate.branch_and_bound import Goal, Items, Minimum, smallest
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor, stack
from floatplan.certificate.findings import RECORDED_PEAK, at_most
from floatplan.certificate.planar.flight import FlightEnclosure
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.errors import InputError
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject
from floatplan.tables import JOINT_LIMITS, RANGE, RELATIVE, LimitRow

PEAK_GAP = 1e-6  # [-] of the peak: how sharply a peak is bounded


@dataclass(frozen=True, eq=False)
class Quantity:
    """Something whose magnitude is limited: models (K, cells, members); infinite where there is no limit."""

    kind: Kind
    subject: Subject
    models: Taylor
    limit: float


def range_findings(record: PlanRecord) -> tuple[list[Finding], list[int]]:
    """Joint ranges that hold because ``|sin| <= 1``; and the joints for which that does not say so."""
    found, left = [], []
    with flint.ctx.workprec(PRECISION):
        for index, (low, high) in enumerate(_ranges(record)):
            centre, amplitude = flint.arb(float(record.centre[index])), abs(float(record.amplitude[index]))
            beyond = flint.arb.max(centre + amplitude - high, low - (centre - amplitude))
            bound = float(beyond.upper()) + 2.0**-60
            if bound <= RANGE:
                found.append(Finding("position", (record.robot.joints[index],), "proved", bound, None, 0.0))
            else:
                left.append(index)
    return found, left


@dataclass(frozen=True, eq=False)
class Quantities:
    """All quantities whose peaks are wanted: ``found``; and which of them are velocities (n), torques (n), motors'."""

    found: list[Quantity]
    velocities: list[int]
    torques: list[int]
    motors: list[int]


def quantities(robot: PlanarRobot, record: PlanRecord, flight: FlightEnclosure, beyond_range: list[int]) -> Quantities:
    """All limited quantities, and those whose peaks the record claims."""
    joints, limits, names = flight.joints, record.problem["limits"], record.robot.joints
    found: list[Quantity] = []
    first = {}
    for row in JOINT_LIMITS:
        first[row.key] = len(found)
        found += _of_joints(row, record, flight)
    velocities = [first["velocity"] + i for i in range(len(names))]
    own = _own_limits(robot, limits)
    motors = []
    for i, name in enumerate(robot.motors):
        motors.append(len(found))
        found.append(Quantity("torque", (name,), joints.motor_torques[:, i : i + 1], own[i]))
    torques = []
    for i, name in enumerate(names):
        several = np.count_nonzero(robot.motor_ratios[:, i]) > 1
        torques.append(len(found) if several else motors[i])
        if several:
            together = joints.motor_torques.linear(Balls.exact(robot.motor_ratios[:, i : i + 1].T))
            found.append(Quantity("generalized_torque", (name,), together, _limit(limits["torque"], i)))
    for name, motor in (limits.get("motor") or {}).items():
        found.append(_motor_curve(robot, flight, name, motor))
    if limits.get("orientation_rate") is not None:
        found.append(Quantity("orientation_rate", (), joints.rate, float(limits["orientation_rate"])))
    found += [_beyond_range(record, flight, i) for i in beyond_range]
    return Quantities(found, velocities, torques, motors)


def _of_joints(row: LimitRow, record: PlanRecord, flight: FlightEnclosure) -> list[Quantity]:
    """The joints' quantities of a row that are limited, or all where the record claims their peaks."""
    limits = record.problem["limits"].get(row.key) or [None] * len(record.robot.joints)
    models: Taylor = getattr(flight.joints, row.quantity)
    of_joints = [
        Quantity(row.key, (name,), models[:, i : i + 1], _limit(limits, i))
        for i, name in enumerate(record.robot.joints)
    ]
    return of_joints if row.always else [quantity for quantity in of_joints if quantity.limit != math.inf]


def _motor_curve(robot: PlanarRobot, flight: FlightEnclosure, name: str, motor: Mapping[str, Any]) -> Quantity:
    """``|torque| + slope |velocity|`` of a motor, as the larger of two magnitudes."""
    joints, i = flight.joints, _motor(robot, name, "motor")
    leader = int(np.argmax(np.abs(robot.motor_ratios[i])))
    slope = flint.arb(float(motor["slope"])) * float(robot.motor_ratios[i, leader])
    drop = joints.velocities[:, leader : leader + 1].times(Balls.from_arb([slope], (1,)))
    torque = joints.motor_torques[:, i : i + 1]
    return Quantity("motor", (name,), stack([torque + drop, torque - drop]), float(motor["stall"]))


def _beyond_range(record: PlanRecord, flight: FlightEnclosure, joint: int) -> Quantity:
    """Distance of a joint from the middle of its range, where its sine polynomial alone does not keep it inside."""
    low, high = _ranges(record)[joint]
    with flint.ctx.workprec(PRECISION):
        middle = Balls.from_arb([(flint.arb(low) + high) / 2], (1,))
        reach = float(((flint.arb(high) - low) / 2).lower())
    shape = (len(flight.cells), 1)
    shift = Balls(np.broadcast_to(middle.mid, shape), np.broadcast_to(middle.rad, shape))
    position = flight.joints.positions[:, joint : joint + 1]
    name = record.robot.joints[joint]
    return Quantity("position", (name,), position - Taylor.constant(shift, position.order), reach)


def _own_limits(robot: PlanarRobot, limits: Mapping[str, Any]) -> list[float]:
    """Limit of each motor's own torque: its own, and that of its joint where it is the joint's only motor."""
    own = limits.get("motor_torque") or {}
    for name in own:
        _motor(robot, name, "motor_torque")
    values = []
    for i, name in enumerate(robot.motors):
        limit = _limit([own[name]], 0) if name in own else math.inf
        alone = i < len(robot.joints) and np.count_nonzero(robot.motor_ratios[:, i]) == 1
        values.append(min(limit, _limit(limits["torque"], i)) if alone else limit)
    return values


def _motor(robot: PlanarRobot, name: str, key: str) -> int:
    if name not in robot.motors:
        raise InputError("must be the name of one of the robot's motors", element=f"problem.limits.{key}.{name}")
    return robot.motors.index(name)


def limit_findings(found: list[Quantity], flight: FlightEnclosure) -> tuple[list[Finding], list[Minimum]]:
    """Findings on the limited quantities, and the peaks of all."""
    counts = [q.models.e.shape[1] for q in found]
    groups = np.repeat(np.arange(len(found)), counts)
    models = stack([q.models for q in found])
    limits = np.array([q.limit for q in found])
    tolerances = np.array([_tolerance(q) for q in found])
    sizes = np.fmax.reduceat(np.fmax.reduce(models.size, axis=0, initial=0.0), np.cumsum([0, *counts[:-1]]))
    goal = Goal(gap=PEAK_GAP * sizes + 1e-12, threshold=-(limits + tolerances))
    items = Items.whole_cells([bernstein(models)], np.arange(len(flight.cells)))
    peaks = smallest(items, groups, _below, _at_point, goal, flight.cells)
    said = [
        at_most(q.kind, q.subject, -peak.bound, -peak.attained, q.limit, tolerance, peak.instant)
        for q, peak, tolerance in zip(found, peaks, tolerances.tolist(), strict=True)
        if q.limit != math.inf
    ]
    return said, list(peaks)


def recorded_peaks(name: str, recorded: Array, peaks: list[Minimum]) -> Finding:
    """Whether the peaks that the file claims are those enclosed."""
    upper = np.array([-peak.bound for peak in peaks])
    lower = np.array([-peak.attained for peak in peaks])
    scale = RECORDED_PEAK * np.maximum(upper, 1e-3)
    largest = np.maximum(np.abs(recorded - upper), np.abs(recorded - lower)) / scale
    smallest_ = np.maximum(0.0, np.maximum(recorded - upper, lower - recorded)) / scale
    factor = RECORDED_PEAK
    return at_most(
        "recorded", (name,), float(largest.max()) * factor, float(smallest_.max()) * factor, 0.0, factor, None
    )


def _below(forms: Taylor, member: IntArray) -> Array:
    return -magnitude(forms[0])


def _at_point(values: Balls, member: IntArray) -> Array:
    return np.asarray(-np.maximum(0.0, (np.abs(values.mid[0]) - values.rad[0]) * (1.0 - 2.0**-50)))


def _tolerance(quantity: Quantity) -> float:
    if math.isinf(quantity.limit):
        return 0.0
    return RANGE if quantity.kind == "position" else RELATIVE * quantity.limit


def _ranges(record: PlanRecord) -> list[tuple[float, float]]:
    ranges = record.problem["limits"]["position"]
    if len(ranges) != len(record.robot.joints):
        raise ValueError("problem.limits.position should be one range per joint")
    return [(float(low), float(high)) for low, high in ranges]


def _limit(limits: Any, index: int) -> float:
    if limits[index] is None:
        return math.inf
    limit = float(limits[index])
    if not math.isfinite(limit):
        raise ValueError(f"{limit} is no limit")
    return limit
