"""Momentum and torques of a robot with a free base in space, by Pinocchio, at many instants.

Nothing here depends on gravity, on where the robot is, or on its attitude: the base is at the identity, its origin at
rest for an instant, and velocities and accelerations are in its own axes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.motion.planar.full_model import Workspace

BASE = 6  # velocities of the free flyer; its configuration has one number more
ANGULAR = slice(3, 6)  # rows of a spatial momentum, and velocities of the free flyer, that turn


@dataclass(frozen=True, eq=False)
class SpatialDynamics:
    """Momentum about the centre of mass, and torques, at K instants.

    The joints of ``model``, a ``pinocchio.Model`` on a free flyer whose joints have one coordinate each, are at
    ``reference + selection @ positions``, with ``reference`` (J,) and ``selection`` (J, n).
    """

    model: Any
    reference: Array
    selection: Array
    _workspace: Workspace = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_workspace", Workspace(self.model))

    @property
    def data(self) -> Any:
        """Pinocchio's data of the model, of this thread."""
        return self._workspace.data

    def __reduce__(self) -> tuple[type[SpatialDynamics], tuple[Any, Array, Array]]:
        return SpatialDynamics, (self.model, self.reference, self.selection)

    def configurations(self, positions: Array) -> Array:
        """Configurations (K, 7 + J) of the model with its base at the identity, from planned positions (K, n)."""
        full = np.zeros((len(positions), self.model.nq))
        full[:, BASE] = 1.0
        full[:, BASE + 1 :] = self.reference + positions @ self.selection.T
        return full

    def full_velocities(self, velocities: Array, rates: Array) -> Array:
        """Velocities (K, 6 + J) from planned ones (K, n) and the base's rates (K, 3), its origin at rest."""
        full = np.zeros((len(velocities), self.model.nv))
        full[:, ANGULAR], full[:, BASE:] = rates, velocities @ self.selection.T
        return full

    def momentum_maps(self, positions: Array) -> tuple[Array, Array]:
        """I (K, 3, 3) and A (K, 3, n), kg m^2: angular momentum by the base's and by the joints' rates."""
        model, data = self.model, self._workspace.data
        maps = np.empty((len(positions), 3, model.nv))
        for k, q in enumerate(self.configurations(positions)):
            maps[k] = pin.computeCentroidalMap(model, data, q)[ANGULAR]
        return maps[..., ANGULAR], maps[..., BASE:] @ self.selection

    def momentum_slopes(self, positions: Array, velocities: Array, rates: Array) -> Array:
        """L (K, 3, n): derivatives of ``I omega + A q'`` by the planned positions, at rates omega (K, 3)."""
        model, data = self.model, self._workspace.data
        none, slopes = np.zeros(model.nv), np.empty((len(positions), 3, model.nv - BASE))
        full = self.full_velocities(velocities, rates)
        for k, q in enumerate(self.configurations(positions)):
            slopes[k] = pin.computeCentroidalDynamicsDerivatives(model, data, q, full[k], none)[0][ANGULAR, BASE:]
        return slopes @ self.selection

    def full_accelerations(self, positions: Array, velocities: Array, accelerations: Array, rates: Array) -> Array:
        """Accelerations (K, 6 + J) in free flight but for gravity: the base's are those of no wrench on it."""
        model, data = self.model, self._workspace.data
        full = np.zeros((len(positions), model.nv))
        full[:, BASE:] = accelerations @ self.selection.T
        moving = self.full_velocities(velocities, rates)
        for k, q in enumerate(self.configurations(positions)):
            wrench = pin.rnea(model, data, q, moving[k], full[k])[:BASE]
            full[k, :BASE] = np.linalg.solve(pin.crba(model, data, q)[:BASE, :BASE], -wrench)
        return full

    def torques(self, positions: Array, velocities: Array, accelerations: Array, rates: Array) -> Array:
        """Each joint's own torque (K, J), N m (force, N, where it slides), in free flight."""
        model, data = self.model, self._workspace.data
        full = self.full_accelerations(positions, velocities, accelerations, rates)
        moving, forces = self.full_velocities(velocities, rates), np.empty((len(positions), model.nv - BASE))
        for k, q in enumerate(self.configurations(positions)):
            forces[k] = pin.rnea(model, data, q, moving[k], full[k])[BASE:]
        return forces

    def torque_slopes(
        self, positions: Array, velocities: Array, accelerations: Array, rates: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Derivatives of :meth:`torques` by the planned positions, velocities, accelerations, and by the base's rates.

        (K, J, n) three times, and (K, J, 3).
        """
        model, data = self.model, self._workspace.data
        full = self.full_accelerations(positions, velocities, accelerations, rates)
        moving, joints = self.full_velocities(velocities, rates), model.nv - BASE
        by_all = np.empty((len(positions), joints, 3 * joints + 3))
        for k, q in enumerate(self.configurations(positions)):
            by_q, by_v, by_a = pin.computeRNEADerivatives(model, data, q, moving[k], full[k])
            by_a = np.triu(by_a) + np.triu(by_a, 1).T
            columns = np.concatenate((by_q[:, BASE:], by_v[:, BASE:], by_a[:, BASE:], by_v[:, ANGULAR]), axis=1)
            followed = np.linalg.solve(by_a[:BASE, :BASE], columns[:BASE])
            by_all[k] = columns[BASE:] - by_a[BASE:, :BASE] @ followed
        by_q, by_v, by_a = (by_all[..., d * joints : (d + 1) * joints] @ self.selection for d in range(3))
        return by_q, by_v, by_a, by_all[..., 3 * joints :]
