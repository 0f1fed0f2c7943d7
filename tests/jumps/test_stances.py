"""What stances are made of: contacts found by shape, standing postures, and quintics between them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import GO2, INSTALLED, go2_problem
from needed import skip_or_fail

import floatplan as fp
from floatplan.jumps.contacts import contact_at, rolling, standing_feet
from floatplan.jumps.exact import StanceDynamics
from floatplan.jumps.model import PlanarModel
from floatplan.jumps.motion import Grid, Stance, hermite, quintic
from floatplan.jumps.phases import Phase, not_static, standing_posture, static_beyond_ranges
from floatplan.jumps.planner import jump
from floatplan.robot import Robot
from floatplan.robot.standing import heights_over_com

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")

TALOS = "example-robot-data:talos_data/robots/talos_reduced.urdf"


def level(robot: Robot) -> np.ndarray:
    """The reference posture, its base level."""
    return np.append(0.0, robot.resting)


def test_a_quadruped_stands_on_four_feet_in_two_pairs() -> None:
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    rear, front = standing_feet(robot, "RL_foot", level(robot))
    (contact,) = contact_at(robot, front, level(robot))
    assert rear == "RL_foot"
    assert set(contact.names) == {"FL_foot", "FR_foot"}
    assert 0.015 < contact.depth < 0.03


def test_a_humanoid_stands_on_heel_and_toe() -> None:
    robot = Robot.from_urdf(TALOS, coupled="mirror", plane="xz", reference="half_sitting")
    toe, heel = contact_at(robot, "leg_left_6_link", level(robot))
    assert (toe.suffix, heel.suffix, toe.vertical, heel.vertical) == (".toe", ".heel", False, True)
    places = heights_over_com(robot, [toe.spots[0], heel.spots[0]], level(robot))
    assert 0.15 < places[0].real - places[1].real < 0.3
    assert abs(places[0].imag - toe.depth - places[1].imag + heel.depth) < 1e-9


def test_a_standing_posture_is_level_and_balanced() -> None:
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    wanted = level(robot) + np.array([0.0, 0.1, 0.0, -0.1, 0.1])
    contacts = [contact_at(robot, frame, wanted)[0] for frame in ("RL_foot", "FL_foot")]
    found = standing_posture(robot, contacts, wanted, np.vstack(((0, 0), robot.position_limits)))
    places = heights_over_com(robot, [each.spots[0] for each in contacts], found)
    assert abs(np.ptp(places.imag - [each.depth for each in contacts])) < 1e-5
    assert places.real.min() < 0 < places.real.max()
    assert np.abs(found - wanted).max() < 0.2


def test_where_nothing_stands_there_is_no_posture_and_a_reason() -> None:
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    contacts = [contact_at(robot, frame, level(robot))[0] for frame in ("RL_foot", "FL_foot")]
    narrow = np.array([[0.0, 0.0], [0.0, 0.1], [-1.0, -0.9], [1.5, 1.6], [-1.0, -0.9]])
    assert standing_posture(robot, contacts, level(robot), narrow) is None
    assert re.search("mm apart in height, '[RF]L_foot' is the highest", not_static(robot, contacts, narrow[:, 0]))
    beyond = static_beyond_ranges(robot, contacts, level(robot), narrow)
    assert beyond.startswith("static would be FL_thigh_joint at ")
    assert "where 0 to 0.1 rad are left of its range" in beyond


def test_where_the_mass_is_over_the_feet_or_not_is_said() -> None:
    robot = Robot.from_urdf(GO2, coupled="mirror", reference="standing")
    contacts = [contact_at(robot, frame, level(robot))[0] for frame in ("RL_foot", "FL_foot")]
    for lean, words in ((1.2, "behind 'RL_foot'"), (-1.2, "ahead of 'FL_foot'")):
        aslant = level(robot) - lean * np.array([0.0, 1.0, 0.0, 1.0, 0.0])
        assert words in not_static(robot, contacts, aslant)


def test_quintics_pass_through_what_they_are_given() -> None:
    times = np.array([0.0, 0.3, 0.5])
    motion = np.random.default_rng(0).normal(size=(3, 2, 3))
    curve = hermite(times, motion)
    for order, values in enumerate(motion):
        found = (curve.derivative(order) if order else curve)(times)
        np.testing.assert_allclose(found.T, values, atol=1e-9)


@pytest.mark.parametrize("way", [1, -1])
def test_a_quintic_dies_out_at_its_other_end(way: int) -> None:
    change, span = np.array([[0.3], [-1.0], [4.0]]), np.array([0.2, 0.7])
    found = quintic(span, span, *(change, 0 * change)[::way])
    np.testing.assert_allclose(found[:, 0, ::way], np.hstack((change, 0 * change)), atol=1e-9)


@pytest.mark.parametrize("feet", ["point", "rolling"])
@pytest.mark.parametrize("frames", [("RL_foot", "FL_foot"), ("FL_foot",)])
def test_released_robots_fall_with_their_feet_at_rest(frames: tuple[str, ...], feet: str) -> None:
    robot, rng = Robot.from_urdf(GO2, coupled="mirror", reference="standing"), np.random.default_rng(0)
    home = level(robot)
    contacts = tuple(contact_at(robot, frame, home)[0] for frame in frames)
    contacts = tuple(rolling(robot, each, home) for each in contacts) if feet == "rolling" else contacts
    dynamics = StanceDynamics(PlanarModel(robot), Phase("takeoff", contacts, 1.0, (1.0, 1.0), 1), home)
    drawn = rng.normal(size=(3, 5, 1)) * [[[0.2]], [[3.0]], [[50.0]]]
    y, v, a = (part[:, 0] for part in dynamics.close(home[:, None] + drawn[0], *drawn[1:]))
    pushed = dynamics.released(y, v, a)
    parts = (np.stack((each, each), axis=1) for each in (y, v, pushed))
    stance = Stance(robot, 9.81, contacts, 0j, Grid(np.array([0.0, 1.0]), *parts, np.zeros((len(frames) - 1, 2))))
    state, model = stance.at(np.zeros(1)), robot.model
    motion = [each[0] for each in (state.positions, state.velocities, state.accelerations)]
    data = model.createData()
    rate = pin.computeCentroidalMomentumTimeVariation(model, data, *motion)
    plane = robot.plane
    falling = [rate.linear @ plane.horizontal, rate.linear @ plane.vertical, rate.angular @ plane.normal]
    np.testing.assert_allclose(falling, [0.0, -9.81 * robot.mass, 0.0], atol=1e-9)
    for _, jacobians in stance.touching(state.positions).values():
        np.testing.assert_allclose(jacobians[0] @ motion[1], 0.0, atol=1e-9)
    pin.forwardKinematics(model, data, *motion)
    for joint, local, radius in stance.points.values():
        at = pin.SE3(np.eye(3), local)
        velocity, acceleration = at.actInv(data.v[joint]), at.actInv(data.a[joint])
        pushes = data.oMi[joint].rotation @ (acceleration.linear + np.cross(velocity.angular, velocity.linear))
        turned = data.oMi[joint].rotation @ acceleration.angular
        np.testing.assert_allclose(pushes, radius * np.cross(turned, plane.vertical), atol=1e-8)  # of the centre


@pytest.mark.long
def test_both_feet_are_in_the_cone_or_in_the_least_that_holds_them() -> None:
    robot, rng, friction = Robot.from_urdf(GO2, coupled="mirror", reference="standing"), np.random.default_rng(0), 0.2
    home = level(robot)
    contacts = tuple(contact_at(robot, frame, home)[0] for frame in ("RL_foot", "FL_foot"))
    dynamics = StanceDynamics(PlanarModel(robot), Phase("takeoff", contacts, 1.0, (1.0, 1.0), 1), home)
    motion = dynamics.close(
        *np.stack(
            [
                home[:, None] * (order == 0) + scale * rng.normal(size=(5, 50))
                for order, scale in enumerate((0.1, 0.5, 10.0))
            ]
        )
    )
    given = Grid(np.arange(50.0), *motion, rng.normal(size=(1, 50)))
    shared = Stance(robot, 9.81, contacts, 0j, replace(given, ratios=dynamics.shared_ratios(given, friction)))
    forces = shared.at(given.times).forces
    feet = np.array([forces["RL_foot"], forces["FL_foot"]])
    feet = feet[:, (feet[..., 1] > 1.0).all(axis=0)]
    cones, needed = np.abs(feet[..., 0] / feet[..., 1]), np.abs(feet[..., 0].sum(axis=0) / feet[..., 1].sum(axis=0))
    assert (needed > friction).sum() > 5 < (needed < friction).sum()
    assert (cones <= np.maximum(needed, friction) + 1e-9).all()


@pytest.mark.long  # as one foot does that is alone, in test_rolling.py
def test_all_feet_may_leave_and_come_at_once() -> None:
    both = [("RL_foot", "FL_foot")]
    problem = go2_problem(turns=0)
    found = jump(problem, fp.JumpRequest(takeoff=fp.JumpTakeoff(both), landing=fp.JumpLanding(both)), starts=1)
    assert found.ok
    assert max(found.check.figures[name] for name in ("takeoff_seam", "landing_seam")) < 1e-8


@pytest.mark.long
def test_a_program_is_the_same_in_every_process() -> None:
    """What stays above the ground is in the order of the contacts, whatever the hashes of their names."""
    lines = (
        "import sys",
        "import numpy as np, floatplan as fp",
        "from floatplan.jumps.contacts import clearance_points, contact_at",
        "robot = fp.Robot.from_urdf(sys.argv[1], coupled='mirror', reference='standing')",
        "level = np.append(0.0, robot.resting)",
        "feet = [contact_at(robot, frame, level)[0] for frame in ('RL_foot', 'FL_foot')]",
        "print([spot.body for spot in clearance_points(robot, feet, -0.3, level, 4).spots])",
    )
    told = {
        subprocess.run(
            [sys.executable, "-c", "\n".join(lines), GO2],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
            text=True,
        ).stdout
        for seed in "01"
    }
    assert len(told) == 1
    assert "6" in told.pop()
