"""Why no jump is found: what stands in the way is what was made too small."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from jumps import INSTALLED, backflip, go2_problem
from needed import skip_or_fail

import floatplan as fp
from floatplan.jumps import planner
from floatplan.jumps.conflicts import Conflict, conflict_sentence, elastic_conflicts, kind_of, relaxed
from floatplan.jumps.planner import MARGINS
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.setup import jump_setup

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")

SIDE = "takeoff on RL_foot"


@pytest.fixture
def at_leisure(monkeypatch: pytest.MonkeyPatch) -> None:
    """What would help is tried to the end, however long the search before took."""
    monkeypatch.setattr(planner, "process_time", lambda: 0.0)


def weak(share: float) -> fp.Problem:
    problem = go2_problem()
    own = zip(problem.robot.motors, problem.motor_torque_limits.tolist(), strict=True)
    return replace(problem, limits=replace(problem.limits, torque={name: share * most for name, most in own}))


def narrow() -> fp.Problem:
    problem = go2_problem()
    ranges = (problem.initial.positions[:, None] + [-0.2, 0.2]).tolist()
    return replace(problem, limits=replace(problem.limits, position=ranges))


HURRIED = fp.JumpTakeoff(durations=[[0.05, 0.1], [0.03, 0.06]])
CASES = {
    "weak": (weak(0.5), fp.JumpRequest(), "torque", 1),
    "weaker": (weak(0.35), fp.JumpRequest(), "torque", 1),
    "slippery": (go2_problem(), fp.JumpRequest(friction=0.1), "friction", 1),
    "narrow": (narrow(), fp.JumpRequest(), "range", 3),
    "weak and slippery": (weak(0.5), fp.JumpRequest(friction=0.1), "friction", 2),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_what_was_made_too_small_stands_in_the_way(name: str) -> None:
    problem, request, kind, most = CASES[name]
    program = jump_setup(replace(problem, jump=request), request).program(MARGINS, iterations=60)
    timed = ("duration of (takeoff",) if request.takeoff.durations else ()
    gives = elastic_conflicts(program, program.solve(program.guess()), timed)
    assert kind in [each.kind for each in gives[:most]], gives


@pytest.mark.long
def test_nothing_stands_in_the_way_of_what_is_found() -> None:
    program = jump_setup(go2_problem(), fp.JumpRequest()).program(MARGINS)
    assert elastic_conflicts(program, program.solve(program.guess())) == []


@pytest.mark.long
@pytest.mark.usefixtures("at_leisure")
def test_a_search_that_finds_nothing_says_why() -> None:
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


@pytest.mark.long
@pytest.mark.usefixtures("at_leisure")
def test_limits_that_are_broken_between_nodes_are_tried_too() -> None:
    answer = fp.jump(go2_problem(), fp.JumpRequest(friction=0.2), starts=1)
    found = re.fullmatch(
        r"Between .*friction is .*, 0\.2 at most\. With friction (\S+) a jump .* checked\.", answer.explanation
    )
    assert found is not None, answer.explanation
    assert fp.jump(go2_problem(), fp.JumpRequest(friction=float(found[1])), starts=1).ok


def test_what_is_in_the_way_near_a_jump_at_hand_is_said_while_the_search_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As it is found there, from there; elsewhere it may be another, which is what the answer says."""
    found, begun = backflip(), list[bool]()

    def given(program: JumpProgram, _: object, __: object, guess: np.ndarray | None = None) -> list[Conflict]:
        begun.append(guess is not None and bool(np.abs(guess - program.guess()).max() > 0.1))
        return [Conflict("friction of RL_foot (flight)", "friction", 0.5, 1.0)] if begun[-1] else []

    ended = SimpleNamespace(converged=False, shortfall=np.inf, worst=(1.0, "parabola"), iterations=9)
    monkeypatch.setattr(planner, "solve_in_rounds", lambda first, *_: (first, ended))
    monkeypatch.setattr(planner, "conflicting_limits", given)
    said, failed = list[str](), "no jump was found near the one at hand"
    answer = fp.jump(found.problem, fp.JumpRequest(friction=0.2), starts=2, near=found, progress=said.append)
    told = f"{failed}. In the way there: friction of RL_foot (flight): 0.3 needed, 0.2 allowed. Searching on: "
    tried = [f"{told}{words}" for words in ("start 1 of 2", "start 2 of 2", "what stands in the way")]
    assert said == ["from the jump at hand", f"{failed}; what is in the way there", *tried]
    assert answer.explanation == "No jump was found in 2 starts. In the way: parabola."
    assert begun == [True, False]


