"""Left and right: joints that are each other's mirror image, identified by their places and not by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.parts import Coupling
from floatplan.robot.planar.choice import Choice
from floatplan.robot.urdf.tree import UrdfTree

TOLERANCE = 0.03  # [-] of the robot's extent: how far from the mirror image a joint may be


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
    places = _places(tree, choice)
    extent = float(np.ptp(np.array(list(places.values())), axis=0).max()) or 1.0
    middle = float(np.median([place[2] for place in places.values()]))
    partner: dict[str, str] = {}
    for name in choice.planned:
        if name in partner:
            continue
        mirrored = [
            (gap, other)
            for other in choice.planned
            if other != name
            and other not in partner
            and (gap := _gap(places[name], places[other], middle)) < TOLERANCE * extent
            and abs(places[name][2] - middle) > TOLERANCE * extent
            and _have_paired_parents(tree, name, other, partner)
        ]
        if mirrored:
            other = min(mirrored)[1]
            partner[name], partner[other] = other, name
    return _couplings(choice, partner, joints)


def _couplings(choice: Choice, partner: Mapping[str, str], joints: Sequence[str] | None) -> dict[str, Coupling]:
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


def _places(tree: UrdfTree, choice: Choice) -> dict[str, Array]:
    """Horizontal, vertical and normal place (3,) of each planned joint at the reference."""
    plane = choice.plane
    axes = np.array([plane.horizontal, plane.vertical, plane.normal])
    placements = tree.placements(choice.positions_at_zero())
    return {name: axes @ placements[tree.joint[name].child].translation for name in choice.planned}


def _gap(place: Array, other: Array, middle: float) -> float:
    """Distance between a place and the mirror image of the other."""
    mirrored = other.copy()
    mirrored[2] = 2.0 * middle - other[2]
    return float(np.linalg.norm(place - mirrored))


def _have_paired_parents(tree: UrdfTree, name: str, other: str, partner: Mapping[str, str]) -> bool:
    """Whether the next planned joints above are the same or a pair."""
    above, other_above = _above(tree, name, partner), _above(tree, other, partner)
    return above == other_above or (above is not None and partner.get(above) == other_above)


def _above(tree: UrdfTree, name: str, partner: Mapping[str, str]) -> str | None:
    """The nearest joint with a partner on the path from a joint to the root."""
    carrier = {joint.child: joint for joint in tree.joints}
    joint = carrier.get(tree.joint[name].parent)
    while joint is not None and joint.name not in partner:
        joint = carrier.get(joint.parent)
    return None if joint is None else joint.name
