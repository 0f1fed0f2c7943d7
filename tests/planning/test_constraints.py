"""Every constraint and objective: derivatives against differences, values against what they say they are.

In the plane by the reference in NumPy that the kernel is held to, and by the kernel where the rates at the ends follow
from h; those of the kernel's own are in ``tests/kernel``. A constraint that is added to ``constraints.py`` without a
case here fails the first test.
"""

from __future__ import annotations

from dataclasses import replace
from typing import get_args, get_type_hints

import numpy as np
import pytest
from general_flight import general_flight
from kernel_program import KernelProgram
from reduced_program import CoefficientNorm, IntegralOfSquares
from robot_samples import URDF_FOLDER
from sampled_flight import jacobian_of, sample_also, sample_nodes, trajectory, values_of
from scipy.integrate import simpson

import floatplan as fp
from floatplan import tables
from floatplan.arrays import read_only
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.constraints import (
    QUANTITIES,
    Constraint,
    RowTable,
    applies,
    clearance,
)
from floatplan.planning.constraints import limit as limit_of
from floatplan.planning.kernel_input.rows import DistanceRows, SumRows
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import decision_variables
from floatplan.problem.problem import Shares

CIRCLE = fp.Circle(center=(0.3, 1.2), radius=0.2, margin=0.02, velocity=(0.4, -0.2))
GROUND = fp.HalfPlane(point=(0.0, -0.3), normal=(0.1, 1.0), margin=0.01)
BAR = fp.Bar(start=(0.2, 0.5), end=(0.4, 1.4), radius=0.03, velocity=(0.1, 0.3), window=(0.2, 0.8))
LINKS = ("shank", "thigh", "trunk", "arms")
JOINTS, LIMITS = (0, 2), read_only([30.0, 12.0])
GROUPS = read_only([[1.0, 0.0, 0.0], [0.0, -0.5, 2.0]])
SLOPE = read_only([2.0, 0.3])
RATIOS = read_only([[1.0, 0.0, 0.0], [0.0, 0.0, -1.3]])

OF_JOINTS = np.eye(3)[list(JOINTS)]


def limit(key, rows, limits=LIMITS, **also) -> Constraint:
    row, names = tables.LIMIT_TABLE[key], tuple(f"{key} {number}" for number in range(len(rows)))
    return limit_of(Shares(key, names, limits, row.unit, {row.quantity: rows / limits[:, None]}, also), None)


CONSTRAINTS = {
    "circle": clearance(CIRCLE, CIRCLE.margin, LINKS, "it is there"),
    "half-plane": clearance(GROUND, GROUND.margin, LINKS * 2, "it is there"),
    "bar": clearance(BAR, BAR.margin, LINKS, "it is there", BAR.window),
    "self": clearance(((0,), (2, 3)), 0.05, ("shank", "arms"), "they are there"),
    "torque": limit("torque", GROUPS),
    "velocity": limit("velocity", OF_JOINTS),
    "acceleration": limit("acceleration", OF_JOINTS),
    "motor": limit("torque", OF_JOINTS, velocities=(SLOPE / LIMITS)[:, None] * RATIOS),
    "orientation rate": limit("orientation_rate", np.eye(1), read_only([4.0])),
}
ROWS = [block.rows for block in CONSTRAINTS.values()]
OBJECTIVES = {
    "coefficients": CoefficientNorm(8),
    "acceleration": IntegralOfSquares("accelerations", 300.0),
    "torque": IntegralOfSquares("torques", 5e4),
}
INSTANTS = np.array([0.0, 0.123, 0.5, 0.77, 1.0])  # besides the nodes; both ends among them


def test_every_row_of_the_tables_has_a_case():
    limited = {name for rows in ROWS if isinstance(rows, SumRows) for name in rows.weights}
    assert {row.quantity for row in tables.LIMIT_TABLE.values()} <= limited <= set(QUANTITIES)
    assert set(OBJECTIVES) == set(tables.OBJECTIVES) == set(tables.OBJECTIVE_TABLE) - {"clip"}


def test_every_kind_of_constraint_has_a_case():
    kinds = get_args(get_type_hints(Constraint)["rows"])
    assert set(kinds) == {type(rows) for rows in ROWS}


