"""From XML to a :class:`UrdfTree`: every fault that Pinocchio would accept, drop or crash on is refused here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, check_name
from floatplan.robot.urdf.inertia import check_inertias
from floatplan.robot.urdf.tree import Inertial, Mimic, Origin, UrdfJoint, UrdfLink, UrdfTree
from floatplan.robot.urdf.values import limit, number, only, triple

LARGEST_ANGLE = 1e3  # [rad] limits this large are placeholders: nobody means 159 turns
LARGEST_RATE = 1e3  # [rad/s] the same
LARGEST_TORQUE = 1e4  # [N m] the same
LARGEST_TORQUE_BESIDE_RATE = 1e3  # [N m] beside a rate limit that is a placeholder
MOST_JOINTS = 150  # [-] Pinocchio's workspace grows as the cube of the joints; thousands exhaust the memory
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed")
SMALLEST_MASS = 1e-15  # [kg] of a link that has any
SHORTEST_AXIS = 1e-9  # [-] length as written


def check_urdf(root: Element) -> UrdfTree:
    """Return the links and joints of a ``<robot>`` element.

    Raises
    ------
    InputError
        If a name is missing or used twice, a number is not a finite number, an inertia is impossible, an axis is zero,
        limits are crossed, a joint's type is unknown, there are too many joints, or links and joints do not form one
        tree.
    """
    joint_elements = root.findall("joint")
    if len(joint_elements) > MOST_JOINTS:
        raise InputError(f"has {len(joint_elements)} joints, more than the {MOST_JOINTS} that can be handled")
    links = _by_name("link", root.findall("link"))
    joints = _by_name("joint", joint_elements)
    if not links:
        raise InputError("has no <link>", advice="if it is a xacro file, run xacro on it first")
    name = (root.get("name") or "").strip()
    if not name:
        raise InputError("has no name", element="<robot>", advice='write <robot name="...">')
    check_name(name, "<robot>")
    read_links = {link: _read_link(link, element) for link, element in links.items()}
    read_joints = [_read_joint(joint, element) for joint, element in joints.items()]
    base, ordered = _order(read_links, read_joints)
    for joint in ordered:
        _check_mimic(joint, joints)
    warnings = check_inertias(read_links, ordered)
    ordered, dropped = _drop_placeholders(ordered)
    return UrdfTree(name, base, read_links, ordered, (*warnings, *dropped))


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


def _read_link(name: str, element: Element) -> UrdfLink:
    return UrdfLink(name, _read_inertial(f'link "{name}"', element), tuple(element.findall("collision")))


def _read_inertial(place: str, link: Element) -> Inertial | None:
    element = only(place, link, "inertial")
    if element is None:
        return None
    origin = read_origin(place, element)
    mass_element = only(place, element, "mass")
    mass = 0.0 if mass_element is None else number(f"{place}: mass", mass_element, "value", None)
    if mass < 0.0:
        raise InputError(f"is negative: {mass:g} kg", element=f"{place}: mass")
    if 0.0 < mass < SMALLEST_MASS:
        raise InputError(f"is smaller than any part's: {mass:g} kg", element=f"{place}: mass", advice="write 0")
    inertia = _read_inertia(f"{place}: inertia", only(place, element, "inertia"))
    return Inertial(origin, mass, inertia) if mass > 0.0 or inertia.any() else None


def _read_inertia(place: str, element: Element | None) -> Array:
    if element is None:
        return read_only(np.zeros((3, 3)))
    xx, xy, xz, yy, yz, zz = (number(place, element, key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    return read_only([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _read_joint(name: str, element: Element) -> UrdfJoint:
    place = f'joint "{name}"'
    kind = element.get("type")
    if kind not in JOINT_TYPES:
        known = ", ".join(JOINT_TYPES)
        raise InputError(f'has type "{kind}"' if kind else "has no type", element=place, advice=f"give one of {known}")
    limits = only(place, element, "limit")
    lower, upper = _read_range(f"{place}: limit", kind, limits)
    return UrdfJoint(
        name=name,
        type=kind,
        parent=_read_end(place, element, "parent"),
        child=_read_end(place, element, "child"),
        origin=read_origin(place, element),
        axis=_read_axis(place, element, kind),
        lower=lower,
        upper=upper,
        velocity=_read_bound(f"{place}: limit", limits, "velocity"),
        effort=_read_bound(f"{place}: limit", limits, "effort"),
        mimic=_read_mimic(place, element),
    )


def _read_end(place: str, element: Element, kind: str) -> str:
    end = only(place, element, kind)
    link = None if end is None else end.get("link")
    if not link:
        raise InputError(f"has no {kind} link", element=place)
    return link


def read_origin(place: str, element: Element) -> Origin:
    """Return the ``<origin>`` of an element, the identity where it has none."""
    origin = only(place, element, "origin")
    xyz = triple(f"{place}: origin xyz", origin, "xyz", (0.0, 0.0, 0.0))
    return Origin(xyz, triple(f"{place}: origin rpy", origin, "rpy", (0.0, 0.0, 0.0)))


def _read_axis(place: str, element: Element, kind: str) -> Array:
    vector = triple(f"{place}: axis", only(place, element, "axis"), "xyz", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(vector))
    if kind == "fixed":
        return read_only((1.0, 0.0, 0.0))
    if length < SHORTEST_AXIS:
        raise InputError("has zero length", element=f"{place}: axis")
    return vector if length == 1.0 else read_only(vector / length)


def _read_range(place: str, kind: str, limits: Element | None) -> tuple[float, float]:
    """Limits of position; infinite for continuous joints, and where lower = upper = 0."""
    if limits is None or kind in ("continuous", "fixed"):
        return -math.inf, math.inf
    lower, upper = limit(place, limits, "lower"), limit(place, limits, "upper")
    if lower > upper:
        raise InputError(f"lower {lower:g} exceeds upper {upper:g}", element=place)
    return (-math.inf, math.inf) if lower == upper == 0.0 else (lower, upper)


def _read_bound(place: str, limits: Element | None, key: str) -> float:
    """A limit of velocity or effort; infinite where it is zero or left out."""
    if limits is None:
        return math.inf
    bound = limit(place, limits, key)
    if bound < 0.0:
        raise InputError(f"{key} {bound:g} is negative", element=place)
    return bound or math.inf


def _read_mimic(place: str, element: Element) -> Mimic | None:
    where = f"{place}: mimic"
    mimic = only(place, element, "mimic")
    if mimic is None:
        return None
    joint = mimic.get("joint")
    if not joint:
        raise InputError("names no joint", element=where, advice='write joint="..."')
    return Mimic(joint, number(where, mimic, "multiplier", 1.0), number(where, mimic, "offset", 0.0))


def _drop_placeholders(joints: Iterable[UrdfJoint]) -> tuple[tuple[UrdfJoint, ...], list[str]]:
    """Make limits infinite that are too large to be meant, with a warning for each kind."""
    kept: list[UrdfJoint] = []
    dropped: dict[str, list[str]] = {"position": [], "velocity": [], "effort": []}
    for joint in joints:
        fast = LARGEST_RATE <= joint.velocity < math.inf
        strong = (LARGEST_TORQUE_BESIDE_RATE if fast else LARGEST_TORQUE) <= joint.effort < math.inf
        wide = LARGEST_ANGLE <= max(-joint.lower, joint.upper) < math.inf
        found = {"position": wide, "velocity": fast, "effort": strong}
        if not joint.turns or not any(found.values()):
            kept.append(joint)
            continue
        for kind, is_found in found.items():
            dropped[kind] += [joint.name] if is_found else []
        lower, upper = (-math.inf, math.inf) if wide else (joint.lower, joint.upper)
        velocity, effort = math.inf if fast else joint.velocity, math.inf if strong else joint.effort
        kept.append(replace(joint, lower=lower, upper=upper, velocity=velocity, effort=effort))
    listed = [f"limits of {kind} too large to be meant, taken as not given: " for kind in dropped]
    return tuple(kept), [text + ", ".join(names) for text, names in zip(listed, dropped.values(), strict=True) if names]


def _check_mimic(joint: UrdfJoint, joints: Mapping[str, Element]) -> None:
    if joint.mimic is None:
        return
    where = f'joint "{joint.name}": mimic'
    if joint.mimic.joint not in joints:
        raise InputError(f'names joint "{joint.mimic.joint}", which does not exist', element=where)
    if joint.mimic.joint == joint.name:
        raise InputError("a joint cannot mimic itself", element=where)


def _order(links: Mapping[str, UrdfLink], joints: Sequence[UrdfJoint]) -> tuple[str, tuple[UrdfJoint, ...]]:
    """Return the root link and the joints, parents before children and siblings by name."""
    carrier: dict[str, UrdfJoint] = {}
    children: dict[str, list[UrdfJoint]] = {name: [] for name in links}
    for joint in joints:
        place = f'joint "{joint.name}"'
        for kind, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise InputError(f'its {kind} link "{link}" does not exist', element=place)
        if joint.child == joint.parent:
            raise InputError(f'joins link "{joint.child}" to itself', element=place)
        if joint.child in carrier:
            reason = f'has two parents: joints "{carrier[joint.child].name}" and "{joint.name}" both carry it'
            raise InputError(reason, element=f'link "{joint.child}"', advice="a URDF robot is a tree")
        carrier[joint.child] = joint
        children[joint.parent].append(joint)
    roots = [name for name in links if name not in carrier]
    if not roots:
        raise InputError(f"the joints form a loop: {_loop(carrier)}; no link is the root")
    if len(roots) > 1:
        named = ", ".join(f'"{name}"' for name in roots[:5])
        raise InputError(
            f"has {len(roots)} root links ({named}), so parts of it are detached", advice="connect them by a joint"
        )
    ordered = _depth_first(roots[0], children)
    if len(ordered) < len(joints):
        reached = {joint.name for joint in ordered}
        loop = _loop({child: joint for child, joint in carrier.items() if joint.name not in reached})
        raise InputError(f'the joints form a loop, detached from the root link "{roots[0]}": {loop}')
    return roots[0], ordered


def _depth_first(root: str, children: Mapping[str, list[UrdfJoint]]) -> tuple[UrdfJoint, ...]:
    ordered: list[UrdfJoint] = []
    waiting = sorted(children[root], key=lambda joint: joint.name, reverse=True)
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += sorted(children[joint.child], key=lambda below: below.name, reverse=True)
    return tuple(ordered)


def _loop(carrier: Mapping[str, UrdfJoint]) -> str:
    """Links of one loop, written ``a - b - a``; every link in ``carrier`` has a parent in it or leads to a loop."""
    link = next(iter(carrier))
    seen: list[str] = []
    while link not in seen:
        seen.append(link)
        link = carrier[link].parent
    return " - ".join([link, *reversed(seen[seen.index(link) :])])
