"""The path of the centre of mass: takeoff and landing frames where they are asked to be, by Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import floatplan as fp

TIMES = np.linspace(0, 1.3, 7)


def flight_between(robot, takeoff, landing, **flight):
    """A problem with random states at both ends."""
    rng = np.random.default_rng(1)
    n = len(robot.joints)
    start, goal = (fp.Posture(rng.uniform(-3, 3), rng.uniform(-1, 1, n)) for _ in range(2))
    limits = fp.Limits(position="full")
    return fp.Problem(robot, start, goal, fp.Flight(1.3, takeoff=takeoff, landing=landing, **flight), limits=limits)


def place(robot, name, state, com):
    """Place (2,) of a frame, by Pinocchio, when the centre of mass is at ``com``."""
    data = robot.model.createData()
    full = robot.reference + robot.selection @ state.positions
    full[2] = state.orientation
    pin.framesForwardKinematics(robot.model, data, full)
    offset = data.oMf[robot.model.getFrameId(name)].translation - pin.centerOfMass(robot.model, data, full)
    return com + np.array([offset @ robot.plane.horizontal, offset @ robot.plane.vertical])


def test_frames_are_where_they_are_asked_to_be(any_robot):
    first, last = any_robot.tree.names[0], any_robot.tree.names[-1]
    takeoff, landing = fp.Takeoff(last, (0.3, -0.2)), fp.Landing(first, 0.7)
    problem = flight_between(any_robot, takeoff, landing, horizontal_velocity=-1.5, gravity=3.7)
    path = problem.path
    at_start, at_end = path.positions(np.array([0.0, 1.3]))
    assert place(any_robot, last, problem.initial, at_start) == pytest.approx([0.3, -0.2], abs=1e-12)
    assert place(any_robot, first, problem.final, at_end)[1] == pytest.approx(0.7, abs=1e-12)


def test_path_obeys_2_and_3(gymnast):
    path = flight_between(gymnast, None, None, horizontal_velocity=2.0, gravity=9.81).path
    positions, velocities = path.positions(TIMES), path.velocities(TIMES)
    assert positions[:, 0] - positions[0, 0] == pytest.approx(2.0 * TIMES)
    assert velocities[:, 0].tolist() == [2.0] * len(TIMES)
    parabola = np.polynomial.Polynomial.fit(TIMES, positions[:, 1], 2)
    assert parabola.deriv(2)(0.4) == pytest.approx(-9.81, rel=1e-10)
    assert velocities[:, 1] == pytest.approx(parabola.deriv()(TIMES), abs=1e-11)
    assert parabola(TIMES) == pytest.approx(positions[:, 1], abs=1e-13)
