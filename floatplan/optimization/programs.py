"""What a nonlinear program is, and when a search for its solution ends; it knows no robot.

minimise f(x) subject to c(x) = 0 and g(x) >= 0.

The QP subproblem of SQP, ``x H x / 2 + g x`` subject to ``A x = b`` and ``C x >= l``, is solved by a dual
method, by ProxQP where that gives up, else elastic; see :mod:`floatplan.optimization.sqp`.
"""

from __future__ import annotations

import contextlib
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.proxqp import proxqp

Detail = TypeVar("Detail")
QP_ACCURACY = 1e-9  # of a QP's residuals, in the units of its rows
QP_ITERATIONS = 30  # outer; ProxQP's default of 10000 can take minutes on one infeasible QP
QP_INNER_ITERATIONS = 30
ELASTIC_ITERATIONS = 80  # of Newton's method
ENOUGH = 1e-6  # [-] of the slope along a step of that: the whole step is taken where no more is left
REGULARISATION = 1e-12  # [-] of the elastic system, relative to the slack penalty
ROWS_AT_ONCE = 16  # inequalities added to a QP at a time
ACTIVE_PER_VARIABLE = 4  # [-] inequalities of the last QP that the next begins with; at a vertex there is 1
GENERATIONS = 12  # times that rows are added before the QP counts as infeasible
QP_CHANGES = 400  # of active rows, by the dual method
QP_TOLERANCE = 1e-10  # in its own unit, by which a row may be violated by what the dual method finds
ROW_TOLERANCE = 1e-8  # in its own unit, by which a row left out of a QP may be violated by its solution


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


class Multipliers(NamedTuple):
    """Lagrange multipliers ``equality`` (e,) and ``inequality`` (k,) >= 0 of a program."""

    equality: Array
    inequality: Array

    @property
    def largest(self) -> float:
        """The largest magnitude."""
        largest = max(map(abs, self.equality.tolist()), default=0.0)
        return max(largest, float(self.inequality.max())) if self.inequality.size else largest

    def towards(self, target: Multipliers, step_length: float) -> Multipliers:
        """Move towards the multipliers of the QP by the step length (Nocedal and Wright, algorithm 18.3)."""
        if step_length == 1:
            return target
        return Multipliers(*(own + step_length * (other - own) for own, other in zip(self, target, strict=True)))


class Step(NamedTuple):
    """Solution of a QP; ``violation_left`` is that of the linearised constraints after it, 0 unless it is elastic."""

    direction: Array
    multipliers: Multipliers
    violation_left: float = 0.0
    elastic: bool = False


FirstWay: TypeAlias = Callable[[AnyEvaluation, Array], Step | None]
Counted: TypeAlias = Callable[[int, int], None]  # numbers that ProxQP has solved for, variables and rows; iterations
SolveQp: TypeAlias = Callable[[AnyEvaluation, Array, IntArray, float], Step]


def solve_qp(
    current: AnyEvaluation,
    hessian: Array,
    active: IntArray,
    slack_penalty: float,
    first: FirstWay | None = None,
    counted: Counted | None = None,
) -> Step:
    """Solve the QP of the linearised program, by :func:`elastic_qp` where there is no other way.

    The ``first`` way, where one is given, needs no guess of the ``active`` rows. What ProxQP does is ``counted``.
    """
    return (
        (first(current, hessian) if first else None)
        or _by_constraint_generation(current, hessian, active, counted)
        or elastic_qp(current, hessian, slack_penalty)
    )


def _by_constraint_generation(
    current: AnyEvaluation, hessian: Array, active: IntArray, counted: Counted | None
) -> Step | None:
    """Solve the QP by ProxQP, of ever more rows; None where it fails.

    Only the rows active last time enter, with the most violated beside them; rows that the solution violates are added
    until none is left. Thousands of rows, most of them neighbours in time, thus cost as little as the few that matter.
    """
    inequality = current.inequality
    rows = _most_violated(inequality, np.inf)
    if active.size <= ACTIVE_PER_VARIABLE * len(hessian):  # else after an elastic step, which pulls at all rows
        rows = np.union1d(active, rows)
    for _ in range(GENERATIONS):
        solution = _proxqp(current, hessian, rows, counted)
        if solution is None:
            return None
        direction, equality_multipliers, row_multipliers = solution
        linearised = inequality + current.inequality_jacobian @ direction
        linearised[rows] = np.inf
        violated = _most_violated(linearised, -ROW_TOLERANCE)
        if not violated.size:
            inequality_multipliers = np.zeros(len(inequality))
            inequality_multipliers[rows] = np.maximum(row_multipliers, 0)
            return Step(direction, Multipliers(equality_multipliers, inequality_multipliers))
        rows = np.union1d(rows, violated)
    return None


