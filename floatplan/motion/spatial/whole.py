"""The whole robot in a flight in space, at any instant, by Pinocchio's full model.

World: the root link's axes at the identity, z up; the origin is the problem's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.motion.dynamics import FlightState
from floatplan.motion.planar.full_model import Coordinates, FullMotion
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.motion.spatial.attitude import (
    IntegrationError,
    Turning,
    cells,
    growth_of_errors,
    turn,
    weighted_growth,
    wrong_way,
)
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.clearance import SpatialSegments, shapes_in_space
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.motion.spatial.kinematics import poses_about, posture_about
from floatplan.motion.spatial.rotations import logarithm, of_quaternions, quaternions_of, unwrapped_angles
from floatplan.pool import one_thread
from floatplan.problem.attitude import required
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.robot.urdf.base import FREE_FLYER


class SpatialMotion:
    """A motion of joints as written, with an angular momentum (3,), kg m^2/s, and the base's, which follows."""

    def __init__(self, problem: Problem, joints: WrittenMotion, angular_momentum: Array, path: Ballistics) -> None:
        self.problem = problem
        self.joints = joints
        self.angular_momentum = angular_momentum
        self.path = path
        self.dynamics = spatial_dynamics(problem.robot)

    @cached_property
    @one_thread
    def turning(self) -> Turning:
        """How the base turns, in as many cells as that needs."""
        before = None
        resolved = 1e-11  # [rad] a change of the attitude at landing by twice as many cells that counts as none
        for count in (16, 32, 64, 128):
            fine = cells(count, 10)
            duration = self.problem.flight.duration
            positions, velocities, _ = self.joints.at(fine.s * duration)
            inertia, joint_map = self.dynamics.momentum_maps(positions)
            relative = np.einsum("kan,kn->ka", joint_map, velocities)
            start = required(self.problem.initial.attitude).matrix
            try:
                turning = turn(fine, duration, inertia, relative, self.angular_momentum, start)
            except IntegrationError:
                continue
            if before is not None and np.linalg.norm(logarithm(turning.ends[-1:] @ before.T)) < resolved:
                return turning
            before = turning.ends[-1]
        if before is None:
            raise IntegrationError("the motion is too wild to be integrated")
        return turning

    @cached_property
    def _quaternions(self) -> Array:
        """Quaternions (C + 1, 4) x, y, z, w at the borders of the cells, of signs that go on in time."""
        borders = np.concatenate((self.turning.borders, self.turning.ends[-1:]))
        quaternions = quaternions_of(borders)
        turned = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1.0, 1.0))
        quaternions[1:] *= turned[:, None]
        return quaternions

    def quaternions(self, attitudes: Array, instants: Array) -> Array:
        """Quaternions (N, 4) x, y, z, w of attitudes at times (N,) s, continuous in time."""
        quaternions = quaternions_of(attitudes)
        nearest = np.rint(instants / self.problem.flight.duration * self.turning.cells.count).astype(np.int64)
        same = (quaternions * self._quaternions[nearest]).sum(axis=1) < 0
        return np.where(same[:, None], -quaternions, quaternions)

    def state(self, instants: Array) -> FlightState:
        """State at times (N,) s within the flight: quaternions (N, 4), and rates in the base's axes."""
        robot = self.problem.robot
        positions, velocities, accelerations = self.joints.at(instants)
        inertia, joint_map = self.dynamics.momentum_maps(positions)
        attitudes = self.attitudes(instants)
        relative = np.einsum("kan,kn->ka", joint_map, velocities)
        rates = np.linalg.solve(inertia, (self.angular_momentum @ attitudes - relative)[..., None])[..., 0]
        forces = self.dynamics.torques(positions, velocities, accelerations, rates)
        com = self.path.positions(instants)
        momentum = np.einsum("kab,kb->ka", attitudes, np.einsum("kab,kb->ka", inertia, rates) + relative)
        poses = poses_about(robot, attitudes, positions, com)
        base = 1  # of the bodies, after the world
        return FlightState(
            times=read_only(instants),
            orientation=read_only(self.quaternions(attitudes, instants)),
            orientation_rate=read_only(rates),
            positions=read_only(positions),
            velocities=read_only(velocities),
            accelerations=read_only(accelerations),
            torques=read_only(forces @ robot.selection[FREE_FLYER:]),
            motor_torques=read_only(forces @ robot.transmission[FREE_FLYER:]),
            com_position=read_only(com),
            com_velocity=read_only(self.path.velocities(instants)),
            base_position=read_only(poses.places[:, base]),
            angular_momentum=read_only(momentum),
        )

    def attitudes(self, instants: Array) -> Array:
        """Attitudes (N, 3, 3) at times (N,) s."""
        return self.turning.at(np.clip(instants / self.problem.flight.duration, 0.0, 1.0))

    def full_motion(self, state: FlightState) -> FullMotion:
        """Motion of every joint of the robot's file, and of the base, at the N instants of a state."""
        return SpatialFullMotion(self.problem.robot, SpatialCoordinates(self, state))

    def forces(self, state: FlightState) -> Array:
        """Forces (N, nv), N m, on all coordinates of the model at the N instants of a state; none on the base."""
        moved = (state.positions, state.velocities, state.accelerations, state.orientation_rate)
        return np.pad(self.dynamics.torques(*moved), ((0, 0), (FREE_FLYER, 0)))

    def bodies(self, instants: Array) -> BodyPoses:
        """Where the bodies are at times (N,) s."""
        joints = self.joints.at(instants)[0]
        com = self.path.positions(instants)
        return poses_about(self.problem.robot, self.attitudes(instants), joints, com)

    def segments(self, instants: Array, hulls: bool = False) -> SpatialSegments:
        """The links' capsules at times (N,) s."""
        return shapes_in_space(self.problem.robot).place(self.bodies(instants))

    def posture(self, state: JointState, time: float) -> BodyPoses:
        """Where they are in a posture, the centre of mass where it is at a time, s."""
        return posture_about(self.problem.robot, state, self.path.positions(np.array([time]))[0])

    def orientation(self, times: Array) -> Array:
        """Refused: the orientation is no number."""
        raise self.problem.robot.not_in_plane

    @property
    def final_orientation(self) -> float:
        """Refused as well."""
        raise self.problem.robot.not_in_plane

    def heights(self, instants: Array) -> tuple[Array, tuple[str, ...]]:
        """Heights (N, S), m, of shapes over the ground's line at times (N,) s, and whose they are: links (S)."""
        poses = self.bodies(instants)
        solids = self.problem.robot.solids
        heights = np.stack(list(map(poses.lowest, solids)), axis=1)
        return heights - self.problem.ground_plane.point[-1], tuple(solid.link for solid in solids)

    @property
    def orientation_at_ends(self) -> Mapping[str, Any]:
        """Quaternions x, y, z, w at the start, at the end and of the goal, with w not negative."""
        start, goal = (required(state.attitude).quaternion for state in (self.problem.initial, self.problem.final))
        end = quaternions_of(self.turning.ends[-1:])[0]
        named = (("start", start), ("end", read_only(end)), ("goal", goal))
        return {name: {"quaternion_xyzw": quaternion} for name, quaternion in named}

    @property
    def missed(self) -> float:
        """By how much the attitude at landing misses the goal, rad; a whole rotation too many or too few counts."""
        reorientation = self.problem.reorientation
        assert reorientation is not None, "the robot flies in space"
        missed = float(np.linalg.norm(logarithm(reorientation.goal.matrix.T[None] @ self.turning.ends[-1:])))
        return math.inf if wrong_way(reorientation, self.turning.way) else missed

    @cached_property
    def growth_of_errors(self) -> tuple[Array, Array]:
        """K (3,), rad, and P (3, 3), see :func:`~floatplan.motion.spatial.attitude.growth_of_errors`."""
        by_size, by_attitude = growth_of_errors(self.turning.landing_by_momentum(np.eye(3)), self.angular_momentum)
        return read_only(by_size), read_only(by_attitude)

    def robust_size(self, size: float) -> float:
        """The objective "robust", rad, of a motion of the joints of some size, rad: root of ``size^2 + |growth|^2``."""
        growth = weighted_growth(self.turning.landing_by_momentum(np.eye(3)), self.angular_momentum)
        return float(np.sqrt(size * size + growth @ growth))

    def angles(self, axes: str) -> Array:
        """Angles (C S + 2, 3), rad, of takeoff, all stages and landing, unwrapped from those requested at takeoff."""
        angles = unwrapped_angles(axes, self.turning.way)
        requested = required(self.problem.initial.attitude).angles_about(axes)
        angles[:, [0, 2]] += (2 * np.pi * np.rint((requested - angles[0]) / (2 * np.pi)))[[0, 2]]
        return angles

    def angles_at(self, axes: str, instants: Array) -> Array:
        """The same (N, 3), rad, at times (N,) s."""
        angles_at_stages = self.angles(axes)
        angles = unwrapped_angles(axes, self.attitudes(instants))
        stages = np.concatenate(([0.0], self.turning.cells.s, [1.0])) * self.problem.flight.duration
        near = np.stack([np.interp(instants, stages, column) for column in angles_at_stages.T], axis=1)
        angles[:, [0, 2]] += (2 * np.pi * np.rint((near - angles) / (2 * np.pi)))[:, [0, 2]]
        return angles


