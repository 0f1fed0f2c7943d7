"""Sequential quadratic programming (Nocedal and Wright, chapter 18); ProxQP solves the quadratic programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from floatplan.arrays import Array
from floatplan.method.program import Evaluation
from floatplan.proxqp import proxqp

QP_ACCURACY = 1e-10  # of a QP's residuals, in the units of its rows
QP_ITERATIONS = 60  # outer and inner each; at ProxQP's default of 10000 an infeasible QP can take minutes
FEASIBLE = 1e-10  # sum of violations, rad or in shares of limits, at a solution
STATIONARY = 1e-7  # [-] of the gradient's length, what is left of the Lagrangian's at a solution
MOST_STEPS = 200  # of an SQP
ARMIJO = 1e-4  # [-] of the descent that a step promises, which it has to make
SHORTEST = 1e-6  # [-] of a QP's step
DAMPING = 0.2  # [-] of Powell's BFGS (18.15): least curvature that an update leaves
ELASTIC_PENALTY = 1e3  # [-] of the largest gradient and multiplier: what relaxing all rows at once costs


class Step(NamedTuple):
    """Solution of a QP: the step (m,), multipliers of equality (1,) and rows (r,) >= 0, and how far it is relaxed."""

    direction: Array
    equality_multipliers: Array
    row_multipliers: Array
    relaxed: float = 0.0


@dataclass(frozen=True, eq=False)
class Solution:
    """Where an SQP ended: the point, the program there, the Hessian of its Lagrangian, and how it came there."""

    x: Array
    evaluation: Evaluation
    hessian: Array
    converged: bool
    steps: int
    evaluations: int


class Evaluated(Protocol):
    """A program of m variables."""

    def evaluate(self, x: Array) -> Evaluation:
        """Values and derivatives at x (m,)."""

    def step_size(self, step: Array) -> float:
        """Length of a step (m,), at most 1 of which the program's linearisation is to be trusted."""


def minimise(program: Evaluated, x: Array, hessian: Array | None = None) -> Solution:
    """Solve a program from x (m,), with a line search on the l1 merit function.

    The Hessian begins as that of Gauss and Newton, which for (17) is the identity, and is updated by damped BFGS.
    """
    current = program.evaluate(x)
    B = gauss_newton(current) if hessian is None else hessian
    penalty = 0.0
    steps = 0
    evaluations = 1
    converged = False
    while len(x) and steps < MOST_STEPS:
        steps += 1
        step = solve_qp(current, B) or solve_elastic_qp(current, B)
        if step is None:
            break
        multipliers = np.concatenate((step.equality_multipliers, step.row_multipliers))
        slope = lagrangian_gradient(current, step)
        if not step.relaxed and current.violation < FEASIBLE and is_stationary(current, step, B):
            converged = True
            break
        penalty = max(penalty / 2, 1.5 * float(np.abs(multipliers).max(initial=0.0)))
        length, candidate, more = line_search(program, x, current, step, penalty)
        evaluations += more
        if candidate is None:
            break
        x = x + length * step.direction
        change = lagrangian_gradient(candidate, step) - slope
        B = damped_bfgs(B, length * step.direction, change)
        current = candidate
    return Solution(x, current, B, converged, steps, evaluations)


def gauss_newton(current: Evaluation) -> Array:
    """J^T J (m, m) of the residuals, shifted where a variable has no residual."""
    J = current.residuals_jacobian
    squares = J.T @ J
    return squares + 1e-6 * np.diagonal(squares).max() * np.eye(len(squares))


def lagrangian_gradient(current: Evaluation, step: Step) -> Array:
    """Gradient (m,) of the Lagrangian with the multipliers of a step."""
    of_equality = current.missed_jacobian.T @ step.equality_multipliers
    return current.gradient + of_equality - current.rows_jacobian.T @ step.row_multipliers


def is_stationary(current: Evaluation, step: Step, B: Array) -> bool:
    """Whether the step of a QP promises nothing more: in the norm of B it is short against the gradient."""
    left = float(np.linalg.norm(B @ step.direction))
    return left <= STATIONARY * max(float(np.linalg.norm(current.gradient)), 1e-12)


