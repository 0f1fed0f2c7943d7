"""What is measured in flight, checked: numbers of the right shapes, in time, and near what was to be expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.plans.plan import Plan

ORIENTATION_JUMP = 0.6  # [rad] beside what is expected; a turn more or less is never accepted
LARGEST_JUMP = 2.0  # [rad] the same, long after the last measurement
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
        positions, velocities = (np.array(values, dtype=np.float64).reshape(size) for values in joints)
        place, speed = (None if value is None else np.array(value, dtype=np.float64).reshape(2) for value in com)
    except Exception:  # whatever a caller's object raises: the flight goes on
        return None
    if (place is None) != (speed is None):
        return None
    arrays = [positions, velocities, *([] if place is None or speed is None else [place, speed])]
    if not all(map(math.isfinite, (time, angle, rate, *chain.from_iterable(array.tolist() for array in arrays)))):
        return None
    return Measurement(time, angle, rate, positions, velocities, place, speed)


class Plausibility:
    """Bounds of what a measurement may differ by from what was expected."""

    def __init__(self, plan: Plan) -> None:
        state = plan.at(np.linspace(0.0, plan.duration, 65))
        fastest = float(np.abs(state.orientation_rate).max())
        self._drift = 0.5 * fastest
        self._base_rate = RATE_JUMP + fastest
        self._joint_rate: list[float] = (RATE_JUMP + 2 * np.abs(state.velocities).max(axis=0)).tolist()

    def joints(self, measured: Measurement, positions: Array, velocities: Array) -> bool:
        """Whether joints are near their reference (n,)."""
        places = zip(measured.positions.tolist(), positions.tolist(), strict=True)
        rates = zip(measured.velocities.tolist(), velocities.tolist(), self._joint_rate, strict=True)
        return all(abs(one - other) <= POSITION_JUMP for one, other in places) and all(
            abs(one - other) <= fastest for one, other, fastest in rates
        )

    def base(self, measured: Measurement, orientation: float, rate: float, unseen: float) -> bool:
        """Whether the base is near what is expected, ``unseen`` s after the last measurement."""
        reach = min(ORIENTATION_JUMP + self._drift * unseen, LARGEST_JUMP)
        return (
            abs(measured.orientation - orientation) <= reach
            and abs(measured.orientation_rate - rate) <= self._base_rate
        )

    @staticmethod
    def com(measured: Measurement, position: Array, velocity: Array) -> bool:
        """Whether the centre of mass is near its path."""
        if measured.com_position is None or measured.com_velocity is None:
            return True
        near = np.abs(measured.com_position - position) <= PLACE_JUMP
        return bool(near.all() and (np.abs(measured.com_velocity - velocity) <= SPEED_JUMP).all())

    @staticmethod
    def may_be(measured: Measurement, orientation: float) -> bool:
        """Whether a robot that was hit, or long unseen, may be there: a turn more or less is never accepted."""
        return abs(measured.orientation - orientation) <= LARGEST_JUMP


class Recovery:
    """Measurements that are far from what was expected, but go on from one another: the robot was hit, say."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget them: one was as expected."""
        self._last: Measurement | None = None
        self._count = 0
        self._off = np.zeros(0)

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
