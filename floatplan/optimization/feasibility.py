"""Feasible points, whatever their objective: Levenberg-Marquardt on the constraint violations.

From one start, sequential quadratic programming fails on many obstacle problems that have a solution; least squares on
the violations, from several starts, solves most of them (Nocedal and Wright, Numerical Optimization, section 10.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

import numpy as np

from floatplan.arrays import Array
from floatplan.optimization.nonlinear_program import AnyEvaluation, Detail, Evaluation, Program
from floatplan.optimization.quadratic_program import solved

ITERATIONS = 60
FEASIBLE = 1e-11  # in the units of the rows: root of the sum of squared violations, at which the iteration ends
STALL_ITERATIONS = 6  # within which the squared violation must fall below STALLED
STALLED = 0.8  # [-] of the squared violation before
INITIAL_DAMPING = 1e-2  # [-] weight of the squared step
SMALLEST_DAMPING = 1e-8  # [-]
LARGEST_DAMPING = 1e8  # [-] beyond it the iteration ends
PASSES = 4  # of one step, each with the rows that the step before would violate


@dataclass(frozen=True, eq=False)
class LeastViolation(Generic[Detail]):
    """Result of :func:`reduce_violations`: a point x, the program there, its violation, and the evaluations used."""

    x: Array
    evaluation: Evaluation[Detail]
    squared_violation: float
    evaluations: int


def reduce_violations(
    program: Program[Detail], x: Array, stop: Callable[[], bool] = lambda: False, iterations: int = ITERATIONS
) -> LeastViolation[Detail]:
    """Minimise the squared violations from x (m,); steps are damped in the program's metric and in x itself."""
    metric = program.metric.T @ program.metric + np.eye(len(x))
    damping = INITIAL_DAMPING
    evaluation = program.evaluate(x)
    squared = _squares(evaluation)
    evaluations, history = 1, [squared]
    for _ in range(iterations):
        stalled = len(history) > STALL_ITERATIONS and history[-1] > STALLED * history[-1 - STALL_ITERATIONS]
        if squared < FEASIBLE**2 or damping > LARGEST_DAMPING or stalled or stop():
            break
        while damping <= LARGEST_DAMPING:
            step = _damped_step(evaluation, damping * metric)
            trial = program.evaluate(x + step)
            evaluations += 1
            if _squares(trial) < squared:
                x, damping = x + step, max(damping / 5, SMALLEST_DAMPING)
                evaluation, squared = trial, _squares(trial)
                break
            damping *= 4
        history.append(squared)
    return LeastViolation(x, evaluation, squared, evaluations)


def _squares(evaluation: AnyEvaluation) -> float:
    """Sum of squared violations."""
    violated = np.minimum(evaluation.inequality, 0)
    return float(evaluation.equality @ evaluation.equality + violated @ violated)


def _damped_step(evaluation: AnyEvaluation, damping: Array) -> Array:
    """Minimise the squared violations of the linearised program and the damping.

    Rows that hold now and would be violated by the step join those that are violated now: without them the search
    zigzags where several rows are close to their limits.
    """
    normal = evaluation.equality_jacobian.T @ evaluation.equality_jacobian + damping
    gradient = evaluation.equality_jacobian.T @ evaluation.equality
    step: Array = np.zeros(len(gradient))
    taken = np.zeros(len(evaluation.inequality), dtype=bool)
    for _ in range(PASSES):
        new = (evaluation.inequality + evaluation.inequality_jacobian @ step < 0) & ~taken
        if step.any() and not new.any():
            break
        taken |= new
        jacobian = evaluation.inequality_jacobian[new]
        normal += jacobian.T @ jacobian
        gradient += jacobian.T @ evaluation.inequality[new]
        step = -solved(normal, gradient)
    return step
