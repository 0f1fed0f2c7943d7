"""What holds of the joints: limits for all times, both ends, (13), and numbers that the file gives twice."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import flint
import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.branch_and_bound import (
    RECORDED_PEAK,
    SAME,
    Goal,
    Items,
    Minimum,
    at_most,
    bernstein,
    deviations,
    magnitude,
    smallest,
)
from floatplan.certificate.cells import TimeCells
from floatplan.certificate.enclosure import PRECISION, Balls, Taylor, stack
from floatplan.errors import InputError
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject
from floatplan.tables import BOUNDARY, JOINT_LIMITS, RANGE, RELATIVE

JointState: TypeAlias = tuple[list[Any], list[Any], list[Any]]

ENDS = ("start", "goal")
QUANTITIES = ("positions", "velocities", "accelerations")
PEAK_GAP = 1e-6  # [-] of the peak: how sharply a peak is bounded


def boundary_findings(record: PlanRecord, states: Sequence[JointState]) -> list[Finding]:
    """Positions, velocities and accelerations at both ends, (13), in Arb; ``states`` are those of :func:`at_ends`."""
    findings = []
    for end, state, instant in zip(ENDS, states, (0.0, record.duration), strict=True):
        for quantity, values, tolerance in zip(QUANTITIES, state, BOUNDARY, strict=True):
            exact = np.array(record.problem[end][quantity], dtype=np.float64)
            upper, attained = deviations(Balls.from_arb(values, exact.shape), exact)
            findings.append(at_most(end, (quantity,), float(upper), float(attained), 0.0, tolerance, instant))
    return findings


def at_ends(record: PlanRecord) -> list[JointState]:
    """Positions, velocities and accelerations (n), in Arb, at the beginning and at the end."""
    instants = (0.0, record.duration)
    states: list[JointState] = [([], [], []) for _ in instants]
    with flint.ctx.workprec(PRECISION):
        rows = zip(record.coefficients.tolist(), record.centre.tolist(), record.amplitude.tolist(), strict=True)
        for row, centre, amplitude in rows:
            polynomial = flint.arb_poly(row)
            first = polynomial.derivative()
            second = first.derivative()
            for (positions, velocities, accelerations), instant in zip(states, instants, strict=True):
                t = flint.arb(instant)
                dp = first(t)
                sine, cosine = polynomial(t).sin_cos()
                positions.append(centre + amplitude * sine)
                velocities.append(amplitude * cosine * dp)
                accelerations.append(amplitude * (cosine * second(t) - sine * dp * dp))
    return states


def same(kind: Kind, subject: Subject, number: float, other: float, instant: float | None) -> Finding:
    """Two numbers of the file that should be one."""
    scale = max(1.0, abs(number), abs(other))
    deviation = abs(number - other)
    radius = 2.0**-51 * (abs(number) + deviation)
    return at_most(kind, subject, deviation + radius, max(0.0, deviation - radius), 0.0, SAME * scale, instant)


@dataclass(frozen=True, eq=False)
class LimitedQuantity:
    """Something whose magnitude is limited: models (K, cells, members); infinite where there is no limit.

    Where the models are of its square, ``power`` is 2.
    """

    kind: Kind
    subject: Subject
    models: Taylor
    limit: float
    power: int = 1

    @property
    def tolerance(self) -> float:
        """What the quantity may exceed its limit by."""
        if math.isinf(self.limit):
            return 0.0
        return RANGE if self.kind == "position" else RELATIVE * self.limit

    def root(self, value: float, towards: float) -> float:
        """The magnitude that belongs to one of the models, rounded towards infinity or 0."""
        return value if self.power == 1 else math.nextafter(math.sqrt(max(0.0, value)), towards)


class Actuated(Protocol):
    """A robot: names of its motors, and derivatives (motors, n) of their positions by the planned ones."""

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motors' joints."""

    @property
    def motor_ratios(self) -> Array:
        """Derivatives."""


class Moved(Protocol):
    """Models (K, cells, n) of the planned joints' motion, and (K, cells, motors) of their motors' torques."""

    @property
    def positions(self) -> Taylor:
        """Positions, rad."""

    @property
    def velocities(self) -> Taylor:
        """Rates, rad/s."""

    @property
    def accelerations(self) -> Taylor:
        """Accelerations, rad/s^2."""

    @property
    def motor_torques(self) -> Taylor:
        """The motors' own torques, N m."""

    def limited_rate(self, limit: float) -> LimitedQuantity:
        """The base's rate, and its limit, rad/s."""


