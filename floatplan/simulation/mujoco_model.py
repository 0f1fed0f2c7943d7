"""The robot for MuJoCo: the URDF's links and joints, on slide, slide, hinge at the base, or on a free joint."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError, import_optional
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.tree import UrdfJoint, UrdfLink, UrdfTree
from floatplan.simulation.reduced_model import ReducedModel

ONE_AT_A_TIME = threading.Lock()  # MuJoCo waits for ever where two threads ask for its warnings at once
HEADER = '<mujoco><compiler fusestatic="{}" balanceinertia="false" discardvisual="true"/></mujoco>'


def import_mujoco() -> ModuleType:
    """Return the module, which then writes no log of its warnings; InputError where it is not installed."""
    with ONE_AT_A_TIME:
        mujoco = import_optional("mujoco", name="MuJoCo", element="engine", extra="replay")
        if mujoco.get_mju_user_warning() is None:  # else it writes MUJOCO_LOG.TXT where the user is
            mujoco.set_mju_user_warning(_unheard)
    return mujoco


def _unheard(_: str) -> None:
    """Take a warning: whether the robot lands as planned is what counts."""


def mujoco_model(robot: Robot, reduced: ReducedModel, mass: Array, inertia: Array) -> tuple[Any, list[int]]:
    """Return the ``mujoco.MjModel``, and which of its coordinates each coordinate of the reduced model is.

    ``mass, inertia`` (njoints,) are factors of the links that each joint of the reduced model carries.

    Raises
    ------
    InputError
        MuJoCo is not installed, or refuses the robot, such as for a link that moves and has no mass.
    """
    mujoco = import_mujoco()
    try:
        spec = mujoco.MjSpec.from_string(_urdf(robot, robot.layout.tree, robot.locked, HEADER.format("false")))
        _to_plane(mujoco, spec, robot)
        _leave_inertia_alone(mujoco, spec, reduced.model.gravity.linear)
        model = spec.compile()
    except ValueError as error:
        raise _refused(robot, error) from None
    rows = {f"joint{index}": name for index, name in enumerate(robot.model.names)}
    of_name = {rows.get(model.joint(j).name, model.joint(j).name): int(model.jnt_qposadr[j]) for j in range(model.njnt)}
    base = ["base_horizontal", "base_vertical", "base_orientation"]
    order = [of_name[name] for name in [*base, *list(reduced.model.names)[BASE_COORDINATES + 1 :]]]
    _scale_bodies(mujoco, model, {coordinate: joint + 1 for joint, coordinate in enumerate(order)}, mass, inertia)
    return model, order


def _scale_bodies(mujoco: ModuleType, model: Any, joint_of: Mapping[int, int], mass: Array, inertia: Array) -> None:
    """Scale each body by the factors of the joint that carries it; ``joint_of`` coordinates of MuJoCo."""
    for body in range(1, model.nbody):
        carrier = int(model.body_weldid[body])
        if carrier:
            last = int(model.body_jntadr[carrier] + model.body_jntnum[carrier] - 1)
            joint = joint_of[int(model.jnt_qposadr[last])]
            model.body_mass[body] *= mass[joint]
            model.body_inertia[body] *= inertia[joint]
    mujoco.mj_setConst(model, mujoco.MjData(model))


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

    Factors and errors as of :func:`mujoco_model`.
    """
    mujoco = import_mujoco()
    rigid = {name: position for name, position in robot.locked.items() if name not in set(reduced.model.names)}
    try:
        spec = mujoco.MjSpec.from_string(_urdf(robot, robot.file_tree, rigid, HEADER.format("true")))
        _leave_inertia_alone(mujoco, spec, reduced.model.gravity.linear)
        model = spec.compile()
    except ValueError as error:
        raise _refused(robot, error) from None
    names = list(reduced.model.names)[BASE_COORDINATES + 1 :]
    joints = [model.joint(f"joint{robot.model.getJointId(name)}").id for name in names]
    free = model.joint("free").id
    joint_of = {int(model.jnt_qposadr[joint]): BASE_COORDINATES + 1 + row for row, joint in enumerate(joints)}
    _scale_bodies(mujoco, model, {int(model.jnt_qposadr[free]): BASE_COORDINATES, **joint_of}, mass, inertia)
    return SpatialModel(
        model,
        int(model.jnt_qposadr[free]),
        int(model.jnt_dofadr[free]),
        np.asarray(model.jnt_qposadr[joints], dtype=np.int64),
        np.asarray(model.jnt_dofadr[joints], dtype=np.int64),
    )


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
            if _has_inertia(tree.links[joint.child]):
                heavy.add(body[joint.child])
        light = {joint.child for joint in tree.joints if body[joint.child] == joint.child} - heavy
        found = {name for name in robot.locked if {tree.joint[name].child, body[tree.joint[name].parent]} & light}
        if found <= rigid:
            return rigid
        rigid |= found


