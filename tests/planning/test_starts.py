"""Starts: the plain motion first, then seeded random ones that already meet the goal's orientation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count, islice, takewhile

import numpy as np
import pytest
from sampled_flight import sample_nodes, trajectory

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.kernel_problem import LEVEL_OF_DRAWS, MOTIONS_PER_VARIABLE
from floatplan.planning.options import SearchOptions
from floatplan.planning.result import AttemptResult
from floatplan.planning.search import Search

NODES = 96
NEAR_THE_GOAL = 0.2  # rad; a random motion is far from it


def starts_of(problem: fp.Problem, seed: int = 0) -> Iterator[AttemptResult]:
    """Where starts begin: no work may be done."""
    prepared = Search(problem, SearchOptions(seed))
    numbers = (range(number, number + 1) for number in count())
    return takewhile(bool, (prepared.follow_numbered(problem.degrees, [], each, lambda: True) for each in numbers))


def missed(problem: fp.Problem, start: AttemptResult) -> float:
    """By how much a start misses the goal's orientation, rad."""
    model = flight_of(problem)
    nodes = sample_nodes(gauss_grid(NODES), start.variables.polynomials.form)
    return abs(trajectory(model, start.variables, nodes, start.x).residual.item())


@pytest.fixture(scope="module")
def problem(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def obstructed(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "obstacle.toml")


def test_the_first_is_the_plain_motion(obstructed):
    first = next(starts_of(obstructed))
    assert first.x == pytest.approx(first.variables.plain_motion)


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
    _, drawn, *_ = islice(starts_of(obstructed), 3)
    measured = MOTIONS_PER_VARIABLE * drawn.variables.size * NODE_COUNTS[LEVEL_OF_DRAWS]
    assert drawn.work > measured * drawn.spec.flight.bodies > 0
    assert drawn.evaluations < 10


def test_with_a_free_momentum_plain_motions_take_turns(obstructed):
    free = replace(obstructed, flight=replace(obstructed.flight, angular_momentum="free"))
    some = list(islice(starts_of(free), 9))
    coefficients = some[0].variables.coefficients
    plain = [start for start in some if np.array_equal(start.x[:coefficients], some[0].x[:coefficients])]
    assert plain == some[:1] + some[1::2]
    momenta = [start.variables.angular_momentum(start.x).item() for start in plain]
    assert len({round(h, 9) for h in momenta}) == len(momenta)
    allowed = some[0].variables.momentum
    assert all(abs(h - allowed.centre.item()) <= allowed.axes.item() * (1 + 1e-12) for h in momenta)


def test_where_nothing_is_free_there_is_one(problem):
    settled = replace(problem, motion=fp.Motion(degree=5))
    assert len(list(starts_of(settled))) == 1