# Models (K, cells, n) of what limits of the joints are about, named as in the table of limits, in a plane and in space;
# looked up only where something limits it.
JOINT_QUANTITIES: Mapping[str, Callable[[Actuated, Moved], Taylor]] = {
    "velocities": lambda robot, joints: joints.velocities,
    "accelerations": lambda robot, joints: joints.accelerations,
}


def generalized_torques(robot: Actuated, joints: Moved) -> Taylor:
    """Torques (K, cells, n), N m, by ratio of all motors that a planned joint moves with."""
    return joints.motor_torques.linear(Balls.exact(robot.motor_ratios.T))


def limit_findings(
    robot: Actuated, record: PlanRecord, joints: Moved, cells: TimeCells
) -> tuple[list[Finding], dict[str, list[Minimum]]]:
    """Findings on all that is limited, and on the peaks that the record claims; and these peaks.

    They are named as in the record: "velocity_peak" (n), "torque_peak" (n) and "motor_torque_peak" (motors), each with
    the least value of minus the magnitude.
    """
    findings, beyond = _range_findings(record)
    limited, claimed = _limited(robot, record, joints)
    limited += [_beyond_range(record, joints.positions, joint) for joint in beyond]
    least = least_of(limited, cells)
    for quantity, peak in zip(limited, least, strict=True):
        if quantity.limit != math.inf:
            finding = at_most(
                kind=quantity.kind,
                subject=quantity.subject,
                upper=quantity.root(-peak.bound, math.inf),
                attained=quantity.root(-peak.attained, 0.0),
                limit=quantity.limit,
                tolerance=quantity.tolerance,
                instant=peak.instant,
            )
            findings.append(finding)
    peaks = {}
    for name, indices in claimed.items():
        peaks[name] = [least[index] for index in indices]
    recorded = {"velocity_peak": record.velocity_peak, "torque_peak": record.torque_peak}
    if record.motor_torque_peak is not None:
        for name in robot.motors:
            if name not in record.motor_torque_peak:
                raise InputError("is missing", element=f"motor_torque_peak.{name}")
        recorded["motor_torque_peak"] = np.array([float(record.motor_torque_peak[name]) for name in robot.motors])
    return findings + [_recorded_peaks(name, values, peaks[name]) for name, values in recorded.items()], peaks


def _range_findings(record: PlanRecord) -> tuple[list[Finding], list[int]]:
    """Joint ranges that hold because ``|sin| <= 1``; and the joints for which that does not say so."""
    findings = []
    left = []
    with flint.ctx.workprec(PRECISION):
        for index, (low, high) in enumerate(record.problem["limits"]["position"]):
            centre = flint.arb(float(record.centre[index]))
            amplitude = abs(float(record.amplitude[index]))
            beyond = flint.arb.max(centre + amplitude - high, low - (centre - amplitude))
            bound = float(beyond.upper()) + 2.0**-60
            if bound <= RANGE:
                findings.append(Finding("position", (record.robot.joints[index],), "proved", bound, None, 0.0))
            else:
                left.append(index)
    return findings, left


def _limited(robot: Actuated, record: PlanRecord, joints: Moved) -> tuple[list[LimitedQuantity], dict[str, list[int]]]:
    """All limited quantities but ranges, and those whose peaks the record claims: which of them these are."""
    limits = record.problem["limits"]
    names = record.robot.joints
    limited: list[LimitedQuantity] = []
    claimed: dict[str, list[int]] = {"velocity_peak": [], "torque_peak": [], "motor_torque_peak": []}
    for row in JOINT_LIMITS:
        of_row = [_limit(limit) for limit in limits.get(row.key) or [None] * len(names)]
        is_limited = any(limit != math.inf for limit in of_row)
        if not (row.always or is_limited):
            continue
        models = JOINT_QUANTITIES[row.quantity](robot, joints)
        for i, name in enumerate(names):
            if row.key == "velocity":
                claimed["velocity_peak"].append(len(limited))
            if row.always or of_row[i] != math.inf:
                limited.append(LimitedQuantity(row.key, (name,), models[:, i : i + 1], of_row[i]))
    own = limits.get("motor_torque") or {}
    for name in own:
        _motor(robot, name, "motor_torque")
    several = np.count_nonzero(robot.motor_ratios, axis=0) > 1  # motors move one joint: torques are added
    for i, name in enumerate(robot.motors):
        limit = _limit(own.get(name))
        if i < len(names) and not several[i]:
            limit = min(limit, _limit(limits["torque"][i]))
        claimed["motor_torque_peak"].append(len(limited))
        limited.append(LimitedQuantity("torque", (name,), joints.motor_torques[:, i : i + 1], limit))
    generalized = generalized_torques(robot, joints) if several.any() else None
    for i, name in enumerate(names):
        claimed["torque_peak"].append(len(limited) if several[i] else claimed["motor_torque_peak"][i])
        if generalized is not None and several[i]:
            models = generalized[:, i : i + 1]
            limited.append(LimitedQuantity("generalized_torque", (name,), models, _limit(limits["torque"][i])))
    for name, motor in (limits.get("motor") or {}).items():
        limited.append(_motor_curve(robot, joints, name, motor))
    if limits.get("orientation_rate") is not None:
        limited.append(joints.limited_rate(float(limits["orientation_rate"])))
    return limited, claimed


