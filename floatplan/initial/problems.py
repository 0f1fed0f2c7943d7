"""The problem of a flight that can begin and end, and the limits of first flights."""

from __future__ import annotations

import numpy as np

from floatplan.initial.candidates import Candidate, Flights
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.stance import FAST
from floatplan.problem.parts import Flight, Landing, Limits, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem

MOTION = Motion(degree="auto", objective="acceleration")


def problem_of(chosen: ChosenRobot, flights: Flights, candidate: Candidate) -> Problem:
    """Return the problem whose motion makes a flight of a candidate."""
    begin, end = candidate.orientations.tolist()
    frame = flights.stance.frame
    return Problem(
        chosen.robot,
        Posture(begin, candidate.positions[0], "takeoff", "free"),
        Posture(end, candidate.positions[1], "landing", "free"),
        Flight(
            candidate.duration,
            angular_momentum=candidate.angular_momentum,
            takeoff=Takeoff(frame),
            landing=Landing(frame),
            horizontal_velocity=candidate.horizontal_velocity,
        ),
        MOTION,
        limits_of(chosen),
        name=chosen.robot.name,
        ground=True,
    )


def limits_of(chosen: ChosenRobot) -> Limits:
    """Return the URDF's limits; where it gives no velocities, what is fast."""
    robot = chosen.robot
    known = np.isfinite(robot.motor_velocity_limits).any()
    return Limits(
        velocity="urdf" if known else FAST, torque="urdf" if np.isfinite(robot.motor_torque_limits).any() else "none"
    )
