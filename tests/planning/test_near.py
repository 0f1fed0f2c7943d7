"""Plans that begin with the motion of another one."""

from dataclasses import replace

import numpy as np
import pytest
from places import PROBLEMS

import floatplan as fp
from floatplan.planning import in_space
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned

PATIENCE = 60.0  # s of budget that no search here uses up
NAMES = ("obstacle", "torque_limited", "handstand_ground", "moving_hoop", "new_configuration_moving", "gallery/go2")


def plan_near(problem, near, budget):
    return planned(problem, SearchOptions(budget=budget), near).plan


def problem_of(name):
    return fp.load_problem(PROBLEMS / f"{name}.toml")


def turned(problem, angle):
    """The problem with another last joint at the goal."""
    positions = np.array(problem.final.positions)
    positions[-1] += angle
    return replace(problem, goal=replace(problem.goal, positions=positions))


@pytest.mark.parametrize("name", NAMES)
def test_a_plan_is_at_its_own_motion_and_a_small_change_is_planned_as_by_the_whole_search(name):
    problem = problem_of(name)
    plan = fp.plan(problem)
    again = plan_near(problem, plan, PATIENCE)
    assert again.ok
    assert again.objective_value == pytest.approx(plan.objective_value, rel=1e-6)
    times = np.linspace(0, plan.duration, 50)
    assert np.allclose(again.at(times).positions, plan.at(times).positions, atol=1e-3)
    assert again.angular_momentum == pytest.approx(plan.angular_momentum, abs=1e-3)
    changed = turned(problem, -0.03)
    whole, near = fp.plan(changed), plan_near(changed, plan, PATIENCE)
    assert whole.ok
    assert near.ok
    assert near.objective_value <= whole.objective_value * (1 + 1e-5)
    if name == "gallery/go2":
        assert near.solver["starts"] == 1
        assert 4 * near.solver["evaluations"] < whole.solver["evaluations"]
    assert np.allclose(near.at(near.duration).positions, changed.final.positions, atol=1e-9)


def test_where_the_motion_at_hand_leads_to_none_another_is_searched():
    """From one of another degree, and from none that holds; and it is said why there is none."""
    problem = problem_of("handstand_ground")
    lower, higher = (replace(problem, motion=replace(problem.motion, degree=degree)) for degree in (9, 13))
    low, high = fp.plan(lower), fp.plan(higher)
    assert low.ok
    assert high.ok
    assert plan_near(lower, high, PATIENCE).coefficients.shape == low.coefficients.shape
    raised = plan_near(higher, low, PATIENCE)
    assert raised.ok
    assert raised.coefficients.shape == high.coefficients.shape
    slow = replace(lower, limits=replace(problem.limits, velocity=0.1))
    none = plan_near(slow, low, 0.5)
    assert not none.ok
    assert "velocity limit" in none.explanation
    assert plan_near(lower, none, PATIENCE).ok


def test_in_space_a_plan_is_at_its_own_motion_too_and_a_small_change_begins_with_it(request):
    plan = request.getfixturevalue("planned")("space/free_ur5")
    problem = plan.problem
    again = plan_near(problem, plan, PATIENCE)
    assert again.ok
    assert again.solver["starts"] == 1
    assert again.objective_value == pytest.approx(plan.objective_value, rel=1e-6)
    changed = turned(problem, 0.02)
    near, whole = plan_near(changed, plan, PATIENCE), fp.plan(changed)
    assert near.ok
    assert near.solver["starts"] == 1
    assert near.objective_value <= whole.objective_value * (1 + 1e-5)


def test_in_space_a_start_near_a_plan_is_followed_within_its_limits_as_it_is(request, monkeypatch):
    """Made smaller without them first, it would leave them: flights past the edge of a box were not found."""
    plan = request.getfixturevalue("planned")("space/go2_barrel_roll")
    assert plan.problem.has_inequalities
    made_smaller = []

    def recorded(motion, *arguments, **options):
        made_smaller.append(motion)
        return descend(motion, *arguments, **options)

    descend = in_space.descend
    monkeypatch.setattr(in_space, "descend", recorded)
    again = plan_near(plan.problem, plan, PATIENCE)
    assert again.ok
    assert again.solver["starts"] == 1
    assert not made_smaller
