"""A clip between its frames, and where its bodies are."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from floatplan.arrays import Array, read_only
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.robot.robot import Robot


class ClipCurve:
    """A clip between its N frames: cubic splines of the base's position and the joints, and of the attitude.

    Parameters
    ----------
    robot : Robot
        With a free base.
    fps : Hz
    base_position : (N, 3) m
    base_quaternion : (N, 4) x, y, z, w
    positions : (N, J) rad
    """

    def __init__(
        self, robot: Robot, fps: float, base_position: Array, base_quaternion: Array, positions: Array
    ) -> None:
        self.robot = robot
        self.fps = fps
        self.frames = len(positions)
        self.duration = (self.frames - 1) / fps
        times = np.arange(self.frames) / fps
        self._straight = CubicSpline(times, np.concatenate((base_position, positions), axis=1))
        self._attitude = RotationSpline(times, Rotation.from_quat(base_quaternion))

    def base_positions(self, times: Array) -> Array:
        """Places (K, 3) of the base at times (K,), m."""
        return np.asarray(self._straight(times)[:, :3])

    def positions(self, times: Array) -> Array:
        """Positions (K, J) of the joints, rad."""
        return np.asarray(self._straight(times)[:, 3:])

    def attitudes(self, times: Array) -> Array:
        """Attitudes (K, 3, 3) of the base."""
        return np.asarray(self._attitude(times).as_matrix())

    def velocities(self, times: Array) -> tuple[Array, Array, Array]:
        """Velocities at times (K,): of the base in the world (K, 3), m/s and rad/s, and of the joints (K, J)."""
        straight = self._straight(times, 1)
        turning = self._attitude(times).apply(self._attitude(times, 1))
        return straight[:, :3], turning, straight[:, 3:]

    def poses(self, times: Array) -> BodyPoses:
        """Where all bodies are at times (K,)."""
        straight = self._straight(times)
        return body_poses(self.robot, straight[:, :3], self.attitudes(times), straight[:, 3:])


def body_poses(
    robot: Robot, base_positions: Array, attitudes: Array, positions: Array, chain: Sequence[int] | None = None
) -> BodyPoses:
    """Return where the bodies of a robot's free-flyer model are at K instants, in the world.

    Parameters
    ----------
    robot : with a free base, whose joints have one coordinate each
    base_positions : (K, 3) m
    attitudes : (K, 3, 3)
    positions : (K, J) rad
    chain : joints from the base outwards, optional
        That are of interest: other bodies are left at the world's origin.
    """
    model = robot.model
    count = len(positions)
    places = np.zeros((count, model.njoints, 3))
    rotations = np.empty((count, model.njoints, 3, 3))
    rotations[:] = np.eye(3)
    places[:, 1] = base_positions
    rotations[:, 1] = attitudes
    axes_of_joints = joint_axes(robot)
    for joint in range(2, model.njoints) if chain is None else chain:
        parent = model.parents[joint]
        placement = model.jointPlacements[joint]
        axes = axes_of_joints[joint]
        moved = positions[:, joint - 2]
        places[:, joint] = places[:, parent] + rotations[:, parent] @ placement.translation
        turned = rotations[:, parent] @ placement.rotation
        if axes[:3].any():
            places[:, joint] += moved[:, None] * (turned @ axes[:3])
            rotations[:, joint] = turned
        else:
            rotations[:, joint] = turned @ _rotations_about(axes[3:], moved)
    return BodyPoses(places, rotations)


@lru_cache(maxsize=16)
def joint_axes(robot: Robot) -> Array:
    """Of each joint of the model (njoints, 6), in its own frame: along what it slides, about what it turns."""
    model = robot.model
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = np.zeros((model.njoints, 6))
    for joint in range(2, model.njoints):
        axes[joint] = np.ravel(data.joints[joint].S)
    return read_only(axes)


def _rotations_about(axis: Array, angles: Array) -> Array:
    """Rotations (K, 3, 3) about a unit vector (3,) by angles (K,), rad: Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine = np.sin(angles)[:, None, None]
    versine = 1.0 - np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def centre_of_mass(robot: Robot, poses: BodyPoses) -> Array:
    """Places (K, 3) of the centre of mass, m, in the world."""
    model = robot.model
    moment = np.zeros((len(poses.places), 3))
    mass = 0.0
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        moment += body.mass * (poses.places[:, joint] + poses.rotations[:, joint] @ body.lever)
        mass += body.mass
    return np.asarray(moment / mass)
