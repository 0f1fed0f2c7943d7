"""From XML to a :class:`UrdfTree`: every fault that Pinocchio would accept, drop or crash on is refused here.

An inertia counts as part of the rigid body that moves: links joined by fixed joints, taken together. A camera with a
made-up inertia does no harm on a trunk; on a joint of its own it does.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, check_name
from floatplan.robot.urdf.tree import (
    LARGEST,
    Inertial,
    Mimic,
    Origin,
    UrdfJoint,
    UrdfLink,
    UrdfTree,
    number,
    only,
    rigid_body,
    triple,
)

LARGEST_ANGLE = 1e3  # [rad] limits this large are placeholders: nobody means 159 turns
LARGEST_RATE = 1e3  # [rad/s] the same
LARGEST_TORQUE = 1e4  # [N m] the same
LARGEST_TORQUE_BESIDE_RATE = 1e3  # [N m] beside a rate limit that is a placeholder
MOST_JOINTS = 150  # [-] Pinocchio's workspace grows as the cube of the joints; thousands exhaust the memory
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed")
DYNAMICS = ("armature", "damping", "friction")  # attributes of a joint's <dynamics>
SMALLEST_MASS = 1e-15  # [kg] of a link that has any
SHORTEST_AXIS = 1e-9  # [-] length as written
TRIANGLE_SLACK = 1e-3  # [-] of the largest moment: rounding to three digits of a plate, whose moments are on the edge
DEFINITE_SLACK = 1e-9  # [-] of the largest moment: rounding of a rod, whose least moment is zero
NEGLIGIBLE = 1e-12  # [kg m^2] a grain of sand's; a fault smaller than this is noise around zero


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
    link_elements, named = _by_name("link", root.findall("link")), _by_name("joint", joint_elements)
    if not link_elements:
        raise InputError("has no <link>", advice="if it is a xacro file, let its name end in .xacro")
    name = (root.get("name") or "").strip()
    if not name:
        raise InputError("has no name", element="<robot>", advice='write <robot name="...">')
    check_name(name, "<robot>")
    links = {
        link: UrdfLink(
            link,
            _read_inertial(f'link "{link}"', element),
            tuple(element.findall("collision")),
            element.get("type") == "frame",
        )
        for link, element in link_elements.items()
    }
    joints = [_read_joint(joint, element, named) for joint, element in named.items()]
    base, ordered = _order(links, joints)
    warnings = _check_inertias(UrdfTree(name, base, links, ordered, ()))
    ordered, dropped = _drop_placeholders(ordered)
    return UrdfTree(name, base, links, ordered, (*warnings, *dropped))


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


def _read_inertial(place: str, link: Element) -> Inertial | None:
    element = only(place, link, "inertial")
    if element is None:
        return None
    origin = read_origin(place, element)
    mass_element, moments = only(place, element, "mass"), only(place, element, "inertia")
    mass = 0.0 if mass_element is None else number(f"{place}: mass", mass_element, "value", None)
    if mass < 0.0:
        raise InputError(f"is negative: {mass:g} kg", element=f"{place}: mass")
    if 0.0 < mass < SMALLEST_MASS:
        raise InputError(f"is smaller than any part's: {mass:g} kg", element=f"{place}: mass", advice="write 0")
    xx, xy, xz, yy, yz, zz = (
        0.0 if moments is None else number(f"{place}: inertia", moments, key, None)
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    inertia = read_only([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(origin, mass, inertia) if mass > 0.0 or inertia.any() else None


def read_origin(place: str, element: Element) -> Origin:
    """Return the ``<origin>`` of an element, the identity where it has none."""
    origin = only(place, element, "origin")
    xyz = triple(f"{place}: origin xyz", origin, "xyz", (0.0, 0.0, 0.0))
    return Origin(xyz, triple(f"{place}: origin rpy", origin, "rpy", (0.0, 0.0, 0.0)))


def _read_joint(name: str, element: Element, joints: Collection[str]) -> UrdfJoint:
    place = f'joint "{name}"'
    kind = element.get("type")
    if kind not in JOINT_TYPES:
        known = ", ".join(JOINT_TYPES)
        raise InputError(f'has type "{kind}"' if kind else "has no type", element=place, advice=f"give one of {known}")
    ends = []
    for tag in ("parent", "child"):
        end = only(place, element, tag)
        ends.append("" if end is None else end.get("link", ""))
        if not ends[-1]:
            raise InputError(f"has no {tag} link", element=place)
    lower, upper, velocity, effort = _read_limits(f"{place}: limit", kind, only(place, element, "limit"))
    origin, axis = read_origin(place, element), _read_axis(place, element, kind)
    mimic = _read_mimic(f"{place}: mimic", name, only(place, element, "mimic"), joints)
    dynamics = only(place, element, "dynamics")
    given = [] if dynamics is None else [(key, dynamics) for key in DYNAMICS if key in dynamics.attrib]
    motor = {key: _magnitude(f"{place}: dynamics", each, key, None) for key, each in given}
    return UrdfJoint(name, kind, ends[0], ends[1], origin, axis, lower, upper, velocity, effort, mimic, **motor)


def _magnitude(place: str, element: Element, key: str, default: float | None, largest: float = LARGEST) -> float:
    value = number(place, element, key, default, largest)
    if value < 0.0:
        raise InputError(f"{key} {value:g} is negative", element=place)
    return value


def _read_axis(place: str, element: Element, kind: str) -> Array:
    vector = triple(f"{place}: axis", only(place, element, "axis"), "xyz", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(vector))
    if kind == "fixed":
        return read_only((1.0, 0.0, 0.0))
    if length < SHORTEST_AXIS:
        raise InputError("has zero length", element=f"{place}: axis")
    return vector if length == 1.0 else read_only(vector / length)


def _read_limits(place: str, kind: str, limits: Element | None) -> tuple[float, float, float, float]:
    """Limits of position, velocity and effort; infinite where they are zero or left out, or the joint has none."""
    if limits is None:
        return -math.inf, math.inf, math.inf, math.inf
    lower = upper = 0.0
    if kind not in ("continuous", "fixed"):
        lower, upper = (number(place, limits, key, 0.0, math.inf) for key in ("lower", "upper"))
    if lower > upper:
        raise InputError(f"lower {lower:g} exceeds upper {upper:g}", element=place)
    if lower == upper == 0.0:
        lower, upper = -math.inf, math.inf
    velocity, effort = (_magnitude(place, limits, key, 0.0, math.inf) for key in ("velocity", "effort"))
    return lower, upper, velocity or math.inf, effort or math.inf


def _read_mimic(place: str, name: str, mimic: Element | None, joints: Collection[str]) -> Mimic | None:
    if mimic is None:
        return None
    leader = mimic.get("joint")
    if not leader:
        raise InputError("names no joint", element=place, advice='write joint="..."')
    if leader not in joints:
        raise InputError(f'names joint "{leader}", which does not exist', element=place)
    if leader == name:
        raise InputError("a joint cannot mimic itself", element=place)
    return Mimic(leader, number(place, mimic, "multiplier", 1.0), number(place, mimic, "offset", 0.0))


def _drop_placeholders(joints: Iterable[UrdfJoint]) -> tuple[tuple[UrdfJoint, ...], list[str]]:
    """Make limits infinite that are too large to be meant, with a warning for each kind."""
    kept: list[UrdfJoint] = []
    dropped: dict[str, list[str]] = {"position": [], "velocity": [], "effort": []}
    for joint in joints:
        fast = joint.turns and LARGEST_RATE <= joint.velocity < math.inf
        strong = joint.turns and (LARGEST_TORQUE_BESIDE_RATE if fast else LARGEST_TORQUE) <= joint.effort < math.inf
        wide = joint.turns and LARGEST_ANGLE <= max(-joint.lower, joint.upper) < math.inf
        lower, upper = (-math.inf, math.inf) if wide else (joint.lower, joint.upper)
        velocity, effort = math.inf if fast else joint.velocity, math.inf if strong else joint.effort
        kept.append(replace(joint, lower=lower, upper=upper, velocity=velocity, effort=effort))
        for kind, large in zip(dropped, (wide, fast, strong), strict=True):
            dropped[kind] += [joint.name] if large else []
    return tuple(kept), [
        f"limits of {kind} too large to be meant, taken as not given: {', '.join(names)}"
        for kind, names in dropped.items()
        if names
    ]


def _order(links: Collection[str], joints: Sequence[UrdfJoint]) -> tuple[str, tuple[UrdfJoint, ...]]:
    """Return the root link and the joints, parents before children and siblings by name."""
    carrier: dict[str, UrdfJoint] = {}
    children: dict[str, list[UrdfJoint]] = {name: [] for name in links}
    for joint in sorted(joints, key=lambda joint: joint.name):
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
        listed = ", ".join(f'"{name}"' for name in roots[:5])
        reason = f"has {len(roots)} root links ({listed}), so parts of it are detached"
        raise InputError(reason, advice="connect them by a joint")

    def below(link: str) -> Iterator[UrdfJoint]:
        for joint in children[link]:
            yield joint
            yield from below(joint.child)

    ordered = tuple(below(roots[0]))
    if len(ordered) < len(joints):
        reached = {joint.child for joint in ordered}
        loop = _loop({child: joint for child, joint in carrier.items() if child not in reached})
        raise InputError(f'the joints form a loop, detached from the root link "{roots[0]}": {loop}')
    return roots[0], ordered


def _loop(carrier: Mapping[str, UrdfJoint]) -> str:
    """Links of one loop, written ``a - b - a``; every link in ``carrier`` has a parent in it or leads to a loop."""
    link = next(iter(carrier))
    seen: list[str] = []
    while link not in seen:
        seen.append(link)
        link = carrier[link].parent
    return " - ".join([link, *reversed(seen[seen.index(link) :])])


def _check_inertias(tree: UrdfTree) -> list[str]:
    """Return warnings about links whose own inertia is impossible, and whose rigid body's is not.

    Refused is a rigid body with a negative principal moment, or one larger than the sum of the other two. A moment of
    zero (a massless link, a point mass, a rod) is left to the check of the model's mass matrix.
    """
    faults = {
        link.name: fault
        for link in tree.links.values()
        if link.inertial is not None and (fault := _fault(link.inertial.inertia))
    }
    if not faults:
        return []
    body = {tree.root: tree.root}
    for joint in tree.joints:
        body[joint.child] = body[joint.parent] if joint.type == "fixed" else joint.child
    placements = tree.placements({})
    for name, fault in faults.items():
        fixed = [link for link in tree.links if body[link] == body[name]]
        parts = ((own, placements[link]) for link in fixed if (own := tree.links[link].inertial) is not None)
        if _fault(rigid_body(parts)[2]):
            advice = "no body has a negative moment, or one larger than the sum of the other two"
            raise InputError(fault, element=f'link "{name}": inertia', advice=advice)
    reason = "used, because together with the links fixed to them they make sound bodies"
    return [f"links with an inertia that no body can have: {', '.join(faults)}; {reason}"]


def _fault(inertia: Array) -> str | None:
    moments = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{moment:.4g}" for moment in moments)
    if moments[0] < -max(DEFINITE_SLACK * abs(moments[2]), NEGLIGIBLE):
        return f"is not positive definite: principal moments {listed} kg m^2"
    if moments[2] > moments[0] + moments[1] + max(TRIANGLE_SLACK * moments[2], NEGLIGIBLE):
        return f"breaks the triangle inequality: principal moments {listed} kg m^2"
    return None
