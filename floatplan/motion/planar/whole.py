"""The whole robot in a flight in a plane, at any instant, by Pinocchio's full model."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.motion import quadrature
from floatplan.motion.dynamics import FlightState
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances
from floatplan.motion.planar.full_model import FlightCoordinates, FullMotion, PinocchioDynamics
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.pool import one_thread
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.problem import Problem


class PlanarMotion:
    """A motion of joints as written, with an angular momentum, kg m^2/s, and the base's, which follows."""

    def __init__(self, problem: Problem, joints: WrittenMotion, angular_momentum: float, path: Ballistics) -> None:
        self.problem = problem
        self.joints = joints
        self.angular_momentum = angular_momentum
        self.path = path
        self.dynamics = PinocchioDynamics(problem.robot)

    def state(self, instants: Array) -> FlightState:
        """State at times (N,) s within the flight."""
        robot = self.problem.robot
        positions, velocities, accelerations = self.joints.at(instants)
        momentum_map = self.dynamics.momentum_map(positions)
        joint_part = np.einsum("ki,ki->k", momentum_map[:, 1:], velocities)
        rate = (self.angular_momentum - joint_part) / momentum_map[:, 0]
        orientation = self.orientation(instants)
        forces = self.dynamics.full_forces(positions, velocities, accelerations, rate)
        com = self.path.positions(instants)
        angles = robot.tree.absolute_angles(orientation, positions)
        base = robot.tree.rotations(angles) @ robot.tree.point_weights(np.array([0]), np.array([0j]))[0]
        return FlightState(
            times=read_only(instants),
            orientation=read_only(orientation),
            orientation_rate=read_only(rate),
            positions=read_only(positions),
            velocities=read_only(velocities),
            accelerations=read_only(accelerations),
            torques=read_only(forces @ robot.selection),
            motor_torques=read_only(forces @ robot.transmission),
            com_position=read_only(com),
            com_velocity=read_only(self.path.velocities(instants)),
            base_position=read_only(com + np.stack((base.real, base.imag), axis=1)),
            angular_momentum=read_only(momentum_map[:, 0] * rate + joint_part),
        )

    def segments(self, instants: Array, hulls: bool = False) -> Segments:
        """The links' shapes at instants (N,); with the hulls for distances to the ground where asked for."""
        tree = self.problem.robot.tree
        com = self.path.positions(instants)
        angles = tree.absolute_angles(self.orientation(instants), self.joints.at(instants)[0])
        shapes = self._links_and_hulls if hulls else self._links
        return shapes.place(com[:, 0] + 1j * com[:, 1], angles)

    @cached_property
    def _links(self) -> LinkShapes:
        return LinkShapes(self.problem.robot.tree, self.problem.robot.shapes)

    @cached_property
    def _links_and_hulls(self) -> LinkShapes:
        return LinkShapes(self.problem.robot.tree, self.problem.robot.shapes, self.problem.ground_shapes)

    def heights(self, instants: Array) -> tuple[Array, tuple[str, ...]]:
        """Heights of shapes over the ground's line; of both ends of a shape, one after the other."""
        heights = obstacle_distances(self.segments(instants, hulls=True), self.problem.ground_plane, instants)
        return heights, 2 * tuple(shape.link for shape in self.problem.ground_shapes)

    def full_motion(self, state: FlightState) -> FullMotion:
        """Motion of every joint of the robot's file, and of the base in space, at the N instants of a state."""
        return FullMotion(self.problem.robot, FlightCoordinates(self.dynamics, state, self.path.gravity))

    def forces(self, state: FlightState) -> Array:
        """Forces (N, nv), N m, on all coordinates of the model at the N instants of a state."""
        return self.dynamics.full_forces(state.positions, state.velocities, state.accelerations, state.orientation_rate)

    def orientation(self, times: Array) -> Array:
        """Orientation (N,) rad at times (N,), by (18)."""
        rule, rates = self._orientation_rates
        integrals = rule.integrals(times / self.problem.flight.duration) @ rates
        return np.asarray(self.problem.initial.orientation + self.problem.flight.duration * integrals)

    @property
    def final_orientation(self) -> float:
        """Orientation at the end of the flight, rad."""
        rule, rates = self._orientation_rates
        return float(self.problem.initial.orientation + self.problem.flight.duration * (rule.weights @ rates))

    @property
    def orientation_at_ends(self) -> Mapping[str, Any]:
        """Orientations, rad, at the start, at the end and of the goal."""
        start = self.problem.initial.orientation
        goal = self.problem.final.orientation
        return {"start": start, "end": self.final_orientation, "goal": goal}

    @property
    def missed(self) -> float:
        """By how much the orientation at landing misses the goal, rad."""
        return abs(self.final_orientation - self.problem.final.orientation)

    @cached_property
    @one_thread
    def _orientation_rates(self) -> tuple[quadrature.GaussLegendre, Array]:
        """Quadrature with as many nodes as theta0' needs, and theta0' (N,) at them."""
        for count in quadrature.NODE_COUNTS:
            rule = quadrature.gauss_legendre(count)
            positions, velocities, _ = self.joints.at(rule.nodes * self.problem.flight.duration)
            rates = self.dynamics.base_rate(positions, velocities, self.angular_momentum)
            # A tail of the Legendre coefficients of theta0' that is 1e-14 of the largest rate is rounding.
            if rule.tail(rates) <= 1e-14 * max(float(np.abs(rates).max()), 1e-300):
                break
        return rule, rates
