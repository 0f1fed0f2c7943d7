"""A clip between its frames, and where its bodies are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from floatplan.arrays import Array
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.robot.robot import Robot


class ClipCurve:
    """A clip between its N frames: cubic splines of the base's place and the joints, and of the attitude.

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
        return body_poses(self.robot.model, self.base_positions(times), self.attitudes(times), self.positions(times))


def body_poses(model: Any, base_positions: Array, attitudes: Array, positions: Array) -> BodyPoses:
    """Return where the bodies of a free-flyer model are at K instants, in the world.

    Parameters
    ----------
    model : pinocchio.Model whose first joint is a free flyer, and whose others have one coordinate each
    base_positions : (K, 3) m
    attitudes : (K, 3, 3)
    positions : (K, J) rad
    """
    count = len(positions)
    places = np.zeros((count, model.njoints, 3))
    rotations = np.empty((count, model.njoints, 3, 3))
    rotations[:, 0] = np.eye(3)
    places[:, 1] = base_positions
    rotations[:, 1] = attitudes
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for joint in range(2, model.njoints):
        parent = model.parents[joint]
        placement = model.jointPlacements[joint]
        axes = np.ravel(data.joints[joint].S)
        moved = positions[:, joint - 2]
        places[:, joint] = places[:, parent] + rotations[:, parent] @ placement.translation
        turned = rotations[:, parent] @ placement.rotation
        if axes[:3].any():
            places[:, joint] += moved[:, None] * (turned @ axes[:3])
            rotations[:, joint] = turned
        else:
            rotations[:, joint] = turned @ _rotations_about(axes[3:], moved)
    return BodyPoses(places, rotations)


def _rotations_about(axis: Array, angles: Array) -> Array:
    """Rotations (K, 3, 3) about a unit vector (3,) by angles (K,), rad: Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine = np.sin(angles)[:, None, None]
    versine = 1.0 - np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def centre_of_mass(model: Any, poses: BodyPoses) -> Array:
    """Places (K, 3) of the centre of mass, m, in the world."""
    moment = np.zeros((len(poses.places), 3))
    mass = 0.0
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        moment += body.mass * (poses.places[:, joint] + poses.rotations[:, joint] @ body.lever)
        mass += body.mass
    return np.asarray(moment / mass)
