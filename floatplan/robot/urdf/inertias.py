"""Inertias that no body can have: refused, or balanced as MuJoCo does; and masses that the robot carries."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
import pinocchio as pin

from floatplan.arguments import by_name, made, many
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, refuse
from floatplan.keys import Keyed, Reader
from floatplan.robot.urdf.tree import LARGEST, Inertial, Origin, UrdfTree, rigid_body
from floatplan.tables import Key

NEGLIGIBLE = 1e-12  # [kg m^2] a grain of sand's; a fault smaller than this is noise around zero


@dataclass(frozen=True)
class Payload(Keyed):
    """A point mass that a link carries."""

    about: ClassVar[str] = "What the robot carries"
    link: Annotated[str, Key("The link that carries it")]
    mass: Annotated[float, Key("How heavy it is", "kg")]
    at: Annotated[tuple[float, float, float], Key("Where it is, in the link's frame", "m")] = (0.0, 0.0, 0.0)


def payloads(value: Any, element: str) -> tuple[Payload, ...]:
    """Check a payload, or a sequence of them; mappings are made into payloads."""
    if isinstance(value, Payload | Mapping):
        return (_payload(value, element),)
    return tuple(many(_payload, "payloads")(value, element))


def _payload(value: Any, element: str) -> Payload:
    if isinstance(value, Mapping):
        reader = Reader()
        value = reader.table(Payload, by_name(_any_value)(value, element), element)
        refuse(reader.errors)
    payload: Payload = made(Payload)(value, element)
    return payload


def _any_value(value: Any, _: str) -> Any:
    """Check nothing: the keys' own checks do."""
    return value


def fault(inertia: Array) -> str | None:
    """Return why no body has an inertia (3, 3), kg m^2: a negative moment, or one above the sum of the other two."""
    moments = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{moment:.4g}" for moment in moments)
    # 1e-9 of the largest moment is rounding of a rod, whose least moment is zero
    if moments[0] < -max(1e-9 * abs(moments[2]), NEGLIGIBLE):
        return f"is not positive definite: principal moments {listed} kg m^2"
    # 1e-3 is rounding to three digits of a plate, whose moments are on the edge
    if moments[2] > moments[0] + moments[1] + max(1e-3 * moments[2], NEGLIGIBLE):
        return f"breaks the triangle inequality: principal moments {listed} kg m^2"
    return None


def with_sound_inertias(tree: UrdfTree, balance: bool) -> UrdfTree:
    """Return the robot, with a warning about links whose own inertia no body can have.

    An inertia counts with the rigid body that moves: all links joined by fixed joints. A moment of zero (a massless
    link, a point mass, a rod) is left to the check of the model's mass matrix.

    Parameters
    ----------
    tree : UrdfTree
    balance : whether all three principal moments of such a link become their mean

    Raises
    ------
    InputError
        A rigid body has an inertia that is none, or the mean of a link's moments is not positive.
    """
    faults = {}
    for link in tree.links.values():
        reason = None if link.inertial is None else fault(link.inertial.inertia)
        if reason:
            faults[link.name] = reason
    if not faults:
        return tree
    if balance:
        return _balanced(tree, faults)
    body = {tree.root: tree.root}
    for joint in tree.joints:
        body[joint.child] = body[joint.parent] if joint.type == "fixed" else joint.child
    placements = tree.placements({})
    for name, reason in faults.items():
        members = []
        for other, element in tree.links.items():
            if body[other] == body[name] and element.inertial is not None:
                members.append((element.inertial, placements[other]))
        if fault(rigid_body(members)[2]):
            advice = (
                "no body has a negative moment, or one larger than the sum of the other two; mend it, or have such "
                "inertias balanced as MuJoCo does, to equal moments: balance_inertias = true under [robot], or "
                "--balance-inertias"
            )
            raise InputError(reason, element=f'link "{name}": inertia', advice=advice)
    used = "used, because with the links fixed to them they make sound bodies"
    warning = f"links with an inertia that no body can have: {', '.join(faults)}; {used}"
    return replace(tree, warnings=(*tree.warnings, warning))


def _balanced(tree: UrdfTree, faults: dict[str, str]) -> UrdfTree:
    links = dict(tree.links)
    for name, reason in faults.items():
        own = links[name].inertial
        if own is None:
            continue
        xx, yy, zz = own.inertia.diagonal()
        mean = (xx + yy + zz) / 3  # of the diagonal's elements as of the principal moments
        if not mean > 0.0:
            where = f'link "{name}": inertia'
            advice = "give the link the inertia of a body"
            raise InputError(f"{reason}, whose mean is not positive", element=where, advice=advice)
        links[name] = replace(links[name], inertial=replace(own, inertia=read_only(mean * np.eye(3))))
    return replace(tree, links=links, warnings=(*tree.warnings, balanced_warning(faults)))


def balanced_warning(names: Sequence[str] | dict[str, str]) -> str:
    """Return the warning about links whose inertias were balanced."""
    what = "balanced: inertias that no body can have, all three principal moments made equal to their mean"
    return f"{what}: {', '.join(names)}"


def with_payload(tree: UrdfTree, payload: Sequence[Payload]) -> UrdfTree:
    """Return the robot with point masses added to its links.

    Raises
    ------
    InputError
        There is no such link, or mass or inertia are larger than those of any robot.
    """
    links = dict(tree.links)
    for carried in payload:
        if carried.link not in links:
            advice = f"the links are: {', '.join(links)}"
            raise InputError(f'no link is called "{carried.link}"', element="payload", advice=advice)
        point = Inertial(
            Origin(read_only(carried.at), read_only(np.zeros(3))), carried.mass, read_only(np.zeros((3, 3)))
        )
        own = links[carried.link].inertial
        members = [point] if own is None else [own, point]
        mass, center, inertia = rigid_body((member, pin.SE3.Identity()) for member in members)
        if max(mass, abs(inertia).max(), abs(center).max()) > LARGEST:
            reason = f"makes its link heavier than any robot's: {mass:g} kg, moments of {abs(inertia).max():g} kg m^2"
            raise InputError(reason, element=f'payload "{carried.link}"', advice="give kg, and m in the link's frame")
        sum_of_both = Inertial(Origin(read_only(center), read_only(np.zeros(3))), mass, read_only(inertia))
        links[carried.link] = replace(links[carried.link], inertial=sum_of_both)
    return replace(tree, links=links)
