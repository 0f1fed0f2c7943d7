"""The two ways to evaluate D are one: a cosine for each pair of bodies, and the rotation of each body."""

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.planar.momentum import FEW_BODIES, BodyRotations, PairCosines, TurningBodies, momentum_mapping
from floatplan.motion.planar.pinocchio_dynamics import PinocchioDynamics
from floatplan.robot.urdf.example_robots import robots_folder


@pytest.fixture
def state(any_robot):
    rng = np.random.default_rng(11)
    n = len(any_robot.joints)
    return rng.uniform(-4, 4, (50, n)), rng.uniform(-5, 5, (50, n)), rng.uniform(-5, 5, 50)


class TestTwoWays:
    def test_give_the_same_D(self, any_robot, state):
        cosines, rotations = (
            way(TurningBodies.of(any_robot.tree))(state[0]).rows for way in (PairCosines, BodyRotations)
        )
        assert np.abs(cosines - rotations).max() < 1e-13 * np.abs(rotations).max()

    def test_give_the_same_change_of_momentum(self, any_robot, state):
        positions, velocities, rate = state
        cosines, rotations = (
            way(TurningBodies.of(any_robot.tree))(positions).momentum_by_position(rate, velocities)
            for way in (PairCosines, BodyRotations)
        )
        assert np.abs(cosines - rotations).max() < 1e-13 * np.abs(rotations).max()

    @pytest.mark.parametrize("way", [PairCosines, BodyRotations])
    def test_change_of_momentum_is_its_derivative(self, any_robot, state, way):
        positions, velocities, rate = state
        mapping = way(TurningBodies.of(any_robot.tree))

        def momentum(at):
            return (mapping(at).rows * np.concatenate((rate[:, None], velocities), axis=1)).sum(axis=1)

        actual = mapping(positions).momentum_by_position(rate, velocities)
        step = 1e-5 * np.eye(positions.shape[1])
        expected = np.stack([(momentum(positions + d) - momentum(positions - d)) / 2e-5 for d in step], axis=1)
        assert np.abs(actual - expected).max() < 1e-8 * np.abs(expected).max()


def test_few_bodies_go_by_cosines(gymnast, any_robot):
    assert isinstance(momentum_mapping(gymnast.tree), PairCosines)
    assert isinstance(momentum_mapping(any_robot.tree), PairCosines) == (
        len(TurningBodies.of(any_robot.tree).turns) <= FEW_BODIES
    )


def test_bodies_that_turn_alike_are_one(any_robot, state):
    """D against Pinocchio's, for as many bodies as rows of turns differ; a coupled quadruped has 5 of 9."""
    bodies = TurningBodies.of(any_robot.tree)
    assert len(bodies.turns) == len(np.unique(any_robot.tree.turns, axis=0))
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    go2 = fp.Robot.from_urdf("example-robot-data:go2_description/urdf/go2.urdf", coupled="mirror")
    merged = TurningBodies.of(go2.tree)
    assert (len(merged.turns), len(go2.tree.mass)) == (5, 9)
    positions = np.random.default_rng(3).uniform(-3, 3, (20, len(go2.joints)))
    expected = PinocchioDynamics(go2).momentum_map(positions)
    for way in (PairCosines, BodyRotations):
        assert way(merged)(positions).rows == pytest.approx(expected, rel=1e-12, abs=1e-13)
