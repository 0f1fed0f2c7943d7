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
FIRST_DAMPING = 1e-2  # [-] of squared steps, in rad of p
LARGEST_DAMPING = 1e6  # [-] beyond which nothing is gained
ARMIJO = 1e-4  # [-] of the descent that a step promises: it has to make so much
SHORTEST = 1e-5  # [-] of a step
DAMPING = 0.2  # [-] least curvature that an update leaves, (18.15)
ELASTIC = 1e3  # [-] of the Hessian's largest diagonal entry: what the square of a violation costs in an elastic step
PASSES = 20  # of an elastic step, each with the rows that fail after the one before


@dataclass(frozen=True, eq=False)
class Solution:
    """Where it ended: x (m,), the program there, the Lagrangian's Hessian (m, m), and how it came there."""

    x: Array
    evaluation: Evaluation
    hessian: Array
    converged: bool
    steps: int


@dataclass(frozen=True, eq=False)
class Step:
    """A direction (m,), the multipliers of (14) and of the rows, and the violation that it leaves, linearised."""

    direction: Array
    of_equality: Array
    of_rows: Array
    violation_left: float = 0.0

    @property
    def largest_multiplier(self) -> float:
        """Below which the penalty of an l1 merit must not be."""
        return float(max(np.abs(self.of_equality).max(), self.of_rows.max(initial=0.0)))

    def lagrangian_gradient(self, current: Evaluation) -> Array:
        """Gradient (m,) of the objective, less the constraints by their multipliers."""
        constraints = current.missed_J.T @ self.of_equality - current.rows_J.T @ self.of_rows
        return np.asarray(current.gradient + constraints)


def minimise(program: Program, x: Array, hessian: Array | None = None) -> Solution:
    """Solve a program from x (m,); its Hessian begins as Gauss's and Newton's, for (17) the identity."""
    current = program.evaluate(x)
    B = gauss_newton(current) if hessian is None else hessian
    penalty = 0.0
    for steps in range(MOST_STEPS if len(x) else 0):
        step = quadratic_step(current, B) or elastic_step(current, B)
        left = float(np.linalg.norm(B @ step.direction)) / max(float(np.linalg.norm(current.gradient)), 1e-9)
        if current.violation < FEASIBLE and left < STATIONARY:
            return Solution(x, current, B, True, steps)
        penalty = max(1.2 * step.largest_multiplier, penalty / 2)
        taken = line_search(program, x, current, step, penalty)
        if taken is None:
            return Solution(x, current, B, False, steps)
        moved, following = taken
        B = damped_bfgs(B, moved, step.lagrangian_gradient(following) - step.lagrangian_gradient(current))
        x = x + moved
        current = following
    return Solution(x, current, B, not len(x), MOST_STEPS)


def reduce_violations(program: Program, x: Array) -> Array:
    """The motion (m,) near x that violates least, whatever its objective: Levenberg and Marquardt, section 10.3."""
    current = program.evaluate(x)
    damping = FIRST_DAMPING
    for _ in range(MOST_STEPS):
        fails = current.rows < 0
        lacking = np.concatenate((current.missed, current.rows[fails]))
        J = np.vstack((current.missed_J, current.rows_J[fails])) @ program.scale
        if current.violation < FEASIBLE or damping > LARGEST_DAMPING:
            break
        step = -program.scale @ np.linalg.solve(J.T @ J + damping * np.eye(len(x)), J.T @ lacking)
        following = program.evaluate(x + step)
        gains = following.squared_violation < current.squared_violation
        damping *= 0.25 if gains else 4.0
        if gains:
            x = x + step
            current = following
    return x


def gauss_newton(current: Evaluation) -> Array:
    """J^T J (m, m) of the residuals, a little more where a variable has none."""
    squares = current.residuals_J.T @ current.residuals_J
    return np.asarray(squares + 1e-6 * np.diagonal(squares).max() * np.eye(len(squares)))


