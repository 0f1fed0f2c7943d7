"""What the robot may do, resolved to arrays in the order of joints and motors: from ``[limits]`` to numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import InputError, ProblemError, faults
from floatplan.problem.checks import check_joint_names
from floatplan.problem.parts import JointState, JointValues, Limits
from floatplan.robot.robot import Robot
from floatplan.tables import JOINT_LIMITS, LIMIT_TABLE, LimitRow

EDGE = 1e-12  # of the range: closer than this, a joint stands on its edge
NARROWEST = 1e-6  # rad, of a joint's range
FULL_RANGE = (-math.pi, math.pi)
TORQUE = LIMIT_TABLE["torque"]


def position_limits(robot: Robot, limits: Limits) -> Array:
    """Return the joint ranges (n, 2) in rad that a problem with these limits has: always finite."""
    given = robot.position_limits.copy()
    given[~np.isfinite(given).all(axis=1)] = FULL_RANGE
    if isinstance(limits.position, str):
        if limits.position == "full":
            given[:] = FULL_RANGE
    elif isinstance(limits.position, Mapping):
        check_joint_names(robot, limits.position, "limits.position")
        for joint, interval in limits.position.items():
            given[robot.joints.index(joint)] = _interval(interval, f"limits.position.{joint}")
    else:
        if len(limits.position) != len(robot.joints):
            raise InputError(f"{len(limits.position)} ranges for {len(robot.joints)} joints", element="limits.position")
        for index, interval in enumerate(limits.position):
            given[index] = _interval(interval, f"limits.position.{robot.joints[index]}")
    return read_only(given)


def _interval(interval: Sequence[float], element: str) -> tuple[float, float]:
    low, high = interval
    if not low < high:
        raise InputError(f"low {low} is not below high {high}", element=element)
    if high - low < NARROWEST:
        raise InputError(
            f"[{low}, {high}] is narrower than {NARROWEST:g} rad", element=element, advice="lock the joint"
        )
    return float(low), float(high)


def joint_limits(robot: Robot, limits: Limits) -> dict[str, Array]:
    """Return the limits (n,) of the planned coordinates' motion, by key of ``[limits]``.

    Raises
    ------
    ProblemError
        All that is wrong with them.
    """
    resolved: dict[str, Array] = {}

    def resolve(row: LimitRow) -> None:
        resolved[row.key] = _joint_limit(robot, row, getattr(limits, row.key))

    errors = faults(partial(resolve, row) for row in JOINT_LIMITS)
    if errors:
        raise ProblemError(errors)
    return resolved


def _joint_limit(robot: Robot, row: LimitRow, given: str | JointValues) -> Array:
    """Return limits (n,), in the row's unit, of the planned coordinates, infinite where there is none.

    A number or a mapping is about each motor: a leader is as slow as its followers demand, by their ratios.
    """
    if isinstance(given, str):
        if row.in_urdf and given == "urdf":
            return read_only(getattr(robot, f"{row.key}_limits"))
        return _no_limits(len(robot.joints))
    if not isinstance(given, Mapping | int | float):
        return _by_coordinate(robot, given, row)
    own = _by_motor(robot, given, row)
    with np.errstate(divide="ignore"):
        per_coordinate = own[:, None] / np.abs(robot.motor_ratios)
    return read_only(np.where(robot.motor_ratios != 0, per_coordinate, math.inf).min(axis=0))


def motor_torque_limits(robot: Robot, given: str | JointValues) -> Array:
    """Return limits (m,) N m of the motors' own torques, infinite where there is none.

    A sequence (n,) is about the generalised torques: it is a motor's own limit where the joint has but one motor.
    """
    if isinstance(given, str):
        return robot.motor_torque_limits if given == "urdf" else _no_limits(len(robot.motors))
    if isinstance(given, Mapping | int | float):
        return _by_motor(robot, given, TORQUE)
    generalized = _by_coordinate(robot, given, TORQUE)
    alone = (robot.motor_ratios != 0).sum(axis=0) == 1
    leader = _leaders(robot)
    return read_only(np.where(alone[leader], generalized[leader], math.inf))


def torque_limits(robot: Robot, given: str | JointValues) -> Array:
    """Return limits (n,) N m of the generalised torques: as given, or what those of the motors add up to."""
    if isinstance(given, str | Mapping | int | float):
        own, ratios = motor_torque_limits(robot, given), np.abs(robot.motor_ratios)
        return read_only((ratios * np.where(ratios > 0, own[:, None], 0.0)).sum(axis=0))
    return _by_coordinate(robot, given, TORQUE)


def _no_limits(count: int) -> Array:
    """No limit of any of so many motors or coordinates."""
    return read_only(np.full(count, math.inf))


def _by_motor(robot: Robot, given: Mapping[str, float] | float, row: LimitRow) -> Array:
    """Limits (m,) of the motors: one for all, or by name; a leader's value holds for followers that are not named."""
    element = f"limits.{row.key}"
    if isinstance(given, Mapping):
        _check_motor_names(robot, given, element)
        values = np.array([_of_motor(robot, given, index, math.inf) for index in range(len(robot.motors))], np.float64)
    else:
        values = np.full(len(robot.motors), given, np.float64)
    return read_only(values)


