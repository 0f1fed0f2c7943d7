"""How the momentum changes with the joints, and bodies that turn alike."""

import numpy as np
import pytest
from general_flight import GeneralDynamics

import floatplan as fp
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.full_model import PinocchioDynamics
from floatplan.robot.planar.inertia import TurningBodies
from floatplan.robot.urdf.tree import robots_folder


def test_change_of_the_base_rate_is_its_derivative(any_robot):
    rng = np.random.default_rng(11)
    n = len(any_robot.joints)
    positions, velocities, momentum = rng.uniform(-4, 4, (50, n)), rng.uniform(-5, 5, (50, n)), rng.uniform(-5, 5, 50)
    dynamics = GeneralDynamics(any_robot.tree)
    actual = dynamics.base_rate_derivatives(positions, velocities, momentum).by_position

    def rate(at):
        return dynamics.base_rate(at, velocities, momentum)

    step = 1e-5 * np.eye(n)
    expected = np.stack([(rate(positions + d) - rate(positions - d)) / 2e-5 for d in step], axis=1)
    assert np.abs(actual - expected).max() < 1e-8 * np.abs(expected).max()


def test_bodies_that_turn_alike_are_one(any_robot):
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
    assert Dynamics(go2.tree).momentum_map(positions) == pytest.approx(expected, rel=1e-12, abs=1e-13)
