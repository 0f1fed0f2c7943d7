"""The reference method's dynamics and motions: against the Appendix, the closed form, differences."""

from __future__ import annotations

import numpy as np
import pytest
from paper_appendix import TABLE_1, ThreeLinks
from plain_problems import plain_problems

import floatplan as fp
from floatplan.method.dynamics import Dynamics
from floatplan.method.motion import Motions
from floatplan.motion.planar.closed_form import tree_dynamics
from floatplan.motion.planar.full_model import PinocchioDynamics

STATES = 20  # random ones of a robot
STEP = 1e-6  # of differences
SLOPE = 1e-6  # [-] by which derivatives may differ from them, relative to the largest


def states_of(robot: fp.Robot, seed: int) -> np.ndarray:
    """Random states u (N, 3n+2): q, q', q'', h, theta_0."""
    return np.random.default_rng(seed).normal(size=(STATES, 3 * len(robot.joints) + 2))


def differences(function, point: np.ndarray) -> np.ndarray:
    """Central differences of a function of a vector, column by column."""
    columns = []
    for index in range(len(point)):
        step = np.zeros(len(point))
        step[index] = STEP
        columns.append((function(point + step) - function(point - step)) / (2 * STEP))
    return np.transpose(columns)


def assert_slopes(actual: np.ndarray, expected: np.ndarray) -> None:
    assert np.abs(actual - expected).max() <= SLOPE * max(1.0, np.abs(expected).max())


@pytest.fixture
def armed(any_robot: fp.Robot) -> fp.Robot:
    """Every chain and some trees, in all planes, coupled and locked; with rotors."""
    choices = {"plane": any_robot.plane.name, "locked": any_robot.locked, "coupled": any_robot.coupled}
    return fp.Robot.from_urdf(any_robot.path, **choices, armature=0.02)


def test_momentum_of_table_1_is_A_4(gymnast):
    paper, dynamics = ThreeLinks(**TABLE_1), Dynamics(gymnast)
    for u in states_of(gymnast, 0):
        assert dynamics.momentum_map(u[:2]) == pytest.approx(paper.D(u[None, :2])[0], rel=1e-12)


def test_momentum_rates_and_torques_are_those_of_the_closed_form_and_of_the_full_model(armed):
    """The closed form is what the kernel computes; the full model gives a finished plan's numbers."""
    dynamics, n = Dynamics(armed), len(armed.joints)
    closed, full = tree_dynamics(armed.tree), PinocchioDynamics(armed)
    for u in states_of(armed, 1):
        state = u[None, :n], u[None, n : 2 * n]
        assert dynamics.momentum_map(u[:n]) == pytest.approx(closed.momentum_map(state[0])[0], rel=1e-9, abs=1e-12)
        rate = closed.base_rate(*state, u[-2])
        assert dynamics.base_rate(u)[0] == pytest.approx(rate, rel=1e-9)
        moments = closed.moments(*state, u[None, 2 * n : 3 * n], rate)
        own = dynamics.quantities(u)
        assert own["torques"][0] == pytest.approx((moments @ armed.tree.turns)[0], rel=1e-8, abs=1e-8)
        motors = (moments @ armed.tree.motor_turns)[0]
        assert own["motor_torques"][0] == pytest.approx(motors, rel=1e-8, abs=1e-8)
        forces = full.full_forces(*state, u[None, 2 * n : 3 * n], rate)[0]
        assert dynamics.torques(u)[0] == pytest.approx(forces, rel=1e-8, abs=1e-8)


def test_derivatives_are_differences(armed):
    dynamics = Dynamics(armed)
    weights = armed.tree.point_weights(np.arange(len(armed.tree.mass)), np.full(len(armed.tree.mass), 0.3 - 0.2j))
    for u in states_of(armed, 2)[:3]:
        for quantity in (dynamics.base_rate, dynamics.torques):
            assert_slopes(quantity(u)[1], differences(lambda at, of=quantity: of(at)[0], u))
        for name, (_, by_u) in dynamics.quantities(u).items():
            assert_slopes(by_u, differences(lambda at, of=name: dynamics.quantities(at)[of][0], u))
        assert_slopes(
            dynamics.points(u, weights)[1].view(float),
            differences(lambda at: dynamics.points(at, weights)[0], u).copy().view(float),
        )


@pytest.mark.parametrize("number", range(0, 40, 8))
def test_motions_meet_their_ends_whatever_the_variables(number):
    """(12) keeps the range, (13) holds on every branch, (17) is of a plan's b, derivatives are differences."""
    problem, rng = plain_problems(number + 1)[number], np.random.default_rng(number)
    motions = Motions(problem, problem.degrees, rng.integers(-1, 2, len(problem.robot.joints)))
    low, high = problem.position_limits.T
    for z in (np.zeros(motions.size), rng.normal(size=motions.size)):
        ends, _ = motions.at(np.array([0.0, 1.0]), z)
        for end, state in zip(ends, (problem.initial, problem.final), strict=True):
            asked = np.concatenate((state.positions, state.velocities, state.accelerations))
            assert end == pytest.approx(asked, abs=1e-8)
        moving, by_z = motions.at(np.linspace(0, 1, 7), z)
        assert (np.abs(moving[:, : len(low)] - (low + high) / 2) <= (high - low) / 2 * (1 + 1e-12)).all()
        slopes = differences(lambda at: motions.at(np.linspace(0, 1, 7), at)[0].ravel(), z)
        assert_slopes(by_z.reshape(slopes.shape), slopes)
        b, b_by_z = motions.b(z)
        exact = motions.polynomials.powers_of_seconds(motions.coefficients(z)).ravel()
        assert b == pytest.approx(exact, rel=1e-9, abs=1e-9 * np.abs(exact).max())
        assert_slopes(b_by_z, differences(lambda at: motions.b(at)[0], z))
