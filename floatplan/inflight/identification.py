"""Momentum and masses as they are, from the rates measured in flight: a Kalman filter of what does not change.

What is measured of a flight obeys ``h = D(q) . (theta0', q')`` with the real robot's D. The angular momentum and,
relative to the plan's, every body's mass and inertia are the state. D is linear in the inertias; by a mass m_b the
coupling C of :mod:`floatplan.motion.planar.momentum` changes by ``conj(w_b) w_b``, w_b the weights of its centre
of mass. With masses alone wrong by a few per cent, ``D . (theta0', q')`` of the plan's masses wanders by as much while
the robot tucks and stretches: a filter of h alone would lag behind it.
"""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.momentum import centroidal_coupling
from floatplan.robot.planar.tree import PlanarTree

MASS_ERROR = 0.05  # [-] of what is known of masses and inertias beforehand
LARGEST_ERROR = 0.3  # [-] of them that is believed
MOMENTUM_ERROR = 0.2  # [-] of the plan's h
SLOWEST_TURN = 1.0  # [rad/s] whose momentum is the least scale of h
RATE_NOISE = 0.02  # [rad/s] of measured rates
WANDER = 0.02  # [-] of the errors, per root of a second, by which the state may change


class Identification:
    """The filter's state: ``angular_momentum`` kg m^2/s, and relative errors of masses and inertias (m,) each."""

    def __init__(self, tree: PlanarTree, dynamics: Dynamics, angular_momentum: float, inertia: float) -> None:
        bodies = len(tree.mass)
        self._tree, self._nominal = tree, dynamics
        self._weights = tree.point_weights(np.arange(bodies), tree.center)
        self._coupling, self._inertia, self._mass = centroidal_coupling(tree), np.array(tree.inertia), tree.mass
        scale = MOMENTUM_ERROR * max(abs(angular_momentum), SLOWEST_TURN * inertia)
        deviations = np.concatenate(([scale], np.full(2 * bodies, MASS_ERROR)))
        self._covariance = np.diag(deviations**2)
        self._wander = np.diag((WANDER * deviations) ** 2)
        self.state = np.zeros(1 + 2 * bodies)
        self.state[0] = angular_momentum
        self.dynamics = dynamics

    @property
    def angular_momentum(self) -> float:
        """Estimate of h, kg m^2/s."""
        return float(self.state[0])

    def learn(self, positions: Array, velocities: Array, rate: float, dt: float) -> None:
        """Take in joints (n,) and the base's rate, rad/s, measured ``dt`` s after the last time."""
        tree = self._tree
        rates = tree.turns @ velocities + rate
        rotations = tree.rotations(tree.turns @ positions + tree.offsets)
        moving = rotations * rates
        by_mass = self._mass * ((self._weights @ rotations).conj() * (self._weights @ moving)).real
        by_inertia = self._inertia * rates
        momentum = float((rotations.conj() @ (self._coupling @ moving)).real + by_inertia.sum())
        row = np.concatenate(([1.0], -by_mass, -by_inertia))
        inertia = self._nominal.momentum_map(positions[None, :])[0]
        covariance = self._covariance + dt * self._wander
        gain = covariance @ row
        gain /= row @ gain + RATE_NOISE**2 * float(inertia @ inertia)
        self.state = self.state + gain * (momentum - row @ self.state)
        np.clip(self.state[1:], -LARGEST_ERROR, LARGEST_ERROR, out=self.state[1:])
        self._covariance = covariance - np.outer(gain, row @ covariance)
        self._adapt()

    def _adapt(self) -> None:
        bodies = len(self._mass)
        masses, inertias = self.state[1 : 1 + bodies] * self._mass, self.state[1 + bodies :]
        coupling = self._coupling + self._weights.conj().T @ (masses[:, None] * self._weights)
        self.dynamics = self._nominal.adapted(coupling, self._inertia * (1 + inertias))
