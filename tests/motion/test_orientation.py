"""Orientation by (18): closed forms, and an independent integration."""

import numpy as np
import pytest
from flight_reference import drawn_plan, random_coefficients
from independent import Look
from robot_samples import URDF_FOLDER

import floatplan as fp
from floatplan.motion.planar.closed_form import Dynamics

TIMES = np.linspace(0, 1, 11)


@pytest.fixture(scope="module")
def acrobat():
    return fp.Robot.from_urdf(URDF_FOLDER / "acrobat.urdf")


def turn_of_two_links(robot, start, goal):
    """Orientation gained with h = 0 between two joint angles within (-pi, pi): minus the integral of D_1 / D_0.

    D_0 = a + 2 b cos q and D_1 = c + b cos q.
    """
    flat, folded = Dynamics(robot.tree).momentum_map(np.array([[0.0], [np.pi]]))
    a, b, c = (flat[0] + folded[0]) / 2, (flat[0] - folded[0]) / 4, (flat[1] + folded[1]) / 2

    def antiderivative(q):
        root = np.sqrt(a**2 - 4 * b**2)
        return q / 2 + (2 * c - a) / root * np.arctan(np.sqrt((a - 2 * b) / (a + 2 * b)) * np.tan(q / 2))

    return antiderivative(start) - antiderivative(goal)


def test_a_rigid_body_turns_evenly(any_robot):
    position = np.full(len(any_robot.joints), 0.4)
    plan = drawn_plan(any_robot, np.arcsin(position / np.pi)[:, None], -3.0, duration=2.5, orientation=0.7)
    inertia = Dynamics(any_robot.tree).momentum_map(position[None])[0, 0]
    times = 2.5 * TIMES
    assert plan.orientation(times) == pytest.approx(0.7 - 3.0 / inertia * times, rel=1e-13)
    assert plan.final_orientation == pytest.approx(0.7 - 7.5 / inertia, rel=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_one_joint_turns_the_base_by_a_closed_form(acrobat, seed):
    plan = drawn_plan(acrobat, random_coefficients(seed, 1), 0.0)
    positions = plan.at(TIMES).positions[:, 0]
    assert np.abs(positions).max() < np.pi
    expected = turn_of_two_links(acrobat, positions[0], positions)
    assert plan.orientation(TIMES) == pytest.approx(expected, abs=1e-13)


def test_orientation_is_that_of_an_independent_integration(any_robot):
    coefficients = random_coefficients(5, len(any_robot.joints))
    plan = drawn_plan(any_robot, coefficients, 1.1, orientation=-0.4)
    expected = Look(plan, TIMES).orientation
    assert plan.orientation(TIMES) == pytest.approx(expected, abs=1e-10)
    assert plan.final_orientation == pytest.approx(expected[-1], abs=1e-10)
