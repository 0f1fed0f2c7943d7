"""How high and how fast legs lift a robot before it jumps in space, and what of it stays above the ground."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from long_cases import cases
from scipy.optimize import least_squares, linprog

import floatplan as fp
from floatplan.jumps.spatial.guess import guess
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.planner import MARGINS
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.standing import Kinematics, clearance_points
from floatplan.problem.jump import JumpTakeoff

HUMANOIDS = ("talos_side", "g1_side")


@pytest.fixture(scope="module")
def setup_of(root):
    """The setup of a file's jump."""

    @cache
    def setup(name, **changes):
        problem = fp.load_problem(root / "problems" / "jumps" / "space" / f"{name}.toml")
        return spatial_setup(problem, replace(problem.jump, **changes))

    return setup


def carried(setup, height):
    """Where SciPy brings the centre of mass to a height with the legs alone: largest gap, m, and configuration."""
    kinematics = Kinematics(setup.problem.robot)
    model = kinematics.model
    standing = setup.ends.y[0]
    places = np.concatenate([setup.ends.places["takeoff"][foot.name] for foot in setup.feet])
    in_legs = {number for foot in setup.feet for number in model.supports[foot.body]}
    names = setup.problem.robot.joints
    legs = [index for index, name in enumerate(names) if model.getJointId(name) in in_legs]
    ranges = np.asarray(setup.problem.position_limits)[legs]

    def pose(x):
        joints = standing[BASE:].copy()
        joints[legs] = x[3:]
        return kinematics.pose(x[:3], np.eye(3), joints)

    def gaps(x):
        q = pose(x)
        centre = pin.centerOfMass(model, kinematics.data, q) - np.array([0.0, 0.0, height])
        feet = [kinematics.point(foot.body, foot.local) for foot in setup.feet]
        return np.concatenate((centre, np.concatenate(feet) - places))

    low = np.concatenate((np.full(3, -9.0), ranges[:, 0] - 1e-6))
    high = np.concatenate((np.full(3, 9.0), ranges[:, 1] + 1e-6))
    first = np.concatenate((np.zeros(2), standing[2:3], standing[BASE:][legs]))
    solution = least_squares(gaps, first, bounds=(low, high), xtol=1e-6).x
    return np.abs(gaps(solution)).max(), pose(solution)


def fastest_lift(setup, q):
    """Greatest speed upwards of the centre of mass, m/s, over all rates that joints may have while feet stand."""
    robot = setup.problem.robot
    model = robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    pin.computeJointJacobians(model, data, q)
    of_centre = pin.jacobianCenterOfMass(model, data, q)
    rows = [of_centre[:2], np.eye(6, model.nv)[3:]]  # it goes straight up, its base is not rotated
    for foot in setup.feet:
        arm = data.oMi[foot.body].rotation @ np.array(foot.local)
        of_joint = pin.getJointJacobian(model, data, foot.body, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        rows.append(of_joint[:3] - pin.skew(arm) @ of_joint[3:])
    still = np.vstack(rows)
    most = np.zeros(model.nv)
    most[:BASE] = 100.0
    for joint, limit in zip(robot.joints, setup.problem.velocity_limits, strict=True):
        most[model.joints[model.getJointId(joint)].idx_v] = setup.request.margin["velocity"] * min(limit, 1e6)
    bounds = np.stack((-most, most), axis=1)
    return -linprog(-of_centre[2], A_eq=still, b_eq=np.zeros(len(still)), bounds=bounds).fun


def test_legs_reach_as_high_as_is_said(setup_of):
    setup = setup_of("talos_side")
    tallest = setup.ends.tallest
    gap, _ = carried(setup, tallest)
    assert gap < 2e-4
    gap, _ = carried(setup, tallest + 0.02)
    assert gap > 2e-3


def takeoff_height(setup):
    """Height of the centre of mass at which the guess leaves the ground, m."""
    program = setup.program(replace(MARGINS, refinement=0.3))
    return guess(program)[program.begins[program.borders[program.flight]] + 2]


@pytest.mark.long
def test_a_guess_leaves_the_ground_where_slow_legs_reach(setup_of):
    """A Talos that stands with its knees hardly bent leaves it lower than the 1.15 of its height of others."""
    problem = setup_of("talos_side").problem
    setup = spatial_setup(problem, replace(problem.jump, takeoff=JumpTakeoff()))
    gap, _ = carried(setup, takeoff_height(setup))
    assert gap < 2e-4
    usual = 1.15 * setup.ends.y[0, 2]
    gap, _ = carried(setup, usual)
    assert gap > 5e-3


def test_a_guess_with_fast_legs_is_as_high_as_ever(setup_of):
    setup = setup_of("go2_side")
    assert takeoff_height(setup) == 1.15 * setup.ends.y[0, 2]


def test_slow_legs_make_flights_short(setup_of):
    """Those of a Talos may last a fifth longer than what its fastest lift gives; a Go2's are what they are."""
    talos = setup_of("talos_turn", fixed=())
    flight = talos.phases[1]
    heights = talos.ends.y[0, 2] * np.array([0.63, 0.8, 1.0])
    fastest = max(fastest_lift(talos, carried(talos, height)[1]) for height in heights)
    gravity = float(talos.problem.flight.gravity)
    assert flight.bounds[1] == pytest.approx(1.2 * 2 * fastest / gravity, rel=0.05)
    assert flight.bounds[0] < flight.duration < flight.bounds[1]
    go2 = setup_of("go2_side")
    unit = np.sqrt(go2.ends.y[0, 2] / gravity)
    assert go2.phases[1].duration == pytest.approx(2.57 * unit)
    assert go2.phases[1].bounds == pytest.approx((0.6 * 2.57 * unit, 1.8 * 2.57 * unit))


def test_a_fixed_duration_stays(setup_of):
    setup = setup_of("talos_side")
    assert setup.request.fixed == ("duration",)
    assert setup.phases[1].bounds == (0.26, 0.26)


@pytest.mark.parametrize("name", cases([*HUMANOIDS, "go2_side"], {"g1_side"}))
def test_nothing_is_in_the_ground_where_a_robot_stands(setup_of, name):
    """A Talos' shank, in a capsule as thick as its knee, would be: no motion keeps that above the ground."""
    setup = setup_of(name)
    robot = setup.problem.robot
    kinematics = Kinematics(robot)
    y = setup.ends.y[0]
    kinematics.pose(np.zeros(3), np.eye(3), y[BASE:])
    foot = setup.feet[0]
    ground = kinematics.point(foot.body, foot.local)[2] - foot.depth
    ends = {}
    for capsule in robot.solid_capsules:
        for end in (capsule.start, capsule.end):
            ends[capsule.link, *end.tolist()] = capsule.radius
    thinner = set()
    for point in clearance_points(robot, setup.feet, np.eye(3), y[BASE:]):
        lowest = kinematics.point(point.body, point.local)[2] - point.radius - ground
        assert lowest > 5e-3
        if point.radius < ends.get((point.link, *point.local), 0.0):
            thinner.add(point.link)
            assert lowest == pytest.approx(kinematics.lowest([point.link]) - ground, abs=1e-9)
    assert thinner == ({"leg_left_4_link", "leg_right_4_link"} if name == "talos_side" else set())
