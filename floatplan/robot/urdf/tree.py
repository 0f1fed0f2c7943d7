"""A URDF after reading: links and joints as data, with every number known to be a number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array

ROTATIONAL = ("revolute", "continuous")
MOVING = (*ROTATIONAL, "prismatic")


@dataclass(frozen=True, eq=False)
class Origin:
    """A placement as URDF writes it: translation (3,) in m, and roll, pitch, yaw (3,) in rad."""

    xyz: Array
    rpy: Array

    @cached_property
    def placement(self) -> Any:
        """The same as ``pinocchio.SE3``."""
        return pin.SE3(pin.rpy.rpyToMatrix(self.rpy), self.xyz)


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass in kg, and inertia (3, 3) in kg m^2 about the centre of mass, in the axes of ``origin``."""

    origin: Origin
    mass: float
    inertia: Array


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A link; ``inertial`` is None where the file gives none or all zeros; ``collisions`` are its XML elements."""

    name: str
    inertial: Inertial | None
    collisions: tuple[Element, ...]


@dataclass(frozen=True)
class Mimic:
    """``position = multiplier * position of joint + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint from ``parent`` to ``child`` with unit ``axis`` (3,) in its own frame.

    ``lower`` and ``upper`` (rad or m), ``velocity`` and ``effort`` are infinite where the file does not give them;
    ``armature`` (the rotor's inertia as the joint feels it, kg m^2), ``damping`` (N m s/rad) and ``friction`` (N m) are
    None there.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Origin
    axis: Array
    lower: float
    upper: float
    velocity: float
    effort: float
    mimic: Mimic | None
    armature: float | None = None
    damping: float | None = None
    friction: float | None = None

    @property
    def moves(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.type in MOVING

    @property
    def turns(self) -> bool:
        """Whether it is one of rotation."""
        return self.type in ROTATIONAL

    def nearest(self, position: float) -> float:
        """The position within its limits that is nearest to ``position``."""
        return float(min(max(position, self.lower), self.upper))

    def motion(self, position: float) -> Any:
        """Placement (``pinocchio.SE3``) of the child's frame in the joint's frame at ``position``."""
        if position == 0.0 or not self.moves:
            return pin.SE3.Identity()
        if self.turns:
            return pin.SE3(pin.AngleAxis(position, self.axis).matrix(), np.zeros(3))
        return pin.SE3(np.eye(3), position * self.axis)


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """Links by name, and joints with parents before children, siblings by name: the order of Pinocchio.

    ``warnings`` are doubts about the file.
    """

    name: str
    root: str
    links: Mapping[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    warnings: tuple[str, ...]

    @cached_property
    def joint(self) -> Mapping[str, UrdfJoint]:
        """Joints by name."""
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def carrier(self) -> Mapping[str, UrdfJoint]:
        """The joint that carries a link, by the link's name."""
        return {joint.child: joint for joint in self.joints}

    def path(self, link: str) -> Iterator[UrdfJoint]:
        """Joints from the one that carries a link to the root's."""
        while link in self.carrier:
            yield self.carrier[link]
            link = self.carrier[link].parent

    def placements(self, positions: Mapping[str, float]) -> dict[str, Any]:
        """Placement (``pinocchio.SE3``) of each link in the root link, at joint ``positions`` (zero where left out)."""
        placements = {self.root: pin.SE3.Identity()}
        for joint in self.joints:
            moved = joint.motion(positions.get(joint.name, 0.0))
            placements[joint.child] = placements[joint.parent] * joint.origin.placement * moved
        return placements
