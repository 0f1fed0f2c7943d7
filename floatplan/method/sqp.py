"""Sequential quadratic programming (Nocedal and Wright, chapter 18), whose quadratic programs ProxQP solves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from proxsuite import proxqp

from floatplan.arrays import Array
from floatplan.method.program import Evaluation, Program

QP_ACCURACY = 1e-9  # of a QP's residuals, in the units of its rows
QP_ITERATIONS = 60  # outer, and inner ones of each; ProxQP's default of 10000 takes minutes where there is no solution
NEAR = 0.5  # [-] of its scale: a row that leaves more is not in a QP, whose step is not to change it by so much
LONGEST_STEP = 0.5  # [rad] root mean square of p, for which a linearisation is trusted
SHORTEST = 1e-4  # [-] of a step
FEASIBLE = 1e-9  # sum of violations, in rad and shares of limits, at a solution
STATIONARY = 1e-5  # [-] of the gradient, what is left of the Lagrangian's at a solution: its square, of the objective
LITTLE = 1e-3  # [rad] of a variable: the gradient counts as no less than what so much of one makes of it
MOST_STEPS = 100
ARMIJO = 1e-4  # [-] of the descent that a step promises: it has to make so much
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
        return np.asarray(at.gradient + at.missed_by_x.T @ self.of_equality - at.rows_by_x.T @ self.of_rows)


def minimise(program: Program, x: Array) -> Solution:
    """Solve a program from x (m,), by a line search on the l1 merit; its Hessian is, for (17), first the identity."""
    current = program.evaluate(x)
    squares = current.residuals_by_x.T @ current.residuals_by_x  # Gauss's and Newton's Hessian
    B = squares + 1e-6 * np.diagonal(squares).max(initial=0.0) * np.eye(len(x))
    penalty = 0.0
    for steps in range(MOST_STEPS if len(x) else 0):
        step = quadratic_step(current, B) or elastic_step(current, B)
        size = max(float(np.linalg.norm(current.gradient)), LITTLE * float(np.diagonal(B).max()))
        left = np.linalg.norm(B @ step.direction) / size
        if current.violation < FEASIBLE and left < STATIONARY:
            return Solution(x, current, True, steps)
        largest = np.abs(np.concatenate((step.of_equality, step.of_rows))).max()
        penalty = max(1.2 * float(largest), current.objective, penalty / 2)
        slope = float(current.gradient @ step.direction) - penalty * (current.violation - step.violation_left)
        merit = current.objective + penalty * current.violation
        taken = None
        for length, moved, following in tried_steps(program, x, current, step):
            enough = merit + ARMIJO * length * min(slope, 0.0) + 1e-13 * abs(merit)
            if following.objective + penalty * following.violation <= enough:
                taken = moved, following
                break
        if taken is None:
            return Solution(x, current, False, steps)
        moved, following = taken
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
    rows = (current.rows_by_x[near], -current.rows[near]) if len(near) else (None, None)
    qp.init(scale * B, scale * current.gradient, current.missed_by_x, -current.missed, *rows, None)
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
    direction: Array = np.zeros(len(B))
    for _ in range(PASSES):
        fails = current.rows + current.rows_by_x @ direction < 0
        J = np.vstack((current.missed_by_x, current.rows_by_x[fails]))
        lacking = np.concatenate((current.missed, current.rows[fails]))
        gradient = current.gradient + weight * J.T @ lacking
        direction = np.asarray(-np.linalg.solve(B + weight * J.T @ J, gradient), dtype=np.float64)
    rows = np.minimum(current.rows + current.rows_by_x @ direction, 0)
    missed = current.missed + current.missed_by_x @ direction
    return Step(direction, weight * missed, -weight * rows, float(np.abs(missed).sum() - rows.sum()))


def tried_steps(
    program: Program, x: Array, current: Evaluation, step: Step
) -> Iterator[tuple[float, Array, Evaluation]]:
    """Yield ever shorter steps: their length, how far they go (m,), and the program there.

    After a whole one, it corrected by the shortest step to the active constraints as they are there, (18.42).
    """
    in_rad = float(np.linalg.norm(np.linalg.solve(program.scale, step.direction)))
    first = min(1.0, LONGEST_STEP / max(in_rad, SHORTEST**2))
    length = first
    while length > SHORTEST * first and in_rad > SHORTEST**2:
        following = program.evaluate(x + length * step.direction)
        yield length, length * step.direction, following
        if length == 1:
            active = step.of_rows > 0
            J = np.vstack((current.missed_by_x, current.rows_by_x[active]))
            lacking = np.concatenate((following.missed, following.rows[active]))
            corrected = step.direction - np.linalg.lstsq(J, lacking, rcond=1e-10)[0]
            yield length, corrected, program.evaluate(x + corrected)
        length /= 2


def damped_bfgs(B: Array, step: Array, change: Array) -> Array:
    """Update B (m, m) by how the Lagrangian's gradient changes along a step, (18.14) to (18.16)."""
    Bs = B @ step
    curvature = float(step @ Bs)
    share = 1.0
    if step @ change < DAMPING * curvature:
        share = (1 - DAMPING) * curvature / (curvature - float(step @ change))
    r = share * change + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curvature + np.outer(r, r) / float(step @ r))
