"""Stances from rest to a takeoff: those of a jump are found again, and those that no robot can have are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jumps import INSTALLED, backflip, go2_problem
from needed import skip_or_fail

import floatplan as fp
from floatplan.stance.launch import launch

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")


@pytest.mark.long
def test_the_takeoff_of_a_jump_is_reached() -> None:
    """A stance is known, within 0.88 of the rates and 0.85 of the torques."""
    flight = backflip().flight
    assert flight is not None
    found = launch(flight, starts=1)
    assert found.ok
    assert found.ratio < 0.9
    assert found.joint in flight.robot.motors
    assert found.sentences[0].startswith("Takeoff: reachable, with ")
    assert found.joint in found.sentences[0]
    assert found.sentences[-1].startswith("Friction 0.6, at rest with FL_thigh_joint 0.7")
    assert found.figures["residual"] < 1e-3


@pytest.mark.long
def test_a_takeoff_of_a_weak_robot_is_not() -> None:
    """The rates at takeoff alone are beyond the limits."""
    flight = backflip().flight
    assert flight is not None
    weak = replace(flight, problem=replace(flight.problem, limits=fp.Limits(velocity=5.0, torque="urdf")))
    found = launch(weak, starts=1)
    assert not found.ok
    assert found.ratio > 1
    assert "no stance was found within the limits (least factor " in found.sentences[0]
    assert found.impossible
    assert "whatever the stance" in found.sentences[1]


def test_a_saved_plan_stands_where_its_robot_did_on_the_ground_of_its_jump(tmp_path: Path) -> None:
    """The reference posture is in no URDF, and friction in no flight: the plan's file holds both."""
    problem = replace(go2_problem(), jump=fp.JumpRequest(friction=0.45))
    plan = fp.plan(problem)
    again = fp.load_plan(plan.save(tmp_path / "plan.json"))
    np.testing.assert_array_equal(again.robot.resting, problem.robot.resting)
    assert again.problem.jump == problem.jump
    flight = backflip().flight
    assert flight is not None
    assert flight.problem.jump == backflip().request
    np.testing.assert_array_equal(flight.robot.resting, problem.robot.resting)
