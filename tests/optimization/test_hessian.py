"""A Hessian and its inverse are two forms of the same approximation."""

import numpy as np
import pytest

from floatplan.optimization.programs import Derivatives, Evaluation
from floatplan.optimization.sqp import DirectHessian, InverseHessian, hessian_approximation

NO_ROWS = np.empty(0, dtype=np.int64)
SIZE = 5
SLACK_PENALTY = 1e3


def positive_definite(rng):
    factor = rng.normal(size=(SIZE, SIZE))
    return factor @ factor.T + 0.1 * np.eye(SIZE)


def evaluation(rng, equalities=1, rows=None):
    rows = rng.normal(size=(equalities, SIZE)) if rows is None else rows
    derivatives = Derivatives(rng.normal(size=SIZE), rows, np.empty((0, SIZE)))
    return Evaluation(0.0, rng.normal(size=len(rows)), np.empty(0), lambda: derivatives, None)


@pytest.fixture(params=range(5))
def rng(request):
    return np.random.default_rng(request.param)


@pytest.fixture
def forms(rng):
    hessian = positive_definite(rng)
    return hessian_approximation(hessian, inequalities=True), hessian_approximation(hessian, inequalities=False)


def test_inequalities_ask_for_the_hessian_itself(forms):
    assert isinstance(forms[0], DirectHessian)
    assert isinstance(forms[1], InverseHessian)
    assert forms[1].hessian == pytest.approx(forms[0].hessian, rel=1e-9, abs=1e-9)
    assert 1 <= forms[1].largest <= forms[0].largest * (1 + 1e-9)


@pytest.mark.parametrize("equalities", [0, 1, 2])
def test_both_take_the_same_step(forms, rng, equalities):
    current = evaluation(rng, equalities)
    one, other = (form.step(current, NO_ROWS, SLACK_PENALTY) for form in forms)
    assert other.direction == pytest.approx(one.direction, rel=1e-8, abs=1e-10)
    assert other.multipliers.equality == pytest.approx(one.multipliers.equality, rel=1e-8, abs=1e-10)
    assert current.equality_jacobian @ other.direction == pytest.approx(-current.equality, rel=1e-9, abs=1e-10)
    assert not one.elastic
    assert not other.elastic


@pytest.mark.parametrize("step_length", [1.0, 0.3])
def test_both_give_the_same_product(forms, rng, step_length):
    current = evaluation(rng)
    step = forms[1].step(current, NO_ROWS, SLACK_PENALTY)
    one, other = (form.product(step_length * step.direction, step, step_length) for form in forms)
    assert other == pytest.approx(one, rel=1e-8, abs=1e-10)


def test_both_learn_the_same(forms, rng):
    change = rng.normal(size=SIZE)
    gradient_change = positive_definite(rng) @ change
    product = forms[0].product(change, None, 1.0)
    one, other = (form.updated(change, product, gradient_change) for form in forms)
    assert one.hessian @ change == pytest.approx(gradient_change, rel=1e-9)
    assert other.hessian == pytest.approx(one.hessian, rel=1e-7, abs=1e-9)
    assert np.linalg.eigvalsh(one.hessian).min() > 0


def test_contradicting_equations_make_an_elastic_step(forms, rng):
    row = rng.normal(size=SIZE)
    current = evaluation(rng, rows=np.stack((row, 2 * row)))
    assert forms[1].step(current, NO_ROWS, SLACK_PENALTY).elastic


def test_an_equation_that_no_variable_moves_makes_an_elastic_step(forms, rng):
    current = evaluation(rng, rows=np.zeros((1, SIZE)))
    for form in forms:
        step = form.step(current, NO_ROWS, SLACK_PENALTY)
        assert step.elastic
        assert step.violation_left == pytest.approx(abs(current.equality[0]))
