"""Peaks of many plans, by the compiled kernel."""

from dataclasses import replace

import numpy as np
import pytest
from long_cases import cases
from plain_problems import problem_of, random_robot

import floatplan as fp
from floatplan.plans.plans import PlanEntry
from floatplan.studies.peaks import many_peaks

DENSE = 4001  # instants
SPREADS = (0.3, 0.3, 1.0, 1.0, 3.0, 6.0)  # of coefficients; the last motions need more nodes than there are
SMOOTH = 2  # motions that need no more


def groups(every):
    """Problems of one robot and degrees each, and motions of theirs, smooth and wild, that need not meet any goal."""
    found = []
    for number in range(0, 24, every):
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
    answer = PlanEntry("optimal", objective=0.0, angular_momentum=momentum, residual=0.0, coefficients=coefficients)
    plan = answer.plan(replace(like, flight=flight), seed=0)
    state = plan.at(np.linspace(0, duration, DENSE))
    return np.abs(state.motor_torques).max(axis=0), np.abs(state.velocities).max(axis=0)


@pytest.mark.parametrize("every", cases([4, 1], {1}))
def test_peaks_are_those_of_the_plans_at_many_instants(every):
    """Whatever the tree, with coupled joints and mirrored planes."""
    for like, duration, momentum, coefficients in groups(every):
        found = many_peaks(like, duration, momentum, coefficients)
        for row in range(SMOOTH):
            torque, velocity = measured_densely(like, duration[row], float(momentum[row]), coefficients[row])
            np.testing.assert_allclose(found.motor_torque[row], torque, rtol=5e-5, atol=1e-6 * torque.max())
            np.testing.assert_allclose(found.joints["velocity"][row], velocity, rtol=5e-5, atol=1e-6 * velocity.max())
            assert (found.motor_torque[row] >= torque * (1 - 1e-8)).all()


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
