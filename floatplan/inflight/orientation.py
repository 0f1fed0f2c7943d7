"""Orientations as corrections compute with them: an angle in a plane, in space a rotation from the base to the world.

Both are turned by small turns of e numbers, rad: about the plane's normal, or about the world's axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from floatplan.arrays import Array

TURN = 2 * math.pi  # [rad]
MOST_TURNS = 100  # [-] farther off than that an angle is no orientation


class Orientations(Protocol):
    """What is computed with orientations.

    Attributes
    ----------
    size : e
    com : how many coordinates the centre of mass has
    suspicious : rad, a turn from what is expected from which on another convention is suspected
    """

    size: int
    com: int
    suspicious: float

    def read(self, orientation: Any, rate: Any) -> tuple[Any, list[float]]:
        """Return an orientation and the base's rates (e,), rad/s, of what was measured; raise where it is neither."""
        ...

    def turned(self, orientation: Any, since: Any) -> list[float]:
        """Return the turn (e,), rad, that leads from one orientation to another."""
        ...

    def unwrapped(self, orientation: Any, turn: list[float], expected: Sequence[float]) -> Any:
        """Return a measured orientation, of those that measure the same the nearest to the one expected.

        ``turn`` (e,) leads to it from a known one, and is changed with it; ``expected`` (e,) leads to the one expected.
        """
        ...

    def world_rates(self, orientation: Any, rates: Sequence[float]) -> list[float]:
        """Return the rates (e,) of such a turn, rad/s, where the base turns at these."""
        ...

    def misread(self, measured: Any, expected: Any, allowed: float) -> str:
        """Return which other convention explains an orientation, up to an angle, rad; "" where none does."""
        ...


class PlanarOrientations:
    """Angles, rad."""

    size = 1
    com = 2
    suspicious = math.pi / 2

    def read(self, orientation: Any, rate: Any) -> tuple[float, list[float]]:
        """As :class:`Orientations` says, of an angle and its rate."""
        return float(orientation), [float(rate)]

    def turned(self, orientation: float, since: float) -> list[float]:
        """Their difference."""
        return [orientation - since]

    def unwrapped(self, orientation: float, turn: list[float], expected: Sequence[float]) -> float:
        """By so many turns more or less."""
        turns = (turn[0] - expected[0]) / TURN
        if not 0.5 < abs(turns) < MOST_TURNS:
            return orientation
        whole = TURN * round(turns)
        turn[0] -= whole
        return orientation - whole

    def world_rates(self, orientation: float, rates: Sequence[float]) -> list[float]:
        """The same."""
        return [*rates]

    def misread(self, measured: float, expected: float, allowed: float) -> str:
        """Degrees."""
        off_as_degrees = abs(math.radians(measured) - expected)
        if off_as_degrees <= allowed:
            return "the orientation is where it is expected in degrees: give radians"
        return ""


class SpatialOrientations:
    """Rotations (3, 3) from the base's axes to the world's; measured are quaternions x, y, z, w."""

    size = 3
    com = 3
    suspicious = math.pi / 4

    def read(self, orientation: Any, rate: Any) -> tuple[Array, list[float]]:
        """As :class:`Orientations` says, of a quaternion (4,) and an angular velocity (3,) in the base's axes."""
        quaternion = np.array(orientation, dtype=np.float64).reshape(4)
        shortest = 0.5  # [-] of a quaternion that was rounded, or of which a number is missing
        if not shortest < float(quaternion @ quaternion) < 1 / shortest:
            raise ValueError
        return rotation(quaternion), np.array(rate, dtype=np.float64).reshape(3).tolist()

    def turned(self, orientation: Array, since: Array) -> list[float]:
        """The vector of the shortest rotation."""
        return rotation_vector(orientation @ since.T)

    def unwrapped(self, orientation: Array, turn: list[float], expected: Sequence[float]) -> Array:
        """Itself."""
        return orientation

    def world_rates(self, orientation: Array, rates: Sequence[float]) -> list[float]:
        """In the world's axes."""
        turned: list[float] = (orientation @ rates).tolist()
        return turned

    def misread(self, measured: Array, expected: Array, allowed: float) -> str:
        """A quaternion whose scalar comes first, or the rotation from the world to the base."""
        x, y, z, w = quaternion_of(measured)
        if _size(self.turned(rotation(np.array([y, z, w, x])), expected)) <= allowed:
            return "the quaternion is where it is expected as w, x, y, z: give x, y, z, w"
        if _size(self.turned(measured.T, expected)) <= allowed:
            return "the quaternion is where it is expected as from the world to the base: give its conjugate"
        return ""


def _size(turn: Sequence[float]) -> float:
    return math.sqrt(sum(part * part for part in turn))


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
