"""The search for a first flight: what it does is counted, and where it ends is what a plan's own search finds."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from jumps import GO2, INSTALLED, backflip
from legged_samples import biped

import floatplan as fp
from floatplan.initial import flight
from floatplan.initial.afloat import problems_afloat
from floatplan.initial.flight import FirstFlight, first_flight
from floatplan.initial.options import InitOptions
from floatplan.initial.robots import ChosenRobot, chosen_robot
from floatplan.initial.shortcomings import feet_rise, shortcomings, with_largest_pitch_error
from floatplan.initial.text import problem_file_text
from floatplan.jumps import planner
from floatplan.jumps.check import touchdown_height
from floatplan.jumps.jump import Jump
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.plans.measures import PlanWarning

needs_jumps = pytest.mark.skipif(not INSTALLED, reason="CasADi or example-robot-data is not installed")


def test_patience_changes_no_plan_that_it_waits_for(root: Path) -> None:
    problem = fp.load_problem(root / "problems" / "torque_limited.toml")
    whole = planned(problem, SearchOptions())
    patient = planned(problem, SearchOptions(patience=whole.work))
    assert whole.plan.ok
    assert not patient.gave_up
    np.testing.assert_array_equal(patient.plan.coefficients, whole.plan.coefficients)
    assert patient.work == whole.work
    hasty = planned(problem, SearchOptions(patience=1e3))
    assert hasty.gave_up
    assert hasty.work < whole.work


def go2_s() -> ChosenRobot:
    chosen = chosen_robot(GO2)
    assert chosen.robot.joints == backflip().problem.robot.joints
    return chosen


@needs_jumps
def test_of_a_jump_the_flight_stands_between_its_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[fp.Problem] = []

    def found(problem: fp.Problem, **options: Any) -> Jump:
        if "near" not in options:  # not again, for links that overlap
            asked.append(problem)
        return backflip()

    monkeypatch.setattr(flight, "jump", found)
    first = first_flight(go2_s())
    guess, *with_narrower_ranges = asked  # since its calves come into its thighs
    for narrower in with_narrower_ranges:
        assert np.ptp(narrower.position_limits, axis=1).sum() < np.ptp(guess.position_limits, axis=1).sum()
    assert guess.jump is not None
    assert guess.final.orientation - guess.initial.orientation == pytest.approx(-2 * np.pi)
    assert first.reasons == ()
    assert first.base_rotation == pytest.approx(-2 * np.pi)
    again = fp.plan(first.problem, prove=True)
    np.testing.assert_array_equal(first.plan.coefficients, again.coefficients)
    flown = backflip().flight
    assert flown is not None
    for end, other in ((first.problem.initial, flown.problem.initial), (first.problem.final, flown.problem.final)):
        for name in ("orientation", "positions", "velocities", "accelerations"):
            np.testing.assert_allclose(getattr(end, name), getattr(other, name), rtol=1e-5, atol=1e-5)
        assert np.abs(end.velocities).max() > 1.0
    request = first.problem.jump
    assert request is not None
    groups = [*(request.takeoff.contacts or ()), *(request.landing.contacts or ())]
    stances = [phase.contacts for phase in backflip().phases if phase.kind == "stance"]
    assert [len(group) for group in groups] == [2, 1, 1, 2]
    assert all(set(group) < set(stood) for group, stood in zip(groups, stances, strict=True))


@needs_jumps
def test_a_jump_that_was_found_is_not_exchanged_for_its_warnings(monkeypatch: pytest.MonkeyPatch) -> None:
    """One whose flight has a warning, with the ground and without, is written, and so is the warning."""
    warning = PlanWarning("torque", "FL_calf_joint", 50.0, 45.0, "N m", 0.1, "FL_calf_joint needs more torque.")
    warned = {"warnings": (warning,)}
    plans: list[fp.Problem] = []

    def planned_with_warning(problem: fp.Problem, **options: Any) -> fp.Plan:
        plans.append(problem)
        plan = fp.plan(problem, **options)
        plan.__dict__.update(warned)
        return plan

    monkeypatch.setattr(flight, "jump", lambda problem, **_: backflip())
    monkeypatch.setattr(flight, "plan", planned_with_warning)
    chosen = go2_s()
    first = first_flight(chosen)
    assert first.jump is not None
    assert [problem.ground for problem in plans] == [False, True]
    text = problem_file_text(chosen, first, Path("go2.toml"))
    assert "# Warning: FL_calf_joint needs more torque." in text


def asked_to_land_turned(error: float) -> Jump:
    """The Go2's backflip as one that has to be clear of the ground where it lands turned by so much, rad."""
    request = replace(backflip().request, pitch_error=error)
    return replace(backflip(), request=request, problem=replace(backflip().problem, jump=request))


