"""Rates with which a frame is at rest at takeoff or landing: the optimum by brute force, the motion by Pinocchio."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robot_samples import TWO_LINKS, robot_text
from scipy.optimize import linprog

import floatplan as fp
from floatplan.motion.planar.contact_rates import (
    at_end,
    contact_rates,
    equations_at,
    has_contact,
    least_rates,
    rate_limits,
)
from floatplan.robot.urdf.tree import robots_folder

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

    def test_joint_is_the_one_whose_limit_holds_back_most(self, any_robot):
        rng = np.random.default_rng(9)
        for _ in range(5):
            problem = random_problem(any_robot, rng)
            found = contact_rates(problem, "takeoff", 1.0)
            limits = rate_limits(problem)
            ratios = []
            for index in range(len(limits)):
                lowered = limits * np.where(np.arange(len(limits)) == index, 1 - 1e-5, 1)
                ratios.append(contact_rates(replace(problem, limits=fp.Limits(velocity=lowered)), "takeoff", 1.0).ratio)
            if found.joint is not None:
                motor = any_robot.motors.index(found.joint)
                leader = int(np.flatnonzero(any_robot.motor_ratios[motor])[0])
                assert ratios[leader] == pytest.approx(max(ratios), rel=1e-9)
                assert max(ratios) > found.ratio

    @pytest.mark.parametrize("seed", range(4))
    def test_of_any_columns_as_highs_finds_it(self, seed):
        """Also where rates without limits, parallel columns and weak ones are among them."""
        rng = np.random.default_rng(seed)
        for trial in range(100):
            free, limited = int(rng.integers(1, 3)), int(rng.integers(1, 8))
            columns, target = rng.normal(size=(3, free + limited)), rng.normal(size=3)
            limits = np.concatenate((np.full(free, np.inf), rng.uniform(1, 30, limited)))
            if trial % 3 == 0:
                columns[:, -1] = columns[:, 0] + 2 * columns[:, -2]
            if trial % 5 == 0:
                columns[:, -1] *= 1e-4
            if trial % 7 == 0:
                limits[-1] = np.inf
            found = least_rates(columns, target, limits)
            best = by_highs(columns, target, limits)
            assert (best is None) == np.isinf(found.ratio)
            if best is not None:
                assert found.ratio == pytest.approx(best, rel=1e-7, abs=1e-9)
                assert np.max(np.abs(found.values) / limits) == pytest.approx(best, rel=1e-7, abs=1e-9)
                assert columns @ found.values == pytest.approx(target, abs=1e-9)
                assert found.influence.sum() == pytest.approx(1.0 if best > 1e-9 else found.influence.sum())

    @pytest.mark.parametrize("joints", [2, 3, 9])
    def test_no_joint_moves_the_foot(self, joints):
        rng = np.random.default_rng(joints)
        columns, limits = rng.standard_normal((3, joints + 1)), np.r_[np.inf, rng.uniform(0.5, 2.0, joints)]
        columns[1:, 1:] = 0.0
        found = least_rates(columns, rng.standard_normal(3), limits)
        assert np.isinf(found.ratio)
        assert np.isnan(found.values).all()

    def test_limits_of_any_size(self):
        """The least and the largest that a problem may have, side by side."""
        columns = np.array([[1.0, 2.0, 0.5, 1.0], [0.3, -1.0, 1.0, 0.2], [0.1, 0.4, 0.7, -1.0]])
        target = np.array([1.0, 2.0, -0.5])
        for limits in ([1e-9, 1e12, 1.0], [1e-9, 1e-9, 1e12], [1e12, 1e12, 1e-9]):
            found = least_rates(columns, target, np.array([np.inf, *limits]))
            assert columns @ found.values == pytest.approx(target, rel=1e-9)
            assert np.max(np.abs(found.values[1:]) / limits) == pytest.approx(found.ratio, rel=1e-9)
            bounds = []
            for index in (1, 2, 3):
                normal, others = np.cross(columns[:, 0], columns[:, index]), [i for i in (1, 2, 3) if i != index]
                strength = np.abs(normal @ columns[:, others]) @ [limits[i - 1] for i in others]
                bounds.append(abs(normal @ target) / strength)
            assert found.ratio == pytest.approx(max(bounds), rel=1e-9)

    def test_ties_are_broken_alike_in_any_order_and_sign(self):
        """Two equal legs and a mirror pair: several rates have the least largest ratio."""
        rng = np.random.default_rng(3)
        leg = rng.normal(size=(3, 2))
        columns = np.column_stack((rng.normal(size=3), leg, leg, [0.0, 0.0, 1e-3], rng.normal(size=(3, 2)) * 0.1))
        limits = np.array([np.inf, 9.0, 7.0, 9.0, 7.0, 5.0, 3.0, 3.0])
        target = rng.normal(size=3)
        expected = least_rates(columns, target, limits)
        assert expected.values[1:3] == pytest.approx(expected.values[3:5], abs=1e-9)
        for _ in range(20):
            order, signs = rng.permutation(8), rng.choice([-1.0, 1.0], 8)
            found = least_rates((columns * signs)[:, order], target, limits[order])
            assert found.ratio == pytest.approx(expected.ratio, rel=1e-12)
            assert found.values == pytest.approx((expected.values * signs)[order], rel=1e-9, abs=1e-11)


def by_highs(columns, target, limits):
    count = len(limits)
    bounds = [
        np.eye(count, count + 1)[i] * sign - limits[i] * np.eye(count + 1)[-1]
        for i in np.flatnonzero(np.isfinite(limits))
        for sign in (1, -1)
    ]
    solution = linprog(
        np.eye(count + 1)[-1],
        A_ub=np.array(bounds).reshape(-1, count + 1),
        b_ub=np.zeros(len(bounds)),
        A_eq=np.column_stack((columns, np.zeros(3))),
        b_eq=target,
        bounds=[(None, None)] * count + [(0, None)],
    )
    return solution.fun if solution.status == 0 else None


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

    def test_of_a_coupled_quadruped(self):
        if robots_folder() is None:
            pytest.skip("example-robot-data is not installed")
        robot = fp.Robot.from_urdf("example-robot-data:go2_description/urdf/go2.urdf", coupled="mirror")
        rng = np.random.default_rng(12)
        for _ in range(40):
            problem = random_problem(robot, rng)
            found = contact_rates(problem, "takeoff", 2.0)
            best = brute_force(equations_at(problem.robot, *at_end(problem, "takeoff")), 2.0, rate_limits(problem))
            assert found.ratio == pytest.approx(best, rel=1e-9)
            velocity = com_velocity(problem, "takeoff")
            speed, h = moved(robot, problem.initial, found, problem.takeoff.frame, velocity)
            assert speed < 1e-9 * max(1.0, float(np.abs(found.rates).max()) / 100)
            assert h == pytest.approx(2.0, abs=1e-6)  # legs' centres are not exactly mirrored


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
    def test_one_joint_has_too_few_rates(self, tmp_path):
        (tmp_path / "r.urdf").write_text(TWO_LINKS)
        robot = fp.Robot.from_urdf(tmp_path / "r.urdf")
        flight = fp.Flight(0.5, takeoff=fp.Takeoff("b"))
        problem = fp.Problem(robot, fp.Posture(0.2, 0.5), fp.Posture(0.4, 0.3), flight)
        found = contact_rates(problem, "takeoff", 0.1)
        assert found.ratio == np.inf
        assert not found.exist
        assert found.joint is None
        assert np.isnan(found.rates).all()

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

    def test_joints_without_a_limit_are_free_and_slow(self, tmp_path):
        robot = fp.Robot.from_urdf("urdf/chain10.urdf")
        rng = np.random.default_rng(5)
        problem = random_problem(robot, rng)
        everything = contact_rates(problem, "takeoff", 1.0)
        named = {"q1": 10.0, "q4": 3.0, "q7": 5.0}
        some = contact_rates(replace(problem, limits=fp.Limits(velocity=named)), "takeoff", 1.0)
        assert some.ratio == pytest.approx(0.0, abs=1e-9)  # the other seven do it
        assert [some.rates[robot.joints.index(name)] for name in named] == pytest.approx([0.0] * 3, abs=1e-9)
        alone = {name: 10.0 for name in robot.joints if name != "q5"}
        one_free = contact_rates(replace(problem, limits=fp.Limits(velocity=alone)), "takeoff", 1.0)
        all_ten = contact_rates(replace(problem, limits=fp.Limits(velocity=10.0)), "takeoff", 1.0)
        assert one_free.ratio <= all_ten.ratio * (1 + 1e-9)
        assert everything.ratio > 0

    def test_a_singular_posture_says_so(self, gymnast):
        flight = fp.Flight(1.0, takeoff=fp.Takeoff("foot"), landing=fp.Landing("hand"))
        problem = fp.Problem(gymnast, fp.Posture(1.2, [0.5, -0.8]), fp.Posture(-1.5, [0.0, 0.0]), flight)
        assert contact_rates(problem, "landing", 0.3).ratio == np.inf
        assert contact_rates(problem, "landing", None).ratio == np.inf

    @pytest.mark.parametrize("orientation", [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.3])
    def test_stretched_out_along_any_direction(self, gymnast, orientation):
        """Where an axis of the plane is the robot's, a whole row is rounding, or 0."""
        flight = fp.Flight(1.0, takeoff=fp.Takeoff("hand"), horizontal_velocity=0.7)
        posture = fp.Posture(orientation, [0.0, 0.0])
        for limits in (fp.Limits(), fp.Limits(velocity=20.0)):
            problem = fp.Problem(gymnast, posture, posture, flight, limits=limits)
            across = abs(np.sin(orientation)) < 1e-9  # it lies: the joints can give the vertical velocity
            assert contact_rates(problem, "takeoff", 0.4).ratio == np.inf
            assert contact_rates(problem, "takeoff", None).ratio == np.inf
            level = replace(problem, flight=replace(flight, horizontal_velocity=0.0))
            assert contact_rates(level, "takeoff", 0.4).exist == across

    def test_the_base_link_itself_is_no_contact(self, gymnast):
        state = fp.Posture(0.0, 0.1)
        assert not has_contact(fp.Problem(gymnast, state, state, fp.Flight(1.0)), "takeoff")
        foot = fp.Flight(1.0, takeoff=fp.Takeoff("foot"))
        assert has_contact(fp.Problem(gymnast, state, state, foot), "takeoff")
        assert has_contact(fp.Problem(gymnast, state, state, foot), "landing")

    def test_stricter_of_urdf_and_problem(self, tmp_path):
        robot = fp.Robot.from_urdf("urdf/high_jumper.urdf")
        state = fp.Posture(1.2, [0.4, -0.4, -1.0])
        flight = fp.Flight(0.5, takeoff=fp.Takeoff("foot"))
        problem = fp.Problem(robot, state, state, flight, limits=fp.Limits(velocity={"q1": 5.0, "q3": 100.0}))
        assert rate_limits(problem).tolist() == [5.0, 12.0, 20.0]


