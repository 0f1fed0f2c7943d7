"""The search for a first flight: what it does is counted, and where it ends is what a plan's own search finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import floatplan as fp
from floatplan.initial import flight
from floatplan.initial.flight import first_flight
from floatplan.initial.problems import turns_afloat
from floatplan.initial.robots import chosen_robot
from floatplan.planning.planned import planned
from floatplan.planning.search import SearchOptions


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


def test_the_flight_found_is_the_one_that_plan_finds(root: Path) -> None:
    found = first_flight(chosen_robot(root / "urdf" / "gymnast.urdf"))
    again = fp.plan(found.problem, prove=True)
    np.testing.assert_array_equal(found.plan.coefficients, again.coefficients)
    assert found.reasons == ()


def test_without_work_left_the_turn_is_afloat(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight, "FLIPS_WORK", 0.0)
    monkeypatch.setattr(flight, "LEAPS_WORK", 0.0)
    tried: list[str] = []
    found = first_flight(chosen_robot(root / "urdf" / "gymnast.urdf"), progress=tried.append)
    assert not found.problem.ground
    assert all("afloat" in message for message in tried)
    assert len(found.reasons) == 2


def test_joints_swing_to_where_they_turn_the_base_farthest(root: Path) -> None:
    chosen = chosen_robot(root / "urdf" / "high_jumper.urdf")
    first = next(turns_afloat(chosen))
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
