"""Jumps in a plane that begin in motion, in a given state."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import go2_problem, planned_jump
from places import PROBLEMS

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.motion import Grid, Stance
from floatplan.jumps.phases import begin_state
from floatplan.jumps.planner import MARGINS
from floatplan.jumps.setup import jump_setup
from floatplan.problem.jump import JumpFlight, JumpLanding, JumpRequest, JumpTakeoff
from floatplan.view.report.data import request_rows

ALL_FEET = [["RL_foot", "FL_foot"], ["RL_foot"]]
BENT = {"FL_thigh_joint": 0.65, "FL_calf_joint": -1.6, "RL_thigh_joint": 0.8, "RL_calf_joint": -1.4}
EXCLUDED = {
    "several flights": ({"flights": [JumpFlight(repeat=2)]}, "takeoff: several flights begin standing"),
    "a periodic jump": ({"landing": JumpLanding(to="periodic")}, "takeoff: several flights begin standing"),
}
REFUSED = {
    "feet that move": (
        {"com_velocity": (1.0, 0.0), "orientation_rate": 0.0, "velocities": {"FL_thigh_joint": -3.0}},
        r"jump\.takeoff: .*foot would not stand: these rates and velocities are .* nearest is base",
    ),
    "rates beyond their limits": (
        {"com_velocity": (9.0, 0.0), "orientation_rate": 0.0},
        r"jump\.takeoff: F._thigh_joint would begin with .* rad/s, where .* rad/s are left",
    ),
    "a foot in the air": (
        {"com_velocity": (1.0, 0.0), "from_": BENT | {"RL_calf_joint": -2.4}},
        r"jump\.takeoff\.from: its feet are \d+ mm apart",
    ),
}


def hop(**takeoff):
    """A Go2 that begins in motion, hops, and stands."""
    problem = go2_problem(turns=0)
    return replace(problem, jump=JumpRequest(takeoff=JumpTakeoff(contacts=ALL_FEET, **takeoff)))


@pytest.mark.parametrize("name", EXCLUDED)
def test_what_does_not_begin_in_motion_is_refused(name):
    values, reason = EXCLUDED[name]
    with pytest.raises(InputError, match=re.escape(reason)):
        JumpRequest(takeoff=JumpTakeoff(com_velocity=(1.0, 0.0)), **values)


def test_an_orientation_without_its_posture_is_refused():
    with pytest.raises(InputError, match="orientation: is of a posture in motion"):
        JumpTakeoff(orientation=0.1, com_velocity=(1.0, 0.0))


def test_rates_of_unknown_joints_are_refused():
    with pytest.raises(InputError, match=r"jump\.takeoff\.velocities: 'knee' is not a planned joint"):
        hop(velocities={"knee": 1.0})


@pytest.mark.parametrize("name", REFUSED)
def test_states_in_which_feet_do_not_stand_are_refused(name):
    takeoff, reason = REFUSED[name]
    problem = hop(**takeoff)
    with pytest.raises(InputError, match=reason):
        jump_setup(problem, problem.jump)


@pytest.mark.parametrize("contacts", [ALL_FEET, [["FL_foot"]]])
def test_feet_stand_and_velocities_are_those_requested(contacts):
    problem = hop(from_=BENT, orientation=0.05, com_velocity=(1.0, 0.2), orientation_rate=-0.7)
    request = replace(problem.jump, takeoff=replace(problem.jump.takeoff, contacts=contacts))
    problem = replace(problem, flight=replace(problem.flight, takeoff=fp.Takeoff(contacts[-1][0])))
    setup = jump_setup(problem, request)
    robot = problem.robot
    posture, rates = begin_state(robot, setup.request.takeoff)
    assert np.abs(posture[1:] - list(BENT.values())).max() < 0.1
    assert posture[0] == 0.05
    assert rates[0] == pytest.approx(-0.7)
    times = np.array([0.0, 1.0])
    y, v, a = (np.tile(values[:, None], 2) for values in (posture, rates, 0 * rates))
    phase = setup.phases[0]
    stance = Stance(robot, 9.81, phase.contacts, 0j, Grid(times, y, v, a, np.zeros((len(phase.others), 2))))
    state = stance.at(times[:1])
    for place, speeds in stance.inverse_dynamics(state)[1].values():
        assert speeds.max() < 1e-9
        assert abs(place[0, 1] - stance.ground) < 0.03  # all on one level, within the radius of a foot
    data = robot.model.createData()
    pin.centerOfMass(robot.model, data, state.positions[0], state.velocities[0])
    velocity = [robot.plane.horizontal @ data.vcom[0], robot.plane.vertical @ data.vcom[0]]
    assert velocity == pytest.approx([1.0, 0.2], abs=1e-9)


def test_the_whole_state_is_the_same_state_again():
    problem = hop(com_velocity=(0.8, 0.0), velocities={"RL_calf_joint": -1.0})
    setup = jump_setup(problem, problem.jump)
    again = jump_setup(setup.problem, setup.request)
    assert np.abs(again.begin_rates - setup.begin_rates).max() < 1e-12
    assert setup.begin_rates[-1] == pytest.approx(-1.0)
    assert setup.request.takeoff.from_standing == replace(problem.jump.takeoff, com_velocity=None, velocities=None)


def test_the_program_begins_with_the_rates_and_ends_at_rest():
    problem = hop(com_velocity=(1.0, 0.0), orientation_rate=0.3)
    setup = jump_setup(problem, problem.jump)
    program = setup.program(MARGINS)
    low, high = (program.split(bounds[: len(program.guess())]) for bounds in program.box)
    for bounds in (low, high):
        assert np.allclose(bounds.y[:, 0], setup.ends[0])
        assert np.allclose(bounds.v[:, 0], setup.begin_rates)
        assert np.allclose(bounds.v[:, -1], 0.0)
    assert np.isinf(low.a[:, 0]).all()
    assert np.isinf(high.a[:, 0]).all()
    assert not high.a[:, -1].any()


@pytest.mark.long
def test_a_running_hop_is_found_proved_and_lands_in_mujoco(tmp_path):
    jump = planned_jump("sequences/go2_running_hop")
    assert jump.ok, jump.explanation
    assert fp.certify(jump.flight).proved
    begin = jump.at([0.0])
    assert np.abs(begin.planned(jump.robot)[:2, :, 0] - begin_state(jump.robot, jump.request.takeoff)).max() < 1e-9
    assert jump.check.figures["begin"] < 1e-9
    assert fp.load_jump(jump.save(tmp_path / "jump.json")).check.figures["begin"] < 1e-9
    shown = [row for row in request_rows(jump.problem, jump.request) if "1 m/s horizontally" in str(row)]
    assert len(shown) == 1
    flown = fp.replay_jump(jump, gains=(58.8, 1.0))
    assert flown.uncorrected.clean.all()


@pytest.mark.long
def test_a_sole_s_heel_stands_still_from_the_beginning():
    problem = fp.load_problem(PROBLEMS / "jumps" / "talos_hop.toml")
    takeoff = replace(problem.jump.takeoff, com_velocity=(0.3, 0.0), orientation_rate=0.0)
    problem = replace(problem, jump=replace(problem.jump, takeoff=takeoff))
    program = jump_setup(problem, problem.jump).program(MARGINS)
    _, bounds = program.node_rows.stance(program.phases[0])
    low, high = program._stance_bounds(0, bounds)
    stands = [bound.kind for bound in bounds].index("stands")
    assert low[stands, 0] == high[stands, 0] == 0.0, "its accelerations are free, so that the row is not implied"
    jump = fp.jump(problem, starts=2, helps=False)
    assert jump.ok, jump.explanation
    assert jump.check.figures["begin"] < 1e-9
    assert jump.check.figures["foot_speed"] < 1e-6
