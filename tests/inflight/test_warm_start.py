"""Where a flight's first correction begins: near its end, wherever the robot's momentum lets it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from flown_plans import Drifting

import floatplan as fp
from floatplan.inflight.replanner import EARLY

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"


@pytest.fixture(scope="module")
def backflip() -> fp.Plan:
    return fp.plan(fp.load_problem(PROBLEMS / "gallery" / "go2.toml"))


@pytest.mark.parametrize("error", [-0.12, -0.09, -0.05, 0.03, 0.12])
def test_the_first_correction_is_nearly_the_last(backflip: fp.Plan, error: float) -> None:
    """With limits and ground: one motion is looked at beside that which was prepared, and it lands at the goal."""
    replanner = fp.Replanner(backflip)
    robot = Drifting(backflip, backflip.angular_momentum * (1 + error))
    correction = replanner.update(*robot.state(replanner))
    assert correction.status == "applied"
    assert abs(correction.predicted_miss) < math.radians(0.1)
    assert replanner._update._flight.corrected.evaluated <= 4, (
        "the plan's motion, that which was prepared, and two beside"
    )


def test_it_goes_on_from_where_the_joints_are(backflip: fp.Plan) -> None:
    replanner = fp.Replanner(backflip)
    robot = Drifting(backflip, 1.1 * backflip.angular_momentum)
    before = replanner.motion
    robot.fly(replanner, 0.03 * backflip.duration)
    correction = replanner.update(*robot.state(replanner))
    assert np.abs(correction.motion.coefficients - before.coefficients).max() > 0.01
    for old, new in zip(before.at(robot.time), correction.motion.at(robot.time), strict=True):
        np.testing.assert_allclose(new, old, rtol=1e-9, atol=1e-6)


def test_a_late_first_correction_begins_from_the_plan(backflip: fp.Plan) -> None:
    replanner = fp.Replanner(backflip)
    robot = Drifting(backflip, 0.97 * backflip.angular_momentum)
    robot.fly(replanner, (EARLY + 0.3) * backflip.duration, 500)
    before = robot.state(replanner)
    late = replanner.update(*before)
    replanner.reset()
    replanner._warm_starts._latest = -1.0
    alone = replanner.update(*before)
    assert late.predicted_miss == alone.predicted_miss
    assert late.status in {"applied", "limited"}


def test_without_angular_momentum_nothing_is_prepared() -> None:
    plan = fp.plan(fp.load_problem(PROBLEMS / "falling_cat.toml"))
    assert plan.angular_momentum == 0
    replanner = fp.Replanner(plan)
    assert replanner._warm_starts.at(0.0, 0.1) is None
    assert replanner.update(*Drifting(plan, 0.001).state(replanner)).status == "applied"
