"""Joint torques of a flight: those of the plan, as strong as the motors are, and feedback that tracks its path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.recorded_motion import RecordedMotion
from floatplan.simulation.reduced_model import ReducedModel

FASTEST = 1e4  # [rad/s] bandwidth of feedback


@dataclass(frozen=True, eq=False)
class Feedback:
    """Joint torques that pull the joints to their paths: ``stiffness (q_d - q) + damping (q_d' - q')``, (m,) each."""

    stiffness: Array
    damping: Array

    @classmethod
    def critically_damped(cls, bandwidth: float, inertia: Array) -> Feedback:
        """Gains for a bandwidth, rad/s, from the inertia (m,) that each joint turns, kg m^2."""
        return cls(read_only(bandwidth**2 * inertia), read_only(2.0 * bandwidth * inertia))

    def torques(self, position_error: Array, velocity_error: Array) -> Array:
        """Torques (m,), N m."""
        return np.asarray(self.stiffness * position_error + self.damping * velocity_error)


def feedback_of(reduced: ReducedModel, posture: Array, bandwidth: float) -> Feedback:
    """Return critically damped gains for a bandwidth, rad/s, from the inertia that each joint turns at a posture.

    That inertia is ``1 / (M^-1)_jj``: what a torque on the joint alone feels while the robot floats.
    """
    inverse = pin.computeMinverse(reduced.model, reduced.model.createData(), np.asarray(posture))
    return Feedback.critically_damped(bandwidth, 1.0 / np.diagonal(inverse)[BASE_COORDINATES:])


class JointTorques:
    """Torques (m,) by time, s, and the joints' positions and velocities (m,): the plan's, and feedback's.

    ``factors`` (m,) say how strong each motor is; without feedback the torques are open loop.
    """

    def __init__(self, motion: RecordedMotion, factors: Array, feedback: Feedback | None) -> None:
        self.factors, self.feedback = factors, feedback
        # a Runge-Kutta method evaluates some instants twice
        self._planned = lru_cache(maxsize=4)(motion.torques)
        self._target = lru_cache(maxsize=4)(motion.joints)

    def __call__(self, time: float, positions: Array, velocities: Array) -> Array:
        """Torques (m,), N m."""
        torques = self._planned(time)
        if self.feedback is not None:
            target = self._target(time)
            torques = torques + self.feedback.torques(
                target.positions[BASE_COORDINATES:] - positions, target.velocities[BASE_COORDINATES:] - velocities
            )
        return np.asarray(self.factors * torques)
