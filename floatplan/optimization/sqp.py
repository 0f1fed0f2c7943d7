"""Sequential quadratic programming for small dense nonlinear programs.

minimise f(x) subject to c(x) = 0 and g(x) >= 0. Damped BFGS for the Lagrangian's Hessian (Nocedal and Wright,
Numerical Optimization, 2nd ed., procedure 18.2), multipliers that follow the step (algorithm 18.3), an l1 merit
function with Armijo line search (section 18.3), one second-order correction per iteration where there are inequalities
(section 18.3, (18.42)), and an elastic QP where the linearised constraints contradict each other (section 18.3,
p. 536).

From one start it fails on many obstacle problems that have a solution. Levenberg-Marquardt on the constraint violations
alone, whatever the objective, solves most of them from several starts (section 10.3): :func:`reduce_violations`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.tolerances import EXCHANGE, SETTINGS
from floatplan.optimization.programs import (
    AnyEvaluation,
    Detail,
    Evaluation,
    Multipliers,
    Program,
    Settings,
    SolveQp,
    Step,
    solve_qp,
    solved,
)


def solve_small(matrix: Array, right: Array) -> Array | None:
    """Solution of a small symmetric system, positive semidefinite: that of least norm; None where there is none."""
    if len(right) == 1:
        return np.asarray(right / matrix[0, 0]) if matrix[0, 0] > 0 else None
    solution = np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-12)[0], dtype=np.float64)
    return solution if np.allclose(matrix @ solution, right, rtol=1e-9, atol=1e-12) else None


@dataclass(frozen=True, eq=False)
class Solution(Generic[Detail]):
    """The point where the solver stopped, and why.

    ``status`` is "optimal" (both tolerances hold), "feasible" (only the constraints do) or "infeasible"; ``hessian`` is
    the last approximation of the Lagrangian's.
    """

    x: Array
    evaluation: Evaluation[Detail]
    status: str
    iterations: int
    evaluations: int
    hessian: Array | None = None


class _Accepted(NamedTuple, Generic[Detail]):
    """A point that the line search accepted: x moved by ``change``."""

    x: Array
    change: Array
    evaluation: Evaluation[Detail]
    step_length: float


def minimise(
    program: Program[Detail],
    x: Array,
    hessian: Array,
    settings: Settings | None = None,
    stop: Callable[[], bool] = lambda: False,
    start: Evaluation[Detail] | None = None,
    solve: SolveQp = solve_qp,
) -> Solution[Detail]:
    """Minimise a program from x (m,), with a first approximation (m, m) of the Lagrangian's Hessian.

    Parameters
    ----------
    stop : callable
        Called before every iteration; once it is true the point reached so far is returned.
    start : Evaluation, optional
        The program at x, where that is known.
    solve : callable
        The way in which quadratic programs are solved.
    """
    settings = settings or Settings()
    current = linearised = start or program.evaluate(x)
    evaluations, penalty = 1, 0.0
    initial = hessian
    active = np.empty(0, dtype=np.int64)
    slack_penalty = SETTINGS.slack_penalty * float(hessian.diagonal().max(initial=1.0))
    metric_norm = math.sqrt(float(np.vdot(program.metric, program.metric)))
    was_reset, optimal, slow_steps, iteration = True, False, 0, 0
    multipliers = Multipliers(np.zeros(len(current.equality)), np.zeros(len(current.inequality)))
    while x.size and iteration < settings.iterations and not stop():
        iteration += 1
        linearised = current
        step = solve(current, hessian, active, slack_penalty)
        if current.inequality.size:
            active = np.flatnonzero(step.multipliers.inequality)
        slope = float(current.gradient @ step.direction)
        stationary = _is_stationary(current, step, slope, settings)
        optimal = stationary and current.worst_violation <= settings.feasibility
        if optimal:
            break
        required = SETTINGS.penalty_factor * step.multipliers.largest
        penalty = max(required, required + SETTINGS.penalty_kept * (penalty - required))
        squared = float(step.direction @ step.direction)
        if not squared or required > SETTINGS.largest_multiplier * slack_penalty:
            break
        step_length = 1.0
        if metric_norm * math.sqrt(squared) > settings.longest_step:  # else it is shorter in the metric
            step_length = min(1.0, settings.longest_step / float(np.linalg.norm(program.metric @ step.direction)))
        accepted, used = _line_search(program, x, current, step, slope, step_length, penalty)
        evaluations += used
        slow_steps = slow_steps + 1 if used > SETTINGS.slow_evaluations else 0
        if accepted is None or slow_steps == SETTINGS.slow_steps:
            if was_reset:
                break
            hessian, was_reset, slow_steps = initial, True, 0
            continue
        previous, x, current = current, accepted.x, accepted.evaluation
        optimal = stationary and accepted.step_length == 1 and current.worst_violation <= settings.feasibility
        if optimal:
            break
        if not step.elastic:
            multipliers = multipliers.towards(step.multipliers, accepted.step_length)
            updated = _damped_bfgs(hessian, accepted, previous, multipliers, SETTINGS.largest_curvature * slack_penalty)
            hessian = initial if updated is None else updated
        was_reset = was_reset and slow_steps > 0
    if settings.polish:
        x, current, used = _polish(program, x, current, linearised if optimal else current)
        evaluations += used
    feasible = current.worst_violation <= settings.feasibility
    status = ("optimal" if optimal else "feasible") if feasible else "infeasible"
    return Solution(x, current, status, iteration, evaluations, hessian)


def _polish(
    program: Program[Detail], x: Array, current: Evaluation[Detail], linearised: Evaluation[Detail]
) -> tuple[Array, Evaluation[Detail], int]:
    """Least-norm steps on to the equalities, with the derivatives of a point nearby, while the violation decreases."""
    used = 0
    while used < SETTINGS.polishing_steps and max(map(abs, current.equality.tolist()), default=0.0) > SETTINGS.polished:
        rows = linearised.equality_jacobian
        multipliers = solve_small(rows @ rows.T, current.equality)
        if multipliers is None:
            break
        closer, used = x - multipliers @ rows, used + 1
        trial = program.evaluate(closer)
        if not trial.worst_violation < current.worst_violation:
            break
        x, current = closer, trial
    return x, current, used


def _is_stationary(current: AnyEvaluation, step: Step, slope: float, settings: Settings) -> bool:
    """Whether the Lagrangian's predicted decrease over a full step, ``d H d``, is small relative to the objective.

    ``slope`` is the objective's along the step.
    """
    predicted = float(step.multipliers.equality @ current.equality) - slope
    if current.inequality.size:
        predicted -= float(step.multipliers.inequality @ current.inequality)
    return not step.elastic and abs(predicted) <= settings.optimality * (1 + abs(current.objective))


def _line_search(
    program: Program[Detail],
    x: Array,
    current: Evaluation[Detail],
    step: Step,
    slope: float,
    first: float,
    penalty: float,
) -> tuple[_Accepted[Detail] | None, int]:
    """Backtrack from a ``first`` step length: the point accepted, None where none is; and the number of evaluations."""

    def merit(evaluation: AnyEvaluation) -> float:
        return evaluation.objective + penalty * evaluation.violation

    start = merit(current)
    slope = min(slope - penalty * (current.violation - step.violation_left), 0.0)
    rounding = 1e-13 * (1 + abs(start))
    length, used = first, 0
    while length > SETTINGS.shortest_step * first:
        change = step.direction if length == 1 else length * step.direction
        point = x + change
        trial = program.evaluate(point)
        used += 1
        rise = merit(trial) - start
        if rise <= SETTINGS.armijo * length * slope + rounding:
            return _Accepted(point, change, trial, length), used
        if length == first and current.inequality.size and trial.violation > current.violation:
            violated = trial.inequality < 0  # to zero, to first order, by the shortest step
            rows = np.concatenate((current.equality_jacobian, current.inequality_jacobian[violated]))
            lacking = np.concatenate((trial.equality, trial.inequality[violated]))
            corrected = point - np.linalg.lstsq(rows, lacking, rcond=1e-10)[0]
            evaluation = program.evaluate(corrected)
            used += 1
            if merit(evaluation) - start <= SETTINGS.armijo * length * slope + rounding:
                return _Accepted(corrected, corrected - x, evaluation, length), used
        lowest = -slope * length / (2 * (rise - slope * length))  # of the parabola, Nocedal and Wright (3.58)
        length *= min(SETTINGS.shortening[1], max(SETTINGS.shortening[0], lowest))
    return None, used


def _damped_bfgs(
    hessian: Array,
    accepted: _Accepted[Detail],
    previous: AnyEvaluation,
    multipliers: Multipliers,
    largest_curvature: float,
) -> Array | None:
    """Update the approximation along an accepted step; None where its curvature exceeds ``largest_curvature``.

    The new one maps the change of x to that of the Lagrangian's gradient, Nocedal and Wright (6.19).
    """
    change, current = accepted.change, accepted.evaluation
    gradient_change = multipliers.equality @ (current.equality_jacobian - previous.equality_jacobian)
    gradient_change += current.gradient - previous.gradient
    if current.inequality.size:
        gradient_change -= multipliers.inequality @ (current.inequality_jacobian - previous.inequality_jacobian)
    product = hessian @ change
    approximated = float(change @ product)
    if approximated < 1e-20:
        return hessian
    curvature = float(change @ gradient_change)
    if curvature < SETTINGS.damping * approximated:
        damping = (1 - SETTINGS.damping) * approximated / (approximated - curvature)
        gradient_change = damping * gradient_change + (1 - damping) * product
        curvature = float(change @ gradient_change)
    if not float(gradient_change @ gradient_change) < largest_curvature * curvature:
        return None
    gained = (gradient_change / (gradient_change @ change))[:, None] * gradient_change
    lost = (product / (product @ change))[:, None] * product
    return np.asarray(hessian + gained - lost)


@dataclass(frozen=True, eq=False)
class LeastViolation(Generic[Detail]):
    """Result of :func:`reduce_violations`: a point x, the program there, its violation, and the evaluations used.

    It is ``stuck`` where a step that is hardly damped was to gain next to nothing.
    """

    x: Array
    evaluation: Evaluation[Detail]
    squared_violation: float
    evaluations: int
    stuck: bool


def reduce_violations(
    program: Program[Detail], x: Array, stop: Callable[[], bool] = lambda: False, iterations: int = EXCHANGE.iterations
) -> LeastViolation[Detail]:
    """Minimise the squared violations from x (m,); steps are damped in the program's metric and in x itself."""
    metric = program.metric.T @ program.metric + np.eye(len(x))
    damping = EXCHANGE.initial_damping
    evaluation = program.evaluate(x)
    squared = _squares(evaluation)
    evaluations, history, stuck = 1, [squared], False
    for _ in range(iterations):
        stalled = (
            len(history) > EXCHANGE.stall_iterations
            and history[-1] > EXCHANGE.stalled * history[-1 - EXCHANGE.stall_iterations]
        )
        if squared < EXCHANGE.feasible**2 or damping > EXCHANGE.largest_damping or stalled or stuck or stop():
            break
        while damping <= EXCHANGE.largest_damping:
            step, left = _damped_step(evaluation, damping * metric)
            stuck = (
                squared > EXCHANGE.far
                and damping <= EXCHANGE.initial_damping
                and left > (1 - EXCHANGE.least_gain) * squared
            )
            if stuck:
                break
            trial = program.evaluate(x + step)
            evaluations += 1
            if _squares(trial) < squared:
                x, damping = x + step, max(damping / 5, EXCHANGE.smallest_damping)
                evaluation, squared = trial, _squares(trial)
                break
            damping *= 4
        history.append(squared)
    return LeastViolation(x, evaluation, squared, evaluations, stuck)


