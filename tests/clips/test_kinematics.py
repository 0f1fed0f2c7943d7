"""Bodies of a robot at many instants: against Pinocchio, and against what is true of lowest points and bent legs."""

from __future__ import annotations

from pathlib import Path

import clip_samples as samples
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.arrays import Array
from floatplan.motion.spatial.attitude import cells, turn
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.kinematics import (
    BodySolids,
    Limb,
    body_poses,
    centre_of_mass,
    free_dynamics,
    in_body,
    on_body,
)
from floatplan.motion.spatial.rotations import logarithm

COUNT = 21  # [-] instants: no multiple of what the kernel computes at once


@pytest.fixture(scope="module")
def sliding(tmp_path_factory: pytest.TempPathFactory) -> fp.Robot:
    """The robot, with a knee that slides."""
    text = samples.robot_text().replace('name="l_knee" type="revolute"', 'name="l_knee" type="prismatic"')
    path: Path = tmp_path_factory.mktemp("robot") / "sliding.urdf"
    path.write_text(text)
    return fp.Robot.from_urdf(path, base="free-flyer")


@pytest.fixture
def configurations(sliding: fp.Robot) -> Array:
    rng = np.random.default_rng(1)
    places = rng.normal(size=(COUNT, 3))
    quaternions = Rotation.random(COUNT, random_state=2).as_quat()
    return np.concatenate((places, quaternions, rng.uniform(-2.0, 2.0, (COUNT, 4))), axis=1)


def poses_of(robot: fp.Robot, configurations: Array) -> BodyPoses:
    attitudes = Rotation.from_quat(configurations[:, 3:7]).as_matrix()
    return body_poses(robot, configurations[:, :3], attitudes, configurations[:, 7:])


def test_poses_are_those_of_pinocchio(sliding: fp.Robot, configurations: Array) -> None:
    poses = poses_of(sliding, configurations)
    com = centre_of_mass(sliding, poses)
    data = sliding.model.createData()
    for k, q in enumerate(configurations):
        np.testing.assert_allclose(com[k], pin.centerOfMass(sliding.model, data, q), atol=1e-13)
        for body, placement in enumerate(data.oMi):
            np.testing.assert_allclose(poses.places[k, body], placement.translation, atol=1e-13)
            np.testing.assert_allclose(poses.rotations[k, body], placement.rotation, atol=1e-13)


def test_lowest_points_are_those_of_the_solids(sliding: fp.Robot, configurations: Array) -> None:
    poses = poses_of(sliding, configurations)
    by_solid = BodySolids(tuple([solid] for solid in sliding.solids)).lowest(poses)
    for number, solid in enumerate(sliding.solids):
        np.testing.assert_allclose(by_solid[:, number, 2], poses.lowest(solid), atol=1e-13)
    of_all = BodySolids((sliding.solids,)).lowest(poses)[:, 0]
    lowest = by_solid[..., 2].argmin(axis=1)
    np.testing.assert_allclose(of_all, by_solid[np.arange(COUNT), lowest], atol=1e-13)


def test_reach_of_points_below_a_level(sliding: fp.Robot, configurations: Array) -> None:
    poses = poses_of(sliding, configurations)
    levels = np.stack([configurations[:, 2], np.full(COUNT, -np.inf)], axis=1)
    directions = np.array([[1.0, 0.0], [0.0, -1.0], [0.6, 0.8]])
    reach = BodySolids((sliding.solids, sliding.solids)).reach(poses, levels, directions)
    expected = np.full((COUNT, len(directions)), -np.inf)
    for solid in sliding.solids:
        places = poses.points(solid.body, solid.points)
        below = poses.lowest(solid) - places[..., 2].min(axis=1)
        on_ground = places[..., 2] + below[:, None] < levels[:, :1]
        along = np.where(on_ground[..., None], places[..., :2] @ directions.T, -np.inf)
        expected = np.maximum(expected, along.max(axis=1))
    np.testing.assert_allclose(reach, expected, atol=1e-13)


