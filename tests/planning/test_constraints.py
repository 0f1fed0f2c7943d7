"""Every constraint and objective: derivatives against differences, values against what they say they are.

In the plane by the reference in NumPy that the kernel is held to, and by the kernel where the rates at the ends follow
from h; those of the kernel's own are in ``tests/kernel``. A constraint that is added to ``constraints.py`` without a
case here fails the first test.
"""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest
from general_flight import general_flight
from kernel_program import KernelProgram
from reduced_program import CoefficientNorm, FlightProgram, IntegralOfSquares, objective, watching
from robot_samples import URDF_FOLDER
from sampled_flight import jacobian_of, nodes_of, sample_also, sample_nodes, trajectory, values_of
from scipy.integrate import simpson

import floatplan as fp
from floatplan import tables
from floatplan.arrays import read_only
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form
from floatplan.planning import constraints as constraints_module
from floatplan.planning.constraints import (
    QUANTITIES,
    Clearance,
    Constraint,
    Limit,
    applies,
    constraints,
    link_clearance,
    obstacle_clearance,
)
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


def limit(key, rows, limits=LIMITS, **also) -> Limit:
    row, names = tables.LIMIT_TABLE[key], tuple(f"{key} {number}" for number in range(len(rows)))
    return Limit.of(Shares(key, names, limits, row.unit, {row.quantity: rows / limits[:, None]}, also))


CONSTRAINTS = {
    "circle": obstacle_clearance(CIRCLE, "circle", LINKS),
    "half-plane": obstacle_clearance(GROUND, "ground", LINKS * 2),
    "bar": obstacle_clearance(BAR, "bar", LINKS, window=BAR.window),
    "self": link_clearance((0,), (2, 3), ("shank", "arms"), 0.05),
    "torque": limit("torque", GROUPS),
    "velocity": limit("velocity", OF_JOINTS),
    "acceleration": limit("acceleration", OF_JOINTS),
    "motor": limit("torque", OF_JOINTS, velocities=(SLOPE / LIMITS)[:, None] * RATIOS),
    "orientation rate": limit("orientation_rate", np.eye(1), read_only([4.0])),
}
OBJECTIVES = {
    "coefficients": CoefficientNorm(8),
    "acceleration": IntegralOfSquares("accelerations", 300.0),
    "torque": IntegralOfSquares("torques", 5e4),
}
INSTANTS = np.array([0.0, 0.123, 0.5, 0.77, 1.0])  # besides the nodes; both ends among them


def test_every_row_of_the_tables_has_a_case():
    limited = {name for block in CONSTRAINTS.values() if isinstance(block, Limit) for name in block.weights}
    assert {row.quantity for row in tables.LIMIT_TABLE.values()} <= limited <= set(QUANTITIES)
    assert set(OBJECTIVES) == set(tables.OBJECTIVES) == set(tables.OBJECTIVE_TABLE) - {"clip"}


