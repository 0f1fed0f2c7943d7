"""From XML to a :class:`UrdfTree`: every fault that Pinocchio would accept, drop or crash on is refused here."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element, tostring

import numpy as np

from floatplan.arguments import without
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, check_name
from floatplan.robot.urdf.base import with_free_base
from floatplan.robot.urdf.inertias import Payload, with_payload, with_sound_inertias
from floatplan.robot.urdf.tree import (
    LARGEST,
    MOVING,
    Inertial,
    Mimic,
    Origin,
    UrdfJoint,
    UrdfLink,
    UrdfText,
    UrdfTree,
    number,
    only,
    triple,
)
from floatplan.robot.urdf.written import urdf_of
from floatplan.tables import FREE_TYPES, RANGES

MOST_JOINTS = 150  # [-] that move: Pinocchio's workspace grows as their cube, and thousands exhaust the memory
MOST_FIXED_JOINTS = 2000  # [-] ten times those of any robot; URDF readers that recurse link by link bear 3000
LIMITS = "limits of"  # beginning of the warnings about limits that are ignored
AXISLESS = ("fixed", "floating")  # types of joints
WITHOUT_RANGE = ("continuous", *AXISLESS, "planar")


@dataclass(frozen=True)
class LargestLimits:
    """Limits as large as these are placeholders of a file."""

    angle: float = 1e3  # [rad] nobody means 159 turns
    rate: float = 1e3  # [rad/s]
    torque: float = 1e4  # [N m]
    torque_with_rate: float = 1e3  # [N m] where the rate limit is a placeholder, too


LARGEST_LIMITS = LargestLimits()


@dataclass(frozen=True)
class Changes:
    """Differences between a robot and its URDF.

    Attributes
    ----------
    balance_inertias : whether inertias that no body can have are balanced, see :func:`with_sound_inertias`
    payload : point masses that links carry
    with_role : joints that the user names: joints by which the file lets its base float stay joints where all are
        locked
    """

    balance_inertias: bool = False
    payload: tuple[Payload, ...] = ()
    with_role: Collection[str] = ()


def check_urdf(root: Element, with_role: Collection[str] = ()) -> UrdfTree:
    """Return the links and joints of a ``<robot>`` element, its own free base read as such.

    ``with_role`` as of :class:`Changes`.

    Raises
    ------
    InputError
        If a name is missing or used twice, a number is not a finite number, an inertia is impossible, an axis is zero,
        limits are crossed, a joint's type is unknown, there are too many joints, or links and joints do not form one
        tree.
    """
    return _without_placeholders(_changed(read_tree(root), Changes(with_role=with_role)))


def taken_urdf(text: UrdfText, changes: Changes) -> tuple[UrdfText, UrdfTree]:
    """Return a robot as it is taken, as a URDF and as a tree; errors as of :func:`check_urdf`.

    The URDF is the file's own where it says all of it.
    """
    read = read_tree(text.root)
    tree = _changed(read, changes)
    if text.kind == "urdf":  # in that of an MJCF zeros are written where it gives no limit
        tree = replace(tree, warnings=(*tree.warnings, *_zero_limits(tree, text.root)))
    root = urdf_of(tree, read, text.root)
    if root is not text.root:
        text = replace(text, root=root, xml=tostring(root, encoding="unicode"))
    return text, _without_placeholders(tree)


def _changed(tree: UrdfTree, changes: Changes) -> UrdfTree:
    tree = with_free_base(tree, changes.with_role)
    tree = with_sound_inertias(tree, changes.balance_inertias)
    return with_payload(tree, changes.payload)


def read_tree(root: Element) -> UrdfTree:
    """Return links and joints as they are written, whose inertias are not checked; errors as :func:`check_urdf`."""
    joint_elements = root.findall("joint")
    _check_counts(joint_elements)
    link_elements = _by_name("link", root.findall("link"))
    named = _by_name("joint", joint_elements)
    if not link_elements:
        raise InputError("has no <link>", advice="a URDF has one for each part of the robot")
    name = (root.get("name") or "").strip()
    if not name:
        raise InputError("has no name", element="<robot>", advice='write <robot name="...">')
    check_name(name, "<robot>")
    links = {}
    for link, element in link_elements.items():
        inertial = _read_inertial(f'link "{link}"', element)
        links[link] = UrdfLink(link, inertial, tuple(element.findall("collision")), element.get("type") == "frame")
    joints = [_read_joint(joint, element, named) for joint, element in named.items()]
    base, ordered = _order(links, joints)
    return UrdfTree(name, base, links, ordered, ())


def _check_counts(joints: Sequence[Element]) -> None:
    """Refuse more joints than can be handled; those that are fixed cost little."""
    fixed = sum(joint.get("type") == "fixed" for joint in joints)
    for count, most, which in ((len(joints) - fixed, MOST_JOINTS, "that move"), (fixed, MOST_FIXED_JOINTS, "fixed")):
        if count > most:
            words = f"{count} joints {which}" if which != "fixed" else f"{count} fixed joints"
            raise InputError(f"has {words}, more than the {most} that can be handled")


def _by_name(kind: str, elements: Iterable[Element]) -> dict[str, Element]:
    named: dict[str, Element] = {}
    for position, element in enumerate(elements, start=1):
        name = element.get("name")
        if not name or not name.strip():
            raise InputError("has no name", element=f"<{kind}> number {position}", advice='write name="..."')
        check_name(name, f"<{kind}> number {position}")
        if name in named:
            raise InputError(f"two {kind}s have this name", element=f'{kind} "{name}"', advice="rename one of them")
        if name == "universe":
            raise InputError("Pinocchio keeps this name for the world", element=f'{kind} "{name}"', advice="rename it")
        named[name] = element
    return named


def _read_inertial(where: str, link: Element) -> Inertial | None:
    element = only(where, link, "inertial")
    if element is None:
        return None
    origin = read_origin(where, element)
    mass_element = only(where, element, "mass")
    moments = only(where, element, "inertia")
    if mass_element is None:
        advice = 'write <mass value="..."/>, in kg; of a link that weighs nothing remove the <inertial>'
        raise InputError("has no <mass>", element=f"{where}: inertial", advice=advice)
    mass = number(f"{where}: mass", mass_element, "value", None)
    if mass < 0.0:
        raise InputError(f"is negative: {mass:g} kg", element=f"{where}: mass")
    if 0.0 < mass < RANGES["mass"].low:
        raise InputError(f"is smaller than any part's: {mass:g} kg", element=f"{where}: mass", advice="write 0")
    moment = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 0.0)
    if moments is not None:
        for key in moment:
            moment[key] = number(f"{where}: inertia", moments, key, None)
    xx, xy, xz, yy, yz, zz = moment.values()
    inertia = read_only([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(origin, mass, inertia) if mass > 0.0 or inertia.any() else None


def read_origin(where: str, element: Element) -> Origin:
    """Return the ``<origin>`` of an element, the identity where it has none."""
    origin = only(where, element, "origin")
    xyz = triple(f"{where}: origin xyz", origin, "xyz", (0.0, 0.0, 0.0))
    return Origin(xyz, triple(f"{where}: origin rpy", origin, "rpy", (0.0, 0.0, 0.0)))


def _read_joint(name: str, element: Element, joints: Collection[str]) -> UrdfJoint:
    where = f'joint "{name}"'
    kind = element.get("type")
    types = (*MOVING, "fixed", *FREE_TYPES)
    if kind not in types:
        reason = f'has type "{kind}", which URDF does not have' if kind else "has no type"
        raise InputError(reason, element=where, advice=f"give one of {', '.join(types)}")
    ends = []
    for tag in ("parent", "child"):
        end = only(where, element, tag)
        ends.append("" if end is None else end.get("link", ""))
        if not ends[-1]:
            raise InputError(f"has no {tag} link", element=where)
    lower, upper, velocity, effort = _read_limits(f"{where}: limit", kind, only(where, element, "limit"))
    origin = read_origin(where, element)
    axis = _read_axis(where, element, kind)
    mimic = _read_mimic(f"{where}: mimic", name, only(where, element, "mimic"), joints)
    dynamics = only(where, element, "dynamics")
    motor = {}
    for key in ("armature", "damping", "friction"):
        if dynamics is not None and key in dynamics.attrib:
            motor[key] = _magnitude(f"{where}: dynamics", dynamics, key, None)
    return UrdfJoint(name, kind, ends[0], ends[1], origin, axis, lower, upper, velocity, effort, mimic, **motor)


def _magnitude(where: str, element: Element, key: str, default: float | None, largest: float = LARGEST) -> float:
    value = number(where, element, key, default, largest)
    if value < 0.0:
        raise InputError(f"{key} {value:g} is negative", element=where)
    return value


def _read_axis(where: str, element: Element, kind: str) -> Array:
    axis = only(where, element, "axis")
    if axis is not None and kind not in AXISLESS and axis.get("xyz") is None:
        raise InputError(
            "has no xyz", element=f"{where}: axis", advice='write xyz="...", or leave <axis> out for 1 0 0'
        )
    vector = triple(f"{where}: axis", axis, "xyz", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(vector))
    if kind in AXISLESS:
        return read_only((1.0, 0.0, 0.0))
    if length < 1e-9:  # no direction can be read from it
        raise InputError("has zero length", element=f"{where}: axis")
    return vector if length == 1.0 else read_only(vector / length)


def _read_limits(where: str, kind: str, limits: Element | None) -> tuple[float, float, float, float]:
    """Limits of position, velocity and effort; infinite where they are zero or left out, or the joint has none."""
    if limits is None:
        return -math.inf, math.inf, math.inf, math.inf
    lower = upper = 0.0
    if kind not in WITHOUT_RANGE:
        lower = number(where, limits, "lower", 0.0, math.inf)
        upper = number(where, limits, "upper", 0.0, math.inf)
    if lower > upper:
        raise InputError(f"lower {lower:g} exceeds upper {upper:g}", element=where)
    if lower == upper == 0.0:
        lower = -math.inf
        upper = math.inf
    velocity = _magnitude(where, limits, "velocity", 0.0, math.inf)
    effort = _magnitude(where, limits, "effort", 0.0, math.inf)
    return lower, upper, velocity or math.inf, effort or math.inf


def _read_mimic(where: str, name: str, mimic: Element | None, joints: Collection[str]) -> Mimic | None:
    if mimic is None:
        return None
    leader = mimic.get("joint")
    if not leader:
        raise InputError("names no joint", element=where, advice='write joint="..."')
    if leader not in joints:
        raise InputError(f'names joint "{leader}", which does not exist', element=where)
    if leader == name:
        raise InputError("a joint cannot mimic itself", element=where)
    return Mimic(leader, number(where, mimic, "multiplier", 1.0), number(where, mimic, "offset", 0.0))


def _zero_limits(tree: UrdfTree, root: Element) -> list[str]:
    """The warnings about joints that move, and whose range is written as 0 to 0 or left out of their ``<limit>``.

    Exporters write all four numbers as zero where nobody chose them. Of a joint with a range, zero as a rate or torque
    is the usual way to write that there is no such limit, and no warning.
    """
    zero: dict[str, list[str]] = {"position": [], "velocity": [], "effort": []}
    for element in root.iterfind("joint[limit]"):
        joint = tree.joint[element.get("name", "")]
        limits = element.find("limit")
        if not joint.moves or joint.type in WITHOUT_RANGE or limits is None:
            continue
        is_zero = {key: float(limits.get(key, "0")) == 0.0 for key in ("lower", "upper", "velocity", "effort")}
        if is_zero["lower"] and is_zero["upper"]:
            zero["position"].append(joint.name)
            for kind in ("velocity", "effort"):
                if is_zero[kind]:
                    zero[kind].append(joint.name)
    return _limit_warnings("that are zero", zero)


def _limit_warnings(reason: str, joints: Mapping[str, Sequence[str]]) -> list[str]:
    """A warning for each kind of limit that is ignored for some joints."""
    warnings = []
    for kind, names in joints.items():
        if names:
            warnings.append(f"{LIMITS} {kind} {reason}, taken as not given: {', '.join(names)}")
    return warnings


def _without_placeholders(tree: UrdfTree) -> UrdfTree:
    """Make limits infinite that are too large to be meant, with a warning for each kind."""
    joints: list[UrdfJoint] = []
    dropped: dict[str, list[str]] = {"position": [], "velocity": [], "effort": []}
    for joint in tree.joints:
        fast = joint.turns and LARGEST_LIMITS.rate <= joint.velocity < math.inf
        largest_torque = LARGEST_LIMITS.torque_with_rate if fast else LARGEST_LIMITS.torque
        strong = joint.turns and largest_torque <= joint.effort < math.inf
        wide = joint.turns and LARGEST_LIMITS.angle <= max(-joint.lower, joint.upper) < math.inf
        if wide:
            joint = replace(joint, lower=-math.inf, upper=math.inf)
            dropped["position"].append(joint.name)
        if fast:
            joint = replace(joint, velocity=math.inf)
            dropped["velocity"].append(joint.name)
        if strong:
            joint = replace(joint, effort=math.inf)
            dropped["effort"].append(joint.name)
        joints.append(joint)
    warnings = _limit_warnings("too large to be meant", dropped)
    return replace(tree, joints=tuple(joints), warnings=(*tree.warnings, *warnings))


def _order(links: Collection[str], joints: Sequence[UrdfJoint]) -> tuple[str, tuple[UrdfJoint, ...]]:
    """Return the root link and the joints, parents before children and siblings by name."""
    carrier: dict[str, UrdfJoint] = {}
    children: dict[str, list[UrdfJoint]] = {name: [] for name in links}
    for joint in sorted(joints, key=lambda joint: joint.name):
        where = f'joint "{joint.name}"'
        for kind, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise InputError(f'its {kind} link "{link}" does not exist', element=where)
        if joint.child == joint.parent:
            raise InputError(f'joins link "{joint.child}" to itself', element=where)
        if joint.child in carrier:
            reason = f'has two parents: joints "{carrier[joint.child].name}" and "{joint.name}" both carry it'
            raise InputError(reason, element=f'link "{joint.child}"', advice="a URDF robot is a tree")
        carrier[joint.child] = joint
        children[joint.parent].append(joint)
    roots = [name for name in links if name not in carrier]
    if not roots:
        raise InputError(f"the joints form a loop: {_loop(carrier)}; no link is the root")
    if len(roots) > 1:
        listed = ", ".join(f'"{name}"' for name in roots[:5])
        reason = f"has {len(roots)} root links ({listed}), so parts of it are detached"
        raise InputError(reason, advice="connect them by a joint")

    ordered: list[UrdfJoint] = []
    waiting = children[roots[0]][::-1]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += children[joint.child][::-1]
    if len(ordered) < len(joints):
        attached = {joint.child for joint in ordered}
        loop = _loop(without(carrier, attached))
        raise InputError(f'the joints form a loop, detached from the root link "{roots[0]}": {loop}')
    return roots[0], tuple(ordered)


def _loop(carrier: Mapping[str, UrdfJoint]) -> str:
    """Links of one loop, written ``a - b - a``; every link in ``carrier`` has a parent in it or leads to a loop."""
    link = next(iter(carrier))
    seen: list[str] = []
    while link not in seen:
        seen.append(link)
        link = carrier[link].parent
    return " - ".join([link, *reversed(seen[seen.index(link) :])])
