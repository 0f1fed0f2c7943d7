"""Flight in space: attitudes against another integrator, derivatives against differences, a planar plan flown there."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.motion.spatial.attitude import IntegrationError, cells, turn
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.motion.spatial.momentum import _PlainMotion, suggested_momentum
from floatplan.motion.spatial.rotations import (
    cross_matrix,
    exponential,
    left_jacobian_inverse,
    logarithm,
    of_angles,
    unwrapped_angles,
)

URDF = Path(__file__).resolve().parents[2] / "urdf"
DURATION = 0.8
LEVEL = fp.Attitude(quaternion_xyzw=(0, 0, 0, 1))


@pytest.fixture(scope="module")
def diver():
    return fp.Robot.from_urdf(URDF / "diver.urdf", base="free-flyer")


@pytest.fixture(scope="module")
def swinging(diver):
    """Dynamics, h, the attitude at takeoff, and the joints' positions and velocities at times (K,)."""
    rng, n = np.random.default_rng(5), len(diver.joints)
    sizes, phases, dynamics = 0.4 * rng.normal(size=(3, n)), rng.uniform(0, 6, (3, n)), spatial_dynamics(diver)
    pace = np.array([3.0, 5.0, 8.0])[:, None]

    def joints(times):
        angle = pace * np.atleast_1d(times)[:, None, None] + phases
        return (sizes * np.sin(angle)).sum(axis=1), (pace * sizes * np.cos(angle)).sum(axis=1)

    h = dynamics.momentum_maps(joints(0.0)[0])[0][0] @ [2.0, 7.0, 3.0]
    return dynamics, h, exponential(rng.normal(size=(1, 3)))[0], joints


def momenta(dynamics, joints, grid):
    positions, velocities = joints(grid.s * DURATION)
    inertia, joint_map = dynamics.momentum_maps(positions)
    return inertia, np.einsum("kan,kn->ka", joint_map, velocities)


def integrated(swinging, times):
    """Attitudes at times, by DOP853 on the matrix."""
    dynamics, h, start, joints = swinging

    def rate(time, flat):
        rotation, (positions, velocities) = flat.reshape(3, 3), joints(time)
        inertia, joint_map = dynamics.momentum_maps(positions)
        omega = np.linalg.solve(inertia[0], rotation.T @ h - joint_map[0] @ velocities[0])
        return (rotation @ cross_matrix(omega)).ravel()

    span = (0.0, DURATION)
    return solve_ivp(rate, span, start.ravel(), "DOP853", times, rtol=1e-12, atol=1e-13).y.T.reshape(-1, 3, 3)


def test_the_attitude_is_that_of_another_integrator_at_every_instant(swinging):
    dynamics, h, start, joints = swinging
    instants = np.array([0.0, 0.07, 0.4, 0.63, 1.0])
    expected = integrated(swinging, instants * DURATION)
    for (count, stages), error in {(16, 5): 1e-5, (16, 8): 1e-7, (32, 10): 1e-11}.items():
        grid = cells(count, stages)
        turning = turn(grid, DURATION, *momenta(dynamics, joints, grid), h, start)
        assert np.abs(turning.at(instants) - expected).max() < error
        assert np.abs(turning.at(grid.s) - turning.attitudes).max() < 1e-13
        gaps = logarithm(turning.borders[1:] @ np.swapaxes(turning.ends[:-1], 1, 2))
        assert np.abs(gaps).max() < 1e-12


def test_without_momentum_the_attitude_is_a_quadrature_of_its_own(swinging):
    dynamics, _, start, joints = swinging
    grid = cells(32, 10)
    turning = turn(grid, DURATION, *momenta(dynamics, joints, grid), np.zeros(3), start)
    expected = integrated((dynamics, np.zeros(3), start, joints), np.array([DURATION]))
    assert np.abs(turning.ends[-1] - expected[0]).max() < 1e-11


