"""Robots drawn at random over everything that a URDF can hold and floatplan plans with.

Branched trees in any of the three planes; link frames turned at random; axes slightly off the plane's normal; followers
by ``<mimic>`` or by the user; locked joints that turn or slide; collision geometry of every kind, or none.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.tables import LARGEST_TILT

PLANES = ("xy", "xz", "yz")
SHAPES = ("box", "cylinder", "sphere", "capsule", "mesh")
MOST_PLANNED = 5
FULL_RANGE = (-math.pi, math.pi)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
TRIANGLES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


@dataclass
class _Tip:
    """Where a next link can be joined: a link, its frame's rotation in the root link, and a place in that frame."""

    link: str
    rotation: Rotation
    place: np.ndarray


@dataclass
class _Drawing:
    """A URDF in the making, and how it is to be loaded."""

    rng: np.random.Generator
    folder: Path
    plane: str
    document: ET.Element
    planned: list[str] = field(default_factory=list)
    coupled: dict[str, fp.Coupling] = field(default_factory=dict)
    locked: dict[str, float] = field(default_factory=dict)
    tips: list[_Tip] = field(default_factory=list)

    @property
    def axes(self) -> np.ndarray:
        """Horizontal, vertical and normal of the plane (3, 3), in the root link."""
        unit = dict(zip("xyz", np.eye(3), strict=True))
        (left_out,) = set("xyz") - set(self.plane)
        return np.array([unit[self.plane[0]], unit[self.plane[1]], unit[left_out]])

    def chance(self, probability: float) -> bool:
        """Toss a coin."""
        return bool(self.rng.random() < probability)


def witness_robot(rng: np.random.Generator, folder: Path) -> fp.Robot:
    """Write a random robot into a folder, which is to stay as long as the robot, and load it."""
    drawing = _Drawing(rng, folder, str(rng.choice(PLANES)), ET.Element("robot", name="drawn"))
    base = _add_link(drawing, "base", Rotation.identity(), size=1.0)
    for branch in range(int(rng.integers(1, 4))):
        end = base if drawing.chance(0.5) else _Tip("base", Rotation.identity(), np.zeros(3))
        for number in range(int(rng.integers(1, 4))):
            if len(drawing.planned) == MOST_PLANNED:
                break
            name = f"{branch}{number}"
            end = _add_moving(drawing, end, f"j{name}", f"L{name}", None)
        if end.link != "base":
            drawing.tips.append(end)
    _add_followers(drawing)
    _add_locked(drawing)
    for index, end in enumerate(drawing.tips):
        ET.SubElement(drawing.document, "link", name=f"tip{index}")
        _add_joint(drawing, f"fix{index}", "fixed", end, f"tip{index}", end.rotation)
    path = folder / "drawn.urdf"
    ET.ElementTree(drawing.document).write(path, encoding="unicode")
    by_user = {name: coupling for name, coupling in drawing.coupled.items() if not _is_mimic(drawing, name)}
    return fp.Robot.from_urdf(
        path, plane=drawing.plane, joints=drawing.planned, coupled=by_user or None, locked=drawing.locked or None
    )


def _is_mimic(drawing: _Drawing, name: str) -> bool:
    return any(joint.get("name") == name and joint.find("mimic") is not None for joint in drawing.document)


def _add_moving(drawing: _Drawing, end: _Tip, joint: str, link: str, coupling: fp.Coupling | None) -> _Tip:
    """Add a joint that turns in the plane with its link; planned where there is no coupling."""
    rng = drawing.rng
    rotation = Rotation.random(random_state=rng) if drawing.chance(0.5) else end.rotation
    kind = "continuous" if coupling is None and drawing.chance(0.25) else "revolute"
    element = _add_joint(drawing, joint, kind, end, link, rotation)
    _set_axis(drawing, element, rotation)
    if kind == "revolute":
        low, high = (-6.0, 6.0) if coupling else (-rng.uniform(1.2, 2.6), rng.uniform(1.2, 2.6))
        effort, velocity = rng.uniform(20, 90), rng.uniform(8, 30)
        numbers = {"lower": low, "upper": high, "effort": effort, "velocity": velocity}
        ET.SubElement(element, "limit", {key: repr(float(value)) for key, value in numbers.items()})
    if coupling is None:
        drawing.planned.append(joint)
    else:
        drawing.coupled[joint] = coupling
        if drawing.chance(0.5):
            multiplier, offset = repr(coupling.ratio), repr(coupling.offset)
            ET.SubElement(element, "mimic", joint=coupling.leader, multiplier=multiplier, offset=offset)
    return _add_link(drawing, link, rotation, size=rng.uniform(0.3, 0.8))


def _add_followers(drawing: _Drawing) -> None:
    rng = drawing.rng
    for number in range(int(rng.choice([0, 1, 2], p=[0.5, 0.3, 0.2]))):
        end = drawing.tips[int(rng.integers(len(drawing.tips)))]
        leader, ratio = str(rng.choice(drawing.planned)), float(rng.choice([-1.3, -1.0, 0.5, 1.0, 2.0]))
        coupling = fp.Coupling(leader, ratio, float(rng.uniform(-0.3, 0.3)))
        _add_moving(drawing, end, f"f{number}", f"F{number}", coupling)


