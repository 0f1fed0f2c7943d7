"""Limits of the joints' accelerations: kept by the search, proved, drawn, and told."""

from dataclasses import replace

import numpy as np
import pytest
from places import PROBLEMS

import floatplan as fp

EXAMPLE = PROBLEMS / "new_configuration.toml"


def limited(problem, acceleration):
    return replace(problem, limits=replace(problem.limits, acceleration=acceleration))


@pytest.fixture(scope="module")
def free():
    """The plan without the limit."""
    return fp.plan(fp.load_problem(EXAMPLE))


@pytest.fixture(scope="module")
def limits(free):
    return [0.95 * peak for peak in free.peaks.joints["acceleration"].tolist()]


@pytest.fixture(scope="module")
def plan(free, limits):
    found = fp.plan(limited(free.problem, limits))
    assert found.ok, found.explanation
    return found


def test_the_search_keeps_it_at_all_times(plan, free, limits):
    peaks = np.abs(plan.at(np.linspace(0, plan.duration, 5001)).accelerations).max(axis=0)
    assert (peaks <= np.array(limits) * (1 + 1e-9)).all()
    assert plan.objective_value > free.objective_value


def test_it_is_proved_and_a_tighter_one_refuted(plan, free, limits):
    certificate = fp.certify(plan)
    assert certificate.proved
    found = {finding.label: finding for finding in certificate.findings}
    assert [found[f"acceleration {joint}"].limit for joint in plan.robot.joints] == limits
    refuted = fp.certify(replace(free, problem=plan.problem))
    assert refuted.verdict == "refuted"
    wrong = {finding.label for finding in refuted.findings if finding.verdict == "refuted"}
    assert wrong == {f"acceleration {joint}" for joint in plan.robot.joints}


def test_a_goal_beyond_it_is_impossible(free):
    goal = replace(free.problem.goal, accelerations=[5.0, 0.0])
    plan = fp.plan(limited(replace(free.problem, goal=goal), 4.0))
    assert not plan.ok
    assert "At landing the goal itself is impossible: acceleration of q1 is violated by 1 rad/s^2" in plan.explanation
