"""Quadratic programs that searches have met, solved by the dual method.

The Hessians are those of a damped BFGS method, which stay positive definite; many are next to singular. Indefinite ones
are drawn in ``test_quadratic.py``.
"""

from __future__ import annotations

import numpy as np
from recorded_quadratics import RecordedQuadratic, recorded
from reduced_program import Step, dual_step
from scipy.optimize import linprog

PROGRAMS = recorded()
ROW_TOLERANCE = (
    2e-8  # [unit of the row] by which a constraint may be missed; of a Hessian next to singular that is most
)
STATIONARY = 2e-7  # [-] of what the terms of the Lagrangian's gradient sum up to
LONGEST = 1e3  # [-] of a step, in whitened variables: longer ones stand for rows that all but contradict one another
CONTRADICTION = 1e-6  # [unit of the row] that some constraint lacks at every point, where there is no solution


def solution(program: RecordedQuadratic) -> Step | None:
    return dual_step(program.evaluation, program.hessian)


def is_short(step: Step) -> bool:
    return float(np.abs(step.direction).max()) <= LONGEST


def least_violation(program: RecordedQuadratic, longest: float | None) -> float:
    """What the constraint that is missed most lacks, at the point within reach where that is least."""
    size, A, C = len(program.gradient), program.equality_rows, program.inequality_rows
    rows = np.concatenate((-C, A, -A))
    bounds = np.concatenate((program.inequality, -program.equality, program.equality))
    with_violation = np.column_stack((rows, -np.ones(len(rows))))
    limits = [(None if longest is None else -longest, longest)] * size
    found = linprog(np.eye(size + 1)[-1], A_ub=with_violation, b_ub=bounds, bounds=[*limits, (0, None)])
    assert found.status == 0
    return float(found.fun)


SOLVED = [(program, step) for program in PROGRAMS if (step := solution(program)) is not None]
SHORT = [(program, step) for program, step in SOLVED if is_short(step)]


def test_solutions_leave_no_residuals():
    """The conditions of Karush, Kuhn and Tucker, which a convex program's solution alone satisfies."""
    for program, (x, (y, z)) in SHORT:
        A, C = program.equality_rows, program.inequality_rows
        terms = (program.hessian @ x, program.gradient, y @ A, -z @ C)
        sizes = np.abs(program.hessian) @ np.abs(x) + np.abs(program.gradient) + np.abs(y) @ np.abs(A) + z @ np.abs(C)
        slack = program.inequality + C @ x
        assert np.abs(sum(terms)).max() <= STATIONARY * sizes.max()
        assert np.abs(program.equality + A @ x).max(initial=0) <= ROW_TOLERANCE
        assert slack.min(initial=0) >= -ROW_TOLERANCE
        assert z.min(initial=0) >= 0
        assert np.abs(slack * z).max(initial=0) <= ROW_TOLERANCE * (1 + z.max(initial=0))


def test_contradictory_rows_have_no_solution():
    for program in PROGRAMS:
        if solution(program) is None:
            assert least_violation(program, None) > CONTRADICTION
