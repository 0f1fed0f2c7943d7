"""What is measured in flight, checked: numbers of the right shapes, in time, and near what was to be expected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from operator import le, sub

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.plans.plan import Plan

GATE = 5.0  # [-] standard deviations of an orientation beside what is expected
NOISIEST = math.radians(1.0)  # [rad] standard deviation of angles that is not yet an outlier's
LARGEST_JUMP = 2.0  # [rad] of an orientation, after which a robot that was hit is believed again
MOST_TURNS = 100  # [-] that an orientation is unwrapped by
MISTAKEN = 0.1  # [rad] of a joint beside its reference, from which on another order or unit is thought of
EXPLAINED = 0.4  # [-] of the joints' distance from their reference is left, where that is it
POSITION_JUMP = 0.6  # [rad] of a joint beside its reference
RATE_JUMP = 3.0  # [rad/s] of base and joints beside the expected, and as much again as the plan's fastest
PLACE_JUMP = 1.0  # [m] of the centre of mass
SPEED_JUMP = 3.0  # [m/s]
CONSISTENT = 5  # [-] measurements that go on from one another, after which a robot is where they say
DEVIATION = 0.05  # [rad] of angles from where their rates lead
LONGEST_GAP = 0.1  # [s] between them


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Measurement:
    """The robot at a time, s since takeoff; units and shapes as of :meth:`floatplan.inflight.replanner.Replanner`."""

    time: float
    orientation: float
    orientation_rate: float
    positions: Array
    velocities: Array
    com_position: Array | None = None
    com_velocity: Array | None = None


def read(
    t: float,
    orientation: float,
    orientation_rate: float,
    joints: tuple[npt.ArrayLike, npt.ArrayLike],
    com: tuple[npt.ArrayLike | None, npt.ArrayLike | None],
    size: int,
) -> Measurement | None:
    """Return a measurement of ``size`` joints; None where anything is no finite number or of another shape."""
    try:
        time, angle, rate = float(t), float(orientation), float(orientation_rate)
        positions = np.array(joints[0], dtype=np.float64).reshape(size)
        velocities = np.array(joints[1], dtype=np.float64).reshape(size)
        place, speed = (None if value is None else np.array(value, dtype=np.float64).reshape(2) for value in com)
    except Exception:  # whatever a caller's object raises: the flight goes on
        return None
    if (place is None) != (speed is None):
        return None
    numbers = chain.from_iterable(each.tolist() for each in (positions, velocities, place, speed) if each is not None)
    if not all(map(math.isfinite, (time, angle, rate, *numbers))):
        return None
    return Measurement(time, angle, rate, positions, velocities, place, speed)


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Expected:
    """Joints (n,) and base where a measurement is made, if they were on their reference; rad, rad/s.

    ``orientation`` and ``rate`` are the base's; it would stand ``aside`` with the joints as they are measured.
    ``variance``, rad^2, is the filter's of that orientation; ``noise`` is the variance of a measured one, over that of
    all angles: the joints' count as well.
    """

    positions: Array
    velocities: Array
    orientation: float
    rate: float
    aside: float
    variance: float
    noise: float

    @property
    def beside(self) -> float:
        """The base's orientation with the joints as they are measured, rad."""
        return self.orientation + self.aside

    @property
    def deviation(self) -> float:
        """Standard deviation of a measured orientation from that, rad: the filter's, and the noise of all angles."""
        return math.sqrt(max(self.variance, 0.0) + NOISIEST**2 * self.noise)


def unwrapped(orientation: float, expected: float) -> float:
    """Return the orientation by so many turns more or less that it is nearest to the expected one, rad."""
    turns = (orientation - expected) / (2 * math.pi)
    return orientation - 2 * math.pi * round(turns) if 0.5 < abs(turns) < MOST_TURNS else orientation


