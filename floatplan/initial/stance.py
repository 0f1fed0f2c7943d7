"""How a robot stands at one end of a flight: on a frame at rest, with nothing else in the ground or going into it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, ComplexArray
from floatplan.motion.planar.ballistics import frame_weights
from floatplan.motion.planar.contact import STILL
from floatplan.motion.planar.contact_rates import ContactRates, equations_at, rates_at
from floatplan.problem.ground import contact_shapes
from floatplan.robot.robot import Robot

BoolArray: TypeAlias = npt.NDArray[np.bool_]

FAST = math.radians(2000)  # [rad/s] that no joint of a legged robot turns at, whatever its URDF says
SOON = 0.03  # [s] after takeoff, or before landing, when everything still has to be above the ground
ROUNDING = 1e-9  # [m]
GAP = 0.002  # [m] between the ground and what does not stand on it


@dataclass(frozen=True, eq=False)
class Stance:
    """A robot on the frame that leaves or meets the ground."""

    robot: Robot
    frame: str

    @cached_property
    def limits(self) -> Array:
        """Velocity limits (n,) rad/s of the planned joints: the URDF's, where that has sensible ones."""
        fast = FAST / np.abs(self.robot.motor_ratios).max(axis=0)
        return np.asarray(np.minimum(self.robot.velocity_limits, fast))

    @cached_property
    def _points(self) -> tuple[ComplexArray, Array, BoolArray, BoolArray]:
        """Weights (P, m) of the ends of all shapes, radii (P,), m; which stand, and which are on a foot's body."""
        robot, frame = self.robot, self.robot.frames[self.frame]
        standing = {id(shape) for shape in contact_shapes(robot, frame.link)}
        if not standing:
            return frame_weights(robot, frame)[None], np.zeros(1), np.ones(1, dtype=bool), np.ones(1, dtype=bool)
        turns = robot.tree.turns
        ends = [(shape, end) for shape in robot.shapes for end in (shape.start, shape.end)]
        bodies, local = (np.array(column) for column in zip(*((shape.body, end) for shape, end in ends), strict=True))
        feet = (turns[bodies] == turns[frame.body]).all(axis=1)
        stands = np.array([id(shape) in standing for shape, _ in ends])
        return robot.tree.point_weights(bodies, local), np.array([shape.radius for shape, _ in ends]), stands, feet

    def height(self, orientation: float, positions: Array) -> float:
        """Height of the centre of mass over the ground, m."""
        weights, radii, stands, _ = self._points
        heights = (weights[stands] @ self._rotations(orientation, positions)).imag - radii[stands]
        return -float(heights.min())

    def rates(self, orientation: float, positions: Array, com_velocity: Array, momentum: float) -> ContactRates:
        """Least rates with which the frame is at rest; ``com_velocity`` (2,) m/s, momentum kg m^2/s."""
        equations = equations_at(self.robot, self.robot.frames[self.frame], orientation, positions, com_velocity)
        return rates_at(self.robot, equations, self.limits, momentum)

    def depth(self, orientation: float, positions: Array, com_rise: float, found: ContactRates) -> float:
        """How far something soon would be below the ground, m, or how fast pressed into it, m/s; else 0.

        Parameters
        ----------
        com_rise : m/s, of the centre of mass: upwards at takeoff, downwards at landing, where time runs backwards
        found : the rates there
        """
        weights, _, _, _ = self._points
        tree = self.robot.tree
        rotations = self._rotations(orientation, positions)
        heights = self._heights(rotations)
        rates = found.orientation_rate + tree.turns @ found.rates
        rises = com_rise + (weights @ (1j * tree.turn * rates * rotations)).imag
        velocities = math.copysign(1.0, com_rise) * rises
        soon = -float((heights + velocities * SOON).min())
        pressed = -float(velocities[heights < GAP].min(initial=0.0))
        return max(soon, pressed if pressed > STILL else 0.0, 0.0)

    def sunk(self, orientation: float, positions: Array) -> float:
        """How far something is below the ground, or nearer to it than what does not stand on it may be, m."""
        heights = self._heights(self._rotations(orientation, positions))
        depth = float((np.where(self._points[3], 0.0, GAP) - heights).max())
        return depth if depth > ROUNDING else 0.0

    def _heights(self, rotations: ComplexArray) -> Array:
        """Heights (P,) of the points over the ground, m."""
        weights, radii, stands, _ = self._points
        heights = (weights @ rotations).imag - radii
        return np.asarray(heights - heights[stands].min())

    def _rotations(self, orientation: float, positions: Array) -> ComplexArray:
        tree = self.robot.tree
        return tree.rotations(tree.absolute_angles(np.array(orientation), positions))
