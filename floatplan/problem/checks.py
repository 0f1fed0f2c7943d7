"""From what the user gives to what a problem keeps: checked, in joint order, every fault with its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import InputError
from floatplan.problem.ground import ground_height, resting_height
from floatplan.problem.parts import (
    OBJECTIVES,
    Flight,
    HalfPlane,
    JointState,
    JointValues,
    Landing,
    Limits,
    Motion,
    Obstacle,
    Posture,
    SelfClearance,
    Takeoff,
)
from floatplan.robot.robot import Robot

LOWEST_DEGREE = 5
HIGHEST_DEGREE = 15  # above it, the doubles of a plan file no longer hold (13) and the orientation to 1e-8 rad
MOST_JOINTS = 60
EDGE = 1e-12  # of the range: closer than this, a joint stands on its edge
FULL_RANGE = (-math.pi, math.pi)


class ProblemError(InputError):
    """All that is wrong with a problem, one thing a line.

    Attributes
    ----------
    errors : tuple of InputError
        At least one.
    """

    def __init__(self, errors: Sequence[InputError]) -> None:
        self.errors = tuple(errors)
        super().__init__("\n".join(str(error) for error in errors))

    def within(self, source: str | Path | None = None, element: str | None = None) -> ProblemError:
        """Return the same errors, each with its file, or the element around it, added."""
        return ProblemError([error.within(source, element) for error in self.errors])


def faults(checks: Iterable[Callable[[], None]]) -> list[InputError]:
    """Run the checks and return what they raise."""
    errors = []
    for check in checks:
        try:
            check()
        except InputError as error:
            errors.append(error)
    return errors


def joint_state(robot: Robot, posture: Posture, element: str) -> JointState:
    """Return a posture as arrays in joint order."""
    _finite(posture.orientation, f"{element}.orientation")
    return JointState(
        orientation=float(posture.orientation),
        positions=_joint_values(robot, posture.positions, f"{element}.positions", default=None),
        velocities=_joint_values(robot, posture.velocities, f"{element}.velocities", default=0.0),
        accelerations=_joint_values(robot, posture.accelerations, f"{element}.accelerations", default=0.0),
    )


def _joint_values(robot: Robot, values: JointValues, element: str, default: float | None) -> Array:
    """Values (n,) in joint order; joints that a mapping leaves out take the default, and without one are missing."""
    if isinstance(values, Mapping):
        _check_joint_names(robot, values, element)
        missing = [joint for joint in robot.joints if joint not in values]
        if missing and default is None:
            raise InputError(
                f"no value for joint {missing[0]!r}", element=element, advice=f"give one for each of {_listed(robot)}"
            )
        filled = [values.get(joint, default) for joint in robot.joints]
    elif isinstance(values, int | float):
        filled = [values] * len(robot.joints)
    else:
        filled = list(values)
    if len(filled) != len(robot.joints):
        raise InputError(
            f"{len(filled)} values for {len(robot.joints)} joints", element=element, advice=f"joints: {_listed(robot)}"
        )
    for joint, value in zip(robot.joints, filled, strict=True):
        _finite(value, f"{element}.{joint}")
    return read_only(np.array(filled, dtype=np.float64))


def position_limits(robot: Robot, limits: Limits) -> Array:
    """Return the joint ranges (n, 2) in rad that a problem with these limits has: always finite."""
    given = robot.position_limits.copy()
    given[~np.isfinite(given).all(axis=1)] = FULL_RANGE
    if isinstance(limits.position, str):
        if limits.position == "full":
            given[:] = FULL_RANGE
        elif limits.position != "urdf":
            raise InputError(f"{limits.position!r} is none of 'urdf', 'full', a table", element="limits.position")
    elif isinstance(limits.position, Mapping):
        _check_joint_names(robot, limits.position, "limits.position")
        for joint, interval in limits.position.items():
            given[robot.joints.index(joint)] = _interval(interval, f"limits.position.{joint}")
    else:
        if len(limits.position) != len(robot.joints):
            raise InputError(f"{len(limits.position)} ranges for {len(robot.joints)} joints", element="limits.position")
        for index, interval in enumerate(limits.position):
            given[index] = _interval(interval, f"limits.position.{robot.joints[index]}")
    return read_only(given)


def _interval(interval: Sequence[float], element: str) -> tuple[float, float]:
    if len(interval) != 2:
        raise InputError("a range has two numbers, low and high", element=element)
    low, high = interval
    _finite(low, element)
    _finite(high, element)
    if not low < high:
        raise InputError(f"low {low} is not below high {high}", element=element)
    return float(low), float(high)


def velocity_limits(robot: Robot, given: str | JointValues) -> Array:
    """Return limits (n,) rad/s of the planned coordinates, infinite where there is none.

    A number or a mapping is about each motor: a leader is as slow as its followers demand, by their ratios.
    """
    if isinstance(given, str):
        return robot.velocity_limits if given == "urdf" else _no_limits(robot, given, "velocity")
    if not isinstance(given, Mapping | int | float):
        return _by_coordinate(robot, given, "velocity")
    own = _by_motor(robot, given, "velocity")
    with np.errstate(divide="ignore"):
        per_coordinate = own[:, None] / np.abs(robot.motor_ratios)
    return read_only(np.where(robot.motor_ratios != 0, per_coordinate, math.inf).min(axis=0))


def motor_torque_limits(robot: Robot, given: str | JointValues) -> Array:
    """Return limits (m,) N m of the motors' own torques, infinite where there is none.

    A sequence (n,) is about the generalised torques: it is a motor's own limit where the joint has but one motor.
    """
    if isinstance(given, str):
        return robot.motor_torque_limits if given == "urdf" else _no_limits(robot, given, "torque")
    if isinstance(given, Mapping | int | float):
        return _by_motor(robot, given, "torque")
    generalized = _by_coordinate(robot, given, "torque")
    alone = (robot.motor_ratios != 0).sum(axis=0) == 1
    leader = _leaders(robot)
    return read_only(np.where(alone[leader], generalized[leader], math.inf))


def torque_limits(robot: Robot, given: str | JointValues) -> Array:
    """Return limits (n,) N m of the generalised torques: as given, or what those of the motors add up to."""
    if isinstance(given, str | Mapping | int | float):
        own, ratios = motor_torque_limits(robot, given), np.abs(robot.motor_ratios)
        return read_only((ratios * np.where(ratios > 0, own[:, None], 0.0)).sum(axis=0))
    return _by_coordinate(robot, given, "torque")


def _no_limits(robot: Robot, word: str, name: str) -> Array:
    """No limit of any motor (m,), or of any coordinate (n,) where the limits are by coordinate."""
    if word != "none":
        raise InputError(
            f"must be 'urdf', 'none', a number or a table by joint, not {word!r}", element=f"limits.{name}"
        )
    return read_only(np.full(len(robot.joints if name == "velocity" else robot.motors), math.inf))


def _by_motor(robot: Robot, given: Mapping[str, float] | float, name: str) -> Array:
    """Limits (m,) of the motors: one for all, or by name; a leader's value holds for followers that are not named."""
    element = f"limits.{name}"
    if isinstance(given, Mapping):
        _check_motor_names(robot, given, element)
        values = np.array([_of_motor(robot, given, index, math.inf) for index in range(len(robot.motors))], np.float64)
    else:
        values = np.full(len(robot.motors), given, np.float64)
    _check_positive(values, robot.motors, element)
    return read_only(values)


