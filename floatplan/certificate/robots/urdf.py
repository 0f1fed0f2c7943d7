"""The robot as the certificate reads it: links, inertias and joints straight from the URDF, in Arb, and their roles.

No code is shared with ``floatplan.robot``. The parameters are the doubles nearest to the file's decimals, as every URDF
reader takes them; what is computed from them is enclosed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import flint

from floatplan.certificate.enclosure import PRECISION
from floatplan.errors import InputError
from floatplan.files import parsed_xml
from floatplan.plans.record import RobotRecord

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")  # all six in an <inertia>; without one a link is a point mass


@dataclass(frozen=True)
class Placement:
    """A rigid displacement ``x -> rotation x + translation`` of columns, ``flint.arb_mat``."""

    rotation: Any = field(default_factory=lambda: flint.arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    translation: Any = field(default_factory=lambda: flint.arb_mat(3, 1))

    def __mul__(self, other: Placement) -> Placement:
        """Do ``other`` first."""
        return Placement(self.rotation * other.rotation, self.point(other.translation))

    def point(self, point: Any) -> Any:
        """Return the displaced point (3, 1)."""
        return self.rotation * point + self.translation


@dataclass(frozen=True)
class Link:
    """A link: mass (kg), placement of its centre of mass and inertia axes, inertia (3, 3) about them (kg m^2).

    ``frame``: it only stands between joints, of an MJCF's body (``type="frame"``) or of a base that floats, and has no
    shape at all.
    """

    name: str
    mass: Any
    center: Placement
    inertia: Any
    has_inertial: bool
    has_collision: bool
    frame: bool = False


@dataclass(frozen=True)
class Joint:
    """A joint: its child's frame is at ``origin`` times the motion about (or along) ``axis``.

    ``mimic`` is the joint that the file makes it follow, with multiplier and offset: ``position = multiplier * leader's
    position + offset``. ``armature`` is the inertia of its motor's rotor as the joint feels it, kg m^2.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Placement
    axis: Any
    mimic: tuple[str, float, float] | None
    armature: float

    @property
    def unit_axis(self) -> Any:
        """The axis in the joint's own frame, made a unit vector (3, 1)."""
        length = sum((entry * entry for entry in self.axis.entries()), start=flint.arb(0)).sqrt()
        if not length > 0:
            raise InputError("its axis has no length", element=f'joint "{self.name}"')
        return self.axis * (1 / length)

    def motion(self, position: float) -> Placement:
        """Displacement at a position (rad or m)."""
        if self.kind == "prismatic":
            return Placement(translation=self.unit_axis * flint.arb(position))
        return Placement(rotation_about(self.unit_axis, flint.arb(position))) if position else Placement()


@dataclass(frozen=True)
class Urdf:
    """Links and joints of a file; joints come after the joint that carries their parent."""

    links: Mapping[str, Link]
    joints: tuple[Joint, ...]
    root: str


def read_urdf(content: bytes, path: Path) -> Urdf:
    """Read the content of a URDF file; the path is for messages.

    Raises
    ------
    InputError
        It is not a tree of links and joints with finite numbers.
    """
    try:
        with flint.ctx.workprec(PRECISION):
            return _tree(parsed_xml(content, path))
    except InputError as error:
        raise error.within(path) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"is no URDF: {error}", source=path) from None


def _tree(root: Element) -> Urdf:
    links: dict[str, Link] = {}
    for element in root.findall("link"):
        link = _link(element)
        if link.name in links:
            raise InputError("there are two of this name", element=f'link "{link.name}"')
        links[link.name] = link
    joints = list(map(_joint, root.findall("joint")))
    children = [joint.child for joint in joints]
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise InputError(f'there is no link "{end}"', element=f'joint "{joint.name}"')
    roots = [name for name in links if name not in children]
    if len(roots) != 1 or len(set(children)) != len(children) or len({j.name for j in joints}) != len(joints):
        raise InputError("is not one tree: it needs one root link, one joint to each other link, and distinct names")
    return Urdf(links, _parents_first(joints, roots[0]), roots[0])


