"""The search for a first flight: what it does is counted, and where it ends is what a plan's own search finds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from jumps import GO2, backflip

import floatplan as fp
from floatplan.initial import flight
from floatplan.initial.flight import FirstFlight, first_flight
from floatplan.initial.robots import chosen_robot
from floatplan.initial.shortcomings import shortcomings, with_largest_pitch_error
from floatplan.initial.text import problem_file_text
from floatplan.jumps.check import touchdown_height
from floatplan.jumps.jump import Jump


def go2_s():
    chosen = chosen_robot(GO2)
    assert chosen.robot.joints == backflip().problem.robot.joints
    return chosen


def asked_to_land_turned(error):
    """The Go2's backflip as one that has to be clear of the ground where it lands turned by so much, rad."""
    request = replace(backflip().request, pitch_error=error)
    return replace(backflip(), request=request, problem=replace(backflip().problem, jump=request))


@pytest.mark.long
def test_a_jump_that_is_not_clear_where_it_lands_turned_is_asked_for_what_it_keeps(monkeypatch, tmp_path):
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
    assert again.jump.pitch_error == pytest.approx(error)


def test_where_no_jump_is_found_the_reasons_are_said(monkeypatch):
    asked = []

    def none(problem, progress, **_):
        asked.append(problem)
        progress("start 1 of 1")
        return Jump(problem, fp.JumpRequest(), explanation="The torques stand in the way.")

    monkeypatch.setattr(flight, "jump", none)
    tried = []
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


@pytest.mark.parametrize("ground", [False, True])
def test_a_flight_that_was_planned_above_the_ground_is_asked_so_in_the_file(tmp_path, ground):
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
