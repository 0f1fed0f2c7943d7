"""The compiled changes of active rows against the Python."""

from __future__ import annotations

import numpy as np
import pytest

from floatplan.kernel import quadratic
from floatplan.kernel.library import kernel
from floatplan.kernel.quadratic import step_by_active_rows
from floatplan.optimization.nonlinear_program import Derivatives, Evaluation
from floatplan.optimization.quadratic_program import by_changes_of_active_rows

pytestmark = pytest.mark.skipif(kernel() is None, reason="no compiled kernel")


def drawn(rng: np.random.Generator) -> tuple[Evaluation[None], np.ndarray, np.ndarray]:
    """A linearised program, a Hessian, and a guess of the active rows; some have no solution."""
    size = int(rng.choice([1, 2, 3, 5, 8, 13, quadratic.LARGEST]))
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
    guess = rng.choice(count, int(rng.integers(0, min(size, count) // 4 + 1)), replace=False)
    return program, scale * (root @ root.T + 0.1 * np.eye(size)), np.sort(guess)


@pytest.mark.parametrize("seed", range(8))
def test_solves_what_the_python_solves_and_the_same(seed):
    rng = np.random.default_rng(seed)
    solved = 0
    for _ in range(40):
        program, hessian, guess = drawn(rng)
        wanted, found = by_changes_of_active_rows(program, hessian, guess), step_by_active_rows(program, hessian, guess)
        assert (found is None) == (wanted is None)
        if found is None or wanted is None:
            continue
        solved += 1
        assert found.direction == pytest.approx(wanted.direction, rel=1e-7, abs=1e-9)
        for mine, other in zip(found.multipliers, wanted.multipliers, strict=True):
            assert mine == pytest.approx(other, rel=1e-6, abs=1e-9 * np.abs(program.gradient).max())
        assert np.array_equal(found.multipliers.inequality > 0, wanted.multipliers.inequality > 0)
    assert solved > 10


def test_the_program_stays_as_it_is():
    program, hessian, guess = drawn(np.random.default_rng(1))
    before = [values.copy() for values in (hessian, guess, program.inequality, program.inequality_jacobian)]
    step_by_active_rows(program, hessian, guess)
    for values, kept in zip((hessian, guess, program.inequality, program.inequality_jacobian), before, strict=True):
        assert np.array_equal(values, kept)


def test_without_the_kernel_it_is_the_python(monkeypatch):
    program, hessian, _ = drawn(np.random.default_rng(3))
    monkeypatch.setattr(quadratic, "kernel", lambda: None)
    none = np.empty(0, dtype=np.int64)
    found, wanted = (way(program, hessian, none) for way in (step_by_active_rows, by_changes_of_active_rows))
    assert found is not None
    assert found.direction.tobytes() == wanted.direction.tobytes()


@pytest.mark.parametrize("row", ["inequality", "gradient"])
def test_what_is_no_number_has_no_solution(row):
    program, hessian, _ = drawn(np.random.default_rng(3))
    getattr(program, row)[...] = np.nan
    assert step_by_active_rows(program, hessian, np.array([0])) is None