def _parents_first(joints: list[Joint], root: str) -> tuple[Joint, ...]:
    below: dict[str, list[Joint]] = {}
    for joint in reversed(joints):
        below.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    waiting = list(below.get(root, []))
    while waiting:
        ordered.append(waiting.pop())
        waiting += below.get(ordered[-1].child, [])
    if len(ordered) != len(joints):
        raise InputError("is not one tree: some joints form a loop")
    return tuple(ordered)


def _link(element: Element) -> Link:
    name = _text(element, "name")
    inertial = element.find("inertial")
    collides = element.find("collision") is not None
    frame = element.get("type") == "frame"
    if inertial is None:
        return Link(name, flint.arb(0), Placement(), flint.arb_mat(3, 3), False, collides, frame)
    mass = inertial.find("mass")
    inertia = inertial.find("inertia")
    if mass is None:
        raise InputError("its <inertial> has no <mass>", element=f'link "{name}"')
    written = dict.fromkeys(MOMENTS, "0") if inertia is None else inertia.attrib
    for key in MOMENTS:
        if key not in written:
            raise InputError(f"its <inertia> has no {key}", element=f'link "{name}"')
    xx, xy, xz, yy, yz, zz = (number(written[key]) for key in MOMENTS)
    value = number(mass.get("value"))
    if not value >= 0:
        raise InputError("its mass is negative", element=f'link "{name}"')
    moments = flint.arb_mat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Link(name, value, _origin(inertial), moments, True, collides, frame)


def _joint(element: Element) -> Joint:
    name = _text(element, "name")
    kind = _text(element, "type")
    if kind not in ("revolute", "continuous", "prismatic", "fixed", "floating", "planar"):
        raise InputError(f'its type "{kind}" is none that floatplan plans with', element=f'joint "{name}"')
    parent = element.find("parent")
    child = element.find("child")
    axis = element.find("axis")
    if parent is None or child is None:
        raise InputError("lacks a parent or a child", element=f'joint "{name}"')
    if axis is not None and axis.get("xyz") is None and kind not in ("fixed", "floating"):
        raise InputError("its <axis> has no xyz", element=f'joint "{name}"')
    direction = _vector(None if axis is None else axis.get("xyz"), "1 0 0")
    ends = (_text(parent, "link"), _text(child, "link"))
    mimic = element.find("mimic")
    follower = None
    if mimic is not None:
        multiplier, offset = (float(mimic.get(key, default)) for key, default in (("multiplier", "1"), ("offset", "0")))
        follower = (_text(mimic, "joint"), multiplier, offset)
    dynamics = element.find("dynamics")
    armature = 0.0 if dynamics is None else float(number(dynamics.get("armature", "0")))
    return Joint(name, kind, *ends, _origin(element), direction, follower, armature)


def _origin(element: Element) -> Placement:
    origin = element.find("origin")
    if origin is None:
        return Placement()
    turned = Placement()
    for index, angle in enumerate(_vector(origin.get("rpy"), "0 0 0").entries()):
        if not angle.is_zero():
            axis = flint.arb_mat(3, 1, [float(index == entry) for entry in range(3)])
            turned = Placement(rotation_about(axis, angle)) * turned
    return Placement(turned.rotation, _vector(origin.get("xyz"), "0 0 0"))


