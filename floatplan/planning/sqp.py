"""Sequential quadratic programming for small dense programs, which knows no robot; ProxSuite solves the larger QPs.

minimise f(x) subject to c(x) = 0 and g(x) >= 0. Damped BFGS for the Lagrangian's Hessian (Nocedal and Wright,
Numerical Optimization, 2nd ed., procedure 18.2), an l1 merit function with Armijo line search (section 18.3), one
second-order correction per iteration where there are inequalities (section 18.3, (18.42)), and an elastic QP where the
linearised constraints contradict each other (section 18.3, p. 536).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from proxsuite import proxqp

from floatplan.arrays import Array, IntArray
from floatplan.planning.nonlinear_program import (
    Evaluation,
    Program,
    Settings,
    Solution,
    total_violation,
)

ARMIJO = 1e-4  # sufficient decrease of the merit function, Nocedal and Wright p. 540
PENALTY_FACTOR = 1.2  # of the l1 merit function's penalty over the largest multiplier
PENALTY_KEPT = 0.25  # of what a penalty is larger than needed, in the next iteration
SHORTEST_STEP = 1e-6  # of the QP's step; below it the line search has failed
SHORTENING = (0.1, 0.5)  # by which the line search goes on after a failure: from most to least
LARGEST_MULTIPLIER = 1e12  # relative to the price of a slack; beyond it the constraints' derivatives are mere rounding
CRAWLING_EVALUATIONS = 5  # of one line search: more than these is crawling
CRAWLING_STEPS = 5  # in a row, after which the Hessian starts afresh, and the second time the search ends
DAMPING = 0.2  # of Powell's damped BFGS, Nocedal and Wright (18.14)
QP_ACCURACY = 1e-9
QP_ITERATIONS = 30  # outer; ProxQP's default of 10000 can take minutes on one infeasible QP
QP_INNER_ITERATIONS = 30
ELASTIC_WEIGHT = 1e3  # price of a slack, relative to the Hessian's largest diagonal entry
ELASTIC_ITERATIONS = 20
REGULARISATION = 1e-12  # of the elastic system, relative to the price
LARGEST_CURVATURE = 1e10  # of the Hessian's guess, relative to the first one; beyond it the guess is worthless
ROWS_AT_ONCE = 16  # inequalities added to a QP at a time
GENERATIONS = 12
ROW_TOLERANCE = 1e-8  # by which a row left out of a QP may be violated by its solution
POLISHING_STEPS = 2
POLISHED = 1e-12  # equalities within this are about as good as rounding lets them be


@dataclass(frozen=True, eq=False)
class _Multipliers:
    equality: Array
    inequality: Array

    @property
    def largest(self) -> float:
        """The largest magnitude."""
        largest = max(map(abs, self.equality.tolist()), default=0.0)
        return max(largest, float(self.inequality.max())) if self.inequality.size else largest

    def towards(self, wanted: _Multipliers, share: float) -> _Multipliers:
        """Go a share of the way, as far as the step went (Nocedal and Wright, algorithm 18.3)."""
        if share == 1:
            return wanted
        return _Multipliers(
            self.equality + share * (wanted.equality - self.equality),
            self.inequality + share * (wanted.inequality - self.inequality),
        )


@dataclass(frozen=True, eq=False)
class _Step:
    """Solution of a QP; ``left`` is the violation of the linearised constraints after it, 0 but for an elastic one."""

    direction: Array
    multipliers: _Multipliers
    left: float = 0.0
    elastic: bool = False


@dataclass(frozen=True, eq=False)
class _Accepted:
    """What the line search accepted after a share of the step."""

    x: Array
    evaluation: Evaluation
    share: float


def minimise(
    program: Program,
    x: Array,
    hessian: Array,
    settings: Settings | None = None,
    stop: Callable[[], bool] = lambda: False,
    start: Evaluation | None = None,
) -> Solution:
    """Minimise a program from x (m,), with ``hessian`` (m, m) as the first guess of the Lagrangian's.

    Parameters
    ----------
    stop : callable
        Asked before every iteration; when it says so the best point so far is returned.
    start : Evaluation, optional
        The program at x, where that is known.
    """
    settings = settings or Settings()
    current = start or program.evaluate(x)
    evaluations, penalty = 1, 0.0
    fresh = hessian
    active = np.empty(0, dtype=np.int64)
    price = ELASTIC_WEIGHT * float(hessian.diagonal().max(initial=1.0))
    was_reset, crawling = True, 0
    optimal = False
    iteration = 0
    multipliers = _Multipliers(np.zeros(len(current.equality)), np.zeros(len(current.inequality)))
    while x.size and iteration < settings.iterations and not stop():
        iteration += 1
        step = _solve_qp(current, hessian, active, price)
        if current.inequality.size:
            active = np.flatnonzero(step.multipliers.inequality)
        settled = _is_settled(current, step, settings)
        optimal = settled and current.worst_violation <= settings.feasibility
        if optimal:
            break
        wanted = PENALTY_FACTOR * step.multipliers.largest
        penalty = max(wanted, wanted + PENALTY_KEPT * (penalty - wanted))
        measured = program.metric @ step.direction
        length = math.sqrt(measured @ measured)
        if not length or wanted > LARGEST_MULTIPLIER * price:
            break
        share = min(1.0, settings.longest_step / length)
        accepted, used = _line_search(program, x, current, step, share, penalty)
        evaluations += used
        crawling = crawling + 1 if used > CRAWLING_EVALUATIONS else 0
        if accepted is None or crawling == CRAWLING_STEPS:
            if was_reset:
                break
            hessian, was_reset, crawling = fresh, True, 0
            continue
        previous, change = current, accepted.x - x
        x, current = accepted.x, accepted.evaluation
        optimal = settled and accepted.share == 1 and current.worst_violation <= settings.feasibility
        if optimal:
            break
        if not step.elastic:
            multipliers = multipliers.towards(step.multipliers, accepted.share)
            hessian = _damped_bfgs(hessian, change, previous, current, multipliers)
            if not hessian.trace() < LARGEST_CURVATURE * price:
                hessian = fresh
        was_reset = was_reset and crawling > 0
    if settings.polish:
        x, current, used = _polish(program, x, current)
        evaluations += used
    feasible = current.worst_violation <= settings.feasibility
    status = ("optimal" if optimal else "feasible") if feasible else "infeasible"
    return Solution(x, current, status, iteration, evaluations, hessian)


def _polish(program: Program, x: Array, current: Evaluation) -> tuple[Array, Evaluation, int]:
    """Newton's method on the equalities alone, by shortest steps, as long as it gains."""
    used = 0
    while used < POLISHING_STEPS and np.abs(current.equality).max(initial=0) > POLISHED:
        closer = x - np.linalg.lstsq(current.equality_jacobian, current.equality, rcond=1e-12)[0]
        trial = program.evaluate(closer)
        used += 1
        if not trial.worst_violation < current.worst_violation:
            break
        x, current = closer, trial
    return x, current, used


