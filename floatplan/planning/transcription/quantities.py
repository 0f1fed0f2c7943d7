"""Quantities of a motion that limits and objectives are about, with their derivatives by x."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.dynamics import Partials
from floatplan.planning.transcription.trajectory import Trajectory
from floatplan.planning.transcription.variables import AtEnds

EVERYTHING: frozenset[AtEnds] = frozenset({"momentum", "velocities", "accelerations"})


@dataclass(frozen=True)
class Quantity:
    """A quantity (K, m) of a trajectory, and its derivatives (K, m, size) by x.

    ``depends_at_ends_on`` : on what, beside the posture, it depends at takeoff and landing.
    """

    values: Callable[[Trajectory], Array]
    jacobian: Callable[[Trajectory], Array]
    depends_at_ends_on: frozenset[AtEnds] = EVERYTHING


def _acceleration_jacobian(motion: Trajectory) -> Array:
    """Derivatives (K, n, size) of the joint accelerations by x."""
    count, n = motion.motion.accelerations.shape
    return motion.jacobian(Partials(by_acceleration=np.broadcast_to(np.eye(n), (count, n, n))))


QUANTITIES: dict[str, Quantity] = {
    "velocities": Quantity(lambda it: it.motion.velocities, lambda it: it.velocity_jacobian, frozenset({"velocities"})),
    "accelerations": Quantity(lambda it: it.motion.accelerations, _acceleration_jacobian, frozenset({"accelerations"})),
    "torques": Quantity(lambda it: it.torques, lambda it: it.torque_jacobian),
    "motor_torques": Quantity(lambda it: it.motor_torques, lambda it: it.motor_torque_jacobian),
    "orientation_rate": Quantity(
        lambda it: it.flown.rate, lambda it: it.base_rate_jacobian, frozenset({"velocities", "momentum"})
    ),
}