def test_every_kind_of_constraint_has_a_case():
    classes = filter(inspect.isclass, vars(constraints_module).values())
    made = {each for each in classes if issubclass(each, Constraint)}
    assert made - {Constraint} == {type(block) for block in CONSTRAINTS.values()}


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
    assert variables.momentum.free == 1
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

    def test_of_14(self, flight, x, scale):
        jacobian = trajectory(*flight, x).residual_jacobian
        assert np.abs(jacobian).min() > 0
        assert_derivative(lambda at: trajectory(*flight, at).residual, jacobian, x, scale)

    def test_of_18(self, flight, x, scale):
        jacobian = trajectory(*flight, x).attitude_jacobian[:, 0]
        assert_derivative(lambda at: trajectory(*flight, at).flown.attitude, jacobian, x, scale)

    def test_of_the_whole_program(self, flight, x, scale):
        """Objective, (14), the rows of (9) for a free h, and all constraints, as the SQP sees them."""
        program = FlightProgram(*flight, CoefficientNorm(flight[1].coefficients), tuple(CONSTRAINTS.values()))
        here = program.evaluate(x)
        assert_derivative(lambda at: program.evaluate(at).equality, here.equality_jacobian, x, scale)
        assert_derivative(lambda at: program.evaluate(at).inequality, here.inequality_jacobian, x, scale)
        assert_derivative(lambda at: np.array(program.evaluate(at).objective), here.gradient, x, scale)


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

    def test_the_norm_of_coefficients_is_17(self, following, there):
        if following.problem.motion.objective != "coefficients":
            pytest.skip("another objective")
        variables = following.variables

        def both(at):
            motions = variables.motion_class(variables.angular_momentum(at))
            b = motions.powers_of_seconds(variables.free_coefficients(at))
            return (b**2).sum() / following.evaluate(at).objective

        assert both(there) == pytest.approx(both(-there), rel=1e-9)

    def test_given_states_stand_and_the_frames_rest(self, following, there):
        model, variables = flight_of(following.problem), following.variables
        ends = sample_also(nodes_of(-2, variables.polynomials.form), np.array([0.0, 1.0]))
        motion = trajectory(model, variables, ends, there).motion
        rates = variables.following.rates(variables.angular_momentum(there))
        assert motion.velocities[-2:] == pytest.approx(rates, abs=1e-10)
        for end, free in enumerate(end in variables.polynomials.free_ends for end in (2, 5)):
            given = variables.following.accelerations[end]
            assert not given.any() if free else motion.accelerations[end - 2] == pytest.approx(given, abs=1e-8)


class TestConstraints:
    """What the values mean, from the state that :class:`floatplan.Plan` reports."""

    @pytest.mark.parametrize("name", CONSTRAINTS)
    def test_derivatives_need_no_values_before_them(self, flight, x, name):
        before, after = trajectory(*flight, x), trajectory(*flight, x)
        values_of(CONSTRAINTS[name], before)
        assert (jacobian_of(CONSTRAINTS[name], before) == jacobian_of(CONSTRAINTS[name], after)).all()

    @pytest.mark.parametrize("name", CONSTRAINTS)
    def test_labels_units_and_scales_fit(self, name):
        block = CONSTRAINTS[name]
        assert len(block.labels) == len(block.scale)
        assert (block.scale > 0).all()
        assert block.unit in ("m", "N m", "rad/s", "rad/s^2")

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
        assert constraints_module.RowTable.of(tuple(CONSTRAINTS.values())).window_ends == (0.2, 0.8)

    @pytest.mark.parametrize("window", [(-1.0, 0.45), (0.45, 7.0), (-1.0, 7.0), (0.0, 5e-324), (0.3, 0.3000001)])
    def test_windows_are_fractions_of_the_flight(self, problem, window):
        obstacle = replace(BAR, window=window)
        (block,) = constraints(replace(problem, obstacles=(obstacle,)), flight_of(problem))
        expected = np.clip(np.array(window) / problem.flight.duration, 0.0, 1.0)
        assert block.window == tuple(expected)
        assert applies(block, expected).all()

    def test_window_ends_are_instants_of_the_program_as_they_are(self):
        nodes = sample_nodes(gauss_grid(24), Form(3))
        ends = (np.nextafter(1 / 3, 1), 0.7000001234567891)
        block = obstacle_clearance(BAR, "bar", LINKS, window=ends)
        sampling = watching(nodes, (block, CONSTRAINTS["circle"]), np.array([0.5]))
        assert sampling.grid.s[24:].tolist() == [ends[0], 0.5, ends[1]]

    def test_margin_is_subtracted(self, flight, x):
        motion = trajectory(*flight, x)
        wider = obstacle_clearance(replace(CIRCLE, margin=0.12), "circle", LINKS)
        gap = (values_of(CONSTRAINTS["circle"], motion) - values_of(wider, motion)) * wider.scale
        assert gap == pytest.approx(0.1, abs=1e-13)

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
        made = constraints(asked, flight_of(asked))
        kinds = [Clearance] * 3 + [Limit] * 4
        assert [type(block) for block in made] == kinds
        assert [len(block.labels) for block in made] == [4, 8, 1, 6, 2, 4, 2]
        assert constraints(problem, flight_of(problem)) == ()
        named = {label for block in made for label in block.labels}
        assert {"clearance of trunk to obstacle 0 (circle)", "torque of q3", "velocity of q2"} <= named

    def test_a_link_of_several_capsules_has_a_row_for_each_pair(self):
        block = link_clearance((0, 1), (2, 3, 4), ("a", "b"), 0.0)
        assert len(block.labels) == len(block.scale) == 6


