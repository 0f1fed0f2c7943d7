"""Quadratic programs by the dual method."""

from __future__ import annotations

import numpy as np
import pytest

from floatplan.compiled.quadratic import dual_step
from floatplan.optimization.programs import ROW_TOLERANCE, Derivatives, Evaluation


def drawn(rng: np.random.Generator) -> tuple[Evaluation[None], np.ndarray]:
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


def test_the_program_stays_as_it_is():
    program, hessian = drawn(np.random.default_rng(1))
    before = [values.copy() for values in (hessian, program.inequality, program.inequality_jacobian)]
    dual_step(program, hessian)
    for values, kept in zip((hessian, program.inequality, program.inequality_jacobian), before, strict=True):
        assert np.array_equal(values, kept)


@pytest.mark.parametrize("row", ["inequality", "gradient"])
def test_what_is_no_number_has_no_solution(row):
    program, hessian = drawn(np.random.default_rng(3))
    getattr(program, row)[...] = np.nan
    assert dual_step(program, hessian) is None
