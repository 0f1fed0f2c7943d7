"""Momentum, base rate and torques: the Appendix as corrected, and the closed form against Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from general_flight import BaseRate, GeneralDynamics
from generated_problems import random_chain
from make_chain import GYMNAST, Body
from paper_appendix import TABLE_1, ThreeLinks
from robot_free_flyer import relative_error

from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.full_model import BASE, PinocchioDynamics

COUNT = 1000  # random configurations
H = -1.7  # kg m^2/s
ENGINES = {"closed form": lambda robot: Dynamics(robot.tree), "Pinocchio": PinocchioDynamics}


def draw(rng, robot, count):
    """Positions, velocities, accelerations (count, n)."""
    n = len(robot.joints)
    return rng.uniform(-np.pi, np.pi, (count, n)), rng.normal(size=(count, n)), rng.normal(size=(count, n))


def errors_by_state(actual, expected):
    """Largest error of each state's numbers, relative to the state's largest number."""
    flat = (len(expected), -1)
    size = np.abs(expected).reshape(flat).max(axis=1)
    return np.abs(actual - expected).reshape(flat).max(axis=1) / size


@pytest.fixture(params=["Table I", *range(5)])
def three_links(request, gymnast):
    """A robot of three links and its row of constants: Table I, or one in which l and r differ."""
    if request.param == "Table I":
        return gymnast, ThreeLinks(**TABLE_1)
    robot = random_chain(np.random.default_rng(request.param), 2)
    tree = robot.tree
    length = np.array([*tree.anchor.real[1:], robot.frames["hand"].local.real])
    return robot, ThreeLinks(tuple(tree.center.real), tuple(length - tree.center.real), tree.mass, tree.inertia)


def test_table_1_is_the_script_s_gymnast():
    assert tuple(Body(f"body{i}", *row) for i, row in enumerate(zip(*TABLE_1.values(), strict=True))) == GYMNAST


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
class TestAppendix:
    def test_D_is_A_4(self, three_links, engine):
        robot, paper = three_links
        q, _, _ = draw(np.random.default_rng(1), robot, COUNT)
        assert errors_by_state(engine(robot).momentum_map(q), paper.D(q)).max() < 1e-12

    def test_H_is_A_2(self, three_links, engine):
        """Column j of H is what a unit acceleration of joint j takes at rest."""
        robot, paper = three_links
        q, _, _ = draw(np.random.default_rng(2), robot, COUNT)
        still = np.zeros((COUNT, 2))
        columns = [engine(robot).torques(q, still, still + unit, np.zeros(COUNT)) for unit in np.eye(2)]
        assert errors_by_state(np.stack(columns, axis=2), paper.H(q)).max() < 1e-12

    def test_momentum_term_is_A_3(self, three_links, engine):
        """At rest in its joints the robot turns at h / D_0."""
        robot, paper = three_links
        q, _, _ = draw(np.random.default_rng(3), robot, COUNT)
        still = np.zeros((COUNT, 2))
        torques = engine(robot).torques(q, still, still, H / paper.D(q)[:, 0])
        expected = paper.momentum_term(q, H)
        assert np.abs(torques - expected).max() < 1e-12 * np.abs(expected).max()

    def test_torques_are_A_1(self, three_links, engine):
        robot, paper = three_links
        q, velocity, acceleration = draw(np.random.default_rng(4), robot, COUNT)
        dynamics = engine(robot)
        torques = dynamics.torques(q, velocity, acceleration, dynamics.base_rate(q, velocity, H))
        assert errors_by_state(torques, paper.torques(q, velocity, acceleration, H)).max() < 1e-10

    def test_base_rate_solves_4(self, three_links, engine):
        robot, paper = three_links
        q, velocity, _ = draw(np.random.default_rng(5), robot, COUNT)
        D = paper.D(q)
        rate = engine(robot).base_rate(q, velocity, H)
        assert np.abs(D[:, 0] * rate + (D[:, 1:] * velocity).sum(axis=1) - H).max() < 1e-13


def test_A_are_A_7(three_links):
    """The tree's weights of the centre of mass as seen from the foot."""
    robot, paper = three_links
    foot = robot.tree.point_weights(np.array([0]), np.array([0j]))[0]
    assert relative_error(-foot.real, paper.A) < 1e-12
    assert np.abs(foot.imag).max() < 1e-15


