"""Sequential quadratic programming for small dense programs, which knows no robot.

minimise f(x) subject to c(x) = 0 and g(x) >= 0. Damped BFGS for the Lagrangian's Hessian (Nocedal and Wright,
Numerical Optimization, 2nd ed., procedure 18.2), multipliers that follow the step (algorithm 18.3), an l1 merit
function with Armijo line search (section 18.3), one second-order correction per iteration where there are inequalities
(section 18.3, (18.42)), and an elastic QP where the linearised constraints contradict each other (section 18.3,
p. 536).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

import numpy as np

from floatplan.arrays import Array
from floatplan.optimization.hessian import Curvature, solve_small
from floatplan.optimization.nonlinear_program import AnyEvaluation, Detail, Evaluation, Program, Settings
from floatplan.optimization.quadratic_program import Multipliers, Step

ARMIJO = 1e-4  # sufficient decrease of the merit function, Nocedal and Wright p. 540
PENALTY_FACTOR = 1.2  # of the l1 merit function's penalty over the largest multiplier
PENALTY_KEPT = 0.25  # of what a penalty is larger than needed, in the next iteration
SHORTEST_STEP = 1e-6  # of the QP's step; below it the line search has failed
SHORTENING = (0.1, 0.5)  # by which the line search goes on after a failure: from most to least
LARGEST_MULTIPLIER = 1e12  # relative to the price of a slack; beyond it the constraints' derivatives are mere rounding
CRAWLING_EVALUATIONS = 5  # of one line search: more than these is crawling
CRAWLING_STEPS = 5  # in a row, after which the Hessian starts afresh, and the second time the search ends
DAMPING = 0.2  # of Powell's damped BFGS, Nocedal and Wright (18.14)
ELASTIC_WEIGHT = 1e3  # price of a slack, relative to the Hessian's largest diagonal entry
LARGEST_CURVATURE = 1e10  # found by BFGS, relative to the price of a slack; beyond it the guess is worthless
POLISHING_STEPS = 2
POLISHED = 1e-12  # equalities within this are about as good as rounding lets them be


@dataclass(frozen=True, eq=False)
class Solution(Generic[Detail]):
    """Where the search ended.

    ``status`` is "optimal" (both tolerances hold), "feasible" (only the constraints do) or "infeasible"; ``curvature``
    is the last guess of the Lagrangian's Hessian.
    """

    x: Array
    evaluation: Evaluation[Detail]
    status: str
    iterations: int
    evaluations: int
    curvature: Curvature | None = None


@dataclass(frozen=True, eq=False)
class _Accepted(Generic[Detail]):
    """What the line search accepted after a share of the step: x moved by ``change``."""

    x: Array
    change: Array
    evaluation: Evaluation[Detail]
    share: float


def minimise(
    program: Program[Detail],
    x: Array,
    guess: Curvature,
    settings: Settings | None = None,
    stop: Callable[[], bool] = lambda: False,
    start: Evaluation[Detail] | None = None,
) -> Solution[Detail]:
    """Minimise a program from x (m,), with a first guess of the Lagrangian's Hessian.

    Parameters
    ----------
    stop : callable
        Asked before every iteration; when it says so the best point so far is returned.
    start : Evaluation, optional
        The program at x, where that is known.
    """
    settings = settings or Settings()
    current = linearised = start or program.evaluate(x)
    evaluations, penalty = 1, 0.0
    fresh = guess
    active = np.empty(0, dtype=np.int64)
    price = ELASTIC_WEIGHT * guess.largest
    metric_norm = float(np.linalg.norm(program.metric))
    was_reset, crawling = True, 0
    optimal = False
    iteration = 0
    multipliers = Multipliers(np.zeros(len(current.equality)), np.zeros(len(current.inequality)))
    while x.size and iteration < settings.iterations and not stop():
        iteration += 1
        linearised = current
        step = guess.step(current, active, price)
        if current.inequality.size:
            active = np.flatnonzero(step.multipliers.inequality)
        slope = float(current.gradient @ step.direction)
        settled = _is_settled(current, step, slope, settings)
        optimal = settled and current.worst_violation <= settings.feasibility
        if optimal:
            break
        wanted = PENALTY_FACTOR * step.multipliers.largest
        penalty = max(wanted, wanted + PENALTY_KEPT * (penalty - wanted))
        squared = float(step.direction @ step.direction)
        if not squared or wanted > LARGEST_MULTIPLIER * price:
            break
        share = 1.0
        if metric_norm * math.sqrt(squared) > settings.longest_step:
            share = min(1.0, settings.longest_step / float(np.linalg.norm(program.metric @ step.direction)))
        accepted, used = _line_search(program, x, current, step, slope, share, penalty)
        evaluations += used
        crawling = crawling + 1 if used > CRAWLING_EVALUATIONS else 0
        if accepted is None or crawling == CRAWLING_STEPS:
            if was_reset:
                break
            guess, was_reset, crawling = fresh, True, 0
            continue
        previous, x, current = current, accepted.x, accepted.evaluation
        optimal = settled and accepted.share == 1 and current.worst_violation <= settings.feasibility
        if optimal:
            break
        if not step.elastic:
            multipliers = multipliers.towards(step.multipliers, accepted.share)
            updated = _damped_bfgs(guess, step, accepted, previous, multipliers, LARGEST_CURVATURE * price)
            guess = fresh if updated is None else updated
        was_reset = was_reset and crawling > 0
    if settings.polish:
        x, current, used = _polish(program, x, current, linearised if optimal else current)
        evaluations += used
    feasible = current.worst_violation <= settings.feasibility
    status = ("optimal" if optimal else "feasible") if feasible else "infeasible"
    return Solution(x, current, status, iteration, evaluations, guess)


def _polish(
    program: Program[Detail], x: Array, current: Evaluation[Detail], linearised: Evaluation[Detail]
) -> tuple[Array, Evaluation[Detail], int]:
    """Shortest steps on to the equalities alone, with the derivatives of a point nearby, as long as they gain."""
    used = 0
    while used < POLISHING_STEPS and max(map(abs, current.equality.tolist()), default=0.0) > POLISHED:
        rows = linearised.equality_jacobian
        multipliers = solve_small(rows @ rows.T, current.equality)
        if multipliers is None:
            break
        closer = x - multipliers @ rows
        trial = program.evaluate(closer)
        used += 1
        if not trial.worst_violation < current.worst_violation:
            break
        x, current = closer, trial
    return x, current, used


def _is_settled(current: AnyEvaluation, step: Step, slope: float, settings: Settings) -> bool:
    """What a full step still promises of the Lagrangian, ``d H d`` twice over, is small beside the objective.

    ``slope`` is the objective's along the step.
    """
    if step.elastic:
        return False
    promised = float(step.multipliers.equality @ current.equality) - slope
    if current.inequality.size:
        promised -= float(step.multipliers.inequality @ current.inequality)
    return abs(promised) <= settings.optimality * (1 + abs(current.objective))


def _merit(evaluation: AnyEvaluation, penalty: float) -> float:
    return evaluation.objective + penalty * evaluation.violation


def _line_search(
    program: Program[Detail],
    x: Array,
    current: Evaluation[Detail],
    step: Step,
    slope: float,
    share: float,
    penalty: float,
) -> tuple[_Accepted[Detail] | None, int]:
    """Go ``share`` of a step or less: the point accepted, None where none was good enough; and the evaluations."""
    start = _merit(current, penalty)
    slope = min(slope - penalty * (current.violation - step.left), 0.0)
    rounding = 1e-13 * (1 + abs(start))
    length, used = share, 0
    while length > SHORTEST_STEP * share:
        change = step.direction if length == 1 else length * step.direction
        point = x + change
        trial = program.evaluate(point)
        used += 1
        rise = _merit(trial, penalty) - start
        if rise <= ARMIJO * length * slope + rounding:
            return _Accepted(point, change, trial, length), used
        if length == share and current.inequality.size and trial.violation > current.violation:
            corrected = point + _second_order_correction(current, trial)
            evaluation = program.evaluate(corrected)
            used += 1
            if _merit(evaluation, penalty) - start <= ARMIJO * length * slope + rounding:
                return _Accepted(corrected, corrected - x, evaluation, length), used
        lowest = -slope * length / (2 * (rise - slope * length))  # of the parabola, Nocedal and Wright (3.58)
        length *= min(SHORTENING[1], max(SHORTENING[0], lowest))
    return None, used


def _second_order_correction(current: AnyEvaluation, trial: AnyEvaluation) -> Array:
    """Shortest step that takes the constraints violated after a full step back to zero, to first order."""
    violated = trial.inequality < 0
    jacobian = np.concatenate((current.equality_jacobian, current.inequality_jacobian[violated]))
    residual = np.concatenate((trial.equality, trial.inequality[violated]))
    return np.asarray(-np.linalg.lstsq(jacobian, residual, rcond=1e-10)[0])


def _damped_bfgs(
    guess: Curvature,
    step: Step,
    accepted: _Accepted[Detail],
    previous: AnyEvaluation,
    multipliers: Multipliers,
    largest_curvature: float,
) -> Curvature | None:
    """Update the guess by what was met on the way; None where the curvature there is larger than any to be believed."""
    change, current = accepted.change, accepted.evaluation
    gradient_change = multipliers.equality @ (current.equality_jacobian - previous.equality_jacobian)
    gradient_change += current.gradient - previous.gradient
    if current.inequality.size:
        gradient_change -= multipliers.inequality @ (current.inequality_jacobian - previous.inequality_jacobian)
    image = guess.image(change, step, accepted.share)
    known = float(change @ image)
    if known < 1e-20:
        return guess
    product = float(change @ gradient_change)
    if product < DAMPING * known:
        share = (1 - DAMPING) * known / (known - product)
        gradient_change = share * gradient_change + (1 - share) * image
        product = float(change @ gradient_change)
    if not float(gradient_change @ gradient_change) < largest_curvature * product:
        return None
    return guess.updated(change, image, gradient_change)
