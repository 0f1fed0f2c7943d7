"""Rates with which a frame is at rest at takeoff or landing: the optimum by brute force, the motion by Pinocchio."""

import itertools

import numpy as np
import pinocchio as pin
import pytest

import floatplan as fp
from floatplan.motion.planar.contact_rates import at_end, contact_rates, equations_at, rate_limits

POSTURES = 30  # of each of eight robots


def random_problem(robot, rng):
    """A flight between random postures, with limits, from the frame of a random body that is not the base's."""
    low, high = np.clip(robot.position_limits, -np.pi, np.pi).T
    n = len(robot.joints)
    start, goal = (low + (high - low) * rng.uniform(0.05, 0.95, n) for _ in range(2))
    frames = sorted(name for name, frame in robot.frames.items() if frame.body)
    takeoff, landing = rng.choice(frames, 2)
    flight = fp.Flight(
        duration=rng.uniform(0.3, 1.0),
        takeoff=fp.Takeoff(takeoff),
        landing=fp.Landing(landing),
        horizontal_velocity=rng.uniform(-2, 2),
    )
    limits = fp.Limits(velocity=rng.uniform(5, 30, n))
    return fp.Problem(robot, fp.Posture(rng.uniform(-3, 3), start), fp.Posture(1.0, goal), flight, limits=limits)


def brute_force(equations, momentum, limits):
    """Least ratio over all vertices of the linear program: every joint but one at plus or minus its limit."""
    target = equations.target(momentum)
    scale = np.abs(equations.matrix).max(axis=1)
    matrix, target = equations.matrix / scale[:, None], target / scale
    n, best = len(limits), np.inf
    for free in range(n):
        others = [index for index in range(n) if index != free]
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=n - 1))).reshape(2 ** (n - 1), n - 1)
        pushes = (signs * limits[others]) @ matrix[:, 1:][:, others].T
        systems = np.empty((len(signs), 3, 3))
        systems[:, :, 0], systems[:, :, 1], systems[:, :, 2] = matrix[:, 0], matrix[:, 1 + free], pushes
        systems = systems[np.abs(np.linalg.det(systems)) > 1e-11]
        if len(systems):
            _, rate, ratio = np.linalg.solve(systems, np.broadcast_to(target[:, None], (len(systems), 3, 1)))[..., 0].T
            best = min(best, ratio[np.abs(rate) <= limits[free] * ratio * (1 + 1e-10)].min(initial=np.inf))
    return best


