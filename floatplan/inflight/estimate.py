"""The robot's state in flight, from measurements: orientation, place of the centre of mass, momentum and masses.

A measurement is checked first: numbers of the right shapes, in time, and near what was to be expected.

Between measurements the orientation goes on by (4) along the joints' reference, the centre of mass on its parabola.
What is measured beside that corrects them: orientation, momentum and masses by a Kalman filter; of the place of the
centre of mass the first measurements are averaged, later ones weigh as ``dt / PLACE_TIME``.

What is measured of a flight obeys ``h = D(q) . (theta0', q')`` with the real robot's D. The orientation, the angular
momentum and, relative to the plan's, every body's mass and inertia are the state; but for the orientation, which turns
as (4) says, they do not change. D is linear in the inertias; by a mass m_b the coupling C of
:mod:`floatplan.motion.planar.closed_form` changes by ``conj(w_b) w_b``, w_b the weights of its centre of mass. With
masses alone wrong by a few per cent, ``D . (theta0', q')`` of the plan's masses wanders by as much while the robot
tucks and stretches: a filter of h alone would lag behind it. The angles, too, tell of h: by how the base turned.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from operator import le, sub

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.motion.flight import Dynamics
from floatplan.plans.plan import Plan
from floatplan.robot.planar.tree import PlanarTree

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
PLACE_TIME = 0.02  # [s] time constant of the low-pass filter
MASS_ERROR = 0.05  # [-] of what is known of masses and inertias beforehand
MOMENTUM_ERROR = 0.2  # [-] of the plan's h
SLOWEST_TURN = 1.0  # [rad/s] whose momentum is the least scale of h
ORIENTATION_ERROR = 0.05  # [rad] at takeoff
WANDER = 0.002  # [-] of the errors, per root of a second, by which the state may change
ORIENTATION_WANDER = 0.0005  # [rad] the same of the orientation


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


def _apart(one: list[float], other: list[float]) -> Iterator[float]:
    return map(abs, map(sub, one, other))


def _farthest(one: list[float], other: list[float]) -> float:
    return max(_apart(one, other))


def _distance(one: list[float], other: list[float]) -> float:
    return sum(_apart(one, other))


class _Chain:
    """Measurements that go on from one another, and how many they are."""

    def __init__(self, measured: Measurement, count: int) -> None:
        self.count, self._last = count, measured
        self._off: Array | float = 0.0  # [rad] of the angles, from where the rates lead

    def takes(self, measured: Measurement) -> bool:
        """Whether a measurement is where the last one's rates and its own lead; if so it is the last one."""
        last, dt = self._last, measured.time - self._last.time
        moved, before = _angles(measured) - _angles(last), np.append(last.velocities, last.orientation_rate)
        if not moved.any() or dt > LONGEST_GAP:  # a sensor that stands still
            return False
        rates = (before + np.append(measured.velocities, measured.orientation_rate)) / 2
        off = self._off + (moved - dt * rates)
        if (np.abs(off) > DEVIATION).any():
            return False
        self.count, self._last, self._off = self.count + 1, measured, off
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


def _angles(measured: Measurement) -> Array:
    """Of joints and base (n+1,), rad."""
    return np.append(measured.positions, measured.orientation)


class Identification:
    """The filter's ``state``: orientation, rad, h, kg m^2/s, and relative errors of masses and inertias (m,) each.

    Its arrays, with ``covariance`` and how many ``surprises`` came one after the other, are changed in place.
    ``inertia`` is that of the robot, all joints held, at takeoff, kg m^2.
    """

    def __init__(self, bodies: int, orientation: float, angular_momentum: float, inertia: float) -> None:
        scale = MOMENTUM_ERROR * max(abs(angular_momentum), SLOWEST_TURN * inertia)
        self.deviations = np.concatenate(([ORIENTATION_ERROR, scale], np.full(2 * bodies, MASS_ERROR)))
        self.covariance = np.diag(self.deviations**2)
        self.wander = (WANDER * self.deviations) ** 2
        self.wander[0] = ORIENTATION_WANDER**2
        self.state = np.zeros(2 + 2 * bodies)
        self.state[:2] = orientation, angular_momentum
        self.surprises = np.zeros(1, dtype=np.int64)  # negative: to the other side

    @property
    def orientation(self) -> float:
        """Estimate of the orientation, rad, with the joints on their reference."""
        return float(self.state[0])

    @property
    def angular_momentum(self) -> float:
        """Estimate of h, kg m^2/s."""
        return float(self.state[1])

    def forget(self) -> None:
        """Orientation and momentum are known no better than at takeoff: the robot was hit, or was long unseen."""
        self.covariance[:2] = self.covariance[:, :2] = 0.0
        self.covariance.flat[: 2 * len(self.state) : len(self.state) + 1] = self.deviations[:2] ** 2
        self.surprises[0] = 0


def adapted(tree: PlanarTree, errors: Array) -> Dynamics:
    """Return a tree's dynamics with relative errors (2m,) of masses and inertias, where its mass centres stay."""
    masses, inertias = np.split(errors, 2)
    weights = tree.point_weights(np.arange(len(masses)), tree.center)
    coupling = tree.coupling + weights.conj().T @ ((masses * tree.mass)[:, None] * weights)
    return Dynamics(tree, coupling, tree.inertia * (1 + inertias))


@dataclass
class Estimate:
    """At ``time``: orientation with the joints on their reference, h and masses.

    Place and velocity of the centre of mass are those at ``com_time``; ``placed`` counts its measurements.
    """

    time: float
    inertial: Identification
    com_position: Array
    com_velocity: Array
    gravity: float
    com_time: float = 0.0
    placed: int = 0

    def place(self, time: float) -> tuple[Array, Array]:
        """Place and velocity (2,) of the centre of mass at a time."""
        dt = time - self.com_time
        fall = np.array([0.0, self.gravity * dt])
        return self.com_position + dt * (self.com_velocity - fall / 2), self.com_velocity - fall

    def take_in(self, measured: Measurement) -> None:
        """Take in when was measured, and where the centre of mass is."""
        self.time = measured.time
        if measured.com_position is None or measured.com_velocity is None:
            return
        dt = measured.time - self.com_time
        position, velocity = self.place(measured.time)
        self.com_time = measured.time
        self.placed += 1
        weight = max(1 / self.placed, 1 - math.exp(-dt / PLACE_TIME))  # their mean at first
        self.com_position = position + weight * (measured.com_position - position)
        self.com_velocity = velocity + weight * (measured.com_velocity - velocity)

    def landing(self, height: float) -> float | None:
        """Time at which the centre of mass comes down to a height, m; None where it does not."""
        climb, speed = height - self.com_position[1], self.com_velocity[1]
        reach = speed * speed - 2 * self.gravity * climb
        if self.gravity <= 0 or reach < 0:
            return None
        return self.com_time + float((speed + math.sqrt(reach)) / self.gravity)
