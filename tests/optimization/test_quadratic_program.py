"""QPs with inequalities, and the linear systems beside them."""

from __future__ import annotations

import numpy as np
import pytest

from floatplan.compiled.quadratic import dual_step
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.optimization import programs
from floatplan.optimization.programs import Derivatives, Evaluation, Step, elastic_qp, solve_qp, solved

SIZE, EQUALITIES, INEQUALITIES = 7, 2, 60
NO_ROWS = np.empty(0, dtype=np.int64)


def linearised(gradient, equality, equality_rows, inequality, inequality_rows) -> Evaluation[None]:
    derivatives = Derivatives(gradient, equality_rows, inequality_rows)
    return Evaluation(0.0, equality, inequality, lambda: derivatives, None)


def drawn(seed: int, touched: bool = False) -> tuple[Evaluation[None], np.ndarray]:
    """A program with a point that keeps all rows, many of them just so where it is ``touched``; and a Hessian."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(SIZE, SIZE))
    point = rng.normal(size=SIZE)
    equality_rows, rows = rng.normal(size=(EQUALITIES, SIZE)), rng.normal(size=(INEQUALITIES, SIZE))
    room = rng.normal(1, 1, INEQUALITIES)
    room = np.maximum(room, 0) if touched else np.abs(room)
    program = linearised(10 * rng.normal(size=SIZE), -equality_rows @ point, equality_rows, room - rows @ point, rows)
    return program, root @ root.T + 0.1 * np.eye(SIZE)


def is_solution(step: Step, program: Evaluation[None], hessian: np.ndarray) -> bool:
    """Whether the step satisfies the conditions of optimality, which is sufficient: the QP is convex."""
    multipliers = step.multipliers
    stationary = hessian @ step.direction + program.gradient
    stationary += multipliers.equality @ program.equality_jacobian
    stationary -= multipliers.inequality @ program.inequality_jacobian
    left = program.inequality + program.inequality_jacobian @ step.direction
    return bool(
        not step.elastic
        and np.abs(stationary).max() < 1e-7
        and np.abs(program.equality + program.equality_jacobian @ step.direction).max() < 1e-7
        and left.min(initial=0) > -1e-7
        and multipliers.inequality.min(initial=0) >= 0
        and np.abs(left * multipliers.inequality).max(initial=0) < 1e-6
    )


@pytest.fixture
def without_proxqp(monkeypatch):
    monkeypatch.setattr(programs, "_proxqp", raising)


class TestQP:
    @pytest.mark.parametrize("touched", [False, True])
    @pytest.mark.parametrize("seed", range(20))
    def test_is_solved_from_any_active_rows(self, seed, touched):
        program, hessian = drawn(seed, touched)
        rng = np.random.default_rng(seed)
        for count in (0, 1, 3, SIZE, SIZE + 1, INEQUALITIES):
            active = np.sort(rng.choice(INEQUALITIES, count, replace=False))
            assert is_solution(solve_qp(program, hessian, active, 1e3, dual_step), program, hessian)

    @pytest.mark.parametrize("touched", [False, True])
    @pytest.mark.usefixtures("without_proxqp")
    def test_the_dual_method_needs_no_other(self, touched):
        for seed in range(40):
            program, hessian = drawn(seed, touched)
            assert is_solution(solve_qp(program, hessian, NO_ROWS, 1e3, dual_step), program, hessian)

    def test_the_dual_method_and_proxqp_agree(self):
        for seed in range(40):
            program, hessian = drawn(seed)
            by_proxqp, step = solve_qp(program, hessian, NO_ROWS, 1e3), dual_step(program, hessian)
            assert step is not None
            assert step.direction == pytest.approx(by_proxqp.direction, abs=1e-6)

    def test_rows_that_say_the_same_twice_are_no_obstacle(self):
        program, hessian = drawn(3)
        active = np.flatnonzero(solve_qp(program, hessian, NO_ROWS, 1e3).multipliers.inequality > 1e-6)
        assert active.size
        rows = np.concatenate((program.inequality_jacobian, program.inequality_jacobian[active]))
        values = np.concatenate((program.inequality, program.inequality[active]))
        twice = linearised(program.gradient, program.equality, program.equality_jacobian, values, rows)
        both = np.concatenate((active, INEQUALITIES + np.arange(active.size)))
        assert is_solution(solve_qp(twice, hessian, both, 1e3, dual_step), twice, hessian)

    @pytest.mark.usefixtures("without_proxqp")
    def test_without_inequalities_is_a_linear_system(self):
        program, hessian = drawn(0)
        alone = linearised(
            program.gradient, program.equality, program.equality_jacobian, np.empty(0), np.empty((0, SIZE))
        )
        assert is_solution(solve_qp(alone, hessian, NO_ROWS, 1e3, dual_step), alone, hessian)

    def test_that_nothing_solves_is_elastic(self):
        program, hessian = drawn(0)
        rows = np.concatenate((program.inequality_jacobian[:1], -program.inequality_jacobian[:1]))
        contradictory = linearised(program.gradient, program.equality, program.equality_jacobian, -np.ones(2), rows)
        step = solve_qp(contradictory, hessian, NO_ROWS, 1e3)
        assert step.elastic
        assert step.violation_left == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("penalty", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("size", [3, 20])
def test_elastic_steps_are_the_least_of_their_program(size, penalty):
    """Where the gradient of a convex function vanishes, quadratic piece by piece: whole steps go round in circles."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        root, count = rng.normal(size=(size, size)), int(rng.integers(1, 120))
        hessian, rows, equality_rows = root @ root.T + 0.1 * np.eye(size), rng.normal(size=(count, size)), root[:1]
        values, gradient = rng.normal(-0.5, 1, count), 10 * rng.normal(size=size)
        step = elastic_qp(linearised(gradient, np.ones(1), equality_rows, values, rows), hessian, penalty)
        left = values + rows @ step.direction
        pulls = penalty * np.minimum(left, 0), penalty * (1 + equality_rows @ step.direction)
        unbalanced = gradient + hessian @ step.direction + rows.T @ pulls[0] + equality_rows.T @ pulls[1]
        size_of_parts = np.abs(gradient).max() + (np.abs(rows.T) @ -pulls[0]).max()
        regular = EXCHANGE.regularisation * penalty * (1 + np.abs(step.direction).max())
        assert np.abs(unbalanced).max() < 1e-6 * size_of_parts + 10 * regular
        assert step.multipliers.inequality == pytest.approx(-pulls[0])
        assert step.violation_left == pytest.approx((abs(pulls[1][0]) - pulls[0].sum()) / penalty)


