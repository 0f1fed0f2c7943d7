"""Replay of jumps in space in MuJoCo with contact: how they land, and what corrections in flight make of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import roll, try_few_gains
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.spatial.standing import Foot
from floatplan.simulation.base_states import SpatialBase
from floatplan.simulation.contact.model import ContactRobot
from floatplan.simulation.contact.shapes import shapes_of_jump
from floatplan.simulation.contact.tracked_motion import PERIOD
from floatplan.simulation.jump_run import JumpControl
from floatplan.simulation.mujoco_model import free_base
from floatplan.simulation.perturbation import Perturbation
from floatplan.view.report.flights import jump_rows

SOFT = 40.0, 1.0  # [N m/rad, N m s/rad]
PERTURBED = "mass=5%,armature=0.005,noise=0.1deg,delay=4ms"


@pytest.fixture(scope="module")
def flown() -> fp.JumpReplay:
    """A perturbed robot, late, with corrections in flight and without."""
    return fp.replay_jump(roll(), 250.0, perturb=PERTURBED, friction=0.85, flights=1, gains=SOFT, budget=None)


def test_it_lands_on_its_feet(flown: fp.JumpReplay) -> None:
    for landings in (flown.uncorrected, flown.corrected):
        assert landings is not None
        assert landings.clean.all()
        assert landings.torque.max() < 1
        assert (landings.pitch >= 0).all()  # an angle between two attitudes


def test_corrections_turn_it_to_its_goal(flown: fp.JumpReplay) -> None:
    assert flown.corrected is not None
    assert flown.corrected.pitch_worst < np.deg2rad(2)
    assert flown.corrected.pitch_rms < flown.uncorrected.pitch_rms / 2
    assert flown.statuses["applied"] > 50


def test_its_motion_is_a_motion(flown: fp.JumpReplay) -> None:
    """The recorded first flight: rates are those of positions, the ground bears it, and its roll is a whole turn."""
    motion = flown.motion
    times = np.arange(0.0, motion.duration - 0.1, PERIOD)
    state = motion.state(times)
    moved = np.trapezoid(state.com_velocity, times, axis=0)
    np.testing.assert_allclose(state.com_position[-1] - state.com_position[0], moved, atol=2e-3)
    forces = sum(motion.forces(times).values())
    weight = 9.81 * motion.robot.mass
    np.testing.assert_allclose(forces.mean(axis=0), [0.0, 0.0, weight], atol=0.06 * weight)  # masses are 5 % off
    np.testing.assert_allclose(np.linalg.norm(motion.q(times)[:, 3:7], axis=1), 1.0, atol=1e-12)
    quaternions = motion.q(times)[:, 3:7]
    assert quaternions[0] @ quaternions[-1] < -0.95  # after one turn it has the other sign
    assert jump_rows(flown)[3][0] == "attitude at touchdown"


def test_angular_momentum_stays_in_simulated_flight() -> None:
    """Implicit steps of 0.5 ms lose 0.7 % of it here."""
    jump = roll()
    control = JumpControl(jump, np.ones((2, 12)), None)
    robot = ContactRobot(control.tracked, 0.6, Perturbation().sampled(0, 0, 12, jump.robot.model.njoints))
    times = np.arange(jump.takeoff_time + 0.05, jump.takeoff_time + jump.flight.duration - 0.05, PERIOD)
    planned = jump.at(times)
    robot.begin(free_base(planned.positions[0]), planned.positions[0], planned.velocities[0])
    momenta = []
    for torques in planned.torques[:, 6:]:
        assert robot.move(torques, PERIOD)
        mujoco = robot.mujoco_robot.mujoco
        mujoco.mj_fwdPosition(robot.model, robot.data)
        mujoco.mj_subtreeVel(robot.model, robot.data)
        momenta.append(robot.data.subtree_angmom[1].copy())
    change = np.abs(np.subtract(momenta, momenta[0])).max()
    assert change < 1e-5 * np.linalg.norm(momenta[0])


def test_the_simulated_base_is_the_planned_one() -> None:
    """Configuration, velocity and acceleration that are set in MuJoCo come back as Pinocchio has them."""
    jump = roll()
    control = JumpControl(jump, np.ones((2, 12)), None)
    sample = Perturbation().sampled(0, 0, 12, jump.robot.model.njoints)
    robot = ContactRobot(control.tracked, 0.6, sample)
    time = jump.takeoff_time + 0.1
    planned = jump.at(time)
    robot.begin(jump.q(np.array([time]))[0, [0, 1, 2, 6, 3, 4, 5]], planned.positions[0])
    own_q, own_v = robot.mujoco_robot.own_state(planned.positions[0], planned.velocities[0])
    robot.data.qpos[:] = own_q
    robot.data.qvel[:] = own_v
    robot.data.qfrc_applied[robot.mujoco_robot.velocities] = planned.torques[0, 6:]
    robot.mujoco_robot.mujoco.mj_forward(robot.model, robot.data)
    q, v = robot.state()
    np.testing.assert_allclose(q, planned.positions[0], atol=1e-12)
    np.testing.assert_allclose(v, planned.velocities[0], atol=1e-12)
    scale = np.abs(planned.accelerations).max()
    np.testing.assert_allclose(robot.accelerations(), planned.accelerations[0], atol=1e-3 * scale)


def test_feet_and_links_stand_where_the_jump_has_them() -> None:
    """Spheres of the feet touch the ground, and no other shape does, where the robot stands at either end."""
    jump = roll()
    control = JumpControl(jump, np.ones((2, 12)), None)
    sample = Perturbation().sampled(0, 0, 12, jump.robot.model.njoints)
    robot = ContactRobot(control.tracked, 0.6, sample)
    for row in (0, -1):
        positions = control.planned.positions[row]
        robot.begin(positions[[0, 1, 2, 6, 3, 4, 5]], positions)
        for name in robot.feet:
            assert robot.data.geom(name).xpos[2] - robot.model.geom(name).size[0] == pytest.approx(
                jump.ground, abs=1e-6
            )
    data = jump.robot.model.createData()
    pin.forwardKinematics(jump.robot.model, data, positions)
    for foot in jump.contacts:
        place = data.oMi[foot.body].act(np.array(foot.local))
        assert robot.data.geom(foot.frame).xpos[:2] == pytest.approx(place[:2], abs=1e-3)


def test_each_point_of_a_sole_touches_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three spheres of one link, where its points are."""
    jump = roll()
    control = JumpControl(jump, np.ones((2, 12)), None)
    foot = jump.contacts[0]
    sole = []
    for suffix, local in zip(Foot.of_soles, ((-0.05, 0.0, 0.0), (0.1, 0.03, 0.0), (0.1, -0.03, 0.0)), strict=True):
        sole.append(replace(foot, suffix=suffix, local=local, depth=0.0))
    feet = [*jump.contacts, *sole]
    monkeypatch.setattr(JumpMotion, "contacts", feet)
    tracked = replace(control.tracked, shapes=shapes_of_jump(jump))
    robot = ContactRobot(tracked, 0.6, Perturbation().sampled(0, 0, 12, jump.robot.model.njoints))
    first = control.planned.positions[0]
    robot.begin(first[[0, 1, 2, 6, 3, 4, 5]], first)
    assert robot.feet == tuple(dict.fromkeys(point.name for point in feet))
    data = jump.robot.model.createData()
    pin.forwardKinematics(jump.robot.model, data, first)
    for point in sole:
        radius = robot.model.geom(point.name).size[0]
        place = data.oMi[point.body].act(np.array(point.local))
        np.testing.assert_allclose(robot.data.geom(point.name).xpos - [0.0, 0.0, radius], place, atol=1e-9)