class TestOptimum:
    @pytest.mark.parametrize("end", ["takeoff", "landing"])
    def test_is_that_of_all_vertices(self, any_robot, end):
        rng = np.random.default_rng(7)
        for _ in range(POSTURES // 2):
            problem = random_problem(any_robot, rng)
            momentum = float(rng.normal() * any_robot.mass)
            found = contact_rates(problem, end, momentum)
            best = brute_force(equations_at(problem.robot, *at_end(problem, end)), momentum, rate_limits(problem))
            assert found.ratio == pytest.approx(best, rel=1e-9)
            if not found.exist:
                assert len(any_robot.joints) == 1
                continue
            assert np.max(np.abs(found.rates) / rate_limits(problem)) == pytest.approx(best, rel=1e-9)

    def test_free_momentum_is_the_best(self, any_robot):
        rng = np.random.default_rng(8)
        for _ in range(5):
            problem = random_problem(any_robot, rng)
            best = contact_rates(problem, "takeoff", None)
            again = contact_rates(problem, "takeoff", best.angular_momentum)
            assert again.ratio == pytest.approx(best.ratio, rel=1e-9)
            for step in rng.normal(size=20) * any_robot.mass:
                other = contact_rates(problem, "takeoff", best.angular_momentum + float(step))
                assert other.ratio >= best.ratio * (1 - 1e-9)


class TestMotion:
    @pytest.mark.parametrize("end", ["takeoff", "landing"])
    @pytest.mark.parametrize("free", [False, True])
    def test_pinocchio_finds_frame_at_rest_and_momentum_and_velocity_as_asked(self, any_robot, end, free):
        rng = np.random.default_rng(11)
        for _ in range(10):
            problem = random_problem(any_robot, rng)
            momentum = float(rng.normal() * any_robot.mass)
            found = contact_rates(problem, end, None if free else momentum)
            if not found.exist:
                assert len(any_robot.joints) == 1
                continue
            state = problem.initial if end == "takeoff" else problem.final
            frame = problem.takeoff.frame if end == "takeoff" else problem.landing.frame
            speed, h = moved(any_robot, state, found, frame, com_velocity(problem, end))
            size = max(1.0, float(np.abs(found.rates).max()) / 100)
            assert speed < 1e-9 * size
            assert h == pytest.approx(found.angular_momentum, rel=1e-9, abs=1e-9 * any_robot.mass * size)


def com_velocity(problem, end):
    """From the definition: the difference of the parabola's ends."""
    robot, flight = problem.robot, problem.flight
    places = [
        frame_over_com(robot, state, frame)
        for state, frame in ((problem.initial, problem.takeoff.frame), (problem.final, problem.landing.frame))
    ]
    rise = (problem.landing_height - places[1]) - (problem.takeoff.position[1] - places[0])
    sign = 1 if end == "takeoff" else -1
    vertical = rise / flight.duration + sign * flight.gravity * flight.duration / 2
    return np.array([flight.horizontal_velocity, vertical])


def full_positions(robot, state):
    positions = robot.reference + robot.selection @ state.positions
    positions[2] += state.orientation
    return positions


def frame_id(robot, name):
    """Of the link or joint; a link where both have the name."""
    kinds = (pin.FrameType.BODY, pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
    return next(robot.model.getFrameId(name, kind) for kind in kinds if robot.model.existFrame(name, kind))


def frame_over_com(robot, state, name):
    data = robot.model.createData()
    positions = full_positions(robot, state)
    pin.framesForwardKinematics(robot.model, data, positions)
    place = data.oMf[frame_id(robot, name)].translation - pin.centerOfMass(robot.model, data, positions)
    return float(place @ robot.plane.vertical)


def moved(robot, state, found, frame, velocity):
    """The frame's speed in the plane, and h, where rates are as found and the centre of mass moves as asked."""
    model, data = robot.model, robot.model.createData()
    positions, rates = full_positions(robot, state), robot.selection @ found.rates
    rates[2] += found.orientation_rate
    axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
    pin.centerOfMass(model, data, positions, rates)
    rates[:2] = velocity - axes @ data.vcom[0]
    pin.forwardKinematics(model, data, positions, rates)
    pin.updateFramePlacements(model, data)
    at = pin.getFrameVelocity(model, data, frame_id(robot, frame), pin.LOCAL_WORLD_ALIGNED).linear
    h = pin.computeCentroidalMomentum(model, data, positions, rates).angular @ robot.plane.normal
    pin.centerOfMass(model, data, positions, rates)
    assert axes @ data.vcom[0] == pytest.approx(velocity, abs=1e-9)
    return float(np.linalg.norm(axes @ at)), float(h)


class TestSpecialCases:
    def test_without_limits_the_largest_rate_is_least(self, gymnast):
        flight = fp.Flight(1.0, takeoff=fp.Takeoff("foot"))
        problem = fp.Problem(gymnast, fp.Posture(1.2, [0.5, -0.8]), fp.Posture(-1.0, [0.1, 0.2]), flight)
        found = contact_rates(problem, "takeoff", 2.0)
        equations = equations_at(problem.robot, *at_end(problem, "takeoff"))
        only = np.linalg.solve(equations.matrix, equations.target(2.0))
        assert found.ratio is None
        assert [found.orientation_rate, *found.rates] == pytest.approx(only, rel=1e-9)
        free = contact_rates(problem, "takeoff", None)
        assert np.abs(free.rates).max() < np.abs(found.rates).max()
        assert abs(free.rates[0]) == pytest.approx(abs(free.rates[1]))

    def test_stricter_of_urdf_and_problem(self, tmp_path):
        robot = fp.Robot.from_urdf("urdf/high_jumper.urdf")
        state = fp.Posture(1.2, [0.4, -0.4, -1.0])
        flight = fp.Flight(0.5, takeoff=fp.Takeoff("foot"))
        problem = fp.Problem(robot, state, state, flight, limits=fp.Limits(velocity={"q1": 5.0, "q3": 100.0}))
        assert rate_limits(problem).tolist() == [5.0, 12.0, 20.0]
