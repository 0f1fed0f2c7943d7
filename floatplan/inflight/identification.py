"""Orientation, momentum and masses as they are, from what is measured in flight: a Kalman filter.

What is measured of a flight obeys ``h = D(q) . (theta0', q')`` with the real robot's D. The orientation, the angular
momentum and, relative to the plan's, every body's mass and inertia are the state; but for the orientation, which turns
as (4) says, they do not change. D is linear in the inertias; by a mass m_b the coupling C of
:mod:`floatplan.motion.planar.momentum` changes by ``conj(w_b) w_b``, w_b the weights of its centre of mass. With masses
alone wrong by a few per cent, ``D . (theta0', q')`` of the plan's masses wanders by as much while the robot tucks and
stretches: a filter of h alone would lag behind it. The angles, too, tell of h: by how the base turned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.momentum import centroidal_coupling
from floatplan.robot.planar.tree import PlanarTree

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
        self._tree, self._nominal = tree, dynamics
        self._turns = tree.turns.T.copy()
        self._weights = tree.point_weights(np.arange(bodies), tree.center)
        self._weights_transposed, self._weights_adjoint = self._weights.T.copy(), self._weights.conj().T.copy()
        self._coupling, self._inertia, self._mass = centroidal_coupling(tree), np.array(tree.inertia), tree.mass
        scale = MOMENTUM_ERROR * max(abs(angular_momentum), SLOWEST_TURN * inertia)
        self.deviations = np.concatenate(([ORIENTATION_ERROR, scale], np.full(2 * bodies, MASS_ERROR)))
        self.covariance = np.diag(self.deviations**2)
        self.wander = (WANDER * self.deviations) ** 2
        self.wander[0] = ORIENTATION_WANDER**2
        self._only_orientation = np.eye(1, 2 + 2 * bodies)[0]
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

    def orientation_variance(self, turned: Array) -> float:
        """Of the orientation, rad^2, after a turn by ``turned`` (2+2m,) for each of the state."""
        covariance = self.covariance
        return float(covariance[0, 0] + turned @ (2 * covariance[0] + covariance @ turned))

    def learn(self, orientation: float, momentum: float, row: Array, inertia: Array, dt: float) -> None:
        """Take in angles and rates of base and joints, measured ``dt`` s after the last time.

        The base's angle, rad, is that with the joints on their reference; ``momentum`` and ``row`` are those of
        :meth:`momentum`. D there is ``inertia`` (n+1,), kg m^2. The state's own orientation has been brought to now.
        """
        self._predict(row * (dt / inertia[0]), dt)
        noise = float(inertia @ inertia)
        self._correct(self._only_orientation, orientation - self.state[0], ANGLE_NOISE**2 * noise / inertia[0] ** 2)
        innovation, variance = momentum - float(row @ self.state), RATE_NOISE**2 * noise
        if self._believed(innovation, math.sqrt(float(row @ self.covariance @ row) + variance)):
            self._correct(row, innovation, variance)
        np.minimum(np.maximum(self.state[2:], -LARGEST_ERROR), LARGEST_ERROR, out=self.state[2:])
        self._dynamics = None

    def forget(self) -> None:
        """Orientation and momentum are known no better than at takeoff: the robot was hit, or was long unseen."""
        self.covariance[:2] = self.covariance[:, :2] = 0.0
        self.covariance.flat[: 2 * len(self.state) : len(self.state) + 1] = self.deviations[:2] ** 2
        self.surprises[0] = 0

    def _believed(self, innovation: float, deviation: float) -> bool:
        """Whether a momentum is to be learnt from: one that surprises is only as the last of several, a kick."""
        if abs(innovation) <= SURPRISING * deviation:
            self.surprises[0] = 0
            return True
        side = 1 if innovation > 0 else -1
        before = int(self.surprises[0])
        self.surprises[0] = before + side if before * side > 0 else side
        if abs(self.surprises[0]) < SURPRISES:
            return False
        self.forget()
        return True

    def momentum(self, positions: Array, velocities: Array, rates: Array) -> tuple[float, Array]:
        """The measured momentum with the plan's masses, and how h less it depends on the state (2+2m,).

        The joints (2, n) and the base's rates (2,) rad/s are first the expected ones, then those measured: what the
        state does to the momentum is that of the expected, since noise that is in both would make the masses drift.
        """
        body_rates = velocities @ self._turns + rates[:, None]
        rotations = self._tree.rotations(positions @ self._turns + self._tree.offsets)
        places, speeds = rotations @ self._weights_transposed, (rotations * body_rates) @ self._weights_transposed
        bodies = len(self._mass)
        rows = np.zeros((len(rates), 2 + 2 * bodies))
        rows[:, 1] = 1.0
        rows[:, 2 : 2 + bodies] = -self._mass * (places.real * speeds.real + places.imag * speeds.imag)
        rows[:, 2 + bodies :] = -self._inertia * body_rates
        return -float(rows[1, 2:].sum()), rows[0]

    def _predict(self, turned: Array, dt: float) -> None:
        """Bring the covariance to now: the orientation has turned by ``turned`` (2+2m,) for each of the state."""
        covariance = self.covariance
        covariance.flat[:: len(covariance) + 1] += dt * self.wander
        change = covariance @ turned
        covariance[0] += change
        covariance[:, 0] += change
        covariance[0, 0] += turned @ change

    def _correct(self, row: Array, innovation: float, variance: float) -> None:
        gain = self.covariance @ row
        along = gain / (row @ gain + variance)
        self.state += along * innovation
        self.covariance -= along[:, None] * gain

    def _adapted(self, errors: Array) -> Dynamics:
        """The dynamics with relative errors (2m,) of masses and inertias."""
        bodies = len(self._mass)
        masses = errors[:bodies] * self._mass
        coupling = self._coupling + self._weights_adjoint @ (masses[:, None] * self._weights)
        return self._nominal.adapted(coupling, self._inertia * (1 + errors[bodies:]))


def _same(dynamics: Dynamics) -> Dynamics:
    return dynamics
