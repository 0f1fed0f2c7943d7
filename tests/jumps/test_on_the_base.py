"""Robots whose base is what stands: their jumps, with rotors in their motors and without."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import planned_jump

import floatplan as fp


def of_file(root, name, **motors):
    problem = fp.load_problem(root / "problems" / "jumps" / f"{name}.toml")
    return replace(problem, robot=fp.Robot.from_urdf(problem.robot.path, **motors)) if motors else problem


def assert_balanced(jump):
    """RNEA of the file's free flyer, with rotors, takes the jump's torques and forces and nothing else."""
    robot = jump.problem.robot
    model = pin.buildModelFromXML(robot.xml, pin.JointModelFreeFlyer())
    model.gravity = pin.Motion(-jump.problem.flight.gravity * np.asarray(robot.plane.vertical), np.zeros(3))
    for name, armature in robot.armature.items():
        model.armature[model.joints[model.getJointId(name)].idx_v] = armature
    data, times = model.createData(), np.linspace(0.0, jump.duration, 41)
    forces, foot = jump.forces(times)["foot"], model.getFrameId("foot")
    rows = zip(jump.q(times), jump.v(times), jump.a(times), jump.tau(times), forces, strict=True)
    for q, v, a, tau, force in rows:
        pin.computeJointJacobians(model, data, q)
        pushed = pin.computeFrameJacobian(model, data, q, foot, pin.LOCAL_WORLD_ALIGNED)[:3].T @ force
        assert np.abs(pin.rnea(model, data, q, v, a) - tau - pushed).max() < 1e-3 * 9.81 * robot.mass


@pytest.mark.long
def test_it_hops_with_rotors_in_its_motors(root):
    problem = of_file(root, "high_jumper", armature=0.5)
    found = fp.jump(problem, starts=1)
    assert found.ok
    assert abs(found.at([0.0]).positions[0, 2] - found.at([found.duration]).positions[0, 2]) < 1e-9
    assert_balanced(found)
    state = found.at(np.linspace(0.0, found.duration, 501))
    rotors = 0.5 * np.abs(state.accelerations[:, 3:]).max(axis=0)
    assert (rotors > 0.1 * np.abs(state.torques[:, 3:]).max(axis=0)).all()  # so that they matter
    assert fp.launch(found.flight).ok


def test_it_lands_on_its_hands(root):
    """What stands after the flight alone is not kept above the ground there, and its base is as the goal's."""
    problem = of_file(root, "gymnast")
    bent = np.radians([40.0, -40.0])
    flight = replace(problem.flight, landing=fp.Landing("hand"))
    landing = fp.JumpLanding([["hand"]], to=dict(zip(problem.robot.joints, bent, strict=True)))
    request = fp.JumpRequest(takeoff=problem.jump.takeoff, landing=landing)
    found = fp.jump(replace(problem, goal=fp.Posture(np.radians(-100.0), bent), flight=flight), request, starts=2)
    assert found.ok
    first, last = found.at([0.0, found.duration]).positions[:, 2]
    assert np.radians(50) < first < np.radians(90)
    assert np.radians(-120) < last < np.radians(-80)


@pytest.mark.long
@pytest.mark.parametrize("name", ["gymnast", "acrobat"])
def test_jumps_of_chains_are_found(name):
    found = planned_jump(name)
    assert found.ok
    assert_balanced(found)