def _add_locked(drawing: _Drawing) -> None:
    """Add links on joints that are held: those that turn do so about any axis, those that slide along any."""
    rng = drawing.rng
    for number in range(int(rng.choice([0, 1, 2], p=[0.5, 0.3, 0.2]))):
        end = drawing.tips[int(rng.integers(len(drawing.tips)))]
        slides = drawing.chance(0.5)
        rotation = Rotation.random(random_state=rng)
        joint = _add_joint(drawing, f"k{number}", "prismatic" if slides else "revolute", end, f"K{number}", rotation)
        axis = rng.normal(size=3)
        ET.SubElement(joint, "axis", xyz=_text(axis / np.linalg.norm(axis)))
        reach = 0.1 if slides else 1.0
        ET.SubElement(joint, "limit", lower=repr(-reach), upper=repr(reach), effort="0.0", velocity="0.0")
        drawing.locked[f"k{number}"] = float(rng.uniform(-reach, reach))
        _add_link(drawing, f"K{number}", rotation, size=0.2)


def _add_joint(drawing: _Drawing, name: str, kind: str, end: _Tip, child: str, rotation: Rotation) -> ET.Element:
    joint = ET.SubElement(drawing.document, "joint", name=name, type=kind)
    _set_origin(joint, end.place, end.rotation.inv() * rotation)
    ET.SubElement(joint, "parent", link=end.link)
    ET.SubElement(joint, "child", link=child)
    return joint


def _set_axis(drawing: _Drawing, joint: ET.Element, rotation: Rotation) -> None:
    """Along or against the plane's normal, every third slightly off it."""
    axis = drawing.axes[2] * (1 if drawing.chance(0.5) else -1)
    if drawing.chance(1 / 3):
        turn = drawing.axes[:2].T @ drawing.rng.normal(size=2)
        angle = 0.9 * LARGEST_TILT * drawing.rng.random()
        axis = Rotation.from_rotvec(angle * turn / np.linalg.norm(turn)).apply(axis)
    ET.SubElement(joint, "axis", xyz=_text(rotation.inv().apply(axis)))


def _set_origin(element: ET.Element, place: np.ndarray, turn: Rotation) -> None:
    ET.SubElement(element, "origin", xyz=_text(place), rpy=_text(turn.as_euler("xyz")))


def _add_link(drawing: _Drawing, name: str, rotation: Rotation, size: float) -> _Tip:
    """Add a link whose frame is turned by ``rotation``: a rod in the plane, as heavy as its length; return its end."""
    rng, axes = drawing.rng, drawing.axes
    angle, length = rng.uniform(-math.pi, math.pi), size * rng.uniform(0.25, 0.45)
    along = math.cos(angle) * axes[0] + math.sin(angle) * axes[1]
    across, normal = np.cross(axes[2], along), axes[2]
    in_frame = rotation.inv() * Rotation.from_matrix(
        np.array([across, normal, along]).T * _handedness(across, normal, along)
    )
    mass = 4.0 * length * rng.uniform(0.7, 1.3)
    thickness = length * rng.uniform(0.1, 0.3)
    link = ET.SubElement(drawing.document, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    centre = rotation.inv().apply(along) * length * rng.uniform(0.3, 0.7)
    _set_origin(inertial, centre, in_frame)
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    across_moment = mass * (length**2 / 12 + thickness**2 / 4)
    moments = {"ixx": across_moment, "iyy": across_moment, "izz": mass * thickness**2 / 2}
    zeros = dict.fromkeys(("ixy", "ixz", "iyz"), "0.0")
    ET.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in moments.items()} | zeros)
    for _ in range(int(rng.choice([0, 1, 2], p=[0.3, 0.55, 0.15]))):
        _add_collision(drawing, link, rotation.inv().apply(along) * length / 2, in_frame, length, thickness)
    return _Tip(name, rotation, rotation.inv().apply(along) * length)


def _handedness(*axes: np.ndarray) -> np.ndarray:
    """Signs (3,) of the columns that make them a rotation."""
    return np.array([1.0, np.sign(np.linalg.det(np.array(axes))), 1.0])


def _add_collision(
    drawing: _Drawing, link: ET.Element, middle: np.ndarray, along: Rotation, length: float, thickness: float
) -> None:
    """Add a shape about a link's middle, its long axis z nearly along the link."""
    rng = drawing.rng
    collision = ET.SubElement(link, "collision")
    wobble = Rotation.from_rotvec(rng.normal(size=3) * 0.15)
    _set_origin(collision, middle + rng.normal(size=3) * 0.02 * length, along * wobble)
    geometry = ET.SubElement(collision, "geometry")
    kind = str(rng.choice(SHAPES))
    long, wide = length * rng.uniform(0.6, 1.0), thickness * rng.uniform(0.6, 1.2)
    if kind == "box":
        ET.SubElement(geometry, kind, size=_text([wide, wide * rng.uniform(0.5, 2), long]))
    elif kind == "sphere":
        ET.SubElement(geometry, kind, radius=repr(float(wide)))
    elif kind == "mesh":
        filename = f"{link.get('name')}_{len(link)}.stl"
        corners = CORNERS * [wide / 2, wide / 2, long / 2] * rng.uniform(0.6, 1.0, (len(CORNERS), 3))
        (drawing.folder / filename).write_text(_stl(corners), encoding="ascii")
        ET.SubElement(geometry, kind, filename=filename)
    else:
        ET.SubElement(geometry, kind, radius=repr(float(wide / 2)), length=repr(float(long)))


def _stl(corners: np.ndarray) -> str:
    """An STL file in text of the hexahedron with these corners (8, 3)."""
    lines = ["solid drawn"]
    for triangle in TRIANGLES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {_text(corners[corner])}" for corner in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid drawn", ""])


def _text(numbers: np.ndarray | list[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
