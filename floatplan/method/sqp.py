"""Sequential quadratic programming in a trust region; an elastic variable gives each quadratic program a solution.

Numbers in parentheses are those of Nocedal and Wright, Numerical Optimization, second edition, chapter 18.
"""

import numpy as np
from proxsuite import proxqp

from floatplan.arrays import Array
from floatplan.method.program import Evaluation, Program

FEASIBLE = 1e-9  # [-] of a row's scale: largest violation at a solution
MOST_STEPS = 150
LONGEST_STEP = 0.5  # [rad] root mean square of p, of each variable


def minimise(program: Program, x: Array, instants: Array) -> tuple[Array, Evaluation, int]:
    """Solve a program from x (m,), with inequalities at instants: its solution, after fewer than MOST_STEPS steps.

    The merit of a point is its objective and a penalty times what its lowest row lacks, (18.27).
    """

    def merit(point: Evaluation) -> float:
        return float(point.objective - penalty * point.rows.min())

    here = program.evaluate(x, instants)
    B = here.hessian
    radius = LONGEST_STEP
    penalty = max(here.objective, radius**2 * np.trace(B))
    steps = 0
    while steps < MOST_STEPS and radius > 1e-7 and len(x):  # [rad]: where no longer step lowers the merit it ends
        d, multipliers, left = elastic_step(here, B, radius, penalty)
        if left > FEASIBLE and elastic_step(here, B, radius, 10 * penalty)[2] < 0.9 * left:
            penalty = 10 * penalty
            continue
        if left < FEASIBLE:
            penalty = max(here.objective, 2 * multipliers.sum())  # their sum already makes the merit exact
        promised = -here.gradient @ d - d @ B @ d / 2 - penalty * (here.rows.min() + left)
        if promised < 1e-10 * merit(here):
            break
        there = program.evaluate(x + d, instants)
        if merit(here) - merit(there) < promised / 4:
            # Corrected to second order, (18.42), by what active rows, and (14), lack there
            lacking = there.rows - here.rows - here.rows_by_x @ d
            short = (lacking < 0) & ((multipliers > 0) | (np.arange(len(lacking)) < 2))
            d = d - np.linalg.lstsq(here.rows_by_x[short], lacking[short], rcond=1e-10)[0]
            there = program.evaluate(x + d, instants)
        gained = merit(here) - merit(there)
        radius = min(radius, np.abs(d).max()) / 4 if gained < promised / 4 else min(2 * radius, LONGEST_STEP)
        # BFGS with the gradient of the Lagrangian, (18.13), where B stays positive definite
        change = there.gradient - here.gradient - (there.rows_by_x - here.rows_by_x).T @ multipliers
        Bd = B @ d
        if d @ change > 1e-3 * d @ Bd:
            B = B - np.outer(Bd, Bd) / (d @ Bd) + np.outer(change, change) / (d @ change)
        steps += 1
        if gained > 0:
            x = x + d
            here = there
    return x, here, steps


def elastic_step(here: Evaluation, B: Array, radius: float, penalty: float) -> tuple[Array, Array, float]:
    """Minimise ``g d + d B d / 2 + penalty t`` where ``rows + rows_by_x d >= -t`` and no element of d is over a radius.

    Returned are d (m,), the rows' multipliers (r,) and t, which (14) with both signs keeps from being negative.
    """
    largest = np.append(np.full(len(B), radius), np.inf)
    result = proxqp.dense.solve(
        H=np.pad(B / penalty, ((0, 1), (0, 1))),
        g=np.append(here.gradient / penalty, 1.0),
        C=np.column_stack((here.rows_by_x, np.ones(len(here.rows)))),
        l=-here.rows,
        l_box=-largest,
        u_box=largest,
        eps_abs=1e-12,  # rows over the penalty, and multipliers, are small numbers
        max_iter=60,  # where rows depend on one another it stalls at 1e-6 or so: good enough for a step
        initial_guess=proxqp.InitialGuess.NO_INITIAL_GUESS,  # its default takes more time, and leaves more
    )
    multipliers = penalty * np.maximum(-result.z[: len(here.rows)], 0)
    multipliers[:2] -= multipliers[:2].min()  # what (14) has with both signs is nothing
    d = result.x[:-1]
    return d, multipliers, -(here.rows + here.rows_by_x @ d).min()
