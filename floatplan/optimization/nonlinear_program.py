"""What a nonlinear program is, and when a search for its solution ends; it knows no robot.

minimise f(x) subject to c(x) = 0 and g(x) >= 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from floatplan.arrays import Array

Detail = TypeVar("Detail")


class Derivatives(NamedTuple):
    """Of a program at a point: ``gradient`` (m,), ``equality_jacobian`` (e, m), ``inequality_jacobian`` (k, m)."""

    gradient: Array
    equality_jacobian: Array
    inequality_jacobian: Array


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class Evaluation(Generic[Detail]):
    """A program at a point of m variables; the derivatives are computed when asked for.

    ``equality`` (e,), ``inequality`` (k,) with >= 0 wanted. ``detail`` is what the program remembers of the point.
    """

    objective: float
    equality: Array
    inequality: Array
    differentiate: Callable[[], Derivatives]
    detail: Detail

    @cached_property
    def _derivatives(self) -> Derivatives:
        return self.differentiate()

    @property
    def gradient(self) -> Array:
        """Gradient (m,) of the objective."""
        return self._derivatives.gradient

    @property
    def equality_jacobian(self) -> Array:
        """Derivatives (e, m) of the equalities."""
        return self._derivatives.equality_jacobian

    @property
    def inequality_jacobian(self) -> Array:
        """Derivatives (k, m) of the inequalities."""
        return self._derivatives.inequality_jacobian

    @cached_property
    def violation(self) -> float:
        """Sum of what the constraints lack."""
        return total_violation(self.equality, self.inequality)

    @cached_property
    def worst_violation(self) -> float:
        """Largest amount by which one constraint fails."""
        worst = max(map(abs, self.equality.tolist()), default=0.0)
        return max(worst, -float(self.inequality.min())) if self.inequality.size else worst


def total_violation(equality: Array, inequality: Array) -> float:
    """Sum of what equalities (e,) and inequalities (k,) lack."""
    violation: float = sum(map(abs, equality.tolist()))
    return violation - float(np.minimum(inequality, 0).sum()) if inequality.size else violation


AnyEvaluation: TypeAlias = Evaluation[Any]  # whose detail does not matter


class Program(Protocol[Detail]):
    """What :func:`floatplan.optimization.sqp.minimise` solves.

    ``metric`` (m, m) says how far a step goes: 1 is a long one, ``|metric @ step|`` its length.
    """

    @property
    def metric(self) -> Array:
        """Measure of steps (m, m), invertible."""

    def evaluate(self, x: Array) -> Evaluation[Detail]:
        """Values and derivatives at x (m,)."""


@dataclass(frozen=True)
class Settings:
    """When to stop, and how far to trust a step.

    Parameters
    ----------
    feasibility : largest violation of a constraint at a solution
    optimality : relative change of the Lagrangian that a full step still promises at a solution
    iterations : most QPs
    longest_step : of ``|metric @ step|``
    polish : whether to end with steps on to the equalities alone
    """

    feasibility: float = 1e-9
    optimality: float = 1e-9
    iterations: int = 100
    longest_step: float = 0.5
    polish: bool = True
