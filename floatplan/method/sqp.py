"""Sequential quadratic programming in a trust region; an elastic variable gives each quadratic program a solution.

Numbers in parentheses are those of Nocedal and Wright, Numerical Optimization, second edition, chapter 18.
"""

from typing import NamedTuple

import numpy as np
from proxsuite import proxqp

from floatplan.arrays import Array
from floatplan.method.program import Evaluation, Program

FEASIBLE = 1e-9  # [-] of a row's scale: largest violation at a solution
STATIONARY = 1e-10  # [-] of the merit: what a step promises at a solution
MOST_STEPS = 150
LONGEST_STEP = 0.5  # [rad] root mean square of p, of each variable
SHORTEST_STEP = 1e-7  # [rad] where none longer lowers the merit, the search ends
LEAST_CURVATURE = 1e-12  # [-] of the Hessian's largest


class Solution(NamedTuple):
    """Where it ended: x (m,), objective and violation there, whether that is a minimum, and after how many steps."""

    x: Array
    objective: float
    violation: float
    converged: bool
    steps: int


def minimise(program: Program, x: Array, instants: Array) -> Solution:
    """Solve a program from x (m,), with inequalities at instants of [0, 1].

    The merit of a point is its objective and a penalty times its violation, (18.27).
    """
    here = program.evaluate(x, instants)
    B = here.hessian + LEAST_CURVATURE * np.diagonal(here.hessian).max(initial=0.0) * np.eye(len(x))
    radius = LONGEST_STEP
    penalty = max(here.objective, radius**2 * np.trace(B))
    steps = 0
    while steps < MOST_STEPS and radius > SHORTEST_STEP and len(x):
        d, multipliers, left = elastic_step(here, B, radius, penalty)
        if left > FEASIBLE and elastic_step(here, B, radius, 10 * penalty)[2] < 0.9 * left:
            penalty = 10 * penalty
            continue
        if left < FEASIBLE:
            penalty = max(here.objective, 2 * multipliers.sum())  # their sum already makes the merit exact
        promised = penalty * (here.violation - left) - here.gradient @ d - d @ B @ d / 2
        if promised < STATIONARY * here.merit(penalty):
            break
        there = program.evaluate(x + d, instants)
        if here.merit(penalty) - there.merit(penalty) < promised / 4:
            # Corrected to second order, (18.42), by what active rows, and (14), lack there
            lacking = there.rows - here.rows - here.rows_by_x @ d
            short = (lacking < 0) & ((multipliers > 0) | (np.arange(len(lacking)) < 2))
            d = d - np.linalg.lstsq(here.rows_by_x[short], lacking[short], rcond=1e-10)[0]
            there = program.evaluate(x + d, instants)
        gained = here.merit(penalty) - there.merit(penalty)
        if gained < promised / 4:
            radius = min(radius, np.abs(d).max()) / 4
        elif gained > promised * 3 / 4:
            radius = min(2 * radius, LONGEST_STEP)
        # BFGS with the gradient of the Lagrangian, (18.13), where B stays positive definite
        change = there.gradient - here.gradient - (there.rows_by_x - here.rows_by_x).T @ multipliers
        Bd = B @ d
        if d @ change > 1e-3 * d @ Bd:
            B = B - np.outer(Bd, Bd) / (d @ Bd) + np.outer(change, change) / (d @ change)
        steps += 1
        if gained > 0:
            x = x + d
            here = there
    is_minimum = here.violation < FEASIBLE and steps < MOST_STEPS
    return Solution(x, here.objective, here.violation, is_minimum, steps)


def elastic_step(here: Evaluation, B: Array, radius: float, penalty: float) -> tuple[Array, Array, float]:
    """Minimise ``g d + d B d / 2 + penalty t`` where ``rows + rows_by_x d >= -t``, ``t >= 0``, ``|d| <= radius``.

    Returned are d (m,), the rows' multipliers (r,) and t. ProxQP is given the problem in y, ``d = W y``, by which the
    Hessian is the identity and the penalty 1.
    """
    m = len(B)
    eigenvalues, eigenvectors = np.linalg.eigh(B)
    W = eigenvectors * np.sqrt(penalty / np.maximum(eigenvalues, LEAST_CURVATURE * eigenvalues[-1]))
    near = np.flatnonzero(here.rows < radius * np.abs(here.rows_by_x).sum(axis=1))  # others hold wherever d goes
    without_t = np.zeros((m, 1))
    rows = np.block([[here.rows_by_x[near] @ W, np.ones((len(near), 1))], [W / radius, without_t], [without_t.T, 1.0]])
    low = np.concatenate((-here.rows[near], -np.ones(m), [0.0]))
    high = np.concatenate((np.full(len(near), np.inf), np.ones(m), [np.inf]))
    gradient = np.append(W.T @ here.gradient / penalty, 1.0)
    qp = proxqp.dense.QP(m + 1, 0, len(rows))
    qp.settings.eps_abs = 1e-10
    qp.settings.max_iter = 60  # where rows depend on one another it stalls at 1e-6 or so: good enough for a step
    qp.init(np.diag(np.append(np.ones(m), 0.0)), gradient, None, None, rows, low, high)
    qp.solve()
    multipliers = np.zeros(len(here.rows))
    multipliers[near] = penalty * np.maximum(-qp.results.z[: len(near)], 0)
    multipliers[:2] -= multipliers[:2].min()  # what (14) has with both signs is nothing
    d = W @ qp.results.x[:-1]
    return d, multipliers, max(0.0, -(here.rows + here.rows_by_x @ d).min())
