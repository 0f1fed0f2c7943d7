"""Momentum, base rate and torques: the Appendix as corrected, and the closed form against Pinocchio."""

import numpy as np
import pytest
from generated_problems import random_chain
from make_chain import GYMNAST, Body
from paper_appendix import TABLE_1, ThreeLinks
from robot_free_flyer import relative_error

from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.full_model import PinocchioDynamics

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
