"""What an update makes of a measurement: the filter's state, and what it says of the rest of the flight."""

import math
from dataclasses import replace

import numpy as np
import pytest
from flown_plans import Drifting, forward_plan
from long_cases import cases
from places import PROBLEMS
from plain_problems import plain_problems
from update_reference import filtered

import floatplan as fp

CHAINS = cases(range(8, 96, 14), range(36, 96, 14))
NAMES = ("falling_cat_apart", "somersault", "high_jump", "gallery/go2", "gallery/g1", "gallery/human")


def limited(problem, rng):
    """Return a problem with limits of every kind, some of which a correction meets."""
    wild = forward_plan(problem, size=0.3)
    peaks = wild.peaks
    found = {
        "torque": float(np.max(peaks.motor_torque)) * float(rng.uniform(0.8, 1.2)),
        "velocity": float(np.max(peaks.velocity)) * float(rng.uniform(0.8, 1.2)),
        "acceleration": float(peaks.joints["acceleration"].max()) * float(rng.uniform(0.8, 1.2)),
        "orientation_rate": float(np.abs(wild.at(np.linspace(0, wild.duration, 50)).orientation_rate).max()) * 1.02,
    }
    return replace(problem, limits=replace(problem.limits, **found))


def assert_foreseen(plan, error=0.1):
    """What is said of each correction is so of the rest of the flight, flown without another one.

    That are the miss, the largest torques, and where it is "applied" the limits that it keeps.
    """
    problem, momentum = plan.problem, (1 + error) * plan.angular_momentum
    replanner, robot = fp.Replanner(plan), Drifting(plan, momentum)
    limits = problem.motor_torque_limits
    statuses = set()
    for number, following in enumerate((plan.duration * np.arange(1, 31) / 40).tolist()):
        correction = replanner.update(*robot.state(replanner))
        statuses.add(correction.status)
        alone = Drifting(plan, momentum)
        alone.time, alone.orientation = robot.time, robot.orientation
        alone.fly(replanner, plan.duration, 400)
        times = np.linspace(robot.time, plan.duration, 101)
        positions, velocities, accelerations = replanner.motion.at(times)
        rate = plan.dynamics.base_rate(positions, velocities, momentum)
        if number > 4:
            missed = alone.orientation - problem.final.orientation
            assert missed == pytest.approx(correction.predicted_miss, abs=FORESEEN, rel=0.01)  # far off, a share of it
            if plan.robot.motors == plan.robot.joints:
                most = np.abs(plan.dynamics.torques(positions, velocities, accelerations, rate)).max(axis=0)
                assert correction.torque_peak == pytest.approx(most, rel=0.05, abs=0.01 * most.max())
        if correction.status == "applied":
            assert abs(correction.predicted_miss) < math.radians(1)
            assert (np.abs(velocities) <= problem.velocity_limits * (1 + 5e-3)).all()
            assert (np.abs(rate) <= problem.limits.orientation_rate * (1 + 5e-3)).all()
            assert (correction.torque_peak <= limits * (1 + 5e-3)).all()
        robot.fly(replanner, following, 40)
    assert "invalid" not in statuses


FORESEEN = 2e-3  # [rad]


@pytest.mark.parametrize("number", CHAINS)
def test_corrections_of_random_robots_are_what_they_say(number):
    assert_foreseen(forward_plan(limited(plain_problems(96)[number], np.random.default_rng(number)), seed=number))


@pytest.mark.parametrize("name", cases(NAMES, {"gallery/g1", "gallery/human"}))
def test_corrections_within_limits_and_past_obstacles_are_what_they_say(name):
    problem = limited(fp.load_problem(PROBLEMS / f"{name}.toml"), np.random.default_rng(0))
    assert_foreseen(forward_plan(problem))


@pytest.mark.parametrize("name", ["somersault", "handstand", "high_jump", "somersault_motors"])
def test_the_filter_is_a_kalman_filter_of_momentum_and_masses(name):
    plan = forward_plan(fp.load_problem(PROBLEMS / f"{name}.toml"), size=0.2)
    replanner, rng = fp.Replanner(plan), np.random.default_rng(2)
    robot = Drifting(plan, 1.05 * plan.angular_momentum)
    for following in (plan.duration * np.arange(1, 13) / 60).tolist():
        t, angle, rate, positions, velocities = robot.state(replanner)
        noise = 1e-3 * rng.standard_normal((2, 1 + len(positions)))
        measured = t, angle + noise[0, 0], rate + noise[1, 0], positions + noise[0, 1:], velocities + noise[1, 1:]
        state, covariance = filtered(replanner, *measured)
        assert replanner.update(*measured).status != "invalid"
        found, scale = replanner._estimate.inertial, replanner._estimate.inertial.deviations
        np.testing.assert_allclose(found.state / scale, state / scale, rtol=0, atol=1e-7)
        np.testing.assert_allclose(
            found.covariance / np.outer(scale, scale), covariance / np.outer(scale, scale), rtol=0, atol=1e-7
        )
        robot.fly(replanner, following, 100)
