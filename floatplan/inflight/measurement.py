"""A measurement in flight, and whether it can be one: numbers of the right shapes, near what is expected."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import le, sub
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.inflight.orientation import Orientations
from floatplan.plans.plan import Plan


@dataclass(frozen=True)
class PlausibilitySettings:
    """By what a measurement may differ from what is expected.

    Attributes
    ----------
    gate : standard deviations of an orientation from the expected one
    noise : standard deviation of angles that is not yet an outlier's, rad
    orientation : largest difference at which a robot that was hit can be believed again, rad
    mistake : difference of a joint from its reference, beyond which another order or unit is suspected, rad
    unexplained : share of the joints' differences that remains at most, where that is it
    position : difference of a joint from its reference, rad
    rate : difference of the rates of base and joints, in addition to the plan's fastest, rad/s
    com_position, com_velocity : difference of the centre of mass, m, m/s
    chain : measurements that follow from one another, after which a robot that was hit is where they say
    deviation : of angles from where their rates lead, rad
    longest_gap : between measurements of a chain, s
    """

    gate: float = 5.0
    noise: float = math.radians(1.0)
    orientation: float = 2.0
    mistake: float = 0.1
    unexplained: float = 0.4
    position: float = 0.6
    rate: float = 3.0
    com_position: float = 1.0
    com_velocity: float = 3.0
    chain: int = 5
    deviation: float = 0.05
    longest_gap: float = 0.1


PLAUSIBLE = PlausibilitySettings()


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Measurement:
    """The robot at a time, s since takeoff; units and shapes as of :meth:`floatplan.inflight.replanner.Replanner`.

    The orientation is one of :class:`~floatplan.inflight.orientation.Orientations`, the base's rates (e,) a list.
    """

    time: float
    orientation: Any
    orientation_rate: list[float]
    positions: Array
    velocities: Array
    com_position: Array | None = None
    com_velocity: Array | None = None


def read(
    orientations: Orientations,
    t: float,
    orientation: npt.ArrayLike,
    orientation_rate: npt.ArrayLike,
    joints: tuple[npt.ArrayLike, npt.ArrayLike],
    com: tuple[npt.ArrayLike | None, npt.ArrayLike | None],
    size: int,
) -> Measurement | None:
    """Return a measurement of ``size`` joints; None where anything is no finite number or of another shape."""
    try:
        time = float(t)
        attitude, rates = orientations.read(orientation, orientation_rate)
        positions = np.array(joints[0], dtype=np.float64).reshape(size)
        velocities = np.array(joints[1], dtype=np.float64).reshape(size)
        com_position = None if com[0] is None else np.array(com[0], dtype=np.float64).reshape(orientations.com)
        com_velocity = None if com[1] is None else np.array(com[1], dtype=np.float64).reshape(orientations.com)
    except Exception:  # whatever a caller's object raises: the flight goes on
        return None
    if (com_position is None) != (com_velocity is None):
        return None
    numbers = [time, *rates]
    if isinstance(attitude, float):
        numbers.append(attitude)
    for array in (positions, velocities, com_position, com_velocity):
        if array is not None:
            numbers += array.tolist()
    if not all(map(math.isfinite, numbers)):
        return None
    return Measurement(time, attitude, rates, positions, velocities, com_position, com_velocity)


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Expected:
    """Joints (n,) and base where a measurement is made, if they were on their reference; rad, rad/s.

    ``orientation`` and ``rate`` (e,) are the base's; with the joints as they are measured it would differ by the
    rotation ``offset`` (e,). ``variance`` (e,), rad^2, is the filter's of that orientation; ``noise`` (e,) is the
    variance of a measured one, over that of all angles: the joints' count as well.
    """

    positions: Array
    velocities: Array
    orientation: Any
    rate: list[float]
    offset: list[float]
    variance: list[float]
    noise: list[float]

    @property
    def deviations(self) -> list[float]:
        """Standard deviations (e,) of a measured orientation from that, rad."""
        return [*map(_deviation, self.variance, self.noise)]


def _deviation(variance: float, noise: float) -> float:
    """Standard deviation of a measured orientation, rad: the filter's, and the noise of all angles."""
    return math.sqrt(max(variance, 0.0) + PLAUSIBLE.noise**2 * noise)


