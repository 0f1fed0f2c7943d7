"""What joint rates within their limits reach: its edges take exactly the limits, inside less, outside more."""

from dataclasses import replace

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.planar.contact_rates import at_end, equations_at, rate_limits, rates_at, reachable

START, GOAL = [0.5, -0.9, -1.4], [0.9, -0.4, -2.0]


@pytest.fixture(scope="module")
def jump():
    robot = fp.Robot.from_urdf("urdf/high_jumper.urdf")
    flight = fp.Flight(0.4, takeoff=fp.Takeoff("foot"), horizontal_velocity=-1.0)
    return fp.Problem(robot, fp.Posture(1.3, START), fp.Posture(1.4, GOAL), flight)


def ratio(problem, end, asked):
    """Of rates at (h, horizontal, vertical velocity)."""
    frame, orientation, positions, _ = at_end(problem, end)
    equations = equations_at(problem.robot, frame, orientation, positions, np.array(asked[1:]))
    return rates_at(problem.robot, equations, rate_limits(problem), float(asked[0])).ratio


def intervals(found):
    return [found.angular_momentum, found.horizontal_velocity, found.vertical_velocity]


@pytest.mark.parametrize("end", ["takeoff", "landing"])
def test_at_the_ends_of_intervals_the_limits_are_taken(jump, end):
    some = reachable(jump, end, 0.0).polygon.mean(axis=0)
    frame_velocity = at_end(jump, end)[3]
    problem = jump
    if end == "takeoff":  # a duration that makes the vertical velocity one that is reached
        problem = replace(jump, flight=replace(jump.flight, duration=0.12))
        frame_velocity = at_end(problem, end)[3]
    momentum = float(some[0])
    found = reachable(problem, end, momentum)
    assert found.asked == pytest.approx([momentum, *frame_velocity])
    for index, interval in enumerate(intervals(found)):
        if interval is None:
            assert ratio(problem, end, found.asked) > 1
            continue
        for edge in interval:
            at_edge = found.asked.copy()
            at_edge[index] = edge
            assert ratio(problem, end, at_edge) == pytest.approx(1.0, rel=1e-9)
        inside = found.asked.copy()
        inside[index] = 0.7 * interval[0] + 0.3 * interval[1]
        assert ratio(problem, end, inside) < 1
    assert any(interval is not None for interval in intervals(found))


def test_corners_of_the_polygon_take_the_limits_and_it_is_convex(jump):
    found = reachable(jump, "takeoff", 5.0)
    corners, horizontal = found.polygon, found.asked[1]
    assert len(corners) == 6
    for momentum, vertical in corners:
        assert ratio(jump, "takeoff", [momentum, horizontal, vertical]) == pytest.approx(1.0, rel=1e-9)
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0).all()
    middle = corners.mean(axis=0)
    rng = np.random.default_rng(0)
    for weights in rng.dirichlet(np.ones(len(corners)), 20):
        inside = weights @ corners
        outside = middle + 1.01 * (corners[rng.integers(len(corners))] - middle)
        assert ratio(jump, "takeoff", [inside[0], horizontal, inside[1]]) < 1
        assert ratio(jump, "takeoff", [outside[0], horizontal, outside[1]]) > 1


def test_of_random_robots_the_interval_of_h_is_where_the_ratio_is_at_most_1(any_robot):
    """Of any number of joints, one among them: scanned."""
    rng = np.random.default_rng(4)
    n = len(any_robot.joints)
    low, high = np.clip(any_robot.position_limits, -np.pi, np.pi).T
    frames = [name for name, frame in any_robot.frames.items() if frame.body]
    for _ in range(10):
        state = fp.Posture(rng.uniform(-3, 3), low + (high - low) * rng.uniform(0.05, 0.95, n))
        takeoff = fp.Takeoff(str(rng.choice(sorted(frames))))
        flight = fp.Flight(0.05, takeoff=takeoff, horizontal_velocity=rng.uniform(-0.5, 0.5))
        problem = fp.Problem(any_robot, state, state, flight, limits=fp.Limits(velocity=rng.uniform(5, 30, n)))
        found = reachable(problem, "takeoff", 0.0)
        if found.angular_momentum is None:
            assert min(ratio(problem, "takeoff", [h, *found.asked[1:]]) for h in np.linspace(-50, 50, 201)) > 1
            continue
        low_h, high_h = found.angular_momentum
        width = high_h - low_h
        if width <= 1e-9 * abs(low_h):  # one joint alone: a single h
            assert n == 1
            assert ratio(problem, "takeoff", [low_h, *found.asked[1:]]) <= 1
            continue
        for h in (low_h, high_h):
            assert ratio(problem, "takeoff", [h, *found.asked[1:]]) == pytest.approx(1.0, rel=1e-7)
        for h in (low_h - 0.01 * width - 1e-9, high_h + 0.01 * width + 1e-9):
            assert ratio(problem, "takeoff", [h, *found.asked[1:]]) > 1


def test_without_limits_nothing_is_bounded(gymnast):
    state = fp.Posture(1.2, [0.5, -0.8])
    problem = fp.Problem(gymnast, state, state, fp.Flight(0.6, takeoff=fp.Takeoff("foot")))
    found = reachable(problem, "takeoff", 1.0)
    assert found.polygon is None
    assert intervals(found) == [(-np.inf, np.inf)] * 3
