"""Peaks of many plans, by the compiled kernel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from long_cases import cases
from plain_problems import problem_of, random_robot

import floatplan as fp
from floatplan.kernel.library import kernel
from floatplan.planning.kernel_input.bodies import Bodies
from floatplan.plans.plans import Answer
from floatplan.studies import peaks
from floatplan.studies.peaks import many_peaks

DENSE = 4001  # instants
SPREADS = (0.3, 0.3, 1.0, 1.0, 3.0, 6.0)  # of coefficients; the last motions need more nodes than there are
SMOOTH = 2  # motions that need no more


@pytest.fixture(scope="module")
def groups():
    """Problems of one robot and degrees each, and motions of theirs, smooth and wild, that need not meet any goal."""
    found = []
    for number in range(24):
        robot = random_robot(number, 1 + number % 12)
        motion = fp.Motion(degree=[7 + joint % 2 for joint in range(len(robot.joints))])
        like = replace(problem_of(robot, np.random.default_rng(number)), motion=motion)
        rng = np.random.default_rng([6, number])
        count, n, size = len(SPREADS), len(like.degrees), max(like.degrees) + 1
        duration = rng.uniform(0.5, 2.0, count)
        spread = np.array(SPREADS)[:, None, None]
        per_power = duration[:, None, None] ** np.arange(size)
        coefficients = spread * rng.normal(size=(count, n, size)) / per_power
        found.append((like, duration, rng.uniform(-5, 5, count), coefficients))
    return found


def measured_densely(like, duration, momentum, coefficients):
    """Largest torques and rates at many instants, by the plan's own states."""
    flight = replace(like.flight, duration=duration, angular_momentum=momentum)
    answer = Answer("optimal", objective=0.0, angular_momentum=momentum, residual=0.0, coefficients=coefficients)
    plan = answer.plan(replace(like, flight=flight), seed=0)
    state = plan.at(np.linspace(0, duration, DENSE))
    return np.abs(state.motor_torques).max(axis=0), np.abs(state.velocities).max(axis=0)


@pytest.mark.parametrize("every", cases([4, 1], {1}))
def test_peaks_are_those_of_the_plans_at_many_instants(groups, every):
    """Whatever the tree, with coupled joints and mirrored planes."""
    for like, duration, momentum, coefficients in groups[::every]:
        found = many_peaks(like, duration, momentum, coefficients)
        for row in range(SMOOTH):
            torque, velocity = measured_densely(like, duration[row], float(momentum[row]), coefficients[row])
            np.testing.assert_allclose(found.motor_torque[row], torque, rtol=5e-5, atol=1e-6 * torque.max())
            np.testing.assert_allclose(found.joints["velocity"][row], velocity, rtol=5e-5, atol=1e-6 * velocity.max())
            assert (found.motor_torque[row] >= torque * (1 - 1e-8)).all()


def test_all_sets_of_instructions_measure_the_same(groups, monkeypatch):
    found, widest = kernel(), [many_peaks(*group) for group in groups]
    for instructions in range(found.instructions):
        monkeypatch.setattr(found, "instructions", instructions)
        for group, expected in zip(groups, widest, strict=True):
            measured = many_peaks(*group)
            np.testing.assert_allclose(measured.motor_torque, expected.motor_torque, rtol=1e-9)
            np.testing.assert_allclose(measured.joints["velocity"], expected.joints["velocity"], rtol=1e-9)


def test_rates_are_measured_only_where_they_are_asked_for(groups):
    found = many_peaks(*groups[3], orders=0)
    assert not found.joints
    assert np.isinf(found.clearance).all()
    smooth = slice(0, SMOOTH)  # wild motions have more nodes where their rates need them
    np.testing.assert_allclose(found.motor_torque[smooth], many_peaks(*groups[3]).motor_torque[smooth], rtol=1e-9)


def test_all_three_numbers_of_nodes_are_needed(groups, monkeypatch):
    """Else the table above would not try them: with fewer of them peaks are missed."""
    full = [many_peaks(*group).motor_torque for group in groups]
    for fewer in (peaks.NODES[:1], peaks.NODES[:2]):
        monkeypatch.setattr(peaks, "NODES", fewer)
        missed = [1 - many_peaks(*group).motor_torque / most for group, most in zip(groups, full, strict=True)]
        assert max(each.max() for each in missed) > 1e-9


def test_a_plan_s_peaks_do_not_depend_on_its_neighbours(groups):
    like, duration, momentum, coefficients = groups[5]
    together = many_peaks(like, duration, momentum, coefficients)
    for row in range(len(duration)):
        one = slice(row, row + 1)
        alone = many_peaks(like, duration[one], momentum[one], coefficients[one])
        np.testing.assert_array_equal(alone.motor_torque[0], together.motor_torque[row])
        np.testing.assert_array_equal(alone.joints["velocity"][0], together.joints["velocity"][row])


def test_joints_of_lower_degree_may_be_padded(groups):
    """As :class:`floatplan.Plans` pads them."""
    like, duration, momentum, coefficients = groups[6]
    zero, missing = coefficients.copy(), coefficients.copy()
    zero[:, 0, -1], missing[:, 0, -1] = 0.0, np.nan
    np.testing.assert_array_equal(
        many_peaks(like, duration, momentum, missing).motor_torque,
        many_peaks(like, duration, momentum, zero).motor_torque,
    )


def test_nothing_to_measure(groups):
    like, duration, momentum, coefficients = groups[0]
    found = many_peaks(like, duration[:0], momentum[:0], coefficients[:0])
    assert found.motor_torque.shape == (0, len(like.robot.motors))


def test_coupled_joints_and_mirrored_planes_are_in_the_table(groups):
    robots = [like.robot for like, *_ in groups]
    assert any(len(robot.motors) > len(robot.joints) for robot in robots)
    assert {robot.tree.turn for robot in robots} == {-1.0, 1.0}
    assert any(np.abs(Bodies(robot.tree, *np.ones((2, len(robot.joints)))).imaginary).max() > 1e-9 for robot in robots)


def test_rates_and_distances_are_those_of_the_plans():
    """Of problems that differ in obstacles, ranges and durations, moving obstacles and windows among them."""
    base = fp.load_problem("problems/obstacle.toml")
    circle = base.obstacles[0]
    bar = fp.Bar(start=(2.0, 0.5), end=(2.6, 1.9), radius=0.1, margin=0.0, window=(0.3, 0.9), velocity=(0.4, -0.2))
    problems, plans = [], []
    for number, at in enumerate([(1.485, 3.342), (0.9, 2.0), (2.5, 3.0), (3.6, 0.965)]):
        obstacles = (replace(circle, center=at), replace(bar, end=(2.6, 1.9 + 0.1 * number)))
        flight = replace(base.flight, duration=1.4 + 0.05 * number)
        problem = replace(base, obstacles=obstacles, flight=flight)
        problems.append(problem)
        free = fp.plan(replace(problem, obstacles=()))
        plans.append(replace(free, problem=problem))
    of_plans = zip(*((plan.duration, plan.angular_momentum) for plan in plans), strict=True)
    found = many_peaks(problems, *map(np.array, of_plans), np.array([plan.coefficients for plan in plans]), orders=2)
    for row, plan in enumerate(plans):
        np.testing.assert_allclose(found.clearance[row], plan.peaks.clearance, rtol=0, atol=1e-9)
        for name, largest in found.joints.items():
            np.testing.assert_allclose(largest[row], plan.peaks.joints[name], rtol=1e-7)
