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
from floatplan.robot.urdf.tree import Inertial, UrdfJoint, UrdfTree, rigid_body
from floatplan.simulation.recorded_motion import ReducedModel

BASE = ("base_horizontal", "base_vertical", "base_orientation")
LEAST = 1e-14  # [kg m^2] moment of inertia, or [kg] mass, of a body that moves: MuJoCo refuses 1e-15
GYRATION = 1e-3  # [m] least radius of gyration of a body that is free in space, where a point or a line is given
EDGE = 1e-9  # [-] of the largest moment: by how much less than the sum of the others it is at least
ROUNDING = 1e-6  # [-] of the largest moment: what changes by less is not said


def planar_model(robot: Robot, reduced: ReducedModel, mass: Array, inertia: Array) -> tuple[Any, IntArray]:
    """Return the ``mujoco.MjModel``, and which of its coordinates (3 + m,) each of the reduced model's is.

    ``mass, inertia`` (njoints,) are factors of the links that each joint of the reduced model carries.

    Raises
    ------
    InputError
        MuJoCo is not installed, or refuses the robot, such as for a link that moves and has no mass.
    """
    model, _ = _compiled(robot, reduced, robot.layout.tree, robot.locked)
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
    balanced : name of a body's first link -> change of its inertia, as of :func:`inertial_spec`
    """

    model: Any
    base_position: int
    base_velocity: int
    positions: IntArray
    velocities: IntArray
    balanced: dict[str, float]


def spatial_model(robot: Robot, reduced: ReducedModel, mass: Array, inertia: Array) -> SpatialModel:
    """Return the robot on a free joint, its axes as the file has them; what the reduced model has not made rigid moves.

    Factors and errors as of :func:`planar_model`.
    """
    rigid = {name: position for name, position in robot.locked.items() if name not in set(reduced.model.names)}
    model, balanced = _compiled(robot, reduced, robot.file_tree, rigid, in_plane=False)
    joints = [model.joint(name).id for name in ("free", *_names(robot, reduced))]
    positions, velocities = (np.asarray(each[joints], dtype=np.int64) for each in (model.jnt_qposadr, model.jnt_dofadr))
    scale_bodies(model, positions, mass, inertia)
    return SpatialModel(model, int(positions[0]), int(velocities[0]), positions[1:], velocities[1:], balanced)


def _names(robot: Robot, reduced: ReducedModel) -> list[str]:
    """Names that the joints of a reduced model have in MuJoCo."""
    return [f"joint{robot.model.getJointId(name)}" for name in reduced.joints]


def _compiled(
    robot: Robot, reduced: ReducedModel, tree: UrdfTree, rigid: Mapping[str, float], in_plane: bool = True
) -> tuple[Any, dict[str, float]]:
    """The model of a tree as of :func:`inertial_spec`, and which bodies were balanced."""
    mujoco, (spec, balanced) = import_mujoco(), inertial_spec(robot, tree, rigid, in_plane)
    # nothing but inertia, gravity and joint torques, which damping and friction are taken off
    spec.option.gravity = reduced.model.gravity.linear
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for name, armature in robot.armature.items():
        spec.joint(f"joint{robot.model.getJointId(name)}").armature = armature
    return compiled(robot, spec), balanced


def compiled(robot: Robot, spec: Any) -> Any:
    """The ``mujoco.MjModel`` of an ``MjSpec`` of a robot; InputError where MuJoCo refuses it."""
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(f"MuJoCo refuses the robot: {error}", source=robot.source, element="engine") from None


def scale_bodies(model: Any, entries: IntArray, mass: Array, inertia: Array) -> None:
    """Scale each body by the factors of the joint that carries it; ``entries`` (1 + m,) of base and joints in qpos."""
    mujoco = import_mujoco()
    joint_of = dict(zip(entries.tolist(), count(len(mass) - len(entries))))
    for body in range(1, model.nbody):
        last = int(model.body_jntadr[body] + model.body_jntnum[body] - 1)
        joint = joint_of[int(model.jnt_qposadr[last])]
        model.body_mass[body] *= mass[joint]
        model.body_inertia[body] *= inertia[joint]
    mujoco.mj_setConst(model, mujoco.MjData(model))


def rigid_joints(robot: Robot) -> set[str]:
    """Locked joints that must be rigid in MuJoCo, where a body that a joint turns must have inertia about its axis."""
    tree, rigid = robot.file_tree, set[str]()
    while True:
        carried = _carried(tree, {name: robot.locked[name] for name in rigid})
        solid = {body: rigid_body(parts) for body, parts in _parts(tree, carried).items()}
        light = {joint.child for joint in tree.joints if joint.child in solid and _light(joint, *solid[joint.child])}
        found = {name for name in robot.locked if {tree.joint[name].child, carried[tree.joint[name].parent][0]} & light}
        if found <= rigid:
            return rigid
        rigid |= found


def _light(joint: UrdfJoint, mass: float, lever: Array, inertia: Array) -> bool:
    """Whether a joint turns no more than a point on its axis, or slides no mass."""
    arm = np.cross(joint.axis, lever)
    moment = joint.axis @ inertia @ joint.axis + mass * arm @ arm
    return bool(moment <= mass * GYRATION**2 if joint.turns else mass == 0)


def _carried(tree: UrdfTree, rigid: Mapping[str, float]) -> dict[str, tuple[str, Any]]:
    """Of each link the first link of the body that it is part of, and its placement in it; rigid joints stay."""
    found = {tree.root: (tree.root, pin.SE3.Identity())}
    for joint in tree.joints:
        body, place = found[joint.parent]
        if joint.moves and joint.name not in rigid:
            found[joint.child] = joint.child, pin.SE3.Identity()
        else:
            found[joint.child] = body, place * joint.origin.placement * joint.motion(rigid.get(joint.name, 0.0))
    return found


def _parts(tree: UrdfTree, carried: Mapping[str, tuple[str, Any]]) -> dict[str, list[tuple[Inertial, Any]]]:
    """What has inertia of each body, by first link."""
    parts: dict[str, list[tuple[Inertial, Any]]] = {body: [] for body, _ in carried.values()}
    for link, (body, place) in carried.items():
        own = tree.links[link].inertial
        if own is not None:
            parts[body].append((own, place))
    return parts


def inertial_spec(
    robot: Robot, tree: UrdfTree, rigid: Mapping[str, float], in_plane: bool
) -> tuple[Any, dict[str, float]]:
    """Return the ``mujoco.MjSpec`` of inertias and joints alone, these called ``joint`` and their number in the model.

    The base moves in the plane alone, or is free; rigid joints stay where they are, and what they carry is one body.
    In the plane a body has its moment about the normal about all axes: the others do not count. In space moments that
    MuJoCo refuses are balanced: what is told, by body, is the largest change of one, kg m^2.
    """
    mujoco = import_mujoco()
    spec, kinds = mujoco.MjSpec(), mujoco.mjtJoint
    base = spec.worldbody.add_body()
    if in_plane:
        plane = robot.plane
        for name, axis in zip(BASE, (plane.horizontal, plane.vertical, plane.normal), strict=True):
            base.add_joint(name=name, type=kinds.mjJNT_HINGE if name == BASE[-1] else kinds.mjJNT_SLIDE, axis=axis)
    else:
        base.add_joint(name="free", type=kinds.mjJNT_FREE)
    bodies, carried = {tree.root: base}, _carried(tree, rigid)
    for joint in (joint for joint in tree.joints if carried[joint.child][0] == joint.child):
        carrier, place = carried[joint.parent]
        place = place * joint.origin.placement
        body = bodies[carrier].add_body(pos=place.translation, quat=_quaternion(place.rotation))
        name, kind = f"joint{robot.model.getJointId(joint.name)}", "HINGE" if joint.turns else "SLIDE"
        body.add_joint(name=name, type=getattr(kinds, f"mjJNT_{kind}"), axis=joint.axis)
        bodies[joint.child] = body
    placements, changed = tree.placements(rigid), dict[str, float]()
    for name, parts in _parts(tree, carried).items():
        body = bodies[name]
        body.mass, body.ipos, inertia = rigid_body(parts)
        body.mass = body.mass if in_plane else max(body.mass, LEAST)  # between the joints of a shoulder there is none
        if in_plane:
            normal = placements[name].rotation.T @ plane.normal
            inertia = normal @ inertia @ normal * np.eye(3)
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 0] *= np.linalg.det(axes)  # right-handed
        least = LEAST if in_plane else max(LEAST, body.mass * GYRATION**2)
        body.inertia, body.iquat, body.explicitinertial = _balanced(moments, least), _quaternion(axes), True
        change = np.abs(body.inertia - moments).max()
        if change > max(ROUNDING * moments[-1], LEAST):
            changed[name] = float(change)
    return spec, changed


def _balanced(moments: Array, least: float) -> Array:
    """Principal moments (3,), rising, as MuJoCo takes them: none less than ``least`` or more than the others' sum."""
    moments = np.maximum(moments, least)
    moments[:2] += max(moments[2] * (1 + EDGE) - moments[0] - moments[1], 0.0) / 2
    return moments


def balanced_in_words(balanced: Mapping[str, float]) -> str:
    """Say which inertias were balanced, and by how much."""
    return f"of {', '.join(balanced)}, which no body can have: moments changed by {max(balanced.values()):.2g} kg m^2"


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion w x y z of a rotation matrix."""
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)
