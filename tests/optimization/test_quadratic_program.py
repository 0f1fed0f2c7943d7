"""The linear systems of the QPs."""

from __future__ import annotations

import numpy as np
import pytest

from floatplan.optimization.quadratic_program import solved


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
