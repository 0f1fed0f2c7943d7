"""From what the user gives to what a problem keeps: checked, in joint order, every fault with its place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.problem.ground import ground_height, resting_height
from floatplan.problem.parts import (
    OBSTACLE_KINDS,
    Flight,
    JointState,
    Landing,
    Motion,
    Obstacle,
    Posture,
    SelfClearance,
    Takeoff,
)
from floatplan.robot.robot import Robot
from floatplan.tables import MOST_OBSTACLES, OBJECTIVES, RANGES, REST, check_number

LONGEST = 1700  # characters of all that is wrong with a problem
MOST_DISTANCES = 800  # between shapes of links and obstacles
LOWEST_DEGREE = 5
HIGHEST_DEGREE = 15  # above it, the doubles of a plan file no longer hold (13) and the orientation to 1e-8 rad
MOST_JOINTS = 60


class ProblemError(InputError):
    """All that is wrong with a problem, one thing a line.

    Attributes
    ----------
    errors : tuple of InputError
        At least one.
    """

    def __init__(self, errors: Sequence[InputError]) -> None:
        self.errors = tuple(errors)
        super().__init__("several things are wrong")

    def __str__(self) -> str:
        """All of them, as far as there is room."""
        told, room = [], LONGEST
        for error in map(str, self.errors):
            room -= len(error) + 1
            if room < 0:
                break
            told.append(error)
        rest = len(self.errors) - len(told)
        return "\n".join([*told, *([f"and {rest} more"] if rest else [])])

    def within(self, source: str | Path | None = None, element: str | None = None) -> ProblemError:
        """Return the same errors, each with its file, or the element around it, added."""
        return ProblemError([error.within(source, element) for error in self.errors])


def refuse(errors: Sequence[InputError]) -> None:
    """Raise what is wrong, if anything is: one error as it is, several together, what was found twice once."""
    different = list({str(error): error for error in errors}.values())
    if different:
        raise ProblemError(different) if len(different) > 1 else different[0]


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
    check_number(posture.orientation, f"{element}.orientation", "orientation")
    settled = posture.settled or (None, None)
    frame_rests = _is_word(posture.velocities, REST[element], f"{element}.velocities")
    free_accelerations = _is_word(posture.accelerations, "free", f"{element}.accelerations")
    velocities = settled[0] if frame_rests else posture.velocities
    accelerations = settled[1] if free_accelerations else posture.accelerations
    return JointState(
        orientation=float(posture.orientation),
        positions=_joint_values(robot, posture.positions, f"{element}.positions", default=None),
        velocities=_joint_values(robot, velocities, f"{element}.velocities", default=0.0),
        accelerations=_joint_values(robot, accelerations, f"{element}.accelerations", default=0.0),
        frame_rests=frame_rests,
        free_accelerations=free_accelerations,
    )


def _is_word(values: object, word: str, element: str) -> bool:
    if not isinstance(values, str):
        return False
    if values != word:
        raise InputError(f"must be numbers or {word!r}, not {values!r}", element=element)
    return True


def check_contact(flight: Flight, state: JointState, element: str) -> None:
    """Refuse rates of a frame at rest where no frame is named that stands on the ground."""
    if state.frame_rests and flight.takeoff is None and (element == "start" or flight.landing is None):
        raise InputError(
            f"{REST[element]!r} needs a frame that stands on the ground",
            element=f"{element}.velocities",
            advice=f"name it as flight.{REST[element]}, or give the rates",
        )


def _joint_values(robot: Robot, values: Any, element: str, default: float | None) -> Array:
    """Values (n,) in joint order; joints that a mapping leaves out take the default, and without one are missing.

    NaN for None.
    """
    if values is None:
        return read_only(np.full(len(robot.joints), np.nan))
    if isinstance(values, Mapping):
        check_joint_names(robot, values, element)
        missing = [joint for joint in robot.joints if joint not in values]
        if missing and default is None:
            raise InputError(
                f"no value for joint {missing[0]!r}", element=element, advice=f"give one for each of {listed(robot)}"
            )
        filled = [values.get(joint, default) for joint in robot.joints]
    elif isinstance(values, int | float):
        filled = [values] * len(robot.joints)
    else:
        filled = list(values)
    if len(filled) != len(robot.joints):
        raise InputError(
            f"{len(filled)} values for {len(robot.joints)} joints", element=element, advice=f"joints: {listed(robot)}"
        )
    for joint, value in zip(robot.joints, filled, strict=True):
        check_number(value, f"{element}.{joint}", element.rpartition(".")[2])
    return read_only(np.array(filled, dtype=np.float64))


def degrees_of(robot: Robot, motion: Motion) -> tuple[int, ...]:
    """Return k_i of (12) for each joint."""
    n = len(robot.joints)
    if n > MOST_JOINTS:
        raise InputError(f"{n} planned joints, more than {MOST_JOINTS}", element="robot.joints", advice="lock some")
    if isinstance(motion.degree, str):
        if motion.degree != "auto":
            raise InputError(
                f"must be an integer, a list of integers or 'auto', not {motion.degree!r}", element="motion.degree"
            )
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
    """Refuse an objective that is not in the table."""
    if motion.objective not in OBJECTIVES:
        known = " or ".join(map(repr, OBJECTIVES))
        raise InputError(f"must be {known}, not {motion.objective!r}", element="motion.objective")


def check_duration(flight: Flight) -> None:
    """Refuse a duration that is not positive, or out of its range."""
    check_number(flight.duration, "flight.duration", "duration")


def check_angular_momentum(flight: Flight) -> None:
    """Refuse what is neither a number nor a known word."""
    if not isinstance(flight.angular_momentum, str):
        check_number(flight.angular_momentum, "flight.angular_momentum", "angular_momentum")
    elif flight.angular_momentum not in ("midpoint", "free"):
        raise InputError(
            f"must be a number, 'midpoint' or 'free', not {flight.angular_momentum!r}",
            element="flight.angular_momentum",
        )


def check_ballistics(flight: Flight) -> None:
    """Refuse velocities and gravity that cannot be."""
    check_number(flight.horizontal_velocity, "flight.horizontal_velocity", "horizontal_velocity")
    check_number(flight.gravity, "flight.gravity", "gravity", advice="downwards is positive")


def takeoff_of(robot: Robot, flight: Flight) -> Takeoff:
    """Return the takeoff with its default filled in."""
    takeoff = flight.takeoff or Takeoff(robot.tree.names[0])
    _check_frame(robot, takeoff.frame, "flight.takeoff.frame")
    check_number(takeoff.position, "flight.takeoff.position", "position")
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
    check_number(height, "flight.landing.height", "height")
    return Landing(landing.frame, height)


def check_counts(robot: Robot, obstacles: Sequence[Obstacle], pairs: Sequence[SelfClearance]) -> None:
    """Refuse more of them than a search can look at in its time, on their own or with the robot's shapes."""
    for count, element in ((len(obstacles), "obstacles"), (len(pairs), "self_clearance")):
        if count > MOST_OBSTACLES:
            raise InputError(f"{count} of them, more than {MOST_OBSTACLES}", element=element, advice="leave some out")
    shapes = len(robot.shapes) if obstacles else 0
    if shapes * len(obstacles) > MOST_DISTANCES:
        raise InputError(
            f"{len(obstacles)} of them and {shapes} shapes of links make more than {MOST_DISTANCES} distances",
            element="obstacles",
            advice="leave some out, or simplify the robot's collision geometry",
        )