def test_without_a_turn_it_does_not_stand() -> None:
    """A robot that is level, but short of its whole turn, has not done what was planned."""
    jump = roll()
    control = JumpControl(jump, np.ones((2, 12)), None)
    sample = Perturbation().sampled(0, 0, 12, jump.robot.model.njoints)
    robot = ContactRobot(control.tracked, 0.6, sample)
    planned = control.planned.positions
    base = free_base(planned[0])
    robot.begin(base, planned[0])
    assert robot.stands(base, 0.0)
    apart = control.base.apart(np.tile(planned[0], (len(planned), 1)), planned)
    assert apart[-1] == pytest.approx(2 * np.pi, abs=0.01)
    assert not robot.stands(base, apart[-1])


@pytest.mark.parametrize("turns", [0.5, 1.0, 1.5, 2.0, 3.0])
def test_whole_turns_are_counted(turns: float) -> None:
    """About a skew axis, however many: a quaternion returns to its sign after two."""
    angles = np.linspace(0.0, 2 * np.pi * turns, 200)
    axis = np.array([0.6, 0.0, 0.8])
    planned = np.zeros((200, 9))
    planned[:, 3:7] = Rotation.from_rotvec(angles[:, None] * axis).as_quat()
    still = np.tile(planned[0], (200, 1))
    np.testing.assert_allclose(SpatialBase().apart(still, planned), angles, atol=1e-9)
    # One that turns with it, leaning to and fro by 0.4 rad, misses nothing but what it leans.
    leaning = planned.copy()
    lean = 0.4 * np.sin(np.linspace(0.0, 20.0, 200))
    leaning[:, 3:7] = (
        Rotation.from_rotvec(lean[:, None] * [0.0, 1.0, 0.0]) * Rotation.from_quat(planned[:, 3:7])
    ).as_quat()
    np.testing.assert_allclose(SpatialBase().apart(leaning, planned), np.abs(lean), atol=1e-9)


@pytest.mark.long
def test_gains_are_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    try_few_gains(monkeypatch, (0.8, 0.7))  # with more this roll rings
    flown = fp.replay_jump(roll(), 250.0, perturb="noise=0.1deg,delay=4ms", friction=0.85)
    assert flown.tried == 2
    assert flown.landed
