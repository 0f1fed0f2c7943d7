"""Legs that are straight where they stand together: their joints cannot follow, and no exception leaves a search."""

from dataclasses import replace

import numpy as np
import pytest
from legged_samples import leg, legged

import floatplan as fp
from floatplan.jumps import planner
from floatplan.jumps.planner import jump_of_solution
from floatplan.jumps.rounds import solve_in_rounds
from floatplan.jumps.setup import jump_setup
from floatplan.problem.parts import Flight


def table(folder):
    """A body on a straight leg in front and one behind."""
    path = folder / "table.urdf"
    path.write_text(legged(leg("rear", (-0.18, 0.0)), leg("front", (0.18, 0.0))))
    return fp.Robot.from_urdf(path, plane="xz")


def hop(robot):
    posture = fp.Posture(0.0, robot.resting)
    flight = Flight(0.25, angular_momentum="free", takeoff=fp.Takeoff("rear_foot"))
    both = ("rear_foot", "front_foot")
    request = fp.JumpRequest(
        takeoff=fp.JumpTakeoff(contacts=[both, both[:1]]),
        landing=fp.JumpLanding(contacts=[both[1:], both]),
    )
    limits = fp.Limits(velocity="urdf", torque="urdf")
    return fp.Problem(robot, posture, posture, flight, fp.Motion(objective="torque"), limits, jump=request)


def test_from_straight_legs_it_stands_bent(tmp_path):
    problem = hop(table(tmp_path))
    setup = jump_setup(problem, problem.jump)
    knees = [1 + problem.robot.joints.index(f"{name}_knee") for name in ("rear", "front")]
    assert np.abs(setup.ends[:, knees]).min() > 0.4


def test_in_space_straight_legs_are_refused(root):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / "solo12_quarter_turn.toml")
    straight = dict.fromkeys(problem.robot.joints, 0.0)
    request = replace(problem.jump, takeoff=replace(problem.jump.takeoff, from_=straight))
    straight_legged = replace(problem, jump=request)
    with pytest.raises(fp.InputError, match=r"leg of 'FL_FOOT' is straight.*stand with bent legs") as error:
        fp.jump(straight_legged, starts=1)
    assert error.value.element == "jump.takeoff.from"


@pytest.mark.long
def test_from_straight_legs_a_jump_is_found(tmp_path):
    problem = hop(table(tmp_path))
    setup = jump_setup(problem, problem.jump)
    first = setup.program(replace(planner.MARGINS, refinement=0.6))
    found = jump_of_solution(setup, *solve_in_rounds(first, first.guess()), seed=0)
    assert found.ok, found.explanation
