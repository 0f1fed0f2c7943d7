"""How a robot stands at one end of a flight: on a frame at rest, with nothing else in the ground or going into it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray
from floatplan.initial.robots import upright
from floatplan.motion.planar.ballistics import frame_weights
from floatplan.motion.planar.closed_form import Dynamics, tree_dynamics
from floatplan.motion.planar.contact_rates import contact_matrices, least_rates, row_sizes
from floatplan.robot.robot import LinkCapsule, Robot
from floatplan.tables import AT_REST, CLEARANCE

FAST = math.radians(2000)  # [rad/s] that no joint of a legged robot turns at, whatever its URDF says
STRONGEST = 1e9  # [N m] where the URDF gives no torque limit
SOON = 0.04  # [s] after takeoff, or before landing, when everything still has to be above the ground
LIFTED = 5.0 * SOON**2 / 2  # [m] at 5 m/s^2, by which the accelerations, which are free, raise a foot by then
ROUNDING = 1e-9  # [m]
ALIKE = 1e-3  # [m] by which the meshes of left and right may differ
POSTURES = 4  # [-] in which points that are the same place always coincide
FLAT = math.radians(15)  # [rad] that a sole may be tipped
SOLE = 0.05  # [m] a foot that is shorter is a point: it may be tipped
FOOT = 0.25  # [-] of the height of the centre of mass at rest, as long as a person's foot; feet count as no shorter
NEAR = 0.1  # [-] of that height, above the ground, of what the robot stands on
TRUNK = 0.12  # [-] of that height, between the trunk's true shape and the ground
GAP = 0.002  # [m] between the ground and what does not stand on it


@dataclass(frozen=True, eq=False)
class Stance:
    """A robot on the frame that leaves or meets the ground; ``feet`` are all that it could stand on."""

    robot: Robot
    frame: str
    feet: tuple[str, ...] = ()

    @cached_property
    def limits(self) -> Array:
        """Velocity limits (n,) rad/s of the planned joints: the URDF's, where that has sensible ones."""
        fast = FAST / np.abs(self.robot.motor_ratios).max(axis=0)
        return np.asarray(np.minimum(self.robot.velocity_limits, fast))

    @cached_property
    def sluggishness(self) -> Array:
        """Torque (n,) that each joint alone takes for an acceleration of 1 rad/s^2 at rest, over its limit: s^2/rad."""
        robot, alone = self.robot, np.eye(len(self.robot.joints))
        moments = self.dynamics.moments(robot.resting + 0 * alone, 0 * alone, alone, np.zeros(len(alone)))
        limits = np.minimum(robot.motor_torque_limits, STRONGEST) @ np.abs(robot.motor_ratios)
        return np.asarray((moments @ robot.tree.turns).diagonal() / limits)

    @cached_property
    def dynamics(self) -> Dynamics:
        """D of (4)."""
        return tree_dynamics(self.robot.tree)

    @cached_property
    def _shapes(self) -> tuple[LinkCapsule, ...]:
        return self.robot.hulls([self.frame])

    @cached_property
    def _standing(self) -> str | None:
        """The link with whose shapes the frame stands."""
        return self.robot.contact_link(self.robot.frames[self.frame].link)

    @cached_property
    def points(self) -> tuple[ComplexArray, Array, BoolArray, BoolArray]:
        """Weights (P, m) of the ends of all shapes, radii (P,), m; which stand, and which are where a foot is."""
        robot, frame = self.robot, self.robot.frames[self.frame]
        if self._standing is None:
            return frame_weights(robot, frame)[None], np.zeros(1), np.ones(1, dtype=bool), np.ones(1, dtype=bool)
        turns = robot.tree.turns
        ends = [(shape, end) for shape in self._shapes for end in (shape.start, shape.end)]
        bodies, local = (np.array(column) for column in zip(*((shape.body, end) for shape, end in ends), strict=True))
        weights = robot.tree.point_weights(bodies, local)
        stands = np.array([shape.link == self._standing for shape, _ in ends])
        positions = np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, len(robot.joints)))
        somewhere = robot.tree.rotations(robot.tree.absolute_angles(np.zeros(POSTURES), positions))
        places = somewhere @ weights.T
        apart = np.abs(places[:, :, None] - places[:, None, stands]).max(axis=0).min(axis=1)
        feet = (turns[bodies] == turns[frame.body]).all(axis=1) | (apart < ALIKE)  # a shank ends where its foot is
        return weights, np.array([shape.radius for shape, _ in ends]), stands, feet

    @cached_property
    def upright(self) -> float:
        """Orientation, rad, in which the robot stands on the frame; see :func:`floatplan.initial.robots.upright`."""
        return upright(self.robot, self.frame)

    @cached_property
    def resting(self) -> Standing:
        """The robot upright on its foot, in its resting posture."""
        return self.standing(np.array([self.upright]), self.robot.resting[None])

    @cached_property
    def size(self) -> float:
        """Height of the centre of mass at rest, m."""
        return max(float(self.resting.height[0]), 1e-3)

    @cached_property
    def sole(self) -> float:
        """Length of the foot, m."""
        weights, _, stands, _ = self.points
        places = (self.resting._rotations @ weights[stands].T).real
        return float(np.ptp(places))

    @property
    def foot_turns(self) -> Array:
        """Derivatives (n,) of the foot's absolute angle by the planned positions."""
        turns: Array = self.robot.tree.turns[self.robot.frames[self.frame].body]
        return turns

    @cached_property
    def trunk(self) -> BoolArray:
        """Which of the points (P,) are on the base, where that is not what stands."""
        if self.robot.frames[self.frame].body == 0 or self._standing is None:
            return np.zeros(len(self.points[1]), dtype=bool)
        return np.array([shape.body == 0 for shape in self._shapes for _ in range(2)]) & ~self.points[2]

    @cached_property
    def feet_weights(self) -> ComplexArray:
        """Weights (f, m) of all feet, relative to the frame."""
        frames = self.robot.frames
        own = frame_weights(self.robot, frames[self.frame])
        return np.array([frame_weights(self.robot, frames[foot]) - own for foot in (self.frame, *self.feet)])

    def standing(self, orientations: Array, positions: Array) -> Standing:
        """The robot in K postures: orientations (K,) and positions (K, n), rad."""
        return Standing(self, orientations, positions)