class SpatialCoordinates(Coordinates):
    """All coordinates of ``robot.model`` in a flight, at the N instants of a state; each array computed when asked for.

    Of the base its origin's position, the quaternion x y z w, continuous in time, and the spatial velocity in its own
    axes, linear then angular; then all J joints.
    """

    def __init__(self, motion: SpatialMotion, state: FlightState) -> None:
        self.motion = motion
        self.state = state
        self._attitudes = of_quaternions(state.orientation)

    @cached_property
    def positions(self) -> Array:
        """Positions (N, 7 + J), m, [-] and rad."""
        joints = self.motion.dynamics.configurations(self.state.positions)[:, FREE_FLYER + 1 :]
        return read_only(np.hstack((self.state.base_position, self.state.orientation, joints)))

    @cached_property
    def velocities(self) -> Array:
        """Velocities (N, 6 + J), m/s and rad/s."""
        state = self.state
        model = self.motion.dynamics.model
        data = self.motion.dynamics.data
        moving = self.motion.dynamics.full_velocities(state.velocities, state.orientation_rate)
        # of the centre of mass where the base's origin is at rest, in the base's axes
        still = np.empty((len(moving), 3))
        for k, q in enumerate(self.motion.dynamics.configurations(state.positions)):
            pin.centerOfMass(model, data, q, moving[k])
            still[k] = data.vcom[0]
        linear = np.einsum("kba,kb->ka", self._attitudes, state.com_velocity) - still
        joints = state.velocities @ self.motion.problem.robot.selection[FREE_FLYER:].T
        return read_only(np.hstack((linear, state.orientation_rate, joints)))

    @cached_property
    def accelerations(self) -> Array:
        """Derivatives (N, 6 + J) of the velocities, m/s^2 and rad/s^2, gravity's included."""
        state = self.state
        base = self.motion.dynamics.base_accelerations(
            state.positions, state.velocities, state.accelerations, state.orientation_rate
        )
        up = np.array([0.0, 0.0, 1.0])
        down = np.einsum("kba,b->ka", self._attitudes, -self.motion.path.gravity * up)
        carried = np.cross(state.orientation_rate, self.velocities[:, :3])
        base[:, :3] += down - carried
        joints = state.accelerations @ self.motion.problem.robot.selection[FREE_FLYER:].T
        return read_only(np.hstack((base, joints)))

    @cached_property
    def torques(self) -> Array:
        """Torques (N, 6 + J), N m, of all joints; there are none on the base."""
        return read_only(self.motion.forces(self.state))


