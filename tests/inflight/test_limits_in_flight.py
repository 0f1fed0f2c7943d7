"""Limits and obstacles while correcting: what a correction keeps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from flown_plans import Drifting
from long_cases import cases
from places import PROBLEMS

import floatplan as fp
from floatplan.motion.planar.clearance import obstacle_distances


def distance_to_circle(plan, times, orientations, positions):
    """Least distance of any link to the first obstacle's surface, sampled along the links."""
    robot, obstacle = plan.robot, plan.problem.obstacles[0]
    com = plan.ballistics.positions(times)
    angles = robot.tree.absolute_angles(orientations, positions)
    least = math.inf
    for shape in robot.shapes:
        for share in np.linspace(0.0, 1.0, 21):
            local = np.array([shape.start + share * (shape.end - shape.start)])
            weights = robot.tree.point_weights(np.array([shape.body]), local)[0]
            place = robot.tree.rotations(angles) @ weights + com[:, 0] + 1j * com[:, 1]
            away = np.abs(place - complex(*obstacle.center)) - obstacle.radius - shape.radius
            least = min(least, float(away.min()))
    return least


@pytest.mark.parametrize("error", cases([-0.1, 0.1], {0.1}))
def test_an_obstacle_is_passed(error):
    plan = fp.plan(fp.load_problem(PROBLEMS / "obstacle.toml"))
    replanner = fp.Replanner(plan)
    robot = Drifting(plan, plan.angular_momentum * (1 + error))
    least = math.inf
    for following in (plan.duration * np.arange(1, 141) / 140).tolist():
        correction = replanner.update(*robot.state(replanner))
        assert correction.status in ("applied", "limited")
        least = min(least, distance_to_circle(plan, *robot.fly(replanner, following)))
    assert least > 0.9 * plan.problem.obstacles[0].margin
    assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.1)


@pytest.mark.parametrize(("quantity", "share"), [("torque", 1.1), ("velocity", 1.0)])
def test_limits_are_kept_where_corrections_are_applied(quantity, share):
    free = fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))
    limit = share * (free.peaks.motor_torque if quantity == "torque" else free.peaks.velocity)
    plan = replace(free, problem=replace(free.problem, limits=fp.Limits(position="full", **{quantity: limit})))
    momentum = 0.9 * plan.angular_momentum
    for checked, breaks in ((plan, False), (free, True)):
        replanner = fp.Replanner(checked)
        robot = Drifting(checked, momentum)
        most = 0.0
        for following in (plan.duration * np.arange(1, 101) / 100).tolist():
            replanner.update(*robot.state(replanner))
            times = np.linspace(robot.time, following, 5)
            joints = replanner.motion.at(times)
            rate = plan.dynamics.base_rate(joints[0], joints[1], momentum)
            used = plan.dynamics.torques(*joints, rate) if quantity == "torque" else joints[1]
            most = max(most, float((np.abs(used) / limit).max()))
            robot.fly(replanner, following)
        if breaks:
            assert most > 1.01, "the limit would be broken without being watched"
        else:
            assert most <= 1.005
            assert abs(robot.orientation - plan.problem.final.orientation) < math.radians(0.5)


def test_an_impossible_correction_is_told():
    free = fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))
    limits = fp.Limits(position="full", torque=1.001 * free.peaks.motor_torque, velocity=1.001 * free.peaks.velocity)
    plan = replace(free, problem=replace(free.problem, limits=limits))
    replanner = fp.Replanner(plan)
    robot = Drifting(plan, 0.8 * plan.angular_momentum)
    correction = replanner.update(*robot.state(replanner))
    assert correction.status in ("limited", "refused")
    assert correction.reason
    assert abs(correction.predicted_miss) > math.radians(5)


def through_the_hand(plan, when, error, velocity):
    """The plan with a small obstacle that is there for 8 ms, in the way of the corrected flight, not of the plan."""
    replanner, robot = fp.Replanner(plan), Drifting(plan, plan.angular_momentum * (1 + error))
    replanner.update(*robot.state(replanner))
    _, orientations, positions = robot.fly(replanner, when, 400)
    shape, tree = plan.robot.shapes[-1], plan.robot.tree
    weights = tree.point_weights(np.array([shape.body]), np.array([(shape.start + shape.end) / 2]))[0]
    com = plan.ballistics.positions(np.array([when]))[0]
    place = tree.rotations(tree.absolute_angles(orientations[-1:], positions[-1:]))[0] @ weights + complex(*com)
    center = place - complex(*velocity) * when
    circle = fp.Circle(
        center=(center.real, center.imag), radius=0.05, velocity=velocity, window=(when - 0.004, when + 0.004)
    )
    return replace(plan, problem=replace(plan.problem, obstacles=(circle,)))


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (4.0, -2.0)])
@pytest.mark.parametrize("when", cases([0.45, 0.62, 0.8], {0.62}))
def test_an_obstacle_that_is_there_for_a_moment_is_not_flown_through(plan, when, velocity):
    """Whatever is called applied passes it, as it is foreseen."""
    plan = through_the_hand(plan, when, 0.1, velocity)
    replanner, robot = fp.Replanner(plan), Drifting(plan, 1.1 * plan.angular_momentum)
    (circle,) = plan.problem.obstacles
    times = np.linspace(*circle.window, 9)
    judged = 0
    for following in np.arange(0.015, when, 0.015).tolist():
        correction = replanner.update(*robot.state(replanner))
        if correction.status == "applied":
            alone = Drifting(plan, robot.momentum)
            alone.time, alone.orientation = robot.time, robot.orientation
            least = math.inf
            for until in times.tolist():
                ends, orientations, positions = alone.fly(replanner, until, 40)
                shapes = replanner.views.flying.flight.link_shapes.place(
                    plan.ballistics.positions(ends[-1:]).view(complex)[:, 0],
                    plan.robot.tree.absolute_angles(orientations[-1:], positions[-1:]),
                )
                least = min(least, float(obstacle_distances(shapes, circle, ends[-1:]).min()))
            assert least > -1e-3
            judged += 1
        robot.fly(replanner, following)
    assert judged > 5
