"""The robot's state in flight, from measurements: orientation, position of the centre of mass, momentum and masses.

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
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.measurement import Measurement
from floatplan.motion.flight import Dynamics
from floatplan.robot.planar.tree import PlanarTree

PLACE_TIME = 0.02  # [s] time constant of the low-pass filter
MASS_ERROR = 0.05  # [-] of what is known of masses and inertias beforehand
MOMENTUM_ERROR = 0.2  # [-] of the plan's h
SLOWEST_TURN = 1.0  # [rad/s] whose momentum is the least scale of h
ORIENTATION_ERROR = 0.05  # [rad] at takeoff
WANDER = 0.002  # [-] of the errors, per root of a second, by which the state may change
ORIENTATION_WANDER = 0.0005  # [rad] the same of the orientation


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
