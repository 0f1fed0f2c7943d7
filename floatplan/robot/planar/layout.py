"""From URDF links and the choice of joints to the :class:`PlanarTree` and its named frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, read_only
from floatplan.robot.parts import Coupling, Frame, Plane
from floatplan.robot.planar.choice import Choice
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.urdf.tree import UrdfTree

_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True, eq=False)
class _Body:
    """A body: its root link, its angle (turns @ positions + offset), and its origin in the root link's plane.

    ``motor_turns`` are those by the positions of the motors.
    """

    name: str
    parent: int
    turns: Array
    motor_turns: Array
    offset: float
    origin: complex


@dataclass(frozen=True, eq=False)
class TreeLayout:
    """The bodies, which body each link belongs to, and where the links are when the planned positions are zero.

    ``placements`` are ``pinocchio.SE3`` in the root link.
    """

    tree: UrdfTree
    plane: Plane
    bodies: tuple[_Body, ...]
    body_of: Mapping[str, int]
    placements: Mapping[str, Any]

    def local(self, body: int, point: Array) -> complex:
        """Place in a body's frame of a ``point`` (3,) of the root link, at planned positions zero."""
        home = self.bodies[body]
        back = np.exp(-1j * self.plane.turn * home.offset)
        return complex((in_plane(self.plane, point) - home.origin) * back)


def in_plane(plane: Plane, point: Array) -> complex:
    """Projection of a point (3,) onto the plane: horizontal + i vertical."""
    return complex(plane.horizontal @ point, plane.vertical @ point)


def lay_out(tree: UrdfTree, choice: Choice) -> TreeLayout:
    """Gather links that do not move relative to each other into bodies, parents first."""
    positions = choice.positions_at_zero()
    placements = tree.placements(positions)
    column = {name: index for index, name in enumerate(choice.planned)}
    motor = {name: index for index, name in enumerate(choice.motors)}
    bodies = [_Body(tree.root, -1, np.zeros(len(choice.planned)), np.zeros(len(motor)), 0.0, 0j)]
    body_of = {tree.root: 0}
    angle = {tree.root: 0.0}
    for joint in tree.joints:
        parent = body_of[joint.parent]
        turned = choice.signs.get(joint.name, 0.0) * positions.get(joint.name, 0.0)
        angle[joint.child] = angle[joint.parent] + turned
        body_of[joint.child] = parent
        if joint.name in column or joint.name in choice.coupled:
            body_of[joint.child] = len(bodies)
            coupling = choice.coupled.get(joint.name, Coupling(joint.name))
            turns = bodies[parent].turns.copy()
            turns[column[coupling.leader]] += choice.signs[joint.name] * coupling.ratio
            motor_turns = bodies[parent].motor_turns.copy()
            if joint.name in motor:
                motor_turns[motor[joint.name]] += choice.signs[joint.name]
            else:
                motor_turns[motor[coupling.leader]] += choice.signs[joint.name] * coupling.ratio
            origin = in_plane(choice.plane, placements[joint.child].translation)
            bodies.append(_Body(joint.child, parent, turns, motor_turns, angle[joint.child], origin))
    return TreeLayout(tree, choice.plane, tuple(bodies), body_of, placements)


def planar_tree(layout: TreeLayout) -> PlanarTree:
    """Return the bodies with their masses, centres of mass and inertias about the plane's normal."""
    count = len(layout.bodies)
    mass, inertia = np.zeros(count), np.zeros(count)
    moment = np.zeros(count, dtype=np.complex128)
    parts = []
    for link in layout.tree.links.values():
        if link.inertial is None:
            continue
        body = layout.body_of[link.name]
        placement = layout.placements[link.name] * link.inertial.origin.placement
        part = layout.local(body, placement.translation)
        normal = placement.rotation.T @ layout.plane.normal
        mass[body] += link.inertial.mass
        moment[body] += link.inertial.mass * part
        inertia[body] += normal @ link.inertial.inertia @ normal
        parts.append((body, link.inertial.mass, part))
    center = np.divide(moment, mass, out=np.zeros_like(moment), where=mass > 0.0)
    for body, part_mass, part in parts:
        inertia[body] += part_mass * abs(part - center[body]) ** 2
    return PlanarTree(
        names=tuple(body.name for body in layout.bodies),
        parent=_sealed(np.array([body.parent for body in layout.bodies], dtype=np.int64)),
        anchor=_sealed(np.array([_anchor(layout, body) for body in layout.bodies], dtype=np.complex128)),
        mass=read_only(mass),
        center=_sealed(center),
        inertia=read_only(inertia),
        turns=read_only([body.turns for body in layout.bodies]),
        motor_turns=read_only([body.motor_turns for body in layout.bodies]),
        offsets=read_only([body.offset for body in layout.bodies]),
        turn=layout.plane.turn,
    )


def named_frames(layout: TreeLayout) -> Mapping[str, Frame]:
    """Return the origin of every link and joint; where both have one name, the link's."""
    frames = {}
    for joint in layout.tree.joints:
        frames[joint.name] = _frame(layout, joint.child)
    for link in layout.tree.links:
        frames[link] = _frame(layout, link)
    return MappingProxyType(frames)


def _frame(layout: TreeLayout, link: str) -> Frame:
    body = layout.body_of[link]
    return Frame(body, layout.local(body, layout.placements[link].translation), link)


def _anchor(layout: TreeLayout, body: _Body) -> complex:
    if body.parent < 0:
        return 0j
    return layout.local(body.parent, layout.placements[body.name].translation)


def _sealed(array: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
    array.setflags(write=False)
    return array