def _is_settled(current: Evaluation, step: _Step, settings: Settings) -> bool:
    """What a full step still promises of the Lagrangian, ``d H d`` twice over, is small beside the objective."""
    if step.elastic:
        return False
    promised = float(step.multipliers.equality @ current.equality) - float(current.gradient @ step.direction)
    if current.inequality.size:
        promised -= float(step.multipliers.inequality @ current.inequality)
    return abs(promised) <= settings.optimality * (1 + abs(current.objective))


def _merit(evaluation: Evaluation, penalty: float) -> float:
    return evaluation.objective + penalty * evaluation.violation


def _line_search(
    program: Program, x: Array, current: Evaluation, step: _Step, share: float, penalty: float
) -> tuple[_Accepted | None, int]:
    """Go ``share`` of a step or less: the point accepted, None where none was good enough; and the evaluations."""
    start = _merit(current, penalty)
    promised = float(current.gradient @ step.direction) - penalty * (current.violation - step.left)
    slope = min(promised, 0.0)
    rounding = 1e-13 * (1 + abs(start))
    length, used = share, 0
    while length > SHORTEST_STEP * share:
        point = x + (step.direction if length == 1 else length * step.direction)
        trial = program.evaluate(point)
        used += 1
        rise = _merit(trial, penalty) - start
        if rise <= ARMIJO * length * slope + rounding:
            return _Accepted(point, trial, length), used
        if length == share and current.inequality.size and trial.violation > current.violation:
            corrected = point + _second_order_correction(current, trial)
            evaluation = program.evaluate(corrected)
            used += 1
            if _merit(evaluation, penalty) - start <= ARMIJO * length * slope + rounding:
                return _Accepted(corrected, evaluation, length), used
        lowest = -slope * length / (2 * (rise - slope * length))  # of the parabola, Nocedal and Wright (3.58)
        length *= min(SHORTENING[1], max(SHORTENING[0], lowest))
    return None, used