@pytest.fixture(scope="module")
def problem():
    """A flight of four links with everything that can move: rates at both ends, h free, unequal degrees."""
    robot = fp.Robot.from_urdf(URDF_FOLDER / "high_jumper.urdf", armature=0.3)
    start = fp.Posture(1.4, [0.3, -0.2, -2.0], [0.3, -0.5, 0.2], [1.0, 0.0, -2.0])
    goal = fp.Posture(3.4, [0.9, -1.0, -0.7], [0.0, 0.4, -0.3])
    flight = fp.Flight(0.9, "free", fp.Takeoff("foot"), fp.Landing("trunk", 0.8), horizontal_velocity=-2.0)
    return fp.Problem(robot, start, goal, flight, fp.Motion([7, 9, 7]))


@pytest.fixture(scope="module")
def flight(problem):
    """What evaluates a motion x in NumPy: (model, variables, sampling)."""
    branches = np.array([[0, 0, 0], [0, 1, -1]])
    variables = decision_variables(problem, problem.degrees, branches, flight_of(problem).momentum_set)
    polynomials = variables.polynomials
    assert variables.momentum.axes.shape[1] == 1
    sampling = sample_also(sample_nodes(gauss_grid(24), polynomials.form), INSTANTS)
    return general_flight(problem), variables, sampling


@pytest.fixture(scope="module", params=range(3))
def x(request, flight):
    """A random motion: p's random part 0.3 rad root mean square, h anywhere within (9)."""
    _, variables, _ = flight
    rng = np.random.default_rng(request.param)
    z = rng.normal(scale=0.3, size=(3, variables.polynomials.width))
    return variables.variables(z, variables.momentum.centre + variables.momentum.axes @ rng.uniform(-1, 1, 1))


def assert_derivative(values, derivative, x, scale):
    """Fourth-order central differences of values (...) by x against a derivative (..., size).

    Steps are in units of ``scale``: a column of it is a sensible change of x.
    """
    step = 1e-3
    for column in scale.T:
        ahead, behind, far_ahead, far_behind = (values(x + n * step * column) for n in (1, -1, 2, -2))
        expected = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * step)
        size = max(1.0, float(np.abs(expected).max()))
        assert np.abs(derivative @ column - expected).max() < 1e-6 * size


@pytest.fixture(scope="module")
def scale(flight):
    """Columns (size, size): changes of x that move p by 1e-1 rad, or h by a tenth of its reach."""
    return 0.1 * np.linalg.inv(flight[1].metric)


class TestDerivatives:
    """One finite-difference test for all blocks, by every variable, a free h included."""

    @pytest.mark.parametrize("name", CONSTRAINTS)
    def test_of_constraints(self, flight, x, scale, name):
        block = CONSTRAINTS[name]
        motion = trajectory(*flight, x)
        values, jacobian = values_of(block, motion), jacobian_of(block, motion)
        assert np.abs(jacobian).max() > 1e-3
        assert values.shape == (29, len(block.labels))
        assert_derivative(lambda at: values_of(block, trajectory(*flight, at)), jacobian, x, scale)

    @pytest.mark.parametrize("name", OBJECTIVES)
    def test_of_objectives(self, flight, x, scale, name):
        def value(at):
            return np.array(OBJECTIVES[name].value(trajectory(*flight, at), at))

        gradient = OBJECTIVES[name].gradient(trajectory(*flight, x), x)
        assert np.abs(gradient).max() > 1e-3
        assert_derivative(value, gradient, x, scale)


class TestRatesThatFollow:
    """The kernel's derivatives where the rates at both ends follow from a free h, and accelerations are free."""

    @pytest.fixture(params=[("coefficients", "free", 0.0), ("coefficients", 0.0, "free"), ("torque", "free", "free")])
    def following(self, request, problem):
        objective_name, at_takeoff, at_landing = request.param
        asked = replace(
            problem,
            start=replace(problem.start, velocities="takeoff", accelerations=at_takeoff),
            goal=replace(problem.goal, velocities="landing", accelerations=at_landing),
            flight=replace(problem.flight, landing=fp.Landing("hand", 0.8)),
            motion=fp.Motion([7, 9, 7], objective_name),
            limits=fp.Limits(velocity=20.0, acceleration=300.0, torque=30.0, orientation_rate=4.0),
            obstacles=(CIRCLE, GROUND, BAR),
            self_clearances=(fp.SelfClearance(("shank", "arms"), 0.05),),
        )
        branches = np.array([[0, 0, 0], [0, 1, -1]])
        variables = decision_variables(asked, asked.degrees, branches, flight_of(asked).momentum_set)
        assert variables.following
        return KernelProgram(asked, NODE_COUNTS.index(24), tuple(INSTANTS), variables)

    @pytest.fixture(params=range(3))
    def there(self, request, following):
        variables, rng = following.variables, np.random.default_rng(request.param)
        z = rng.normal(scale=0.3, size=(3, variables.polynomials.width))
        return variables.variables(z, variables.momentum.centre + variables.momentum.axes @ rng.uniform(-1, 1, 1))

    def test_of_the_whole_program(self, following, there):
        here, scale = following.evaluate(there), 0.01 * np.linalg.inv(following.variables.metric)
        assert len(here.inequality) > 500
        assert_derivative(lambda at: following.evaluate(at).equality, here.equality_jacobian, there, scale)
        assert_derivative(lambda at: following.evaluate(at).inequality, here.inequality_jacobian, there, scale)
        assert_derivative(lambda at: np.array(following.evaluate(at).objective), here.gradient, there, scale)
        eigenvalues = np.linalg.eigvalsh(following.whole(there)["hessian"])
        assert eigenvalues.min() > 1e-6 * eigenvalues.max()


