"""Corrections of flights in space: continuous, to the goal's attitude, foreseen as they come; nothing stops them."""

import copy
import math
import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from flown_plans import DriftingInSpace

import floatplan as fp
from floatplan.inflight import authority as authority_module
from floatplan.inflight import prediction, update
from floatplan.kernel.tolerances import CORRECTION_OPTIONS_IN_SPACE
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import flight_of
from floatplan.planning.constraints import LENGTH_SCALE


@pytest.fixture(scope="module")
def diver(planned):
    return planned("space/diver_half_twist")


@pytest.fixture(scope="module")
def go2(planned):
    return planned("space/go2_barrel_roll")


@pytest.fixture(scope="module")
def bar(planned):
    return planned("space/diver_past_a_bar")


@pytest.fixture(scope="module")
def of_diver(diver):
    return fp.Replanner(diver)


@pytest.fixture(scope="module")
def of_go2(go2):
    return fp.Replanner(go2)


@pytest.fixture
def replanner(of_diver):
    of_diver.reset()
    return of_diver


def instants(plan, count):
    return (plan.duration * np.arange(1, count + 1) / count).tolist()


@pytest.mark.parametrize("error", [-0.1, 0.1])
def test_a_go2_lands_from_another_momentum(go2, of_go2, error):
    of_go2.reset()
    robot = DriftingInSpace(go2, go2.angular_momentum * (1 + error))
    for following in instants(go2, 50):
        before = of_go2.motion
        correction = of_go2.update(*robot.state(of_go2))
        assert correction.status == "applied"
        for old, new in zip(before.at(robot.time), correction.motion.at(robot.time), strict=True):
            np.testing.assert_allclose(new, old, rtol=1e-9, atol=1e-6)
        robot.fly(of_go2, following)
    assert np.linalg.norm(robot.off) < math.radians(0.02)
    np.testing.assert_allclose(of_go2.motion.at(go2.duration)[0][0], go2.problem.final.positions, atol=1e-9)
    np.testing.assert_allclose(correction.angular_momentum, robot.momentum, rtol=0, atol=2e-3)
    alone = DriftingInSpace(go2, robot.momentum)
    of_go2.reset()
    alone.fly(of_go2, go2.duration)
    assert np.linalg.norm(alone.off) > math.radians(20)


def test_an_undisturbed_flight_stays_the_plan(diver, replanner):
    robot = DriftingInSpace(diver, np.asarray(diver.angular_momentum))
    for following in instants(diver, 40):
        assert replanner.update(*robot.state(replanner)).status == "applied"
        robot.fly(replanner, following)
    late = diver.duration - 0.02
    assert np.abs(replanner.motion.at(late)[0][0] - diver.at(late).positions).max() < 1e-3
    assert np.linalg.norm(robot.off) < 1e-4


