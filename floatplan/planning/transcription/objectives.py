"""What the search minimises: (17), or the time integral of a squared quantity.

The search scales every objective to about 1 at a sensible motion of its class; :func:`objective_value` is the user's
own, by which motions of different classes compare.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.sine_polynomial import powers_map
from floatplan.planning.transcription.trajectory import QUANTITIES, FlightModel, Sampling, Trajectory, trajectory
from floatplan.planning.transcription.variables import DecisionVariables, whitened_unit
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE
from floatplan.tables import Objective as ObjectiveName

LEAST_CURVATURE = 1e-3  # of a Gauss-Newton approximation, relative to its largest
EXACT_LEVEL = -1  # of the grids: the finest, for the number that the user sees


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
class FollowingCoefficientNorm:
    """(17) where conditions (13) change with h: ``|b|^2 / (2 unit^2)``, with the unit of whitened variables."""

    variables: DecisionVariables

    @cached_property
    def _map(self) -> Array:
        """Matrix (k+1, g+width) from a joint's given conditions and z to its b, over the unit."""
        polynomials = self.variables.polynomials
        return np.asarray(powers_map(polynomials.form, polynomials.duration) / whitened_unit(polynomials))

    def _written(self, trajectory: Trajectory, x: Array) -> Array:
        """B (n, k+1) over the unit."""
        given = self.variables.motion_class(trajectory.angular_momentum[0]).given_boundary
        coefficients = np.concatenate((given, self.variables.free_coefficients(x)), axis=1)
        return np.asarray(coefficients @ self._map.T)

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""
        return float((self._written(trajectory, x) ** 2).sum()) / 2

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""
        return np.asarray(self._by_x(trajectory, (self._written(trajectory, x) @ self._map)[None])[0])

    def hessian(self, trajectory: Trajectory) -> Array:
        """Return that of b by x and h, and 1 more for each direction of h."""
        joints = len(self.variables.polynomials.free)
        by_all = np.einsum("jl,kc->jklc", np.eye(joints), self._map).reshape(-1, joints, self._map.shape[1])
        jacobian = self._by_x(trajectory, by_all)
        of_momentum = np.arange(self.variables.size) >= self.variables.coefficients
        hessian: Array = jacobian.T @ jacobian + np.diag(of_momentum.astype(float))
        return hessian

    def _by_x(self, trajectory: Trajectory, by_all: Array) -> Array:
        """Derivatives (r, size) by x of those (r, n, g+width) by all coefficients of the basis."""
        assert trajectory.boundary_by_axes is not None, "the conditions change with h"
        given = trajectory.sampling.given
        by_axes = np.tensordot(by_all[..., :given], trajectory.boundary_by_axes, 2)
        return self.variables.gradient(by_all[..., given:], None, by_axes)


@dataclass(frozen=True, eq=False)
class IntegralOfSquares:
    """Integral over the flight of the square of a quantity, by its name, over the joints, divided by ``scale``."""

    quantity: str
    scale: float

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""
        values = QUANTITIES[self.quantity].values(trajectory)[: trajectory.sampling.grid.nodes]
        return float((_time_weights(trajectory) / self.scale) @ (values**2).sum(axis=1))

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""
        by_quantity = trajectory.quantity_jacobian(self.quantity)[: trajectory.sampling.grid.nodes]
        return np.asarray(np.einsum("kr,krx->x", self.weights(trajectory), by_quantity))

    def weights(self, trajectory: Trajectory) -> Array:
        """Derivatives (N, r) by the quantity at the nodes."""
        values = QUANTITIES[self.quantity].values(trajectory)[: trajectory.sampling.grid.nodes]
        return np.asarray((2 / self.scale * _time_weights(trajectory))[:, None] * values)

    def hessian(self, trajectory: Trajectory) -> Array:
        """Gauss-Newton approximation, with the least curvature added."""
        weights = np.sqrt(2 * _time_weights(trajectory) / self.scale)
        by_quantity = trajectory.quantity_jacobian(self.quantity)[: trajectory.sampling.grid.nodes]
        rows = (weights[:, None, None] * by_quantity).reshape(-1, by_quantity.shape[2])
        hessian: Array = rows.T @ rows
        diagonal = hessian.diagonal()
        return hessian + LEAST_CURVATURE * max(float(diagonal.max(initial=0)), LEAST_CURVATURE) * np.eye(len(hessian))


Objective: TypeAlias = CoefficientNorm | FollowingCoefficientNorm | IntegralOfSquares  # a term to minimise


def objective_term(name: ObjectiveName, variables: DecisionVariables, scale: float = 1.0) -> Objective:
    """Return the row of the table of objectives as the search minimises it; integrals are divided by ``scale``."""
    quantity = OBJECTIVE_TABLE[name].quantity
    if quantity is None:
        return FollowingCoefficientNorm(variables) if variables.following else CoefficientNorm(variables.coefficients)
    return IntegralOfSquares(quantity, scale)


def objective_value(name: ObjectiveName, motion: Trajectory, x: Array) -> float:
    """Value of the user's objective, in the unit that the table of objectives gives.

    It is computed as exactly for every class of motions, and knows nothing of the scaling of the variables x that the
    ``motion`` belongs to.
    """
    model, variables = motion.model, motion.variables
    if OBJECTIVE_TABLE[name].quantity is None:
        motions = variables.motion_class(motion.angular_momentum[0])
        return float(np.linalg.norm(motions.powers_of_seconds(variables.free_coefficients(x))))
    exact = trajectory(model, variables, model.nodes(EXACT_LEVEL, variables.polynomials.form), x)
    return objective_term(name, variables).value(exact, x)


def _time_weights(trajectory: Trajectory) -> Array:
    return trajectory.duration * trajectory.sampling.grid.weights


def objective(problem: Problem, model: FlightModel, variables: DecisionVariables, sampling: Sampling) -> Objective:
    """The problem's objective, scaled to 1 at the motion with no free part; (17) is scaled by its variables."""
    name = problem.motion.objective
    if name == "coefficients":
        return objective_term(name, variables)
    x = variables.plain_motion()
    value = objective_term(name, variables).value(trajectory(model, variables, sampling, x), x)
    return objective_term(name, variables, max(value, 1e-6))