class TestConstraints:
    """What the values mean, from the state that :class:`floatplan.Plan` reports."""

    def test_limits(self, flight, x):
        motion = trajectory(*flight, x)
        torque, velocity = motion.flown.motor_torques @ GROUPS.T, motion.motion.velocities[:, JOINTS]
        for name, state in (("torque", torque), ("velocity", velocity)):
            slack = (values_of(CONSTRAINTS[name], motion) * CONSTRAINTS[name].scale).reshape(-1, 2, 2)
            assert slack.min(axis=1) == pytest.approx(LIMITS - np.abs(state), abs=1e-11)
        slack = (values_of(CONSTRAINTS["motor"], motion) * CONSTRAINTS["motor"].scale).reshape(-1, 4, 2)
        torque, velocity = motion.flown.motor_torques[:, JOINTS], motion.motion.velocities @ RATIOS.T
        expected = LIMITS - np.abs(torque) - SLOPE * np.abs(velocity)
        assert slack.min(axis=1) == pytest.approx(expected, abs=1e-11)
        slack = values_of(CONSTRAINTS["orientation rate"], motion) * 4.0
        assert slack.min(axis=1) == pytest.approx(4.0 - np.abs(motion.flown.rate[:, 0]), abs=1e-12)

    def test_obstacles_exist_in_their_windows(self):
        s = np.array([0.0, 0.2, 0.5, 0.8, 0.81])
        assert applies(CONSTRAINTS["bar"], s).tolist() == [False, True, True, True, False]
        for name in CONSTRAINTS.keys() - {"bar"}:
            assert applies(CONSTRAINTS[name], s).all()
        assert RowTable.of(tuple(CONSTRAINTS.values())).window_ends == (0.2, 0.8)

    def test_of_a_problem_are_all_that_it_asks_for(self, problem):
        limits = fp.Limits(velocity={"q2": 9.0}, torque=40.0, motor={"q1": fp.Motor(50.0, 2.0)}, orientation_rate=5.0)
        asked = fp.Problem(
            problem.robot,
            problem.start,
            problem.goal,
            problem.flight,
            limits=limits,
            obstacles=(CIRCLE, GROUND),
            self_clearances=(fp.SelfClearance(("shank", "arms"), 0.05),),
        )
        made = FlightSpec(asked).constraints
        assert [type(block.rows) for block in made] == [DistanceRows] * 3 + [SumRows] * 4
        assert [len(block.labels) for block in made] == [4, 8, 1, 6, 2, 4, 2]
        assert FlightSpec(problem).constraints == ()
        named = {label for block in made for label in block.labels}
        assert {"clearance of trunk to obstacle 0 (circle)", "torque of q3", "velocity of q2"} <= named


class TestObjectives:
    @pytest.mark.parametrize(("name", "unit"), [("acceleration", 300.0), ("torque", 5e4)])
    def test_integrals_are_those_of_the_squares(self, flight, x, name, unit):
        """Against Simpson's rule."""
        model, variables, _ = flight
        nodes = sample_nodes(gauss_grid(96), variables.polynomials.form)
        s = np.linspace(0, 1, 2001)
        dense = trajectory(model, variables, sample_also(nodes, s), x)
        values = (dense.flown.torques if name == "torque" else dense.motion.accelerations)[96:]
        expected = simpson((values**2).sum(axis=1), x=0.9 * s) / unit
        found = OBJECTIVES[name].value(trajectory(model, variables, nodes, x), x)
        assert found == pytest.approx(expected, rel=1e-8)