def _motor_curve(robot: Actuated, joints: Moved, name: str, motor: Mapping[str, Any]) -> LimitedQuantity:
    """``|torque| + slope |velocity|`` of a motor, as the larger of two magnitudes."""
    i = _motor(robot, name, "motor")
    leader = int(np.argmax(np.abs(robot.motor_ratios[i])))
    slope = flint.arb(float(motor["slope"])) * float(robot.motor_ratios[i, leader])
    drop = joints.velocities[:, leader : leader + 1].times(Balls.from_arb([slope], (1,)))
    torque = joints.motor_torques[:, i : i + 1]
    return LimitedQuantity("motor", (name,), stack([torque + drop, torque - drop]), float(motor["stall"]))


def _beyond_range(record: PlanRecord, positions: Taylor, joint: int) -> LimitedQuantity:
    """Distance of a joint from the middle of its range, where its sine polynomial alone does not keep it inside."""
    low, high = record.problem["limits"]["position"][joint]
    with flint.ctx.workprec(PRECISION):
        middle = Balls.from_arb([(flint.arb(low) + high) / 2], (1,)).broadcast((len(positions.e), 1))
        reach = float(((flint.arb(high) - low) / 2).lower())
    position = positions[:, joint : joint + 1]
    name = record.robot.joints[joint]
    return LimitedQuantity("position", (name,), position - Taylor.constant(middle, position.order), reach)


def _motor(robot: Actuated, name: str, key: str) -> int:
    if name not in robot.motors:
        raise InputError("must be the name of one of the robot's motors", element=f"problem.limits.{key}.{name}")
    return robot.motors.index(name)


def least_of(limited: Sequence[LimitedQuantity], cells: TimeCells) -> tuple[Minimum, ...]:
    """The least value of minus the magnitude of each quantity."""
    counts = [q.models.e.shape[1] for q in limited]
    models = stack([q.models for q in limited])
    thresholds = -np.array([(q.limit + q.tolerance) ** q.power for q in limited])
    sizes = np.fmax.reduceat(np.fmax.reduce(models.size, axis=0, initial=0.0), np.cumsum([0, *counts[:-1]]))
    goal = Goal(gap=PEAK_GAP * sizes + 1e-12, threshold=thresholds)
    items = Items.whole_cells([bernstein(models)], np.arange(len(cells)))
    groups = np.repeat(np.arange(len(limited)), counts)
    return smallest(items, groups, lambda forms, _: -magnitude(forms[0]), _at_point, goal, cells)


def _at_point(values: Balls, member: IntArray) -> Array:
    return np.asarray(-np.maximum(0.0, (np.abs(values.mid[0]) - values.rad[0]) * (1.0 - 2.0**-50)))


def _recorded_peaks(name: str, recorded: Array, peaks: Sequence[Minimum]) -> Finding:
    """Whether the peaks that the file claims are those enclosed."""
    upper = np.array([-peak.bound for peak in peaks])
    lower = np.array([-peak.attained for peak in peaks])
    scale = RECORDED_PEAK * np.maximum(upper, 1e-3)
    farthest = np.maximum(np.abs(recorded - upper), np.abs(recorded - lower)) / scale
    nearest = np.maximum(0.0, np.maximum(recorded - upper, lower - recorded)) / scale
    upper_off = float(farthest.max()) * RECORDED_PEAK
    least_off = float(nearest.max()) * RECORDED_PEAK
    return at_most("recorded", (name,), upper_off, least_off, 0.0, RECORDED_PEAK, None)


def _limit(limit: float | None) -> float:
    return math.inf if limit is None else float(limit)