class TestObjectives:
    def test_coefficient_norm_is_17(self, flight, x):
        """``|b|^2 = constant + unit^2 |x|^2``: differences of |b|^2 are in proportion to those of the objective."""
        _, variables, _ = flight
        norm = OBJECTIVES["coefficients"]

        def both(at):
            b = variables.polynomials.powers_of_seconds(variables.free_coefficients(at))
            return (b**2).sum(), norm.value(trajectory(*flight, at), at)

        origin, here, twice = both(0 * x), both(x), both(2 * x)
        assert origin[1] == 0
        assert twice[0] - origin[0] == pytest.approx(4 * (here[0] - origin[0]), rel=1e-9)
        other = both(x[::-1].copy())
        ratio = (here[0] - origin[0]) / here[1]
        assert (other[0] - origin[0]) / other[1] == pytest.approx(ratio, rel=1e-9)

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

    @pytest.mark.parametrize("name", OBJECTIVES)
    def test_hessians_are_positive_definite(self, flight, x, name):
        hessian = OBJECTIVES[name].hessian(trajectory(*flight, x))
        assert hessian == pytest.approx(hessian.T, rel=1e-12)
        eigenvalues = np.linalg.eigvalsh(hessian)
        assert eigenvalues.min() > 1e-4 * eigenvalues.max()

    @pytest.mark.parametrize("name", ["coefficients", "torque", "acceleration"])
    def test_of_a_problem_is_of_size_one(self, problem, name):
        asked = fp.Problem(problem.robot, problem.start, problem.goal, problem.flight, fp.Motion(7, name))
        model = flight_of(asked)
        branches = np.zeros((2, 3), dtype=np.int64)
        variables = decision_variables(asked, (7,) * 3, branches, flight_of(asked).momentum_set)
        sampling = sample_nodes(gauss_grid(32), Form(2))
        made = objective(asked, model, variables, sampling)
        assert type(made) is type(OBJECTIVES[name])
        if name != "coefficients":
            plain = variables.plain_motion
            value = made.value(trajectory(model, variables, sampling, plain), plain)
            assert value == pytest.approx(1.0, rel=1e-12)


class TestVariables:
    def test_there_and_back(self, flight, x):
        _, variables, _ = flight
        z, momentum = variables.free_coefficients(x), variables.angular_momentum(x)
        assert variables.variables(z, momentum) == pytest.approx(x, rel=1e-9, abs=1e-9)
        assert (z != 0).sum() == sum(variables.polynomials.free) == variables.coefficients

    def test_plain_motion_is_the_hermite_one_at_the_middle_h(self, flight):
        _, variables, _ = flight
        plain = variables.plain_motion
        assert np.abs(variables.free_coefficients(plain)).max() < 1e-9
        assert variables.angular_momentum(plain) == variables.momentum.centre

    def test_metric_is_the_root_mean_square_of_p(self, flight, x):
        """Over time and joints, of the change that a step makes to p; h is measured by its reach."""
        _, variables, _ = flight
        step = np.append(x[:-1], 0.0)
        fine = sample_nodes(gauss_grid(64), variables.polynomials.form)
        z = variables.free_coefficients(step) - variables.free_coefficients(0 * x)
        change = fine.values[0][:, 6:] @ z.T
        expected = np.sqrt(fine.grid.weights @ (change**2).mean(axis=1))
        assert np.linalg.norm(variables.metric @ step) == pytest.approx(expected, rel=1e-10)
        assert variables.metric[-1].tolist() == [0.0] * variables.coefficients + [1.0]