class TestClosedFormAgainstPinocchio:
    def test_values(self, any_robot):
        closed, full = Dynamics(any_robot.tree), PinocchioDynamics(any_robot)
        q, velocity, acceleration = draw(np.random.default_rng(6), any_robot, 50)
        rate = full.base_rate(q, velocity, H)
        assert errors_by_state(closed.momentum_map(q), full.momentum_map(q)).max() < 1e-12
        assert relative_error(closed.base_rate(q, velocity, H), rate) < 1e-12
        expected = full.torques(q, velocity, acceleration, rate)
        assert relative_error(closed.torques(q, velocity, acceleration, rate), expected) < 1e-12

    def test_derivatives_of_the_base_rate(self, any_robot):
        q, velocity, _ = draw(np.random.default_rng(8), any_robot, 20)
        actual = GeneralDynamics(any_robot.tree).base_rate_derivatives(q, velocity, H)
        for k in range(len(q)):
            expected = pinocchio_base_rate_derivatives(any_robot, q[k], velocity[k])
            assert relative_error(actual.by_position[k], expected.by_position) < 1e-11
            assert relative_error(actual.by_velocity[k], expected.by_velocity) < 1e-12
            assert relative_error(actual.by_momentum[k], expected.by_momentum) < 1e-12

    def test_derivatives_of_the_torques(self, any_robot):
        closed = GeneralDynamics(any_robot.tree)
        q, velocity, acceleration = draw(np.random.default_rng(9), any_robot, 20)
        base_rate = closed.base_rate_derivatives(q, velocity, H)
        actual = any_robot.tree.turns.T @ closed.moment_derivatives(q, velocity, acceleration, base_rate)
        n = q.shape[1]
        for k in range(len(q)):
            by_position, by_velocity, by_acceleration, by_momentum = pinocchio_torque_derivatives(
                any_robot, q[k], velocity[k], acceleration[k]
            )
            assert relative_error(actual[k, :, :n], by_position) < 1e-10
            assert relative_error(actual[k, :, n : 2 * n], by_velocity) < 1e-10
            assert relative_error(actual[k, :, 2 * n : 3 * n], by_acceleration) < 1e-11
            assert relative_error(actual[k, :, 3 * n], by_momentum) < 1e-10


def full_state(robot, position, velocity, rate):
    """Position and velocity (nv,) of the planar model, the base's origin at rest in the world's."""
    return robot.reference + robot.selection @ position, robot.selection @ velocity + rate * np.eye(
        len(robot.reference)
    )[2]


def pinocchio_base_rate_derivatives(robot, position, velocity):
    """By implicit differentiation of h(q, theta0', q') with ``computeCentroidalDynamicsDerivatives``."""
    data = robot.model.createData()
    dynamics = PinocchioDynamics(robot)
    rate = dynamics.base_rate(position[None], velocity[None], H)[0]
    full, full_velocity = full_state(robot, position, velocity, rate)
    still = np.zeros_like(full)
    by_q, _, _, by_v = pin.computeCentroidalDynamicsDerivatives(robot.model, data, full, full_velocity, still)
    normal = np.r_[np.zeros(3), robot.plane.normal]
    inertia = normal @ by_v[:, 2]
    return BaseRate(
        rate,
        by_velocity=-(normal @ by_v @ robot.selection) / inertia,
        by_momentum=1 / inertia,
        differentiate=lambda: -(normal @ by_q @ robot.selection) / inertia,
    )


def pinocchio_torque_derivatives(robot, position, velocity, acceleration):
    """Derivatives by position, velocity, acceleration and h, with ``computeRNEADerivatives``.

    The base rate follows from h, the base's acceleration from the wrench on it, which stays zero.
    """
    rate = pinocchio_base_rate_derivatives(robot, position, velocity)
    dynamics = PinocchioDynamics(robot)
    base = dynamics.base_acceleration(*(row[None] for row in (position, velocity, acceleration)), np.array([rate.rate]))
    full, full_velocity = full_state(robot, position, velocity, rate.rate)
    full_acceleration = robot.selection @ acceleration + np.r_[base[0], np.zeros(len(full) - BASE)]
    data = robot.model.createData()
    by_q, by_v, mass = (
        np.array(values)
        for values in pin.computeRNEADerivatives(robot.model, data, full, full_velocity, full_acceleration)
    )
    mass = np.triu(mass) + np.triu(mass, 1).T
    turning = by_v[:, 2:3]
    direct = (
        by_q @ robot.selection + turning * rate.by_position,
        by_v @ robot.selection + turning * rate.by_velocity,
        mass @ robot.selection,
        turning[:, 0] * rate.by_momentum,
    )
    response = np.linalg.solve(mass[:BASE, :BASE], np.eye(BASE))
    return [robot.selection.T @ (block - mass[:, :BASE] @ response @ block[:BASE]) for block in direct]
