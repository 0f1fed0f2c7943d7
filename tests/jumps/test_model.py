"""The expressions of the planar tree against Pinocchio: inverse dynamics with forces, momentum, places."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from floatplan.jumps.model import PlanarModel, casadi
from floatplan.robot import Robot
from floatplan.robot.standing import Spot

ROBOTS = {
    "go2": ("go2_description/urdf/go2.urdf", {"coupled": "mirror", "reference": "standing"}, "RL_foot"),
    "bolt": ("bolt_description/robots/bolt.urdf", {"coupled": "mirror", "armature": 0.05}, "FR_FOOT"),
    "talos": (
        "talos_data/robots/talos_reduced.urdf",
        {"coupled": "mirror", "plane": "xz", "reference": "half_sitting"},
        "leg_left_6_link",
    ),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_inverse_dynamics_is_that_of_pinocchio(name: str) -> None:
    source, choices, foot = ROBOTS[name]
    robot = Robot.from_urdf(f"example-robot-data:{source}", **choices)
    model = PlanarModel(robot)
    frame = robot.frames[foot]
    spot = Spot(frame.body, frame.local)
    force = casadi().SX.sym("force", 2)
    moments = model.moments(spot, [(spot, (force[0], force[1]))])
    motors = model.motor_torques(moments)
    com = model.com_from(spot, 2)
    evaluate = model.function("f", [motors, sum(moments[k] for k in range(moments.numel())), *com], force)

    rng = np.random.default_rng(0)
    y, v, a = rng.normal(size=(3, 1 + len(robot.joints)))
    given = rng.normal(size=2) * 50
    torques, moment, ax, az = (np.asarray(value).ravel() for value in evaluate(y, v, a, given))

    pin_model, data = robot.model, robot.model.createData()
    full = robot.reference + robot.selection @ y[1:]
    full[2] = y[0]
    rate, acceleration = robot.selection @ v[1:], robot.selection @ a[1:]
    rate[2], acceleration[2] = v[0], a[0]
    identity = pin_model.getFrameId(foot)
    pin.computeJointJacobians(pin_model, data, full)
    pin.updateFramePlacements(pin_model, data)
    axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
    jacobian = axes @ pin.getFrameJacobian(pin_model, data, identity, pin.LOCAL_WORLD_ALIGNED)[:3]
    pin.forwardKinematics(pin_model, data, full, rate, acceleration)
    drift = axes @ pin.getFrameClassicalAcceleration(pin_model, data, identity, pin.LOCAL_WORLD_ALIGNED).linear
    acceleration[:2] = -drift
    acceleration[1] += model.gravity
    rnea = pin.rnea(pin_model, data, full, rate, acceleration) - jacobian.T @ given
    assert np.abs(torques - rnea @ robot.transmission).max() < 1e-9
    np.testing.assert_allclose(moment, rnea[2], atol=1e-9)
    np.testing.assert_allclose(rnea[:2], robot.mass * np.array([ax[0], az[0] + model.gravity]) - given, atol=1e-9)


def test_momentum_is_that_of_pinocchio() -> None:
    robot = Robot.from_urdf("example-robot-data:go2_description/urdf/go2.urdf", coupled="mirror")
    model = PlanarModel(robot)
    y, v = np.random.default_rng(1).normal(size=(2, 5))
    found = float(model.function("h", [model.momentum()])(y, v, 0 * y))
    full, rate = robot.reference + robot.selection @ y[1:], robot.selection @ v[1:]
    full[2], rate[2] = y[0], v[0]
    data = robot.model.createData()
    expected = robot.plane.normal @ pin.computeCentroidalMomentum(robot.model, data, full, rate).angular
    assert abs(found - expected) < 1e-12 * abs(expected) + 1e-14