class Plausibility:
    """Bounds of what a measurement may differ by from what was expected."""

    def __init__(self, plan: Plan) -> None:
        state = plan.at(np.linspace(0.0, plan.duration, 65))
        fastest = float(np.abs(state.orientation_rate).max())
        self._base_rate = RATE_JUMP + fastest
        self._joint_rate: list[float] = (RATE_JUMP + 2 * np.abs(state.velocities).max(axis=0)).tolist()

    def joints(self, measured: Measurement, expected: Expected) -> bool:
        """Whether joints are near their reference."""
        rates = _apart(measured.velocities.tolist(), expected.velocities.tolist())
        return _farthest(measured.positions.tolist(), expected.positions.tolist()) <= POSITION_JUMP and all(
            map(le, rates, self._joint_rate)
        )

    def base(self, measured: Measurement, expected: Expected) -> bool:
        """Whether the base is near what is expected, as well as that is known."""
        return (
            abs(measured.orientation - expected.beside) <= GATE * expected.deviation
            and abs(measured.orientation_rate - expected.rate) <= self._base_rate
        )

    @staticmethod
    def mistaken(measured: Measurement, expected: Expected) -> str:
        """What explains angles that are not where they are expected: degrees, or joints in another order."""
        found, there = measured.positions.tolist(), expected.positions.tolist()
        if _farthest(found, there) > MISTAKEN:
            explained = EXPLAINED * _distance(found, there)
            if _distance(list(map(math.radians, found)), there) <= explained:
                return "the joints fit their reference as degrees: give radians"
            if _distance(sorted(found), sorted(there)) <= explained:
                return "the joints fit their reference in another order: give them as robot.joints lists them"
        if abs(measured.orientation - expected.orientation) > math.pi / 2 and (
            abs(math.radians(measured.orientation) - expected.orientation) <= GATE * expected.deviation
        ):
            return "the orientation is where it is expected in degrees: give radians"
        return ""

    @staticmethod
    def com(measured: Measurement, position: Array, velocity: Array) -> bool:
        """Whether the centre of mass is near its path."""
        if measured.com_position is None or measured.com_velocity is None:
            return True
        near = np.abs(measured.com_position - position) <= PLACE_JUMP
        return bool(near.all() and (np.abs(measured.com_velocity - velocity) <= SPEED_JUMP).all())

    @staticmethod
    def may_be(measured: Measurement, expected: Expected) -> bool:
        """Whether a robot that was hit, or long unseen, may be there."""
        return abs(measured.orientation - expected.beside) <= LARGEST_JUMP


def _apart(one: list[float], other: list[float]) -> Iterator[float]:
    return map(abs, map(sub, one, other))


def _farthest(one: list[float], other: list[float]) -> float:
    return max(_apart(one, other))


def _distance(one: list[float], other: list[float]) -> float:
    return sum(_apart(one, other))


class Recovery:
    """Measurements that are far from what was expected, but go on from one another: the robot was hit, say."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget them: one was as expected."""
        self._last: Measurement | None = None
        self._count = 0

    def again(self, measured: Measurement) -> bool:
        """Take in the next; whether so many have gone on from one another that they are to be believed."""
        last, self._last = self._last, measured
        if last is None or not self._goes_on(last, measured):
            self._count, self._off = 1, np.zeros(1 + len(measured.positions))
        else:
            self._count += 1
        return self._count >= CONSISTENT

    def _goes_on(self, last: Measurement, measured: Measurement) -> bool:
        dt = measured.time - last.time
        moved, before = _angles(measured) - _angles(last), np.append(last.velocities, last.orientation_rate)
        rates = (before + np.append(measured.velocities, measured.orientation_rate)) / 2
        if not moved.any():  # a sensor that stands still
            return False
        self._off = self._off + (moved - dt * rates)
        return dt <= LONGEST_GAP and bool((np.abs(self._off) <= DEVIATION).all())


def _angles(measured: Measurement) -> Array:
    """Of joints and base (n+1,), rad."""
    return np.append(measured.positions, measured.orientation)
