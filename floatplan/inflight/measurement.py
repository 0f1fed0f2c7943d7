"""A measurement in flight, and whether it can be one: numbers of the right shapes, near what was to be expected."""

import math
from collections.abc import Iterable
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
CONSISTENT = 5  # [-] measurements that go on from one another, after which a robot that was hit is where they say
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
        off = _differences(measured.positions.tolist(), expected.positions.tolist())
        rates_off = _differences(measured.velocities.tolist(), expected.velocities.tolist())
        return max(off) <= POSITION_JUMP and all(map(le, rates_off, self._joint_rate))

    def base(self, measured: Measurement, expected: Expected) -> bool:
        """Whether the base is near what is expected, as well as that is known."""
        return (
            abs(measured.orientation - expected.beside) <= GATE * expected.deviation
            and abs(measured.orientation_rate - expected.rate) <= self._base_rate
        )

    @staticmethod
    def mistaken(measured: Measurement, expected: Expected) -> str:
        """What explains angles that are not where they are expected: degrees, or joints in another order."""
        angles = measured.positions.tolist()
        reference = expected.positions.tolist()
        off = _differences(angles, reference)
        if max(off) > MISTAKEN:
            explained = EXPLAINED * sum(off)
            if sum(_differences(map(math.radians, angles), reference)) <= explained:
                return "the joints fit their reference as degrees: give radians"
            if sum(_differences(sorted(angles), sorted(reference))) <= explained:
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


def _differences(one: Iterable[float], other: Iterable[float]) -> list[float]:
    """Magnitudes of differences; of lists, which are quicker than arrays of a few numbers."""
    return [abs(value) for value in map(sub, one, other)]


class _Chain:
    """Measurements that go on from one another, and how many they are."""

    def __init__(self, measured: Measurement, count: int) -> None:
        self.count = count
        self._last = measured
        self._off: Array | float = 0.0  # [rad] of the angles, from where the rates lead

    def takes(self, measured: Measurement) -> bool:
        """Whether a measurement is where the last one's rates and its own lead; if so it is the last one."""
        last = self._last
        dt = measured.time - last.time
        moved = np.append(measured.positions, measured.orientation) - np.append(last.positions, last.orientation)
        if not moved.any() or dt > LONGEST_GAP:  # a sensor that stands still
            return False
        before = np.append(last.velocities, last.orientation_rate)
        rates = (before + np.append(measured.velocities, measured.orientation_rate)) / 2
        off = self._off + (moved - dt * rates)
        if (np.abs(off) > DEVIATION).any():
            return False
        self.count += 1
        self._last = measured
        self._off = off
        return True


class Recovery:
    """Whether measurements that are far from what was expected are to be believed.

    They are where they go on from one that was believed: a joint lags behind its reference, say. Else where enough go
    on from one another: the robot was hit.
    """

    def __init__(self) -> None:
        self._chains: list[_Chain] = []

    def believe(self, measured: Measurement) -> None:
        """One was as expected."""
        self._chains = [_Chain(measured, CONSISTENT)]

    def again(self, measured: Measurement) -> bool:
        """Take in one that was not; whether it is to be believed."""
        taken = next((chain for chain in self._chains if chain.takes(measured)), None)
        believed = [chain for chain in self._chains if chain.count >= CONSISTENT]
        self._chains = [*believed[-1:], *([] if taken in believed else [taken or _Chain(measured, 1)])]
        return taken is not None and taken.count >= CONSISTENT
