"""Stances from rest to a takeoff: those of a jump are found again, and those that no robot can have are not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from jumps import INSTALLED, backflip
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
