"""Corrections in flight: continuous, inside the joint ranges, to the goal; and nothing that is measured stops them."""

import math

import numpy as np
import pytest
from flown_plans import Drifting, forward_plan
from long_cases import cases
from places import PROBLEMS

import floatplan as fp

FILES = sorted(PROBLEMS.glob("*.toml")) + sorted(PROBLEMS.glob("gallery/*.toml"))
DAILY = (
    "falling_cat",
    "handstand",
    "high_jump",
    "moving_hoop",
    "somersault_motors",
    "gallery/go2",
)  # of every kind one
LONG = {*FILES} - {PROBLEMS / f"{name}.toml" for name in DAILY}
STATUSES = {"applied", "limited", "refused"}


def instants(plan, count):
    return (plan.duration * np.arange(count) / count).tolist()


def assert_continuous(before, after, now, scale):
    """Positions, velocities, accelerations go on where a motion takes the place of another."""
    for old, new in zip(before.at(now), after.at(now), strict=True):
        np.testing.assert_allclose(new, old, rtol=1e-9, atol=1e-8 * scale)


@pytest.mark.parametrize("error", [-0.2, -0.1, 0.1, 0.2])
def test_lands_at_the_goal_from_another_momentum(plan, replanner, error):
    robot = Drifting(plan, plan.angular_momentum * (1 + error))
    for following in [*instants(plan, 100)[1:], plan.duration]:
        before = replanner.motion
        correction = replanner.update(*robot.state(replanner))
        assert correction.status == "applied"
        assert_continuous(before, correction.motion, robot.time, 100.0)
        robot.fly(replanner, following)
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.05)
    landed = replanner.motion.at(plan.duration)
    for values, goal in zip(landed, ("positions", "velocities", "accelerations"), strict=True):
        np.testing.assert_allclose(values[0], getattr(plan.problem.final, goal), atol=1e-9)
    alone = Drifting(plan, plan.angular_momentum * (1 + error))
    replanner.reset()
    alone.fly(replanner, plan.duration, 2000)
    assert abs(alone.orientation - plan.problem.final.orientation) > math.radians(20)


def test_an_undisturbed_flight_stays_the_plan(plan, replanner):
    robot = Drifting(plan, plan.angular_momentum)
    for following in [*instants(plan, 200)[1:], plan.duration]:
        replanner.update(*robot.state(replanner))
        robot.fly(replanner, following)
    times = np.linspace(0.0, plan.duration, 50)
    for time in times:
        reference = replanner.reference(time)
    assert np.abs(replanner.motion.at(plan.duration - 0.02)[0] - plan.at(plan.duration - 0.02).positions).max() < 1e-3
    assert np.abs(reference.positions - plan.problem.final.positions).max() < 1e-9


