"""The motion of every joint that a URDF has, planned, coupled and locked, and of the base in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.motion.flight_state import FlightState
from floatplan.motion_plan import Plan
from floatplan.robot.robot import Robot

BASE = 3  # coordinates of the planar free-flyer


@dataclass(frozen=True, eq=False)
class FullMotion:
    """All J joints that can move, and the base, at N instants.

    Attributes
    ----------
    times : (N,) s
    joints : (J) names, in the order of Pinocchio
    positions, velocities, accelerations, torques : (N, J) rad, rad/s, rad/s^2, N m
        Each joint's own, also where several are coupled; a locked joint's torque is what holds it. Joints that slide
        are in m, m/s, m/s^2, N.
    base_position, base_velocity : (N, 3) m, m/s
        Of the root link's origin, in the world.
    base_quaternion : (N, 4)
        x, y, z, w; without jumps of sign.
    base_angular_velocity : (N, 3) rad/s
        In the root link's axes, which is the same in the world's: it is along the plane's normal.
    """

    times: Array
    joints: tuple[str, ...]
    positions: Array
    velocities: Array
    accelerations: Array
    torques: Array
    base_position: Array
    base_velocity: Array
    base_quaternion: Array
    base_angular_velocity: Array


def full_motion(plan: Plan, times: Array) -> FullMotion:
    """Return the motion of all joints at times (N,), s.

    The world's axes are the root link's at orientation 0, its origin is where the takeoff frame leaves the ground.
    """
    robot, state = plan.robot, plan.at(times)
    axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
    half = state.orientation[:, None] / 2
    selection = robot.selection[BASE:]
    return FullMotion(
        times=times,
        joints=tuple(robot.model.names)[BASE + 1 :],
        positions=robot.reference[BASE:] + state.positions @ selection.T,
        velocities=state.velocities @ selection.T,
        accelerations=state.accelerations @ selection.T,
        torques=_torques(robot, state),
        base_position=state.base_position @ axes,
        base_velocity=_base_velocity(robot, state) @ axes,
        base_quaternion=np.concatenate((np.sin(half) * robot.plane.normal, np.cos(half)), axis=1),
        base_angular_velocity=state.orientation_rate[:, None] * robot.plane.normal,
    )


def _base_velocity(robot: Robot, state: FlightState) -> Array:
    """Velocity (N, 2) of the base link's origin, horizontal and vertical."""
    tree = robot.tree
    rotations = tree.rotations(tree.absolute_angles(state.orientation, state.positions))
    rates = state.orientation_rate[:, None] + state.velocities @ tree.turns.T
    swing = (1j * tree.turn * rates * rotations) @ tree.point_weights(np.array([0]), np.array([0j]))[0]
    return np.asarray(state.com_velocity + np.stack((swing.real, swing.imag), axis=1))


def _torques(robot: Robot, state: FlightState) -> Array:
    """Torques (N, J) by RNEA, the base accelerating so that no wrench acts on it; gravity cancels."""
    model, data = robot.model, robot.model.createData()
    torques = np.empty((len(state.times), model.nv - BASE))
    for index in range(len(state.times)):
        q = robot.reference + robot.selection @ state.positions[index]
        v, a = (robot.selection @ values[index] for values in (state.velocities, state.accelerations))
        v[BASE - 1] = state.orientation_rate[index]
        forces = np.array(pin.rnea(model, data, q, v, a))
        rows = np.triu(pin.crba(model, data, q))[:BASE]
        base = rows[:, :BASE] + np.triu(rows[:, :BASE], 1).T
        torques[index] = forces[BASE:] - rows[:, BASE:].T @ np.linalg.solve(base, forces[:BASE])
    return torques
