"""Joints left and right of the plane that are each other's mirror image, and are coupled to move as one."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.planar.choice import Choice, Coupling
from floatplan.robot.urdf.tree import UrdfTree


def mirror_couplings(tree: UrdfTree, choice: Choice, joints: Sequence[str] | None) -> dict[str, Coupling]:
    """Return couplings that make left and right limbs move as one.

    Two joints of ``choice`` are a pair where, at planned positions zero, they have the same position in the plane, are
    at equal distances on either side of the middle (the joints' median), and on the same or on paired links. A joint's
    distance from the plane is that of the bodies it carries, or of its origin: where on its axis a file puts the origin
    means nothing. The ratio is -1 where their axes oppose each other. The one that comes first leads, or the one among
    ``joints`` where there are such.

    Raises
    ------
    InputError
        If there is no pair.
    """
    partner = _partners(tree, choice)
    couplings: dict[str, Coupling] = {}
    for name in choice.planned:
        other = partner.get(name)
        if other is None or other in couplings or name in couplings:
            continue
        leader, follower = (name, other) if joints is None or name in joints else (other, name)
        if joints is None or (leader in joints and follower not in joints):
            couplings[follower] = Coupling(leader, choice.signs[leader] * choice.signs[follower])
    if not couplings:
        reason = "no two joints to be coupled are each other's mirror image"
        raise InputError(reason, element='coupled "mirror"', advice="name the pairs: follower = leader")
    return couplings


def _partners(tree: UrdfTree, choice: Choice) -> dict[str, str]:
    """The joints that have a mirror image, and their mirror images."""
    plane = choice.required_plane
    names = choice.planned
    placements = tree.placements(choice.positions_at_zero)
    origins = np.array([placements[tree.joint[name].child].translation for name in names])
    carried = _carried_centers(tree, placements, names)
    positions = origins @ np.array([plane.horizontal, plane.vertical]).T  # (joints, 2), m
    sides = np.array([carried @ plane.normal, origins @ plane.normal])  # (2, joints), m: two ways to measure it
    extent = max(np.ptp(positions, axis=0).max(), np.ptp(sides, axis=1).min())
    tolerance = 0.03 * (float(extent) or 1.0)  # as far from a mirror image as files of real robots have joints
    sides -= np.median(sides, axis=1, keepdims=True)
    gaps = _mirror_gaps(positions, sides, tolerance)
    partner: dict[str, str] = {}
    for i, name in enumerate(names):
        if name in partner:
            continue
        images = []
        for gap, other in zip(gaps[i].tolist(), names, strict=True):
            is_free = other != name and other not in partner
            if gap < tolerance and is_free and _carried_alike(tree, name, other, partner):
                images.append((gap, other))
        if images:
            other = min(images)[1]
            partner[name] = other
            partner[other] = name
    return partner


def _carried_centers(tree: UrdfTree, placements: Mapping[str, Any], names: Sequence[str]) -> Array:
    """Centres of mass (joints, 3) of all that joints carry, m in the root link; a joint's origin where that is none."""
    centers = np.empty((len(names), 3))
    for index, name in enumerate(names):
        child = tree.joint[name].child
        mass = 0.0
        moment = np.zeros(3)
        for link in tree.links.values():
            carries = link.name == child or tree.joint[name] in tree.path(link.name)
            if carries and link.inertial is not None:
                mass += link.inertial.mass
                moment += link.inertial.mass * (placements[link.name] * link.inertial.origin.placement.translation)
        centers[index] = moment / mass if mass > 0.0 else placements[child].translation
    return centers


def _mirror_gaps(positions: Array, sides: Array, tolerance: float) -> Array:
    """Distances (joints, joints) of joints from the mirror images of others, m; infinite next to the middle.

    Of the measures ``sides`` (measures, joints) of the distance from the middle, that with the smaller gap counts.
    """
    apart = np.linalg.norm(positions[:, None] - positions[None, :], axis=2)
    gaps = np.hypot(apart, np.abs(sides[:, :, None] + sides[:, None, :]))
    away = np.abs(sides) > tolerance
    gaps[~(away[:, :, None] & away[:, None, :])] = np.inf
    return np.asarray(gaps.min(axis=0))


def _carried_alike(tree: UrdfTree, name: str, other: str, partner: Mapping[str, str]) -> bool:
    """Whether the next joints above two joints that have a mirror image are the same or a pair."""
    above = _paired_above(tree, name, partner)
    other_above = _paired_above(tree, other, partner)
    return above == other_above or (above is not None and partner.get(above) == other_above)


def _paired_above(tree: UrdfTree, name: str, partner: Mapping[str, str]) -> str | None:
    for joint in tree.path(tree.joint[name].parent):
        if joint.name in partner:
            return joint.name
    return None
