"""What the search minimises: (17), or the time integral of a squared quantity.

The search scales every objective to about 1 at a sensible motion of its class; :func:`objective_value` is the user's
own, by which motions of different classes compare.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import SinePolynomials, powers_map
from floatplan.planning.transcription.quantities import QUANTITIES, Quantity
from floatplan.planning.transcription.trajectory import Trajectory, trajectory
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.tables import OBJECTIVE_TABLE
from floatplan.tables import Objective as ObjectiveName

LEAST_CURVATURE = 1e-3  # of a Gauss-Newton approximation, relative to its largest
EXACT_LEVEL = -1  # of the grids: the finest, for the number that the user sees


class Objective(Protocol):
    """A term to minimise."""

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""

    def hessian(self, trajectory: Trajectory) -> Array:
        """Positive definite guess (size, size) of the second derivative by x."""


@dataclass(frozen=True, eq=False)
class CoefficientNorm:
    """(17). The variables are whitened so that ``|b|^2 = least^2 + unit^2 |x|^2``: here ``|x|^2 / 2``."""

    coefficients: int

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""
        coefficients = x[: self.coefficients]
        return float(coefficients @ coefficients) / 2

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""
        gradient = x.copy()
        gradient[self.coefficients :] = 0
        return gradient

    def hessian(self, trajectory: Trajectory) -> Array:
        """Return the identity, which is exact but for the entry of a free h."""
        return np.eye(trajectory.variables.size)


@dataclass(frozen=True, eq=False)
class IntegralOfSquares:
    """Integral over the flight of a quantity's square, summed over the joints and divided by ``scale``."""

    quantity: Quantity
    scale: float

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""
        nodes = trajectory.sampling.nodes
        values = self.quantity.values(trajectory)[:nodes]
        return float((_time_weights(trajectory) / self.scale) @ (values**2).sum(axis=1))

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""
        nodes = trajectory.sampling.nodes
        weighted = (_time_weights(trajectory) / self.scale)[:, None] * self.quantity.values(trajectory)[:nodes]
        return np.asarray(2 * np.einsum("kr,krx->x", weighted, self.quantity.jacobian(trajectory)[:nodes]))

    def hessian(self, trajectory: Trajectory) -> Array:
        """Gauss-Newton approximation, with the least curvature added."""
        weights = np.sqrt(2 * _time_weights(trajectory) / self.scale)
        weighted = weights[:, None, None] * self.quantity.jacobian(trajectory)[: trajectory.sampling.nodes]
        rows = weighted.reshape(weighted.shape[0] * weighted.shape[1], weighted.shape[2])
        hessian: Array = rows.T @ rows
        diagonal = hessian.diagonal()
        return hessian + LEAST_CURVATURE * max(float(diagonal.max(initial=0)), LEAST_CURVATURE) * np.eye(len(hessian))


def objective_term(name: ObjectiveName, variables: DecisionVariables, scale: float = 1.0) -> Objective:
    """Return the row of the table of objectives as the search minimises it; integrals are divided by ``scale``."""
    quantity = OBJECTIVE_TABLE[name].quantity
    if quantity is None:
        return CoefficientNorm(variables.coefficients)
    return IntegralOfSquares(QUANTITIES[quantity], scale)


def objective_value(name: ObjectiveName, motion: Trajectory, x: Array) -> float:
    """Value of the user's objective, in the unit that the table of objectives gives.

    It is computed as exactly for every class of motions, and knows nothing of the scaling of the variables x that the
    ``motion`` belongs to.
    """
    model, variables = motion.model, motion.variables
    if OBJECTIVE_TABLE[name].quantity is None:
        return float(np.linalg.norm(variables.polynomials.powers_of_seconds(variables.free_coefficients(x))))
    exact = trajectory(model, variables, model.nodes(EXACT_LEVEL, variables.polynomials.width), x)
    return objective_term(name, variables).value(exact, x)


def _time_weights(trajectory: Trajectory) -> Array:
    return trajectory.duration * trajectory.sampling.weights


def whitened_variables(polynomials: SinePolynomials) -> tuple[Array, Array]:
    """Offset (m,) and scaling (m, m) for which (17) is ``constant + unit^2 |x|^2``.

    A joint's b is affine in its z, ``b = b_0 + C z``; with ``C = Q R``, ``x = (R z + Q^T b_0) / unit``. The unit makes
    the most sensitive direction of x move p by one radian (root mean square).
    """
    width, duration = polynomials.width, polynomials.duration
    factors = [_factors(width, free, duration) for free in polynomials.free]
    unit = 1 / max(factor.longest for factor in factors)
    offsets = [
        factor.offset_by_boundary @ boundary for factor, boundary in zip(factors, polynomials.boundary, strict=True)
    ]
    size = sum(polynomials.free)
    scaling, start = np.zeros((size, size)), 0
    for factor in factors:
        stop = start + len(factor.inverse)
        scaling[start:stop, start:stop] = unit * factor.inverse
        start = stop
    return np.concatenate(offsets), scaling


@dataclass(frozen=True, eq=False)
class _Factors:
    """Of ``C = Q R``: the inverse of R, its norm, and ``-R^-1 Q^T`` times the map from the boundary to b_0."""

    inverse: Array
    longest: float
    offset_by_boundary: Array


@lru_cache(maxsize=64)
def _factors(width: int, free: int, duration: float) -> _Factors:
    """Factors for a joint with ``free`` of ``width`` coefficients and a duration in s."""
    powers = powers_map(width, duration)
    columns = powers[:, CONDITIONS : CONDITIONS + free]
    orthogonal, triangular = np.linalg.qr(columns)
    inverse = np.linalg.inv(triangular)
    longest = float(np.linalg.norm(inverse, 2)) if inverse.size else 0.0
    return _Factors(inverse, longest, -inverse @ (orthogonal.T @ powers[:, :CONDITIONS]))
