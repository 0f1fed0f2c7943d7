"""Starts: the plain motion first, then seeded random ones that already meet the goal's orientation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count, islice, takewhile

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.planar.flight import gauss_grid
from floatplan.planning.attempt import Attempts
from floatplan.planning.starts import Start
from floatplan.planning.transcription.trajectory import flight_model, sample_nodes, trajectory

NODES = 96
NEAR_THE_GOAL = 0.2  # rad; a random motion is far from it


def starts_of(problem: fp.Problem, seed: int = 0) -> Iterator[Start]:
    prepared = Attempts(problem, seed)
    return takewhile(bool, (prepared.start(problem.degrees, number) for number in count()))


def missed(problem: fp.Problem, start: Start) -> float:
    """By how much a start misses the goal's orientation, rad."""
    model = flight_model(problem)
    nodes = sample_nodes(gauss_grid(NODES), start.variables.polynomials.form)
    return abs(trajectory(model, start.variables, nodes, start.x).residual.item())


@pytest.fixture(scope="module")
def problem(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def obstructed(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "obstacle.toml")


def test_the_first_is_the_plain_motion(problem):
    first, *others = islice(starts_of(problem), 5)
    assert first.at_once
    assert first.x == pytest.approx(first.variables.plain_motion())
    assert not any(start.at_once for start in others)


def test_random_ones_turn_just_enough(problem):
    """Where the kernel's starts are not followed."""
    problem = replace(problem, motion=fp.Motion(objective="torque"))
    drawn = list(islice(starts_of(problem), 1, 7))
    errors = [missed(problem, start) for start in drawn]
    assert np.median(errors) < NEAR_THE_GOAL
    assert np.median(errors) < missed(problem, next(starts_of(problem)))


def test_a_seed_settles_them(obstructed):
    first, same, other = (list(islice(starts_of(obstructed, seed), 1, 5)) for seed in (3, 3, 4))
    assert [start.x.tobytes() for start in first] == [start.x.tobytes() for start in same]
    assert [start.x.tobytes() for start in first] != [start.x.tobytes() for start in other]


def test_drawing_counts_as_work(obstructed):
    prepared = Attempts(obstructed, 0)
    assert prepared.plain_start.work == 0
    before = prepared.model.work
    assert prepared.start(obstructed.degrees, 1).work == prepared.model.work - before > 0


def test_with_a_free_momentum_plain_motions_take_turns(obstructed):
    free = replace(obstructed, flight=replace(obstructed.flight, angular_momentum="free"))
    some = list(islice(starts_of(free), 9))
    assert [start.at_once for start in some] == [True, *[True, False] * 4]
    momenta = [start.variables.angular_momentum(start.x).item() for start in some if start.at_once]
    assert len({round(h, 9) for h in momenta}) == len(momenta)
    allowed = some[0].variables.momentum
    assert all(abs(h - allowed.centre.item()) <= allowed.axes.item() * (1 + 1e-12) for h in momenta)


def test_where_nothing_is_free_there_is_one(problem):
    settled = replace(problem, motion=fp.Motion(degree=5))
    assert len(list(starts_of(settled))) == 1
