"""Flight in space: attitudes against another integrator, derivatives against differences, a planar plan flown there."""

import math

import numpy as np
import pinocchio as pin
import pytest
from places import URDF
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.motion.spatial.attitude import cells, turn
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.motion.spatial.momentum import suggested_momentum
from floatplan.motion.spatial.rotations import cross_matrix, exponential, logarithm

DURATION = 0.8


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


def test_a_planar_plan_flown_in_space_is_the_planar_plan(handstand):
    """The same joints' motion and momentum; the gymnast is its own mirror image, and so never leaves the plane."""
    planar = handstand
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


def test_the_motion_in_the_files_coordinates_is_one_of_pinocchio(diver, planned):
    """No force on the base but gravity, q' = v, v' = a, and the momentum is constant."""
    plan = planned("space/diver_half_twist")
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
