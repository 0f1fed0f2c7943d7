"""What the kernel makes of a measurement: the filter's state, the rest of the flight, a step, and what it keeps."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flown_plans import Drifting, forward_plan
from long_cases import cases
from plain_problems import plain_problems
from update_reference import Present, Reference, filtered, step

import floatplan as fp
from floatplan.inflight import prediction, update
from floatplan.inflight.replanner import REACHED, Correction
from floatplan.kernel.tolerances import CORRECTION_GAINS
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.robot.urdf.tree import robots_folder

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
CHAINS = cases(range(8, 96, 14), range(36, 96, 14))


def limited(problem: fp.Problem, rng: np.random.Generator) -> fp.Problem:
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


def assert_foreseen(replanner: fp.Replanner, correction: Correction, rest: Reference) -> None:
    """What is said of a correction is so, evaluated anew; what the motion that it changes, ``rest``, keeps is kept."""
    there = replanner._update._judged(correction.motion)
    anew = Reference(replanner.views, there.motion, rest.present)
    assert there.miss == pytest.approx(anew.miss, rel=1e-9, abs=1e-10)
    np.testing.assert_allclose(there.worst, anew.worst, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(correction.torque_peak, anew.torque_peak, rtol=1e-8, atol=1e-8)
    assert (there.share == 0) == (correction.status == "refused")
    kept = anew.worst >= -CORRECTION_GAINS.kept * (1 + 1e-6)
    assert (correction.status == "applied") == (kept.all() and there.share == 1 and abs(there.miss) <= REACHED)
    assert (kept | (rest.worst < -CORRECTION_GAINS.kept * (1 - 1e-6))).all()
    if there.share == 0:
        np.testing.assert_allclose(there.motion.coefficients, rest.motion.coefficients, rtol=1e-9, atol=1e-10)
    elif there.share < 1:
        assert abs(there.miss) < abs(rest.miss)


def assert_right(plan: fp.Plan, replanner: fp.Replanner, seed: int) -> int:
    """Fly perturbed robots from several instants on; how often they were corrected."""
    return sum(flown(plan, replanner, begin, seed) for begin in (0.0, 0.6 * plan.duration))


def flown(plan: fp.Plan, replanner: fp.Replanner, begin: float, seed: int) -> int:
    """The same of one."""
    rng = np.random.default_rng(seed)
    replanner.reset()
    robot = Drifting(plan, float(rng.uniform(0.85, 1.15)) * plan.angular_momentum)
    if begin:
        robot.fly(replanner, begin, 60)
    path, corrected = plan.ballistics, 0
    for number, following in enumerate((begin + (plan.duration - begin) * np.arange(1, 8) / 7).tolist()):
        t, angle, rate, positions, velocities = robot.state(replanner)
        now = t + float(rng.choice([0.0, 0.2])) * (following - t)
        noise = 1e-3 * rng.standard_normal(2 + 2 * len(positions))
        n = len(positions)
        measured = [t, angle + noise[0], rate + noise[1], positions + noise[2 : n + 2], velocities + noise[n + 2 :]]
        if number == 4:  # invalid, or surprising
            measured[1 + number % 2] += float(rng.choice([0.3, math.nan, 10.0]))
        com = (None, None) if seed % 2 else (path.positions(np.array([t]))[0], path.velocities(np.array([t]))[0] * 1.02)
        robot.fly(replanner, now, 10)
        before = copy.copy(replanner)
        correction = replanner.update(*measured, now, *com)
        if correction.status == "invalid":
            assert replanner.motion is correction.motion
        else:
            rest = before._update.rewritten(now, correction.landing)
            if correction.landing == before.landing:
                times = np.linspace(now, correction.landing, 12)
                for old, new in zip(before.motion.at(times)[:2], rest.at(times)[:2], strict=True):
                    np.testing.assert_allclose(new, old, rtol=1e-8, atol=1e-8)
            present = Present.of(replanner, now)
            assert_foreseen(replanner, correction, Reference(replanner.views, rest, present))
            corrected += 1
        robot.fly(replanner, following, 40)
    return corrected


@pytest.mark.parametrize("number", CHAINS)
def test_limits_that_are_met(number: int) -> None:
    problem = limited(plain_problems(96)[number], np.random.default_rng(number))
    plan = forward_plan(problem, seed=number)
    replanner = fp.Replanner(plan)
    assert len(replanner.views.rows) >= 4
    assert assert_right(plan, replanner, number) >= 10


@pytest.mark.parametrize("seed", cases(range(2), [1]))
@pytest.mark.parametrize("name", ["falling_cat_apart", "somersault", "high_jump"])
def test_obstacles_that_move_and_come_and_go(name: str, seed: int) -> None:
    """Of every kind, some of them in the way."""
    problem = limited(fp.load_problem(PROBLEMS / f"{name}.toml"), np.random.default_rng(seed))
    rng, end = np.random.default_rng(seed), problem.flight.duration
    com = forward_plan(problem).ballistics.positions(np.array([0.4 * end, 0.6 * end]))
    circle = fp.Circle(center=tuple(com[0] + rng.normal(0, 0.3, 2)), radius=0.05, velocity=(0.5, -0.2), margin=0.01)
    bar = fp.Bar(start=tuple(com[1] + rng.normal(0, 0.3, 2)), end=tuple(com[1] + rng.normal(0, 0.6, 2)), radius=0.02)
    wall = fp.HalfPlane(point=tuple(com[1] - 0.4), normal=(1.0, 2.0), window=(0.3 * end, 0.35 * end))
    obstacles = (replace(circle, window=(0.41 * end, 0.42 * end)), bar, replace(bar, window=(0.0, 0.8 * end)), wall)
    plan = forward_plan(replace(problem, obstacles=obstacles), seed=seed)
    replanner = fp.Replanner(plan)
    assert assert_right(plan, replanner, seed) >= 8


@pytest.mark.parametrize("name", ["go2", "g1", "human"])
def test_limits_of_robots_with_coupled_and_locked_joints(name: str) -> None:
    """Without their obstacles."""
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    problem = fp.load_problem(PROBLEMS / "gallery" / f"{name}.toml")
    problem = limited(replace(problem, obstacles=(), self_clearances=(), ground=False), np.random.default_rng(4))
    plan = forward_plan(problem, size=0.3)
    replanner = fp.Replanner(plan)
    assert replanner.views.rows
    assert not replanner.views.has_distances
    assert assert_right(plan, replanner, 3) >= 10


@pytest.mark.parametrize("name", ["somersault", "handstand", "high_jump", "somersault_motors"])
def test_the_filter_is_a_kalman_filter_of_momentum_and_masses(name: str) -> None:
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


STEPPED = [
    "falling_cat_apart",
    "obstacle",
    "somersault_motors",
    "moving_hoop",
    "high_jump",
    "torque_limited",
    "handstand_ground",
]


@pytest.mark.parametrize("landed", [False, True])
@pytest.mark.parametrize("name", STEPPED)
def test_a_step_is_that_of_finite_differences(name: str, landed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a motion that is beyond its aims of every kind; as if it landed at the goal where that is far."""
    gains = replace(CORRECTION_GAINS, evaluations_far=1, far=0.0 if landed else math.inf, weighed=1e3)
    monkeypatch.setattr(update, "CORRECTION_GAINS", gains)
    monkeypatch.setattr(prediction, "SHARE_AIM", 0.8)
    problem = limited(fp.load_problem(PROBLEMS / f"{name}.toml"), np.random.default_rng(1))
    apart = tuple(replace(pair, margin=pair.margin + 0.25) for pair in problem.self_clearances)
    problem = replace(problem, self_clearances=apart)
    plan, sigma, acceleration = forward_plan(problem, size=0.3), 0.001, 0.01
    replanner = fp.Replanner(plan, sigma=sigma, acceleration=acceleration)
    begin = 0.3 * plan.duration
    replanner.reset()
    replanner._estimate.inertial.state[1] *= 1.05
    now = replanner._update
    orientation = float(plan.orientation(np.array([begin]))[0]) + 0.05
    replanner._estimate.inertial.state[0] = orientation
    rest = Reference(replanner.views, replanner.rest(begin), Present.of(replanner, begin))
    assert (rest.worst < [block.aim for block in replanner.views.rows]).sum() >= 4
    found = now.corrected(begin, plan.duration, 1)
    assert found.share == 1
    y = step(replanner, rest, sigma, acceleration, landed and replanner.views.has_distances)
    change = found.motion.coefficients[CONDITIONS:] - rest.motion.coefficients[CONDITIONS:]
    expected = replanner.views.whitening @ y / rest.motion.amplitude
    np.testing.assert_allclose(change, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
