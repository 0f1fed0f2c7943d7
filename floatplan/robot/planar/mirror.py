"""Joints left and right of the plane that are each other's mirror image, and are coupled to move as one."""

from collections.abc import Mapping, Sequence

import numpy as np

from floatplan.errors import InputError
from floatplan.robot.planar.choice import Choice, Coupling
from floatplan.robot.urdf.tree import UrdfTree

MIRRORED = 0.03  # [-] of the robot's extent: how far from the mirror image a joint may be


def mirror_couplings(tree: UrdfTree, choice: Choice, joints: Sequence[str] | None) -> dict[str, Coupling]:
    """Return couplings that make left and right limbs move as one.

    Two joints of ``choice`` are a pair where, at planned positions zero, they lie at the same place in the plane, at
    equal distances on either side of the middle (the joints' median), and on the same or on paired links. The ratio is
    -1 where their axes oppose each other. The one that comes first leads, or the one among ``joints`` where these are
    given.

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
    plane, names = choice.in_plane, choice.planned
    placements = tree.placements(choice.positions_at_zero)
    axes = np.array([plane.horizontal, plane.vertical, plane.normal])
    places = np.array([axes @ placements[tree.joint[name].child].translation for name in names])
    tolerance = MIRRORED * (float(np.ptp(places, axis=0).max()) or 1.0)
    beside = places[:, 2] - np.median(places[:, 2])
    mirrored = places - 2.0 * np.outer(beside, (0.0, 0.0, 1.0))
    gaps = np.linalg.norm(places[:, None] - mirrored[None, :], axis=2)
    partner: dict[str, str] = {}
    for i, name in enumerate(names):
        if name in partner or abs(beside[i]) <= tolerance:
            continue
        images = [
            (gap, other)
            for gap, other in zip(gaps[i].tolist(), names, strict=True)
            if gap < tolerance and other != name and other not in partner and _together(tree, name, other, partner)
        ]
        if images:
            other = min(images)[1]
            partner[name], partner[other] = other, name
    return partner


def _together(tree: UrdfTree, name: str, other: str, partner: Mapping[str, str]) -> bool:
    """Whether the next joints above two joints that have a mirror image are the same or a pair."""
    above, other_above = (
        next((up.name for up in tree.path(tree.joint[joint].parent) if up.name in partner), None)
        for joint in (name, other)
    )
    return above == other_above or (above is not None and partner.get(above) == other_above)
