"""The Pinocchio model: the URDF's links and joints on a planar free-flyer root, built from what was checked.

The root is three joints of one coordinate each (along the plane's horizontal, along its vertical, about its normal), so
that nq = nv and every angle is one unbounded number. ``JointModelPlanar`` carries (cos, sin), and
``JointModelComposite`` has wrong derivatives of RNEA in Pinocchio 4.1.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from random import Random  # NumPy's takes longer to import than all postures take
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.planar.choice import Choice, Plane
from floatplan.robot.urdf.base import FREE_FLYER
from floatplan.robot.urdf.tree import UrdfLink, UrdfTree

BASE_COORDINATES = 3  # [-] along the horizontal, along the vertical, about the normal
UNBOUNDED = 1e6  # [rad, m, 1/s, N m] for Pinocchio where there is no limit


def with_axes_in_plane(tree: UrdfTree, choice: Choice) -> UrdfTree:
    """Return the robot that is planned: the axes of planned and coupled joints exactly along or against the normal.

    An axis slightly off is replaced by it, and nothing else: the joints' origins are those of the file. A robot with
    tilted axes has no motion in the plane to restrict it to; this one moves in the plane exactly, and its momentum
    differs from the file's by the order of the tilt.
    """
    positions = choice.positions_at_zero
    rotations = {tree.root: np.eye(3)}
    joints = []
    for joint in tree.joints:
        rotation = rotations[joint.parent] @ joint.origin.placement.rotation
        exact_joint = joint
        if joint.name in choice.ratios:
            exact = choice.signs[joint.name] * rotation.T @ choice.required_plane.normal
            # rotations from roll, pitch and yaw carry errors of the order of 1e-12
            if abs(exact - joint.axis).max() >= 1e-12:
                exact_joint = replace(joint, axis=exact / math.hypot(*exact))
        joints.append(exact_joint)
        rotations[joint.child] = rotation @ exact_joint.motion(positions.get(joint.name, 0.0)).rotation
    return replace(tree, joints=tuple(joints))


def largest_tilt(written: UrdfTree, exact: UrdfTree) -> float:
    """Largest angle between the axes of a joint in the one and in the other, rad."""
    angles = []
    for joint in written.joints:
        axis = exact.joint[joint.name].axis
        angles.append(math.atan2(np.linalg.norm(np.cross(joint.axis, axis)), joint.axis @ axis))
    return max(angles)


def build_model(tree: UrdfTree, choice: Choice) -> Any:
    """Return the ``pinocchio.Model`` of the robot, free to fly in the plane, or in space, without gravity.

    It has the frames of the file's links and joints.
    """
    model = pin.Model()
    parent_joint = 0
    unlimited = np.array([UNBOUNDED, UNBOUNDED, -UNBOUNDED, UNBOUNDED])  # effort, velocity, lower, upper
    model.name = tree.name
    model.gravity = pin.Motion.Zero()
    for name, kind in _base_joints(choice.plane):
        while name in tree.links or name in tree.joint:
            name += "_"
        limits = np.repeat(unlimited[:, None], kind.nq, axis=1)
        parent_joint = model.addJoint(parent_joint, kind, pin.SE3.Identity(), name, *limits[:2, : kind.nv], *limits[2:])
        model.addJointFrame(parent_joint)
    root = _add_link(model, tree.links[tree.root], parent_joint, model.nframes - 1, pin.SE3.Identity())
    links = {tree.root: root}
    for joint in tree.joints:
        parent = model.frames[links[joint.parent]]
        carrier = parent.parentJoint
        placement = parent.placement * joint.origin.placement
        if joint.moves:
            limits = np.clip([[joint.effort], [joint.velocity], [joint.lower], [joint.upper]], -UNBOUNDED, UNBOUNDED)
            carrier = model.addJoint(carrier, _joint(joint.turns, joint.axis), placement, joint.name, *limits)
            frame = model.addJointFrame(carrier, links[joint.parent])
            placement = pin.SE3.Identity()
            model.armature[model.idx_vs[carrier]] = joint.armature or 0.0  # on the mass matrix: in RNEA, ABA and CRBA
        else:
            fixed = pin.Frame(joint.name, carrier, links[joint.parent], placement, pin.FrameType.FIXED_JOINT)
            frame = model.addFrame(fixed)
        links[joint.child] = _add_link(model, tree.links[joint.child], carrier, frame, placement)
    return model


def _base_joints(plane: Plane | None) -> list[tuple[str, Any]]:
    """Names and kinds of the joints by which the base moves in a plane, or in space."""
    if plane is None:
        return [("base", pin.JointModelFreeFlyer())]
    return [
        ("base_horizontal", _joint(False, plane.horizontal)),
        ("base_vertical", _joint(False, plane.vertical)),
        ("base_orientation", _joint(True, plane.normal)),
    ]


def _joint(turns: bool, axis: Array) -> Any:
    """Pinocchio's joint about or along an axis (3,): those along a letter are quicker."""
    for letter, unit in zip("XYZ", np.eye(3), strict=True):
        if (axis == unit).all():
            return getattr(pin, f"JointModel{'R' if turns else 'P'}{letter}")()
    return (pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned)(np.array(axis))


def _add_link(model: Any, link: UrdfLink, joint: int, above: int, placement: Any) -> int:
    """Add a link with its inertia below a frame, placed in a joint's; return its own frame."""
    inertia = pin.Inertia.Zero()
    if link.inertial is not None:
        origin = link.inertial.origin.placement
        inertia.mass = link.inertial.mass
        inertia.lever = origin.translation
        inertia.inertia = link.inertial.in_link
    return int(model.addFrame(pin.Frame(link.name, joint, above, placement, pin.FrameType.BODY, inertia)))


