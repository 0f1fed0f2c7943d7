"""Momentum of a robot with a free base in space, by Pinocchio, at many instants."""

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
    """Inertia and momentum about the centre of mass, with the base at the identity.

    The joints of ``model``, a ``pinocchio.Model`` on a free flyer whose joints have one coordinate each, are at
    ``reference + selection @ positions``, with ``reference`` (J,) and ``selection`` (J, n).
    """

    model: Any
    reference: Array
    selection: Array
    _workspace: Workspace = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_workspace", Workspace(self.model))

    def configurations(self, positions: Array) -> Array:
        """Configurations (K, 7 + J) of the model with its base at the identity, from planned positions (K, n)."""
        full = np.zeros((len(positions), self.model.nq))
        full[:, BASE] = 1.0
        full[:, BASE + 1 :] = self.reference + positions @ self.selection.T
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
        full = np.zeros((len(positions), model.nv))
        full[:, ANGULAR], full[:, BASE:] = rates, velocities @ self.selection.T
        none, slopes = np.zeros(model.nv), np.empty((len(positions), 3, model.nv - BASE))
        for k, (q, v) in enumerate(zip(self.configurations(positions), full, strict=True)):
            slopes[k] = pin.computeCentroidalDynamicsDerivatives(model, data, q, v, none)[0][ANGULAR, BASE:]
        return slopes @ self.selection