def _by_coordinate(robot: Robot, given: Sequence[float] | Array, row: LimitRow) -> Array:
    """Limits (n,) of the planned coordinates."""
    element = f"limits.{row.key}"
    values = np.array(list(given), dtype=np.float64)
    if values.shape != (len(robot.joints),):
        raise InputError(f"{values.size} values for {len(robot.joints)} joints", element=element)
    return read_only(values)


def _leaders(robot: Robot) -> IntArray:
    """Index (m,) of the planned joint that each motor turns, or follows."""
    return np.asarray(np.abs(robot.motor_ratios).argmax(axis=1))


def _of_motor(robot: Robot, given: Mapping[str, Any], motor: int, default: Any) -> Any:
    """What a mapping says of a motor: by its own name, else by its leader's."""
    leader = robot.joints[int(_leaders(robot)[motor])]
    return given.get(robot.motors[motor], given.get(leader, default))


def motor_values(robot: Robot, limits: Limits, name: str, default: float) -> Array:
    """Return one field of the motors' curves (m,), the default where a motor has none."""
    _check_motor_names(robot, limits.motor, "limits.motor")
    curves = [_of_motor(robot, limits.motor, index, None) for index in range(len(robot.motors))]
    return read_only([default if curve is None else getattr(curve, name) for curve in curves])


def _check_motor_names(robot: Robot, values: Mapping[str, object], element: str) -> None:
    for joint in values:
        if joint in robot.coupled and joint not in robot.motors:
            leader = robot.coupled[joint].leader
            raise InputError(
                f"{joint!r} has no motor of its own: the URDF couples it to {leader!r} by <mimic>",
                element=element,
                advice=f"set that of {leader!r}",
            )
        if joint not in robot.motors:
            raise InputError(
                f"{joint!r} is not a planned joint of the robot, nor one coupled to it",
                element=element,
                advice=f"joints: {', '.join(robot.motors)}",
            )


def _in_degrees(position: float, low: float, high: float) -> str:
    """The same once more, for who wrote degrees."""
    return f" ({math.degrees(position):.4g} degrees, outside {math.degrees(low):.4g} to {math.degrees(high):.4g})"


def check_inside(robot: Robot, limits: Array, state: JointState, element: str, index: int) -> None:
    """Refuse a joint outside its range, and one on its edge that does not stand still or accelerates outwards."""
    joint, (low, high) = robot.joints[index], limits[index]
    position, velocity, acceleration = (
        float(values[index]) for values in (state.positions, state.velocities, state.accelerations)
    )
    if not low <= position <= high:
        raise InputError(
            f"{position:.6g} rad is outside the joint's range [{low:.6g}, {high:.6g}]"
            f"{_in_degrees(position, low, high)}",
            element=f"{element}.positions.{joint}",
            advice="move it inside, or widen the range with limits.position",
        )
    if min(position - low, high - position) > EDGE * (high - low):
        return
    edge = f"on the edge of the joint's range [{low:.6g}, {high:.6g}]"
    if not (velocity == 0 or np.isnan(velocity)):
        raise InputError(
            f"{velocity:.6g} rad/s {edge}",
            element=f"{element}.velocities.{joint}",
            advice="a joint can only be on the edge of its range at rest",
        )
    if acceleration * (2 * position - low - high) > 0:
        raise InputError(
            f"{acceleration:.6g} rad/s^2 {edge} points out of it", element=f"{element}.accelerations.{joint}"
        )
