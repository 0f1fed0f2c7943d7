"""Quasi-Newton approximations of the Lagrangian's Hessian, updated by BFGS, and the QP steps that they give.

Without inequalities the inverse is kept instead: a step then needs products only, and a system as small as the
multipliers (Nocedal and Wright, Numerical Optimization, 2nd ed., section 16.2, range-space method).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.optimization.nonlinear_program import AnyEvaluation
from floatplan.optimization.quadratic_program import FirstWay, Multipliers, Step, elastic_qp, solve_qp


class HessianApproximation(Protocol):
    """A quasi-Newton approximation H (m, m) of the Lagrangian's Hessian, positive definite."""

    @property
    def hessian(self) -> Array:
        """H (m, m)."""

    @property
    def largest(self) -> float:
        """About H's largest diagonal entry."""

    def step(self, current: AnyEvaluation, active: IntArray, slack_penalty: float) -> Step:
        """Solve the QP of a linearised program, see :func:`floatplan.optimization.quadratic_program.solve_qp`."""

    def product(self, change: Array, step: Step, step_length: float) -> Array:
        """Hessian product H change (m,); the change of x is ``step_length`` times the step's direction."""

    def updated(self, change: Array, hessian_product: Array, gradient_change: Array) -> HessianApproximation:
        """BFGS update: the new H maps the change to the change of the Lagrangian's gradient (m,)."""


@dataclass(frozen=True, eq=False)
class DirectHessian:
    """H itself, for programs with inequalities; ``first`` is the way in which their QPs are tried first."""

    hessian: Array
    first: FirstWay | None = None

    @property
    def largest(self) -> float:
        """Largest diagonal entry."""
        return float(self.hessian.diagonal().max(initial=1.0))

    def step(self, current: AnyEvaluation, active: IntArray, slack_penalty: float) -> Step:
        """By its active rows."""
        return solve_qp(current, self.hessian, active, slack_penalty, self.first)

    def product(self, change: Array, step: Step, step_length: float) -> Array:
        """By multiplication."""
        return self.hessian @ change

    def updated(self, change: Array, hessian_product: Array, gradient_change: Array) -> DirectHessian:
        """Nocedal and Wright (6.19)."""
        correction = (gradient_change / (gradient_change @ change))[:, None] * gradient_change
        return DirectHessian(
            self.hessian + correction - (hessian_product / (hessian_product @ change))[:, None] * hessian_product,
            self.first,
        )


@dataclass(frozen=True, eq=False)
class InverseHessian:
    """The inverse of H, for programs without inequalities."""

    inverse: Array

    @property
    def hessian(self) -> Array:
        """H."""
        return _inverse(self.inverse)

    @property
    def largest(self) -> float:
        """Reciprocal of the smallest diagonal entry of the inverse: a lower bound of H's largest."""
        return max(1.0, 1 / float(self.inverse.diagonal().min(initial=1.0)))

    def step(self, current: AnyEvaluation, active: IntArray, slack_penalty: float) -> Step:
        """``-H^-1 (g + A^T y)``, with the multipliers y for which it satisfies the linearised equalities."""
        rows, gradient = current.equality_jacobian, current.gradient
        unconstrained, per_multiplier = self.inverse @ gradient, self.inverse @ rows.T
        multipliers = solve_small(rows @ per_multiplier, current.equality - rows @ unconstrained)
        if multipliers is None:
            return elastic_qp(current, self.hessian, slack_penalty)
        direction = -(unconstrained + per_multiplier @ multipliers)
        return Step(
            direction, Multipliers(multipliers, current.inequality), lagrangian_gradient=gradient + multipliers @ rows
        )

    def product(self, change: Array, step: Step, step_length: float) -> Array:
        """By the step's own optimality, ``H direction = -lagrangian_gradient``."""
        assert step.lagrangian_gradient is not None, "an elastic step does not update H"
        return -step_length * step.lagrangian_gradient

    def updated(self, change: Array, hessian_product: Array, gradient_change: Array) -> InverseHessian:
        """Nocedal and Wright (6.17)."""
        curvature = float(gradient_change @ change)
        mapped = self.inverse @ gradient_change
        half = (0.5 + 0.5 * float(gradient_change @ mapped) / curvature) * change - mapped
        cross = change[:, None] * (half / curvature)
        return InverseHessian(self.inverse + cross + cross.T)


def hessian_approximation(hessian: Array, *, inequalities: bool, first: FirstWay | None = None) -> HessianApproximation:
    """Return an initial approximation (m, m), in the form for programs with inequalities or without.

    ``first`` is how QPs with inequalities are tried first, see
    :func:`floatplan.optimization.quadratic_program.solve_qp`.
    """
    return DirectHessian(hessian, first) if inequalities else InverseHessian(_inverse(hessian))


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def solve_small(matrix: Array, right: Array) -> Array | None:
    """Solution of a small symmetric system, positive semidefinite: that of least norm; None where there is none."""
    if len(right) == 1:
        return np.asarray(right / matrix[0, 0]) if matrix[0, 0] > 0 else None
    solution = np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-12)[0], dtype=np.float64)
    return solution if np.allclose(matrix @ solution, right, rtol=1e-9, atol=1e-12) else None
