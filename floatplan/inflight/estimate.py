"""The robot's state in flight, from measurements: orientation, position of the centre of mass, momentum and masses.

Between measurements the orientation goes on by (4) along the joints' reference, the centre of mass on its parabola.
Measurements correct them: orientation, momentum and masses by a Kalman filter; of the position of the centre of mass
the first measurements are averaged, later ones weigh as ``dt / com_time``.

What is measured of a flight obeys ``h = D(q) . (theta0', q')`` with the real robot's D. The orientation, the angular
momentum and, relative to the plan's, every body's mass and inertia are the state; but for the orientation, which
changes by (4), they are constant. D is linear in the inertias; by a mass m_b the coupling C of
:mod:`floatplan.motion.planar.closed_form` changes by ``conj(w_b) w_b``, w_b the weights of its centre of mass. With
only masses wrong by a few per cent, ``D . (theta0', q')`` of the plan's masses wanders by as much while the robot
tucks and stretches: a filter of only h would lag behind it. The angles, too, depend on h: by the base's rotation.
"""

import math
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.measurement import Measurement
from floatplan.motion.flight import Dynamics
from floatplan.robot.planar.tree import PlanarTree


@dataclass(frozen=True)
class FilterSettings:
    """Numbers of the filter: what is uncertain at takeoff, and how fast it may change.

    Attributes
    ----------
    com_time : time constant of the low-pass filter of the centre of mass, s
    mass_error : relative error of masses and inertias
    momentum_error : relative error of the plan's h
    slowest_rate : of the base, whose momentum is the least scale of h, rad/s
    orientation_error : at takeoff, rad
    wander : share of these errors, per root of a second, by which the state may change
    orientation_wander : the same of the orientation, rad
    """

    com_time: float = 0.02
    mass_error: float = 0.05
    momentum_error: float = 0.2
    slowest_rate: float = 1.0
    orientation_error: float = 0.05
    wander: float = 0.002
    orientation_wander: float = 0.0005


FILTER = FilterSettings()


class Identification:
    """The filter's ``state``: orientation, rad, h, kg m^2/s, and relative errors of masses and inertias (m,) each.

    Its arrays, with ``covariance`` and how many ``surprises`` came one after the other, are changed in place.
    ``inertia`` is that of the robot with fixed joints at takeoff, kg m^2.
    """

    def __init__(self, bodies: int, orientation: float, angular_momentum: float, inertia: float) -> None:
        momentum_error = FILTER.momentum_error * max(abs(angular_momentum), FILTER.slowest_rate * inertia)
        mass_errors = np.full(2 * bodies, FILTER.mass_error)
        self.deviations = np.concatenate(([FILTER.orientation_error, momentum_error], mass_errors))
        self.covariance = np.diag(self.deviations**2)
        self.wander = (FILTER.wander * self.deviations) ** 2
        self.wander[0] = FILTER.orientation_wander**2
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
        """Orientation and momentum are as uncertain as at takeoff: the robot was hit, or was not measured for long."""
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

    Position and velocity of the centre of mass are those at ``com_time``; ``com_measurements`` counts its measurements.
    """

    time: float
    inertial: Identification
    com_position: Array
    com_velocity: Array
    gravity: float
    com_time: float = 0.0
    com_measurements: int = 0

    def com_at(self, time: float) -> tuple[Array, Array]:
        """Position and velocity (2,) of the centre of mass at a time."""
        dt = time - self.com_time
        fall = np.array([0.0, self.gravity * dt])
        return self.com_position + dt * (self.com_velocity - fall / 2), self.com_velocity - fall

    def add(self, measured: Measurement) -> None:
        """Add a measurement's time, and its position of the centre of mass."""
        self.time = measured.time
        if measured.com_position is None or measured.com_velocity is None:
            return
        dt = measured.time - self.com_time
        position, velocity = self.com_at(measured.time)
        self.com_time = measured.time
        self.com_measurements += 1
        weight = max(1 / self.com_measurements, 1 - math.exp(-dt / FILTER.com_time))  # their mean at first
        self.com_position = position + weight * (measured.com_position - position)
        self.com_velocity = velocity + weight * (measured.com_velocity - velocity)

    def landing(self, height: float) -> float | None:
        """Time at which the centre of mass comes down to a height, m; None where it does not."""
        climb = height - self.com_position[1]
        speed = self.com_velocity[1]
        speed_squared = speed * speed - 2 * self.gravity * climb  # at that height
        if self.gravity <= 0 or speed_squared < 0:
            return None
        return self.com_time + float((speed + math.sqrt(speed_squared)) / self.gravity)
