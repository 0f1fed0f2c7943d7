"""Orientation by (18): closed forms, and an independent integration."""

from __future__ import annotations

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


def test_orientation_counts_full_turns(gymnast):
    plan = drawn_plan(gymnast, np.zeros((2, 1)), 30.0)
    assert plan.final_orientation == pytest.approx(30.0 / 0.8113461538461539, rel=1e-13)
    assert plan.final_orientation > 10 * np.pi


@pytest.mark.parametrize("seed", range(4))
def test_one_joint_that_comes_back_has_not_turned(acrobat, seed):
    """With h = 0 the base's angle is a function of the joint's."""
    there_and_back = np.polymul([-1.0, 1.0, 0.0], random_coefficients(seed, 1, 3, 3.0)[0])[::-1]
    plan = drawn_plan(acrobat, there_and_back[None], 0.0)
    turned = plan.orientation(TIMES)
    assert np.abs(turned).max() > 0.1
    assert abs(plan.final_orientation) < 1e-13


@pytest.mark.parametrize("seed", range(4))
def test_one_joint_turns_the_base_by_a_closed_form(acrobat, seed):
    plan = drawn_plan(acrobat, random_coefficients(seed, 1), 0.0)
    positions = plan.at(TIMES).positions[:, 0]
    assert np.abs(positions).max() < np.pi
    expected = turn_of_two_links(acrobat, positions[0], positions)
    assert plan.orientation(TIMES) == pytest.approx(expected, abs=1e-13)


def test_two_joints_turn_the_base_though_they_come_back(gymnast):
    """What cats do: (1 - t) t and (1 - t) t^2, out of phase."""
    coefficients = np.array([[0, 1, -1, 0], [0, 0, 1, -1]])
    assert abs(drawn_plan(gymnast, coefficients, 0.0).final_orientation) > 1e-3
    in_phase = np.array([[0, 1, -1, 0], [0, 2, -2, 0]])
    assert abs(drawn_plan(gymnast, in_phase, 0.0).final_orientation) < 1e-13


class TestLaws:
    def test_change_is_affine_in_h(self, any_robot):
        coefficients = random_coefficients(1, len(any_robot.joints))
        turned = [drawn_plan(any_robot, coefficients, h).orientation(TIMES) for h in (0.0, 1.0, -2.5)]
        assert turned[2] == pytest.approx(turned[0] - 2.5 * (turned[1] - turned[0]), rel=1e-11, abs=1e-12)

    def test_starts_where_it_is_told_and_nothing_else_depends_on_it(self, gymnast):
        coefficients = random_coefficients(2, 2)
        here, there = (drawn_plan(gymnast, coefficients, 0.3, orientation=start) for start in (0.0, 9.0))
        assert there.orientation(np.zeros(1)) == pytest.approx([9.0], abs=1e-15)
        assert there.orientation(TIMES) - 9.0 == pytest.approx(here.orientation(TIMES), abs=1e-14)

    def test_is_the_same_at_another_pace(self, gymnast):
        """Twice as slow, with half the angular momentum."""
        coefficients = random_coefficients(3, 2)
        quick = drawn_plan(gymnast, coefficients, 0.6)
        slow = drawn_plan(gymnast, coefficients / 2.0 ** np.arange(6), 0.3, duration=2.0)
        assert slow.orientation(2 * TIMES) == pytest.approx(quick.orientation(TIMES), abs=1e-14)

    def test_runs_back_when_time_does(self, gymnast):
        coefficients = random_coefficients(4, 2)
        backwards = np.array([np.poly1d(row[::-1])(np.poly1d([-1.0, 1.0])).coef[::-1] for row in coefficients])
        ahead = drawn_plan(gymnast, coefficients, 0.6).orientation(TIMES)
        back = drawn_plan(gymnast, backwards, -0.6).orientation(TIMES)
        assert back == pytest.approx(ahead[::-1] - ahead[-1], abs=1e-13)


def test_orientation_is_that_of_an_independent_integration(any_robot):
    coefficients = random_coefficients(5, len(any_robot.joints))
    plan = drawn_plan(any_robot, coefficients, 1.1, orientation=-0.4)
    expected = Look(plan, TIMES).orientation
    assert plan.orientation(TIMES) == pytest.approx(expected, abs=1e-10)
    assert plan.final_orientation == pytest.approx(expected[-1], abs=1e-10)


def test_a_wild_motion_gets_the_nodes_that_it_needs(gymnast):
    plan = drawn_plan(gymnast, random_coefficients(6, 2, size=6.0), 0.4)
    assert plan.orientation(TIMES) == pytest.approx(Look(plan, TIMES).orientation, abs=1e-10)
