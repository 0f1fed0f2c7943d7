"""Stances in space between two fixed ends: from rest to a flight, between two flights, and none."""

from dataclasses import replace

import numpy as np
import pytest

import floatplan as fp
from floatplan.jumps.spatial.coordinates import Mechanics
from floatplan.jumps.spatial.exact import met_by_flight
from floatplan.jumps.spatial.phases import SpatialPhase
from floatplan.jumps.spatial.stance_search import MARGINS, StanceEnd, planned_stance, stance_setup
from floatplan.jumps.spatial.standing import Kinematics, feet_at
from floatplan.problem.attitude import Attitude

FEET = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")


class Case:
    """A Go2 that stands, and flights that begin, or end, where it stands."""

    def __init__(self, root):
        self.problem = fp.load_problem(root / "problems" / "jumps" / "space" / "go2_side.toml")
        robot = self.problem.robot
        level = Attitude(angles=(0.0, 0.0, 0.0), axes="zyx")
        self.feet = tuple(foot for name in FEET for foot in feet_at(robot, name, level, robot.resting, "contacts"))
        self.mechanics = Mechanics(robot, "zyx", 9.81, self.feet)
        kinematics = Kinematics(robot)
        kinematics.pose(np.zeros(3), np.eye(3), robot.resting)
        height = self.feet[0].depth - kinematics.point(self.feet[0].body, self.feet[0].local)[2]
        self.standing = np.zeros((3, 6 + len(robot.joints)))
        self.standing[0, 2] = height
        self.standing[0, 6:] = robot.resting
        places = self.mechanics.feet(self.standing[:, :, None], FEET)
        self.places = dict(zip(FEET, places[0, 0], strict=True))

    def met(self, velocity, momentum):
        """The motion in which a flight with a velocity of the centre of mass and a momentum is met."""
        return met_by_flight(self.mechanics, self.standing, self.places, np.array(velocity), np.array(momentum))

    def setup(self, side, first, last, duration, intervals, request=None):
        """Of a problem that has no request of a jump, as that of a flight has none."""
        phases = [SpatialPhase(side, self.feet, duration, (0.4 * duration, 1.6 * duration), intervals)]
        problem = replace(self.problem, jump=None)
        return stance_setup(problem, request or fp.JumpRequest(), "zyx", phases, (first, last), self.places)

    def stance(self, *arguments):
        return planned_stance(self.setup(*arguments))

    def flies_with(self, stance, instant):
        """Velocity of the centre of mass, angular momentum, and the largest force at an instant of a stance."""
        motion = stance.grid.at(np.array([instant]))
        centres, momenta = self.mechanics.centre(motion)
        forces = stance.at(np.array([instant])).forces
        return centres[1, :, 0], momenta[:, 0], max(np.abs(force).max() for force in forces.values())


@pytest.fixture(scope="module")
def case(root):
    return Case(root)


def test_a_stance_ends_as_the_flight_begins(case):
    """Velocity and momentum are the flight's, by Pinocchio; nothing bears the robot then, and at first all of it."""
    velocity = [0.2, 0.1, 1.0]
    momentum = [0.1, 0.2, -0.1]
    end = case.met(velocity, momentum)
    result = case.stance("takeoff", StanceEnd(case.standing), StanceEnd(end, flies=True), 0.4, 6)
    assert result.ok, result.broken
    (stance,) = result.stances
    reached, turning, force = case.flies_with(stance, stance.span[1])
    assert np.abs(reached - velocity).max() < 1e-9
    assert np.abs(turning - momentum).max() < 1e-9
    assert force < 1e-6
    assert np.abs(stance.grid.at(np.array([stance.span[1]]))[:, :, 0] - end).max() < 1e-7
    at_first = stance.at(np.array([0.0]))
    assert sum(at_first.forces.values())[0, 2] == pytest.approx(9.81 * case.problem.robot.mass, rel=1e-9)
    assert np.abs(at_first.velocities).max() < 1e-9
    assert result.figures["torque"] <= 0.85
    assert result.figures["friction"] <= 0.6


