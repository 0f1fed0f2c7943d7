"""What the actuators of a compiled MJCF can, and what their joints feel of them."""

import math
from typing import Any, NamedTuple

import numpy as np

from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.mjcf.tree import MjcfTree


class JointMotor(NamedTuple):
    """A joint's largest torque, N m, infinite without a limit; armature kg m^2, damping N m s/rad, friction N m."""

    effort: float
    armature: float
    damping: float
    friction: float


def joint_motors(tree: MjcfTree) -> tuple[dict[int, JointMotor], list[str]]:
    """Return the motor of each joint that moves the robot's bodies, and warnings about what is not as in the file.

    What several actuators of a joint can adds up. Limits are one number for both directions, the smaller one, and none
    where the joint is driven in one direction only.
    """
    transmissions, model = import_mujoco().mjtTrn, tree.model
    of_joints = model.actuator_trntype <= int(transmissions.mjTRN_JOINTINPARENT)
    said: dict[str, list[str]] = {
        "actuators that act on no joint, left out": [f"number {1 + each}" for each in np.flatnonzero(~of_joints)],
        "joints without an actuator, planned as if they had one without limits": [],
        "torques that differ by direction, taken to be the smaller one, or without limit where that is zero": [],
    }
    idle, uneven = list(said)[1:]
    motors = {}
    for joint in tree.moving:
        actuators = np.flatnonzero(of_joints & (model.actuator_trnid[:, 0] == joint)).tolist()
        low, high = np.sum([_range(model, each) for each in actuators] or [(-math.inf, math.inf)], axis=0).tolist()
        if model.jnt_actfrclimited[joint]:
            low, high = np.clip([low, high], *model.jnt_actfrcrange[joint]).tolist()
        said[idle] += [] if actuators or not of_joints.any() else [tree.joint_names[joint]]
        said[uneven] += [tree.joint_names[joint]] if low != -high else []
        effort, degree = min(-low, high), model.jnt_dofadr[joint]
        felt = [float(getattr(model, f"dof_{key}")[degree]) for key in ("armature", "damping", "frictionloss")]
        for index, key in enumerate(("actuator_armature", "actuator_damping")):  # of newer versions of MuJoCo
            if hasattr(model, key):
                felt[index] += float(model.actuator_gear[actuators, 0] ** 2 @ getattr(model, key)[actuators])
        motors[joint] = JointMotor(effort if effort > 0.0 else math.inf, *felt)
    return motors, [f"{what}: {', '.join(names)}" for what, names in said.items() if names]


def _range(model: Any, number: int) -> tuple[float, float]:
    """Least and largest torque of an actuator on its joint: by its range of forces, and of control where known."""
    mujoco = import_mujoco()
    low, high = (
        model.actuator_forcerange[number].tolist() if model.actuator_forcelimited[number] else (-math.inf, math.inf)
    )
    by_control = (
        model.actuator_ctrllimited[number]
        and model.actuator_gaintype[number] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_dyntype[number] == mujoco.mjtDyn.mjDYN_NONE
    )
    if by_control:
        ends = sorted((model.actuator_gainprm[number, 0] * model.actuator_ctrlrange[number]).tolist())
        low, high = max(low, ends[0]), min(high, ends[1])
    gear = float(model.actuator_gear[number, 0])
    first, last = sorted((gear * low, gear * high)) if gear else (0.0, 0.0)
    return first, last