def written(plane="xz", flipped=(), mirrored=False, mass=1.0):
    """A trunk with a leg of three links and an arm, in a plane, with axes turned round, mirrored, or heavier."""

    def place(horizontal, vertical):
        vector = dict.fromkeys("xyz", 0.0)
        vector[plane[0]], vector[plane[1]] = -horizontal if mirrored else horizontal, vertical
        return " ".join(str(vector[axis]) for axis in "xyz")

    across = {"xz": "0 -1 0", "yz": "1 0 0"}[plane]  # turns the horizontal towards the vertical axis

    def axis(name):
        sign = (-1 if name in flipped else 1) * (-1 if mirrored else 1)
        return " ".join(str(sign * int(part)) for part in across.split())

    def link(name, weight, horizontal, vertical):
        moments = " ".join(f'{key}="{0.02 * mass * weight}"' for key in ("ixx", "iyy", "izz"))
        return (
            f'<link name="{name}"><inertial><origin xyz="{place(horizontal, vertical)}"/>'
            f'<mass value="{mass * weight}"/>'
            f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    def turning(name, parent, child, horizontal, vertical):
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{place(horizontal, vertical)}"/><axis xyz="{axis(name)}"/>'
            '<limit lower="-2.5" upper="2.5" effort="50" velocity="25"/></joint>'
        )

    toe = (
        '<link name="toe"/><joint name="tip" type="fixed"><parent link="foot"/><child link="toe"/>'
        f'<origin xyz="{place(0.15, -0.03)}"/></joint>'
    )
    return robot_text(
        link("trunk", 5.0, 0.02, 0.1),
        link("thigh", 2.0, 0.0, -0.15),
        link("shank", 1.0, 0.01, -0.15),
        link("foot", 0.5, 0.05, -0.02),
        link("arm", 1.2, 0.02, -0.2),
        toe,
        turning("hip", "trunk", "thigh", 0.05, -0.1),
        turning("knee", "thigh", "shank", 0.0, -0.35),
        turning("ankle", "shank", "foot", 0.0, -0.35),
        turning("shoulder", "trunk", "arm", -0.03, 0.3),
    )


