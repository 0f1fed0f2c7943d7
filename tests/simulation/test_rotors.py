"""Motors with rotors, damping and friction: in torques, proofs, corrections and files as Pinocchio has them."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from plain_problems import problem_of
from robot_samples import joint, robot_text

import floatplan as fp
from floatplan.simulation.engines import JointTorques
from floatplan.simulation.plan_motion import PlanarPlanMotion
from floatplan.simulation.reduced_model import FRICTION_RATE, reduced_model
from floatplan.studies.peaks import many_peaks

TIMES = np.linspace(0.0, 1.0, 23)
MIMIC = '<mimic joint="a" multiplier="-1.5" offset="0.1"/>'
ROTOR = '<dynamics armature="0.06" damping="0.05" friction="0.1"/>'


def tree(of_b: str = "", of_c: str = "") -> str:
    """Three joints, axes both ways."""
    joints = joint("a", "x", "y"), joint("b", "y", "z", "0 -1 0", more=of_b), joint("c", "x", "w", "0 -1 0", more=of_c)
    return robot_text(*joints, links="xyzw")


def loaded(folder, text: str, **choices) -> fp.Robot:
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return fp.Robot.from_urdf(path, **choices)


CASES = {  # every way in which a motor moves something
    "one number": (tree(), {"armature": 0.02}),
    "in the file": (tree(of_c=ROTOR), {"armature": {"a": 0.1}}),
    "coupled": (tree(), {"coupled": {"c": fp.Coupling("a", -0.7, 0.2)}, "armature": {"a": 0.03, "c": 0.2}}),
    "geared": (tree(MIMIC), {"armature": {"a": 0.2, "b": 0.1, "c": 0.03}}),
    "mirrored": (tree(MIMIC), {"plane": "zx", "armature": {"a": 0.2, "b": 0.1}}),
    "locked": (tree(ROTOR), {"locked": {"b": 0.4}, "armature": 0.1}),
}


@pytest.fixture(scope="module", params=CASES)
def plan(request, tmp_path_factory) -> fp.Plan:
    text, choices = CASES[request.param]
    robot = loaded(tmp_path_factory.mktemp("robots"), text, **{"plane": "xz", **choices})
    return fp.plan(problem_of(robot, np.random.default_rng(2)))


def in_pinocchio(robot: fp.Robot, gravity: float):
    """The free-flyer model of the file as its users load it, with rotors."""
    model = pin.buildModelFromXML(robot.xml, pin.JointModelFreeFlyer())
    for name, armature in robot.armature.items():
        model.armature[model.joints[model.getJointId(name)].idx_v] = armature
    model.gravity = pin.Motion(-gravity * np.asarray(robot.plane.vertical), np.zeros(3))
    return model


def test_torques_are_those_of_pinocchio_with_rotors(plan: fp.Plan):
    model = in_pinocchio(plan.robot, plan.ballistics.gravity)
    data, times = model.createData(), plan.duration * TIMES
    rows = zip(plan.q(times), plan.v(times), plan.a(times), strict=True)
    expected = np.array([pin.rnea(model, data, *row) for row in rows])
    assert np.abs(plan.tau(times) - expected)[:, 6:].max() < 1e-9 * np.abs(expected).max()
    model.armature[:] = 0.0
    bare = np.array(
        [pin.rnea(model, data, *row) for row in zip(plan.q(times), plan.v(times), plan.a(times), strict=True)]
    )
    assert np.abs(bare - expected).max() > 0.05 * np.abs(expected).max()  # so that it matters


def test_closed_form_kernel_and_certificate_agree(plan: fp.Plan):
    """NumPy's moments, the kernel's peaks and the certificate's enclosures against Pinocchio's torques."""
    robot, fine = plan.robot, plan.duration * np.linspace(0.0, 1.0, 4001)
    state = plan.at(fine)
    replanner = fp.Replanner(plan, rate=100)
    for index in (0, 1234, 4000):
        reference = replanner.reference(float(fine[index]))
        np.testing.assert_allclose(reference.feedforward, state.torques[index], rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(reference.motors, state.motor_torques[index], rtol=1e-7, atol=1e-7)
    found = many_peaks(
        plan.problem, *(np.array([each]) for each in (plan.duration, plan.angular_momentum)), plan.coefficients[None]
    )
    np.testing.assert_allclose(found.motor_torque[0], np.abs(state.motor_torques).max(axis=0), rtol=1e-4)
    certificate = fp.certify(plan)
    peaks = [certificate.motor_torque_peak[name] for name in robot.motors]
    np.testing.assert_allclose(peaks, np.abs(state.motor_torques).max(axis=0), rtol=1e-4)
    assert certificate.proved


@pytest.mark.long
def test_both_engines_land(tmp_path):
    """Forward dynamics with rotors, and with what joints lose, which motors make up for."""
    robot = loaded(tmp_path, tree(of_c=ROTOR), plane="xz", armature={"a": 0.1})
    plan = fp.plan(problem_of(robot, np.random.default_rng(2)))
    assert fp.replay(plan).landed
    landing = fp.replay(plan, engine="mujoco", step=1e-3)
    assert landing.landed
    assert landing.spatial.orientation_error < 1e-3
    still = replace(plan.record, robot=replace(plan.record.robot, armature={"a": 0.0}))
    assert fp.replay(still).landed  # its torques are its own


class TestProof:
    """Of limits that are kept without rotors, and not with them."""

    def test_a_rotor_alone_breaks_a_limit(self, tmp_path):
        plan = fp.plan(problem_of(loaded(tmp_path, tree(), plane="xz"), np.random.default_rng(2)))
        record = plan.record
        limits = record.problem["limits"] | {"torque": [1.0001 * peak for peak in record.torque_peak]}
        record = replace(record, problem={**record.problem, "limits": limits})
        assert fp.certify(record).proved
        state = plan.at(plan.duration * np.linspace(0.0, 1.0, 2001))
        for index, name in enumerate(record.robot.joints):
            heavier = replace(record, robot=replace(record.robot, armature={name: 0.5}))
            findings = fp.certify(heavier).findings  # after the other, whose robot is kept
            broken = {each.subject for each in findings if each.verdict == "refuted" and each.kind == "torque"}
            needed = np.abs(state.torques[:, index] + 0.5 * state.accelerations[:, index]).max()
            assert needed > limits["torque"][index]
            assert broken == {(name,)}  # a rotor is felt by its own joint alone
        assert fp.certify(record).proved


def test_limits_hold_with_rotors(tmp_path):
    """The search keeps a limit that the plan without inequalities breaks, by rows of the kernel."""
    robot = loaded(tmp_path, tree(of_c=ROTOR), plane="xz", armature={"a": 0.05}, coupled={"c": fp.Coupling("a", -0.7)})
    problem = problem_of(robot, np.random.default_rng(2))
    free = fp.plan(problem)
    limits = dict(zip(robot.motors, 0.9 * free.peaks.motor_torque, strict=True))
    problem = replace(problem, limits=fp.Limits(torque=limits), motion=fp.Motion(degree=9))
    found = fp.plan(problem, starts=4)
    assert found.ok
    state = found.at(found.duration * np.linspace(0, 1, 1001))
    assert (np.abs(state.motor_torques).max(axis=0) <= np.array(list(limits.values())) * (1 + 1e-9)).all()
    assert fp.certify(found).proved
    assert fp.Replanner(found, rate=200).update(
        0.1,
        *(float(each) for each in (found.at(0.1).orientation + 1e-3, found.at(0.1).orientation_rate)),
        found.at(0.1).positions,
        found.at(0.1).velocities,
    ).status in ("applied", "limited")


def test_what_joints_lose_is_felt_where_they_move_otherwise(tmp_path):
    bare, lossy = (
        fp.plan(problem_of(loaded(folder, text, plane="xz"), np.random.default_rng(2)))
        for folder, text in ((tmp_path, tree()), (tmp_path, tree('<dynamics damping="0.05" friction="0.1"/>')))
    )
    assert lossy.robot.damping == {"b": 0.05}
    assert lossy.robot.friction == {"b": 0.1}
    assert np.array_equal(bare.coefficients, lossy.coefficients)
    assert np.array_equal(bare.peaks.motor_torque, lossy.peaks.motor_torque)
    motion = PlanarPlanMotion(lossy.record, reduced_model(lossy.robot, 9.81))
    torques = JointTorques(motion, np.ones(3), None)
    order = [motion.reduced.joints.index(name) for name in "abc"]
    state = lossy.at(0.3)
    q, v = np.empty(3), np.empty(3)
    q[order], v[order] = state.positions, state.velocities
    found = torques(0.3, q, v)
    np.testing.assert_allclose(found[order], state.motor_torques, rtol=1e-9)
    lost = torques(0.3, q, v + 2.0) - found
    friction = 0.1 * (
        np.tanh((state.velocities[1] + 2.0) / FRICTION_RATE) - np.tanh(state.velocities[1] / FRICTION_RATE)
    )
    np.testing.assert_allclose(lost[order], [0.0, -0.05 * 2.0 - friction, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"armature": -0.1}, r"armature: -0.1 kg m\^2 is negative"),
        ({"armature": {"a": math.nan}}, "armature.a: nan is not a finite number"),
        ({"armature": {"z": 0.1}}, 'armature "z": no joint is called "z"'),
        ({"armature": {"b": 0.1}}, 'armature "b": the joint is locked, so that its motor does not turn'),
        ({"armature": "much"}, "armature: 'much' is not a number"),
        ({"armature": True}, "armature: True is not a number"),
        ({"damping": [1.0, 2.0]}, "damping: .* is not a number"),
        ({"damping": {"a": math.inf}}, "damping.a: inf is not a finite number"),
        ({"damping": {"a": 1e30}}, "damping.a: 1e.30 is outside"),
    ],
)
def test_motors_that_there_are_not_are_refused(tmp_path, asked, reason):
    with pytest.raises(fp.InputError, match=reason):
        loaded(tmp_path, tree(), plane="xz", locked={"b": 0.0}, **asked)