def _by_coordinate(robot: Robot, given: Sequence[float] | Array, name: str) -> Array:
    """Limits (n,) of the planned coordinates."""
    element = f"limits.{name}"
    values = np.array(list(given), dtype=np.float64)
    if values.shape != (len(robot.joints),):
        raise InputError(f"{values.size} values for {len(robot.joints)} joints", element=element)
    _check_positive(values, robot.joints, element)
    return read_only(values)


def _check_positive(values: Array, names: Sequence[str], element: str) -> None:
    for joint, value in zip(names, values, strict=True):
        if not value > 0:
            raise InputError(f"{value} is not a positive number", element=f"{element}.{joint}")


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
    for joint, motor in limits.motor.items():
        value = getattr(motor, name)
        _finite(value, f"limits.motor.{joint}.{name}")
        if value < 0 or (name == "stall" and value == 0):
            raise InputError(f"{value} is not a positive number", element=f"limits.motor.{joint}.{name}")
    curves = [_of_motor(robot, limits.motor, index, None) for index in range(len(robot.motors))]
    return read_only([default if curve is None else getattr(curve, name) for curve in curves])


def degrees_of(robot: Robot, motion: Motion) -> tuple[int, ...]:
    """Return k_i of (12) for each joint."""
    n = len(robot.joints)
    if n > MOST_JOINTS:
        raise InputError(f"{n} planned joints, more than {MOST_JOINTS}", element="robot.joints", advice="lock some")
    if isinstance(motion.degree, str):
        if motion.degree != "auto":
            raise InputError(f"{motion.degree!r} is none of a number, a list, 'auto'", element="motion.degree")
        return (7,) * n
    degrees = (motion.degree,) * n if isinstance(motion.degree, int) else tuple(motion.degree)
    if len(degrees) != n:
        raise InputError(f"{len(degrees)} degrees for {n} joints", element="motion.degree")
    for degree in degrees:
        if isinstance(degree, bool) or not isinstance(degree, int):
            raise InputError(f"{degree!r} is not a whole number", element="motion.degree")
        if not LOWEST_DEGREE <= degree <= HIGHEST_DEGREE:
            raise InputError(
                f"degree {degree} is outside {LOWEST_DEGREE} to {HIGHEST_DEGREE}",
                element="motion.degree",
                advice="six boundary conditions per joint need degree 5; one more at least is needed to steer, (16)",
            )
    return degrees