def quadratic_step(current: Evaluation, B: Array) -> Step | None:
    """Minimise ``g d + d B d / 2`` where the linearised constraints hold; None where ProxQP finds no solution."""
    g = current.gradient
    near = np.flatnonzero(current.rows < NEAR)
    scale = 1 / max(float(np.abs(g).max()), 1.0)  # of the objective, whose residuals ProxQP bounds too
    qp = proxqp.dense.QP(len(g), len(current.missed), len(near))
    qp.settings.eps_abs = QP_ACCURACY
    qp.settings.max_iter = QP_ITERATIONS
    qp.settings.max_iter_in = QP_ITERATIONS
    bounds = (current.rows_J[near], -current.rows[near]) if len(near) else (None, None)
    qp.init(scale * B, scale * g, current.missed_J, -current.missed, *bounds, None)
    qp.solve()
    results = qp.results
    if results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED or not np.isfinite(results.x).all():
        return None
    of_rows = np.zeros(len(current.rows))
    of_rows[near] = np.maximum(-np.array(results.z), 0) / scale
    return Step(np.array(results.x), np.array(results.y) / scale, of_rows)


def elastic_step(current: Evaluation, B: Array) -> Step:
    """Minimise the same and the squares of what linearised constraints lack: where they contradict, all give a little."""
    weight = ELASTIC * float(np.diagonal(B).max())
    direction = np.zeros(len(B))
    for _ in range(PASSES):
        fails = current.rows + current.rows_J @ direction < 0
        J = np.vstack((current.missed_J, current.rows_J[fails]))
        lacking = np.concatenate((current.missed, current.rows[fails]))
        direction = -np.linalg.solve(B + weight * J.T @ J, current.gradient + weight * J.T @ lacking)
        rows = current.rows + current.rows_J @ direction
        if ((rows < 0) == fails).all():
            break
    missed = current.missed + current.missed_J @ direction
    left = float(np.abs(missed).sum() - np.minimum(rows, 0).sum())
    return Step(direction, weight * missed, weight * np.maximum(-rows, 0), left)


def line_search(
    program: Program, x: Array, current: Evaluation, step: Step, penalty: float
) -> tuple[Array, Evaluation] | None:
    """How far to go (m,) by a step, and the program there; None where nothing makes the l1 merit less."""
    slope = float(current.gradient @ step.direction) - penalty * (current.violation - step.violation_left)
    merit = current.objective + penalty * current.violation
    length = min(1.0, 1 / max(program.step_size(step.direction), 1e-12))
    moved = step.direction if length == 1 else length * step.direction
    while length > SHORTEST:
        following = program.evaluate(x + moved)
        allowed = merit + ARMIJO * length * min(slope, 0.0) + 1e-13 * abs(merit)
        if following.objective + penalty * following.violation <= allowed:
            return moved, following
        if length == 1 and moved is step.direction:
            moved = second_order(current, following, step)
        else:
            length /= 2
            moved = length * step.direction
    return None


def second_order(current: Evaluation, following: Evaluation, step: Step) -> Array:
    """A whole step (m,), corrected by the shortest one to the active constraints as they are there, (18.42)."""
    active = step.of_rows > 0
    J = np.vstack((current.missed_J, current.rows_J[active]))
    lacking = np.concatenate((following.missed, following.rows[active]))
    return np.asarray(step.direction - np.linalg.lstsq(J, lacking, rcond=1e-10)[0])


def damped_bfgs(B: Array, step: Array, change: Array) -> Array:
    """Update B (m, m) by how the Lagrangian's gradient changes along a step, (18.14) to (18.16)."""
    Bs = B @ step
    curvature = float(step @ Bs)
    share = 1.0
    if step @ change < DAMPING * curvature:
        share = (1 - DAMPING) * curvature / (curvature - float(step @ change))
    r = share * change + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curvature + np.outer(r, r) / float(step @ r))
