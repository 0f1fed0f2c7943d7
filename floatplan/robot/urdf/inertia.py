"""Is every inertia that of a possible body?

What counts is the rigid body that moves: links joined by fixed joints, taken together. A camera with a made-up inertia
does no harm on a trunk; on a joint of its own it does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfJoint, UrdfLink

TRIANGLE_SLACK = 1e-3  # [-] of the largest moment: rounding to three digits of a plate, whose moments are on the edge
DEFINITE_SLACK = 1e-9  # [-] of the largest moment: rounding of a rod, whose least moment is zero
NEGLIGIBLE = 1e-12  # [kg m^2] a grain of sand's; a fault smaller than this is noise around zero


def check_inertias(links: Mapping[str, UrdfLink], joints: Sequence[UrdfJoint]) -> list[str]:
    """Return warnings about links whose own inertia is impossible, and whose rigid body's is not.

    Raises
    ------
    InputError
        If a rigid body has a negative principal moment, or one larger than the sum of the other two. A moment of zero
        (a massless link, a point mass, a rod) is left to the check of the model's mass matrix.
    """
    faults = {link.name: fault for link in links.values() if (fault := _fault_of_link(link))}
    for name, fault in faults.items():
        members = _rigid_body(name, joints)
        if _fault(_combined_inertia([(links[link], place) for link, place in members.items()])):
            advice = "no body has a negative moment, or one larger than the sum of the other two"
            raise InputError(fault, element=f'link "{name}": inertia', advice=advice)
    listed = ", ".join(faults)
    reason = "used, because together with the links fixed to them they make sound bodies"
    return [f"links with an inertia that no body can have: {listed}; {reason}"] if faults else []


def _fault_of_link(link: UrdfLink) -> str | None:
    return None if link.inertial is None else _fault(link.inertial.inertia)


def _fault(inertia: Array) -> str | None:
    moments = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{moment:.4g}" for moment in moments)
    if moments[0] < -max(DEFINITE_SLACK * abs(moments[2]), NEGLIGIBLE):
        return f"is not positive definite: principal moments {listed} kg m^2"
    if moments[2] > moments[0] + moments[1] + max(TRIANGLE_SLACK * moments[2], NEGLIGIBLE):
        return f"breaks the triangle inequality: principal moments {listed} kg m^2"
    return None


def _rigid_body(link: str, joints: Sequence[UrdfJoint]) -> dict[str, Any]:
    """The links joined to ``link`` by fixed joints, and their placements in the first of them."""
    carrier = {joint.child: joint for joint in joints}
    while link in carrier and carrier[link].type == "fixed":
        link = carrier[link].parent
    placements: dict[str, Any] = {link: pin.SE3.Identity()}
    for joint in joints:
        if joint.type == "fixed" and joint.parent in placements:
            placements[joint.child] = placements[joint.parent] * joint.origin.placement
    return placements


def _combined_inertia(parts: Sequence[tuple[UrdfLink, Any]]) -> Array:
    """Inertia (3, 3) of several links about their common centre of mass."""
    solid = [(link.inertial, place * link.inertial.origin.placement) for link, place in parts if link.inertial]
    mass = sum(inertial.mass for inertial, _ in solid)
    center = sum((inertial.mass * place.translation for inertial, place in solid), np.zeros(3)) / (mass or 1.0)
    combined = np.zeros((3, 3))
    for inertial, place in solid:
        arm = place.translation - center
        combined += place.rotation @ inertial.inertia @ place.rotation.T
        combined += inertial.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return combined
