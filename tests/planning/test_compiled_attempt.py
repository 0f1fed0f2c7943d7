"""Starts that the kernel follows end where the same search in Python ends, and motions are measured alike."""

from __future__ import annotations

import numpy as np
import pytest
from general_path import take_general_path

import floatplan as fp
from floatplan.planning.attempt import Attempts
from floatplan.planning.transcription import compiled_attempt
from floatplan.planning.transcription.compiled_attempt import BATCH_LEVEL, crossings
from floatplan.planning.transcription.constraints import applies
from floatplan.planning.transcription.trajectory import trajectory
from floatplan.robot.urdf.tree import PREFIX, robots_folder

NAMES = ("obstacle", "torque_limited", "moving_hoop", "handstand_ground", "gallery/solo", "gallery/bolt")
MOTIONS = 6


@pytest.fixture(params=NAMES)
def ready(request, root) -> Attempts:
    """Obstacles, some that move or are the ground, torques, rates, clearances of links, a free h, other objectives."""
    path = root / "problems" / f"{request.param}.toml"
    if PREFIX in path.read_text() and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    return Attempts(fp.load_problem(path), 0)


def test_a_start_ends_where_the_general_path_ends(ready, monkeypatch):
    compiled = ready.attempt(ready.plain_start)
    take_general_path(monkeypatch)
    general = Attempts(ready.problem, 0)
    assert general._compiled is None
    general = general.attempt(general.plain_start)
    assert (compiled.holds, compiled.solution.status) == (general.holds, general.solution.status)
    assert compiled.objective_value == pytest.approx(general.objective_value, rel=1e-6)
    assert ready.judge(compiled.variables, compiled.solution).violation == compiled.violation == 0


@pytest.mark.parametrize("reach", [0.5, 1.1, 1.6])
def test_where_a_start_ends_hangs_little_on_which_rows_are_differentiated(reach, root, monkeypatch):
    """A G1 whose rows contradict one another at first; it leads elsewhere where such steps are not solved exactly."""
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    monkeypatch.setattr(compiled_attempt, "REACH", reach)
    compiled_attempt._rules.cache_clear()
    g1 = Attempts(fp.load_problem(root / "problems" / "gallery" / "g1.toml"), 0)
    ended = g1.attempt(g1.plain_start)
    compiled_attempt._rules.cache_clear()
    assert ended.is_optimal
    assert ended.objective_value == pytest.approx(428.7169660, rel=1e-8)


def test_of_what_does_not_hold_both_judges_say_the_same(ready):
    """The plain motion as it is: no work may be done."""
    ended = ready.attempt(ready.plain_start, most_work=0)
    judged = ready.judge(ended.variables, ended.solution)
    assert judged.violation == pytest.approx(ended.violation, abs=1e-9)
    assert len(judged.worst.s) == len(ended.worst.s)
    assert np.sort(judged.worst.value) == pytest.approx(np.sort(ended.worst.value), abs=1e-7)


def test_starts_between_motions_are_those_of_python(ready):
    """The secant method between pairs, by the general path's evaluations."""
    model, kept, variables = ready.model, ready.constraints, ready.plain_start.variables
    drawn = ready.plain_start.x + 0.3 * np.random.default_rng(0).normal(size=(MOTIONS, variables.size))

    nodes = model.nodes(BATCH_LEVEL, variables.polynomials.form)

    def measured(motions):
        each = [trajectory(model, variables, nodes, x) for x in motions]
        squares = [
            [(np.minimum(block.values(at), 0) ** 2)[applies(block, at.sampling.grid.s)].sum() for block in kept]
            for at in each
        ]
        return np.array([at.residual[0] for at in each]), np.array(squares).sum(axis=1)

    missed, size = measured(drawn)[0], np.linalg.norm(drawn, axis=1)
    over, under = (np.flatnonzero(side)[np.argsort(size[side])] for side in (missed > 0, missed < 0))
    if len(over) and len(under):
        pairs = max(len(over), len(under))
        (low, high), (below, above) = ([of[np.resize(side, pairs)] for side in (over, under)] for of in (drawn, missed))
        for _ in range(2):
            share = np.clip(below / (below - above), 0.05, 0.95)[:, None]
            middle = low + share * (high - low)
            left, violations = measured(middle)
            is_over = left > 0
            low, below = np.where(is_over[:, None], middle, low), np.where(is_over, left, below)
            high, above = np.where(is_over[:, None], high, middle), np.where(is_over, above, left)
        expected = middle[np.argsort(violations + 1e-9 * np.linalg.norm(middle, axis=1))]
    else:
        expected = drawn[[np.argmin(np.abs(missed))]]
    found = crossings(model, kept, variables, drawn, steps=2, most=MOTIONS, apart=0.0)
    assert found == pytest.approx(expected, abs=1e-8)
