"""Problem files of flights in space: what their comments say, that they fly; and goals that are known to be reached."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from places import SPACE
from space_sections import drawn_goals

import floatplan as fp
from floatplan.robot.urdf.tree import robots_folder

NAMES = sorted(path.stem for path in SPACE.glob("*.toml"))
DAILY = ("go2_barrel_roll",)


@pytest.fixture
def plans(planned):
    return lambda name: planned(f"space/{name}")


@pytest.mark.parametrize(
    "name", [name if name in DAILY else pytest.param(name, marks=pytest.mark.long) for name in NAMES]
)
def test_they_are_planned_within_limits_and_land(plans, name):
    plan = plans(name)
    assert plan.ok, plan.explanation
    assert plan.whole.missed < 1e-8
    for peak, limit in (
        (plan.peaks.velocity, plan.problem.velocity_limits),
        (plan.peaks.motor_torque, plan.problem.motor_torque_limits),
    ):
        assert (peak <= limit * (1 + 1e-9)).all()
    assert "ground" not in [warning.kind for warning in plan.warnings]
    flown = fp.replay(plan, feedback=30 / plan.duration)  # open loop, rounding errors grow in 25 s of an arm
    assert flown.landed
    assert flown.orientation_error < 1e-9
    assert flown.momentum_drift < 1e-9


def test_without_limits_levelling_is_not_larger_than_with_them():
    """Both go down the same curved valley, without limits by the descent alone."""
    problem = fp.load_problem(SPACE / "go2_levels.toml")
    within = fp.plan(problem)
    without = fp.plan(replace(problem, limits=fp.Limits()))
    assert without.ok
    assert without.objective_value < 1.01 * within.objective_value


def test_the_cat_rolls_by_bending_round_in_circles(plans):
    plan = plans("cat")
    assert plan.angular_momentum == pytest.approx([0, 0, 0])
    angles = plan.whole.angles("xyz")
    assert angles[-1] - angles[0] == pytest.approx([math.pi, 0, 0], abs=1e-8)
    forwards, aside = plan.at(np.linspace(0, plan.duration, 400)).positions.T
    bent = np.unwrap(np.arctan2(aside, forwards))
    circles = abs(bent[-1] - bent[0]) / (2 * math.pi)
    assert circles == pytest.approx(round(circles), abs=1e-6)
    assert circles > 0.5
    low, high = plan.robot.position_limits.T
    assert (low < [forwards.min(), aside.min()]).all()
    assert ([forwards.max(), aside.max()] < high).all()


@pytest.mark.parametrize("seeds", [(0, 2, 3), pytest.param(range(40), marks=pytest.mark.long)])
def test_goals_to_which_drawn_motions_lead_are_found(seeds):
    """A third of them within limits of 1.3 times what the drawn motion needs."""
    drawn = enumerate(drawn_goals(max(seeds) + 1))
    plans = [fp.plan(problem, seed=seed) for seed, problem in drawn if seed in seeds]
    found = [plan for plan in plans if plan.ok]
    assert len(found) >= 0.9 * len(seeds)
    assert plans[0].ok, plans[0].explanation
    assert np.isfinite(plans[0].problem.torque_limits).all()
    for plan in found:
        assert plan.whole.missed < 1e-9
        assert (plan.peaks.torque <= plan.problem.torque_limits * (1 + 1e-9)).all()
        ends = plan.at([0.0, plan.duration])
        for index, end in enumerate((plan.problem.initial, plan.problem.final)):
            assert ends.positions[index] == pytest.approx(end.positions, abs=1e-9)
            assert ends.velocities[index] == pytest.approx(end.velocities, abs=1e-9)
            assert ends.accelerations[index] == pytest.approx(end.accelerations, abs=1e-8)


def test_the_ur5_on_a_free_base_is_that_of_ur_description():
    """All bodies that move, where their joints are, and what these may do."""
    packaged = robots_folder() / "ur_description" / "urdf" / "ur5_robot.urdf"
    ours = pin.buildModelFromUrdf(str(SPACE.parents[1] / "urdf" / "free_ur5.urdf"))
    theirs = pin.buildModelFromUrdf(str(packaged))
    assert list(ours.names) == list(theirs.names)
    assert ours.nv == 6
    for joint in range(2, ours.njoints):
        assert ours.jointPlacements[joint].isApprox(theirs.jointPlacements[joint], 1e-11)
    for joint in range(1, ours.njoints):
        assert ours.inertias[joint].isApprox(theirs.inertias[joint], 1e-11)
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        assert getattr(ours, limit) == pytest.approx(getattr(theirs, limit))