def _most_violated(values: Array, threshold: float) -> IntArray:
    """Indices of the lowest values below a threshold, ``ROWS_AT_ONCE`` at most."""
    few = len(values) <= ROWS_AT_ONCE
    lowest = np.arange(len(values)) if few else np.argpartition(values, ROWS_AT_ONCE)[:ROWS_AT_ONCE]
    return lowest[values[lowest] < threshold]


def elastic_qp(current: AnyEvaluation, hessian: Array, slack_penalty: float) -> Step:
    """Solve the QP with a slack in every constraint and a quadratic penalty on the slacks: it always has a solution.

    Without the slacks it is a convex function, quadratic piece by piece, minimised by Newton's method on the violated
    rows, each step as far as the function falls.
    """
    equality, rows = current.equality_jacobian, current.inequality_jacobian
    fixed = hessian + slack_penalty * equality.T @ equality
    regular = REGULARISATION * slack_penalty * np.eye(len(hessian))
    direction: Array = np.zeros(len(hessian))
    linearised, gradient = current.inequality, current.gradient + slack_penalty * equality.T @ current.equality
    for _ in range(ELASTIC_ITERATIONS):
        violated = linearised < 0
        jacobian = rows[violated]
        slope = gradient + slack_penalty * jacobian.T @ linearised[violated]
        change = -solved(fixed + slack_penalty * jacobian.T @ jacobian + regular, slope)
        pieces = linearised, rows @ change, slack_penalty
        length = _lowest(float(gradient @ change), float(change @ fixed @ change), *pieces)
        direction, gradient = direction + length * change, gradient + length * fixed @ change
        linearised = current.inequality + rows @ direction
        if length == 1 and ((linearised < 0) == violated).all():
            break
    residual = current.equality + equality @ direction
    multipliers = Multipliers(slack_penalty * residual, slack_penalty * np.maximum(-linearised, 0))
    return Step(direction, multipliers, total_violation(residual, linearised), elastic=True)


def _lowest(slope: float, bend: float, values: Array, changes: Array, penalty: float) -> float:
    """Where a convex function is least along a line: of its part without rows slope and second derivative are given.

    Rows have these values (k,), and change so much; between two lengths at which one vanishes it is quadratic.
    """

    def derivative(length: float) -> float:
        violated = np.minimum(values + length * changes, 0)
        return slope + length * bend + penalty * float(changes @ violated)

    lengths = np.divide(-values, changes, out=np.full(len(values), np.inf), where=changes != 0)
    kinks = [0.0, *np.sort(lengths[(lengths > 0) & np.isfinite(lengths)]).tolist()]
    after = bisect_left(kinks, 0.0, lo=1, key=derivative)
    low, high = kinks[after - 1], kinks[after] if after < len(kinks) else kinks[after - 1] + 1
    below, above = derivative(low), derivative(high)
    return (
        1.0 if abs(derivative(1.0)) <= ENOUGH * abs(derivative(0.0)) else low - below * (high - low) / (above - below)
    )


def solved(matrix: Array, right: Array) -> Array:
    """Solution of a linear system; of one that rounding has made singular that of least norm, zeros if that fails."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        with contextlib.suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)
    return np.zeros(len(right))


def _proxqp(
    current: AnyEvaluation, hessian: Array, rows: IntArray, counted: Counted | None
) -> tuple[Array, Array, Array] | None:
    """Solve the QP with some ``rows`` of the inequalities: x, and multipliers y, z >= 0; None if it fails.

    At the solution ``H x + g + A^T y - C^T z = 0``.
    """
    equality, inequality = current.equality, current.inequality[rows]
    qp = proxqp.dense.QP(len(hessian), len(equality), len(inequality))
    qp.settings.eps_abs = QP_ACCURACY
    qp.settings.max_iter = QP_ITERATIONS
    qp.settings.max_iter_in = QP_INNER_ITERATIONS
    of_equality = (current.equality_jacobian, -equality) if equality.size else (None, None)
    of_inequality = (current.inequality_jacobian[rows], -inequality) if inequality.size else (None, None)
    qp.init(hessian, current.gradient, *of_equality, *of_inequality, None)
    qp.solve()
    results = qp.results
    if counted:
        counted(len(hessian) + len(rows), results.info.iter)
    if results.info.status != proxqp.PROXQP_SOLVED or not np.isfinite(results.x).all():
        return None
    return np.array(results.x), np.array(results.y), -np.array(results.z)