def solve_qp(current: Evaluation, B: Array) -> Step | None:
    """Minimise ``g d + d B d / 2`` subject to the linearised constraints; None where ProxQP finds no solution."""
    solved = proxqp_solution(
        B, current.gradient, current.missed_jacobian, -current.missed, current.rows_jacobian, -current.rows
    )
    return None if solved is None else Step(*solved)


def solve_elastic_qp(current: Evaluation, B: Array) -> Step | None:
    """Minimise the same where the constraints are met but for a share t of [0, 1] of what they lack (Powell).

    Relaxed by t = 1, the QP has the solution d = 0. None where ProxQP does not come near enough to a solution.
    """
    size = len(B)
    weight = ELASTIC_PENALTY * max(1.0, float(np.abs(current.gradient).max()))
    hessian = np.zeros((size + 1, size + 1))
    hessian[:size, :size] = B
    hessian[size, size] = weight
    gradient = np.append(current.gradient, weight)
    equality = np.column_stack((current.missed_jacobian, -current.missed))
    of_rows = np.column_stack((current.rows_jacobian, -np.minimum(current.rows, 0)))
    of_t = np.zeros((2, size + 1))
    of_t[:, size] = 1, -1
    lower = np.concatenate((-current.rows, [0.0, -1.0]))
    solved = proxqp_solution(hessian, gradient, equality, -current.missed, np.vstack((of_rows, of_t)), lower)
    if solved is None:
        return None
    direction, equality_multipliers, row_multipliers = solved
    return Step(direction[:size], equality_multipliers, row_multipliers[:-2], float(direction[size]))


def proxqp_solution(
    B: Array, g: Array, A: Array, b: Array, C: Array, lower: Array
) -> tuple[Array, Array, Array] | None:
    """Minimise ``g d + d B d / 2`` where ``A d = b`` and ``C d >= lower``: d, and multipliers of both; None if it fails.

    At the solution ``B d + g + A^T y - C^T z = 0``.
    """
    scale = 1 / max(float(np.abs(g).max()), float(np.abs(B).max()), 1e-12)  # of the objective, for ProxQP's tolerances
    qp = proxqp.dense.QP(len(g), len(b), len(lower))
    qp.settings.eps_abs = QP_ACCURACY
    qp.settings.max_iter = QP_ITERATIONS
    qp.settings.max_iter_in = QP_ITERATIONS
    of_rows = (C, lower) if len(lower) else (None, None)
    qp.init(scale * B, scale * g, A, b, *of_rows, None)
    qp.solve()
    results = qp.results
    if results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED or not np.isfinite(results.x).all():
        return None
    return np.array(results.x), np.array(results.y) / scale, np.maximum(-np.array(results.z), 0) / scale


def line_search(
    program: Evaluated, x: Array, current: Evaluation, step: Step, penalty: float
) -> tuple[float, Evaluation | None, int]:
    """Length of the step, the program after it (None where no length makes the merit less), and evaluations."""
    lacking = (1 - step.relaxed) * current.violation
    promised = float(current.gradient @ step.direction) - penalty * lacking
    length = min(1.0, 1 / max(program.step_size(step.direction), 1e-300))
    evaluations = 0
    merit = current.objective + penalty * current.violation
    while length > SHORTEST:
        candidate = program.evaluate(x + length * step.direction)
        evaluations += 1
        allowed = merit + ARMIJO * length * min(promised, 0.0) + 1e-14 * abs(merit)
        if candidate.objective + penalty * candidate.violation <= allowed:
            return length, candidate, evaluations
        length /= 2
    return 0.0, None, evaluations


def damped_bfgs(B: Array, step: Array, change: Array) -> Array:
    """Update B by the change (m,) of the Lagrangian's gradient along a step: Powell's, (18.14) to (18.16)."""
    Bs = B @ step
    curvature = float(step @ Bs)
    share = 1.0
    if step @ change < DAMPING * curvature:
        share = (1 - DAMPING) * curvature / (curvature - float(step @ change))
    r = share * change + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curvature + np.outer(r, r) / float(step @ r))
