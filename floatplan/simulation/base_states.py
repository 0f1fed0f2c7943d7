"""The base's numbers in the states of a control loop, (2, B + J): positions and velocities, before those of J joints.

In a plane B is 3: horizontal, vertical, angle. In space it is 7: position and quaternion x, y, z, w; of the velocities
the first is empty, for there are only six.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.jumps.spatial.stance import continuous
from floatplan.problem.attitude import required
from floatplan.problem.problem import Problem
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.integration import State
from floatplan.simulation.reduced_model import ReducedModel
from floatplan.simulation.spatial_motion import angle_between, rotation_matrix


class PlanarBase:
    """The base in a plane.

    Attributes
    ----------
    size : B
    rotations : how many numbers rotate it
    """

    size = BASE_COORDINATES
    rotations = 1

    def joined(self, q: Array, v: Array) -> Array:
        """Return the state (2, B + J) of a configuration and its velocity."""
        return np.stack((q, v))

    def parts(self, state: Array) -> State:
        """Return configuration and velocity of a state."""
        return state[0], state[1]

    def orientation(self, state: Array) -> Any:
        """Return the angle, rad, as a replanner is given it."""
        return float(state[0, self.size - 1])

    def rate(self, state: Array) -> Any:
        """Return its rate, rad/s."""
        return float(state[1, self.size - 1])

    def disturb(self, state: Array, noise: Array) -> None:
        """Add noise (2, 1), rad and rad/s, to the orientation and its rate."""
        state[:, self.size - 1] += noise[:, 0]

    def off(self, positions: Array, goal: Any) -> Array:
        """Return by how much (N,) positions (N, B + J) are off a goal's orientation, rad."""
        return np.asarray(self.attitudes(positions) - goal)

    def trace(self, positions: Array, goal: Any) -> Array:
        """Return what is shown (N,) of orientations, rad: themselves."""
        return self.attitudes(positions)

    def attitudes(self, positions: Array) -> Array:
        """Return the angles (N,), rad."""
        return np.asarray(positions[:, self.size - 1])

    def goal(self, problem: Problem) -> Any:
        """Return the orientation at landing that is required."""
        return problem.final.orientation

    def apart(self, positions: Array, planned: Array) -> Array:
        """Return the angles (N,) between the bases of two motions (N, B + J), rad, whole turns included."""
        return np.abs(self.attitudes(positions) - self.attitudes(planned))

    def continuous(self, positions: Array) -> Array:
        """Return configurations (N, 3 + J) of a motion, whose orientation goes on from one to the next."""
        return positions


class SpatialBase:
    """The base in space; members as of :class:`PlanarBase`."""

    size = 7
    rotations = 3
    quaternion = slice(3, 7)
    angular = slice(4, 7)

    def joined(self, q: Array, v: Array) -> Array:
        """Return the state (2, B + J) of a configuration and its velocity."""
        return np.stack((q, np.concatenate(([0.0], v))))

    def parts(self, state: Array) -> State:
        """Return configuration and velocity of a state."""
        return state[0], state[1, 1:]

    def orientation(self, state: Array) -> Any:
        """Return the quaternion x, y, z, w."""
        return state[0, self.quaternion]

    def rate(self, state: Array) -> Any:
        """Return the angular velocity (3,) in the base's axes, rad/s."""
        return state[1, self.angular]

    def disturb(self, state: Array, noise: Array) -> None:
        """Add noise (2, 3), rad and rad/s: of the attitude a small rotation in the base's axes."""
        turned = rotation_matrix(state[0, self.quaternion]) @ pin.exp3(noise[0])
        state[0, self.quaternion] = pin.Quaternion(turned).coeffs()
        state[1, self.angular] += noise[1]

    def off(self, positions: Array, goal: Any) -> Array:
        """Return the angles (N,) of the rotations from a goal, a quaternion, rad."""
        return np.array([angle_between(row[self.quaternion], goal) for row in positions])

    def trace(self, positions: Array, goal: Any) -> Array:
        """Return the same: an attitude is no number."""
        return self.off(positions, goal)

    def attitudes(self, positions: Array) -> Array:
        """Return the rotations (N, 3, 3)."""
        return np.array([rotation_matrix(row[self.quaternion]) for row in positions])

    def goal(self, problem: Problem) -> Any:
        """Return the attitude at landing that is required, a quaternion."""
        return required(problem.final.attitude).quaternion

    def apart(self, positions: Array, planned: Array) -> Array:
        """Return the angles (N,) between the bases of two motions (N, 7 + J), rad, whole turns included.

        Attitudes do not tell whole turns, and the signs of quaternions only whether their number is odd. So the
        rotation from the planned to the real base is integrated: the sum of its small rotations from one instant to the
        next, which are vectors, tells the number of whole turns; the attitudes tell the remainder.
        """
        rotations = Rotation.from_quat(positions[:, self.quaternion])
        error = rotations * Rotation.from_quat(planned[:, self.quaternion]).inv()
        steps = (error[1:] * error[:-1].inv()).as_rotvec()
        swept = np.linalg.norm(np.cumsum(np.concatenate((error[:1].as_rotvec(), steps)), axis=0), axis=1)
        whole_turns = 2 * np.pi * np.round(swept / (2 * np.pi))
        return np.asarray(np.abs(whole_turns + np.copysign(error.magnitude(), swept - whole_turns)))

    def continuous(self, positions: Array) -> Array:
        """Return configurations (N, 7 + J) of a motion, whose quaternions do not change their signs."""
        return continuous(np.array(positions))


BaseStates: TypeAlias = PlanarBase | SpatialBase


def base_states(reduced: ReducedModel) -> BaseStates:
    """Return how the states of a robot hold its base."""
    return SpatialBase() if reduced.is_spatial else PlanarBase()
