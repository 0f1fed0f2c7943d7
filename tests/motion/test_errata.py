"""One test for each row of errata.md: what the paper prints does not hold on Pinocchio's robot, and what does."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from paper_appendix import TABLE_1, ThreeLinks

import floatplan as fp
from floatplan.motion.planar.full_model import PinocchioDynamics
from floatplan.robot.planar.inertia import inertia_extremes

PAPER = ThreeLinks(**TABLE_1)
H = 0.9  # kg m^2/s
ANGLES = np.array([[0.7, -0.4]])  # where errata.md gives H_11


@pytest.fixture(scope="module")
def pinocchio_dynamics(gymnast):
    return PinocchioDynamics(gymnast)


def draw(seed, count=50):
    rng = np.random.default_rng(seed)
    return rng.uniform(-np.pi, np.pi, (count, 2)), rng.normal(size=(count, 2)), rng.normal(size=(count, 2))


def largest_error(actual, expected):
    return np.abs(actual - expected).max() / np.abs(expected).max()


def centers_of_mass(robot, orientation, q):
    """Centres of mass (N, 2) relative to the foot, by Pinocchio."""
    data = robot.model.createData()
    rows = robot.reference + q @ robot.selection.T + np.outer(orientation, np.eye(len(robot.reference))[2])
    places = np.array([pin.centerOfMass(robot.model, data, row).copy() for row in rows])
    return places @ np.stack((robot.plane.horizontal, robot.plane.vertical), axis=1)


def test_6_takes_absolute_angles(gymnast):
    q, _, _ = draw(1)
    orientation = np.random.default_rng(2).uniform(-7, 7, len(q))
    expected = centers_of_mass(gymnast, orientation, q)

    def center(angles, A):
        return np.stack((np.cos(angles) @ A, np.sin(angles) @ A), axis=1)

    relative = np.column_stack((orientation, q))
    absolute = np.cumsum(relative, axis=1)
    assert np.abs(center(absolute, PAPER.A) - expected).max() < 1e-15
    assert np.abs(center(relative, PAPER.A) - expected).max() > 0.1
    assert np.abs(center(absolute, PAPER.printed_A) - expected).max() > 0.1


def test_15_is_4_solved_for_the_base_rate(gymnast, pinocchio_dynamics):
    """Put back into (4): the momentum that Pinocchio computes at the base rate is h."""
    q, velocity, _ = draw(3)
    D = pinocchio_dynamics.momentum_map(q)
    g0, g = 1 / D[:, 0], -D[:, 1:] / D[:, :1]
    printed_g0, printed_g = -H / D[:, 0], -D[:, 1:] / D[:, :1] * velocity
    data = gymnast.model.createData()

    def momenta(rates):
        full, full_velocity = np.pad(q, ((0, 0), (3, 0))), np.column_stack((0 * q, rates, velocity))
        states = zip(full, full_velocity, strict=True)
        moving = [pin.computeCentroidalMomentum(gymnast.model, data, *state).angular.copy() for state in states]
        return np.array(moving) @ gymnast.plane.normal

    assert np.abs(momenta(g0 * H + (g * velocity).sum(axis=1)) - H).max() < 1e-14
    assert np.abs(momenta(printed_g0 * H + (printed_g * velocity).sum(axis=1)) - H).min() > 0.1


def example(name, duration=None):
    problem = fp.load_problem(f"problems/{name}.toml")
    return problem if duration is None else replace_flight(problem, duration=duration)


def replace_flight(problem, **changes):
    return fp.Problem(
        problem.robot,
        problem.start,
        problem.goal,
        replace(problem.flight, **changes),
        problem.motion,
        problem.limits,
        name=problem.name,
    )


@pytest.fixture(autouse=True)
def _at_the_root(root, monkeypatch):
    monkeypatch.chdir(root)


def midpoint(problem):
    low, high = problem.momentum_interval
    return (low + high) / 2


def test_example_a_has_h_by_10():
    """The printed 0.13 is what (10) gives for T = 0.8 s; neither is what (11) would give, joints at rest."""
    problem = example("new_configuration_midpoint")
    assert problem.flight.duration == 1.1
    assert midpoint(problem) == pytest.approx(0.0941, abs=5e-5)
    assert midpoint(example("new_configuration_midpoint", duration=0.8)) == pytest.approx(0.1294, abs=5e-5)


@pytest.mark.parametrize(("name", "h"), [("new_configuration", 0.13), ("new_configuration_midpoint", 0.0941)])
def test_example_a_plans_with_either_h(planned, name, h):
    plan = planned(name)
    assert plan.ok
    assert plan.angular_momentum == pytest.approx(h, abs=5e-5)


def test_example_b_has_h_by_10():
    problem = example("handstand")
    assert problem.flight.duration == 1.4
    assert midpoint(problem) == pytest.approx(-1.1778, abs=5e-5)


@pytest.mark.parametrize(
    ("name", "start", "goal"),
    [("new_configuration", (0, 0), (0, 0)), ("new_configuration_moving", (0.08, -0.08), (0.01, -0.01))],
)
def test_example_a_plans_with_either_boundary_rates(planned, name, start, goal):
    plan = planned(name)
    assert plan.ok
    velocities = plan.at([0, plan.duration]).velocities
    assert velocities == pytest.approx(np.array([start, goal]), abs=1e-10)


def test_A_2_has_the_D_of_relative_rates(pinocchio_dynamics):
    still = np.zeros((1, 2))
    columns = [pinocchio_dynamics.torques(ANGLES, still, still + unit, np.zeros(1))[0] for unit in np.eye(2)]
    assert PAPER.H(ANGLES)[0] == pytest.approx(np.array(columns).T, rel=1e-13)
    assert PAPER.H(ANGLES)[0, 0, 0] == pytest.approx(0.1059, abs=5e-5)
    assert PAPER.printed_H(ANGLES)[0, 0, 0] == pytest.approx(-0.0605, abs=5e-5)


@pytest.mark.parametrize("gravity", [0.0, 9.81, 100.0])
def test_A_3_has_no_term_in_gravity(gymnast, gravity):
    """RNEA of the robot in a field of gravity, with its base falling freely; at rest in its joints, turning."""
    orientation, still = 0.6, np.zeros(2)
    q = draw(4)[0]
    model = gymnast.model.copy()
    model.gravity = pin.Motion(np.r_[-gravity * gymnast.plane.vertical, np.zeros(3)])
    data = model.createData()
    rates = H / PAPER.D(q)[:, 0]
    torques = np.empty_like(q)
    for k, position in enumerate(q):
        full, velocity = np.r_[0, 0, orientation, position], np.r_[0, 0, rates[k], still]
        mass = np.triu(pin.crba(model, data, full))
        mass += np.triu(mass, 1).T
        bias = pin.rnea(model, data, full, velocity, np.zeros(5)).copy()
        base = np.linalg.solve(mass[:3, :3], -bias[:3])
        torques[k] = bias[3:] + mass[3:, :3] @ base
        fall = base[:2] + _turning_acceleration(gymnast, data, model, full, velocity, base)
        assert fall == pytest.approx([0, -gravity], abs=1e-12 * max(gravity, 10))
    expected = PAPER.momentum_term(q, H)
    assert np.abs(torques - expected).max() < 1e-14 * max(1, gravity)
    printed = expected + PAPER.printed_gravity_term(orientation, q, gravity)
    assert (np.abs(torques - printed).max() > 1) == (gravity > 0)


def _turning_acceleration(robot, data, model, full, velocity, base):
    """Acceleration (2,) of the centre of mass relative to the base's origin."""
    pin.centerOfMass(model, data, full, velocity, np.r_[0, 0, base[2], 0, 0])
    return np.array([data.acom[0] @ robot.plane.horizontal, data.acom[0] @ robot.plane.vertical])


