"""URDF files read: as XML, the single values in it, links and joints as data; reference postures of SRDF files.

Robots of the package ``example-robot-data`` are named ``example-robot-data:<path of the URDF in it>``, those that
another package has in its folder ``package:<its import name>/<path in it>``.
"""

import difflib
import hashlib
import math
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, install_advice
from floatplan.files import LARGEST_URDF, is_file, parsed_xml, read_regular
from floatplan.robot.urdf.packages import ADDRESS, description_path, file_inside, package_path, robot_content
from floatplan.tables import RobotKind

ROTATIONAL = ("revolute", "continuous")
MOVING = (*ROTATIONAL, "prismatic")
LARGEST = 1e9  # [SI] above every mass, inertia, length or angle; larger numbers overflow when squared twice
PREFIX = "example-robot-data:"
INSTALL_PREFIXES = ("/usr", "/usr/local", "/opt/openrobots")
FOLDER_VARIABLE = "EXAMPLE_ROBOT_DATA_MODEL_DIR"  # of the environment: the folder "robots" itself


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

    @property
    def in_link(self) -> Array:
        """Inertia (3, 3) about the centre of mass in the link's axes, exactly symmetric, as Pinocchio requires it."""
        return turned_inertia(self.origin.placement.rotation, self.inertia)


def turned_inertia(rotation: Array, inertia: Array) -> Array:
    """Return ``rotation @ inertia @ rotation.T`` (3, 3) without the rounding by which it is not symmetric."""
    product = rotation @ inertia @ rotation.T
    return np.asarray((product + product.T) / 2)


