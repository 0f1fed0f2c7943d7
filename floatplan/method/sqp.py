"""Sequential quadratic programming whose steps exist whatever the constraints ask, by one elastic variable.

Numbers in parentheses are those of Nocedal and Wright, Numerical Optimization, second edition, chapter 18.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from proxsuite import proxqp

from floatplan.arrays import Array
from floatplan.method.program import Evaluation, Program

FEASIBLE = 1e-9  # [-] of a row's scale: largest violation at a solution
STATIONARY = 1e-9  # [-] of the objective: twice what a step promises at a solution
ROUNDING = 1e-12  # [-] of the merit: a change that means nothing
MOST_STEPS = 150
LONGEST_STEP = 0.2  # [rad] root mean square of p, for which linearised rows are trusted
SHORTEST_STEP = 1e-4  # [-] of the first that is tried
MEANINGLESS = 1e6  # [rad] of a whole step: rows that ask for so much do not depend on x
ARMIJO = 1e-4  # [-] of what a step promises: it has to bring so much
NEAR = 0.5  # [-] of its scale: a row that leaves more is not in a QP
WEIGHTS = (1e2, 1e4, 1e6)  # [-] of the elastic variable, in units of the QP: the first that suffices
QP_ACCURACY = 1e-9  # [-] of a QP's residuals
ACTIVE = 1e-6  # [-] of a row's multiplier, in units of the QP: with less it counts as inactive
QP_ITERATIONS = 100  # outer ones, and inner ones of each
LEAST_CURVATURE = 1e-12  # [-] of the Hessian's largest
DAMPING = 0.2  # [-] least curvature that an update leaves, (18.15)


class Solution(NamedTuple):
    """Where it ended: x (m,), the violation there, whether that is a minimum, and after how many steps."""

    x: Array
    violation: float
    converged: bool
    steps: int


def minimise(program: Program, x: Array) -> Solution:
    """Solve a program from x (m,); the merit of a point is its objective and the penalty times its violation."""
    here = program.evaluate(x)
    B = here.hessian + LEAST_CURVATURE * np.diagonal(here.hessian).max(initial=0.0) * np.eye(len(x))
    penalty = 0.0
    for steps in range(MOST_STEPS if len(x) else 0):
        d, violation_left, multipliers = elastic_step(here, B)
        curvature = float(d @ B @ d)
        if here.violation < FEASIBLE and curvature < STATIONARY * here.objective:
            return Solution(x, here.violation, True, steps)
        # A penalty by which the merit falls along the step, (18.36), and which makes it exact
        descent = -float(here.gradient @ d)
        mended = here.violation - violation_left
        penalty = max(penalty / 2, here.objective, 2 * (curvature / 2 - descent) / max(mended, FEASIBLE))
        if violation_left < FEASIBLE:
            penalty = max(penalty, float(multipliers.sum()))
        moved = line_search(program, x, here, d, multipliers, penalty, descent + penalty * mended)
        if moved is None:
            return Solution(x, here.violation, False, steps)
        following = program.evaluate(x + moved)
        change = following.gradient - here.gradient - (following.rows_by_x - here.rows_by_x).T @ multipliers
        B = damped_bfgs(B, moved, change)  # of the Lagrangian's gradient
        x = x + moved
        here = following
    return Solution(x, here.violation, False, MOST_STEPS)


def elastic_step(here: Evaluation, B: Array) -> tuple[Array, float, Array]:
    """Minimise ``g d + d B d / 2 + weight t`` where ``rows + rows_by_x d >= -t`` and ``t >= 0``.

    Returned are d (m,), the t that is left, none where the linearised rows can be met, and the rows' multipliers.
    ProxQP is given the problem in y, ``d = W y``, by which the Hessian is the identity.
    """
    near = np.flatnonzero(here.rows < NEAR)
    eigenvalues, eigenvectors = np.linalg.eigh(B)
    W = eigenvectors / np.sqrt(np.maximum(eigenvalues, LEAST_CURVATURE * eigenvalues[-1]))
    # The unit of y is as long as d without rows and d to (14)
    to_equality = np.linalg.lstsq(here.rows_by_x[:1] @ W, here.rows[:1])[0]
    unit = max(float(np.linalg.norm(W.T @ here.gradient) + np.linalg.norm(to_equality)), FEASIBLE)
    W = unit * W
    rows = np.column_stack((np.vstack((here.rows_by_x[near] @ W, np.zeros(len(B)))), np.ones(len(near) + 1)))
    low = np.append(-here.rows[near], 0.0)
    hessian = np.diag(np.append(np.ones(len(B)), 0.0))
    for weight in WEIGHTS:
        qp = proxqp.dense.QP(len(hessian), 0, len(rows))
        qp.settings.eps_abs = QP_ACCURACY
        qp.settings.max_iter = QP_ITERATIONS
        qp.settings.max_iter_in = QP_ITERATIONS
        gradient = np.append(W.T @ here.gradient / unit**2, weight)
        qp.init(hessian, gradient, None, None, rows, low, None)
        qp.solve()
        solution = np.array(qp.results.x)
        of_rows = np.maximum(-np.array(qp.results.z), 0)
        if solution[-1] < FEASIBLE:
            break
    # ProxQP says which rows are active; these as equations give the solution to its last digits, the same ones always
    active = np.flatnonzero(of_rows > ACTIVE)
    A = rows[active]
    equations = np.block([[hessian, -A.T], [A, np.zeros((len(active), len(active)))]])
    both = np.linalg.lstsq(equations, np.append(-gradient, low[active]), rcond=1e-14)[0]
    polished, of_active = np.split(both, [len(gradient)])
    if (rows @ polished - low).min() > -QP_ACCURACY and of_active.min(initial=0) >= 0:
        solution = polished
        of_rows = np.zeros(len(rows))
        of_rows[active] = of_active
    multipliers = np.zeros(len(here.rows))
    multipliers[near] = unit**2 * of_rows[:-1]
    multipliers[:2] -= multipliers[:2].min()  # what (14) has with both signs is nothing
    return W @ solution[:-1], max(float(solution[-1]), 0.0), multipliers


def line_search(
    program: Program, x: Array, here: Evaluation, d: Array, multipliers: Array, penalty: float, promised: float
) -> Array | None:
    """How far to go (m,) along d: the first of ever shorter steps that lowers the merit, None where none does.

    Each is tried also as corrected to second order, (18.42), by the shortest step to what active rows lack there.
    """
    size = float(np.linalg.norm(d))
    longest = min(1.0, LONGEST_STEP / max(size, FEASIBLE))
    length = longest
    near = multipliers > 0
    near[:2] = True  # (14)
    while promised > 0 and size < MEANINGLESS and length > SHORTEST_STEP * longest:
        enough = here.merit(penalty) * (1 + ROUNDING) - ARMIJO * length * promised
        step = length * d
        following = program.evaluate(x + step)
        if following.merit(penalty) <= enough:
            return step
        lacking = np.minimum(following.rows - here.rows - here.rows_by_x @ step, 0)
        short = near & (lacking < 0)
        corrected = step - np.linalg.lstsq(here.rows_by_x[short], lacking[short], rcond=1e-10)[0]
        if program.evaluate(x + corrected).merit(penalty) <= enough:
            return np.asarray(corrected)
        length /= 2
    return None


def damped_bfgs(B: Array, step: Array, change: Array) -> Array:
    """Update B (m, m) by how the Lagrangian's gradient changes along a step, (18.14) to (18.16)."""
    Bs = B @ step
    curvature = float(step @ Bs)
    share = 1.0
    if step @ change < DAMPING * curvature:
        share = (1 - DAMPING) * curvature / (curvature - float(step @ change))
    r = share * change + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curvature + np.outer(r, r) / float(step @ r))