def test_what_does_not_help_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two attempts, from the same guess as of a search; one where that took as long."""
    tried: list[float] = []

    def unsolved(first: JumpProgram, guess: np.ndarray) -> tuple[JumpProgram, SimpleNamespace]:
        np.testing.assert_array_equal(guess, first.guess())
        tried.append(first.node.bounds.friction / MARGINS.friction)
        return first, SimpleNamespace(converged=False)

    monkeypatch.setattr(planner, "solve_in_rounds", unsolved)
    given = [Conflict("friction of RL_foot", "friction", 0.2, 0.1), Conflict("torque", "torque", 0.03, 1.0)]
    problem = replace(go2_problem(), jump=fp.JumpRequest(friction=0.1))
    said = planner._try_relaxed(problem, given, 0, np.inf, lambda _: None)
    assert said == "Tried without finding one: friction 0.18; friction 0.3."
    assert tried == pytest.approx([0.18, 0.3])
    assert planner._try_relaxed(problem, given, 0, 0.0, lambda _: None) == "Tried without finding one: friction 0.18."


BALL = fp.Circle(center=(2.0, 2.0), radius=0.1)
EASED = {
    "torque by URDF": (fp.Limits(torque="urdf"), lambda p: p.motor_torque_limits, 1.8),
    "torque by number": (fp.Limits(torque=20.0), lambda p: p.motor_torque_limits, 1.8),
    "torque by motor": (fp.Limits(torque={"RL_calf_joint": 20.0}), lambda p: p.motor_torque_limits, 1.8),
    "torque by joint": (fp.Limits(torque=[20.0, 30.0, 20.0, 30.0]), lambda p: p.torque_limits, 1.8),
    "torque by curve": (fp.Limits(motor={"RL_calf_joint": fp.Motor(40.0, 1.0)}), lambda p: p.motor_stall, 1.8),
    "velocity by URDF": (fp.Limits(velocity="urdf"), lambda p: p.velocity_limits, 1.8),
    "velocity by number": (fp.Limits(velocity=10.0), lambda p: p.velocity_limits, 1.8),
    "velocity without": (fp.Limits(), lambda p: p.velocity_limits, 1.0),
    "range": (fp.Limits(), lambda p: np.ptp(p.position_limits, axis=1), 1.8),
    "friction": (fp.Limits(), lambda p: p.jump.friction, 1.8),
    "ground": (fp.Limits(), lambda p: p.jump.clearance, 0.25),
    "duration": (fp.Limits(), lambda p: float(p.jump.takeoff.durations is not None) + len(p.jump.fixed), 0.0),
    "apart": (fp.Limits(), lambda p: float(len(p.obstacles)), 0.5),
}


@pytest.mark.parametrize("name", EASED)
def test_limits_give_as_much_as_is_said(name: str) -> None:
    limits, measured, times = EASED[name]
    request, kind = fp.JumpRequest(takeoff=HURRIED, fixed=("duration",)), name.partition(" ")[0]
    problem = replace(go2_problem(), limits=limits, jump=request, obstacles=(BALL, BALL))
    label = "base clear of obstacle 1 (flight)" if kind == "apart" else kind
    words, other = relaxed(problem, [Conflict(label, kind, 0.2, 0.1)], 1.5)
    assert words
    np.testing.assert_allclose(measured(other), times * measured(problem))


def test_every_row_of_a_limit_is_known_and_no_other() -> None:
    request = fp.JumpRequest(takeoff=HURRIED)
    program = jump_setup(go2_problem(), request).program(MARGINS)
    rows = {kind_of(label) for label in program.compiled.rows.labels}
    assert {"torque", "velocity", "friction", "ground"} <= rows
    assert not {"range", "duration"} & rows
    assert {kind_of(label) for label in program.labels} == {"", "range", "velocity", "duration"}
    assert len(program.labels) == program.box.shape[1]
    for label in ("balance of moments (takeoff)", "FL_foot meets the ground (takeoff)", "FL_foot stands (landing)"):
        assert kind_of(label) not in ("ground", "torque", "friction")
    low, high = program.box
    torso = np.flatnonzero([label.startswith("range of FL_calf_joint") for label in program.labels])
    assert (low[torso] < high[torso]).sum() == program.nodes - 2  # it stands at both ends


@pytest.mark.parametrize(
    ("label", "share", "size", "said"),
    [
        (f"torque of RL_calf_joint ({SIDE})", 0.5, 1.0, "57.9 N m needed, 38.6 N m allowed"),
        (f"rate of RL_calf_joint ({SIDE})", 0.1, 2.0, "15.2 rad/s needed, 13.8 rad/s allowed"),
        (f"friction of RL_foot ({SIDE})", 0.5, 0.1, "0.9 needed, 0.6 allowed"),
        (f"range of RL_calf_joint ({SIDE})", 0.5, 0.4, "0.2 rad missing"),
        (f"duration of ({SIDE})", 2.0, 0.05, "0.1 s missing"),
        ("clear of the ground (flight)", 0.5, 0.08, "0.04 m missing"),
    ],
)
def test_it_is_said_in_the_words_of_the_file(label: str, share: float, size: float, said: str) -> None:
    problem = replace(go2_problem(), jump=fp.JumpRequest())
    assert conflict_sentence(Conflict(label, kind_of(label), share, size), problem) == f"{label}: {said}"


def test_limits_on_joints_are_said_as_they_are_given() -> None:
    limits = fp.Limits(torque=[20.0, 40.0, 20.0, 30.0])
    problem = replace(go2_problem(), limits=limits, jump=fp.JumpRequest())
    name = problem.robot.joints[1]
    said = conflict_sentence(Conflict(f"torque of {name} ({SIDE})", "torque", 0.5, 1.0), problem)
    assert said == f"torque of {name} ({SIDE}): 51 N m needed, 34 N m allowed"