def _refused(robot: Robot, error: ValueError) -> InputError:
    return InputError(f"MuJoCo refuses the robot: {error}", source=robot.source, element="engine")


def _to_plane(mujoco: ModuleType, spec: Any, robot: Robot) -> None:
    """Let the base move in the plane alone."""
    plane = robot.plane
    free = next(joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE)
    base = free.parent
    spec.delete(free)
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    base.add_joint(name="base_horizontal", type=slide, axis=plane.horizontal)
    base.add_joint(name="base_vertical", type=slide, axis=plane.vertical)
    base.add_joint(name="base_orientation", type=hinge, axis=plane.normal)


def _leave_inertia_alone(mujoco: ModuleType, spec: Any, gravity: Array) -> None:
    """Take away everything but inertia, gravity and joint torques."""
    spec.option.gravity = gravity
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in spec.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.damping, joint.frictionloss, joint.armature = _zero_like(joint.damping), 0.0, 0.0


def _zero_like(value: Any) -> Any:
    """Zero of a number, or of an array: damping became one of three coefficients in MuJoCo 3.5."""
    return 0.0 if np.isscalar(value) else np.zeros_like(value)


def _urdf(robot: Robot, tree: UrdfTree, rigid: Mapping[str, float], header: str) -> str:
    """URDF text of inertias and joints alone; links and joints by number, rigid joints fixed where they are."""
    links = {name: f"link{index}" for index, name in enumerate(tree.links)}
    lines = [_link(links[link.name], link) for link in tree.links.values()]
    lines.append('<link name="outside"/><joint name="free" type="floating"><parent link="outside"/>')
    lines.append(f"<child link={quoteattr(links[tree.root])}/></joint>")
    for number, joint in enumerate(tree.joints):
        row = robot.model.getJointId(joint.name) if joint.moves else 0
        name = f"joint{row}" if row else f"fixed{number}"
        lines.append(_joint(name, joint, links, rigid.get(joint.name)))
    return "\n".join(['<robot name="robot">', header, *lines, "</robot>"])


def _link(name: str, link: UrdfLink) -> str:
    if link.inertial is None or not _has_inertia(link):
        return f"<link name={quoteattr(name)}/>"
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertial.inertia.tolist()
    moments = f'ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"'
    origin = link.inertial.origin
    placed = f'<origin xyz="{_words(origin.xyz)}" rpy="{_words(origin.rpy)}"/>'
    mass = f'<mass value="{link.inertial.mass!r}"/>'
    return f"<link name={quoteattr(name)}><inertial>{placed}{mass}<inertia {moments}/></inertial></link>"


def _has_inertia(link: UrdfLink) -> bool:
    return link.inertial is not None and bool(link.inertial.mass or link.inertial.inertia.any())


def _joint(name: str, joint: UrdfJoint, links: dict[str, str], locked: float | None) -> str:
    xyz, rpy = joint.origin.xyz, joint.origin.rpy
    free = joint.moves and locked is None
    kind = "continuous" if joint.turns else "prismatic"
    if locked is not None:
        placement = joint.origin.placement * joint.motion(locked)
        xyz, rpy = placement.translation, pin.rpy.matrixToRpy(placement.rotation)
    turning = f'type="{kind}"><axis xyz="{_words(joint.axis)}"/>' if free else 'type="fixed">'
    return (
        f'<joint name="{name}" {turning}<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'
        f'<parent link="{links[joint.parent]}"/><child link="{links[joint.child]}"/></joint>'
    )


def _words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
