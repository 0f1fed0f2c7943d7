"""A free h: kept within limits at the ends too, not bound to (9), and sought from several sides."""

from dataclasses import replace

import numpy as np
import pytest
from free_problems import free_problem
from places import PROBLEMS

import floatplan as fp


def free(problem):
    return replace(problem, flight=replace(problem.flight, angular_momentum="free"))


def given(problem, momentum):
    return replace(problem, flight=replace(problem.flight, angular_momentum=momentum))


@pytest.fixture(scope="module")
def flip():
    """A front flip of a Go2 whose thighs' torque at takeoff, which follows from h, is near its limit."""
    robot = fp.load_problem(PROBLEMS / "gallery" / "go2.toml").robot
    degree = np.pi / 180

    def posture(orientation, **positions):
        joints = {f"{joint}_joint": degree * angle for joint, angle in positions.items()}
        return fp.Posture(degree * orientation, joints)

    return fp.Problem(
        robot,
        posture(20, FL_thigh=50, FL_calf=-60, RL_thigh=50, RL_calf=-110),
        posture(360, FL_thigh=60, FL_calf=-120, RL_thigh=60, RL_calf=-120),
        fp.Flight(0.6, "free", fp.Takeoff("FL_foot"), fp.Landing("FL_foot", 0.0), horizontal_velocity=1.2),
        fp.Motion(objective="torque"),
        obstacles=(fp.HalfPlane(point=(0.0, -0.032)),),
    )


@pytest.mark.parametrize(("torque", "known"), [(2.05, 6.7), (2.4, 3.88)])
def test_limits_that_depend_on_h_hold_at_the_ends(flip, torque, known):
    """Known are objectives with given h; with h free it was once infeasible, or 6.66."""
    generalized = [torque if joint == "FL_thigh_joint" else np.inf for joint in flip.robot.joints]
    plan = fp.plan(replace(flip, limits=fp.Limits(velocity="urdf", torque=generalized)))
    assert plan.ok, plan.explanation
    assert plan.objective_value < known
    index = plan.robot.joints.index("FL_thigh_joint")
    ends = plan.at([0.0, plan.duration]).torques[:, index]
    assert (np.abs(ends) <= torque * (1 + 1e-9)).all()


@pytest.mark.parametrize(("seed", "momentum"), [(15, -0.86), (22, -12.89)])
def test_is_as_good_as_given(seed, momentum):
    """The best h of a scan, of problems where the first motion found is not the best."""
    problem = free_problem(seed)
    assert problem is not None
    scanned = fp.plan(given(problem, momentum))
    plan = fp.plan(problem)
    assert plan.ok, plan.explanation
    assert plan.objective_value <= 1.001 * (scanned.objective_value if scanned.ok else np.inf)


class TestOutside:
    """(9) bounds h only where no joint turns back."""

    @pytest.fixture
    def cat(self):
        return fp.load_problem(PROBLEMS / "falling_cat.toml")

    def test_a_flight_exists(self, cat):
        low, high = cat.momentum_interval
        plan = fp.plan(cat)
        assert plan.ok
        assert not low <= plan.angular_momentum <= high

    @pytest.mark.parametrize(("turn", "rate"), [(0.0, 2.35), (-0.1, 2.41)])
    def test_a_free_h_goes_there_where_nothing_is_inside(self, cat, turn, rate):
        """The first joint moves at takeoff: with any h in (9) the base then turns faster than it may."""
        problem = replace(
            free(cat),
            start=replace(cat.start, velocities=[4.0, 0.0]),
            goal=replace(cat.goal, orientation=turn),
            motion=fp.Motion("auto"),
            limits=fp.Limits("full", orientation_rate=rate),
        )
        low, high = problem.momentum_interval
        for inside in (low, high):
            assert "At takeoff the start itself is impossible" in fp.plan(given(problem, inside)).explanation
        plan = fp.plan(problem)
        assert plan.ok, plan.explanation
        assert not low <= plan.angular_momentum <= high
