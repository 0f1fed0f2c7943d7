"""Orientations as corrections compute with them: an angle in a plane, in space a rotation from the base to the world.

Small rotations have e numbers, rad: about the plane's normal, or about the world's axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array

TURN = 2 * math.pi  # [rad]


class PlanarOrientations:
    """Angles, rad.

    Attributes
    ----------
    size : e
    com : how many coordinates the centre of mass has
    suspicious : rad
        A difference from what is expected from which on another convention is suspected.
    """

    size = 1
    com = 2
    suspicious = math.pi / 2

    def read(self, orientation: Any, rate: Any) -> tuple[float, list[float]]:
        """Return an angle and its rate (1,), rad/s, of what was measured; raise where it is neither."""
        angle = float(orientation)
        if not math.isfinite(angle):
            raise ValueError
        return angle, [float(rate)]

    def difference(self, orientation: Any, expected: Any) -> list[float]:
        """Return the rotation (1,), rad, that leads from one orientation to another."""
        return [orientation - expected]

    def unwrapped(self, orientation: Any, difference: list[float], offset: Sequence[float]) -> Any:
        """Return a measured orientation by so many turns more or less that it is nearest to the one expected.

        ``difference`` (1,) leads to it from a known one, and is changed with it; ``offset`` (1,) to the one expected.
        """
        turns = (difference[0] - offset[0]) / TURN
        if not 0.5 < abs(turns) < 100:  # an angle farther off is no orientation
            return orientation
        whole = TURN * round(turns)
        difference[0] -= whole
        return orientation - whole

    def world_rates(self, orientation: Any, rates: Sequence[float]) -> list[float]:
        """Return the rates (1,) of such a rotation, rad/s, where the base turns at these."""
        return [*rates]

    def misread(self, measured: Any, expected: Any, allowed: float) -> str:
        """Return which other convention explains an orientation, up to an angle, rad; "" where none does."""
        off_as_degrees = abs(math.radians(measured) - expected)
        if off_as_degrees <= allowed:
            return "the orientation is where it is expected in degrees: give radians"
        return ""


class SpatialOrientations:
    """Rotations (3, 3) from the base's axes to the world's, measured as quaternions x, y, z, w.

    Members as of :class:`PlanarOrientations`.
    """

    size = 3
    com = 3
    suspicious = math.pi / 4

    def read(self, orientation: Any, rate: Any) -> tuple[Array, list[float]]:
        """Return what a quaternion (4,) says, and an angular velocity (3,) in the base's axes, rad/s."""
        quaternion = np.array(orientation, dtype=np.float64).reshape(4)
        shortest = 0.5  # [-] of a quaternion that was rounded, or of which a number is missing
        if not shortest < sum(part * part for part in quaternion.tolist()) < 1 / shortest:
            raise ValueError
        return rotation(quaternion), np.array(rate, dtype=np.float64).reshape(3).tolist()

    def difference(self, orientation: Any, expected: Any) -> list[float]:
        """Return the vector of the shortest rotation (3,), rad, in the world's axes."""
        return rotation_vector(orientation @ expected.T)

    def unwrapped(self, orientation: Any, difference: list[float], offset: Sequence[float]) -> Any:
        """Return it: whole turns do not show."""
        return orientation

    def world_rates(self, orientation: Any, rates: Sequence[float]) -> list[float]:
        """Return rates (3,) in the world's axes, rad/s."""
        return [*(orientation @ rates)]

    def misread(self, measured: Any, expected: Any, allowed: float) -> str:
        """Return whether a scalar comes first, or the rotation is from the world to the base."""
        x, y, z, w = quaternion_of(measured)
        if _size(self.difference(rotation(np.array([y, z, w, x])), expected)) <= allowed:
            return "the quaternion is where it is expected as w, x, y, z: give x, y, z, w"
        if _size(self.difference(measured.T, expected)) <= allowed:
            return "the quaternion is where it is expected as from the world to the base: give its conjugate"
        return ""


Orientations: TypeAlias = PlanarOrientations | SpatialOrientations


def _size(vector: Sequence[float]) -> float:
    return math.sqrt(sum(part * part for part in vector))


def rotation(quaternion: Array) -> Array:
    """Return the rotation (3, 3) of a quaternion x, y, z, w of any length but zero."""
    x, y, z, w = quaternion.tolist()
    twice = 2 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1 - twice * (y * y + z * z), twice * (x * y - z * w), twice * (x * z + y * w)],
            [twice * (x * y + z * w), 1 - twice * (x * x + z * z), twice * (y * z - x * w)],
            [twice * (x * z - y * w), twice * (y * z + x * w), 1 - twice * (x * x + y * y)],
        ]
    )


def quaternion_of(attitude: Array) -> list[float]:
    """Return the unit quaternion x, y, z, w of a rotation (3, 3), by its largest entry."""
    (a, b, c), (d, e, f), (g, h, i) = attitude.tolist()
    found = max(
        ([1 + a - e - i, b + d, c + g, h - f], 1 + a - e - i),
        ([b + d, 1 - a + e - i, f + h, c - g], 1 - a + e - i),
        ([c + g, f + h, 1 - a - e + i, d - b], 1 - a - e + i),
        ([h - f, c - g, d - b, 1 + a + e + i], 1 + a + e + i),
        key=lambda candidate: candidate[1],
    )[0]
    length = _size(found)
    return [part / length for part in found]


def rotation_vector(attitude: Array) -> list[float]:
    """Return the vector (3,) of the shortest rotation, rad, of a rotation (3, 3)."""
    *along, scalar = quaternion_of(attitude)
    sine = _size(along)
    if not sine:
        return along
    angle = 2 * math.atan2(math.copysign(sine, scalar), abs(scalar))
    return [angle / sine * part for part in along]
