"""Quadratic programs by the dual method."""

import numpy as np
import pytest
from recorded_quadratics import recorded
from reduced_program import Derivatives, Evaluation, dual_step
from scipy.optimize import linprog

ROW_TOLERANCE = 1e-8  # in its own unit, by which a row may be violated


def drawn(rng):
    """A linearised program and a Hessian; some have no solution."""
    size = int(rng.choice([1, 2, 3, 5, 8, 13, 48, 100]))
    equalities, count = int(rng.integers(0, min(size, 4))), int(rng.integers(0, 60))
    root = rng.normal(size=(size, size))
    scale = 10.0 ** rng.integers(-3, 8)
    point, rows = rng.normal(size=size), rng.normal(size=(count, size))
    inequality = np.abs(rng.normal(1, 1, count)) - rows @ point
    if count and rng.random() < 0.2:
        rows[-1], inequality[-1] = -rows[0], -inequality[0] - 1.0  # contradicts the first
    equality_rows = rng.normal(size=(equalities, size))
    derivatives = Derivatives(scale * rng.normal(size=size), equality_rows, rows)
    program = Evaluation(0.0, -equality_rows @ point, inequality, lambda: derivatives, None)
    return program, scale * (root @ root.T + 0.1 * np.eye(size))


@pytest.mark.parametrize("seed", range(8))
def test_solutions_are_optimal(seed):
    """By the conditions that a convex program's solution alone satisfies; some programs have none."""
    rng = np.random.default_rng(seed)
    solved = 0
    for _ in range(40):
        program, hessian = drawn(rng)
        found = dual_step(program, hessian)
        if found is None:
            continue
        solved += 1
        step, (equality, inequality) = found.direction, found.multipliers
        slack = program.inequality + program.inequality_jacobian @ step
        unbalanced = hessian @ step + program.gradient
        unbalanced += program.equality_jacobian.T @ equality - program.inequality_jacobian.T @ inequality
        assert np.abs(unbalanced).max() <= 1e-8 * (1 + np.abs(program.gradient).max())
        assert np.abs(program.equality + program.equality_jacobian @ step).max(initial=0) < 1e-8
        assert slack.min(initial=0) >= -2 * ROW_TOLERANCE
        assert inequality.min(initial=0) >= 0
        assert np.abs(slack[inequality > 0]).max(initial=0) < 1e-8
    assert solved > 10


def smooth(seed, deficit):
    """A program whose rows are a smooth function between bounds, at many instants; its Hessian is not definite."""
    rng = np.random.default_rng(seed)
    size, count = int(rng.integers(4, 15)), int(rng.integers(10, 200))
    root = rng.normal(size=(size, int(rng.integers(1, size))))  # as of an objective that not all variables change
    hessian = root @ root.T
    if deficit == "nearly singular":
        turned = np.linalg.qr(rng.normal(size=(size, size)))[0]
        hessian = turned @ np.diag(10.0 ** -np.linspace(0, 17, size)) @ turned.T
        hessian = (hessian + hessian.T) / 2
    if deficit == "indefinite":
        direction = rng.normal(size=size)
        hessian -= 1e-5 * np.diag(hessian).max() * np.outer(direction, direction) / (direction @ direction)
    values = np.polynomial.legendre.legvander(np.linspace(-1, 1, count), size - 1) * rng.normal(1, 0.3, size)
    rows, equality_rows, point = np.concatenate((values, -values)), rng.normal(size=(1, size)), rng.normal(size=size)
    room = np.abs(rng.normal(0.5, 0.5, len(rows)))
    gradient = 3 * rng.normal(size=size)
    derivatives = Derivatives(gradient, equality_rows, rows)
    return Evaluation(0.0, -equality_rows @ point, room - rows @ point, lambda: derivatives, None), hessian


@pytest.mark.parametrize(
    ("deficit", "unbalanced", "missed"),  # residuals: of the gradient's and the Hessian's part, and in the unit of rows
    [("singular", 1e-6, 1e-6), ("nearly singular", 1e-6, 2e-5), ("indefinite", 2e-4, 1e-6)],
)
def test_a_hessian_that_is_not_definite_leaves_no_residuals(deficit, unbalanced, missed):
    """Without a shift none of these would be solved to 1e-6; one that is indefinite has the solution of a near one."""
    for seed in range(100):
        program, hessian = smooth(seed, deficit)
        step = dual_step(program, hessian)
        x, multipliers = step.direction, step.multipliers
        stationary = hessian @ x + program.gradient + multipliers.equality @ program.equality_jacobian
        stationary -= multipliers.inequality @ program.inequality_jacobian
        largest = np.abs(program.gradient).max() + np.abs(hessian).max() * np.abs(x).max()
        left = program.inequality + program.inequality_jacobian @ x
        assert np.abs(stationary).max() < unbalanced * largest
        assert np.abs(program.equality + program.equality_jacobian @ x).max() < missed
        assert left.min() > -missed
        assert np.abs(left * multipliers.inequality).max() < missed


@pytest.mark.parametrize("rows", [np.ones((1, 4)) * [[1], [2]], np.zeros((1, 4))])
def test_equations_that_contradict_one_another_or_nothing_moves_have_no_step(rows):
    derivatives = Derivatives(np.ones(4), rows, np.empty((0, 4)))
    wanted = np.arange(1.0, len(rows) + 1) ** 2
    assert dual_step(Evaluation(0.0, wanted, np.empty(0), lambda: derivatives, None), np.eye(4)) is None


def test_programs_that_searches_have_met():
    """Of BFGS Hessians, many next to singular: solved, or so that no point within reach meets all rows.

    A step longer than 1e3, in whitened variables, stands for rows that all but contradict one another.
    """
    solved = 0
    for program in recorded():
        A, C = program.equality_rows, program.inequality_rows
        step = dual_step(program.evaluation, program.hessian)
        if step is None:
            rows = np.column_stack((np.concatenate((-C, A, -A)), -np.ones(len(C) + 2 * len(A))))
            bounds = np.concatenate((program.inequality, -program.equality, program.equality))
            free = [(None, None)] * len(program.gradient)
            least = linprog(np.eye(len(free) + 1)[-1], A_ub=rows, b_ub=bounds, bounds=[*free, (0, None)])
            assert (least.status, least.fun > 1e-6) == (0, True)
            continue
        x, (y, z) = step.direction, step.multipliers
        if np.abs(x).max() > 1e3:
            continue
        solved += 1
        terms = (program.hessian @ x, program.gradient, y @ A, -z @ C)
        sizes = np.abs(program.hessian) @ np.abs(x) + np.abs(program.gradient) + np.abs(y) @ np.abs(A) + z @ np.abs(C)
        slack = program.inequality + C @ x
        assert np.abs(sum(terms)).max() <= 2e-7 * sizes.max()
        assert np.abs(program.equality + A @ x).max(initial=0) <= 2 * ROW_TOLERANCE
        assert slack.min(initial=0) >= -2 * ROW_TOLERANCE
        assert z.min(initial=0) >= 0
        assert np.abs(slack * z).max(initial=0) <= 2 * ROW_TOLERANCE * (1 + z.max(initial=0))
    assert solved > 50
