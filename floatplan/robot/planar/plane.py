"""The plane of the motion: found from the joints' axes, or given by its two letters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfTree

LETTERS = "xyz"
USUAL_PLANES = {"x": "yz", "y": "xz", "z": "xy"}  # by the normal's letter
LARGEST_TILT = 1e-3  # [rad] an axis this close to the normal is taken for the normal: "1.5708" for pi/2 is 4e-6 off


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane of the motion, in the root link's axes.

    Attributes
    ----------
    name : str
        Two letters, horizontal then vertical: "xz" has +x and +z.
    horizontal, vertical : (3,)
        Unit vectors along the two letters.
    normal : (3,)
        The axis that the planned joints share (majority sign): a unit vector along plus or minus the third letter.
    turn : float
        +1 where a positive angle about the normal turns the horizontal axis towards the vertical one, else -1.
    """

    name: str
    horizontal: Array
    vertical: Array
    normal: Array
    turn: float

    @classmethod
    def of_axes(cls, name: str, axes: Iterable[Array]) -> Plane:
        """The plane called ``name``, its normal along most of ``axes`` (3,); a tie gives the positive one."""
        line = _unit((set(LETTERS) - set(name)).pop())
        votes = sum(np.sign(axis @ line) for axis in axes)
        horizontal, vertical, normal = _unit(name[0]), _unit(name[1]), (-line if votes < 0.0 else line) + 0.0
        turn = round(float(normal @ np.cross(horizontal, vertical)))
        return cls(name, read_only(horizontal), read_only(vertical), read_only(normal), float(turn))

    def project(self, point: Array) -> complex:
        """Horizontal + i vertical of a point (3,)."""
        return complex(self.horizontal @ point, self.vertical @ point)

    def sign(self, axis: Array) -> float:
        """+1 for an axis (3,) along the normal, -1 against it, 0 for any other."""
        return float(np.sign(axis @ self.normal)) if _is_parallel(axis, self.normal) else 0.0

    def tilt(self, axis: Array) -> float:
        """Angle between an axis (3,) and the normal's line, rad."""
        along = axis @ self.normal
        return float(np.arctan2(np.linalg.norm(axis - along * self.normal), abs(along)))


def joint_axes(tree: UrdfTree, placements: Mapping[str, Any]) -> dict[str, Array]:
    """Axis (3,) of each turning joint in the root link, for links at ``placements``."""
    return {
        joint.name: placements[joint.parent].rotation @ joint.origin.placement.rotation @ joint.axis
        for joint in tree.joints
        if joint.turns
    }


def choose_plane(name: str | None, axes: Iterable[Array]) -> str:
    """Return ``name``, or else that of the plane in which most joints turn.

    Parameters
    ----------
    name : str or None
        Two letters, horizontal then vertical.
    axes : (3,) each
        The joints' axes in the root link.

    Raises
    ------
    InputError
        If the name is not two different letters of x, y, z; or if none is given, and no axis or more than one
        has the most joints.
    """
    if name is not None:
        if len(name) != 2 or name[0] == name[1] or not set(name) <= set(LETTERS):
            reason = f'"{name}" is not two different letters of x, y and z'
            raise InputError(reason, element="plane", advice='write the horizontal and the vertical axis, such as "xz"')
        return name
    turning = list(axes)
    if not turning:
        raise InputError("no joint that turns is left to plan", element="joints")
    counts = {letter: sum(_is_parallel(axis, _unit(letter)) for axis in turning) for letter in LETTERS}
    most = max(counts.values())
    if most == 0:
        reason = "no joint that could be planned turns about the x, y or z axis of the root link"
        raise InputError(reason, element="plane", advice="lock the joints that tilt the others at another angle")
    winners = [letter for letter, count in counts.items() if count == most]
    if len(winners) > 1:
        planes = " or ".join(f'plane="{USUAL_PLANES[letter]}"' for letter in winners)
        reason = f"as many joints turn about {' and '.join(winners)} ({most} each)"
        raise InputError(reason, element="plane", advice=f"give {planes}")
    return USUAL_PLANES[winners[0]]


def _is_parallel(axis: Array, direction: Array) -> bool:
    return bool(np.linalg.norm(axis - (axis @ direction) * direction) <= LARGEST_TILT)


def _unit(letter: str) -> Array:
    return np.array([float(letter == each) for each in LETTERS])