def check_objective(motion: Motion) -> None:
    """Refuse an objective that is none."""
    if motion.objective not in OBJECTIVES:
        raise InputError(f"{motion.objective!r} is none of {', '.join(OBJECTIVES)}", element="motion.objective")


def check_orientation_rate(limits: Limits) -> None:
    """Refuse a limit that is not positive."""
    if limits.orientation_rate is not None and not (
        limits.orientation_rate > 0 and math.isfinite(limits.orientation_rate)
    ):
        raise InputError(f"{limits.orientation_rate} is not a positive number", element="limits.orientation_rate")


def check_duration(flight: Flight) -> None:
    """Refuse a duration that is not positive."""
    _finite(flight.duration, "flight.duration")
    if not flight.duration > 0:
        raise InputError(f"{flight.duration} s is not positive", element="flight.duration")


def check_angular_momentum(flight: Flight) -> None:
    """Refuse what is neither a number nor a known word."""
    if not isinstance(flight.angular_momentum, str):
        _finite(flight.angular_momentum, "flight.angular_momentum")
    elif flight.angular_momentum not in ("midpoint", "free"):
        raise InputError(
            f"{flight.angular_momentum!r} is none of a number, 'midpoint', 'free'", element="flight.angular_momentum"
        )


def check_ballistics(flight: Flight) -> None:
    """Refuse velocities and gravity that cannot be."""
    _finite(flight.horizontal_velocity, "flight.horizontal_velocity")
    _finite(flight.gravity, "flight.gravity")
    if flight.gravity < 0:
        raise InputError(f"{flight.gravity} m/s^2 is negative; downwards is positive", element="flight.gravity")


def takeoff_of(robot: Robot, flight: Flight) -> Takeoff:
    """Return the takeoff with its default filled in."""
    takeoff = flight.takeoff or Takeoff(robot.tree.names[0])
    _check_frame(robot, takeoff.frame, "flight.takeoff.frame")
    _finite(takeoff.position, "flight.takeoff.position")
    return takeoff


def landing_of(robot: Robot, flight: Flight, start: Posture, goal: Posture, ground: bool) -> Landing:
    """Return the landing with its defaults filled in: on the ground where there is one."""
    takeoff = takeoff_of(robot, flight)
    landing = flight.landing or Landing(takeoff.frame, None if ground else takeoff.position[1])
    _check_frame(robot, landing.frame, "flight.landing.frame")
    if landing.height is None and ground:
        line = ground_height(robot, takeoff.frame, takeoff.position, joint_state(robot, start, "start"))
        height = resting_height(robot, landing.frame, line, joint_state(robot, goal, "goal"))
        return Landing(landing.frame, height)
    height = 0.0 if landing.height is None else landing.height
    _finite(height, "flight.landing.height")
    return Landing(landing.frame, height)


