"""Corrections of the kernel are those of NumPy: one table of flights through both."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flown_plans import Drifting, forward_plan
from general_path import take_general_path
from plain_problems import plain_problems

import floatplan as fp
from floatplan.inflight import outlook
from floatplan.inflight.compiled import CompiledReckoning
from floatplan.inflight.reckoning import Reckoning
from floatplan.robot.urdf.example_robots import robots_folder

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
FILES = sorted(PROBLEMS.glob("*.toml")) + sorted(PROBLEMS.glob("gallery/*.toml"))
CHAINS = range(8, 96, 14)


def pair(plan: fp.Plan, monkeypatch: pytest.MonkeyPatch) -> list[fp.Replanner]:
    """Return two replanners, the first in NumPy, the second compiled."""
    with monkeypatch.context() as context:
        take_general_path(context)
        general = fp.Replanner(plan)
    found = [general, fp.Replanner(plan)]
    assert [type(each._reckoning) for each in found] == [Reckoning, CompiledReckoning]
    return found


def limited(problem: fp.Problem, rng: np.random.Generator) -> fp.Problem:
    """Return a problem with limits of every kind, some of which a correction meets."""
    wild = forward_plan(problem, size=0.3)
    peaks = wild.peaks
    limits = {
        "torque": float(np.max(peaks.motor_torque)) * float(rng.uniform(0.8, 1.2)),
        "velocity": float(np.max(peaks.velocity)) * float(rng.uniform(0.8, 1.2)),
        "acceleration": float(peaks.joints["acceleration"].max()) * float(rng.uniform(0.8, 1.2)),
        "orientation_rate": float(np.abs(wild.at(np.linspace(0, wild.duration, 50)).orientation_rate).max()) * 1.02,
    }
    return replace(problem, limits=replace(problem.limits, **limits))


def assert_same(plan: fp.Plan, both: list[fp.Replanner], seed: int) -> int:
    """Fly perturbed robots from several instants on, whose measurements both take in; how often they corrected."""
    return sum(flown_alike(plan, both, begin, seed) for begin in (0.0, 0.6 * plan.duration))


def flown_alike(plan: fp.Plan, both: list[fp.Replanner], begin: float, seed: int) -> int:
    """The same of one."""
    rng = np.random.default_rng(seed)
    for replanner in both:
        replanner.reset()
    robot = Drifting(plan, float(rng.uniform(0.85, 1.15)) * plan.angular_momentum)
    if begin:
        robot.fly(both[0], begin, 60)
    path, compared = plan.ballistics, 0
    for number, following in enumerate((begin + (plan.duration - begin) * np.arange(1, 8) / 7).tolist()):
        t, angle, rate, positions, velocities = robot.state(both[0])
        now = t + float(rng.choice([0.0, 0.2])) * (following - t)
        noise = 1e-3 * rng.standard_normal(2 + 2 * len(positions))
        n = len(positions)
        measured = [t, angle + noise[0], rate + noise[1], positions + noise[2 : n + 2], velocities + noise[n + 2 :]]
        if number == 4:  # invalid, or surprising
            measured[1 + number % 2] += float(rng.choice([0.3, math.nan, 10.0]))
        com = (None, None) if seed % 2 else (path.positions(np.array([t]))[0], path.velocities(np.array([t]))[0] * 1.02)
        robot.fly(both[0], now, 10)
        here, there = (replanner.update(*measured, now, *com) for replanner in both)
        assert (there.status, there.reason) == (here.status, here.reason)
        for name in ("predicted_miss", "landing", "angular_momentum"):
            assert getattr(there, name) == pytest.approx(getattr(here, name), rel=1e-9, abs=1e-9), name
        largest = 1 + float(here.torque_peak.max())
        np.testing.assert_allclose(there.torque_peak, here.torque_peak, rtol=0, atol=1e-7 * largest)  # as 1 / tau^2
        rest = np.linspace(now, here.landing, 12)
        np.testing.assert_allclose(there.motion.at(rest)[0], here.motion.at(rest)[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(there.foreseen.worst, here.foreseen.worst, rtol=1e-8, atol=1e-8)
        assert there.predicted_miss == pytest.approx(there.foreseen.outlook.miss, rel=1e-9, abs=1e-11)
        compared += here.status != "invalid"
        robot.fly(both[0], following, 40)
    return compared


@pytest.mark.parametrize("number", CHAINS)
def test_chains_and_trees(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mirrored planes and coupled joints among them."""
    plan = forward_plan(plain_problems(96)[number], seed=number)
    assert assert_same(plan, pair(plan, monkeypatch), number) >= 10


@pytest.mark.parametrize("number", CHAINS)
def test_limits_that_are_met(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = limited(plain_problems(96)[number], np.random.default_rng(number))
    plan = forward_plan(problem, seed=number)
    both = pair(plan, monkeypatch)
    assert len(both[0].views.rows) >= 4
    assert assert_same(plan, both, number) >= 10


@pytest.mark.parametrize("watched", [41, 43])
def test_any_number_of_instants(watched: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outlook, "WATCHED", watched)
    plan = forward_plan(limited(plain_problems(96)[8], np.random.default_rng(8)), seed=8)
    both = pair(plan, monkeypatch)
    assert len(both[0].views.instants.watched) >= watched
    assert assert_same(plan, both, 8) >= 10


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_problem(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if file.parent.name == "gallery" and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    plan = forward_plan(fp.load_problem(file), size=0.1)
    both = pair(plan, monkeypatch)
    assert assert_same(plan, both, 1) >= 10


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", ["falling_cat_apart", "somersault", "high_jump"])
def test_obstacles_that_move_and_come_and_go(name: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every kind, some of them in the way."""
    problem = limited(fp.load_problem(PROBLEMS / f"{name}.toml"), np.random.default_rng(seed))
    rng, end = np.random.default_rng(seed), problem.flight.duration
    com = forward_plan(problem).ballistics.positions(np.array([0.4 * end, 0.6 * end]))
    circle = fp.Circle(center=tuple(com[0] + rng.normal(0, 0.3, 2)), radius=0.05, velocity=(0.5, -0.2), margin=0.01)
    bar = fp.Bar(start=tuple(com[1] + rng.normal(0, 0.3, 2)), end=tuple(com[1] + rng.normal(0, 0.6, 2)), radius=0.02)
    wall = fp.HalfPlane(point=tuple(com[1] - 0.4), normal=(1.0, 2.0), window=(0.3 * end, 0.35 * end))
    obstacles = (replace(circle, window=(0.41 * end, 0.42 * end)), bar, replace(bar, window=(0.0, 0.8 * end)), wall)
    plan = forward_plan(replace(problem, obstacles=obstacles), seed=seed)
    both = pair(plan, monkeypatch)
    assert assert_same(plan, both, seed) >= 8


@pytest.mark.parametrize("name", ["go2", "g1", "human"])
def test_limits_of_robots_with_coupled_and_locked_joints(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without their obstacles."""
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    problem = fp.load_problem(PROBLEMS / "gallery" / f"{name}.toml")
    problem = limited(replace(problem, obstacles=(), self_clearances=(), ground=False), np.random.default_rng(4))
    plan = forward_plan(problem, size=0.3)
    both = pair(plan, monkeypatch)
    assert both[0].views.rows
    assert not both[0].views.has_distances
    assert assert_same(plan, both, 3) >= 10
