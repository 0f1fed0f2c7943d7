"""The reference method's dynamics, its program, its SQP and its inner QPs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from method_flights import plan_there
from plain_problems import plain_problems

import floatplan as fp
from floatplan.method import starts
from floatplan.method.dynamics import QUANTITIES, Dynamics
from floatplan.method.program import LENGTH_SCALE, Evaluation, Program
from floatplan.method.sqp import MOST_STEPS, elastic_step, minimise
from floatplan.motion.planar.closed_form import tree_dynamics
from floatplan.motion.planar.full_model import PinocchioDynamics

STEP, SLOPE = 1e-6, 2e-6
INSTANTS = np.array([0.11, 0.37, 0.52, 0.83])


def test_momentum_rates_and_torques_are_those_of_the_closed_form_and_of_the_full_model(any_robot):
    """The closed form is what the kernel computes; the full model gives a finished plan's numbers."""
    choices = {"plane": any_robot.plane.name, "locked": any_robot.locked, "coupled": any_robot.coupled}
    armed = fp.Robot.from_urdf(any_robot.path, **choices, armature=0.02)
    dynamics, n = Dynamics(armed), len(armed.joints)
    closed, full = tree_dynamics(armed.tree), PinocchioDynamics(armed)
    for u in np.random.default_rng(1).normal(size=(20, 3 * n + 2)):  # q, q', q'', h, theta_0
        state, jets = (u[None, :n], u[None, n : 2 * n]), u[None, :, None]
        assert dynamics.momentum_map(jets[:, :n])[0] == pytest.approx(
            closed.momentum_map(state[0])[0], rel=1e-9, abs=1e-12
        )
        rate = closed.base_rate(*state, u[-2])
        assert dynamics.rates(jets)[0, 0] == pytest.approx(rate, rel=1e-9)
        moments = closed.moments(*state, u[None, 2 * n : 3 * n], rate)
        assert QUANTITIES["torques"](dynamics, jets)[0, :, 0] == pytest.approx(
            (moments @ armed.tree.turns)[0], rel=1e-8, abs=1e-8
        )
        motors = (moments @ armed.tree.motor_turns)[0]
        assert QUANTITIES["motor_torques"](dynamics, jets)[0, :, 0] == pytest.approx(motors, rel=1e-8, abs=1e-8)
        forces = full.full_forces(*state, u[None, 2 * n : 3 * n], rate)[0]
        assert dynamics.torques(jets)[0, :, 0] == pytest.approx(forces, rel=1e-8, abs=1e-8)


@pytest.fixture
def everything(gymnast: fp.Robot) -> fp.Problem:
    """A flight with every kind of limit and obstacle that the method takes."""
    return fp.Problem(
        gymnast,
        start=fp.Posture.degrees(72, [18, -45]),
        goal=fp.Posture.degrees(-90, [0, 0]),
        flight=fp.Flight(1.4, "free", horizontal_velocity=2.0),
        motion=fp.Motion(degree=[7, 8]),
        limits=fp.Limits(velocity=9.0, torque=5.0, acceleration=90.0, orientation_rate=8.0),
        obstacles=[
            fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02),
            fp.Circle(center=(0.5, 3.0), radius=0.1, velocity=(0.3, -0.2)),
            fp.HalfPlane(point=(0.0, -0.5), normal=(0.1, 1.0)),
        ],
    )


def program_of(problem: fp.Problem) -> Program:
    return Program(problem, np.array(problem.degrees), np.array([0, 1]))


