"""Momentum, orientation rate and torques of the free-flying robot, by Pinocchio: what a plan reports.

The search uses the closed form of :mod:`floatplan.motion.planar.closed_form`, which is faster over many instants; a
plan's own numbers come from here, from the full rigid-body model, so that every plan is checked by the other. Nothing
here depends on gravity, on where the centre of mass is, or on the orientation: in free flight the orientation is
cyclic, and joint torques are those of a robot that floats. The paper's (15), (A.1) and (A.3) are meant as corrected.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.robot.robot import Robot


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
        self._generalized = np.concatenate((np.eye(len(robot.reference))[:, :BASE], robot.selection), axis=1)
        self.mass = float(robot.tree.mass.sum())

    def __reduce__(self) -> tuple[type[PinocchioDynamics], tuple[Robot]]:
        return PinocchioDynamics, (self.robot,)

    def full_positions(self, positions: Array) -> Array:
        """Configurations (N, nv) of the model, base at the origin, from planned positions (N, n)."""
        return np.asarray(self._reference + positions @ self._selection.T)

    def momentum_map(self, positions: Array) -> Array:
        """D of (4): rows (D_0, D_1, ..., D_n), (N, n+1) kg m^2, at positions (N, n)."""
        return self._momentum_map(self.full_positions(positions))

    def _momentum_map(self, full: Array) -> Array:
        model, data, row = self._model, self._workspace.data, self._row
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
        model, data = self._model, self._workspace.data
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
        generalized = self.generalized_forces(positions, velocities, accelerations, base_rate)
        return generalized[:, BASE:]

    def generalized_forces(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Forces on base and planned coordinates (N, 3+n); the first three vanish up to rounding."""
        return np.asarray(self.full_forces(positions, velocities, accelerations, base_rate) @ self._generalized)

    def full_forces(self, positions: Array, velocities: Array, accelerations: Array, base_rate: Array) -> Array:
        """Forces (N, nv) on all coordinates, by RNEA; those of the base vanish up to rounding.

        A joint's is its own torque, N m (force, N, where it slides), also where several are coupled or it is locked.
        """
        model, data = self._model, self._workspace.data
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
