"""The robot's full rigid-body model, by Pinocchio: momentum, orientation rate, torques, and every joint of the URDF.

The search uses the closed form of :mod:`floatplan.motion.planar.closed_form`, which is faster over many instants; a
plan's own numbers come from here, from the full rigid-body model, so that every plan is checked by the other. Nothing
here depends on gravity, on where the centre of mass is, or on the orientation: in free flight the orientation is
cyclic, and joint torques are those of a robot that floats. The paper's (15), (A.1) and (A.3) are meant as corrected.

:class:`FreeFlyer` writes a motion in the coordinates of ``pinocchio.buildModelFromUrdf(file,
pinocchio.JointModelFreeFlyer())``. The world's axes are the root link's at orientation 0; its origin is the problem's,
where the takeoff frame is at time 0 unless the problem says that it is elsewhere. Gravity points along minus the
plane's vertical. A configuration is the root link's place, its quaternion (x, y, z, w; continuous in time), and every
joint in the model's order, ``continuous`` ones as (cos, sin). The base's velocity is the spatial one in its own axes,
of its origin, then angular; its acceleration is the derivative of that.

With ``model.gravity`` set to the problem's, ``pin.rnea`` of these gives the torques here, and no force on the base in
the plane; ``pin.computeCentroidalMomentum`` gives the plan's angular momentum about the plane's normal. What they give
out of the plane is the leak. Axes slightly off the normal were turned onto it (by ``robot.tilt`` at most): for such a
robot all this holds to the order of that angle, for the file's axes are the others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray, read_only
from floatplan.motion.dynamics import FlightState
from floatplan.pool import one_thread
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER


class Workspace(threading.local):
    """Pinocchio's ``Data`` of a model, one per thread: its functions write there, and return views of it."""

    def __init__(self, model: Any) -> None:
        self.data = model.createData()


