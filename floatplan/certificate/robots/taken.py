"""The robot as a plan's record says that it was taken: its own free base, balanced inertias, and what it carries.

No code is shared with ``floatplan.robot``, which takes it so for planning; ``docs/certificate.md`` has the rules.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import flint

from floatplan.certificate.robots.columns import cross, diagonal, dot, principal
from floatplan.certificate.robots.urdf import Joint, Link, Placement, Urdf, number
from floatplan.errors import FloatplanError, InputError
from floatplan.plans.record import RobotRecord
from floatplan.tables import FREE_TYPES, INDEPENDENT


class NotReadError(FloatplanError):
    """Something of a robot that the certificate has no way of its own to read, so that it decides nothing."""

    def __init__(self, element: str, what: str = "") -> None:
        super().__init__(f"{element} is not read{what}")


def as_recorded(urdf: Urdf, record: RobotRecord) -> Urdf:
    """Return the robot of a record from what its file holds. To be called with Arb's precision set.

    The URDF that a plan file holds of an MJCF has balanced inertias and the payload in it already.

    Raises
    ------
    InputError
        A joint that floats carries some of the robot; the joints by which its base floats have roles, but not all of
        them are locked; or a payload's link is not there.
    NotReadError
        Whether an inertia was balanced cannot be decided.
    """
    urdf = _with_free_base(urdf, {*record.joints, *record.coupled, *record.locked})
    if record.kind == "mjcf":
        return urdf
    links = dict(urdf.links)
    if record.balance_inertias:
        links = {name: _balanced(link) for name, link in links.items()}
    for point in record.payload or ():
        name = point["link"]
        if name not in links:
            raise InputError(f'the robot has no link "{name}"', element="robot.payload")
        links[name] = _carrying(links[name], number(repr(point["mass"])), point["at"])
    return replace(urdf, links=links)


def _with_free_base(urdf: Urdf, roles: Collection[str]) -> Urdf:
    """Joints that let the whole robot float from a massless root are fixed, unless all of them are locked."""
    base = _free_base(urdf)
    names = [joint.name for joint in base]
    for joint in urdf.joints:
        if joint.kind in FREE_TYPES and joint.name not in names:
            raise InputError(f"is {joint.kind}, and carries only a part of the robot", element=f'joint "{joint.name}"')
    locked = [name for name in names if name in roles]
    if not names or (locked == names and base[0].kind not in FREE_TYPES):
        return urdf
    if locked:
        raise InputError("is one of those by which the base floats", element=f'joint "{locked[0]}"')
    frames = set[str]()
    carriers = {joint.child: joint for joint in urdf.joints}
    link = base[-1].child
    while link in carriers:
        link = carriers[link].parent
        frames.add(link)
    joints = tuple(replace(joint, kind="fixed", mimic=None) if joint.name in names else joint for joint in urdf.joints)
    links = dict(urdf.links)
    for name in frames & links.keys():
        links[name] = replace(links[name], frame=True)
    return replace(urdf, links=links, joints=joints)


def _free_base(urdf: Urdf) -> list[Joint]:
    """The joints from the root to what they let float: links before the last are massless, and carry nothing else."""
    below: dict[str, list[Joint]] = {}
    for joint in urdf.joints:
        below.setdefault(joint.parent, []).append(joint)
    link = urdf.root
    rotation = Placement().rotation
    chain: list[tuple[Joint, Any]] = []
    base: list[Joint] = []
    while _is_massless(urdf.links[link]) and len(below.get(link, ())) == 1:
        (joint,) = below[link]
        rotation = rotation * joint.origin.rotation
        if joint.kind != "fixed":
            chain.append((joint, joint.axis if joint.kind == "floating" else rotation * joint.unit_axis))
            if _floats(chain):
                base = [joint for joint, _ in chain]
        link = joint.child
    leaders = {joint.mimic[0] for joint in urdf.joints if joint.mimic is not None}
    return [] if any(joint.mimic or joint.name in leaders for joint in base) else base


def _is_massless(link: Link) -> bool:
    entries = [link.mass, *link.inertia.entries()]
    return not link.has_collision and all(entry.is_zero() for entry in entries)


def _floats(chain: Sequence[tuple[Joint, Any]]) -> bool:
    """Whether joints, with their axes in the root link at zero, surely move freely in a plane or in space."""
    if len(chain) == 1 and chain[0][0].kind in FREE_TYPES:
        return True
    slides = [axis for joint, axis in chain if joint.kind == "prismatic"]
    turns = [axis for joint, axis in chain if joint.kind in ("revolute", "continuous")]
    if len(slides) + len(turns) < len(chain):
        return False
    if (len(slides), len(turns)) == (3, 3):
        spread = all(_length(cross(one, other)) > INDEPENDENT for one, other in pairwise(turns))
        return spread and bool(abs(dot(cross(slides[0], slides[1]), slides[2])) > INDEPENDENT)
    if (len(slides), len(turns)) == (2, 1):
        in_plane = all(abs(dot(axis, turns[0])) < INDEPENDENT for axis in slides)
        return in_plane and bool(_length(cross(slides[0], slides[1])) > INDEPENDENT)
    return False


def _length(column: Any) -> Any:
    return dot(column, column).sqrt()


def _balanced(link: Link) -> Link:
    """Equal moments where no body has those that are written."""
    _, moments = principal(link.inertia)
    least = moments[0].min(moments[1]).min(moments[2])
    largest = moments[0].max(moments[1]).max(moments[2])
    between = sum(moments) - least - largest
    negligible = flint.arb(1e-12)  # [kg m^2] both tolerances are at least
    # the least moment may be negative by 1e-9 of the largest
    negative = _surely(least, -(abs(largest) * 1e-9).max(negligible), link.name)
    # the largest moment may exceed the sum of the others by 1e-3 of it
    if not negative and not _surely(least + between + (largest * 1e-3).max(negligible), largest, link.name):
        return link
    mean = sum((link.inertia[k, k] for k in range(3)), start=flint.arb(0)) / 3
    if not mean > 0:
        raise InputError("the mean of its moments of inertia is not positive", element=f'link "{link.name}"')
    return replace(link, inertia=diagonal([mean] * 3))


def _surely(small: Any, large: Any, link: str) -> bool:
    """Whether one ball is below another."""
    if not small < large and not small >= large:
        raise NotReadError(f'link "{link}": inertia', ": it is on the edge of what is balanced")
    return bool(small < large)


def _carrying(link: Link, mass: Any, at: Sequence[float]) -> Link:
    """A link with a point mass, its inertia then about the centre of both, in its own axes."""
    total = link.mass + mass
    point = flint.arb_mat(3, 1, [number(repr(float(entry))) for entry in at])
    own = link.center.translation if link.has_inertial else point
    center = (own * link.mass + point * mass) * (1 / total)
    turned = link.center.rotation
    inertia = turned * link.inertia * turned.transpose()
    for inertial_mass, position in ((link.mass, own), (mass, point)):
        arm = position - center
        inertia += (diagonal([dot(arm, arm)] * 3) - arm * arm.transpose()) * inertial_mass
    return replace(link, mass=total, center=Placement(translation=center), inertia=inertia, has_inertial=True)
