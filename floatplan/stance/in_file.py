"""States of a jump in the coordinates of ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``.

Axes, origin and orders are those of a plan: :mod:`floatplan.motion.planar.free_flyer`.
"""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.motion.planar.free_flyer import FREE_FLYER, free_flyer
from floatplan.robot import Robot
from floatplan.stance.motion import BASE, JumpState


def configurations(robot: Robot, state: JumpState) -> Array:
    """Configurations (N, nq): place of the root link, quaternion x y z w, all joints; m and rad."""
    order, joints = free_flyer(robot), state.positions[:, BASE:]
    half = state.positions[:, 2, None] / 2
    q = np.empty((len(state.times), order.nq))
    q[:, :3] = _in_space(robot, _planar(state.positions))
    q[:, 3:7] = np.concatenate((np.sin(half) * robot.plane.normal, np.cos(half)), axis=1)
    q[:, order.in_q] = joints
    angles, first = joints[:, order.continuous], order.in_q[order.continuous]
    q[:, first], q[:, first + 1] = np.cos(angles), np.sin(angles)
    return q


def velocities(robot: Robot, state: JumpState) -> Array:
    """Velocities (N, nv): of the base in its own axes, linear and angular, then of all joints; m/s and rad/s."""
    linear = _planar(state.velocities) * _back(robot, state)
    return _spread(robot, linear, state.velocities)


def accelerations(robot: Robot, state: JumpState) -> Array:
    """Accelerations (N, nv): derivative of the velocities, m/s^2 and rad/s^2."""
    carried = 1j * robot.tree.turn * state.velocities[:, 2] * _planar(state.velocities)
    return _spread(robot, (_planar(state.accelerations) - carried) * _back(robot, state), state.accelerations)


def torques(robot: Robot, state: JumpState) -> Array:
    """Torques (N, nv), N m: nothing on the base, and each joint's own."""
    order = free_flyer(robot)
    values = np.zeros((len(state.times), order.nv))
    values[:, order.in_v] = state.torques[:, BASE:]
    return values


def forces(robot: Robot, state: JumpState) -> dict[str, Array]:
    """Forces (N, 3) N of all points, along the world's axes."""
    return {name: _in_space(robot, values[:, 0] + 1j * values[:, 1]) for name, values in state.forces.items()}


def _planar(values: Array) -> ComplexArray:
    return np.asarray(values[:, 0] + 1j * values[:, 1])


def _back(robot: Robot, state: JumpState) -> ComplexArray:
    """Rotations (N,) of vectors of the plane into the base's axes."""
    return robot.tree.rotations(-state.positions[:, 2])


def _in_space(robot: Robot, vectors: ComplexArray) -> Array:
    return np.asarray(vectors.real[:, None] * robot.plane.horizontal + vectors.imag[:, None] * robot.plane.vertical)


def _spread(robot: Robot, linear: ComplexArray, rates: Array) -> Array:
    order = free_flyer(robot)
    values = np.empty((len(rates), order.nv))
    values[:, :3] = _in_space(robot, linear)
    values[:, 3:FREE_FLYER] = rates[:, 2, None] * robot.plane.normal
    values[:, order.in_v] = rates[:, BASE:]
    return values
