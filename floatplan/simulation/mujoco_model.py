"""The robot for MuJoCo: the URDF's links and joints as they were read, on slide, slide, hinge at the base."""

from __future__ import annotations

from types import ModuleType
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from floatplan.errors import InputError
from floatplan.optional import import_optional
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.tree import UrdfJoint, UrdfLink
from floatplan.simulation.reduced_model import ReducedModel

HEADER = '<mujoco><compiler fusestatic="false" balanceinertia="false" discardvisual="true"/></mujoco>'


def import_mujoco() -> ModuleType:
    """Return the module; InputError where it is not installed."""
    return import_optional("mujoco", name="MuJoCo", element="engine", install="mujoco")


def mujoco_model(robot: Robot, reduced: ReducedModel, gravity: float, step: float) -> tuple[Any, list[int]]:
    """Return the ``mujoco.MjModel``, and which of its coordinates each coordinate of the reduced model is.

    Raises
    ------
    InputError
        MuJoCo is not installed, or refuses the robot, such as for a link that moves and has no mass.
    """
    mujoco = import_mujoco()
    try:
        spec = mujoco.MjSpec.from_string(_urdf(robot, reduced))
        _release(mujoco, spec, robot, gravity, step)
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"MuJoCo refuses the robot: {error}", source=robot.source, element="engine") from None
    rows = {f"joint{index}": name for index, name in enumerate(robot.model.names)}
    of_name = {rows.get(model.joint(j).name, model.joint(j).name): int(model.jnt_qposadr[j]) for j in range(model.njnt)}
    base = ["base_horizontal", "base_vertical", "base_orientation"]
    return model, [of_name[name] for name in [*base, *list(reduced.model.names)[BASE_COORDINATES + 1 :]]]


def _release(mujoco: ModuleType, spec: Any, robot: Robot, gravity: float, step: float) -> None:
    """Let the base go in the plane, and take away everything but inertia, gravity and joint torques."""
    plane = robot.plane
    spec.option.gravity = -gravity * np.asarray(plane.vertical)
    spec.option.timestep = step
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    free = next(joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE)
    base = free.parent
    spec.delete(free)
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    base.add_joint(name="base_horizontal", type=slide, axis=plane.horizontal)
    base.add_joint(name="base_vertical", type=slide, axis=plane.vertical)
    base.add_joint(name="base_orientation", type=hinge, axis=plane.normal)
    for joint in spec.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.damping, joint.frictionloss, joint.armature = _zero_like(joint.damping), 0.0, 0.0


def _zero_like(value: Any) -> Any:
    """Zero of a number, or of an array: damping became one of three coefficients in MuJoCo 3.5."""
    return 0.0 if np.isscalar(value) else np.zeros_like(value)


def _urdf(robot: Robot, reduced: ReducedModel) -> str:
    """URDF text of inertias and joints alone; links and joints by number, locked joints fixed where they are."""
    tree = robot.layout.tree
    links = {name: f"link{index}" for index, name in enumerate(tree.links)}
    lines = [_link(links[link.name], link) for link in tree.links.values()]
    lines.append('<link name="outside"/><joint name="free" type="floating"><parent link="outside"/>')
    lines.append(f"<child link={quoteattr(links[tree.root])}/></joint>")
    for number, joint in enumerate(tree.joints):
        row = robot.model.getJointId(joint.name) if joint.moves else 0
        name = f"joint{row}" if row else f"fixed{number}"
        lines.append(_joint(name, joint, links, robot.locked.get(joint.name)))
    return "\n".join(['<robot name="robot">', HEADER, *lines, "</robot>"])


def _link(name: str, link: UrdfLink) -> str:
    if link.inertial is None or not (link.inertial.mass or link.inertial.inertia.any()):
        return f"<link name={quoteattr(name)}/>"
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertial.inertia.tolist()
    moments = f'ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"'
    origin = link.inertial.origin
    placed = f'<origin xyz="{_words(origin.xyz)}" rpy="{_words(origin.rpy)}"/>'
    mass = f'<mass value="{link.inertial.mass!r}"/>'
    return f"<link name={quoteattr(name)}><inertial>{placed}{mass}<inertia {moments}/></inertial></link>"


def _joint(name: str, joint: UrdfJoint, links: dict[str, str], locked: float | None) -> str:
    xyz, rpy = joint.origin.xyz, joint.origin.rpy
    free = joint.moves and locked is None
    if locked is not None:
        placement = joint.origin.placement * joint.motion(locked)
        xyz, rpy = placement.translation, pin.rpy.matrixToRpy(placement.rotation)
    turning = f'type="continuous"><axis xyz="{_words(joint.axis)}"/>' if free else 'type="fixed">'
    return (
        f'<joint name="{name}" {turning}<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'
        f'<parent link="{links[joint.parent]}"/><child link="{links[joint.child]}"/></joint>'
    )


def _words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
