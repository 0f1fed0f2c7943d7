"""Decision variables: maps there and back, derivatives, and the metric, against what they stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sampled_flight import gradient

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.planning.variables import DecisionVariables, decision_variables


def variables_of(problem: fp.Problem, degree: int | tuple[int, ...] = 7) -> DecisionVariables:
    problem = replace(problem, motion=fp.Motion(degree=degree))
    branches = np.zeros((2, len(problem.robot.joints)), dtype=np.int64)
    momentum = flight_of(problem).momentum_set
    return decision_variables(problem, problem.degrees, branches, momentum)


def with_free_momentum(problem: fp.Problem) -> fp.Problem:
    return replace(problem, flight=replace(problem.flight, angular_momentum="free"))


@pytest.fixture(scope="module")
def problem(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.mark.parametrize("degree", [7, (6, 9)])
@pytest.mark.parametrize("free", [False, True])
def test_motions_go_there_and_back(problem, degree, free):
    variables = variables_of(with_free_momentum(problem) if free else problem, degree)
    x = np.random.default_rng(1).normal(size=variables.size)
    again = variables.variables(variables.free_coefficients(x), variables.angular_momentum(x))
    assert again == pytest.approx(x, abs=1e-10)


def test_a_given_momentum_is_no_variable(problem):
    given = replace(problem, flight=replace(problem.flight, angular_momentum=-1.0))
    variables = variables_of(given)
    assert variables.size == variables.coefficients == 4
    for x in np.random.default_rng(2).normal(size=(3, variables.size)):
        assert variables.angular_momentum(x).tolist() == [-1.0]


def test_a_free_momentum_spans_the_interval(problem):
    problem = replace(problem, goal=replace(problem.goal, orientation=problem.goal.orientation - 4 * np.pi))
    bounds = problem.momentum_interval
    variables = variables_of(with_free_momentum(problem))
    x = variables.plain_motion
    assert variables.size == variables.coefficients + 1
    assert variables.angular_momentum(x) == pytest.approx([sum(bounds) / 2])
    for side, bound in zip((-1.0, 1.0), bounds, strict=True):
        assert variables.angular_momentum(np.append(x[:-1], side)) == pytest.approx([bound])


def test_the_plain_motion_has_no_free_part(problem):
    variables = variables_of(problem)
    z = variables.free_coefficients(variables.plain_motion)
    assert z == pytest.approx(variables.polynomials.no_free_part, abs=1e-12)


def test_coefficients_of_absent_powers_stay_zero(problem):
    variables = variables_of(problem, (6, 9))
    z = variables.free_coefficients(np.random.default_rng(3).normal(size=variables.size))
    assert z.shape == (2, 4)
    assert z[0, 1:].tolist() == [0.0] * 3
    assert np.abs(z[1]).min() > 0


@pytest.mark.parametrize("degree", [7, (6, 9)])
@pytest.mark.parametrize("free", [False, True])
def test_gradients_are_those_of_the_map(problem, degree, free):
    """Of a function that is linear in z and h: its difference over a step is its gradient times the step."""
    rng = np.random.default_rng(4)
    variables = variables_of(with_free_momentum(problem) if free else problem, degree)
    by_z = rng.normal(size=(3, *variables.polynomials.no_free_part.shape))
    by_momentum = rng.normal(size=(3, 1))
    x, step = rng.normal(size=(2, variables.size))

    def value(x):
        momentum = variables.angular_momentum(x)
        return np.tensordot(by_z, variables.free_coefficients(x), 2) + by_momentum @ momentum

    found = gradient(variables, by_z, by_momentum)
    assert found.shape == (3, variables.size)
    assert found @ step == pytest.approx(value(x + step) - value(x), rel=1e-10, abs=1e-10)


def test_the_metric_measures_how_far_joints_move(problem):
    variables = variables_of(with_free_momentum(problem))
    metric = variables.metric
    unit = np.zeros(variables.size)
    unit[-1] = 1.0
    assert np.linalg.norm(metric @ unit) == pytest.approx(1.0)
    step = np.append(np.random.default_rng(5).normal(size=variables.coefficients), 0.0)
    moved = variables.free_coefficients(variables.plain_motion + step) - variables.polynomials.no_free_part
    assert np.linalg.norm(metric @ step) == pytest.approx(np.linalg.norm(moved) / np.sqrt(2))
