"""The motion of a plan file in space: its attitude by its own equation, by a Runge-Kutta method of order 8.

Also how any recorded flight begins, in a plane or in space: as planned, or with what goes wrong at takeoff.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from floatplan.arrays import Array
from floatplan.errors import FloatplanError, InputError
from floatplan.plans.record import PlanRecord
from floatplan.simulation.integration import MOST_EVALUATIONS, TIGHT
from floatplan.simulation.perturbation import Sample
from floatplan.simulation.plan_motion import PlanarPlanMotion, PlanFileMotion
from floatplan.simulation.reduced_model import ReducedModel


class SpatialPlanMotion(PlanFileMotion):
    """The motion of a record in space; of m joints, its configurations are (7 + m,), its velocities (6 + m,)."""

    position_entries = slice(0, 3)
    attitude_entries = slice(3, 7)

    @property
    def start_attitude(self) -> Array:
        """The quaternion at takeoff."""
        return np.array(self.record.orientation["start"]["quaternion_xyzw"])

    def in_base_axes(self, attitude: Array, vector: Any) -> Any:
        """A vector (3,) of the world in the base's own axes."""
        return rotation_matrix(attitude).T @ vector

    def momentum_in_base(self, time: float) -> Any:
        """The record's h at a time, s."""
        return self.in_base_axes(self.attitude(time), self.record.angular_momentum)

    def attitudes(self, angular_momentum: Array, tolerance: float = TIGHT) -> Callable[[float], Array]:
        """The quaternion as a function of time, s, for an angular momentum (3,) in the world.

        A step is off by about ``tolerance``, rad.
        """
        evaluations = count()

        def rate(time: float, quaternion: Array) -> Array:
            if next(evaluations) == MOST_EVALUATIONS:
                raise FloatplanError("the motion's attitude could not be integrated: it turns too fast")
            momentum = self.in_base_axes(quaternion, angular_momentum)
            return quaternion_rate(quaternion, self.base_velocity(self.joints(time), momentum)[0][3:])

        result = solve_ivp(
            rate,
            (0.0, self.record.duration),
            self.start_attitude,
            method="DOP853",
            rtol=tolerance,
            atol=tolerance / 10,
            dense_output=True,
        )
        if result.status != 0:
            raise FloatplanError(f"the motion's attitude could not be integrated: {result.message}")
        assert result.sol is not None  # as dense_output says
        attitude: Callable[[float], Array] = result.sol
        return attitude

    @cached_property
    def attitude(self) -> Callable[[float], Array]:
        """As :meth:`attitudes`, for the record's h; InputError where it ends elsewhere than the record states."""
        attitude = self.attitudes(np.asarray(self.record.angular_momentum))
        off = angle_between(attitude(self.record.duration), self.record.orientation["end"]["quaternion_xyzw"])
        if off > 1e-6:  # rad
            raise InputError(f"is {off:.3g} rad beside where the motion ends", element="orientation.end")
        return attitude

    def off_goal(self, landed: Array) -> float:
        """By how much a configuration misses the goal's attitude, rad."""
        return angle_between(landed[self.attitude_entries], self.record.orientation["goal"]["quaternion_xyzw"])

    def off_path(self, times: Array, configurations: Array) -> tuple[Array, float]:
        """By how much (N,) configurations miss the path's attitude at times (N,), rad, and its sensitivity to h."""
        off = []
        for time, q in zip(times.tolist(), configurations, strict=True):
            off.append(angle_between(q[self.attitude_entries], self.attitude(time)))
        return np.array(off), self.sensitivity()

    def sensitivity(self) -> float:
        """By how much the attitude at landing rotates with h along itself, 1/(kg m^2): radians per kg m^2/s."""
        h = np.asarray(self.record.angular_momentum)
        size = float(np.linalg.norm(h))
        change = 1e-6 * (h if size else np.array([1.0, 0.0, 0.0]))  # of the difference
        landed = rotation_matrix(self.attitudes(h + change)(self.record.duration))
        rotation = pin.log3(landed @ rotation_matrix(self.attitude(self.record.duration)).T)
        return float(np.linalg.norm(rotation) / np.linalg.norm(change))


def plan_file_motion(record: PlanRecord, reduced: ReducedModel) -> PlanFileMotion:
    """Return the motion of a record, in a plane or in space."""
    return SpatialPlanMotion(record, reduced) if record.in_space else PlanarPlanMotion(record, reduced)


def perturbed_takeoff(record: PlanRecord, reduced: ReducedModel, sample: Sample) -> tuple[Array, Array]:
    """The plan's configuration at takeoff, and the perturbed robot's velocity there.

    It has the plan's angular momentum and the velocity of its centre of mass, times the sample's factors. Its centre of
    mass is not quite where the plan's is.
    """
    positions, _ = plan_file_motion(record, reduced).takeoff(record.angular_momentum)
    real = plan_file_motion(record, replace(reduced, model=sample.perturbed(reduced.model)))
    _, velocities = real.takeoff(record.angular_momentum * sample.momentum, sample.rise)
    return positions, velocities


def angle_between(quaternion: Array, other: Any) -> float:
    """Angle between two attitudes, rad, as quaternions x, y, z, w."""
    return float(np.linalg.norm(pin.log3(rotation_matrix(quaternion).T @ rotation_matrix(np.asarray(other)))))


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion x, y, z, w of any length."""
    return np.asarray(pin.Quaternion(quaternion / np.linalg.norm(quaternion)).matrix())


def quaternion_rate(quaternion: Array, omega: Array) -> Array:
    """Derivative (4,) of a quaternion x, y, z, w by time, for an angular velocity (3,) in the body's axes."""
    vector = quaternion[:3]
    scalar = quaternion[3]
    return np.append(scalar * omega + np.cross(vector, omega), -vector @ omega) / 2