@pytest.mark.parametrize("objective", ["coefficients", "torque", "acceleration"])
def test_derivatives_are_differences(everything, objective):
    """Of objective, (14) and every inequality, by all variables, h among them."""
    everything = replace(everything, motion=fp.Motion(degree=[7, 8], objective=objective))
    program, rng = program_of(everything), np.random.default_rng(0)
    x = rng.normal(scale=0.5, size=program.size)

    def residuals(x: np.ndarray) -> np.ndarray:
        variables = np.column_stack((x, np.eye(len(x))))
        return program.residuals(variables, program.states(variables, np.zeros(0)))

    here = program.evaluate(x, INSTANTS)
    assert here.hessian == pytest.approx(residuals(x)[:, 1:].T @ residuals(x)[:, 1:], rel=1e-9)
    assert len(here.rows) == 2 + 4 * (3 * 2 * 2 + 2 + 3 + 3 + 6)
    for index in range(program.size):
        step = np.zeros(program.size)
        step[index] = STEP
        ahead, behind = program.evaluate(x + step, INSTANTS), program.evaluate(x - step, INSTANTS)
        slope = (residuals(x + step)[:, 0] - residuals(x - step)[:, 0]) / (2 * step[index])
        own = residuals(x)[:, 1 + index]
        assert np.abs(own - slope).max() <= SLOPE * max(1.0, np.abs(own).max()), index
        slope = (ahead.rows - behind.rows) / (2 * step[index])
        own = here.rows_by_x[:, index]
        assert np.abs(own - slope).max() <= SLOPE * max(1.0, np.abs(own).max()), index
        slope = (ahead.objective - behind.objective) / (2 * step[index])
        assert here.gradient[index] == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_rows_are_what_a_plan_measures(everything):
    """Torques, rates, orientation and clearances of the plan with the same motion, by the full model."""
    program = program_of(everything)
    x = np.random.default_rng(1).normal(scale=0.3, size=program.size)
    plan = plan_there(program, x)
    state, used = plan.at(INSTANTS * plan.duration), 1 - program.inequalities(x, INSTANTS)
    u = program.states(x[:, None], INSTANTS)[-len(INSTANTS) :]
    assert u[:, -1, 0] == pytest.approx(state.orientation, abs=1e-6)
    assert np.abs(state.torques / 5.0) == pytest.approx(np.maximum(used[:, :2], used[:, 2:4]), abs=1e-6)
    assert (np.abs(state.orientation_rate) / 8.0) == pytest.approx(used[:, -14:-12].max(axis=1), abs=1e-6)
    lowest = (1 - used[:, -12:]).min(axis=1) * LENGTH_SCALE
    assert np.isfinite(lowest).all()
    clear = program.inequalities(x, np.linspace(0, 1, 2001))[:, -12:-9].min() * LENGTH_SCALE + 0.02
    only = replace(everything, obstacles=everything.obstacles[:1])
    assert replace(plan, problem=only).peaks.clearance == pytest.approx(clear, abs=1e-5)


def test_a_qp_without_solution_has_an_elastic_step():
    """x >= 1 and x <= -1 leave x between, where both lack 1; y = -0.5 can be met, and is no worse."""
    rows, rows_by_x = np.array([0.5, -0.5, -1.0, -1.0]), np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])
    at = Evaluation(0.0, np.zeros(2), np.eye(2), rows, rows_by_x)
    direction, _, left = elastic_step(at, np.eye(2), 10.0, 100.0)
    assert direction[0] == pytest.approx(0.0, abs=1e-6)
    assert left == pytest.approx(1.0, abs=1e-6)
    possible = at._replace(rows=np.array([0.5, -0.5, -1.0, 3.0]))
    direction, multipliers, left = elastic_step(possible, np.eye(2), 10.0, 100.0)
    assert direction == pytest.approx([1.0, -0.5], abs=1e-8)
    assert left == pytest.approx(0.0, abs=1e-9)
    assert (multipliers >= 0).all()
    assert direction == pytest.approx(rows_by_x.T @ multipliers, abs=1e-7)  # the Lagrangian's gradient is zero


@pytest.mark.parametrize("number", [8, 9, 17])
def test_a_minimum_stays_one(number):
    """Begun at its own solution, the SQP stays."""
    program, x = next(starts(plain_problems(number + 1)[number], np.random.default_rng(0)))
    solution, there, steps = minimise(program, x, np.zeros(0))
    assert steps < MOST_STEPS
    assert there.rows.min() > -1e-9
    *_, steps = minimise(program, solution, np.zeros(0))
    assert steps <= 1
