"""The base's numbers in the states of a control loop, (2, B + J): positions and velocities, before those of J joints.

In a plane B is 3: horizontal, vertical, angle. In space it is 7: position and quaternion x, y, z, w; of the velocities
the first is empty, for there are only six.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.integration import State
from floatplan.simulation.reduced_model import ReducedModel
from floatplan.simulation.spatial_motion import angle_between, rotation_matrix


class BaseStates(Protocol):
    """How the base's numbers are read and written.

    Attributes
    ----------
    size : B
    rotations : how many numbers turn it
    """

    size: int
    rotations: int

    def joined(self, q: Array, v: Array) -> Array:
        """Return the state (2, B + J) of a configuration and its velocity."""
        ...

    def parts(self, state: Array) -> State:
        """Return these of a state."""
        ...

    def orientation(self, state: Array) -> Any:
        """Return the orientation and its rate as a replanner is given them."""
        ...

    def rate(self, state: Array) -> Any:
        """Return the rate of it."""
        ...

    def disturb(self, state: Array, noise: Array) -> None:
        """Add noise (2, rotations), rad and rad/s, to the orientation and its rate."""
        ...

    def off(self, positions: Array, goal: Any) -> Array:
        """Return by how much (N,) positions (N, B + J) are off a goal's orientation, rad; in space without a sign."""
        ...

    def trace(self, positions: Array, goal: Any) -> Array:
        """Return what is shown (N,) of orientations, rad: in a plane themselves, in space how far off the goal."""
        ...

    def attitudes(self, positions: Array) -> Array:
        """Return angles (N,), in space rotations (N, 3, 3)."""
        ...


class PlanarBase:
    """The base in a plane."""

    size = BASE_COORDINATES
    rotations = 1

    def joined(self, q: Array, v: Array) -> Array:
        """As :class:`BaseStates` says."""
        return np.stack((q, v))

    def parts(self, state: Array) -> State:
        """The same."""
        return state[0], state[1]

    def orientation(self, state: Array) -> float:
        """The angle, rad."""
        return float(state[0, self.size - 1])

    def rate(self, state: Array) -> float:
        """Its rate, rad/s."""
        return float(state[1, self.size - 1])

    def disturb(self, state: Array, noise: Array) -> None:
        """As :class:`BaseStates` says."""
        state[:, self.size - 1] += noise[:, 0]

    def off(self, positions: Array, goal: float) -> Array:
        """The differences."""
        return self.attitudes(positions) - goal

    def trace(self, positions: Array, goal: float) -> Array:
        """The angles."""
        return self.attitudes(positions)

    def attitudes(self, positions: Array) -> Array:
        """The same."""
        return np.asarray(positions[:, self.size - 1])


class SpatialBase:
    """The base in space."""

    size = 7
    rotations = 3
    quaternion = slice(3, 7)
    angular = slice(4, 7)

    def joined(self, q: Array, v: Array) -> Array:
        """As :class:`BaseStates` says."""
        return np.stack((q, np.concatenate(([0.0], v))))

    def parts(self, state: Array) -> State:
        """The same."""
        return state[0], state[1, 1:]

    def orientation(self, state: Array) -> Array:
        """The quaternion x, y, z, w."""
        return state[0, self.quaternion]

    def rate(self, state: Array) -> Array:
        """The angular velocity (3,) in the base's axes, rad/s."""
        return state[1, self.angular]

    def disturb(self, state: Array, noise: Array) -> None:
        """As :class:`BaseStates` says: a small rotation in the base's axes."""
        turned = rotation_matrix(state[0, self.quaternion]) @ pin.exp3(noise[0])
        state[0, self.quaternion] = pin.Quaternion(turned).coeffs()
        state[1, self.angular] += noise[1]

    def off(self, positions: Array, goal: Any) -> Array:
        """The angles of the rotations from the goal, a quaternion."""
        return np.array([angle_between(row[self.quaternion], goal) for row in positions])

    def trace(self, positions: Array, goal: Any) -> Array:
        """The same."""
        return self.off(positions, goal)

    def attitudes(self, positions: Array) -> Array:
        """The rotations."""
        return np.array([rotation_matrix(row[self.quaternion]) for row in positions])


def base_states(reduced: ReducedModel) -> BaseStates:
    """Return how the states of a robot hold its base."""
    return PlanarBase() if reduced.model.nq == reduced.model.nv else SpatialBase()