def coordinates(model: Any, choice: Choice) -> tuple[Array, Array, Array]:
    """Return ``reference`` (nq,), ``selection`` (nv, n) and ``transmission`` (nv, motors).

    The full configuration is ``reference + selection @ positions``, of the joints behind the base in space. Each
    motor's torque is ``transmission.T`` times the torques of all joints: its own joint's, and those that the file gears
    to it, by their ratios.
    """
    positions = choice.positions_at_zero
    at_identity = pin.neutral(model)
    names = []  # of the joint of each velocity
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        names += [name] * joint.nv
        if name in positions:
            at_identity[joint.idx_q] = positions[name]
    selection = _rows(choice.ratios, names, len(choice.planned))
    transmission = _rows(choice.motor_ratios, names, len(choice.motors))
    return read_only(at_identity), selection, transmission


def _rows(ratios: Mapping[str, Array], names: Sequence[str], count: int) -> Array:
    """Rows (names, count) of ratios, zero for joints that have none."""
    return read_only([ratios.get(name, np.zeros(count)) for name in names])


def planned_limits(tree: UrdfTree, choice: Choice) -> tuple[Array, Array, Array]:
    """Return limits of position (n, 2) rad, velocity (n,) rad/s and torque (n,) N m; infinite where there is none.

    Positions and velocities of a leader are those at which its followers are within their limits too. The torque of a
    planned coordinate is the sum of all its motors', by ratio; its limit is the sum of ``|ratio| * limit`` over them.
    Followers that are geared to their leader by the file have no motor, and add nothing.

    Raises
    ------
    InputError
        If a leader and its followers have no common range.
    """
    planned = [tree.joint[name] for name in choice.planned]
    position = np.array([[joint.lower, joint.upper] for joint in planned])
    velocity = np.array([joint.velocity for joint in planned])
    torque = np.array([joint.effort for joint in planned])
    for name, coupling in choice.coupled.items():
        row = choice.planned.index(coupling.leader)
        joint = tree.joint[name]
        ends = sorted((limit - coupling.offset) / coupling.ratio for limit in (joint.lower, joint.upper))
        position[row] = max(position[row, 0], ends[0]), min(position[row, 1], ends[1])
        velocity[row] = min(velocity[row], joint.velocity / abs(coupling.ratio))
        torque[row] += 0.0 if name in choice.geared else joint.effort * abs(coupling.ratio)
        if not position[row, 0] < position[row, 1]:
            reason = f'its limits leave its leader "{coupling.leader}" no range to move in'
            raise InputError(reason, element=f'coupled "{name}"', advice="check the ratio's sign and the offset")
    return read_only(position), read_only(velocity), read_only(torque)


def check_model(model: Any, reference: Array, selection: Array, joints: Sequence[str], limits: Array) -> None:
    """Check that the mass matrix of base and planned joints is positive definite.

    Parameters
    ----------
    model : pinocchio.Model
    reference, selection : (nv,), (nv, n)
    joints : (n) names
    limits : (n, 2) rad, infinite where there is none

    Raises
    ------
    InputError
        If the robot has no mass, or a planned joint moves none.
    """
    base = FREE_FLYER if model.nq > model.nv else BASE_COORDINATES
    moving = np.concatenate([np.eye(model.nv, base), selection], axis=1)
    data = model.createData()
    # a singular mass matrix is singular at almost all postures, or at the first, the reference
    for positions in sample_postures(limits, 4, Random(0)):
        q = np.array(reference)
        q[len(q) - model.nv + base :] += selection[base:] @ positions
        upper = np.triu(pin.crba(model, data, q))
        mass_matrix = moving.T @ (upper + np.triu(upper, 1).T) @ moving
        if not np.isfinite(mass_matrix).all():
            raise InputError("its mass matrix is not finite", advice="check that masses are in kg and lengths in m")
        diagonal = mass_matrix.diagonal()
        if not diagonal[0] > 0.0:
            raise InputError("has no mass", advice="give its links an <inertial> element")
        culprit = int(np.argmin(diagonal[base:]))
        if diagonal.min() > 0.0:
            scale = 1.0 / np.sqrt(diagonal)
            values, vectors = np.linalg.eigh(scale[:, None] * mass_matrix * scale)
            if values[0] > 1e-10:  # of a matrix with unit diagonal: below it, accelerations lose all digits
                continue
            culprit = int(np.argmax(abs(vectors[base:, 0])))
        reason = "moves no inertia of its own: the mass matrix is singular"
        advice = "give the links beyond it mass"
        if _carries_everything(model, joints[culprit]):
            reason = "moves the whole robot, as what carries it weighs nothing: the mass matrix is singular"
            advice = "give the links before it mass"
        raise InputError(reason, element=f'joint "{joints[culprit]}"', advice=f"{advice}, or lock it")


def _carries_everything(model: Any, joint: str) -> bool:
    """Whether all of the robot's mass is beyond a joint."""
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    return bool(data.mass[model.getJointId(joint)] >= data.mass[0] * (1.0 - 1e-9))


def sample_postures(limits: Array, count: int, generator: Random) -> Array:
    """Return postures (count, n) within ``limits`` (n, 2); joints without limits rotate within [-pi, pi].

    The first is the one nearest to zero.
    """
    lower = np.clip(limits[:, 0], -np.pi, None)
    upper = np.clip(limits[:, 1], None, np.pi)
    beyond = lower > upper  # limits that leave [-pi, pi] out altogether
    lower[beyond] = limits[beyond, 0]
    upper[beyond] = limits[beyond, 1]
    fractions = [generator.random() for _ in range(count * len(limits))]
    postures: Array = lower + (upper - lower) * np.array(fractions).reshape(count, len(limits))
    postures[0] = np.clip(0.0, lower, upper)
    return postures
