"""Problems of jumps for tests, and one jump that many of them look at."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from once import made_once

import floatplan as fp
from floatplan.jumps.jump import Jump
from floatplan.jumps.planner import jump
from floatplan.jumps.spatial import planner as planner_in_space
from floatplan.jumps.spatial.jump import SpatialJump

GO2 = "example-robot-data:go2_description/urdf/go2.urdf"


@cache
def go2() -> fp.Robot:
    """A Go2 whose left and right legs move alike."""
    return fp.Robot.from_urdf(GO2, coupled="mirror", reference="standing")


def go2_problem(turns: int = -1) -> fp.Problem:
    """A Go2 that stands, turns so many times in flight, and stands."""
    robot = go2()
    standing = np.array(robot.resting)
    return fp.Problem(
        robot,
        fp.Posture(0.0, standing),
        fp.Posture(2 * math.pi * turns, standing),
        fp.Flight(0.4, angular_momentum="free", takeoff=fp.Takeoff("RL_foot")),
        fp.Motion(objective="torque"),
        fp.Limits(velocity="urdf", torque="urdf"),
        name="go2",
        jump=fp.JumpRequest(),
    )


def backflip() -> Jump:
    """The Go2's backflip."""
    found: Jump = made_once("backflip of a Go2", lambda: jump(go2_problem(), starts=1))
    return found


def roll() -> SpatialJump:
    """The Go2's roll, in space, from its right legs to its left ones; fewer nodes than usual take less time."""
    file = Path(__file__).parents[2] / "problems" / "jumps" / "space" / "go2_roll.toml"

    def coarse() -> Jump:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(planner_in_space, "MARGINS", replace(planner_in_space.MARGINS, refinement=0.6))
            return jump(fp.load_problem(file), starts=1)

    found: SpatialJump = made_once("roll of a Go2", coarse)
    return found