def test_a_leg_is_bent_to_where_its_foot_is_to_be(robot: fp.Robot) -> None:
    rng = np.random.default_rng(3)
    leg = Limb(robot, (2, 3), (2, 3))
    still = np.tile([0.5, -1.0, -0.5, 1.0], (COUNT, 1))
    targets = still + 0.2 * rng.normal(size=still.shape)
    bases = np.zeros((COUNT, 3))
    attitudes = Rotation.random(COUNT, random_state=4).as_matrix()
    goal = body_poses(robot, bases, attitudes, targets)
    place = BodySolids(([solid for solid in robot.solids if solid.body == 3],)).lowest(goal)[:, 0]
    local = in_body(goal, 3, place)
    bent = leg.bent(bases, attitudes, still, local, place, goal.rotations[:, 3])
    np.testing.assert_allclose(bent, targets[:, :2], atol=1e-7)
    bent_knee = Limb(robot, (2, 3), (3,)).bent(bases, attitudes, still, local, place, goal.rotations[:, 3])
    assert bent_knee.shape == (COUNT, 1)
    moved = still.copy()
    moved[:, 1] = bent_knee[:, 0]
    now = on_body(body_poses(robot, bases, attitudes, moved), 3, local)
    before = on_body(body_poses(robot, bases, attitudes, still), 3, local)
    assert (np.linalg.norm(now - place, axis=1) <= np.linalg.norm(before - place, axis=1) + 1e-9).all()


def test_a_straight_leg_does_not_swing(robot: fp.Robot) -> None:
    """It is too short for most targets: then it stays next to straight, and its foot as near as it can be."""
    leg = Limb(robot, (2, 3), (2, 3))
    begin = np.tile([0.0, 0.01, 0.0, 0.0], (COUNT, 1))
    bases = np.zeros((COUNT, 3))
    upright = np.tile(np.eye(3), (COUNT, 1, 1))
    poses = body_poses(robot, bases, upright, begin)
    local = np.zeros((COUNT, 3))
    local[:, 2] = -0.2
    missing = np.linspace(0.0, 0.03, COUNT)[:, None]  # [m]
    place = on_body(poses, 3, local)
    bent = leg.bent(bases, upright, begin, local, place - missing * [0.0, 0.0, 1.0], poses.rotations[:, 3])
    assert np.abs(bent).max() < 0.02
    moved = begin.copy()
    moved[:, :2] = bent
    foot = on_body(body_poses(robot, bases, upright, moved), 3, local)
    misses = np.linalg.norm(foot - place + missing * [0.0, 0.0, 1.0], axis=1)
    np.testing.assert_allclose(misses, missing[:, 0], atol=1e-4)


def test_turns_by_momentum_are_derivatives(robot: fp.Robot) -> None:
    grid = cells(8, 6)
    positions = 0.5 * np.sin(3.0 * grid.s[:, None] + np.arange(4))
    velocities = 1.5 * np.cos(3.0 * grid.s[:, None] + np.arange(4)) / 0.4
    inertia, joint_map = free_dynamics(robot).momentum_maps(positions)
    relative = np.einsum("kaj,kj->ka", joint_map, velocities)
    h = np.array([0.3, -0.5, 0.2])
    instants = np.array([0.0, 0.1, 0.33, 0.7, 1.0])
    turning = turn(grid, 0.4, inertia, relative, h, np.eye(3))
    slopes = turning.turns_by_momentum(instants)
    step = 1e-6
    for axis in range(3):
        moved = h + step * np.eye(3)[axis]
        other = turn(grid, 0.4, inertia, relative, moved, np.eye(3))
        turned = logarithm(other.at(instants) @ np.swapaxes(turning.at(instants), 1, 2)) / step
        np.testing.assert_allclose(slopes[:, :, axis], turned, atol=1e-5)
