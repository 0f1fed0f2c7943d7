"""Feet that roll: circles about their frames, on which a robot stands and from which it jumps."""

from pathlib import Path

import numpy as np
import pinocchio as pin
from jumps import GO2

from floatplan.jumps.contacts import contact_at, rolling
from floatplan.jumps.exact import OnePoint, StanceDynamics
from floatplan.jumps.model import PlanarModel
from floatplan.jumps.motion import Grid, Stance
from floatplan.jumps.phases import Phase
from floatplan.jumps.planner import jump
from floatplan.robot import Robot


def go2_foot(frame="RL_foot"):
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    home = np.append(0.0, robot.resting)
    return robot, rolling(robot, contact_at(robot, frame, home)[0], home), home


def rocking(times):
    """Joints (4, N) of a Go2 that rocks on one pair of feet, with their derivatives."""
    sizes, rates = np.array([[0.3], [-0.5], [0.2], [0.4]]), np.array([[7.0], [9.0], [8.0], [6.0]])
    home = np.array([[0.7], [-1.4], [0.8], [-1.5]])
    return (
        home + sizes * np.sin(rates * times),
        sizes * rates * np.cos(rates * times),
        -sizes * rates**2 * np.sin(rates * times),
    )


def test_a_foot_that_rolls_does_not_slip_and_balances():
    """A Go2 rocks on its rear feet: by Pinocchio what is on the ground is at rest, and all forces act there."""
    robot, contact, _ = go2_foot()
    dynamics = StanceDynamics(PlanarModel(robot), Phase("takeoff", (contact,), 1.0, (1.0, 1.0), 1), np.zeros(5))
    times = np.linspace(0.0, 0.2, 41)
    point = OnePoint(dynamics, times)
    y, v, a = point.follow([np.stack(rocking(each)) for each in point.sampled], (0.1, 2.0))
    stance = Stance(robot, 9.81, (contact,), 0.3 + 0.1j, Grid(times, y, v, a, np.empty((0, len(times)))))
    state, model = stance.at(times), robot.model
    data = model.createData()
    assert np.ptp(y[0] + y[1:].T @ robot.tree.turns[contact.spots[0].body]) > 0.3
    for row, (q, rates, changes) in enumerate(zip(state.positions, state.velocities, state.accelerations, strict=True)):
        wrench = pin.rnea(model, data, q, rates, changes + 9.81 * np.eye(model.nv)[1])
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name in ("RL_foot", "RR_foot"):
            center = data.oMf[model.getFrameId(name)].translation
            np.testing.assert_allclose(state.points[name][row], center - [0.0, 0.0, contact.radius], atol=1e-12)
            jacobian = pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
            speed, turning = np.split(jacobian @ rates, 2)
            np.testing.assert_allclose(speed + np.cross(turning, [0.0, 0.0, -contact.radius]), 0.0, atol=1e-12)
            force = np.insert(state.forces[name][row], 1, 0.0)
            wrench -= jacobian.T @ np.concatenate((force, np.cross([0.0, 0.0, -contact.radius], force)))
        np.testing.assert_allclose(wrench[:3], 0.0, atol=1e-8)
        np.testing.assert_allclose(wrench, state.torques[row], atol=1e-8)
    heights = [state.points[name][:, 2] for name in state.points]
    np.testing.assert_allclose(heights, 0.1 - contact.radius, atol=1e-12)


def test_a_hop_on_one_round_foot(tmp_path):
    """The high jumper, whose shank is its base and whose joints turn the other way, on a ball of 5 cm."""
    ball = '<link name="foot"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>'
    for name, old, new in (
        ("urdf/high_jumper.urdf", '<link name="foot"/>', ball),
        ("problems/jumps/high_jumper.toml", "[jump]", '[jump]\nfeet = "rolling"'),
    ):
        text = Path(name).read_text()
        assert text.count(old) == 1
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text.replace(old, new))
    found = jump(tmp_path / "problems/jumps/high_jumper.toml", starts=1)
    assert found.ok
    assert max(found.check.figures["takeoff_seam"], found.check.figures["landing_seam"]) < 1e-6
    landing = found.phases[-1].begin
    times = np.array([[0.0, 0.8 * found.takeoff_time], [(landing + found.duration) / 2, found.duration]])
    points, q = found.contact_points(times)["foot"], found.q(times)
    model = pin.buildModelFromXML(found.problem.robot.xml, pin.JointModelFreeFlyer())
    data = model.createData()
    for row in np.ndindex(2, 2):
        pin.framesForwardKinematics(model, data, q[row])
        center = data.oMf[model.getFrameId("foot")].translation
        np.testing.assert_allclose(points[row], center - [0.0, 0.0, 0.05], atol=1e-9)
    assert np.isnan(found.contact_points(found.takeoff_time + 0.1)["foot"]).all()
    assert np.ptp(points[..., 0]) > 0.003
