"""The Pinocchio model: the URDF's links and joints on a planar free-flyer root, written anew from what was checked.

The root is three joints of one coordinate each (along the plane's horizontal, along its vertical, about its normal), so
that nq = nv and every angle is one unbounded number. ``JointModelPlanar`` carries (cos, sin), and
``JointModelComposite`` has wrong derivatives of RNEA in Pinocchio 4.1.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.robot.parts import Coupling
from floatplan.robot.planar.choice import Choice
from floatplan.robot.urdf.tree import Origin, UrdfJoint, UrdfLink, UrdfTree

BASE_COORDINATES = 3
ATTRIBUTE = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)
UNBOUNDED = 1e6  # [rad, m, 1/s, N m] stands in Pinocchio for a limit that is not given


def build_model(tree: UrdfTree, choice: Choice) -> Any:
    """Return the ``pinocchio.Model`` of the robot, free to fly in the plane, without gravity."""
    model = pin.buildModelFromXML(planar_xml(tree, choice))
    model.gravity = pin.Motion.Zero()
    model.name = tree.name
    return model


def full_coordinates(model: Any, choice: Choice) -> tuple[Array, Array]:
    """Return ``reference`` (nv,) and ``selection`` (nv, n): full configuration = reference + selection @ positions."""
    reference = np.zeros(model.nv)
    selection = np.zeros((model.nv, len(choice.planned)))
    column = {name: index for index, name in enumerate(choice.planned)}
    for row, name in enumerate(list(model.names)[1:]):
        if name in choice.locked:
            reference[row] = choice.locked[name]
        elif name in choice.coupled:
            coupling = choice.coupled[name]
            reference[row] = coupling.offset
            selection[row, column[coupling.leader]] = coupling.ratio
        elif name in column:
            selection[row, column[name]] = 1.0
    return reference, selection


def motor_coordinates(model: Any, choice: Choice) -> tuple[Array, Array]:
    """Return ``transmission`` (nv, motors) and ``motor_ratios`` (motors, n).

    Velocities of the motors are ``motor_ratios @ velocities``; each motor's torque is ``transmission.T`` times the
    torques of all joints: its own joint's, and those that the file gears to it, by their ratios.
    """
    motor = {name: index for index, name in enumerate(choice.motors)}
    ratios = np.zeros((len(motor), len(choice.planned)))
    for name, index in motor.items():
        coupling = choice.coupled.get(name, Coupling(name))
        ratios[index, choice.planned.index(coupling.leader)] = coupling.ratio
    transmission = np.zeros((model.nv, len(motor)))
    for row, name in enumerate(list(model.names)[1:]):
        if name in motor:
            transmission[row, motor[name]] = 1.0
        elif name in choice.geared:
            transmission[row, motor[choice.coupled[name].leader]] = choice.coupled[name].ratio
    return transmission, ratios


def planar_xml(tree: UrdfTree, choice: Choice) -> str:
    """URDF text of links, inertias, joints and the planar root; geometry and the rest left out."""
    lines = ['<robot name="robot">', *_root_lines(tree, choice)]
    lines += [_link_line(link) for link in tree.links.values()]
    lines += [_joint_line(joint) for joint in tree.joints]
    return "\n".join([*lines, "</robot>"])


def _root_lines(tree: UrdfTree, choice: Choice) -> list[str]:
    taken = {*tree.links, *tree.joint}
    plane = choice.plane
    steps = (("prismatic", plane.horizontal), ("prismatic", plane.vertical), ("revolute", plane.normal))
    joints = ("base_horizontal", "base_vertical", "base_orientation")
    links = [_unused(f"base_{place}", taken) for place in ("world", "column", "carriage")]
    lines = [f"<link name={quoteattr(name)}/>" for name in links]
    chain = [*links, tree.root]
    for number, ((kind, axis), name) in enumerate(zip(steps, joints, strict=True)):
        lines.append(_joint_text(_unused(name, taken), kind, chain[number], chain[number + 1], axis))
    return lines


def _unused(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    return name


def _link_line(link: UrdfLink) -> str:
    if link.inertial is None:
        return f"<link name={quoteattr(link.name)}/>"
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertial.inertia.tolist()
    moments = f'ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"'
    body = f'{_origin_text(link.inertial.origin)}<mass value="{link.inertial.mass!r}"/><inertia {moments}/>'
    return f"<link name={quoteattr(link.name)}><inertial>{body}</inertial></link>"


def _joint_line(joint: UrdfJoint) -> str:
    limits = (joint.lower, joint.upper, joint.velocity, joint.effort)
    kind = "revolute" if joint.type == "continuous" else joint.type
    return _joint_text(joint.name, kind, joint.parent, joint.child, joint.axis, _origin_text(joint.origin), limits)


def _joint_text(
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: Array,
    origin: str = "",
    limits: tuple[float, float, float, float] = (-np.inf, np.inf, np.inf, np.inf),
) -> str:
    lower, upper, velocity, effort = (min(max(limit, -UNBOUNDED), UNBOUNDED) for limit in limits)
    return (
        f"<joint name={quoteattr(name)} type={quoteattr(kind)}>{origin}"
        f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/><axis xyz={quoteattr(_numbers(axis))}/>"
        f'<limit lower="{lower!r}" upper="{upper!r}" velocity="{velocity!r}" effort="{effort!r}"/></joint>'
    )


def _origin_text(origin: Origin) -> str:
    return f'<origin xyz="{_numbers(origin.xyz)}" rpy="{_numbers(origin.rpy)}"/>'


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def quoteattr(text: str) -> str:
    """Quote an attribute's value; the standard library's function for it imports all that it takes to open a URL."""
    return f'"{text.translate(ATTRIBUTE)}"'
