"""The plane of the motion: found from the joints' axes, or given by its two letters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.parts import Plane
from floatplan.robot.urdf.tree import UrdfJoint, UrdfTree

LETTERS = "xyz"
USUAL_PLANES = {"x": "yz", "y": "xz", "z": "xy"}  # by the normal's letter
LARGEST_TILT = 1e-3  # [rad] an axis this close to the normal is taken for the normal: "1.5708" for pi/2 is 4e-6 off


def joint_axes(tree: UrdfTree, placements: Mapping[str, Any]) -> dict[str, Array]:
    """Axis (3,) of each turning joint in the root link, for links at ``placements``."""
    return {
        joint.name: placements[joint.parent].rotation @ joint.origin.placement.rotation @ joint.axis
        for joint in tree.joints
        if joint.turns
    }


def choose_plane(name: str | None, axes: Mapping[str, Array], voters: Iterable[str]) -> str:
    """Return ``name``, or else the plane that most of the joints ``voters`` turn in.

    Parameters
    ----------
    name : str or None
        Two letters, horizontal then vertical.
    axes : joint name -> (3,)
        Axes in the root link.
    voters : joint names

    Raises
    ------
    InputError
        If the name is not two different letters of x, y, z; or if none is given, and no axis or more than one
        has the most joints.
    """
    if name is None:
        turning = [axes[joint] for joint in voters]
        if not turning:
            raise InputError("no joint that turns is left to plan", element="joints")
        counts = {letter: sum(_is_parallel(axis, unit(letter)) for axis in turning) for letter in LETTERS}
        return USUAL_PLANES[_commonest(counts)]
    if len(name) != 2 or name[0] == name[1] or not set(name) <= set(LETTERS):
        reason = f'"{name}" is not two different letters of x, y and z'
        raise InputError(reason, element="plane", advice='write the horizontal and the vertical axis, such as "xz"')
    return name


def third_letter(name: str) -> str:
    """The letter of the normal's line."""
    return (set(LETTERS) - set(name)).pop()


def oriented_plane(name: str, axes: Iterable[Array]) -> Plane:
    """Return the plane called ``name``, its normal along most of ``axes`` (3,); a tie gives the positive one."""
    line = unit(third_letter(name))
    votes = sum(np.sign(axis @ line) for axis in axes)
    horizontal, vertical, normal = unit(name[0]), unit(name[1]), (-line if votes < 0.0 else line) + 0.0
    turn = round(float(normal @ np.cross(horizontal, vertical)))
    return Plane(name, read_only(horizontal), read_only(vertical), read_only(normal), float(turn))


def turns_in_plane(axis: Array, name: str) -> bool:
    """Whether an axis (3,) is along or against the normal of the plane called ``name``."""
    return _is_parallel(axis, unit(third_letter(name)))


def sign_in_plane(axis: Array, plane: Plane) -> float:
    """+1 for an axis along the plane's normal, -1 against it, 0 for any other."""
    return float(np.sign(axis @ plane.normal)) if _is_parallel(axis, plane.normal) else 0.0


def tilt(axis: Array, plane: Plane) -> float:
    """Angle between an axis and the normal's line, rad."""
    along = axis @ plane.normal
    return float(np.arctan2(np.linalg.norm(axis - along * plane.normal), abs(along)))


def unit(letter: str) -> Array:
    """Unit vector (3,) along "x", "y" or "z"."""
    vector = np.zeros(3)
    vector[LETTERS.index(letter)] = 1.0
    return vector


def explain_axis(joint: UrdfJoint, axis: Array, plane: Plane) -> InputError:
    """The error for a joint that should turn in the plane and does not."""
    degrees = np.degrees(tilt(axis, plane))
    reason = f'its axis is {degrees:.3g} deg off the normal of the plane "{plane.name}"'
    return InputError(reason, element=f'joint "{joint.name}"', advice="leave it out, or give another plane")


def _is_parallel(axis: Array, direction: Array) -> bool:
    return bool(np.linalg.norm(axis - (axis @ direction) * direction) <= LARGEST_TILT)


def _commonest(counts: Mapping[str, int]) -> str:
    most = max(counts.values())
    if most == 0:
        reason = "no joint that could be planned turns about the x, y or z axis of the root link"
        raise InputError(reason, element="plane", advice="lock the joints that tilt the others at another angle")
    winners = [letter for letter, count in counts.items() if count == most]
    if len(winners) > 1:
        axes = " and ".join(winners)
        planes = " or ".join(f'plane="{USUAL_PLANES[letter]}"' for letter in winners)
        raise InputError(f"as many joints turn about {axes} ({most} each)", element="plane", advice=f"give {planes}")
    return winners[0]
