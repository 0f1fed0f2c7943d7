"""A motion that violates nothing, whatever it costs: Levenberg-Marquardt on the violations alone.

From one start, sequential quadratic programming loses many obstacle problems that have a solution; least squares on
what is violated, from several starts, finds most of them (Nocedal and Wright, Numerical Optimization, section 10.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

import numpy as np

from floatplan.arrays import Array
from floatplan.optimization.nonlinear_program import AnyEvaluation, Detail, Evaluation, Program

ITERATIONS = 60
ENOUGH = 1e-11  # root of the sum of squares below which the search for the objective takes over
PATIENCE = 6  # iterations over which the violations must fall to STALLED of what they were
STALLED = 0.8
FIRST_DAMPING = 1e-2
SMALLEST_DAMPING = 1e-8
LARGEST_DAMPING = 1e8
PASSES = 4  # times that rows a step would violate join it


@dataclass(frozen=True, eq=False)
class Nearest(Generic[Detail]):
    """The least violating motion found: x, the program there, the sum of squared violations, how many evaluations."""

    x: Array
    evaluation: Evaluation[Detail]
    squares: float
    evaluations: int


def reduce_violations(
    program: Program[Detail], x: Array, stop: Callable[[], bool] = lambda: False, iterations: int = ITERATIONS
) -> Nearest[Detail]:
    """Reduce the violations of a program from x (m,), by steps short in the program's metric and in x itself.

    For objective (17) x is the whitened b: short steps keep motions smooth.
    """
    metric = program.metric.T @ program.metric + np.eye(len(x))
    damping = FIRST_DAMPING
    evaluation = program.evaluate(x)
    squares = _squares(evaluation)
    evaluations, history = 1, [squares]
    for _ in range(iterations):
        stalled = len(history) > PATIENCE and history[-1] > STALLED * history[-1 - PATIENCE]
        if squares < ENOUGH**2 or damping > LARGEST_DAMPING or stalled or stop():
            break
        while damping <= LARGEST_DAMPING:
            step = _step(evaluation, damping * metric)
            trial = program.evaluate(x + step)
            evaluations += 1
            if _squares(trial) < squares:
                x, damping = x + step, max(damping / 5, SMALLEST_DAMPING)
                evaluation, squares = trial, _squares(trial)
                break
            damping *= 4
        history.append(squares)
    return Nearest(x, evaluation, squares, evaluations)


def _squares(evaluation: AnyEvaluation) -> float:
    """Sum of squared violations."""
    violated = np.minimum(evaluation.inequality, 0)
    return float(evaluation.equality @ evaluation.equality + violated @ violated)


def _step(evaluation: AnyEvaluation, damping: Array) -> Array:
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
        step = np.asarray(-np.linalg.solve(normal, gradient))
    return step
