"""Attitudes of a base in space, as a quaternion, or as three angles about axes whose whole turns count."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.keys import Keyed
from floatplan.tables import ANGLE, Key

Triple: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]


@dataclass(frozen=True)
class Attitude(Keyed):
    """How the base is turned from the world's axes, those of the root link at the identity.

    Parameters
    ----------
    quaternion_xyzw : four floats
        Of any length but zero. As a goal the motion to it is the shortest rotation from the start.
    angles : three floats, rad
        Turns about the axes, one after the other, each about the axis as it is turned already: ``R = R_a R_b R_c``. The
        first and the third are unbounded, and a full rotation more is one somersault, or twist, more.
    axes : str
        Of the angles: three of the letters x, y, z, neighbours different, such as "yxz".
    """

    about: ClassVar[str] = "An attitude in space, by a quaternion or by three angles"
    quaternion_xyzw: Annotated[Quaternion | None, Key()] = None
    angles: Annotated[Triple | None, Key(unit=ANGLE, numbers="orientation")] = None
    axes: Annotated[str | None, Key()] = None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """It is stated in one way, and that is complete."""
        if (self.quaternion_xyzw is None) == (self.angles is None):
            yield "quaternion_xyzw", "give either quaternion_xyzw, or angles and axes"
        elif self.quaternion_xyzw is not None:
            if math.hypot(*self.quaternion_xyzw) < 1e-6:  # as written, of any length but zero
                yield "quaternion_xyzw", "the quaternion has length zero"
            if self.axes is not None:
                yield "axes", "a quaternion has no axes"
        elif self.axes is None:
            yield "axes", "is missing: three of the letters x, y, z of the rotations"
        elif not _are_axes(self.axes):
            yield "axes", f"{self.axes!r} is not three of the letters x, y, z with neighbours that differ"

    @cached_property
    def _turned(self) -> Any:
        from scipy.spatial.transform import Rotation  # here, since most problems do without

        if self.quaternion_xyzw is not None:
            return Rotation.from_quat(self.quaternion_xyzw)
        assert self.axes is not None
        assert self.angles is not None
        return Rotation.from_euler(self.axes.upper(), self.angles)

    @cached_property
    def matrix(self) -> Array:
        """Rotation (3, 3) from the base's axes to the world's."""
        return read_only(self._turned.as_matrix())

    @cached_property
    def quaternion(self) -> Array:
        """Unit quaternion (4,) x, y, z, w, with w not negative."""
        return read_only(self._turned.as_quat(canonical=True))

    def angles_about(self, axes: str) -> Array:
        """Angles (3,), rad, about these axes: its own where they are its axes, else within half a rotation."""
        if self.axes == axes:
            return np.array(self.angles)
        angles: Array = self._turned.as_euler(axes.upper(), suppress_warnings=True)
        return angles

    def __str__(self) -> str:
        """For a person, in degrees."""
        if self.angles is None:
            components = [f"{component:.4g}" for component in self.quaternion + 0.0]
            return f"quaternion ({', '.join(components)}) xyzw"
        angles = []
        for letter, angle in zip(self.axes or "", self.angles, strict=True):
            degrees = math.degrees(angle) + 0.0
            angles.append(f"{letter} {degrees:.5g}°")
        return f"angles {', '.join(angles)}"


@dataclass(frozen=True, eq=False)
class Reorientation:
    """From which attitude to which a flight in space turns the base.

    Attributes
    ----------
    start, goal : Attitude
        At takeoff, and as requested for landing.
    start_angles : (3,) rad
        Of the start, about the goal's axes; zeros where the goal is a quaternion.
    change : (3,) rad
        By how much the goal's angles differ from these, whole turns included; zeros where the goal is a quaternion.
    """

    start: Attitude
    goal: Attitude
    start_angles: Array = field(init=False)
    change: Array = field(init=False)

    def __post_init__(self) -> None:
        """Compare the angles."""
        start_angles = change = np.zeros(3)
        if self.goal.axes is not None:
            start_angles = self.start.angles_about(self.goal.axes)
            change = np.array(self.goal.angles) - start_angles
        vars(self).update(start_angles=read_only(start_angles), change=read_only(change))


def required(attitude: Attitude | None) -> Attitude:
    """The attitude of a state, which has one where the robot flies in space."""
    assert attitude is not None, "the robot flies in space"
    return attitude


def _are_axes(axes: str) -> bool:
    return len(axes) == 3 and set(axes) <= set("xyz") and axes[0] != axes[1] != axes[2]


def tilt(axes: str, second: Any) -> Any:
    """By how much, rad, the second angle about axes is off from where the first and the third are defined best."""
    return abs(second) if axes[0] != axes[2] else abs(second - math.pi / 2)
