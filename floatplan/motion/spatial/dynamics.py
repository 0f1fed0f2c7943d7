"""Momentum and torques of a robot with a free base in space, by the kernel, at many instants.

Nothing here depends on gravity, on where the robot is, or on its attitude: the base is at the identity, its origin at
rest for an instant, and velocities and accelerations are in its own axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles, integers, layout
from floatplan.motion.planar.full_model import Workspace
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import FREE_FLYER


@dataclass(frozen=True, eq=False)
class SpatialDynamics:
    """Momentum about the centre of mass, and torques, at K instants.

    The joints of ``model``, a ``pinocchio.Model`` on a free flyer whose joints have one coordinate each, are at
    ``reference + selection @ positions``, with ``reference`` (J,) and ``selection`` (J, n).
    """

    model: Any
    reference: Array
    selection: Array

    @cached_property
    def _workspace(self) -> Workspace:
        return Workspace(self.model)

    @property
    def data(self) -> Any:
        """Pinocchio's data of the model, of this thread."""
        return self._workspace.data

    def __reduce__(self) -> tuple[type[SpatialDynamics], tuple[Any, Array, Array]]:
        return SpatialDynamics, (self.model, self.reference, self.selection)

    @cached_property
    def tree(self) -> Struct:
        """The bodies as the kernel sees them."""
        model = self.model
        data = self.model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        moved = range(2, model.njoints)
        motions = [np.ravel(data.joints[joint].S) for joint in moved]
        slides = [bool(motion[:3].any()) for motion in motions]
        bodies = [model.inertias[joint] for joint in range(1, model.njoints)]
        placed = [model.jointPlacements[joint] for joint in moved]
        axes = [motion[:3] if slide else motion[3:] for slide, motion in zip(slides, motions, strict=True)]
        seconds = []  # sums (3, 3) of m x x^T over each body's masses, kg m^2
        for body in bodies:
            about_center = np.eye(3) * np.trace(body.inertia) / 2 - body.inertia
            seconds.append(about_center + body.mass * np.outer(body.lever, body.lever))
        return Struct(
            "SpatialTree",
            joints=len(slides),
            parent=integers([model.parents[joint] - 1 for joint in moved]),
            slides=integers(slides),
            axis=doubles(axes),
            turned=doubles([frame.rotation for frame in placed]),
            placed=doubles([frame.translation for frame in placed]),
            mass=doubles([body.mass for body in bodies]),
            first=doubles([body.mass * body.lever for body in bodies]),
            second=doubles(seconds),
            armature=doubles(model.armature[FREE_FLYER:]),
        )

    def configurations(self, positions: Array) -> Array:
        """Configurations (K, 7 + J) of the model with its base at the identity, from planned positions (K, n)."""
        full = np.zeros((len(positions), self.model.nq))
        full[:, FREE_FLYER] = 1.0
        full[:, FREE_FLYER + 1 :] = self.reference + positions @ self.selection.T
        return full

    def full_velocities(self, velocities: Array, rates: Array) -> Array:
        """Velocities (K, 6 + J) from planned ones (K, n) and the base's rates (K, 3), its origin at rest."""
        full = np.zeros((len(velocities), self.model.nv))
        full[:, 3:FREE_FLYER] = rates
        full[:, FREE_FLYER:] = velocities @ self.selection.T
        return full

    def computed(self, *state: Array, **shapes: tuple[int, ...]) -> dict[str, Array]:
        """What the kernel writes, by names of ``SpatialMotion`` and shapes of one instant.

        The state is planned positions, velocities and accelerations, (K, n) each, and the base's rates (K, 3).
        """
        count = len(state[0])
        results = {name: np.empty((count, *shape)) for name, shape in shapes.items()}
        names = ("positions", "velocities", "accelerations")
        motions = dict(zip(names, (values @ self.selection.T for values in state[:3]), strict=False))
        motions["positions"] = motions["positions"] + self.reference
        inputs = {**motions, "rates": state[3]} if len(state) > 3 else motions
        arrays = {name: doubles(values) for name, values in inputs.items()}
        moved = Struct(
            "SpatialMotion", instants=count, **(dict.fromkeys(layout("SpatialMotion").arrays) | arrays | results)
        )
        compiled = kernel()
        if compiled.space(self.tree.pointer, moved.pointer, compiled.instructions):
            raise MemoryError
        return results

    def momentum_maps(self, positions: Array) -> tuple[Array, Array]:
        """I (K, 3, 3) and A (K, 3, n), kg m^2: angular momentum by the base's and by the joints' rates."""
        still = np.zeros_like(positions)
        joints = len(self.selection)
        results = self.computed(positions, still, inertia=(3, 3), joint_map=(3, joints))
        return results["inertia"], results["joint_map"] @ self.selection

    def _free(self, *state: Array) -> dict[str, Array]:
        return self.computed(*state, torques=(len(self.selection),), base_acceleration=(FREE_FLYER,))

    def torques(self, positions: Array, velocities: Array, accelerations: Array, rates: Array) -> Array:
        """Each joint's own torque (K, J), N m (force, N, where it slides), in free flight."""
        return self._free(positions, velocities, accelerations, rates)["torques"]

    def base_accelerations(self, positions: Array, velocities: Array, accelerations: Array, rates: Array) -> Array:
        """Spatial accelerations (K, 6) of the base in free flight but for gravity: those of no wrench on it."""
        return self._free(positions, velocities, accelerations, rates)["base_acceleration"]


@lru_cache(maxsize=16)
def spatial_dynamics(robot: Robot) -> SpatialDynamics:
    """Return a robot's dynamics, prepared once."""
    return SpatialDynamics(robot.model, robot.reference[FREE_FLYER + 1 :], robot.selection[FREE_FLYER:])
