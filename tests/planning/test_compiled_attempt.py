"""Starts that the kernel follows end where the same search in Python ends, and motions are measured alike."""

from __future__ import annotations

import numpy as np
import pytest

import floatplan as fp
from floatplan.planning import starts
from floatplan.planning.attempt import Attempts, Outcome
from floatplan.planning.transcription.compiled_attempt import measured
from floatplan.planning.transcription.trajectory import trajectories
from floatplan.robot.urdf.tree import PREFIX, robots_folder

NAMES = ("obstacle", "torque_limited", "moving_hoop", "handstand_ground", "gallery/solo", "gallery/bolt")
LEVEL = 2  # of grids
MOTIONS = 6


@pytest.fixture(params=NAMES)
def ready(request, root) -> Attempts:
    """Obstacles, some that move or are the ground, torques, rates, clearances of links, a free h, other objectives."""
    path = root / "problems" / f"{request.param}.toml"
    if PREFIX in path.read_text() and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    return Attempts(fp.load_problem(path), 0)


def in_python(ready: Attempts) -> Outcome:
    ready._compiled = None
    return ready.attempt(ready.plain_start)


def test_a_start_ends_where_python_ends(ready):
    compiled = ready.attempt(ready.plain_start)
    general = in_python(ready)
    assert (compiled.holds, compiled.solution.status) == (general.holds, general.solution.status)
    assert compiled.objective_value == pytest.approx(general.objective_value, rel=1e-6)
    assert ready.judge(compiled.variables, compiled.solution).violation == compiled.violation == 0


def test_of_what_does_not_hold_both_judges_say_the_same(ready):
    """The plain motion as it is: no work may be done."""
    ended = ready.attempt(ready.plain_start, most_work=0)
    judged = ready.judge(ended.variables, ended.solution)
    assert judged.violation == pytest.approx(ended.violation, abs=1e-9)
    assert len(judged.worst.s) == len(ended.worst.s)
    assert np.sort(judged.worst.value) == pytest.approx(np.sort(ended.worst.value), abs=1e-7)


def test_random_motions_are_measured_as_in_python(ready):
    variables, rng = ready.plain_start.variables, np.random.default_rng(0)
    x = ready.plain_start.x + 0.3 * rng.normal(size=(MOTIONS, variables.size))
    together = trajectories(ready.model, variables, LEVEL, x)
    found = measured(ready.model, ready.constraints, variables, x, LEVEL, True)
    assert found is not None
    missed, violations = found
    assert missed == pytest.approx(together.residual[:, 0], abs=1e-9)
    assert violations == pytest.approx(starts._violations(together, ready.constraints, MOTIONS), rel=1e-7, abs=1e-12)
