"""Whatever is measured, and whenever: no exception, a motion that goes on, and the way back to good measurements."""

import math
from decimal import Decimal

import numpy as np
import pytest
from flown_plans import Drifting

NAMES = ("t", "orientation", "orientation_rate", "positions", "velocities", "now", "com_position", "com_velocity")


class Raising:
    """What fails when it is read."""

    def __float__(self):
        raise RuntimeError

    def __array__(self, *_, **__):
        raise RuntimeError


def spoilt(good, rng):
    """Another value in the place of a good one: wrong, odd, or only a little off."""
    strange = [math.nan, math.inf, -math.inf, 1e308, -1e308, 1e-308, 10**400, None, "x", "", b"1", [], {}, (), True]
    strange += [1j, [1j, 2j], np.ma.masked, Decimal("sNaN"), Raising(), [[1.0, 2.0]], np.array([["a"]]), object()]
    kind = rng.integers(4)
    if kind == 0:
        return strange[rng.integers(len(strange))]
    if kind == 1 and good is not None:
        return np.asarray(good, dtype=float) + rng.standard_normal() * 10.0 ** rng.uniform(-6, 6)
    if kind == 2:
        return 10.0 ** rng.uniform(-300, 300) * rng.choice([-1.0, 1.0], 2)
    return good


def noisy(state, rng, angles=0.002):
    """A measurement with noise of its angles, rad, and ten times that, in 1/s, of its rates."""
    t, angle, rate, positions, velocities = state
    of_angles, of_rates = angles * rng.standard_normal(3), 10 * angles * rng.standard_normal(3)
    return t, angle + of_angles[0], rate + of_rates[0], positions + of_angles[1:], velocities + of_rates[1:]


@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
def test_hostile_calls(plan, replanner):
    """All through a flight; from single instants of every family below."""
    rng = np.random.default_rng(0)
    robot = Drifting(plan, 1.05 * plan.angular_momentum)
    path = plan.ballistics
    taken = 0
    for following in (plan.duration * np.arange(1, 91) / 90).tolist():
        now = np.array([robot.time])
        good = dict(
            zip(
                NAMES,
                (
                    *robot.state(replanner),
                    robot.time,
                    *(values[0] for values in (path.positions(now), path.velocities(now))),
                ),
                strict=True,
            )
        )
        for _ in range(4):
            bad = {name: spoilt(value, rng) if rng.random() < 0.3 else value for name, value in good.items()}
            before, landing = replanner.motion, replanner.landing
            correction = replanner.update(**bad)
            assert correction.status in ("applied", "limited", "refused", "invalid")
            if correction.status == "invalid":
                assert replanner.motion is before
                assert replanner.landing == landing
            reference = replanner.reference(robot.time)
            assert np.isfinite(reference.feedforward).all()
            assert math.isfinite(correction.predicted_miss)
        taken += replanner.update(**good).status != "invalid"
        robot.fly(replanner, following, 2)
    assert taken > 0


@pytest.mark.parametrize(("when", "kick"), [(0.3, 0.3), (0.6, 0.15), (0.3, 0.05), (0.2, -0.12)])
def test_a_kick_is_made_up_for(plan, replanner, when, kick):
    robot = Drifting(plan, plan.angular_momentum)
    rng = np.random.default_rng(0)
    kicked = False
    for following in (plan.duration * np.arange(1, 221) / 220).tolist():
        if robot.time >= when and not kicked:
            robot.momentum, kicked = robot.momentum * (1 + kick), True
        replanner.update(*noisy(robot.state(replanner), rng))
        robot.fly(replanner, following, 3)
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.2)


@pytest.mark.parametrize("turns", [-2, -1, 1])
def test_whole_turns_do_not_matter(plan, replanner, turns):
    robot = Drifting(plan, 1.1 * plan.angular_momentum)
    for following in (plan.duration * np.arange(1, 51) / 100).tolist():
        t, angle, *rest = robot.state(replanner)
        correction = replanner.update(t, angle + 2 * math.pi * turns, *rest)
        assert correction.status == "applied"
        robot.fly(replanner, following, 3)
    alone = Drifting(plan, 1.1 * plan.angular_momentum)
    alone.time, alone.orientation = robot.time, robot.orientation
    alone.fly(replanner, plan.duration, 400)
    assert alone.orientation - plan.problem.final.orientation == pytest.approx(correction.predicted_miss, abs=1e-3)


@pytest.mark.parametrize("size", [-0.5, -0.2, 0.2, 0.5])
def test_an_orientation_far_from_what_the_filter_knows_is_an_outlier(plan, replanner, size):
    """One of ten: each is refused, and no other; the flight lands as without them."""
    robot, rng = Drifting(plan, 1.1 * plan.angular_momentum), np.random.default_rng(2)
    for number, following in enumerate((plan.duration * np.arange(1, 201) / 200).tolist()):
        t, angle, *others = noisy(robot.state(replanner), rng)
        outlier = number % 10 == 4
        correction = replanner.update(t, angle + outlier * size, *others)
        assert (correction.status == "invalid") == outlier
        robot.fly(replanner, following, 3)
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.3)


@pytest.mark.parametrize("degrees", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("error", [-0.15, 0.15])
def test_honest_measurements_are_not_refused(plan, replanner, degrees, error):
    """Noise, another momentum, late measurements: at most one in two hundred is invalid."""
    robot, rng = Drifting(plan, (1 + error) * plan.angular_momentum), np.random.default_rng(7)
    statuses = []
    waiting = ()
    for following in (plan.duration * np.arange(1, 221) / 220).tolist():
        if waiting:
            statuses.append(replanner.update(*waiting, now=robot.time).status)
        waiting = noisy(robot.state(replanner), rng, math.radians(degrees))
        robot.fly(replanner, following, 5)
    assert statuses.count("invalid") <= len(statuses) / 200
