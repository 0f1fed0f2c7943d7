"""Sequential quadratic programming (Nocedal and Wright, chapter 18), whose quadratic programs ProxQP solves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.method.program import Evaluation, Program
from floatplan.proxqp import proxqp

QP_ACCURACY = 1e-10  # of a QP's residuals, in the units of its rows
QP_ITERATIONS = 30  # outer, and inner ones of each; ProxQP's default of 10000 takes minutes where there is no solution
NEAR = 0.5  # [-] of its scale: a row that leaves more is not in a QP, whose step is not to change it by so much
FEASIBLE = 1e-9  # sum of violations, in rad and shares of limits, at a solution
STATIONARY = 1e-5  # [-] of the gradient, what is left of the Lagrangian's at a solution: its square, of the objective
MOST_STEPS = 100
ARMIJO = 1e-4  # [-] of the descent that a step promises: it has to make so much
SHORTEST = 1e-5  # [-] of a step
DAMPING = 0.2  # [-] least curvature that an update leaves, (18.15)
ELASTIC = 1e3  # [-] of the Hessian's largest diagonal entry: what the square of a violation costs in an elastic step
PASSES = 20  # of an elastic step, each with the rows that fail after the one before


@dataclass(frozen=True, eq=False)
class Solution:
    """Where it ended: x (m,), the program there, whether that is a minimum, and after how many steps."""

    x: Array
    evaluation: Evaluation
    converged: bool
    steps: int


@dataclass(frozen=True, eq=False)
class Step:
    """A direction (m,), the multipliers of (14) and of the rows, and the violation that it leaves, linearised."""

    direction: Array
    of_equality: Array
    of_rows: Array
    violation_left: float = 0.0

    def lagrangian_gradient(self, at: Evaluation) -> Array:
        """Gradient (m,) of the objective, less the constraints by their multipliers."""
        return np.asarray(at.gradient + at.missed_J.T @ self.of_equality - at.rows_J.T @ self.of_rows)


def minimise(program: Program, x: Array) -> Solution:
    """Solve a program from x (m,), by a line search on the l1 merit; its Hessian is, for (17), first the identity."""
    current = program.evaluate(x)
    squares = current.residuals_J.T @ current.residuals_J  # Gauss's and Newton's Hessian
    B = squares + 1e-6 * np.diagonal(squares).max(initial=0.0) * np.eye(len(x))
    penalty = 0.0
    for steps in range(MOST_STEPS if len(x) else 0):
        step = quadratic_step(current, B) or elastic_step(current, B)
        left = np.linalg.norm(B @ step.direction) / max(float(np.linalg.norm(current.gradient)), 1e-9)
        if current.violation < FEASIBLE and left < STATIONARY:
            return Solution(x, current, True, steps)
        if program.step_size(step.direction) < SHORTEST**2:
            return Solution(x, current, False, steps)  # where no step promises less violation
        largest = max(float(np.abs(step.of_equality).max()), float(step.of_rows.max(initial=0.0)))
        penalty = max(1.2 * largest, penalty / 2)
        moved, following = line_search(program, x, current, step, penalty)
        if following is None:
            return Solution(x, current, False, steps)
        B = damped_bfgs(B, moved, step.lagrangian_gradient(following) - step.lagrangian_gradient(current))
        x = x + moved
        current = following
    return Solution(x, current, False, MOST_STEPS)


def quadratic_step(current: Evaluation, B: Array) -> Step | None:
    """Minimise ``g d + d B d / 2`` where the linearised constraints hold; None where ProxQP finds no solution."""
    near = np.flatnonzero(current.rows < NEAR)
    scale = 1 / max(float(np.abs(current.gradient).max()), 1.0)  # of the objective, whose residuals ProxQP bounds too
    qp = proxqp.dense.QP(len(B), len(current.missed), len(near))
    qp.settings.eps_abs = QP_ACCURACY
    qp.settings.max_iter = QP_ITERATIONS
    qp.settings.max_iter_in = QP_ITERATIONS
    rows = (current.rows_J[near], -current.rows[near]) if len(near) else (None, None)
    qp.init(scale * B, scale * current.gradient, current.missed_J, -current.missed, *rows, None)
    qp.solve()
    results = qp.results
    if results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED or not np.isfinite(results.x).all():
        return None
    of_rows = np.zeros(len(current.rows))
    of_rows[near] = np.maximum(-np.array(results.z), 0) / scale
    return Step(np.array(results.x), np.array(results.y) / scale, of_rows)


def elastic_step(current: Evaluation, B: Array) -> Step:
    """Minimise that and the squares of what linearised constraints lack: where they contradict, all give a little."""
    weight = ELASTIC * float(np.diagonal(B).max())
    direction = np.zeros(len(B))
    for _ in range(PASSES):
        fails = current.rows + current.rows_J @ direction < 0
        J = np.vstack((current.missed_J, current.rows_J[fails]))
        lacking = np.concatenate((current.missed, current.rows[fails]))
        direction = -np.linalg.solve(B + weight * J.T @ J, current.gradient + weight * J.T @ lacking)
    rows = np.minimum(current.rows + current.rows_J @ direction, 0)
    missed = current.missed + current.missed_J @ direction
    return Step(direction, weight * missed, -weight * rows, float(np.abs(missed).sum() - rows.sum()))


def line_search(
    program: Program, x: Array, current: Evaluation, step: Step, penalty: float
) -> tuple[Array, Evaluation | None]:
    """How far to go (m,) by a step, and the program there; None where nothing makes the l1 merit less.

    A whole step that does not is corrected by the shortest one to the active constraints as they are there, (18.42).
    """
    slope = float(current.gradient @ step.direction) - penalty * (current.violation - step.violation_left)
    merit = current.objective + penalty * current.violation
    length = min(1.0, 1 / max(program.step_size(step.direction), 1e-12))
    corrected = length < 1
    moved = length * step.direction
    while length > SHORTEST:
        following = program.evaluate(x + moved)
        allowed = merit + ARMIJO * length * min(slope, 0.0) + 1e-13 * abs(merit)
        if following.objective + penalty * following.violation <= allowed:
            return moved, following
        if not corrected:
            corrected = True
            active = step.of_rows > 0
            J = np.vstack((current.missed_J, current.rows_J[active]))
            lacking = np.concatenate((following.missed, following.rows[active]))
            moved = step.direction - np.linalg.lstsq(J, lacking, rcond=1e-10)[0]
        else:
            length /= 2
            moved = length * step.direction
    return moved, None


def damped_bfgs(B: Array, step: Array, change: Array) -> Array:
    """Update B (m, m) by how the Lagrangian's gradient changes along a step, (18.14) to (18.16)."""
    Bs = B @ step
    curvature = float(step @ Bs)
    share = 1.0
    if step @ change < DAMPING * curvature:
        share = (1 - DAMPING) * curvature / (curvature - float(step @ change))
    r = share * change + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curvature + np.outer(r, r) / float(step @ r))