def test_reference_is_the_plan_before_anything_is_measured(diver, replanner):
    state, reference = diver.at(0.0), replanner.reference(0.0)
    np.testing.assert_allclose(reference.feedforward, state.torques, rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(reference.motors, state.motor_torques, rtol=1e-7, atol=1e-6)
    for time in np.linspace(0.0, diver.duration, 7):
        state, reference = diver.at(time), replanner.reference(float(time))
        for name in ("positions", "velocities", "accelerations"):
            np.testing.assert_allclose(getattr(reference, name), getattr(state, name), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("begin", [0.0, 0.3, 0.7])
def test_what_is_foreseen_is_what_an_integration_finds(diver, replanner, begin):
    """Of the robot that the filter has found, by Pinocchio and DOP853; errors of h about all axes."""
    turned = pin.exp3(np.array([0.02, -0.03, 0.01]))
    robot = DriftingInSpace(diver, np.asarray(diver.angular_momentum) * 0.97 + [0.5, 0.2, -0.4])
    if begin:
        robot.fly(replanner, begin * diver.duration)
    robot.attitude = turned @ robot.attitude
    for following in begin * diver.duration + np.array([0.02, 0.05, 0.09]):
        correction = replanner.update(*robot.state(replanner))
        assert correction.status in ("applied", "limited")
        now = robot.time
        robot.fly(replanner, float(following))
    found = replanner._estimate.inertial
    foreseen = DriftingInSpace(diver, found.angular_momentum, found.errors)
    foreseen.time, foreseen.attitude = now, replanner._update.turned @ found.orientation
    foreseen.fly(replanner, diver.duration, 1e-11)
    np.testing.assert_allclose(foreseen.off, correction.predicted_miss, rtol=0, atol=1e-6)


def limited(plan):
    """The plan with limits that its motion comes near to."""
    rate = float(np.linalg.norm(plan.at(np.linspace(0, plan.duration, 50)).orientation_rate, axis=1).max())
    peaks = plan.peaks
    limits = fp.Limits(
        torque=1.2 * float(np.max(peaks.motor_torque)),
        velocity=1.2 * float(np.max(peaks.velocity)),
        orientation_rate=1.2 * rate,
    )
    return replace(plan, problem=replace(plan.problem, limits=limits))


@pytest.mark.parametrize("name", ["diver", "go2", "bar"])
def test_a_step_is_that_of_finite_differences(name, request, monkeypatch):
    """Of the miss, and of rows beyond their aims: of torques, rates and distances."""
    gains = replace(CORRECTION_OPTIONS_IN_SPACE, evaluations_far=1, far=math.inf, most_rows=1000, weighed=1e3)
    monkeypatch.setattr(update, "CORRECTION_OPTIONS_IN_SPACE", gains)
    monkeypatch.setattr(prediction, "SHARE_AIM", 0.8)
    monkeypatch.setattr(prediction, "DISTANCE_AIM", 2.0)
    plan = limited(request.getfixturevalue(name))
    sigma, acceleration = 0.01, 0.02
    replanner = fp.Replanner(plan, sigma=sigma, acceleration=acceleration)
    views, now = replanner.views, replanner._update
    replanner.reset()
    replanner._estimate.inertial.state[3:6] *= 1.01
    begin = 0.2 * plan.duration
    rest = replanner.rest(begin)
    shape = (len(rest.coefficients) - CONDITIONS, len(rest.amplitude))

    def looked_at(y):
        coefficients = rest.coefficients.copy()
        coefficients[CONDITIONS:] += views.whitening @ y.reshape(shape) / rest.amplitude
        miss = now.predicted(replace(rest, coefficients=coefficients)).miss
        return miss, now.row_values.copy()

    miss, values = looked_at(np.zeros(shape[0] * shape[1]))
    first = now._block_first
    aims = np.repeat([rows.aim for rows in views.rows], np.diff(first))[:, None] + np.zeros_like(values)
    softness = np.repeat([rows.softness for rows in views.rows], np.diff(first))[:, None] + np.zeros_like(values)
    near = values < aims
    assert [near[begin:end].any() for begin, end in pairwise(first)] == [True] * len(views.rows)
    scale = np.concatenate((np.full(3, max(sigma, np.linalg.norm(miss) / gains.weighed)), softness[near]))
    residual = np.concatenate((miss, (values - aims)[near])) / scale
    columns = []
    for unit in np.eye(shape[0] * shape[1]):
        (ahead, above), (back, below) = looked_at(1e-5 * unit), looked_at(-1e-5 * unit)
        columns.append(np.concatenate((ahead - back, above[near] - below[near])) / (2e-5 * scale))
    jacobian = np.transpose(columns)
    stiffness = 1 / (acceleration * rest.remaining**2) ** 2
    y = -np.linalg.solve(jacobian.T @ jacobian + stiffness * np.eye(len(columns)), jacobian.T @ residual)
    expected = views.whitening @ y.reshape(shape) / rest.amplitude
    found = now.corrected(begin, plan.duration, 1)
    change = found.motion.coefficients[CONDITIONS:] - rest.coefficients[CONDITIONS:]
    assert np.abs(change).max() > 0
    np.testing.assert_allclose(change, expected, rtol=0, atol=2e-5 * np.abs(expected).max())


def test_distances_are_those_of_the_plan(bar):
    replanner, begin = fp.Replanner(bar), 0.3 * bar.duration
    now = replanner._update
    now.estimate.inertial.attitude[:] = pin.Quaternion(bar.at(begin).orientation).matrix()
    now.predicted(replanner.rest(begin))
    motion = flight_of(bar.problem).whole_motion(bar._written, bar.angular_momentum, bar.ballistics)
    segments = motion.segments(now.times)
    for obstacle, (low, high) in zip(bar.problem.obstacles, pairwise(now._block_first), strict=False):
        expected = segments.distances(obstacle, now.times).T
        found = obstacle.margin + LENGTH_SCALE * now.row_values[low:high]
        exists = np.isfinite(found)
        assert exists.any()
        np.testing.assert_allclose(found[exists], expected[exists], rtol=0, atol=1e-6)


def test_momentum_and_masses_are_found(diver, replanner):
    """With noise, of a robot of other masses: how the base turns is then foreseen, which the plan's masses do not."""
    rng = np.random.default_rng(3)
    bodies = len(replanner._estimate.inertial.errors) // 2
    errors = 0.05 * rng.choice((-1.0, 1.0), 2 * bodies)
    robot = DriftingInSpace(diver, np.asarray(diver.angular_momentum) * 1.03 + [0.6, 0.0, -0.3], errors)
    for following in instants(diver, 140)[:100]:
        time, quaternion, rate, positions, velocities = robot.state(replanner)
        noisy = pin.Quaternion(pin.Quaternion(quaternion).matrix() @ pin.exp3(0.001 * rng.standard_normal(3)))
        rate = rate + 0.01 * rng.standard_normal(3)
        assert replanner.update(time, noisy.coeffs(), rate, positions, velocities).status != "invalid"
        robot.fly(replanner, following)
    found, ends = replanner._estimate.inertial, []
    for momentum, masses in (
        (robot.momentum, errors),
        (found.angular_momentum, found.errors),
        (np.asarray(diver.angular_momentum), None),
    ):
        real = DriftingInSpace(diver, momentum, masses)
        real.time, real.attitude = robot.time, robot.attitude
        real.fly(replanner, robot.time + 0.2)
        ends.append(real.attitude)
    off, off_of_plan = (np.linalg.norm(pin.log3(end.T @ ends[0])) for end in ends[1:])
    assert off < 0.01 < 3 * off < off_of_plan


BAD = {
    "nan": {"orientation": [math.nan, 0.0, 0.0, 1.0]},
    "an angle": {"orientation": 0.3},
    "no rotation": {"orientation": [0.0, 0.0, 0.0, 0.0]},
    "not a unit": {"orientation": [0.0, 0.0, 0.0, 2.0]},
    "a matrix": {"orientation": np.eye(3)},
    "text": {"orientation": "up"},
    "scalar first": {"orientation": lambda value: np.roll(value, 1)},
    "from the world to the base": {"orientation": lambda value: value * [-1, -1, -1, 1]},
    "far off": {"orientation": lambda value: np.array([value[3], -value[2], value[1], -value[0]])},
    "one rate": {"orientation_rate": 1.0},
    "rate jump": {"orientation_rate": lambda value: value + 200.0},
    "joint jump": {"positions": lambda value: value + 2.0},
    "joints in degrees": {"positions": np.degrees, "velocities": np.degrees},
    "com of a plane": {"com_position": [0.0, 0.0], "com_velocity": [0.0, 0.0]},
}
WORDS = {"scalar first": "w, x, y, z", "from the world to the base": "conjugate", "joints in degrees": "degrees"}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_is_invalid_and_changes_nothing(diver, replanner, case):
    robot = DriftingInSpace(diver, np.asarray(diver.angular_momentum) * 1.01)
    for following in (0.1, 0.2, 0.3):
        replanner.update(*robot.state(replanner))
        robot.fly(replanner, following)
    names = ("t", "orientation", "orientation_rate", "positions", "velocities")
    good = dict(zip(names, robot.state(replanner), strict=True))
    wrong = {key: value(good[key]) if callable(value) else value for key, value in BAD[case].items()}
    before = replanner.motion
    correction = replanner.update(**{**good, **wrong})
    assert correction.status == "invalid"
    assert WORDS.get(case, "") in correction.reason
    assert correction.motion is replanner.motion is before
    opposite = {**good, "orientation": -good["orientation"]}  # the same attitude
    assert replanner.update(**opposite).status != "invalid"


def test_copies_go_on_alike(diver, replanner):
    robot = DriftingInSpace(diver, np.asarray(diver.angular_momentum) * 0.98)
    for following in (0.05, 0.1):
        replanner.update(*robot.state(replanner))
        robot.fly(replanner, following)
    others = copy.copy(replanner), pickle.loads(pickle.dumps(replanner))
    state = robot.state(replanner)
    own = replanner.update(*state).motion.coefficients
    for other in others:
        np.testing.assert_array_equal(other.update(*state).motion.coefficients, own)


def test_the_landing_follows_the_centre_of_mass(diver, replanner):
    path, robot = diver.ballistics, DriftingInSpace(diver, np.asarray(diver.angular_momentum))
    higher = replace(path, velocity0=path.velocity0 * [1.0, 1.0, 1.02])
    height = path.positions(np.array([diver.duration]))[0, 2]
    climb, speed = height - path.position0[2], higher.velocity0[2]
    landing = (speed + math.sqrt(speed**2 - 2 * path.gravity * climb)) / path.gravity
    for number in range(1, 60):
        time = np.array([robot.time])
        com = {"com_position": higher.positions(time)[0], "com_velocity": higher.velocities(time)[0]}
        correction = replanner.update(*robot.state(replanner), **com)
        robot.fly(replanner, landing * number / 60)
    assert correction.landing == pytest.approx(landing, abs=1e-6)


@pytest.mark.long
def test_authority_has_three_momenta(diver, monkeypatch):
    monkeypatch.setattr(authority_module, "LARGEST", 0.01)
    monkeypatch.setattr(authority_module, "SHARES", (0.0, 0.9))
    found = fp.authority(diver)
    assert found.momentum.shape == (2, 3, 2)
    assert found.inertia.shape == (2, 2)
    assert (found.momentum[0] == [-0.01, 0.01]).all()
    assert (np.abs(found.momentum[1]) < 0.01).any()
    assert found.until(0.01) == 0.0
    assert found.to_dict()["momentum"] == found.momentum.tolist()


def test_corrections_keep_further_off_the_ground_than_off_a_wall(go2):
    """Of a plan that comes as near as it may: feet that follow late would catch on the ground, which is level."""
    window = (0.4 * go2.duration, 0.6 * go2.duration)
    kept = []
    for tilt in (0.0, 1e-3):
        deep = fp.HalfSpace(point=(0.0, 0.0, -10.0), normal=(tilt, 0.0, 1.0), window=window)
        above = float(go2.clearances(np.linspace(*window, 50), [deep]).min())
        touching = replace(deep, point=(0.0, 0.0, above - 10.0))
        plan = replace(go2, problem=replace(go2.problem, obstacles=(touching,)))
        replanner = fp.Replanner(plan)
        robot = DriftingInSpace(plan, np.asarray(plan.angular_momentum) * 1.01)
        for following in instants(plan, 40)[:12]:
            correction = replanner.update(*robot.state(replanner))
            robot.fly(replanner, following)
        assert np.linalg.norm(correction.predicted_miss) < math.radians(0.1)
        kept.append(replanner._update.predicted(correction.motion).worst[0])
    off_ground, off_wall = kept
    assert off_ground > 1.3 * off_wall > 0.0