def test_A_1_has_gyroscopic_terms(pinocchio_dynamics):
    """Printed, C* stands for the Christoffel symbols of H alone: right only where h is zero."""
    q, velocity, acceleration = draw(5)
    for h in (0.0, H):
        rate = pinocchio_dynamics.base_rate(q, velocity, h)
        torques = pinocchio_dynamics.torques(q, velocity, acceleration, rate)
        corrected = PAPER.torques(q, velocity, acceleration, h)
        assert largest_error(torques, corrected) < 1e-13
        printed = corrected - PAPER.gyroscopic(q, velocity, h)
        assert (largest_error(torques, printed) > 0.1) == (h > 0)


def test_A_5_has_d_7_and_m_1(pinocchio_dynamics):
    q, _, _ = draw(6)
    expected = pinocchio_dynamics.momentum_map(q)
    assert largest_error(PAPER.D(q), expected) < 1e-15
    d_2_twice = PAPER.d.copy()  # the last line as printed: d_2 again, and no d_7
    d_2_twice[2], d_2_twice[7] = PAPER.d[7], 0
    assert largest_error(PAPER.D(q, d_2_twice), expected) > 0.01
    m = PAPER.m
    for i in (0, 2):  # whatever else the m_i in d_4 could be
        other_mass = PAPER.d.copy()
        other_mass[4] += m[0] * (m[i] - m[1]) * PAPER.l[1] ** 2 / sum(m)
        assert largest_error(PAPER.D(q, other_mass), expected) > 0.01


def test_table_1_has_these_extremes_of_D(gymnast):
    low, high = inertia_extremes(gymnast.tree, np.array([[-np.pi, np.pi]] * 2))
    assert low.round(5).tolist() == [0.32212, 0.16673, 0.01896]
    assert high.round(5).tolist() == [0.81135, 0.48981, 0.12512]