class TestInvariance:
    @pytest.fixture
    def rates(self, tmp_path):
        """Rates of base and joints, in the sense that turns the horizontal axis of the first writing upwards."""

        def found(momentum=2.0, speed=0.7, **writing):
            (tmp_path / "r.urdf").write_text(written(**writing))
            robot = fp.Robot.from_urdf(tmp_path / "r.urdf", plane=writing.get("plane", "xz"))
            flipped, mass, mirrored = (
                writing.get(k, d) for k, d in (("flipped", ()), ("mass", 1.0), ("mirrored", False))
            )
            side = robot.tree.turn * (-1 if mirrored else 1)
            signs = np.array([-1.0 if name in flipped else 1.0 for name in robot.joints])
            start = {"hip": 0.6, "knee": -1.1, "ankle": 0.4, "shoulder": 0.9}
            posture = fp.Posture(side * 0.3, signs * [start[name] for name in robot.joints])
            flight = fp.Flight(0.5, takeoff=fp.Takeoff("toe"), horizontal_velocity=-speed if mirrored else speed)
            result = contact_rates(fp.Problem(robot, posture, posture, flight), "takeoff", side * momentum * mass)
            return result.ratio, np.array([side * result.orientation_rate, *(signs * result.rates)])

        return found

    @pytest.mark.parametrize(
        "writing",
        [
            {"plane": "yz"},
            {"flipped": ("knee",)},
            {"flipped": ("hip", "knee", "ankle")},
            {"mirrored": True},
            {"mass": 37.0},
            {"plane": "yz", "flipped": ("shoulder", "knee"), "mirrored": True, "mass": 0.01},
        ],
    )
    def test_the_same_robot_written_otherwise_has_the_same_rates(self, rates, writing):
        ratio, expected = rates()
        other_ratio, other = rates(**writing)
        assert ratio > 0.1
        assert other_ratio == pytest.approx(ratio, rel=1e-9)
        assert other == pytest.approx(expected, rel=1e-9, abs=1e-9)

    def test_another_momentum_has_others(self, rates):
        assert rates(momentum=-2.0)[0] != pytest.approx(rates()[0], rel=1e-3)
