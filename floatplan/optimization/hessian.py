"""Guesses of the Lagrangian's Hessian, updated by BFGS, and the steps that they make of a linearised program.

Where there are no inequalities the inverse is kept instead: then a step needs products only, and a system as small as
the multipliers (Nocedal and Wright, Numerical Optimization, 2nd ed., section 16.2, range-space method).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.optimization.nonlinear_program import AnyEvaluation
from floatplan.optimization.quadratic_program import Multipliers, Step, elastic_qp, solve_qp


class Curvature(Protocol):
    """A guess H (m, m) of the Lagrangian's Hessian, positive definite."""

    @property
    def hessian(self) -> Array:
        """H (m, m)."""

    @property
    def largest(self) -> float:
        """About H's largest diagonal entry."""

    def step(self, current: AnyEvaluation, active: IntArray, price: float) -> Step:
        """Solve the QP of a linearised program, see :func:`floatplan.optimization.quadratic_program.solve_qp`."""

    def image(self, change: Array, step: Step, share: float) -> Array:
        """H times a change of x (m,), which followed a ``share`` of a step."""

    def updated(self, change: Array, image: Array, gradient_change: Array) -> Curvature:
        """BFGS, for ``image`` = H change: H maps the change to the Lagrangian's change of gradient (m,)."""


@dataclass(frozen=True, eq=False)
class Hessian:
    """H itself."""

    hessian: Array

    @property
    def largest(self) -> float:
        """Largest diagonal entry."""
        return float(self.hessian.diagonal().max(initial=1.0))

    def step(self, current: AnyEvaluation, active: IntArray, price: float) -> Step:
        """By constraint generation."""
        return solve_qp(current, self.hessian, active, price)

    def image(self, change: Array, step: Step, share: float) -> Array:
        """Their product."""
        return self.hessian @ change

    def updated(self, change: Array, image: Array, gradient_change: Array) -> Hessian:
        """Nocedal and Wright (6.19)."""
        gained = (gradient_change / (gradient_change @ change))[:, None] * gradient_change
        return Hessian(self.hessian + gained - (image / (image @ change))[:, None] * image)


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
        """What the smallest diagonal entry of the inverse stands for: no more than H's largest."""
        return max(1.0, 1 / float(self.inverse.diagonal().min(initial=1.0)))

    def step(self, current: AnyEvaluation, active: IntArray, price: float) -> Step:
        """``-H^-1 (g + A^T y)``, with the multipliers y that take it on to the linearised equalities."""
        rows, gradient = current.equality_jacobian, current.gradient
        unconstrained, per_multiplier = self.inverse @ gradient, self.inverse @ rows.T
        multipliers = solve_small(rows @ per_multiplier, current.equality - rows @ unconstrained)
        if multipliers is None:
            return elastic_qp(current, self.hessian, price)
        direction = -(unconstrained + per_multiplier @ multipliers)
        return Step(direction, Multipliers(multipliers, current.inequality), pull=gradient + multipliers @ rows)

    def image(self, change: Array, step: Step, share: float) -> Array:
        """By the step's own optimality, ``H direction = -pull``."""
        assert step.pull is not None, "no elastic step teaches anything of H"
        return -share * step.pull

    def updated(self, change: Array, image: Array, gradient_change: Array) -> InverseHessian:
        """Nocedal and Wright (6.17)."""
        product = float(gradient_change @ change)
        mapped = self.inverse @ gradient_change
        half = (0.5 + 0.5 * float(gradient_change @ mapped) / product) * change - mapped
        cross = change[:, None] * (half / product)
        return InverseHessian(self.inverse + cross + cross.T)


def curvature(hessian: Array, *, inequalities: bool) -> Curvature:
    """Return a first guess (m, m), to be kept in the form that suits programs with inequalities or without."""
    return Hessian(hessian) if inequalities else InverseHessian(_inverse(hessian))


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def solve_small(matrix: Array, right: Array) -> Array | None:
    """Solution of a small symmetric system, positive semidefinite, the shortest of many; None where there is none."""
    if len(right) == 1:
        return np.asarray(right / matrix[0, 0]) if matrix[0, 0] > 0 else None
    solution = np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-12)[0], dtype=np.float64)
    return solution if np.allclose(matrix @ solution, right, rtol=1e-9, atol=1e-12) else None
