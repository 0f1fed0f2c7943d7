"""A clip between its frames."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from floatplan.arrays import Array
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.kinematics import body_poses
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