def test_small_turns_go_on_as_differences_say(swinging):
    dynamics, h, start, joints = swinging
    grid = cells(16, 8)
    inertia, relative = momenta(dynamics, joints, grid)
    turning = turn(grid, DURATION, inertia, relative, h, start)
    nudge = 1e-6 * np.array([0.3, -0.5, 0.8])

    def ends(sign):
        borders = exponential(np.tile(sign * nudge, (16, 1))) @ turning.borders
        return turn(grid, DURATION, inertia, relative, h, borders).ends

    differences = logarithm(ends(1) @ np.swapaxes(ends(-1), 1, 2)) / 2
    assert np.abs(differences - turning.carried[0] @ nudge).max() < 1e-6 * np.linalg.norm(nudge)


def test_a_motion_that_is_too_wild_is_an_error_of_its_own(swinging):
    dynamics, h, start, joints = swinging
    grid = cells(8, 5)
    inertia, relative = momenta(dynamics, joints, grid)
    with pytest.raises(IntegrationError):
        turn(grid, DURATION, inertia, relative, 1e5 * h, start)


def test_the_logarithm_changes_as_its_derivative_says():
    turn_vector, small = np.array([0.4, -1.1, 0.7]), 1e-6 * np.array([[0.2, 0.9, -0.4]])
    after = [logarithm(exponential(sign * small) @ exponential(turn_vector[None]))[0] for sign in (1, -1)]
    assert (after[0] - after[1]) / 2 == pytest.approx(left_jacobian_inverse(turn_vector) @ small[0], rel=1e-6)
    assert left_jacobian_inverse(np.zeros(3)) == pytest.approx(np.eye(3))


