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

In space orientation and h are three numbers each: with I and A of (S1), ``h = R (I omega + A q')`` has
three rows, and a small turn zeta of the estimated attitude, ``dR = [zeta]x R``, changes what is measured of h by
``[h]x zeta``. That is also what makes turns grow: ``zeta' = R I^-1 R^T (dh + [h]x zeta - what the masses add)``, (S2).
"""

import math
from dataclasses import dataclass
from typing import Any

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
    """The filter's ``state``: e numbers of orientation, rad, e of h, kg m^2/s, and relative errors of the bodies.

    These are of masses and of inertias, (m,) each. In space the orientation is ``attitude`` (3, 3), of which the state
    has a small turn, zero between measurements. All these arrays, with ``covariance`` and how many ``surprises`` (e,)
    came one after the other, are changed in place. ``inertia`` is that of the robot with fixed joints at takeoff.
    """

    def __init__(
        self, bodies: int, orientation: float | Array, angular_momentum: float | Array, inertia: float
    ) -> None:
        momentum = np.atleast_1d(angular_momentum)
        self.size = len(momentum)
        momentum_error = FILTER.momentum_error * max(float(np.linalg.norm(momentum)), FILTER.slowest_rate * inertia)
        of_orientation = np.full(self.size, FILTER.orientation_error)
        of_momentum = np.full(self.size, momentum_error)
        mass_errors = np.full(2 * bodies, FILTER.mass_error)
        self.deviations = np.concatenate((of_orientation, of_momentum, mass_errors))
        self.covariance = np.diag(self.deviations**2)
        self.wander = (FILTER.wander * self.deviations) ** 2
        self.wander[: self.size] = FILTER.orientation_wander**2
        self.state = np.zeros(2 * (self.size + bodies))
        self.state[self.size : 2 * self.size] = momentum
        self.surprises = np.zeros(self.size, dtype=np.int64)  # negative: to the other side
        self.attitude: Array | None = None
        if isinstance(orientation, np.ndarray):
            self.attitude = orientation.copy()
        else:
            self.state[0] = orientation

    @property
    def orientation(self) -> Any:
        """Estimate of the orientation, rad, in space (3, 3), with the joints on their reference."""
        return float(self.state[0]) if self.attitude is None else self.attitude.copy()

    @property
    def angular_momentum(self) -> Any:
        """Estimate of h, kg m^2/s, in space (3,)."""
        return float(self.state[1]) if self.size == 1 else self.state[3:6].copy()

    @property
    def errors(self) -> Array:
        """Estimates of the relative errors of masses and inertias (2m,), which can be changed."""
        return self.state[2 * self.size :]

    def forget(self) -> None:
        """Orientation and momentum are as uncertain as at takeoff: the robot was hit, or was not measured for long."""
        known = 2 * self.size
        self.covariance[:known] = self.covariance[:, :known] = 0.0
        self.covariance.flat[: known * len(self.state) : len(self.state) + 1] = self.deviations[:known] ** 2
        self.surprises[:] = 0


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
        """Position and velocity of the centre of mass at a time."""
        dt = time - self.com_time
        fall = np.zeros(len(self.com_position))
        fall[-1] = self.gravity * dt
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
        climb = height - self.com_position[-1]
        speed = self.com_velocity[-1]
        speed_squared = speed * speed - 2 * self.gravity * climb  # at that height
        if self.gravity <= 0 or speed_squared < 0:
            return None
        return self.com_time + float((speed + math.sqrt(speed_squared)) / self.gravity)
