"""q, v, a, tau of a plan, asked of the model that Pinocchio makes of the URDF itself on a free flyer."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from flight_reference import drawn_plan, random_coefficients
from places import PROBLEMS
from robot_samples import TWO_LINKS
from straight_axes import axes_turned_in_file

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.motion.dynamics import Ballistics
from floatplan.motion.planar.full_model import PinocchioDynamics

DURATION, GRAVITY = 1.3, 3.7
TURNING = -3.0  # rad/s, with the joints at zero
TIMES = np.linspace(0, DURATION, 12)
PATH = Ballistics(read_only([0.3, 1.1]), read_only([-0.4, 5.0]), GRAVITY)
EXACT = 1e-9  # of the largest
TILTED = 10.0  # times the tilt: how far off the file's own model is
STEP = 1e-3  # s, of difference quotients of the fourth order
GALLERY = PROBLEMS / "gallery"


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


def test_real_robots(real_robot):
    """Exactly where no axis was turned; else exactly for the turned axes, and to the order of the tilt for the file."""
    plan, model = drawn(real_robot), free_model(real_robot)
    tilt = max(real_robot.tilt - 1e-9, 0.0)
    turned = free_model(real_robot, axes_turned_in_file(real_robot)[0]) if tilt else model
    assert errors_in_model(plan, turned) < EXACT
    assert errors_in_model(plan, model) < EXACT + TILTED * tilt
    check_derivatives(plan, turned)


def test_a_joint_called_as_the_free_flyer_is_refused(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(TWO_LINKS.replace('name="j"', 'name="root_joint"'))
    plan = drawn(fp.Robot.from_urdf(path))
    assert plan.at(TIMES).torques.any()
    with pytest.raises(fp.InputError, match="free flyer") as caught:
        plan.q(0.0)
    assert caught.value.element == 'joint "root_joint"'
    assert caught.value.advice == "rename it"
