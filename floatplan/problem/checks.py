"""From what the user gives to what a problem keeps: checked, in joint order, every fault with its place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.problem.ground import ground_height, resting_height
from floatplan.problem.parts import (
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
from floatplan.tables import MOST_OBSTACLES, REST

MOST_DISTANCES = 800  # between shapes of links and obstacles
MOST_JOINTS = 60


def joint_state(robot: Robot, posture: Posture, element: str) -> JointState:
    """Return a posture as arrays in joint order."""
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
    return read_only(np.array(filled, dtype=np.float64))


def degrees_of(robot: Robot, motion: Motion) -> tuple[int, ...]:
    """Return k_i of (12) for each joint."""
    n = len(robot.joints)
    if n > MOST_JOINTS:
        raise InputError(f"{n} planned joints, more than {MOST_JOINTS}", element="robot.joints", advice="lock some")
    if isinstance(motion.degree, str):
        return (7,) * n
    degrees = (motion.degree,) * n if isinstance(motion.degree, int) else tuple(motion.degree)
    if len(degrees) != n:
        raise InputError(f"{len(degrees)} degrees for {n} joints", element="motion.degree")
    return degrees


def takeoff_of(robot: Robot, flight: Flight) -> Takeoff:
    """Return the takeoff with its default filled in."""
    takeoff = flight.takeoff or Takeoff(robot.tree.names[0])
    _check_frame(robot, takeoff.frame, "flight.takeoff.frame")
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
    return Landing(landing.frame, 0.0 if landing.height is None else landing.height)


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


def check_window(obstacle: Obstacle, element: str, duration: float) -> None:
    """Refuse an obstacle that never meets the flight."""
    if obstacle.window is not None and (obstacle.window[1] < 0 or obstacle.window[0] > duration):
        start, end = obstacle.window
        raise InputError(
            f"the window [{start}, {end}] s lies outside the flight of {duration} s", element=f"{element}.window"
        )


def check_pair(robot: Robot, pair: SelfClearance, element: str) -> None:
    """Refuse links that the robot does not have."""
    known = {shape.link for shape in robot.shapes}
    for link in pair.links:
        if link not in known:
            raise InputError(
                f"no link {link!r} with a shape", element=f"{element}.links", advice=f"links: {sorted(known)}"
            )


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