@dataclass(frozen=True, eq=False)
class Standing:
    """A robot on its foot in K postures: orientations (K,) and positions (K, n), rad."""

    stance: Stance
    orientations: Array
    positions: Array

    @cached_property
    def height(self) -> Array:
        """Heights (K,) of the centre of mass over the ground, m."""
        return np.asarray(-self._below[:, self.stance.points[2]].min(axis=1))

    @cached_property
    def sunk(self) -> Array:
        """How far (K,) something is below the ground, or nearer to it than what does not stand on it may be, m."""
        depth = (np.where(self.stance.points[3], 0.0, GAP) - self._heights).max(axis=1)
        return np.asarray(np.where(depth > ROUNDING, depth, 0.0))

    @cached_property
    def apart(self) -> Array:
        """Largest difference (K,) of the heights of any foot and the frame, m."""
        return np.asarray(np.abs((self._rotations @ self.stance.feet_weights.T).imag).max(axis=1))

    @cached_property
    def support(self) -> tuple[Array, Array]:
        """Rear and front end (K,) of what the foot stands on, m from the centre of mass."""
        weights, radii, stands, _ = self.stance.points
        places = (self._rotations @ weights[stands].T).real
        near = self._heights[:, stands] < NEAR * self.stance.size
        low = np.where(near, places - radii[stands], np.inf).min(axis=1)
        return low, np.where(near, places + radii[stands], -np.inf).max(axis=1)

    @cached_property
    def unsteady(self) -> Array:
        """How far (K,) from standing it is: a tipped sole, a low trunk, or weight far beyond the feet; else 0.

        In rad, or in the height of the centre of mass, at rest.
        """
        stance, size = self.stance, self.stance.size
        bent = (self.positions - stance.robot.resting) @ stance.foot_turns
        tilt = (self.orientations - stance.upright + bent + math.pi) % (2 * math.pi) - math.pi
        tipped = np.maximum(np.abs(tilt) - FLAT, 0.0) if stance.sole > SOLE else 0.0
        low, high = self.support
        others = self._rotations @ stance.feet_weights.T
        reach = others.real - others.real[:, :1]
        down = np.abs(others.imag) < NEAR * size
        low = low + np.where(down, reach, 0.0).min(axis=1)
        high = high + np.where(down, reach, 0.0).max(axis=1)
        beyond = np.maximum(np.maximum(low, -high) - max(stance.sole, FOOT * size), 0.0)
        trunk = np.maximum(TRUNK * size - self._heights[:, stance.trunk].min(axis=1, initial=np.inf), 0.0)
        return np.asarray(tipped + (beyond + trunk) / size)

    @cached_property
    def inertia(self) -> Array:
        """D (K, n+1) of (4), kg m^2."""
        return self.stance.dynamics.momentum_map(self.positions)

    def rates(self, com_velocities: Array, momenta: Array) -> tuple[Array, Array]:
        """Least rates with which the frame is at rest; ``com_velocities`` (K, 2) m/s, momenta (K,) kg m^2/s.

        Returned are the largest ``|rate| / limit`` (K,), infinite where no rates hold the frame at rest, and the rates
        of base and joints (K, n+1) rad/s: zeros there.
        """
        robot = self.stance.robot
        matrix = contact_matrices(robot, robot.frames[self.stance.frame], self.inertia, self._rotations)
        sizes, target = row_sizes(matrix), np.column_stack((momenta, -com_velocities))
        limits = np.concatenate(([np.inf], self.stance.limits))
        least = least_rates(matrix / sizes[:, :, None], target / sizes, limits)
        return least.ratio, np.nan_to_num(least.values)

    def depth(self, com_rises: Array, rates: Array) -> Array:
        """How far (K,) something soon would be below the ground, m, or how fast pressed into it, m/s; else 0.

        Parameters
        ----------
        com_rises : (K,) m/s, of the centre of mass: upwards at takeoff, downwards at landing, where time runs backwards
        rates : (K, n+1) rad/s, of base and joints there
        """
        tree = self.stance.robot.tree
        of_bodies = rates[:, :1] + rates[:, 1:] @ tree.turns.T
        rises = com_rises[:, None] + ((1j * tree.turn * of_bodies * self._rotations) @ self.stance.points[0].T).imag
        velocities = np.copysign(1.0, com_rises)[:, None] * rises
        lifted = np.where(self.stance.points[3], LIFTED, 0.0)
        soon = -(self._heights + velocities * SOON + lifted).min(axis=1)
        pressed = -np.where(self._heights < CLEARANCE, velocities, 0.0).min(axis=1)
        return np.asarray(np.maximum(np.maximum(soon, np.where(pressed > AT_REST, pressed, 0.0)), 0.0))

    @cached_property
    def _rotations(self) -> ComplexArray:
        tree = self.stance.robot.tree
        return tree.rotations(tree.absolute_angles(self.orientations, self.positions))

    @cached_property
    def _below(self) -> Array:
        """Heights (K, P) of the points' lowest sides over the centre of mass, m."""
        weights, radii, _, _ = self.stance.points
        return np.asarray((self._rotations @ weights.T).imag - radii)

    @cached_property
    def _heights(self) -> Array:
        """Heights (K, P) of the points over the ground, m."""
        return self._below + self.height[:, None]