def check_inside(robot: Robot, limits: Array, state: JointState, element: str, index: int) -> None:
    """Refuse a joint outside its range, and one on its edge that does not stand still or accelerates outwards."""
    joint, (low, high) = robot.joints[index], limits[index]
    position, velocity, acceleration = (
        float(values[index]) for values in (state.positions, state.velocities, state.accelerations)
    )
    if not low <= position <= high:
        raise InputError(
            f"{position:.6g} rad is outside the joint's range [{low:.6g}, {high:.6g}]",
            element=f"{element}.positions.{joint}",
            advice="move it inside, or widen the range with limits.position",
        )
    if min(position - low, high - position) > EDGE * (high - low):
        return
    edge = f"on the edge of the joint's range [{low:.6g}, {high:.6g}]"
    if velocity != 0:
        raise InputError(
            f"{velocity:.6g} rad/s {edge}",
            element=f"{element}.velocities.{joint}",
            advice="a joint can only be on the edge of its range at rest",
        )
    if acceleration * (2 * position - low - high) > 0:
        raise InputError(
            f"{acceleration:.6g} rad/s^2 {edge} points out of it", element=f"{element}.accelerations.{joint}"
        )


def check_obstacle(obstacle: Obstacle, element: str, duration: float) -> None:
    """Refuse an obstacle whose numbers cannot be, or that never meets the flight."""
    for name in ("center", "point", "normal", "start", "end", "velocity", "radius", "margin"):
        if hasattr(obstacle, name):
            _finite(getattr(obstacle, name), f"{element}.{name}")
    for name in ("radius", "margin"):
        if getattr(obstacle, name, 0.0) < 0:
            raise InputError(f"{getattr(obstacle, name)} m is negative", element=f"{element}.{name}")
    if isinstance(obstacle, HalfPlane) and obstacle.normal == (0.0, 0.0):
        raise InputError("the normal has length zero", element=f"{element}.normal")
    if obstacle.window is not None:
        _finite(obstacle.window, f"{element}.window")
        start, end = obstacle.window
        if not start < end:
            raise InputError(f"the window ends ({end} s) before it begins ({start} s)", element=f"{element}.window")
        if end < 0 or start > duration:
            raise InputError(
                f"the window [{start}, {end}] s lies outside the flight of {duration} s", element=f"{element}.window"
            )


def check_pair(robot: Robot, pair: SelfClearance, element: str) -> None:
    """Refuse links that the robot does not have, or that are the same."""
    known = {shape.link for shape in robot.shapes}
    for link in pair.links:
        if link not in known:
            raise InputError(
                f"no link {link!r} with a shape", element=f"{element}.links", advice=f"links: {sorted(known)}"
            )
    if pair.links[0] == pair.links[1]:
        raise InputError("the two links are the same", element=f"{element}.links")
    _finite(pair.margin, f"{element}.margin")
    if pair.margin < 0:
        raise InputError(f"{pair.margin} m is negative", element=f"{element}.margin")


def _check_joint_names(robot: Robot, values: Mapping[str, object], element: str) -> None:
    for joint in values:
        if joint not in robot.joints:
            raise InputError(
                f"{joint!r} is not a planned joint of the robot", element=element, advice=f"joints: {_listed(robot)}"
            )


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


def _check_frame(robot: Robot, name: str, element: str) -> None:
    if name not in robot.frames:
        raise InputError(
            f"the robot has no frame {name!r}", element=element, advice=f"frames: {', '.join(sorted(robot.frames))}"
        )


def _finite(value: object, element: str) -> None:
    try:
        finite = bool(np.isfinite(np.asarray(value, dtype=np.float64)).all())
    except (TypeError, ValueError):
        finite = False
    if not finite:
        raise InputError(f"{value!r} is not a finite number", element=element)


def _listed(robot: Robot) -> str:
    return ", ".join(robot.joints)