def rigid_body(parts: Iterable[tuple[Inertial, Any]]) -> tuple[float, Array, Array]:
    """Mass, kg, centre of mass (3,), m, and inertia (3, 3), kg m^2, about it, of links that are fixed to one another.

    Each link has the placement (``pinocchio.SE3``) of its frame; the axes are those of the placements.
    """
    links = [(own, placement * own.origin.placement) for own, placement in parts]
    mass = sum(own.mass for own, _ in links)
    center = sum((own.mass * placement.translation for own, placement in links), np.zeros(3)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for own, placement in links:
        arm = placement.translation - center
        inertia += turned_inertia(placement.rotation, own.inertia)
        inertia += own.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, center, inertia


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A link; ``inertial`` is None where the file has none or all zeros; ``collisions`` are its XML elements.

    ``frame``: it only stands between joints, of an MJCF's body or of a base that floats, and has no shape at all.
    """

    name: str
    inertial: Inertial | None
    collisions: tuple[Element, ...]
    frame: bool = False


@dataclass(frozen=True)
class Mimic:
    """``position = multiplier * position of joint + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint from ``parent`` to ``child`` with unit ``axis`` (3,) in its own frame.

    ``lower`` and ``upper`` (rad or m), ``velocity`` and ``effort`` are infinite where the file has none;
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


@dataclass(frozen=True, eq=False)
class UrdfText:
    """A robot's file as read: as a URDF, the text and its root element; the SHA-256 of its bytes.

    Of an MJCF, ``files`` are the SHA-256 of the files that it includes or names, by their paths from its folder,
    ``keyframes`` its reference postures, ``gravity_direction`` is as of :class:`~floatplan.robot.robot.Robot`, and
    ``warnings`` are about properties that a URDF has not.
    """

    path: Path
    xml: str
    sha256: str
    root: Element
    kind: RobotKind = "urdf"
    files: Mapping[str, str] = field(default_factory=dict)
    keyframes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    gravity_direction: Array | None = None


def read_xml(path: Path) -> tuple[bytes, Element]:
    """Return the content of a robot's file, and its root element.

    Raises
    ------
    InputError
        If the file is missing, a directory, unreadable, empty, binary, truncated, or not XML.
    """
    advice = {  # about files that are often taken for the robot's
        ".toml": "give the file that its key robot.urdf or robot.mjcf names",
        ".json": "give the URDF or MJCF that it was made with",
    }.get(path.suffix.lower())
    if advice is not None and is_file(path):
        raise InputError(f"is a {path.suffix[1:].upper()} file, not a robot's", source=path, advice=advice)
    content = robot_content(path)
    if not content.strip():
        raise InputError("is empty", source=path)
    return content, parsed_xml(content, path)


def urdf_text(path: Path, content: bytes, root: Element) -> UrdfText:
    """Return a URDF file as read, from its content and root element; InputError where that has no link."""
    if root.find("link") is None:
        raise InputError("has no <link>", source=path, advice=_why_no_links(path, root))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:  # in another encoding: written again
        text = tostring(root, encoding="unicode")
    return UrdfText(path, text, hashlib.sha256(content).hexdigest(), root)


def _why_no_links(path: Path, root: Element) -> str:
    """What to do about a file without links, by what it is: xacro's, with or without its ending, or an SRDF."""
    if path.suffix.lower() == ".xacro":
        macros = b":macro" in read_regular(path, LARGEST_URDF, "a xacro file")
        if macros:
            return "xacro makes a robot without links of it, as it only defines macros: give the file that calls them"
        return "xacro makes a robot without links of it: give the file that has them, or includes those that do"
    xacro = ("{http://www.ros.org/wiki/xacro}", "{http://wiki.ros.org/xacro}", "{http://ros.org/wiki/xacro}")
    if any(element.tag.startswith(xacro) for element in root.iter()):
        return "it is a xacro file: let its name end in .xacro"
    of_srdf = ("group", "group_state", "end_effector", "virtual_joint", "disable_collisions", "rotor_params")
    if any(element.tag in of_srdf for element in root):
        return "it is an SRDF, which says more about a robot: give the URDF itself"
    return "a URDF has one for each part of the robot"


def only(where: str, element: Element, tag: str) -> Element | None:
    """The child of ``element`` called ``tag``, None where there is none, an error where there are several."""
    children = element.findall(tag)
    if len(children) > 1:
        raise InputError(f"has {len(children)} <{tag}> elements, where one is allowed", element=where)
    return children[0] if children else None


def number(where: str, element: Element, key: str, default: float | None, largest: float = LARGEST) -> float:
    """A number from attribute ``key``; ``default`` where it is left out, an error if that is None."""
    text = element.get(key)
    if text is not None:
        return _parsed(f"{where}: {key}", text, largest)
    if default is None:
        raise InputError(f"has no {key}", element=where)
    return default


def triple(where: str, element: Element | None, key: str, default: tuple[float, float, float]) -> Array:
    """Three finite numbers from attribute ``key``; ``default`` where it or the element is left out."""
    text = None if element is None else element.get(key)
    if text is None:
        return read_only(default)
    words = text.split()
    if len(words) != 3:
        raise InputError(f'must be three numbers, not "{text}"', element=where)
    return read_only([_parsed(where, word, LARGEST) for word in words])


def _parsed(where: str, text: str, largest: float) -> float:
    try:
        value = math.nan if "_" in text else float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise InputError(f'must be a number, not "{text}"', element=where)
    if abs(value) > largest:
        reason = "must be a finite number, not" if math.isinf(value) else "is larger than any robot's:"
        raise InputError(f'{reason} "{text.strip()}"', element=where)
    return value


def is_address(source: object) -> bool:
    """Whether a robot's file is named by the package that it is in, not by a path."""
    return isinstance(source, str) and (source.startswith(PREFIX) or ADDRESS.fullmatch(source) is not None)


def urdf_path(source: str | Path, kind: RobotKind | None = None) -> Path:
    """Return the file that ``source`` means: a path, or its address in a package.

    That is ``example-robot-data:`` and a path in that package; ``package:``, the import name of any other and a path in
    its folder; or the name of a robot of robot_descriptions, such as ``go2_description``, with or without
    ``robot_descriptions:``.

    Raises
    ------
    InputError
        If the package is not installed, or holds no such file.
    """
    if not isinstance(source, str) or not is_address(source):
        refuse_bare_name(Path(source))
        return Path(source)
    if source.startswith("package:"):
        return package_path(source)
    if not source.startswith(PREFIX):
        return description_path(source, kind)
    folder = robots_folder()
    if folder is None:
        advice = f'{install_advice("robots")}, or set {FOLDER_VARIABLE} to its folder "robots"'
        raise InputError("the package example-robot-data is not installed", source=source, advice=advice)
    name = source.removeprefix(PREFIX)
    path = file_inside(folder, name)
    if path is None:
        raise InputError(f"example-robot-data has no file {name!r}", source=source, advice=_similar(folder, name))
    return path


def refuse_bare_name(path: Path) -> None:
    """Refuse what is no file but the bare name of a robot of example-robot-data, with its address as advice.

    Raises
    ------
    InputError
        There is no such file, and a robot of that name.
    """
    meant = None if path.suffix or len(path.parts) != 1 or path.exists() else _address_of(path.name)
    if meant is not None:
        advice = f'did you mean "{meant}"? floatplan robots lists all'
        raise InputError("no such file", source=path, advice=advice)


def _address_of(name: str) -> str | None:
    """The address of a robot of example-robot-data whose file or folder has a name; None where there is none."""
    word = name.lower()
    for urdf in example_urdfs():
        if word == Path(urdf).stem.lower():
            return f"{PREFIX}{urdf}"
    for urdf in example_urdfs():
        folder = Path(urdf).parts[0].lower()
        if word == re.sub("(_description|_data)$", "", folder):  # such endings follow the robot's name
            return f"{PREFIX}{urdf}"
    return None


def robots_folder() -> Path | None:
    """Return the folder ``robots`` of example-robot-data, None where it is not installed.

    Searched in the environment variable, in the installed package's list of files, and in the share folders of the
    interpreter, of ROS and of the system.
    """
    return next((folder for folder in _candidates() if folder.is_dir()), None)


def example_urdfs() -> tuple[str, ...]:
    """Names, without the prefix, of all URDFs in the package; empty where it is not installed."""
    folder = robots_folder()
    if folder is None:
        return ()
    return tuple(sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.urdf")))


def _candidates() -> Iterator[Path]:
    if folder := os.environ.get(FOLDER_VARIABLE):
        yield Path(folder)
    if (distributed := _of_distribution()) is not None:
        yield distributed
    prefixes = [
        sys.prefix,
        *os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep),
        *INSTALL_PREFIXES,
    ]
    for prefix in prefixes:
        if prefix:
            yield Path(prefix, "share", "example-robot-data", "robots")


@cache
def _of_distribution() -> Path | None:
    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        return None
    for file in files:
        if file.suffix == ".urdf" and "robots" in file.parts:
            depth = len(file.parts) - 1 - file.parts.index("robots")
            return Path(str(file.locate())).parents[depth - 1]
    return None


def _similar(folder: Path, name: str) -> str | None:
    names = example_urdfs()
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    stem = Path(name).stem.lower()
    close += [other for other in names if stem in other.lower() and other not in close][:3]
    return f"it has {', '.join(close)}" if close else f"its robots are in {folder}"