def _squares(evaluation: AnyEvaluation) -> float:
    """Sum of squared violations."""
    violated = np.minimum(evaluation.inequality, 0)
    return float(evaluation.equality @ evaluation.equality + violated @ violated)


def _damped_step(evaluation: AnyEvaluation, damping: Array) -> tuple[Array, float]:
    """Minimise the squared violations of the linearised program and the damping; return what is left of them too.

    Rows that hold now and would be violated by the step join those that are violated now: without them the search
    zigzags where several rows are close to their limits. What is left is of these alone: with others it is more.
    """
    normal = evaluation.equality_jacobian.T @ evaluation.equality_jacobian + damping
    gradient = evaluation.equality_jacobian.T @ evaluation.equality
    step: Array = np.zeros(len(gradient))
    taken = np.zeros(len(evaluation.inequality), dtype=bool)
    left = 0.0
    for number in range(EXCHANGE.passes):
        after = evaluation.inequality + evaluation.inequality_jacobian @ step
        if number == 1:
            missed = evaluation.equality + evaluation.equality_jacobian @ step
            left = float(missed @ missed + np.square(after[taken & (after < 0)]).sum())
        new = (after < 0) & ~taken
        if step.any() and not new.any():
            break
        taken |= new
        jacobian = evaluation.inequality_jacobian[new]
        normal += jacobian.T @ jacobian
        gradient += jacobian.T @ evaluation.inequality[new]
        step = -solved(normal, gradient)
    return step, left
