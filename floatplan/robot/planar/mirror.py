"""Joints left and right of the plane that are each other's mirror image, and are coupled to move as one."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.planar.choice import Choice, Coupling
from floatplan.robot.urdf.tree import UrdfTree

MIRRORED = 0.03  # [-] of the robot's extent: how far from the mirror image a joint may be


def mirror_couplings(tree: UrdfTree, choice: Choice, joints: Sequence[str] | None) -> dict[str, Coupling]:
    """Return couplings that make left and right limbs move as one.

    Two joints of ``choice`` are a pair where, at planned positions zero, they lie at the same place in the plane, at
    equal distances on either side of the middle (the joints' median), and on the same or on paired links. A joint is
    beside the plane as far as what it carries, or as its origin: where on its axis a file puts the origin means
    nothing. The ratio is -1 where their axes oppose each other. The one that comes first leads, or the one among
    ``joints`` where these are given.

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
    plane = choice.in_plane
    names = choice.planned
    placements = tree.placements(choice.positions_at_zero)
    origins = np.array([placements[tree.joint[name].child].translation for name in names])
    carried = _carried_centers(tree, placements, names)
    in_plane = origins @ np.array([plane.horizontal, plane.vertical]).T  # (joints, 2), m
    beside = np.array([carried @ plane.normal, origins @ plane.normal])  # (2, joints), m: two ways to measure it
    extent = max(np.ptp(in_plane, axis=0).max(), np.ptp(beside, axis=1).min())
    tolerance = MIRRORED * (float(extent) or 1.0)
    beside -= np.median(beside, axis=1, keepdims=True)
    gaps = _mirror_gaps(in_plane, beside, tolerance)
    partner: dict[str, str] = {}
    for i, name in enumerate(names):
        if name in partner:
            continue
        images = [
            (gap, other)
            for gap, other in zip(gaps[i].tolist(), names, strict=True)
            if gap < tolerance and other != name and other not in partner and _together(tree, name, other, partner)
        ]
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


def _mirror_gaps(in_plane: Array, beside: Array, tolerance: float) -> Array:
    """How far joints (joints, joints) are from the mirror images of others, m; infinite next to the middle.

    Of the measures ``beside`` (measures, joints) of the distance from the middle, that counts by which the gap is less.
    """
    apart = np.linalg.norm(in_plane[:, None] - in_plane[None, :], axis=2)
    gaps = np.hypot(apart, np.abs(beside[:, :, None] + beside[:, None, :]))
    away = np.abs(beside) > tolerance
    gaps[~(away[:, :, None] & away[:, None, :])] = np.inf
    return np.asarray(gaps.min(axis=0))


def _together(tree: UrdfTree, name: str, other: str, partner: Mapping[str, str]) -> bool:
    """Whether the next joints above two joints that have a mirror image are the same or a pair."""
    above, other_above = (
        next((up.name for up in tree.path(tree.joint[joint].parent) if up.name in partner), None)
        for joint in (name, other)
    )
    return above == other_above or (above is not None and partner.get(above) == other_above)