def test_the_attitude_at_landing_changes_with_the_momentum_as_differences_say():
    problem = fp.load_problem(URDF.parent / "problems" / "space" / "diver_half_twist.toml")
    plain, h, step = _PlainMotion(problem), np.array([5.0, 30.0, -8.0]), 1e-4
    _, slope = plain.residual(h)
    for axis, direction in enumerate(np.eye(3)):
        ends = [plain.residual(h + sign * step * direction)[0] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(slope[:, axis], rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("axes", ["yxz", "xyz", "zxz", "yzx"])
def test_angles_go_on_over_whole_turns(axes):
    middle = 1.2 if axes[0] == axes[2] else 0.3
    s = np.linspace(0, 1, 60)[:, None]
    angles = s * [4 * math.pi, 0, -3 * math.pi] + [0.1, middle, -0.2]
    found = unwrapped_angles(axes, of_angles(axes, angles))
    assert found - found[0] == pytest.approx(angles - angles[0], abs=1e-9)


def test_a_planar_plan_flown_in_space_is_the_planar_plan():
    """The same joints' motion and momentum; the gymnast is its own mirror image, and so never leaves the plane."""
    planar = fp.plan(fp.load_problem(URDF.parent / "problems" / "handstand.toml"))
    robot = fp.Robot.from_urdf(URDF / "gymnast.urdf", base="free-flyer", joints=list(planar.robot.joints))
    normal, ends = planar.robot.plane.normal, (planar.problem.initial, planar.problem.final)

    def posture(end):
        turned = Rotation.from_rotvec(end.orientation * normal).as_quat()
        return fp.Posture(fp.Attitude(quaternion_xyzw=tuple(turned)), end.positions, end.velocities, end.accelerations)

    flight = planar.problem.flight
    problem = fp.Problem(
        robot,
        *map(posture, ends),
        fp.Flight(
            flight.duration,
            tuple(planar.angular_momentum * normal),
            fp.Takeoff(flight.takeoff.frame, (0.0, 0.0, 0.0)),
            fp.Landing(flight.landing.frame, planar.problem.landing_height),
            (flight.horizontal_velocity, 0.0),
        ),
        limits=fp.Limits(position=planar.problem.position_limits),
    )
    written = WrittenMotion.from_powers(planar.centre, planar.amplitude, planar.coefficients, planar.duration)

    flight = flight_of(problem)
    spatial = flight.whole_motion(written, planar.angular_momentum * normal, flight.ballistics)
    times = np.linspace(0, planar.duration, 9)
    expected, state = planar.at(times), spatial.state(times)
    turned = Rotation.from_rotvec(expected.orientation[:, None] * normal)
    assert np.abs((turned.inv() * Rotation.from_quat(state.orientation)).as_rotvec()).max() < 1e-9
    assert state.torques == pytest.approx(expected.torques, abs=1e-9)
    assert state.com_position[:, [0, 2]] == pytest.approx(expected.com_position, abs=1e-12)
    assert state.base_position[:, [0, 2]] == pytest.approx(expected.base_position, abs=1e-9)


def test_what_is_suggested_turns_the_plain_motion_to_the_goal(diver):
    low, high = diver.position_limits.T
    posture = (low + high) / 2
    start, goal = fp.Attitude(angles=(0.1, 0, 0), axes="yxz"), fp.Attitude(angles=(0.1 + 2 * math.pi, 0, 0), axes="yxz")
    problem = fp.Problem(diver, fp.Posture(start, posture), fp.Posture(goal, posture), fp.Flight(1.2, "suggested"))
    h = suggested_momentum(problem)
    plain = fp.plan(problem)
    assert plain.ok
    assert plain.objective_value < 1e-9
    assert plain.angular_momentum == pytest.approx(h)
    assert abs(h[1]) > 50 * np.hypot(h[0], h[2])


def test_for_a_twist_alone_the_momentum_along_its_axis_is_suggested(diver):
    posture = diver.position_limits.mean(axis=1)
    start, goal = (fp.Attitude(angles=(0.2, 0.3, c), axes="yxz") for c in (0.5, 0.5 - 4 * math.pi))
    problem = fp.Problem(diver, fp.Posture(start, posture), fp.Posture(goal, posture), fp.Flight(1.2, "suggested"))
    plan = fp.plan(problem)
    assert plan.ok
    along = of_angles("yxz", np.array([[0.2, 0.3, 0.0]]))[0][:, 2]
    assert plan.angular_momentum @ along == pytest.approx(-np.linalg.norm(plan.angular_momentum))


@pytest.mark.parametrize("angles", [(0.4, -0.3, 0.2), (0.01, 0.8, 0.7), (0, 0, -0.9)])
def test_small_turns_about_any_axes_need_no_joints(diver, angles):
    posture = diver.position_limits.mean(axis=1)
    level, turned = (fp.Attitude(angles=each, axes="yxz") for each in ((0, 0, 0), angles))
    problem = fp.Problem(diver, fp.Posture(level, posture), fp.Posture(turned, posture), fp.Flight(1.2, "suggested"))
    plain = fp.plan(problem)
    assert plain.ok
    assert plain.objective_value < 1e-9


def test_the_motion_in_the_files_coordinates_is_one_of_pinocchio(diver):
    """No force on the base but gravity, q' = v, v' = a, and the momentum is constant."""
    plan = fp.plan(fp.load_problem(URDF.parent / "problems" / "space" / "diver_half_twist.toml"))
    assert plan.ok
    model = pin.buildModelFromXML(diver.xml, pin.JointModelFreeFlyer())
    model.gravity = pin.Motion(np.array([0.0, 0.0, -9.81]), np.zeros(3))
    data, step = model.createData(), 1e-5
    for time in (0.1, 0.6, 1.3):
        q, v, a, tau = (getattr(plan, name)(time) for name in ("q", "v", "a", "tau"))
        assert pin.rnea(model, data, q, v, a) == pytest.approx(tau, abs=1e-9)
        before, after = plan.q(time - step), plan.q(time + step)
        assert pin.difference(model, before, after) / (2 * step) == pytest.approx(v, abs=1e-5)
        assert (plan.v(time + step) - plan.v(time - step)) / (2 * step) == pytest.approx(a, abs=2e-3)
        momentum = pin.computeCentroidalMomentum(model, data, q, v).angular
        assert momentum == pytest.approx(plan.angular_momentum, abs=1e-9)