@pytest.mark.parametrize("rows", [np.ones((1, SIZE)) * [[1], [2]], np.zeros((1, SIZE))])
def test_equations_that_contradict_one_another_or_nothing_moves_make_an_elastic_step(rows):
    program, hessian = drawn(0)
    wanted = np.arange(1.0, len(rows) + 1) ** 2
    alone = linearised(program.gradient, wanted, rows, np.empty(0), np.empty((0, SIZE)))
    step = solve_qp(alone, hessian, NO_ROWS, 1e3, dual_step)
    assert step.elastic
    least = np.abs(wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0]).sum()
    assert step.violation_left == pytest.approx(least, rel=0.05)


def test_a_regular_system_is_solved():
    assert solved(np.diag([2.0, 4.0]), np.ones(2)) == pytest.approx([0.5, 0.25])


def test_a_singular_one_has_the_solution_of_least_norm():
    assert solved(np.ones((2, 2)), np.full(2, 2.0)) == pytest.approx([1, 1])


def test_one_without_numbers_moves_nothing(monkeypatch):
    monkeypatch.setattr(np.linalg, "solve", raising)
    monkeypatch.setattr(np.linalg, "lstsq", raising)
    assert solved(np.eye(2), np.ones(2)).tolist() == [0, 0]


def raising(*arguments, **options):
    raise np.linalg.LinAlgError


def smooth(seed: int, deficit: str) -> tuple[Evaluation[None], np.ndarray]:
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
    return linearised(gradient, -equality_rows @ point, equality_rows, room - rows @ point, rows), hessian


@pytest.mark.parametrize(
    ("deficit", "unbalanced", "missed"),  # residuals: of the gradient's and the Hessian's part, and in the unit of rows
    [("singular", 1e-6, 1e-6), ("nearly singular", 1e-6, 2e-5), ("indefinite", 2e-4, 1e-6)],
)
def test_a_hessian_that_is_not_definite_leaves_no_residuals(deficit, unbalanced, missed):
    """Without a shift none of these would be solved to 1e-6; one that is indefinite has the solution of a near one."""
    for seed in range(100):
        program, hessian = smooth(seed, deficit)
        step = dual_step(program, hessian)
        assert step is not None
        x, multipliers = step.direction, step.multipliers
        stationary = hessian @ x + program.gradient + multipliers.equality @ program.equality_jacobian
        stationary -= multipliers.inequality @ program.inequality_jacobian
        largest = np.abs(program.gradient).max() + np.abs(hessian).max() * np.abs(x).max()
        left = program.inequality + program.inequality_jacobian @ x
        assert np.abs(stationary).max() < unbalanced * largest
        assert np.abs(program.equality + program.equality_jacobian @ x).max() < missed
        assert left.min() > -missed
        assert np.abs(left * multipliers.inequality).max() < missed


def test_a_hessian_that_is_far_from_definite_is_left_to_others():
    program, hessian = drawn(0)
    assert dual_step(program, hessian - 2 * np.diag(hessian).max() * np.eye(SIZE)) is None
    assert dual_step(program, np.zeros((SIZE, SIZE))) is None