@needs_jumps
def test_a_jump_that_is_not_clear_where_it_lands_turned_is_asked_for_what_it_keeps(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It is written with the largest error at which it is clear, and a warning where that is less than usual."""
    not_clear = asked_to_land_turned(0.5)
    assert not not_clear.ok
    clear = with_largest_pitch_error(not_clear)
    assert clear.ok
    error = clear.request.pitch_error
    assert clear.problem.jump == clear.request
    assert 0.07 < error < 0.5
    assert math.degrees(error) == pytest.approx(round(math.degrees(error), 1), abs=1e-9)
    assert touchdown_height(clear, error) >= 0.0 > touchdown_height(clear, error + math.radians(0.11))
    assert with_largest_pitch_error(clear) is clear
    assert shortcomings(clear) == []
    chosen = go2_s()
    monkeypatch.setattr(flight, "jump", lambda problem, **_: not_clear)
    monkeypatch.setattr("floatplan.initial.shortcomings.USUAL_PITCH_ERROR", 0.5)
    first = first_flight(chosen)
    assert first.jump is not None
    path = tmp_path / "go2.toml"
    path.write_text(problem_file_text(chosen, first, path))
    told = f"touches the ground where it lands turned by {math.degrees(error):.2g} degrees at most"
    assert f"# Warning: Nothing but its feet {told}" in path.read_text()
    again = fp.load_problem(path)
    assert again.jump is not None
    assert again.jump.pitch_error == pytest.approx(error)


@needs_jumps
def test_what_fails_elsewhere_is_no_jump_for_landing_less_turned() -> None:
    """Torques take more than their share too."""
    request = replace(backflip().request, pitch_error=0.4, margin={"torque": 0.1})
    found = replace(backflip(), request=request, problem=replace(backflip().problem, jump=request))
    assert with_largest_pitch_error(found) is found


@pytest.mark.long
@needs_jumps
@pytest.mark.parametrize("known", [True, False])
def test_slow_legs_hop_with_feet_that_rise_by_less(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    """Where motors are too slow for a hop as it is looked for at first; that there is none is ``known`` in no time."""
    path = tmp_path / "slow.urdf"
    path.write_text(biped(foot="sole", knee=(0.0, 2.4)).replace('velocity="25"', 'velocity="2.5"'))
    if known:
        monkeypatch.setattr(planner, "_search", lambda *_: planner._Search(None, None, 1))
    said: list[str] = []
    problem = flight.jump_problem(chosen_robot(path), 0, InitOptions())
    found = fp.jump(problem, starts=1, helps=False, progress=said.append)
    assert found.ok
    assert "with feet that rise by 8 mm in place of 20 mm" in said
    assert found.explanation.endswith("Its feet were asked to rise by 8 mm only.")
    assert feet_rise(found) > 0.006


@needs_jumps
def test_how_far_the_feet_rise_is_as_in_the_motion() -> None:
    """The lower one of the Go2's feet, by the frames of Pinocchio, over where it stood."""
    found = backflip()
    model, height = found.problem.robot.model, []
    data = model.createData()
    assert found.flight is not None
    for time in found.takeoff_time + np.linspace(0.0, found.flight.duration, 101):
        pin.framesForwardKinematics(model, data, found.at(np.array([time])).positions[0])
        feet = [data.oMf[model.getFrameId(f"{name}_foot")].translation for name in ("FL", "RL")]
        height.append(min(foot @ found.problem.robot.plane.vertical for foot in feet))
    ground = found.before[0].ground + found.before[0].contacts[0].depth
    assert feet_rise(found) == pytest.approx(max(height) - ground, abs=1e-6)
    assert shortcomings(found) == []


@needs_jumps
def test_feet_that_hardly_rise_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("floatplan.initial.shortcomings.feet_rise", lambda _: 0.0041)
    assert shortcomings(backflip()) == ["In flight its feet rise by 4.1 mm only."]


@needs_jumps
def test_where_no_jump_is_found_the_reasons_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[fp.Problem] = []

    def none(problem: fp.Problem, progress: Callable[[str], None], **_: Any) -> Jump:
        asked.append(problem)
        progress("start 1 of 1")
        return Jump(problem, fp.JumpRequest(), explanation="The torques stand in the way.")

    monkeypatch.setattr(flight, "jump", none)
    tried: list[str] = []
    found = first_flight(go2_s(), progress=tried.append)
    turns = [each.final.orientation - each.initial.orientation for each in asked]
    np.testing.assert_allclose(turns, [-2 * np.pi, 0.0])
    assert found.jump is None
    assert len(found.reasons) == 2
    assert all("The torques stand in the way." in reason for reason in found.reasons)
    assert tried[:4] == [
        "jump with a whole turn",
        "jump with a whole turn: start 1 of 1",
        "jump without a turn",
        "jump without a turn: start 1 of 1",
    ]
    assert "afloat" in tried[-1]


def test_without_casadi_the_turn_is_afloat(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    found = first_flight(chosen_robot(root / "urdf" / "gymnast.urdf"))
    assert found.jump is None
    assert found.problem.flight.gravity == 0
    (reason,) = found.reasons
    assert "CasADi is not installed" in reason
    assert "jump]" in reason
    again = fp.plan(found.problem, prove=True)
    np.testing.assert_array_equal(found.plan.coefficients, again.coefficients)


def test_joints_swing_to_where_they_turn_the_base_farthest(root: Path) -> None:
    chosen = chosen_robot(root / "urdf" / "high_jumper.urdf")
    first = next(problems_afloat(chosen))
    turn = first.final.orientation
    swing = first.final.positions - first.initial.positions
    for joint in range(len(swing)):
        goal = first.initial.positions + np.where(np.arange(len(swing)) == joint, -swing, swing)
        low, high = chosen.robot.position_limits.T
        if ((goal >= low) & (goal <= high)).all():
            other = afloat_turn(chosen.robot, first.initial.positions, goal)
            assert abs(other) <= abs(turn) + np.deg2rad(0.5)


def afloat_turn(robot: fp.Robot, start: np.ndarray, goal: np.ndarray) -> float:
    """Of (4) with h = 0 along the straight way, by small steps."""
    from floatplan.motion.planar.closed_form import tree_dynamics

    shares = (np.arange(2000) + 0.5) / 2000
    rows = tree_dynamics(robot.tree).momentum_map(start + shares[:, None] * (goal - start))
    return float(-np.mean(rows[:, 1:] @ (goal - start) / rows[:, 0]))


@pytest.mark.parametrize(("rate", "kinds"), [(1210.06, []), (1211.0, ["ground", "takeoff", "landing"])])
def test_a_foot_at_rest_but_for_round_numbers_is_no_warning(root: Path, rate: float, kinds: list[str]) -> None:
    """The base and one joint have two rates for three conditions: they are met by the momentum of a jump alone."""
    robot = fp.Robot.from_urdf(root / "urdf" / "acrobat.urdf", plane="xz")
    angle, bent, rate, change = np.deg2rad([136.318, -102.263, rate, 628.761]).tolist()
    ends = fp.Posture(angle, [bent], [rate], [change]), fp.Posture(3 * np.pi - angle, [-bent], [rate], [-change])
    foot = {"takeoff": fp.Takeoff("foot"), "landing": fp.Landing("foot")}
    problem = fp.Problem(robot, *ends, fp.Flight(0.605615, 4.20297, horizontal_velocity=-1.01873, **foot))
    assert [warning.kind for warning in fp.plan(problem).warnings] == kinds


@needs_jumps
@pytest.mark.parametrize("ground", [False, True])
def test_a_flight_that_was_planned_above_the_ground_is_asked_so_in_the_file(tmp_path: Path, ground: bool) -> None:
    chosen, flown = go2_s(), backflip().flight
    assert flown is not None
    problem = flight.flight_of_jump(backflip(), flown)
    if ground:
        landing = fp.Landing(problem.landing.frame)
        problem = replace(problem, ground=True, flight=replace(problem.flight, landing=landing))
    path = tmp_path / "go2.toml"
    path.write_text(problem_file_text(chosen, FirstFlight(problem, flown, (), backflip()), path))
    again = fp.load_problem(path)
    assert again.ground == ground
    assert again.landing_height == pytest.approx(problem.landing_height, abs=1e-6)
