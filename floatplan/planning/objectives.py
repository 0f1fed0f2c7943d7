"""What the search minimises: (17), or the time integral of squared torques or joint accelerations.

Every objective is scaled to about 1 at a sensible motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from floatplan.arrays import Array
from floatplan.planning.decision_variables import DecisionVariables
from floatplan.planning.trajectory import Partials, Trajectory


class Objective(Protocol):
    """A term to minimise."""

    def evaluate(self, trajectory: Trajectory, x: Array) -> tuple[float, Array]:
        """Value and gradient (size,) by x."""

    def hessian(self, trajectory: Trajectory) -> Array:
        """Positive semidefinite guess (size, size) of the second derivative by x."""


@dataclass(frozen=True, eq=False)
class CoefficientNorm:
    """(17). The variables are whitened so that ``|b|^2 = least^2 + unit^2 |x|^2``: here ``|x|^2 / 2``."""

    coefficients: int

    def evaluate(self, trajectory: Trajectory, x: Array) -> tuple[float, Array]:
        """Value and gradient (size,) by x."""
        gradient = x.copy()
        gradient[self.coefficients :] = 0
        return float(gradient @ gradient) / 2, gradient

    def hessian(self, trajectory: Trajectory) -> Array:
        """Return the identity, which is exact but for the entry of a free h."""
        return np.eye(trajectory.variables.size)


@dataclass(frozen=True, eq=False)
class SquaredAcceleration:
    """Integral over the flight of the squared joint accelerations, rad^2/s^3, divided by ``scale``."""

    scale: float

    def evaluate(self, trajectory: Trajectory, x: Array) -> tuple[float, Array]:
        """Value and gradient (size,) by x."""
        return _integral_of_squares(trajectory, self.scale, *self._integrand(trajectory))

    def hessian(self, trajectory: Trajectory) -> Array:
        """Gauss-Newton approximation."""
        return _gauss_newton(trajectory, self.scale, self._integrand(trajectory)[1])

    def _integrand(self, trajectory: Trajectory) -> tuple[Array, Array]:
        accelerations = trajectory.motion.accelerations
        count, n = accelerations.shape
        return accelerations, trajectory.jacobian(Partials(by_acceleration=np.broadcast_to(np.eye(n), (count, n, n))))


@dataclass(frozen=True, eq=False)
class SquaredTorque:
    """Integral over the flight of the squared joint torques, N^2 m^2 s, divided by ``scale``."""

    scale: float

    def evaluate(self, trajectory: Trajectory, x: Array) -> tuple[float, Array]:
        """Value and gradient (size,) by x."""
        return _integral_of_squares(trajectory, self.scale, trajectory.torques, trajectory.torque_jacobian)

    def hessian(self, trajectory: Trajectory) -> Array:
        """Gauss-Newton approximation."""
        return _gauss_newton(trajectory, self.scale, trajectory.torque_jacobian)


def _integral_of_squares(trajectory: Trajectory, scale: float, values: Array, jacobian: Array) -> tuple[float, Array]:
    """Integral over the flight of |values|^2 / scale, and its gradient (size,)."""
    nodes = trajectory.sampling.nodes
    weighted = (_time_weights(trajectory) / scale)[:, None] * values[:nodes]
    return float((weighted * values[:nodes]).sum()), 2 * np.einsum("kr,krx->x", weighted, jacobian[:nodes])


def _gauss_newton(trajectory: Trajectory, scale: float, jacobian: Array) -> Array:
    weights = np.sqrt(2 * _time_weights(trajectory) / scale)
    weighted = weights[:, None, None] * jacobian[: trajectory.sampling.nodes]
    rows = weighted.reshape(weighted.shape[0] * weighted.shape[1], weighted.shape[2])
    return np.asarray(rows.T @ rows)


def _time_weights(trajectory: Trajectory) -> Array:
    return trajectory.duration * trajectory.sampling.quadrature.weights


def whitened_variables(variables: DecisionVariables) -> tuple[Array, Array]:
    """Offset (m,) and scaling (m, m) for which (17) is ``constant + unit^2 |x|^2``.

    A joint's b is affine in its z, ``b = b_0 + C z``; with ``C = Q R``, ``x = (R z + Q^T b_0) / unit``. The unit makes
    the most sensitive direction of x move p by one radian (root mean square).
    """
    polynomials = variables.polynomials
    powers = polynomials.powers_map
    fixed = powers.shape[1] - polynomials.width
    factors = {free: _factors(powers[:, fixed : fixed + free]) for free in set(polynomials.free)}
    offsets, blocks = [], []
    for boundary, free in zip(polynomials.boundary, polynomials.free, strict=True):
        orthogonal, inverse = factors[free]
        offsets.append(-inverse @ (orthogonal.T @ (powers[:, :fixed] @ boundary)))
        blocks.append(inverse)
    unit = 1 / max((np.linalg.norm(inverse, 2) for _, inverse in factors.values() if inverse.size), default=1.0)
    scaling = np.zeros((variables.coefficients, variables.coefficients))
    start = 0
    for block in blocks:
        stop = start + len(block)
        scaling[start:stop, start:stop] = unit * block
        start = stop
    return np.concatenate(offsets), scaling


def _factors(columns: Array) -> tuple[Array, Array]:
    """Q, and the inverse of R, of ``columns = Q R``."""
    orthogonal, triangular = np.linalg.qr(columns)
    return orthogonal, np.linalg.inv(triangular)