class SpatialFullMotion(FullMotion):
    """All J joints that can move, and the base, at the N instants of a motion in space.

    Its coordinates are those of :class:`SpatialCoordinates`, of a flight or of another motion.
    """

    def __repr__(self) -> str:
        """How many joints, at how many instants."""
        return f"SpatialFullMotion({len(self.joints)} joints, {len(self.positions)} instants)"

    @cached_property
    def positions(self) -> Array:
        """Positions (N, J) of the joints, rad."""
        return read_only(self.coordinates.positions[:, FREE_FLYER + 1 :])

    @cached_property
    def velocities(self) -> Array:
        """Velocities (N, J) of the joints, rad/s."""
        return read_only(self.coordinates.velocities[:, FREE_FLYER:])

    @cached_property
    def accelerations(self) -> Array:
        """Accelerations (N, J) of the joints, rad/s^2."""
        return read_only(self.coordinates.accelerations[:, FREE_FLYER:])

    @cached_property
    def torques(self) -> Array:
        """Torques (N, J), N m: every joint's own, also where several are coupled; a locked joint's holds it."""
        return read_only(self.coordinates.torques[:, FREE_FLYER:])

    @cached_property
    def base_position(self) -> Array:
        """Position (N, 3) of the root link's origin in the world, m."""
        return read_only(self.coordinates.positions[:, :3])

    @cached_property
    def base_quaternion(self) -> Array:
        """Orientation (N, 4) of the root link, x, y, z, w: continuous in time."""
        return read_only(self.coordinates.positions[:, 3 : FREE_FLYER + 1])

    @cached_property
    def _attitudes(self) -> Array:
        return of_quaternions(self.base_quaternion)

    @cached_property
    def base_velocity(self) -> Array:
        """Velocity (N, 3) of the root link's origin in the world, m/s."""
        return read_only(np.einsum("kab,kb->ka", self._attitudes, self.base_twist[:, :3]))

    @cached_property
    def base_angular_velocity(self) -> Array:
        """Angular velocity (N, 3), rad/s, in the world."""
        return read_only(np.einsum("kab,kb->ka", self._attitudes, self.base_twist[:, 3:]))

    @cached_property
    def base_twist(self) -> Array:
        """Spatial velocity (N, 6) of the base in its own axes: of its origin, m/s, then angular, rad/s."""
        return read_only(self.coordinates.velocities[:, :FREE_FLYER])

    @cached_property
    def base_twist_rate(self) -> Array:
        """Derivative (N, 6) of :attr:`base_twist`, m/s^2 and rad/s^2: Pinocchio's acceleration of a free flyer."""
        return read_only(self.coordinates.accelerations[:, :FREE_FLYER])
