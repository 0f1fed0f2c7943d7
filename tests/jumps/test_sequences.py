"""Jumps of several flights, periodic ones, and jumps between grounds of different heights."""

import re
from dataclasses import replace

import numpy as np
import pytest
from jumps import go2_problem, planned_jump

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps import setup as setups
from floatplan.jumps.check import check_jump
from floatplan.jumps.contacts import GroundStep, edge_obstacles
from floatplan.jumps.phases import grounds_below, refuse_other_feet, standing_posture
from floatplan.jumps.planner import MARGINS
from floatplan.jumps.setup import jump_setup
from floatplan.keys import table_of
from floatplan.problem.jump import JumpFlight, JumpLanding, JumpRequest, JumpTakeoff
from floatplan.view.jumps import moments
from floatplan.view.report.data import jump_data

TURN = 2 * np.pi


CONTRADICTIONS = {
    "more flights than a program bears": (
        {"flights": [JumpFlight(repeat=20), JumpFlight()]},
        "flights: 21 flights are too many",
    ),
    "what is of one flight": (
        {"flights": [JumpFlight(repeat=2)], "fixed": ["start"]},
        "fixed: 'start' is of one flight",
    ),
    "a periodic one": ({"landing": JumpLanding(to="periodic"), "fixed": ["goal"]}, "fixed: 'goal' is of one flight"),
    "stairs": (
        {"flights": [JumpFlight(repeat=2)], "landing": JumpLanding(height=0.1), "edge": 0.5},
        "landing.height: several flights are on one ground",
    ),
    "an unknown edge": ({"takeoff": JumpTakeoff(height=0.4)}, "edge: the grounds differ in height"),
    "an edge of nothing": ({"edge": 0.4}, "edge: the grounds are equally high"),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_what_excludes_one_another_is_refused(name):
    values, reason = CONTRADICTIONS[name]
    with pytest.raises(InputError, match=re.escape(reason)):
        JumpRequest(**values)


def test_durations_the_wrong_way_round_are_refused():
    with pytest.raises(InputError, match=r"duration: low 0\.5 s is above high 0\.3 s"):
        JumpFlight(duration=(0.5, 0.3))


def test_other_turns_than_the_goal_s_are_refused():
    problem = go2_problem()
    reason = r"jump\.flights\[0\]\.turns: the first flight makes 1 turns, and the problem's goal is -1 from its start"
    with pytest.raises(InputError, match=reason):
        jump_setup(problem, replace(problem.jump, flights=[JumpFlight(turns=1), JumpFlight()]))


def test_feet_that_come_where_two_flights_meet_are_refused():
    problem = go2_problem()
    phases = jump_setup(problem, problem.jump).phases
    landed_on_one = phases[3]
    with pytest.raises(InputError, match=r"landing\.contacts: FL_foot, FR_foot stand where FL_foot, FR_foot, RL_foot"):
        refuse_other_feet([landed_on_one, phases[0]], periodic=False)
    with pytest.raises(InputError, match=r"landing\.contacts: FL_foot, FR_foot stand where FL_foot, FR_foot, RL_foot"):
        refuse_other_feet([phases[0], landed_on_one], periodic=True)
    refuse_other_feet([phases[4], phases[0]], periodic=True)


def test_obstacles_are_not_for_several_flights():
    problem = replace(go2_problem(), obstacles=(fp.Circle(center=(3.0, 3.0), radius=0.1),))
    with pytest.raises(InputError, match="obstacles: only jumps of one flight"):
        jump_setup(problem, replace(problem.jump, flights=[JumpFlight(repeat=2)]))


@pytest.mark.parametrize(
    "words",
    [
        "edge = 0.5",
        "[[jump.flights]]\nrepeat = 2",
        "[jump.takeoff]\nheight = 0.4",
        "[jump.takeoff]\ncom_velocity = [1.0, 0.0]",
        '[jump.landing]\nto = "periodic"',
    ],
)
def test_in_space_they_are_refused(root, tmp_path, words):
    text = (root / "problems" / "jumps" / "space" / "go2_roll.toml").read_text()
    table = words.partition("\n")[0]
    if table in text:
        text = text.replace(table, words)
    else:
        text = text.replace("[jump]\n", f"[jump]\n{words}\n", 1) if table[0] != "[" else f"{text}\n{words}\n"
    path = tmp_path / "roll.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"is for jumps in a plane|the grounds"):
        fp.load_problem(path)


def test_requests_of_single_jumps_are_written_as_before():
    """Files of jumps hold them, and older versions read these."""
    written = table_of(JumpRequest())
    assert not {"flights", "edge"} & set(written)
    assert not {"height", "com_velocity", "velocities", "orientation", "orientation_rate"} & set(written["takeoff"])


@pytest.mark.parametrize(
    "name",
    [
        "sequences/go2_flips",
        "sequences/go2_flips_periodic",
        "sequences/go2_running_hop",
        "boxes/go2_box",
        "boxes/a1_box",
    ],
)
def test_problems_are_the_same_after_saving(root, tmp_path, name):
    problem = fp.load_problem(root / "problems" / "jumps" / f"{name}.toml")
    again = fp.load_problem(fp.save_problem(problem, tmp_path / "again.toml"))
    assert table_of(again.jump) == table_of(problem.jump)


def test_a_sequence_turns_on_from_flight_to_flight(monkeypatch):
    problem = go2_problem()
    flights = [JumpFlight(repeat=2), JumpFlight(turns=0, duration=(0.1, 0.2))]
    searches = []
    monkeypatch.setattr(setups, "standing_posture", lambda *words: searches.append(1) or standing_posture(*words))
    setup = jump_setup(problem, replace(problem.jump, flights=flights))
    assert len(searches) == 2, "one for each side: all flights have the same contacts"
    assert [phase.side for phase in setup.phases].count("flight") == 3
    assert setup.ends[:, 0] == pytest.approx([0, -TURN, -2 * TURN, -2 * TURN])
    assert setup.phases[-3].bounds == (0.1, 0.2)
    program = setup.program(MARGINS)
    y, _, _, durations = program.motion(program.guess())
    at_meetings = [int(program.first_nodes[index]) for index in (5, 10)]
    assert y[0, at_meetings] == pytest.approx([-TURN, -2 * TURN])
    assert len(durations) == 15


def test_the_edge_of_a_box_is_on_the_side_of_the_higher_ground():
    down = JumpRequest(takeoff=JumpTakeoff(height=0.4), edge=0.5)
    up = JumpRequest(landing=JumpLanding(height=0.4), edge=0.5)
    below = GroundStep.of(down, 1.0)
    above = GroundStep.of(up, 1.0)
    along = np.array([0.4, 0.6])
    assert below.above_low(along) == pytest.approx([0.4, 0.0])
    assert above.above_low(along) == pytest.approx([0.0, 0.4])
    assert (below.low, below.high) == pytest.approx((0.6, 1.0))
    assert (above.low, above.high) == pytest.approx((1.0, 1.4))
    side, top = edge_obstacles(down, 1.0)
    assert max(side.start[0], side.end[0]) + side.radius == pytest.approx(0.5)
    assert top.end[0] < top.start[0] < 0.5
    assert not edge_obstacles(JumpRequest(), 1.0)
    assert grounds_below(np.array([0.0, 0.5, 0.6, 1.0]), 0.4, 0.0).tolist() == [0.4, 0.4, 0.0, 0.0]


@pytest.mark.long
def test_three_flips_in_a_row_are_found_checked_and_proved(tmp_path):
    jump = planned_jump("sequences/go2_flips")
    assert jump.ok, jump.explanation
    assert [phase.kind for phase in jump.phases].count("flight") == 3
    assert all(fp.certify(flight).proved for flight in jump.flights)
    ends = jump.state([0.0, jump.duration])
    assert ends.orientation[1] - ends.orientation[0] == pytest.approx(-3 * TURN)
    meeting = jump.more[0].flight  # it stands still nowhere between
    between = np.linspace(jump.timed_flights[0].end, jump.timed_flights[1].begin, 400)
    assert np.abs(jump.state(between).velocities).max(axis=1).min() > 0.01
    assert meeting.ok
    again = fp.load_jump(jump.save(tmp_path / "jump.json"))
    times = np.linspace(0.0, jump.duration, 500)
    assert np.array_equal(again.at(times).positions, jump.at(times).positions)
    assert again.check.figures == jump.check.figures
    assert jump_data(jump)["flown"] == [[flight.begin, flight.end] for flight in jump.timed_flights]
    shown = moments(jump, flying=2)
    assert np.all(np.diff(shown) > 0)
    for flight in jump.timed_flights:
        assert ((flight.begin < shown) & (shown < flight.end)).sum() == 2


@pytest.mark.long
def test_a_flight_of_a_sequence_that_is_elsewhere_fails_the_check():
    jump = planned_jump("sequences/go2_flips")
    along, up = jump.more[0].shift
    moved = replace(jump.more[0], shift=(along + 1e-3, up))
    check = check_jump(replace(jump, more=(moved, *jump.more[1:])))
    assert not check.ok
    assert check.figures["takeoff_seam"] == pytest.approx(1e-3, rel=0.01)


@pytest.mark.long
def test_three_flips_land_in_mujoco():
    jump = planned_jump("sequences/go2_flips")
    perturb = "mass=5%,friction=17%,armature=0.01,noise=0.1deg,delay=4ms"
    flown = fp.replay_jump(jump, 250.0, perturb=perturb, friction=0.85, flights=2, gains=(58.8, 1.0), budget=None)
    assert flown.corrected.clean.all()
    assert flown.corrected.pitch_rms < np.deg2rad(1)
    assert flown.statuses["applied"] > 2 * 3 * 40


@pytest.mark.long
def test_a_periodic_jump_ends_as_it_begins():
    jump = planned_jump("sequences/go2_flips_periodic")
    assert jump.ok, jump.explanation
    begin, end = jump.at([0.0]), jump.at([jump.duration])
    step = end.positions[0] - begin.positions[0]
    assert step[1] == pytest.approx(0, abs=1e-6)
    assert step[2] == pytest.approx(-TURN)
    assert np.abs(step[3:]).max() < 1e-6
    assert np.abs(begin.velocities).max() > 0.1
    assert np.abs(end.velocities - begin.velocities).max() < 1e-5
    for follow in (fp.replay_jump, fp.bench):
        with pytest.raises(InputError, match="ends in motion"):
            follow(jump)


@pytest.mark.long
def test_from_a_box_to_the_ground():
    jump = planned_jump("boxes/go2_box")
    assert jump.ok, jump.explanation
    assert jump.before[-1].ground - jump.after[0].ground == pytest.approx(0.4)
    assert fp.certify(jump.flight).proved
    wider = replace(jump, request=replace(jump.request, edge=jump.request.edge + 0.4))
    assert check_jump(wider).figures["ground"] < -0.1  # where it lands then is the box
    left, low, right, high = jump_data(jump)["step"]
    assert high - low == pytest.approx(0.4)
    assert left < jump.state([0.0]).com_position[0, 0] < right < jump.state([jump.duration]).com_position[0, 0]
    flown = fp.replay_jump(jump, gains=100.0)
    assert flown.landings.stands.all()
