"""Why no jump is found: what stands in the way is what was made too small."""

import re
from dataclasses import replace

import pytest
from jumps import backflip, go2_problem

import floatplan as fp
from floatplan.jumps import planner
from floatplan.jumps.conflicts import Conflict, elastic_conflicts, relaxed
from floatplan.jumps.setup import jump_setup

FEW_NODES = replace(planner.MARGINS, refinement=0.6)  # which take less time


@pytest.fixture
def at_leisure(monkeypatch):
    """What would help is tried to the end, however long the search before took."""
    monkeypatch.setattr(planner, "process_time", lambda: 0.0)


def weak():
    problem = go2_problem()
    share = 0.5
    own = zip(problem.robot.motors, problem.motor_torque_limits.tolist(), strict=True)
    return replace(problem, limits=replace(problem.limits, torque={name: share * most for name, most in own}))


def narrow():
    problem = go2_problem()
    ranges = (problem.initial.positions[:, None] + [-0.2, 0.2]).tolist()
    return replace(problem, limits=replace(problem.limits, position=ranges))


CASES = {  # weak or slippery alone: in test_jump.py and below
    "narrow": (narrow, fp.JumpRequest(), "range", 3),
    "weak and slippery": (weak, fp.JumpRequest(friction=0.1), "friction", 2),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_what_was_made_too_small_stands_in_the_way(name, monkeypatch):
    make, request, kind, most = CASES[name]
    monkeypatch.setattr("floatplan.jumps.program.ITERATIONS", 60)
    program = jump_setup(replace(make(), jump=request), request).program(FEW_NODES)
    timed = ("duration of (takeoff",) if request.takeoff.durations else ()
    gives = elastic_conflicts(program, program.solve(program.guess()), timed)
    assert kind in [each.kind for each in gives[:most]], gives


def test_a_limit_of_a_kind_that_nobody_relaxes_is_not_taken_for_a_distance():
    with pytest.raises(AssertionError, match="'height'"):
        relaxed(go2_problem(), [Conflict("height of base", "height", 0.1, 1.0)], 1.5)


@pytest.mark.long
@pytest.mark.usefixtures("at_leisure")
def test_a_search_that_finds_nothing_says_why(monkeypatch):
    monkeypatch.setattr("floatplan.jumps.program.ITERATIONS", 125)  # as many as find a jump where there is one
    monkeypatch.setattr(planner, "MARGINS", FEW_NODES)
    said = list[str]()
    answer = fp.jump(go2_problem(), fp.JumpRequest(friction=0.12), starts=1, near=backflip(), progress=said.append)
    assert not answer.ok
    found = re.search(
        r"In the way there: friction of .*: (\S+) needed, 0\.12 allowed.* Searching on: start 1 of 1", said[2]
    )
    assert found is not None, said
    assert float(found[1]) > 0.12
    found = re.search(
        r"In the way: friction of \w+_foot \(\w+ on [^)]*\): (\S+) needed, 0\.12 allowed"
        r".* With friction (\S+) a jump was found and checked\.",
        answer.explanation,
    )
    assert found is not None, answer.explanation
    needed, helps = map(float, found.groups())
    assert 0.12 < needed < helps
    assert fp.jump(go2_problem(), fp.JumpRequest(friction=helps), starts=1).ok