@pytest.mark.long
def test_a_robot_settles_where_its_landing_brings_it(case):
    """Feet stand where they are to; base and joints come to rest elsewhere, where the ground bears them."""
    first = case.met([0.7, 0.2, -0.9], [0.1, 0.3, 0.0])
    last = StanceEnd(case.standing, settles=True)
    result = case.stance("landing", StanceEnd(first, flies=True), last, 0.35, 6)
    assert result.ok, result.broken
    (stance,) = result.stances
    end = stance.grid.at(np.array([stance.span[1]]))
    assert np.abs(end[1:]).max() < 1e-9
    assert np.abs(end[0, :3, 0] - case.standing[0, :3]).max() > 0.02  # m
    feet = case.mechanics.feet(end, FEET)
    assert np.abs(feet[0, 0] - np.array(list(case.places.values()))).max() < 1e-9
    centres, _ = case.mechanics.centre(end)
    for column in (0, 1):
        of_feet = feet[0, 0, :, column]
        assert of_feet.min() < centres[0, column, 0] < of_feet.max()


@pytest.mark.long
def test_a_step_is_between_two_flights(case):
    first = case.met([0.3, 0.0, -1.0], [0.0, 0.3, 0.0])
    last = case.met([0.3, 0.1, 1.1], [0.1, 0.0, 0.1])
    result = case.stance("step", StanceEnd(first, flies=True), StanceEnd(last, flies=True), 0.3, 20)
    assert result.ok, result.broken
    (stance,) = result.stances
    for instant, motion in zip(stance.span, (first, last), strict=True):
        assert np.abs(stance.grid.at(np.array([instant]))[:, :, 0] - motion).max() < 1e-7
        assert case.flies_with(stance, instant)[2] < 1e-6


@pytest.mark.long
def test_what_is_in_the_way_is_said(case):
    """With hardly any friction nothing takes off sideways."""
    end = case.met([0.8, 0.0, 0.6], [0.0, 0.0, 0.0])
    slippery = replace(fp.JumpRequest(), friction=0.05)
    result = case.stance("takeoff", StanceEnd(case.standing), StanceEnd(end, flies=True), 0.4, 6, slippery)
    assert not result.ok
    assert not result.stances
    # It would take longer; that friction keeps it from being faster is not among what binds at the last iterate.
    assert "duration of (takeoff on FL_foot and FR_foot" in result.broken[0]


def test_programs_of_a_setup_share_derivatives(case):
    """What a program with stricter margins computes is what it does where nothing was derived before."""
    end = case.met([0.2, 0.1, 1.0], [0.1, 0.2, -0.1])
    setup = case.setup("takeoff", StanceEnd(case.standing), StanceEnd(end, flies=True), 0.4, 4)
    first = setup.program(MARGINS)
    used = {piece.expression for piece in first.assembly.pieces}
    strict = MARGINS.tightened(setup.request, {"torque": 1.1, "friction": 0.7})
    shared = setup.program(strict)
    own = replace(setup).program(strict)
    assert {piece.expression for piece in shared.assembly.pieces} == used
    assert used.isdisjoint(piece.expression for piece in own.assembly.pieces)
    raw = np.random.default_rng(0).normal(size=own.size)
    with_shanks = replace(strict, shank_height=5e-3)  # has other rows
    more_rows = [one.program(with_shanks).assembly for one in (setup, replace(setup))]
    assert more_rows[0].labels == more_rows[1].labels != shared.assembly.labels
    for bound, other in ((shared.assembly.low, own.assembly.low), (shared.assembly.high, own.assembly.high)):
        assert np.array_equal(bound, other)
    parameters = np.zeros(own.size + 1)
    for name in ("grad_f", "jac_g"):
        results = [program.assembly.first_derivatives[name](raw, parameters) for program in (shared, own)]
        for one, another in zip(*results, strict=True):
            assert np.array_equal(np.array(one), np.array(another))
