"""Stiffness and damping by which joints follow their paths: torques ``kp (q_d - q) + kd (q_d' - q')``, N m."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arguments import by_name, number
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER
from floatplan.tables import Range

GAIN = number(Range(0.0, 1e12, ""))
Gain: TypeAlias = float | Mapping[str, float]  # of all joints, or of some by name
Gains: TypeAlias = tuple[Gain | None, Gain | None]  # stiffness, damping

FASTEST = 1e4  # [rad/s] bandwidth of feedback
BANDWIDTH = 100.0  # [rad/s] of a controller's feedback, unless another is requested


def critical_gains(bandwidth: float, inertia: Array) -> Array:
    """Return stiffness and damping (2, m), critical, for a bandwidth, rad/s, and joints' inertia (m,), kg m^2."""
    return read_only([bandwidth**2 * inertia, 2.0 * bandwidth * inertia])


def joint_inertia(model: Any, posture: Array) -> Array:
    """Return the inertia (m,), kg m^2, that each joint of a ``pinocchio.Model`` accelerates at a posture.

    It is ``1 / (M^-1)_jj``: the torque of the joint over its acceleration while the robot floats.
    """
    inverse = pin.computeMinverse(model, model.createData(), np.asarray(posture))
    base = BASE_COORDINATES if model.nq == model.nv else FREE_FLYER
    return np.asarray(1.0 / np.diagonal(inverse)[base:])


def requested_gains(joints: Sequence[str], requested: Gain | None, element: str, default: Array) -> Array:
    """Return gains (J,) as requested, else as they are by default; InputError where one is wrong."""
    if requested is None:
        return default
    if not isinstance(requested, Mapping):
        return np.full(len(joints), GAIN(requested, element))
    gains = default.copy()
    for joint, gain in by_name(GAIN)(requested, element).items():
        if joint not in joints:
            raise InputError(f"the robot has no such joint that moves: {joint}", element=element)
        gains[joints.index(joint)] = gain
    return gains


def first_gains(jump: JumpMotion, requested: Gains = (None, None)) -> Array:
    """Stiffness, N m/rad, and damping, N m s/rad, (2, J) of all joints of a jump that move: :func:`usual_gains`."""
    spans = [np.linspace(flight.begin, flight.end, 33) for flight in jump.timed_flights]
    in_flight = jump.at(np.concatenate(spans)).positions
    standing = jump.at(0.0).positions[0]
    weight = jump.problem.robot.mass * jump.problem.flight.gravity
    return usual_gains(jump.problem.robot, weight, jump.before[0].ground, standing, in_flight, requested)


def usual_gains(
    robot: Robot, weight: float, ground: float, standing: Array, in_flight: Array, requested: Gains = (None, None)
) -> Array:
    """Stiffness, N m/rad, and damping, N m s/rad, (2, J) of all joints that move, as requested.

    What is left out is the same of all: a stiffness by which the lightest joint in flight has the bandwidth of late
    feedback, but at least the weight times its height where the robot stands, which it falls over without; and a
    damping that is nearly critical. The lightest bounds them all, for damping of more than its inertia over the delay
    rings. InputError where a requested one is wrong.

    Parameters
    ----------
    robot : Robot
    weight : N
    ground : height of the ground, m
    standing : (nq,), posture in which it stands, of ``robot.model``
    in_flight : (K, nq)
    requested : two floats or mappings, optional
    """
    late_bandwidth = 125.0  # [rad/s] of measurements that are 4 ms late, constant for 2 ms: 0.6 over the delay
    damping_time = 0.017  # [s] damping over stiffness: nearly critical
    model = robot.model
    com = pin.centerOfMass(model, model.createData(), standing) @ robot.up
    tipping = weight * float(com - ground)
    lightest = float(np.mean([joint_inertia(model, posture).min() for posture in in_flight]))
    stiffness = float(f"{max(late_bandwidth**2 * lightest, tipping):.2g}")
    joints = robot.model_joints
    kp, kd = requested
    return np.stack(
        [
            requested_gains(joints, kp, "kp", np.full(len(joints), stiffness)),
            requested_gains(joints, kd, "kd", np.full(len(joints), damping_time * stiffness)),
        ]
    )