def test_reference_is_the_plan_before_anything_is_measured(plan, replanner):
    for time in np.linspace(0.0, plan.duration, 23):
        state, reference = plan.at(time), replanner.reference(float(time))
        for name in ("positions", "velocities", "accelerations"):
            np.testing.assert_allclose(getattr(reference, name), getattr(state, name), rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(reference.feedforward, state.torques, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(reference.motors, state.motor_torques, rtol=1e-7, atol=1e-7)


def test_at_rest_in_the_goal_after_landing(plan, replanner):
    for time in (plan.duration + 0.1, 1e6, math.inf):
        reference = replanner.reference(time)
        assert np.isfinite(reference.feedforward).all()
    np.testing.assert_allclose(replanner.reference(9.0).positions, plan.problem.final.positions, atol=1e-9)
    assert not replanner.reference(9.0).velocities.any()


BAD = {
    "nan": {"orientation": math.nan},
    "nan joint": {"positions": [math.nan, 0.0]},
    "infinite": {"orientation_rate": math.inf},
    "text": {"orientation": "up"},
    "none": {"velocities": None},
    "shape": {"positions": [0.0, 0.0, 0.0]},
    "one number": {"velocities": 1.0},
    "half a turn more": {"orientation": lambda value: value + math.pi},
    "degrees": {"orientation": math.degrees},
    "joints in degrees": {"positions": np.degrees, "velocities": np.degrees},
    "joints in another order": {"positions": lambda value: value[::-1], "velocities": lambda value: value[::-1]},
    "huge": {"orientation": 1e308},
    "huge joints": {"positions": [1e308, -1e308]},
    "joint jump": {"positions": lambda value: value + 2.0},
    "rate jump": {"orientation_rate": lambda value: value + 100.0},
    "velocity jump": {"velocities": lambda value: value - 1e4},
    "nan time": {"t": math.nan},
    "before takeoff": {"t": -0.1},
    "from the future": {"t": 0.5, "now": 0.4},
    "now is none": {"now": "soon"},
    "after landing": {"now": 1.1},
    "much later": {"t": 1e9, "now": 1e9},
    "half a centre of mass": {"com_position": [0.0, 0.0]},
    "nan centre of mass": {"com_position": [math.nan, 0.0], "com_velocity": [0.0, 0.0]},
    "far centre of mass": {"com_position": [50.0, 0.0], "com_velocity": [0.0, 0.0]},
    "whole number too large": {"orientation": 10**400},
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_is_invalid_and_changes_nothing(plan, replanner, case):
    robot = Drifting(plan, 1.05 * plan.angular_momentum)
    for following in (0.1, 0.2, 0.3):
        replanner.update(*robot.state(replanner))
        robot.fly(replanner, following)
    names = ("t", "orientation", "orientation_rate", "positions", "velocities")
    good = dict(zip(names, robot.state(replanner), strict=True))
    wrong = {key: value(good[key]) if callable(value) else value for key, value in BAD[case].items()}
    before = replanner.motion
    correction = replanner.update(**{**good, **wrong})
    assert correction.status == "invalid"
    assert correction.reason
    assert correction.motion is replanner.motion is before
    after = replanner.update(**good)
    assert after.status == "applied"
    assert abs(after.predicted_miss) < 1e-3
    assert replanner.update(**good).status == "invalid"  # repeated
    assert replanner.update(**{**good, "t": 0.25, "now": 0.35}).status == "invalid"  # late


@pytest.mark.parametrize("speed", [0.95, 1.06])
def test_landing_time_follows_the_centre_of_mass(plan, replanner, speed):
    path = plan.ballistics
    place, velocity = path.position0.copy(), path.velocity0 * [1.0, speed]
    height = path.positions(np.array([plan.duration]))[0, 1]
    g, climb = path.gravity, height - place[1]
    landing = (velocity[1] + math.sqrt(velocity[1] ** 2 - 2 * g * climb)) / g
    robot = Drifting(plan, 1.05 * plan.angular_momentum)
    step = landing / 150
    for number in range(150):
        now = robot.time
        fall = np.array([0.0, g * now])
        com = {"com_position": place + now * (velocity - fall / 2), "com_velocity": velocity - fall}
        before = replanner.motion
        correction = replanner.update(*robot.state(replanner), **com)
        assert_continuous(before, correction.motion, now, 300.0)
        robot.fly(replanner, min((number + 1) * step, landing))
    assert correction.landing == pytest.approx(landing, abs=1e-6)
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.1)


@pytest.mark.parametrize("file", cases(FILES, LONG), ids=lambda file: file.stem)
def test_every_problem_from_any_instant_and_after_a_failure(file):
    problem = fp.load_problem(file)
    plan = forward_plan(problem, size=0.1)
    replanner = fp.Replanner(plan)
    rng = np.random.default_rng(5)
    low, high = problem.position_limits.T
    scale = 1 + float(np.abs(plan.at(np.linspace(0, plan.duration, 20)).accelerations).max())
    for begin in (0.0, 0.4 * plan.duration, 0.9 * plan.duration):
        replanner.reset()
        robot = Drifting(plan, 1.05 * plan.angular_momentum)
        if begin:
            robot.fly(replanner, begin, 200)
        for following in (begin + (plan.duration - begin) * np.array([0.05, 0.4, 0.95, 1.0])).tolist():
            state = robot.state(replanner)
            assert replanner.update(state[0], math.nan, *state[2:]).status == "invalid"
            before = replanner.motion
            noisy = (state[0], state[1] + 0.002 * rng.standard_normal(), *state[2:])
            correction = replanner.update(*noisy)
            assert correction.status in STATUSES
            assert_continuous(before, correction.motion, robot.time, scale)
            assert np.isfinite(correction.torque_peak).all()
            assert correction.torque_peak.shape == (len(problem.robot.motors),)
            positions = correction.motion.at(np.linspace(robot.time, plan.duration, 40))[0]
            assert (positions >= low - 1e-9).all()
            assert (positions <= high + 1e-9).all()
            robot.fly(replanner, following, 40)
        np.testing.assert_allclose(
            replanner.reference(plan.duration).positions, plan.problem.final.positions, atol=1e-8
        )
