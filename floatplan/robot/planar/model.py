"""The Pinocchio model: the URDF's links and joints on a planar free-flyer root, built from what was checked.

The root is three joints of one coordinate each (along the plane's horizontal, along its vertical, about its normal), so
that nq = nv and every angle is one unbounded number. ``JointModelPlanar`` carries (cos, sin), and
``JointModelComposite`` has wrong derivatives of RNEA in Pinocchio 4.1.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from random import Random  # NumPy's takes longer to import than all postures to draw
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.planar.choice import Choice, Plane
from floatplan.robot.urdf.tree import UrdfLink, UrdfTree

BASE_COORDINATES = 3
FREE_FLYER = 6  # velocities of the base in space; its configuration has one number more
AXIS_ROUNDING = 1e-12  # [-] rotations from roll, pitch and yaw carry errors of this order
UNBOUNDED = 1e6  # [rad, m, 1/s, N m] stands in Pinocchio for a limit that is not given
UNLIMITED = (UNBOUNDED, UNBOUNDED, -UNBOUNDED, UNBOUNDED)  # of effort, of velocity, lower, upper
POSTURES = 4  # [-] a singular mass matrix is singular at almost all of them, or at the first, the reference
WHOLE = 1e-9  # [-] of the robot's mass that may be missing from all of it
LEAST_EIGENVALUE = 1e-10  # [-] of the mass matrix scaled to a unit diagonal; below it, accelerations lose all digits


def with_axes_in_plane(tree: UrdfTree, choice: Choice) -> UrdfTree:
    """Return the robot that is planned: the axes of planned and coupled joints exactly along or against the normal.

    An axis slightly off is turned onto it, and nothing else: the joints' origins are those of the file. A robot with
    tilted axes has no motion in the plane to restrict it to; this one moves in the plane exactly, and its momentum
    differs from the file's by the order of the tilt.
    """
    positions = choice.positions_at_zero
    rotations = {tree.root: np.eye(3)}
    joints = []
    for joint in tree.joints:
        rotation = rotations[joint.parent] @ joint.origin.placement.rotation
        turned = joint
        if joint.name in choice.ratios:
            exact = choice.signs[joint.name] * rotation.T @ choice.in_plane.normal
            if abs(exact - joint.axis).max() >= AXIS_ROUNDING:
                turned = replace(joint, axis=exact / math.hypot(*exact))
        joints.append(turned)
        rotations[joint.child] = rotation @ turned.motion(positions.get(joint.name, 0.0)).rotation
    return replace(tree, joints=tuple(joints))


def largest_turn(written: UrdfTree, turned: UrdfTree) -> float:
    """Largest angle between the axes of a joint in the one and in the other, rad."""
    pairs = [(joint.axis, turned.joint[joint.name].axis) for joint in written.joints]
    return max(math.atan2(np.linalg.norm(np.cross(one, other)), one @ other) for one, other in pairs)


def build_model(tree: UrdfTree, choice: Choice) -> Any:
    """Return the ``pinocchio.Model`` of the robot, free to fly in the plane, or in space, without gravity.

    It has the frames of the file's links and joints.
    """
    model = pin.Model()
    joint = 0
    model.name = tree.name
    model.gravity = pin.Motion.Zero()
    for name, kind in _base_joints(choice.plane):
        while name in tree.links or name in tree.joint:
            name += "_"
        limits = np.repeat(np.array(UNLIMITED)[:, None], kind.nq, axis=1)
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), name, *limits[:2, : kind.nv], *limits[2:])
        model.addJointFrame(joint)
    links = {tree.root: _add_link(model, tree.links[tree.root], joint, model.nframes - 1, pin.SE3.Identity())}
    for each in tree.joints:
        parent = model.frames[links[each.parent]]
        joint = parent.parentJoint
        placement = parent.placement * each.origin.placement
        if each.moves:
            limits = np.clip([[each.effort], [each.velocity], [each.lower], [each.upper]], -UNBOUNDED, UNBOUNDED)
            joint = model.addJoint(joint, _joint(each.turns, each.axis), placement, each.name, *limits)
            frame = model.addJointFrame(joint, links[each.parent])
            placement = pin.SE3.Identity()
            model.armature[model.idx_vs[joint]] = each.armature or 0.0  # on the mass matrix: in RNEA, ABA and CRBA
        else:
            fixed = pin.Frame(each.name, joint, links[each.parent], placement, pin.FrameType.FIXED_JOINT)
            frame = model.addFrame(fixed)
        links[each.child] = _add_link(model, tree.links[each.child], joint, frame, placement)
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
    letter = next((letter for letter, unit in zip("XYZ", np.eye(3), strict=True) if (axis == unit).all()), None)
    if letter is not None:
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
    joints = list(model.joints)[1:]
    positions = choice.positions_at_zero
    names = list(model.names)[1:]
    at_identity = pin.neutral(model)
    for name, joint in zip(names, joints, strict=True):
        if name in positions:
            at_identity[joint.idx_q] = positions[name]
    rows = [name for name, joint in zip(names, joints, strict=True) for _ in range(joint.nv)]
    selection, transmission = (
        read_only([ratios.get(name, np.zeros(count)) for name in rows])
        for ratios, count in ((choice.ratios, len(choice.planned)), (choice.motor_ratios, len(choice.motors)))
    )
    return read_only(at_identity), selection, transmission


def planned_limits(tree: UrdfTree, choice: Choice) -> tuple[Array, Array, Array]:
    """Return limits of position (n, 2) rad, velocity (n,) rad/s and torque (n,) N m; infinite where not given.

    Positions and velocities of a leader are those that keep its followers within their limits too. The torque of a
    planned coordinate is that of all its motors together, by ratio; its limit is the sum of ``|ratio| * limit`` over
    them. Followers that are geared to their leader by the file have no motor, and add nothing.

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
    limits : (n, 2) rad, infinite where not given

    Raises
    ------
    InputError
        If the robot has no mass, or a planned joint moves none.
    """
    base = FREE_FLYER if model.nq > model.nv else BASE_COORDINATES
    moving = np.concatenate([np.eye(model.nv, base), selection], axis=1)
    data = model.createData()
    for positions in sample_postures(limits, POSTURES, Random(0)):
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
            if values[0] > LEAST_EIGENVALUE:
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
    return bool(data.mass[model.getJointId(joint)] >= data.mass[0] * (1.0 - WHOLE))


def sample_postures(limits: Array, count: int, generator: Random) -> Array:
    """Return postures (count, n) within ``limits`` (n, 2); joints without limits turn within [-pi, pi].

    The first is the one nearest to zero.
    """
    lower = np.clip(limits[:, 0], -np.pi, None)
    upper = np.clip(limits[:, 1], None, np.pi)
    beyond = lower > upper  # limits that leave [-pi, pi] out altogether
    lower[beyond] = limits[beyond, 0]
    upper[beyond] = limits[beyond, 1]
    fractions = [[generator.random() for _ in limits] for _ in range(count)]
    postures: Array = lower + (upper - lower) * np.array(fractions).reshape(count, len(limits))
    postures[0] = np.clip(0.0, lower, upper)
    return postures
