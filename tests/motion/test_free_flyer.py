"""q, v, a, tau of a plan, asked of the model that Pinocchio makes of the URDF itself on a free flyer."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from flight_reference import drawn_plan, random_coefficients
from robot_samples import TWO_LINKS, joint, robot_text
from straight_axes import axes_turned_in_file

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.motion.dynamics import Ballistics
from floatplan.motion.planar.full_model import FullMotion, PinocchioDynamics
from floatplan.robot.urdf.tree import PREFIX, robots_folder

DURATION, GRAVITY = 1.3, 3.7
TURNING = -3.0  # rad/s, with the joints at zero
TIMES = np.linspace(0, DURATION, 12)
PATH = Ballistics(read_only([0.3, 1.1]), read_only([-0.4, 5.0]), GRAVITY)
EXACT = 1e-9  # of the largest
TILTED = 10.0  # times the tilt: how far off the file's own model is
STEP = 1e-3  # s, of difference quotients of the fourth order
GALLERY = Path(__file__).parents[2] / "problems" / "gallery"

installed = pytest.mark.skipif(robots_folder() is None, reason="example-robot-data is not installed")


def drawn(robot, seed=5):
    """A motion that turns all joints and the base, after a somersault, under a gravity of its own."""
    coefficients = random_coefficients(seed, len(robot.joints), size=0.4)
    inertia = PinocchioDynamics(robot).momentum_map(np.zeros((1, len(robot.joints))))[0, 0]
    return replace(drawn_plan(robot, coefficients, TURNING * inertia, DURATION, 9.0), ballistics=PATH)


@pytest.fixture(scope="session", params=sorted(path.stem for path in GALLERY.glob("*.toml")))
def real_robot(request):
    """With followers and locked joints, as its problem has them."""
    return fp.load_problem(GALLERY / f"{request.param}.toml").robot


def free_model(robot, text=None):
    model = pin.buildModelFromXML(text or robot.xml, pin.JointModelFreeFlyer())
    model.gravity = pin.Motion(-GRAVITY * robot.plane.vertical, np.zeros(3))
    for name, armature in robot.armature.items():
        model.armature[model.joints[model.getJointId(name)].idx_v] = armature
    return model


def errors_in_model(plan, model):
    """Largest errors, relative, of momentum, force on the base in the plane, torques of all joints, and CM."""
    plane, data, state = plan.robot.plane, model.createData(), plan.at(TIMES)
    motion = [quantity(TIMES) for quantity in (plan.q, plan.v, plan.a, plan.tau)]
    in_plane = np.zeros((3, 6))
    in_plane[0, :3], in_plane[1, :3], in_plane[2, 3:] = plane.horizontal, plane.vertical, plane.normal
    errors = []
    for q, v, a, tau, com in zip(*motion, state.com_position, strict=True):
        momentum = plane.normal @ pin.computeCentroidalMomentum(model, data, q, v).angular
        forces = np.array(pin.rnea(model, data, q, v, a))
        place = pin.centerOfMass(model, data, q)
        scale = max(np.abs(forces).max(), GRAVITY * plan.robot.mass)
        off = place @ np.stack((plane.horizontal, plane.vertical), axis=1) - com
        errors.append(
            [momentum / plan.angular_momentum - 1, *(in_plane @ forces[:6]) / scale, *(forces - tau)[6:] / scale, *off]
        )
        assert not tau[:6].any()
    return np.abs(errors).max()


def check_derivatives(plan, model):
    """v is the derivative of q, by Pinocchio's difference of configurations, and a that of v."""
    times = TIMES[1:-1]
    q, v = ({n: quantity(times + n * STEP) for n in (1, -1, 2, -2)} for quantity in (plan.q, plan.v))
    near, far = ([pin.difference(model, *pair) for pair in zip(q[-n], q[n], strict=True)] for n in (1, 2))
    velocity = (8 * np.array(near) - far) / (12 * STEP)
    acceleration = (8 * (v[1] - v[-1]) - (v[2] - v[-2])) / (12 * STEP)
    for found, expected in ((plan.v(times), velocity), (plan.a(times), acceleration)):
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_chains_and_trees(any_robot):
    """In planes xz, zy and xy, with coupled, locked, sliding and continuous joints."""
    plan, model = drawn(any_robot), free_model(any_robot)
    assert plan.q(TIMES).shape == (len(TIMES), model.nq)
    assert errors_in_model(plan, model) < EXACT
    check_derivatives(plan, model)


@installed
def test_real_robots(real_robot):
    """Exactly where no axis was turned; else exactly for the turned axes, and to the order of the tilt for the file."""
    plan, model = drawn(real_robot), free_model(real_robot)
    tilt = max(real_robot.tilt - 1e-9, 0.0)
    turned = free_model(real_robot, axes_turned_in_file(real_robot)[0]) if tilt else model
    assert errors_in_model(plan, turned) < EXACT
    assert errors_in_model(plan, model) < EXACT + TILTED * tilt
    check_derivatives(plan, turned)


