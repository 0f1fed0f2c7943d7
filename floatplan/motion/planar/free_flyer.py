"""A motion in the coordinates of ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``.

The world's axes are the root link's at orientation 0; its origin is the problem's, where the takeoff frame is at time 0
unless the problem says that it is elsewhere. Gravity points along minus the plane's vertical. A configuration is the
root link's place, its quaternion (x, y, z, w; continuous in time), and every joint in the model's order, ``continuous``
ones as (cos, sin). The base's velocity is the spatial one in its own axes, of its origin, then angular; its
acceleration is the derivative of that.

With ``model.gravity`` set to the problem's, ``pin.rnea`` of these gives the torques here, and no force on the base in
the plane; ``pin.computeCentroidalMomentum`` gives the plan's angular momentum about the plane's normal. What they give
out of the plane is the leak. Axes slightly off the normal were turned onto it (by ``robot.tilt`` at most): for such a
robot all this holds to the order of that angle, for the file's axes are the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.motion.planar.full_motion import FullMotion
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.robot.robot import Robot

FREE_FLYER = 6  # velocities of the free flyer; its configuration has one number more
ROOT_JOINT = "root_joint"  # Pinocchio's name of the free flyer


@dataclass(frozen=True, eq=False)
class FreeFlyer:
    """Where the joints are in ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``.

    Attributes
    ----------
    nq, nv : int
        Sizes of a configuration and of a velocity.
    in_q, in_v : (J,) int
        First entry of each joint in them; the joints in the order of :class:`FullMotion`.
    continuous : (C,) int
        Which of the J joints are (cos, sin) in a configuration.
    """

    nq: int
    nv: int
    in_q: IntArray
    in_v: IntArray
    continuous: IntArray

    def configurations(self, motion: FullMotion) -> Array:
        """Configurations (N, nq): place, quaternion x y z w, joints; m and rad."""
        q = np.empty((len(motion.state.times), self.nq))
        q[:, :3], q[:, 3:7] = motion.base_position, motion.base_quaternion
        q[:, self.in_q] = motion.positions
        angles, first = motion.positions[:, self.continuous], self.in_q[self.continuous]
        q[:, first], q[:, first + 1] = np.cos(angles), np.sin(angles)
        return q

    def velocities(self, motion: FullMotion) -> Array:
        """Velocities (N, nv): of the base in its own axes, linear and angular, then of the joints; m/s and rad/s."""
        return self._spread(motion.base_twist, motion.velocities)

    def accelerations(self, motion: FullMotion) -> Array:
        """Accelerations (N, nv): derivatives of the velocities, m/s^2 and rad/s^2."""
        return self._spread(motion.base_twist_rate, motion.accelerations)

    def torques(self, motion: FullMotion) -> Array:
        """Torques (N, nv): nothing on the base, and each joint's own, N m."""
        return self._spread(np.zeros((len(motion.state.times), FREE_FLYER)), motion.torques)

    def _spread(self, base: Array, joints: Array) -> Array:
        values = np.empty((len(base), self.nv))
        values[:, :FREE_FLYER] = base
        values[:, self.in_v] = joints
        return values


@lru_cache(maxsize=64)
def free_flyer(robot: Robot) -> FreeFlyer:
    """Read where the joints of a robot's URDF are in Pinocchio's model of it.

    Raises
    ------
    InputError
        A joint has the name that Pinocchio gives to the free flyer.
    """
    names = list(robot.model.names)[BASE + 1 :]
    if ROOT_JOINT in robot.layout.tree.joint:
        raise InputError(
            "Pinocchio gives this name to the free flyer, and so has no free-flyer model of the file",
            source=robot.path,
            element=f'joint "{ROOT_JOINT}"',
            advice="rename it",
        )
    model = pin.buildModelFromXML(robot.xml, pin.JointModelFreeFlyer())
    joints = [model.joints[model.getJointId(name)] for name in names]
    return FreeFlyer(
        nq=model.nq,
        nv=model.nv,
        in_q=_indices([joint.idx_q for joint in joints]),
        in_v=_indices([joint.idx_v for joint in joints]),
        continuous=_indices([index for index, joint in enumerate(joints) if joint.nq == 2]),
    )


def _indices(values: list[int]) -> IntArray:
    indices = np.array(values, dtype=np.int64)
    indices.setflags(write=False)
    return indices
