"""A measurement in flight, and whether it can be one: numbers of the right shapes, near what is expected."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from operator import le, sub

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.plans.plan import Plan


@dataclass(frozen=True)
class PlausibilitySettings:
    """By what a measurement may differ from what is expected.

    Attributes
    ----------
    gate : standard deviations of an orientation from the expected one
    noise : standard deviation of angles that is not yet an outlier's, rad
    orientation : difference after which a robot that was hit is believed again, rad
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
        time = float(t)
        angle = float(orientation)
        rate = float(orientation_rate)
        positions = np.array(joints[0], dtype=np.float64).reshape(size)
        velocities = np.array(joints[1], dtype=np.float64).reshape(size)
        com_position = None if com[0] is None else np.array(com[0], dtype=np.float64).reshape(2)
        com_velocity = None if com[1] is None else np.array(com[1], dtype=np.float64).reshape(2)
    except Exception:  # whatever a caller's object raises: the flight goes on
        return None
    if (com_position is None) != (com_velocity is None):
        return None
    numbers = [time, angle, rate]
    for array in (positions, velocities, com_position, com_velocity):
        if array is not None:
            numbers += array.tolist()
    if not all(map(math.isfinite, numbers)):
        return None
    return Measurement(time, angle, rate, positions, velocities, com_position, com_velocity)


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Expected:
    """Joints (n,) and base where a measurement is made, if they were on their reference; rad, rad/s.

    ``orientation`` and ``rate`` are the base's; with the joints as they are measured it would differ by ``offset``.
    ``variance``, rad^2, is the filter's of that orientation; ``noise`` is the variance of a measured one, over that of
    all angles: the joints' count as well.
    """

    positions: Array
    velocities: Array
    orientation: float
    rate: float
    offset: float
    variance: float
    noise: float

    @property
    def orientation_as_measured(self) -> float:
        """The base's orientation with the joints as they are measured, rad."""
        return self.orientation + self.offset

    @property
    def deviation(self) -> float:
        """Standard deviation of a measured orientation from that, rad: the filter's, and the noise of all angles."""
        return math.sqrt(max(self.variance, 0.0) + PLAUSIBLE.noise**2 * self.noise)


def unwrapped(orientation: float, expected: float) -> float:
    """Return the orientation by so many turns more or less that it is nearest to the expected one, rad."""
    turns = (orientation - expected) / (2 * math.pi)
    most = 100  # turns: farther off it is no orientation
    return orientation - 2 * math.pi * round(turns) if 0.5 < abs(turns) < most else orientation


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

    def base(self, measured: Measurement, expected: Expected) -> bool:
        """Whether the base is near what is expected, in view of its uncertainty."""
        off = abs(measured.orientation - expected.orientation_as_measured)
        rate_off = abs(measured.orientation_rate - expected.rate)
        return off <= PLAUSIBLE.gate * expected.deviation and rate_off <= self._base_rate

    @staticmethod
    def mistaken(measured: Measurement, expected: Expected) -> str:
        """What explains angles that are not where they are expected: degrees, or joints in another order."""
        angles = measured.positions.tolist()
        reference = expected.positions.tolist()
        off = _differences(angles, reference)
        if max(off) > PLAUSIBLE.mistake:
            unexplained = PLAUSIBLE.unexplained * sum(off)
            if sum(_differences(map(math.radians, angles), reference)) <= unexplained:
                return "the joints fit their reference as degrees: give radians"
            if sum(_differences(sorted(angles), sorted(reference))) <= unexplained:
                return "the joints fit their reference in another order: give them as robot.joints lists them"
        off_as_radians = abs(measured.orientation - expected.orientation)
        off_as_degrees = abs(math.radians(measured.orientation) - expected.orientation)
        if off_as_radians > math.pi / 2 and off_as_degrees <= PLAUSIBLE.gate * expected.deviation:
            return "the orientation is where it is expected in degrees: give radians"
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
    return [abs(value) for value in map(sub, one, other)]


class _Chain:
    """Measurements that follow from one another, and how many they are."""

    def __init__(self, measured: Measurement, count: int) -> None:
        self.count = count
        self._last = measured
        self._off: Array | float = 0.0  # [rad] of the angles, from where the rates lead

    def takes(self, measured: Measurement) -> bool:
        """Whether a measurement is where the last one's rates and its own lead; if so it is the last one."""
        last = self._last
        dt = measured.time - last.time
        moved = np.append(measured.positions, measured.orientation) - np.append(last.positions, last.orientation)
        if not moved.any() or dt > PLAUSIBLE.longest_gap:  # a sensor that stands still
            return False
        before = np.append(last.velocities, last.orientation_rate)
        rates = (before + np.append(measured.velocities, measured.orientation_rate)) / 2
        off = self._off + (moved - dt * rates)
        if (np.abs(off) > PLAUSIBLE.deviation).any():
            return False
        self.count += 1
        self._last = measured
        self._off = off
        return True


class Recovery:
    """Whether measurements that are far from what was expected are to be believed.

    They are where they follow from one that was believed: a joint lags behind its reference, say. Else where enough
    follow from one another: the robot was hit.
    """

    def __init__(self) -> None:
        self._chains: list[_Chain] = []

    def believe(self, measured: Measurement) -> None:
        """One was as expected."""
        self._chains = [_Chain(measured, PLAUSIBLE.chain)]

    def again(self, measured: Measurement) -> bool:
        """Add one that was not; return whether it is to be believed."""
        own = next((chain for chain in self._chains if chain.takes(measured)), None)
        believed = [chain for chain in self._chains if chain.count >= PLAUSIBLE.chain]
        is_believed = own is not None and own.count >= PLAUSIBLE.chain
        self._chains = believed[-1:]
        if not is_believed:
            self._chains.append(own or _Chain(measured, 1))
        return is_believed