def _second_order_correction(current: Evaluation, trial: Evaluation) -> Array:
    """Shortest step that takes the constraints violated after a full step back to zero, to first order."""
    violated = trial.inequality < 0
    jacobian = np.concatenate((current.equality_jacobian, current.inequality_jacobian[violated]))
    residual = np.concatenate((trial.equality, trial.inequality[violated]))
    return np.asarray(-np.linalg.lstsq(jacobian, residual, rcond=1e-10)[0])


def _damped_bfgs(
    hessian: Array, change: Array, previous: Evaluation, current: Evaluation, multipliers: _Multipliers
) -> Array:
    gradient_change = multipliers.equality @ (current.equality_jacobian - previous.equality_jacobian)
    gradient_change += current.gradient - previous.gradient
    if current.inequality.size:
        gradient_change -= multipliers.inequality @ (current.inequality_jacobian - previous.inequality_jacobian)
    image = hessian @ change
    curvature = float(change @ image)
    if curvature < 1e-20:
        return hessian
    product = float(change @ gradient_change)
    if product < DAMPING * curvature:
        share = (1 - DAMPING) * curvature / (curvature - product)
        gradient_change = share * gradient_change + (1 - share) * image
        product = float(change @ gradient_change)
    gained = (gradient_change / product)[:, None] * gradient_change
    return np.asarray(hessian + gained - (image / curvature)[:, None] * image)


def _solve_qp(current: Evaluation, hessian: Array, active: IntArray, price: float) -> _Step:
    """Solve the QP of the linearised program by constraint generation.

    Only the rows active last time enter, with the most violated beside them; rows that the solution violates are added
    until none is left. Thousands of rows, most of them neighbours in time, thus cost as little as the few that matter.
    """
    equality, inequality, rows = current.equality_jacobian, current.inequality, active
    if active.size:
        rows = _union(len(inequality), active, _most_violated(inequality, np.inf))
    for _ in range(GENERATIONS):
        if rows.size:
            solved = _proxqp(
                hessian,
                current.gradient,
                equality,
                -current.equality,
                current.inequality_jacobian[rows],
                -inequality[rows],
            )
        else:
            solved = _equality_qp(hessian, current.gradient, equality, -current.equality)
        if solved is None:
            return _elastic_qp(current, hessian, price)
        direction, equality_multiplier, row_multiplier = solved
        if not inequality.size:
            return _Step(direction, _Multipliers(equality_multiplier, inequality))
        linearised = inequality + current.inequality_jacobian @ direction
        linearised[rows] = np.inf
        missing = _most_violated(linearised, -ROW_TOLERANCE)
        if not missing.size:
            inequality_multiplier = np.zeros(len(inequality))
            inequality_multiplier[rows] = np.maximum(row_multiplier, 0)
            return _Step(direction, _Multipliers(equality_multiplier, inequality_multiplier))
        rows = _union(len(inequality), rows, missing)
    return _elastic_qp(current, hessian, price)


