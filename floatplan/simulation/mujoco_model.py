"""The robot for MuJoCo: the URDF's links and joints, on slide, slide, hinge at the base, or on a free joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.tree import UrdfTree
from floatplan.simulation.recorded_motion import ReducedModel

BASE = ("base_horizontal", "base_vertical", "base_orientation")


def planar_model(robot: Robot, reduced: ReducedModel, mass: Array, inertia: Array) -> tuple[Any, IntArray]:
    """Return the ``mujoco.MjModel``, and which of its coordinates (3 + m,) each of the reduced model's is.

    ``mass, inertia`` (njoints,) are factors of the links that each joint of the reduced model carries.

    Raises
    ------
    InputError
        MuJoCo is not installed, or refuses the robot, such as for a link that moves and has no mass.
    """
    model = _compiled(robot, reduced, robot.layout.tree, robot.locked)
    joints = [model.joint(name).id for name in (*BASE, *_names(robot, reduced))]
    coordinates = np.asarray(model.jnt_qposadr[joints], dtype=np.int64)
    scale_bodies(model, coordinates[BASE_COORDINATES - 1 :], mass, inertia)
    return model, coordinates


@dataclass(frozen=True, eq=False)
class SpatialModel:
    """A robot of m moving joints on a free joint.

    Attributes
    ----------
    model : mujoco.MjModel
    base_position, base_velocity : int
        First entry of the free joint in ``qpos`` and ``qvel``.
    positions, velocities : (m,) int
        Entry of each joint of a reduced model in ``qpos`` and ``qvel``.
    """

    model: Any
    base_position: int
    base_velocity: int
    positions: IntArray
    velocities: IntArray


def spatial_model(robot: Robot, reduced: ReducedModel, mass: Array, inertia: Array) -> SpatialModel:
    """Return the robot on a free joint, its axes as the file has them; what the reduced model has not made rigid moves.

    Factors and errors as of :func:`planar_model`.
    """
    rigid = {name: position for name, position in robot.locked.items() if name not in set(reduced.model.names)}
    model = _compiled(robot, reduced, robot.file_tree, rigid, in_plane=False)
    joints = [model.joint(name).id for name in ("free", *_names(robot, reduced))]
    positions, velocities = (np.asarray(each[joints], dtype=np.int64) for each in (model.jnt_qposadr, model.jnt_dofadr))
    scale_bodies(model, positions, mass, inertia)
    return SpatialModel(model, int(positions[0]), int(velocities[0]), positions[1:], velocities[1:])


def _names(robot: Robot, reduced: ReducedModel) -> list[str]:
    """Names that the joints of a reduced model have in MuJoCo."""
    return [f"joint{robot.model.getJointId(name)}" for name in reduced.joints]


def _compiled(
    robot: Robot, reduced: ReducedModel, tree: UrdfTree, rigid: Mapping[str, float], in_plane: bool = True
) -> Any:
    """The model of a tree whose base moves in the plane alone, or is free; rigid joints stay where they are."""
    mujoco, spec = import_mujoco(), inertial_spec(robot, tree, rigid, in_plane)
    # nothing but inertia, gravity and joint torques, which damping and friction are taken off
    spec.option.gravity = reduced.model.gravity.linear
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for name, armature in robot.armature.items():
        spec.joint(f"joint{robot.model.getJointId(name)}").armature = armature
    return compiled(robot, spec)


def compiled(robot: Robot, spec: Any) -> Any:
    """The ``mujoco.MjModel`` of an ``MjSpec`` of a robot; InputError where MuJoCo refuses it."""
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(f"MuJoCo refuses the robot: {error}", source=robot.source, element="engine") from None


def scale_bodies(model: Any, entries: IntArray, mass: Array, inertia: Array) -> None:
    """Scale each body by the factors of the joint that carries it; ``entries`` (1 + m,) of base and joints in qpos."""
    mujoco = import_mujoco()
    joint_of = dict(zip(entries.tolist(), count(BASE_COORDINATES)))
    for body in range(1, model.nbody):
        last = int(model.body_jntadr[body] + model.body_jntnum[body] - 1)
        joint = joint_of[int(model.jnt_qposadr[last])]
        model.body_mass[body] *= mass[joint]
        model.body_inertia[body] *= inertia[joint]
    mujoco.mj_setConst(model, mujoco.MjData(model))


def rigid_joints(robot: Robot) -> set[str]:
    """Locked joints that must be rigid in MuJoCo, which refuses bodies that move and have no inertia."""
    tree = robot.file_tree
    rigid: set[str] = set()
    while True:
        body: dict[str, str] = {tree.root: tree.root}  # link -> the link that a joint moves, and this one with it
        heavy: set[str] = set()
        for joint in tree.joints:
            moves = joint.moves and joint.name not in rigid
            body[joint.child] = joint.child if moves else body[joint.parent]
            if tree.links[joint.child].inertial is not None:
                heavy.add(body[joint.child])
        light = {joint.child for joint in tree.joints if body[joint.child] == joint.child} - heavy
        found = {name for name in robot.locked if {tree.joint[name].child, body[tree.joint[name].parent]} & light}
        if found <= rigid:
            return rigid
        rigid |= found


def inertial_spec(robot: Robot, tree: UrdfTree, rigid: Mapping[str, float], in_plane: bool) -> Any:
    """Return the ``mujoco.MjSpec`` of inertias and joints alone, these called ``joint`` and their number in the model.

    The base moves in the plane alone, or is free; rigid joints stay where they are, and what they carry is one body.
    """
    mujoco = import_mujoco()
    spec, kinds = mujoco.MjSpec(), mujoco.mjtJoint
    base, plane = spec.worldbody.add_body(), robot.plane
    if in_plane:
        for name, axis in zip(BASE, (plane.horizontal, plane.vertical, plane.normal), strict=True):
            base.add_joint(name=name, type=kinds.mjJNT_HINGE if name == BASE[-1] else kinds.mjJNT_SLIDE, axis=axis)
    else:
        base.add_joint(name="free", type=kinds.mjJNT_FREE)
    bodies, carried = [base], {tree.root: (0, pin.SE3.Identity())}  # which body carries a link, and where
    for joint in tree.joints:
        carrier, place = carried[joint.parent]
        place = place * joint.origin.placement * joint.motion(rigid.get(joint.name, 0.0))
        if joint.moves and joint.name not in rigid:
            body = bodies[carrier].add_body(pos=place.translation, quat=_quaternion(place.rotation))
            name, kind = f"joint{robot.model.getJointId(joint.name)}", "HINGE" if joint.turns else "SLIDE"
            body.add_joint(name=name, type=getattr(kinds, f"mjJNT_{kind}"), axis=joint.axis)
            carrier, place = len(bodies), pin.SE3.Identity()
            bodies.append(body)
        carried[joint.child] = carrier, place
    inertias = [pin.Inertia.Zero() for _ in bodies]
    for name, (carrier, place) in carried.items():
        own = tree.links[name].inertial
        if own is not None:
            inertias[carrier] += (place * own.origin.placement).act(pin.Inertia(own.mass, np.zeros(3), own.inertia))
    for body, inertia in zip(bodies, inertias, strict=True):
        moments, axes = np.linalg.eigh(inertia.inertia)
        axes[:, 0] *= np.linalg.det(axes)  # right-handed
        body.mass, body.inertia, body.explicitinertial = inertia.mass, moments, True
        body.ipos, body.iquat = inertia.lever, _quaternion(axes)
    return spec


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion w x y z of a rotation matrix."""
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)