@installed
def test_order_is_that_of_the_file(real_robot):
    """Each joint's place in the model holds its own position, velocity and torque."""
    plan = drawn(real_robot)
    model = pin.buildModelFromUrdf(str(real_robot.path), pin.JointModelFreeFlyer())
    motion = plan.full_motion(TIMES)
    assert list(model.names)[2:] == list(motion.joints)
    for index, name in enumerate(motion.joints):
        place = model.joints[model.getJointId(name)]
        angle = plan.q(TIMES)[:, place.idx_q : place.idx_q + place.nq].T
        expected = motion.positions[:, index]
        assert np.array_equal(angle, [expected] if place.nq == 1 else [np.cos(expected), np.sin(expected)])
        assert np.array_equal(plan.v(TIMES)[:, place.idx_v], motion.velocities[:, index])
        assert np.array_equal(plan.tau(TIMES)[:, place.idx_v], motion.torques[:, index])


def test_continuous_joints_are_cosine_and_sine(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(robot_text(joint("turning", "a", "b"), joint("bent", "b", "c", kind="revolute"), links="abc"))
    plan = drawn(fp.Robot.from_urdf(path))
    first, second = plan.at(TIMES).positions[:, list(map(plan.robot.joints.index, ("turning", "bent")))].T
    assert np.array_equal(plan.q(TIMES)[:, 7:].T, [np.cos(first), np.sin(first), second])
    assert plan.v(TIMES).shape == (len(TIMES), 8)


def test_world_is_that_of_the_takeoff(planned):
    """At orientation 0 the root link has the world's axes, and the takeoff frame starts at the origin."""
    plan = planned("handstand")
    model = free_model(plan.robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, plan.q(0.0))
    assert np.abs(data.oMf[model.getFrameId(plan.problem.takeoff.frame)].translation).max() < 1e-12
    turned = pin.Quaternion(plan.q(0.0)[3:7]).matrix()
    expected = pin.AngleAxis(plan.problem.initial.orientation, plan.robot.plane.normal).matrix()
    assert turned == pytest.approx(expected, abs=1e-14)


def test_quaternions_are_continuous(gymnast):
    plan = drawn(gymnast)
    times = np.linspace(0, DURATION, 400)
    turned = np.ptp(plan.at(times).orientation)
    assert turned > 0.5
    quaternions = plan.q(times)[:, 3:7]
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0)
    assert np.abs(np.diff(quaternions, axis=0)).max() < 0.1


def test_one_time_and_many(gymnast):
    plan = drawn(gymnast)
    for quantity, size in ((plan.q, plan.q(TIMES).shape[1]), (plan.v, 8), (plan.a, 8), (plan.tau, 8)):
        assert quantity(0.5).shape == (size,)
        assert quantity(np.float32(0.5)).shape == (size,)
        assert quantity([]).shape == (0, size)
        assert quantity([0.2, 0.5])[1] == pytest.approx(quantity(0.5), rel=1e-13)


def test_motions_are_read_only_and_answers_are_the_caller_s(gymnast):
    plan = drawn(gymnast)
    motion = plan.full_motion(TIMES)
    names = [name for name, member in vars(FullMotion).items() if isinstance(member, cached_property)]
    arrays = [getattr(motion, name) for name in names if not name.startswith("_")]
    assert len(arrays) == 11
    assert not any(array.flags.writeable for array in arrays)
    first = plan.q(TIMES)
    first[:] = 0
    assert plan.q(TIMES).any()


@pytest.mark.parametrize("times", [2 * DURATION, [0.1, np.nan], "soon", 1j, None])
def test_times_that_are_none_are_refused(gymnast, times):
    plan = drawn(gymnast)
    for quantity in (plan.at, plan.q, plan.v, plan.a, plan.tau):
        with pytest.raises(fp.InputError) as caught:
            quantity(times)
        assert caught.value.element == "times"


def test_a_joint_called_as_the_free_flyer_is_refused(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(TWO_LINKS.replace('name="j"', 'name="root_joint"'))
    plan = drawn(fp.Robot.from_urdf(path))
    assert plan.at(TIMES).torques.any()
    with pytest.raises(fp.InputError, match="free flyer") as caught:
        plan.q(0.0)
    assert caught.value.element == 'joint "root_joint"'
    assert caught.value.advice == "rename it"


@installed
def test_a_plan_found_holds_in_the_file_s_model():
    """Of a quadruped, legs coupled: what is written to robots."""
    plan = fp.plan(fp.load_problem(GALLERY / "go2.toml"))
    assert plan.robot.source.startswith(PREFIX)
    model = free_model(plan.robot)
    model.gravity = pin.Motion(-9.81 * plan.robot.plane.vertical, np.zeros(3))
    data = model.createData()
    times = np.linspace(0, plan.duration, 12)
    for q, v, a, tau in zip(plan.q(times), plan.v(times), plan.a(times), plan.tau(times), strict=True):
        forces = pin.rnea(model, data, q, v, a)
        assert np.abs(forces[6:] - tau[6:]).max() < EXACT * np.abs(tau).max()