def _union(count: int, first: IntArray, second: IntArray) -> IntArray:
    """Indices below ``count`` that are in either, rising."""
    chosen = np.zeros(count, dtype=bool)
    chosen[first] = chosen[second] = True
    return np.flatnonzero(chosen)


def _most_violated(values: Array, threshold: float) -> IntArray:
    """Indices of the lowest values below a threshold, ``ROWS_AT_ONCE`` at most."""
    if len(values) > ROWS_AT_ONCE:
        lowest = np.argpartition(values, ROWS_AT_ONCE)[:ROWS_AT_ONCE]
    else:
        lowest = np.arange(len(values))
    return lowest[values[lowest] < threshold]


def _elastic_qp(current: Evaluation, hessian: Array, price: float) -> _Step:
    """The QP with slack in every constraint, at a quadratic price: it always has a solution.

    With the slacks eliminated it is a piecewise quadratic function, minimised by Newton's method on its active rows.
    """
    equality, rows = current.equality_jacobian, current.inequality_jacobian
    fixed_hessian = hessian + price * equality.T @ equality
    fixed_gradient = current.gradient + price * equality.T @ current.equality
    direction: Array = np.zeros(len(hessian))
    lacking = current.inequality < 0
    for _ in range(ELASTIC_ITERATIONS):
        violated = rows[lacking]
        matrix = fixed_hessian + price * violated.T @ violated + REGULARISATION * price * np.eye(len(hessian))
        direction = np.asarray(
            -np.linalg.solve(matrix, fixed_gradient + price * violated.T @ current.inequality[lacking])
        )
        now = current.inequality + rows @ direction < 0
        if (now == lacking).all():
            break
        lacking = now
    missed, linearised = current.equality + equality @ direction, current.inequality + rows @ direction
    multipliers = _Multipliers(price * missed, price * np.maximum(-linearised, 0))
    return _Step(direction, multipliers, total_violation(missed, linearised), elastic=True)


def _equality_qp(hessian: Array, gradient: Array, rows: Array, values: Array) -> tuple[Array, Array, Array] | None:
    """Minimise ``x H x / 2 + g x`` with ``A x = b`` by the linear system of its optimality, see :func:`_proxqp`.

    ProxQP takes those whose rows depend on each other.
    """
    size = len(gradient)
    matrix = np.zeros((size + len(values), size + len(values)))
    matrix[:size, :size] = hessian
    matrix[:size, size:] = rows.T
    matrix[size:, :size] = rows
    right = np.empty(len(matrix))
    np.negative(gradient, out=right[:size])
    right[size:] = values
    try:
        solution = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return _proxqp(hessian, gradient, rows, values, np.empty((0, size)), np.empty(0))
    return solution[:size], solution[size:], np.empty(0)


def _proxqp(
    hessian: Array,
    gradient: Array,
    equality_rows: Array,
    equality_values: Array,
    inequality_rows: Array,
    inequality_bounds: Array,
) -> tuple[Array, Array, Array] | None:
    """Minimise ``x H x / 2 + g x`` with ``A x = b``, ``C x >= l``: x, and multipliers y, z >= 0; None if it fails.

    At the solution ``H x + g + A^T y - C^T z = 0``.
    """
    equalities, inequalities = len(equality_values), len(inequality_bounds)
    qp = proxqp.dense.QP(len(gradient), equalities, inequalities)
    qp.settings.eps_abs = QP_ACCURACY
    qp.settings.max_iter = QP_ITERATIONS
    qp.settings.max_iter_in = QP_INNER_ITERATIONS
    qp.init(
        hessian,
        gradient,
        equality_rows if equalities else None,
        equality_values if equalities else None,
        inequality_rows if inequalities else None,
        inequality_bounds if inequalities else None,
        None,
    )
    qp.solve()
    results = qp.results
    if results.info.status != proxqp.PROXQP_SOLVED or not np.isfinite(results.x).all():
        return None
    return np.array(results.x), np.array(results.y), -np.array(results.z)