class PinocchioDynamics:
    """The robot's dynamics over many instants, from any thread.

    The full coordinates of ``robot.model`` are the base's (horizontal, vertical, orientation), then the joints'.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._model = robot.model
        self._workspace = Workspace(robot.model)
        axis = int(np.argmax(np.abs(robot.plane.normal)))
        self._row = 3 + axis
        self._sign = float(np.sign(robot.plane.normal[axis]))
        self._linear = [int(np.argmax(np.abs(robot.plane.horizontal))), int(np.argmax(np.abs(robot.plane.vertical)))]
        self._reference = np.array(robot.reference)
        self._selection = np.array(robot.selection)
        self._moving = np.concatenate((np.eye(len(robot.reference))[:, [BASE - 1]], robot.selection), axis=1)

    def __reduce__(self) -> tuple[type[PinocchioDynamics], tuple[Robot]]:
        return PinocchioDynamics, (self.robot,)

    def full_positions(self, positions: Array) -> Array:
        """Configurations (N, nv) of the model, base at the origin, from planned positions (N, n)."""
        return np.asarray(self._reference + positions @ self._selection.T)

    def momentum_map(self, positions: Array) -> Array:
        """D of (4): rows (D_0, D_1, ..., D_n), (N, n+1) kg m^2, at positions (N, n)."""
        model = self._model
        data = self._workspace.data
        row = self._row
        full = self.full_positions(positions)
        rows = np.empty_like(full)
        for k, q in enumerate(full):
            rows[k] = pin.computeCentroidalMap(model, data, q)[row]
        return np.asarray(self._sign * (rows @ self._moving))

    def base_rate(self, positions: Array, velocities: Array, angular_momentum: float) -> Array:
        """theta0' (N,) rad/s of (4), corrected (15)."""
        momentum_map = self.momentum_map(positions)
        return np.asarray(
            (angular_momentum - np.einsum("ki,ki->k", momentum_map[:, 1:], velocities)) / momentum_map[:, 0]
        )

    def base_acceleration(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Accelerations (N, 3) of the base coordinates for which momentum, linear and angular, stays constant."""
        model = self._model
        data = self._workspace.data
        full, full_velocities = self._full_state(positions, velocities, base_rate)
        joint_accelerations = accelerations @ self._selection.T
        maps, map_rates = np.empty((2, len(full), 6, full.shape[1]))
        for k, q in enumerate(full):
            map_rates[k] = pin.computeCentroidalMapTimeVariation(model, data, q, full_velocities[k])
            maps[k] = data.Ag
        rows = [*self._linear, self._row]
        drifts = map_rates[:, rows] @ full_velocities[:, :, None] + maps[:, rows] @ joint_accelerations[:, :, None]
        return np.asarray(np.linalg.solve(maps[:, rows, :BASE], -drifts)[:, :, 0])

    def torques(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Joint torques (N, n) N m: S^T RNEA at the base acceleration that makes the base wrench vanish."""
        return np.asarray(self.full_forces(positions, velocities, accelerations, base_rate) @ self._selection)

    def full_forces(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Forces (N, nv) on all coordinates, by RNEA; those of the base vanish up to rounding.

        A joint's is its own torque, N m (force, N, where it slides), also where several are coupled or it is locked.
        """
        model = self._model
        data = self._workspace.data
        full, full_velocities = self._full_state(positions, velocities, base_rate)
        full_accelerations = self.full_accelerations(positions, velocities, accelerations, base_rate)
        forces = np.empty_like(full)
        for k, q in enumerate(full):
            forces[k] = pin.rnea(model, data, q, full_velocities[k], full_accelerations[k])
        return forces

    def full_accelerations(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Accelerations (N, nv) of all coordinates in free flight, but for gravity, at orientation 0."""
        full_accelerations = accelerations @ self._selection.T
        full_accelerations[:, :BASE] = self.base_acceleration(positions, velocities, accelerations, base_rate)
        return full_accelerations

    def _full_state(self, positions: Array, velocities: Array, base_rate: Array) -> tuple[Array, Array]:
        full_velocities = velocities @ self._selection.T
        full_velocities[:, BASE - 1] = base_rate
        return self.full_positions(positions), full_velocities


class Coordinates(Protocol):
    """All coordinates of ``robot.model`` at N instants: the base's horizontal, vertical, orientation, then all joints.

    All arrays are (N, nv).
    """

    @property
    def positions(self) -> Array:
        """Positions, m and rad."""

    @property
    def velocities(self) -> Array:
        """Velocities, m/s and rad/s."""

    @property
    def accelerations(self) -> Array:
        """Accelerations, m/s^2 and rad/s^2."""

    @property
    def torques(self) -> Array:
        """Torques, N m; on the base what no motor makes."""


class FlightCoordinates(Coordinates):
    """All coordinates of ``robot.model`` in a flight, at the N instants of a state; each array computed when asked for.

    ``gravity`` in m/s^2. Arrays are those of :class:`Coordinates`.
    """

    def __init__(self, dynamics: PinocchioDynamics, state: FlightState, gravity: float) -> None:
        self.dynamics = dynamics
        self.state = state
        self.gravity = gravity
        self._planned = state.positions, state.velocities, state.accelerations, state.orientation_rate

    @cached_property
    def positions(self) -> Array:
        """Positions (N, nv), m and rad."""
        values = self.dynamics.full_positions(self.state.positions)
        values[:, :2] = self.state.base_position
        values[:, 2] = self.state.orientation
        return read_only(values)

    @cached_property
    def velocities(self) -> Array:
        """Velocities (N, nv), m/s and rad/s."""
        state = self.state
        tree = self.dynamics.robot.tree
        rotations = tree.rotations(tree.absolute_angles(state.orientation, state.positions))
        rates = state.orientation_rate[:, None] + state.velocities @ tree.turns.T
        velocity = (1j * tree.turn * rates * rotations) @ tree.point_weights(np.array([0]), np.array([0j]))[0]
        values = state.velocities @ self.dynamics.robot.selection.T
        values[:, :2] = state.com_velocity
        values[:, 2] = state.orientation_rate
        values[:, :2] += np.stack((velocity.real, velocity.imag), axis=1)
        return read_only(values)

    @cached_property
    def accelerations(self) -> Array:
        """Accelerations (N, nv), m/s^2 and rad/s^2, gravity's included."""
        values = self.dynamics.full_accelerations(*self._planned)
        pushed = (values[:, 0] + 1j * values[:, 1]) * self.dynamics.robot.tree.rotations(self.state.orientation)
        values[:, 0] = pushed.real
        values[:, 1] = pushed.imag - self.gravity
        return read_only(values)

    @cached_property
    def torques(self) -> Array:
        """Torques (N, nv), N m, of all joints; forces on the base vanish up to rounding."""
        return read_only(self.dynamics.full_forces(*self._planned))


@dataclass(frozen=True, eq=False)
class FullMotion:
    """All J joints that can move, and the base, at the N instants of a motion; each array computed when asked for.

    The world's axes are the root link's at orientation 0; its origin is the problem's, where the takeoff frame leaves
    the ground unless the problem puts that elsewhere. Joints are in the order of ``robot.model``, which is Pinocchio's;
    those that slide are in m, m/s, m/s^2, N.

    Attributes
    ----------
    robot : Robot
    coordinates : Coordinates
    """

    robot: Robot
    coordinates: Coordinates

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the J joints."""
        return self.robot.model_joints

    @cached_property
    def positions(self) -> Array:
        """Positions (N, J) of the joints, rad."""
        return read_only(self.coordinates.positions[:, BASE:])

    @cached_property
    def velocities(self) -> Array:
        """Velocities (N, J) of the joints, rad/s."""
        return read_only(self.coordinates.velocities[:, BASE:])

    @cached_property
    def accelerations(self) -> Array:
        """Accelerations (N, J) of the joints, rad/s^2."""
        return read_only(self.coordinates.accelerations[:, BASE:])

    @cached_property
    def torques(self) -> Array:
        """Torques (N, J), N m: each joint's own, also where several are coupled; a locked joint's holds it."""
        return read_only(self.coordinates.torques[:, BASE:])

    @cached_property
    def motor_torques(self) -> Array:
        """Torques (N, J), N m, that the motors make: a leader's also moves the joints that the file gears to it.

        Those have none themselves; a locked joint's holds it.
        """
        robot = self.robot
        torques = self.torques.copy()
        base = len(robot.transmission) - len(self.joints)
        torques[:, robot.transmission[base:].any(axis=1)] = 0.0
        motors = list(map(self.joints.index, robot.motors))
        torques[:, motors] = self.torques @ robot.transmission[base:]
        return read_only(torques)

    @cached_property
    def base_position(self) -> Array:
        """Place (N, 3) of the root link's origin in the world, m."""
        return read_only(self._in_space(self._planar(self.coordinates.positions)))

    @cached_property
    def base_quaternion(self) -> Array:
        """Orientation (N, 4) of the root link, x, y, z, w: continuous in time, so of opposite sign after one turn."""
        half = self.coordinates.positions[:, BASE - 1, None] / 2
        return read_only(np.concatenate((np.sin(half) * self.robot.plane.normal, np.cos(half)), axis=1))

    @cached_property
    def base_velocity(self) -> Array:
        """Velocity (N, 3) of the root link's origin in the world, m/s."""
        return read_only(self._in_space(self._planar(self.coordinates.velocities)))

    @cached_property
    def base_angular_velocity(self) -> Array:
        """Angular velocity (N, 3), rad/s, in the world; in a plane along its normal."""
        return read_only(self.coordinates.velocities[:, BASE - 1, None] * self.robot.plane.normal)

    @cached_property
    def base_twist(self) -> Array:
        """Spatial velocity (N, 6) of the base in its own axes: of its origin, m/s, then angular, rad/s."""
        linear = self._in_space(self._planar(self.coordinates.velocities) * self._back)
        return read_only(np.concatenate((linear, self.base_angular_velocity), axis=1))

    @cached_property
    def base_twist_rate(self) -> Array:
        """Derivative (N, 6) of :attr:`base_twist`, m/s^2 and rad/s^2: Pinocchio's acceleration of a free flyer."""
        velocities = self.coordinates.velocities
        accelerations = self.coordinates.accelerations
        carried = 1j * self.robot.tree.turn * velocities[:, BASE - 1] * self._planar(velocities)
        linear = self._in_space((self._planar(accelerations) - carried) * self._back)
        angular = accelerations[:, BASE - 1, None] * self.robot.plane.normal
        return read_only(np.concatenate((linear, angular), axis=1))

    @property
    def _back(self) -> ComplexArray:
        """Rotation (N,) of a vector of the plane from the world's axes into the root link's."""
        return self.robot.tree.rotations(-self.coordinates.positions[:, BASE - 1])

    def _planar(self, values: Array) -> ComplexArray:
        """The base's place (N,), horizontal + i vertical, or a derivative, of all coordinates (N, nv)."""
        return np.asarray(values[:, 0] + 1j * values[:, 1])

    def _in_space(self, vectors: ComplexArray) -> Array:
        """Vectors (N, 3) from those of the plane, horizontal + i vertical."""
        plane = self.robot.plane
        return np.stack((vectors.real, vectors.imag), axis=1) @ np.stack((plane.horizontal, plane.vertical))


class MotionInFile:
    """A motion in the coordinates of ``pin.buildModelFromUrdf(file, pin.JointModelFreeFlyer())``.

    Those are the place of the root link, its quaternion x y z w, and all joints (``continuous`` ones as cos, sin); this
    module says what the world's axes are, what that model makes of q, v, a and tau, and of joints that floatplan had to
    turn into the plane.
    """

    def full_motion(self, times: npt.ArrayLike) -> FullMotion:
        """Motion of every joint of the URDF, and of the base in space, at N times; errors as of :meth:`at`."""
        raise NotImplementedError

    def q(self, times: npt.ArrayLike) -> Array:
        """Configuration (..., nq), m and rad, in the order of the free-flyer model of the file itself.

        Parameters
        ----------
        times : number or array
            s, within the motion; the configuration's shape begins with theirs.

        Raises
        ------
        InputError
            As of :meth:`at`; or a joint is called ``root_joint``, as Pinocchio calls the free flyer.
        """
        return self._in_file(times, FreeFlyer.configurations)

    def v(self, times: npt.ArrayLike) -> Array:
        """Velocity (..., nv), m/s and rad/s: of the base in its own axes, linear then angular, and of joints."""
        return self._in_file(times, FreeFlyer.velocities)

    def a(self, times: npt.ArrayLike) -> Array:
        """Acceleration (..., nv), m/s^2 and rad/s^2: the derivative of :meth:`v`, gravity's included."""
        return self._in_file(times, FreeFlyer.accelerations)

    def tau(self, times: npt.ArrayLike) -> Array:
        """Torques (..., nv), N m: 0 on the base, then each joint's own, also of coupled and locked ones."""
        return self._in_file(times, FreeFlyer.torques)

    @one_thread
    def _in_file(self, times: npt.ArrayLike, quantity: Callable[[FreeFlyer, FullMotion], Array]) -> Array:
        """A quantity (N, size) at times of any shape, in that shape."""
        motion = self.full_motion(times)
        values = quantity(free_flyer(motion.robot), motion)
        return values.reshape(*np.shape(times), values.shape[1])


class FreeFlyer:
    """Where the joints are in ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``.

    Joints by which the file lets its own base float are fixed in it, as in ``robot.xml``.
    ``model`` is that one; ``nq, nv`` are the sizes of its configuration and its velocity; ``in_q, in_v`` (J,) the first
    entry of each joint in them, in the order of :class:`FullMotion`; ``continuous`` (C,) which joints are (cos, sin) in
    a configuration.

    Raises
    ------
    InputError
        A joint has the name that Pinocchio gives to the free flyer.
    """

    def __init__(self, robot: Robot) -> None:
        self.model = model = robot.free_flyer()
        joints = [model.joints[model.getJointId(name)] for name in robot.model_joints]
        self.nq = int(model.nq)
        self.nv = int(model.nv)
        self.in_q = np.array([joint.idx_q for joint in joints], int)
        self.in_v = np.array([joint.idx_v for joint in joints], int)
        self.continuous = np.flatnonzero([joint.nq == 2 for joint in joints])

    def configurations(self, motion: FullMotion) -> Array:
        """Configurations (N, nq): place, quaternion x y z w, joints; m and rad."""
        q = np.empty((len(motion.positions), self.nq))
        q[:, :3] = motion.base_position
        q[:, 3:7] = motion.base_quaternion
        q[:, self.in_q] = motion.positions
        angles = motion.positions[:, self.continuous]
        first = self.in_q[self.continuous]
        q[:, first] = np.cos(angles)
        q[:, first + 1] = np.sin(angles)
        return q

    def velocities(self, motion: FullMotion) -> Array:
        """Velocities (N, nv): of the base in its own axes, linear and angular, then of the joints; m/s and rad/s."""
        return self._spread(motion.base_twist, motion.velocities)

    def accelerations(self, motion: FullMotion) -> Array:
        """Accelerations (N, nv): derivatives of the velocities, m/s^2 and rad/s^2."""
        return self._spread(motion.base_twist_rate, motion.accelerations)

    def torques(self, motion: FullMotion) -> Array:
        """Torques (N, nv): nothing on the base, and each joint's own, N m."""
        return self._spread(np.zeros((len(motion.torques), FREE_FLYER)), motion.torques)

    def _spread(self, base: Array, joints: Array) -> Array:
        values = np.empty((len(base), self.nv))
        values[:, :FREE_FLYER] = base
        values[:, self.in_v] = joints
        return values


@lru_cache(maxsize=64)
def free_flyer(robot: Robot) -> FreeFlyer:
    """Return where the joints of a robot are in Pinocchio's model of its URDF; errors as :class:`FreeFlyer`."""
    return FreeFlyer(robot)