def rotation_about(axis: Any, angle: Any) -> Any:
    """Rodrigues' rotation (3, 3) about a unit axis (3, 1)."""
    x, y, z = axis.entries()
    sine, cosine = angle.sin_cos()
    cross = flint.arb_mat([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return Placement().rotation + cross * sine + cross * cross * (1 - cosine)


def _vector(text: str | None, default: str) -> Any:
    return flint.arb_mat(3, 1, numbers(default if text is None else text, 3))


def numbers(text: str, count: int) -> list[Any]:
    """So many numbers as written."""
    words = text.split()
    if len(words) != count:
        raise InputError(f'"{text}" is not {count} numbers')
    return list(map(number, words))


def number(text: str | None) -> Any:
    """The double nearest to a number as written."""
    value = float("nan" if text is None else text)
    if not math.isfinite(value) or "_" in str(text):
        raise InputError(f'"{text}" is not a finite number')
    return flint.arb(value)


def _text(element: Element, key: str) -> str:
    value = element.get(key)
    if value is None:
        raise InputError(f"a <{element.tag}> lacks its {key}")
    return value


def check_roles(urdf: Urdf, record: RobotRecord) -> None:
    """Refuse a record that leaves a moving joint of the file without a role, or gives one two or none it can have."""
    moving = {joint.name: joint for joint in urdf.joints if joint.kind != "fixed"}
    roles = [*record.joints, *record.coupled, *record.locked]
    for name in roles:
        if name not in moving:
            raise InputError(f'the robot has no joint "{name}" that moves', element="robot")
    if len(set(roles)) != len(roles):
        raise InputError("a joint has two roles", element="robot")
    for name, joint in moving.items():
        if name not in roles:
            raise InputError(f'joint "{name}" is neither planned, nor coupled, nor locked', element="robot")
        if joint.kind == "prismatic" and name not in record.locked:
            raise InputError(f'joint "{name}" is prismatic and can only be locked', element="robot")
    for name, coupling in record.coupled.items():
        if not isinstance(coupling, Mapping) or coupling.get("leader") not in record.joints:
            raise InputError("its leader must be a planned joint", element=f"robot.coupled.{name}")
    for name, armature in record.armature.items():
        if name not in moving or name in record.locked:
            raise InputError("is not a joint that is moved", element=f"robot.armature.{name}")
        if not 0.0 <= armature < math.inf:
            raise InputError(f"{armature!r} is no inertia", element=f"robot.armature.{name}")


def is_geared(joints: Mapping[str, Joint], record: RobotRecord, name: str) -> bool:
    """Whether the file's ``<mimic>``, resolved to the joint that leads, says what the record's coupling says."""
    ratio = 1.0
    offset = 0.0
    leader = name
    settled = {*record.joints, *record.locked}
    for _ in joints:
        mimic = joints[leader].mimic
        if mimic is None or leader in settled:
            break
        leader, ratio, offset = mimic[0], ratio * mimic[1], offset + ratio * mimic[2]
        if leader not in joints:
            return False
    coupling = record.coupled[name]
    written = (coupling["leader"], float(coupling.get("ratio", 1.0)), float(coupling.get("offset", 0.0)))
    return leader != name and written == (leader, ratio, offset)


def joint_ratios(record: RobotRecord, motors: Sequence[str]) -> dict[str, tuple[list[float], list[float]]]:
    """Derivatives of the positions of the joints to be moved by those of the planned joints, and of the motors."""
    ratios = {}
    for name in (*record.joints, *record.coupled):
        coupling = record.coupled.get(name, {"leader": name})
        leader = coupling["leader"]
        ratio = float(coupling.get("ratio", 1.0))
        motor, by_motor = (name, 1.0) if name in motors else (leader, ratio)
        by_joints = [ratio if joint == leader else 0.0 for joint in record.joints]
        ratios[name] = by_joints, [by_motor if name_of == motor else 0.0 for name_of in motors]
    return ratios


def carriers(urdf: Urdf) -> dict[str, tuple[str, ...]]:
    """Of each link and each joint's child the links on which it stands: itself, then those that it is fixed to."""
    standing: dict[str, tuple[str, ...]] = {urdf.root: (urdf.root,)}
    for joint in urdf.joints:
        further = standing[joint.parent] if joint.kind == "fixed" else ()
        standing[joint.child] = (joint.child, *further)
    return {joint.name: standing[joint.child] for joint in urdf.joints} | standing
