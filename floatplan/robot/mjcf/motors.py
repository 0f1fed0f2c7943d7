"""The torques of the actuators of a compiled MJCF, and the inertia and losses that their joints feel of them."""

import math
from collections.abc import Sequence

import numpy as np

from floatplan.arrays import Array
from floatplan.robot.mjcf.compiled import CompiledMjcf
from floatplan.robot.mjcf.tree import MjcfTree

UNLIMITED = np.array([-math.inf, math.inf])


def joint_motors(tree: MjcfTree) -> tuple[dict[int, dict[str, float]], list[str]]:
    """Return the motor of each joint that moves the robot's bodies, and warnings about differences from the file.

    A motor has ``effort``, N m, zero without a limit, ``armature`` kg m^2, ``damping`` N m s/rad and ``friction`` N m.
    Torques of several actuators of a joint add up. Limits are one number for both directions, the smaller one, and none
    where the joint is driven in one direction only.
    """
    model = tree.model
    motors = {}
    of_joints = model.actuator_trntype <= model.constants["mjTRN_JOINTINPARENT"]
    others = [f"number {1 + number}" for number in np.flatnonzero(~of_joints)]
    of_base = np.isin(model.actuator_trnid[:, 0], tree.joints[tree.bodies[0]]) & of_joints
    pushing = [model.names["actuator"][number] or f"number {1 + number}" for number in np.flatnonzero(of_base)]
    idle = []
    uneven = []
    for joint in tree.moving:
        actuators = actuators_of(model, joint)
        torques = np.sum([actuator_torques(model, number) for number in actuators] or [UNLIMITED], axis=0)
        if model.jnt_actfrclimited[joint]:
            torques = np.clip(torques, *model.jnt_actfrcrange[joint])
        low, high = torques.tolist()
        effort = min(-low, high)
        if not actuators and of_joints.any():
            idle.append(tree.joint_names[joint])
        if not effort > 0.0 or low != -high:
            uneven.append(tree.joint_names[joint])
        limit = effort if 0.0 < effort < math.inf else 0.0
        motors[joint] = {"effort": limit, **joint_losses(model, joint, actuators)}
    warnings = {
        "actuators that act on no joint, left out": others,
        "actuators that push the base, which flies freely, left out": pushing,
        "joints without an actuator, planned as if they had one without limits": idle,
        "torques that differ by direction, taken to be the smaller one, or without limit where that is zero": uneven,
    }
    return motors, [f"{reason}: {', '.join(names)}" for reason, names in warnings.items() if names]


def actuators_of(model: CompiledMjcf, joint: int) -> list[int]:
    """Return the numbers of the actuators that act on a joint."""
    of_joints = model.actuator_trntype <= model.constants["mjTRN_JOINTINPARENT"]
    numbers: list[int] = np.flatnonzero(of_joints & (model.actuator_trnid[:, 0] == joint)).tolist()
    return numbers


def joint_losses(model: CompiledMjcf, joint: int, actuators: Sequence[int]) -> dict[str, float]:
    """Return ``armature``, kg m^2, ``damping``, N m s/rad, and ``friction``, N m, of a joint with its actuators."""
    degree = model.jnt_dofadr[joint]
    losses = {
        "armature": float(model.dof_armature[degree]),
        "damping": float(model.dof_damping[degree]),
        "friction": float(model.dof_frictionloss[degree]),
    }
    for key in ("armature", "damping"):
        of_actuators = getattr(model, f"actuator_{key}", None)  # of newer versions of MuJoCo
        if of_actuators is not None:
            losses[key] += float(model.actuator_gear[actuators, 0] ** 2 @ of_actuators[actuators])
    return losses


def actuator_torques(model: CompiledMjcf, number: int) -> Array:
    """Least and largest torque of an actuator on its joint: by its range of force, and of control if that is torque."""
    constants = model.constants
    gear = model.actuator_gear[number, 0]
    forces = model.actuator_forcerange[number] if model.actuator_forcelimited[number] else UNLIMITED
    by_control = (
        model.actuator_gaintype[number] == constants["mjGAIN_FIXED"]
        and model.actuator_biastype[number] == constants["mjBIAS_NONE"]
        and model.actuator_dyntype[number] == constants["mjDYN_NONE"]
    )
    if by_control and model.actuator_ctrllimited[number]:
        forces = np.clip(np.sort(model.actuator_gainprm[number, 0] * model.actuator_ctrlrange[number]), *forces)
    return np.sort(gear * forces) if gear else np.zeros(2)
