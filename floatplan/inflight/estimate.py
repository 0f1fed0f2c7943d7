"""The robot's state in flight, from measurements: orientation, place of the centre of mass, momentum and masses.

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

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.measurement import Measurement
from floatplan.motion.planar.ballistics import Ballistics
from floatplan.motion.planar.closed_form import Dynamics, centroidal_coupling
from floatplan.robot.planar.tree import PlanarTree

PLACE_TIME = 0.02  # [s] time constant of the low-pass filter
MASS_ERROR = 0.05  # [-] of what is known of masses and inertias beforehand
LARGEST_ERROR = 0.3  # [-] of them that is believed
MOMENTUM_ERROR = 0.2  # [-] of the plan's h
SLOWEST_TURN = 1.0  # [rad/s] whose momentum is the least scale of h
ORIENTATION_ERROR = 0.05  # [rad] at takeoff
ANGLE_NOISE = 0.002  # [rad] of measured angles
RATE_NOISE = 0.02  # [rad/s] of measured rates
WANDER = 0.002  # [-] of the errors, per root of a second, by which the state may change
ORIENTATION_WANDER = 0.0005  # [rad] the same of the orientation
SURPRISING = 6.0  # [-] deviations of a momentum from what is expected
SURPRISES = 5  # [-] of them to the same side, one after the other, tell of a kick


class Identification:
    """The filter's ``state``: orientation, rad, h, kg m^2/s, and relative errors of masses and inertias (m,) each.

    Its arrays, with ``covariance`` and how many ``surprises`` came one after the other, are changed in place.
    """

    def __init__(
        self, tree: PlanarTree, dynamics: Dynamics, orientation: float, angular_momentum: float, inertia: float
    ) -> None:
        bodies = len(tree.mass)
        self._nominal = dynamics
        self._weights = tree.point_weights(np.arange(bodies), tree.center)
        self._coupling, self._inertia, self._mass = centroidal_coupling(tree), np.array(tree.inertia), tree.mass
        scale = MOMENTUM_ERROR * max(abs(angular_momentum), SLOWEST_TURN * inertia)
        self.deviations = np.concatenate(([ORIENTATION_ERROR, scale], np.full(2 * bodies, MASS_ERROR)))
        self.covariance = np.diag(self.deviations**2)
        self.wander = (WANDER * self.deviations) ** 2
        self.wander[0] = ORIENTATION_WANDER**2
        self.state = np.zeros(2 + 2 * bodies)
        self.state[:2] = orientation, angular_momentum
        self._dynamics: Dynamics | None = dynamics
        self.surprises = np.zeros(1, dtype=np.int64)  # negative: to the other side

    @property
    def orientation(self) -> float:
        """Estimate of the orientation, rad, with the joints on their reference."""
        return float(self.state[0])

    @property
    def angular_momentum(self) -> float:
        """Estimate of h, kg m^2/s."""
        return float(self.state[1])

    @property
    def dynamics(self) -> Dynamics:
        """With the masses found."""
        if self._dynamics is None:
            self._dynamics = self._adapted(self.state[2:])
        return self._dynamics

    def has_changed(self) -> None:
        """The state was changed by others: by the kernel."""
        self._dynamics = None

    def as_found(self) -> Callable[[], Dynamics]:
        """Return what gives the dynamics with the masses found by now, also later."""
        known = self._dynamics
        return partial(self._adapted, self.state[2:].copy()) if known is None else partial(_same, known)

    def forget(self) -> None:
        """Orientation and momentum are known no better than at takeoff: the robot was hit, or was long unseen."""
        self.covariance[:2] = self.covariance[:, :2] = 0.0
        self.covariance.flat[: 2 * len(self.state) : len(self.state) + 1] = self.deviations[:2] ** 2
        self.surprises[0] = 0

    def _adapted(self, errors: Array) -> Dynamics:
        """The dynamics with relative errors (2m,) of masses and inertias."""
        bodies = len(self._mass)
        masses = errors[:bodies] * self._mass
        coupling = self._coupling + self._weights.conj().T @ (masses[:, None] * self._weights)
        return self._nominal.adapted(coupling, self._inertia * (1 + errors[bodies:]))


def _same(dynamics: Dynamics) -> Dynamics:
    return dynamics


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
        return _fallen(time - self.com_time, self.com_position, self.com_velocity, self.gravity)

    def path_from(self, time: float) -> Callable[[], Ballistics]:
        """Return what gives the path of the centre of mass from a time on, as it is known by now, also later."""
        return partial(_path, time - self.com_time, self.com_position, self.com_velocity, self.gravity)

    @property
    def orientation(self) -> float:
        """With the joints on their reference, rad."""
        return self.inertial.orientation

    @property
    def angular_momentum(self) -> float:
        """About the centre of mass, kg m^2/s."""
        return self.inertial.angular_momentum

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


def _fallen(dt: float, position: Array, velocity: Array, gravity: float) -> tuple[Array, Array]:
    fall = np.array([0.0, gravity * dt])
    return position + dt * (velocity - fall / 2), velocity - fall


def _path(dt: float, position: Array, velocity: Array, gravity: float) -> Ballistics:
    return Ballistics(*_fallen(dt, position, velocity, gravity), gravity)
