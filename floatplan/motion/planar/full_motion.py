"""The motion of every joint that a URDF has, planned, coupled and locked, and of the base in space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, ComplexArray, read_only
from floatplan.motion.flight_state import FlightState
from floatplan.motion.planar.pinocchio_dynamics import PinocchioDynamics
from floatplan.robot.planar.model import BASE_COORDINATES as BASE


@dataclass(frozen=True, eq=False)
class FullMotion:
    """All J joints that can move, and the base, at the N instants of a state; each array computed when asked for.

    The world's axes are the root link's at orientation 0; its origin is the problem's, where the takeoff frame leaves
    the ground unless the problem puts that elsewhere. Joints are in the order of ``robot.model``, which is Pinocchio's;
    those that slide are in m, m/s, m/s^2, N.

    Attributes
    ----------
    dynamics : PinocchioDynamics
    state : FlightState
    gravity : m/s^2
    """

    dynamics: PinocchioDynamics
    state: FlightState
    gravity: float

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the J joints."""
        return tuple(self.dynamics.robot.model.names)[BASE + 1 :]

    @cached_property
    def positions(self) -> Array:
        """Positions (N, J) of the joints, rad."""
        return read_only(self.dynamics.full_positions(self.state.positions)[:, BASE:])

    @cached_property
    def velocities(self) -> Array:
        """Velocities (N, J) of the joints, rad/s."""
        return read_only(self.state.velocities @ self.dynamics.robot.selection[BASE:].T)

    @cached_property
    def accelerations(self) -> Array:
        """Accelerations (N, J) of the joints, rad/s^2."""
        return read_only(self._full_accelerations[:, BASE:])

    @cached_property
    def torques(self) -> Array:
        """Torques (N, J), N m: each joint's own, also where several are coupled; a locked joint's holds it."""
        return read_only(self.dynamics.full_forces(*self._planned)[:, BASE:])

    @cached_property
    def motor_torques(self) -> Array:
        """Torques (N, J), N m, that the motors make: a leader's also moves the joints that the file gears to it.

        Those have none themselves; a locked joint's holds it.
        """
        robot, torques = self.dynamics.robot, self.torques.copy()
        driven = robot.transmission[BASE:].any(axis=1)
        torques[:, driven] = 0.0
        torques[:, [self.joints.index(name) for name in robot.motors]] = self.state.motor_torques
        return read_only(torques)

    @cached_property
    def base_position(self) -> Array:
        """Place (N, 3) of the root link's origin in the world, m."""
        return read_only(self.state.base_position @ self._axes)

    @cached_property
    def base_quaternion(self) -> Array:
        """Orientation (N, 4) of the root link, x, y, z, w: continuous in time, so of opposite sign after one turn."""
        half = self.state.orientation[:, None] / 2
        return read_only(np.concatenate((np.sin(half) * self._normal, np.cos(half)), axis=1))

    @cached_property
    def base_velocity(self) -> Array:
        """Velocity (N, 3) of the root link's origin in the world, m/s."""
        return read_only(self._in_space(self._velocity))

    @cached_property
    def base_angular_velocity(self) -> Array:
        """Angular velocity (N, 3), rad/s, in the root link's axes or the world's: it is along the plane's normal."""
        return read_only(self.state.orientation_rate[:, None] * self._normal)

    @cached_property
    def base_twist(self) -> Array:
        """Spatial velocity (N, 6) of the base in its own axes: of its origin, m/s, then angular, rad/s."""
        linear = self._in_space(self._velocity * self._back)
        return read_only(np.concatenate((linear, self.base_angular_velocity), axis=1))

    @cached_property
    def base_twist_rate(self) -> Array:
        """Derivative (N, 6) of :attr:`base_twist`, m/s^2 and rad/s^2: Pinocchio's acceleration of a free flyer."""
        turn, state = self.dynamics.robot.tree.turn, self.state
        pushed = self._full_accelerations[:, 0] + 1j * self._full_accelerations[:, 1]
        carried = 1j * turn * state.orientation_rate * self._velocity
        linear = pushed - (1j * self.gravity + carried) * self._back
        angular = self._full_accelerations[:, BASE - 1, None] * self._normal
        return read_only(np.concatenate((self._in_space(linear), angular), axis=1))

    @cached_property
    def _full_accelerations(self) -> Array:
        return self.dynamics.full_accelerations(*self._planned)

    @property
    def _planned(self) -> tuple[Array, Array, Array, Array]:
        state = self.state
        return state.positions, state.velocities, state.accelerations, state.orientation_rate

    @cached_property
    def _velocity(self) -> ComplexArray:
        """Velocity (N,) of the root link's origin, horizontal + i vertical."""
        tree, state = self.dynamics.robot.tree, self.state
        rotations = tree.rotations(tree.absolute_angles(state.orientation, state.positions))
        rates = state.orientation_rate[:, None] + state.velocities @ tree.turns.T
        swing = (1j * tree.turn * rates * rotations) @ tree.point_weights(np.array([0]), np.array([0j]))[0]
        return np.asarray(state.com_velocity[:, 0] + 1j * state.com_velocity[:, 1] + swing)

    @cached_property
    def _back(self) -> ComplexArray:
        """Rotation (N,) of a vector of the plane from the world's axes into the root link's."""
        return self.dynamics.robot.tree.rotations(-self.state.orientation)

    def _in_space(self, vectors: ComplexArray) -> Array:
        """Vectors (N, 3) from those of the plane, horizontal + i vertical."""
        return np.stack((vectors.real, vectors.imag), axis=1) @ self._axes

    @property
    def _axes(self) -> Array:
        plane = self.dynamics.robot.plane
        return np.stack((plane.horizontal, plane.vertical))

    @property
    def _normal(self) -> Array:
        return self.dynamics.robot.plane.normal
