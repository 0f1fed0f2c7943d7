"""Motion of all joints and of a base in space, from coordinates of the robot's model."""

from functools import cached_property

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.jumps.spatial.model import BASE
from floatplan.motion.flight import FullMotion
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.robot.robot import Robot


class PinocchioMotion(FullMotion):
    """All J joints that can move, and the base, at the N instants of a motion in space.

    Parameters
    ----------
    robot : Robot
    configurations : (N, 7 + J) position of the base, quaternion x y z w, joints
    twists, twist_rates : (N, 6 + J) of the base in its own axes, linear then angular, and of joints
    forces : (N, 6 + J) N, N m, on all coordinates
    """

    configurations: Array
    twists: Array
    twist_rates: Array
    forces: Array

    def __init__(self, robot: Robot, configurations: Array, twists: Array, twist_rates: Array, forces: Array) -> None:
        object.__setattr__(self, "robot", robot)
        object.__setattr__(self, "configurations", configurations)
        object.__setattr__(self, "twists", twists)
        object.__setattr__(self, "twist_rates", twist_rates)
        object.__setattr__(self, "forces", forces)

    @cached_property
    def positions(self) -> Array:
        """Positions (N, J) of the joints, rad."""
        return read_only(self.configurations[:, BASE + 1 :])

    @cached_property
    def velocities(self) -> Array:
        """Velocities (N, J) of the joints, rad/s."""
        return read_only(self.twists[:, BASE:])

    @cached_property
    def accelerations(self) -> Array:
        """Accelerations (N, J) of the joints, rad/s^2."""
        return read_only(self.twist_rates[:, BASE:])

    @cached_property
    def torques(self) -> Array:
        """Torques (N, J), N m: each joint's own, also where several are coupled; a locked joint's holds it."""
        return read_only(self.forces[:, BASE:])

    @cached_property
    def base_position(self) -> Array:
        """Position (N, 3) of the root link's origin in the world, m."""
        return read_only(self.configurations[:, :3])

    @cached_property
    def base_quaternion(self) -> Array:
        """Orientation (N, 4) of the root link, x, y, z, w."""
        return read_only(self.configurations[:, 3 : BASE + 1])

    @cached_property
    def _attitudes(self) -> Array:
        return of_quaternions(self.base_quaternion)

    @cached_property
    def base_velocity(self) -> Array:
        """Velocity (N, 3) of the root link's origin in the world, m/s."""
        return read_only(np.einsum("kab,kb->ka", self._attitudes, self.twists[:, :3]))

    @cached_property
    def base_angular_velocity(self) -> Array:
        """Angular velocity (N, 3), rad/s, in the world."""
        return read_only(np.einsum("kab,kb->ka", self._attitudes, self.twists[:, 3:BASE]))

    @cached_property
    def base_twist(self) -> Array:
        """Spatial velocity (N, 6) of the base in its own axes: of its origin, m/s, then angular, rad/s."""
        return read_only(self.twists[:, :BASE])

    @cached_property
    def base_twist_rate(self) -> Array:
        """Derivative (N, 6) of :attr:`base_twist`, m/s^2 and rad/s^2: Pinocchio's acceleration of a free flyer."""
        return read_only(self.twist_rates[:, :BASE])