class Plausibility:
    """Bounds by which a measurement may differ from what is expected."""

    def __init__(self, plan: Plan) -> None:
        state = plan.at(np.linspace(0.0, plan.duration, 65))
        fastest = float(np.abs(state.orientation_rate).max())
        self._base_rate = PLAUSIBLE.rate + fastest
        self._joint_rate: list[float] = (PLAUSIBLE.rate + 2 * np.abs(state.velocities).max(axis=0)).tolist()

    def joints(self, measured: Measurement, expected: Expected) -> bool:
        """Whether joints are near their reference."""
        off = _differences(measured.positions.tolist(), expected.positions.tolist())
        rates_off = _differences(measured.velocities.tolist(), expected.velocities.tolist())
        return max(off) <= PLAUSIBLE.position and all(map(le, rates_off, self._joint_rate))

    def base(self, off: Sequence[float], measured: Measurement, expected: Expected) -> bool:
        """Whether the base, its orientation ``off`` (e,), rad, is near what is expected, in view of its uncertainty."""
        for part, variance, noise in zip(off, expected.variance, expected.noise, strict=True):
            if not part <= PLAUSIBLE.gate * _deviation(variance, noise):
                return False
        return max(_differences(measured.orientation_rate, expected.rate)) <= self._base_rate

    @staticmethod
    def mistaken(measured: Measurement, expected: Expected) -> str:
        """What explains joints that are not where they are expected: degrees, or another order."""
        angles = measured.positions.tolist()
        reference = expected.positions.tolist()
        off = _differences(angles, reference)
        if max(off) > PLAUSIBLE.mistake:
            unexplained = PLAUSIBLE.unexplained * sum(off)
            if sum(_differences(map(math.radians, angles), reference)) <= unexplained:
                return "the joints fit their reference as degrees: give radians"
            if sum(_differences(sorted(angles), sorted(reference))) <= unexplained:
                return "the joints fit their reference in another order: give them as robot.joints lists them"
        return ""

    @staticmethod
    def com(measured: Measurement, position: Array, velocity: Array) -> bool:
        """Whether the centre of mass is near its path."""
        if measured.com_position is None or measured.com_velocity is None:
            return True
        near = np.abs(measured.com_position - position) <= PLAUSIBLE.com_position
        as_fast = np.abs(measured.com_velocity - velocity) <= PLAUSIBLE.com_velocity
        return bool(near.all() and as_fast.all())


def _differences(one: Iterable[float], other: Iterable[float]) -> list[float]:
    """Magnitudes of differences; of lists, which are quicker than arrays of a few numbers."""
    return list(map(abs, map(sub, one, other)))


class _Chain:
    """Measurements that follow from one another, and how many they are."""

    def __init__(self, orientations: Orientations, measured: Measurement, count: int) -> None:
        self._orientations = orientations
        self.count = count
        self._last = measured
        self._off: Array | float = 0.0  # [rad] of the angles, from where the rates lead

    def takes(self, measured: Measurement) -> bool:
        """Whether a measurement is where the last one's rates and its own lead; if so it is the last one."""
        last = self._last
        dt = measured.time - last.time
        rotated = self._orientations.difference(measured.orientation, last.orientation)
        moved = np.append(measured.positions - last.positions, rotated)
        if not moved.any() or dt > PLAUSIBLE.longest_gap:  # a sensor that stands still
            return False
        rates = (self._rates(last) + self._rates(measured)) / 2
        off = self._off + (moved - dt * rates)
        if (np.abs(off) > PLAUSIBLE.deviation).any():
            return False
        self.count += 1
        self._last = measured
        self._off = off
        return True

    def _rates(self, measured: Measurement) -> Array:
        """Rates (n + e,) of joints and base."""
        turning = self._orientations.world_rates(measured.orientation, measured.orientation_rate)
        return np.append(measured.velocities, turning)


class Recovery:
    """Whether measurements that are far from what was expected are to be believed.

    They are where they follow from one that was believed: a joint lags behind its reference, say. Else where enough
    follow from one another: the robot was hit.
    """

    def __init__(self, orientations: Orientations) -> None:
        self._orientations = orientations
        self._chains: list[_Chain] = []

    def believe(self, measured: Measurement) -> None:
        """One was as expected."""
        self._chains = [_Chain(self._orientations, measured, PLAUSIBLE.chain)]

    def believes(self, measured: Measurement) -> bool:
        """Add one that was not; return whether it is to be believed."""
        own = None
        for chain in self._chains:
            if chain.takes(measured):
                own = chain
                break
        believed = [chain for chain in self._chains if chain.count >= PLAUSIBLE.chain]
        is_believed = own is not None and own.count >= PLAUSIBLE.chain
        self._chains = believed[-1:]
        if not is_believed:
            self._chains.append(own or _Chain(self._orientations, measured, 1))
        return is_believed
