"""Levenberg-Marquardt on the violations: it ends at what violates nothing, or where it stalls, and never fails."""

from __future__ import annotations

import numpy as np
import pytest

from floatplan.kernel.tolerances import EXCHANGE
from floatplan.optimization import sqp
from floatplan.optimization.programs import Derivatives, Evaluation
from floatplan.optimization.sqp import reduce_violations


class Program:
    """Violations c(x) = 0 and g(x) >= 0 of two variables, with nothing to minimise."""

    metric = np.eye(2)

    def __init__(self, equality, equality_gradient, inequality, inequality_gradient):
        self._parts = equality, equality_gradient, inequality, inequality_gradient

    def evaluate(self, x):
        equality, equality_gradient, inequality, inequality_gradient = self._parts
        return Evaluation(
            objective=0.0,
            equality=np.array([equality(*x)]),
            inequality=np.array([inequality(*x)]),
            differentiate=lambda: Derivatives(
                np.zeros(2), np.array([equality_gradient(*x)]), np.array([inequality_gradient(*x)])
            ),
            detail=None,
        )


CIRCLE_AND_LINE = Program(
    lambda a, b: a**2 + b**2 - 4,
    lambda a, b: (2 * a, 2 * b),
    lambda a, b: a + b - 1,
    lambda a, b: (1, 1),
)


def test_ends_at_what_violates_nothing():
    found = reduce_violations(CIRCLE_AND_LINE, np.array([-1.0, -3.0]))
    assert found.squared_violation < 1e-20
    assert not found.stuck
    assert np.linalg.norm(found.x) == pytest.approx(2.0)
    assert found.x.sum() >= 1 - 1e-9
    assert found.evaluation.worst_violation == CIRCLE_AND_LINE.evaluate(found.x).worst_violation


def test_ends_near_what_cannot_be_met():
    """The circle of radius 2 and the half-plane a + b >= 4: nearest at the diagonal."""
    contradictory = Program(
        lambda a, b: a**2 + b**2 - 4, lambda a, b: (2 * a, 2 * b), lambda a, b: a + b - 4, lambda a, b: (1, 1)
    )
    found = reduce_violations(contradictory, np.array([-1.0, -3.0]), iterations=200)
    assert found.squared_violation > 1e-2
    assert found.x[0] == pytest.approx(found.x[1], abs=0.05)


def test_tells_that_it_is_stuck():
    """Between the line a + b = 4 and the half-plane a + b <= 0 no step gains anything, wherever it began."""
    parallel = Program(lambda a, b: a + b - 4, lambda a, b: (1, 1), lambda a, b: -a - b, lambda a, b: (-1, -1))
    found = reduce_violations(parallel, np.array([-1.0, -3.0]))
    assert found.stuck
    assert found.squared_violation == pytest.approx(8.0, rel=EXCHANGE.least_gain)
    assert found.evaluations < 6


def test_damping_never_vanishes(monkeypatch):
    """However many good steps make it smaller: rows that leave a direction free would give a singular system."""
    seen = []
    step = sqp._damped_step
    monkeypatch.setattr(sqp, "_damped_step", lambda at, damping: (seen.append(damping), step(at, damping))[1])
    flat = Program(
        lambda a, b: (a + b - 1) ** 9,
        lambda a, b: (9 * (a + b - 1) ** 8, 9 * (a + b - 1) ** 8),
        lambda a, b: 1.0,
        lambda a, b: (0, 0),
    )
    found = reduce_violations(flat, np.array([3.0, 3.0]))
    assert found.squared_violation < 1e-12
    assert min(np.linalg.eigvalsh(damping)[0] for damping in seen) > 1e-9


def test_stops_when_told():
    found = reduce_violations(CIRCLE_AND_LINE, np.array([-1.0, -3.0]), stop=lambda: True)
    assert found.evaluations == 1
