"""Whether what stands on the ground in space can leave it, and meet it."""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.motion.spatial.kinematics import poses_about
from floatplan.motion.spatial.rotations import exponential
from floatplan.problem.attitude import required
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.tables import CLEARANCE, ROUNDED_FRAME_SPEED

SOON = 1e-7  # [s] in which heights are followed: they are rounded to 1e-9 m/s of it, and curve by no more than 1e-5


def motion_into_ground(problem: Problem, angular_momentum: Array) -> list[InputError]:
    """Return what moves into the ground at takeoff or landing, with this angular momentum (3,), kg m^2/s.

    Of rates that were rounded to six digits nothing is said: where they lead into the ground, the search finds it.
    """
    errors = []
    for name, state, instant, sign, direction in (
        ("start", problem.initial, 0.0, 1.0, "down into the ground at takeoff"),
        ("goal", problem.final, problem.flight.duration, -1.0, "up out of the ground at landing"),
    ):
        link, velocity = _slowest_contact(problem, state, instant, sign, angular_momentum)
        if velocity < -ROUNDED_FRAME_SPEED:
            reason = f"{link} moves {direction}, at {-velocity:.4g} m/s"
            advice = "give other rates there, another angular momentum, posture or duration"
            errors.append(InputError(reason, element=f"{name}.velocities", advice=advice))
    return errors


def _slowest_contact(
    problem: Problem, state: JointState, instant: float, sign: float, angular_momentum: Array
) -> tuple[str, float]:
    """Of the links on the ground the one whose lowest point is slowest upwards, or downwards for sign -1; m/s."""
    robot = problem.robot
    dynamics = spatial_dynamics(robot)
    attitude = required(state.attitude).matrix
    inertia, joint_map = dynamics.momentum_maps(state.positions[None])
    rates: Array = np.linalg.solve(inertia[0], attitude.T @ angular_momentum - joint_map[0] @ state.velocities)
    ahead: Array = np.array([0.0, sign * SOON])
    positions = state.positions + ahead[:, None] * state.velocities
    attitudes = attitude @ exponential(ahead[:, None] * rates)
    poses = poses_about(robot, attitudes, positions, problem.path.positions(instant + ahead))
    slowest = ("", np.inf)
    for solid in robot.solids:
        heights = poses.lowest(solid) - problem.ground_plane.point[-1]
        if abs(heights[0]) < CLEARANCE:
            slowest = min(slowest, (solid.link, float(heights[1] - heights[0]) / SOON), key=lambda contact: contact[1])
    return slowest