def check_obstacle(obstacle: Obstacle, element: str, duration: float) -> None:
    """Refuse an obstacle whose numbers cannot be, or that never meets the flight."""
    if not isinstance(obstacle, tuple(OBSTACLE_KINDS.values())):
        known = " or ".join(kind.__name__ for kind in OBSTACLE_KINDS.values())
        raise InputError(f"must be a {known}, not {obstacle!r}", element=element)
    for each in fields(obstacle):
        if each.name != "window":
            key = each.name if each.name in RANGES else "place"
            check_number(getattr(obstacle, each.name), f"{element}.{each.name}", key)
    for name, reason in obstacle.faults():
        raise InputError(reason, element=f"{element}.{name}")
    if obstacle.window is not None:
        check_number(obstacle.window, f"{element}.window", "window")
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
    check_number(pair.margin, f"{element}.margin", "margin")


def check_joint_names(robot: Robot, values: Mapping[str, object], element: str) -> None:
    """Refuse names that are not those of planned joints."""
    for joint in values:
        if joint not in robot.joints:
            raise InputError(
                f"{joint!r} is not a planned joint of the robot", element=element, advice=f"joints: {listed(robot)}"
            )


def _check_frame(robot: Robot, name: str, element: str) -> None:
    if name not in robot.frames:
        raise InputError(
            f"the robot has no frame {name!r}", element=element, advice=f"frames: {', '.join(sorted(robot.frames))}"
        )


def listed(robot: Robot) -> str:
    """Return the planned joints, for a message."""
    return ", ".join(robot.joints)
