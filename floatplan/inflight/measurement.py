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
    for array in (positions, velocities, com_position, com_velocity):
        if array is not None:
            numbers += array.tolist()
    if not all(map(math.isfinite, numbers)):
        return None
    return Measurement(time, attitude, rates, positions, velocities, com_position, com_velocity)


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Expected:
    """Joints and base where a measurement is made, if they were on their reference, and how far it is from there.

    Attributes
    ----------
    positions : (n,) rad
    orientation : the base's
    offset : (e,) rad
        Rotation by which that differs with the joints as they are measured.
    allowed : (e,) rad
        Rotation from there of an orientation that can be one: so many deviations by the filter's variance and the
        noise of all angles, as the joints' count as well.
    positions_off, velocities_off : (n,) rad, rad/s
        Magnitudes of the differences of measured joints.
    rate_off : (e,) rad/s
        The same of the base's rates.
    """

    positions: Array
    orientation: Any
    offset: list[float]
    allowed: list[float]
    positions_off: list[float]
    velocities_off: list[float]
    rate_off: list[float]


class Plausibility:
    """Bounds by which a measurement may differ from what is expected."""

    def __init__(self, plan: Plan) -> None:
        state = plan.at(np.linspace(0.0, plan.duration, 65))
        fastest = float(np.abs(state.orientation_rate).max())
        self._base_rate = PLAUSIBLE.rate + fastest
        self._joint_rate: list[float] = (PLAUSIBLE.rate + 2 * np.abs(state.velocities).max(axis=0)).tolist()

    def joints(self, expected: Expected) -> bool:
        """Whether joints are near their reference."""
        is_near = max(expected.positions_off) <= PLAUSIBLE.position
        return is_near and all(map(le, expected.velocities_off, self._joint_rate))

    def base(self, off: Sequence[float], expected: Expected) -> bool:
        """Whether the base, its orientation ``off`` (e,), rad, is near what is expected, in view of its uncertainty."""
        return all(map(le, off, expected.allowed)) and max(expected.rate_off) <= self._base_rate

    @staticmethod
    def mistaken(measured: Measurement, expected: Expected) -> str:
        """What explains joints that are not where they are expected: degrees, or another order."""
        if max(expected.positions_off) <= PLAUSIBLE.mistake:
            return ""
        angles = measured.positions.tolist()
        reference = expected.positions.tolist()
        unexplained = PLAUSIBLE.unexplained * sum(expected.positions_off)
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


def _differences(one: Iterable[float], other: Iterable[float]) -> Iterable[float]:
    """Magnitudes of differences."""
    return map(abs, map(sub, one, other))


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
