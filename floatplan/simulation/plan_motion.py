"""The motion that a plan file states, and the torques that it takes, by Pinocchio's inverse dynamics.

Nothing is shared with the planner: joints from the coefficients by (12), the base's rate from the joint-space inertia
matrix, torques from RNEA. In flight the torques do not depend on gravity, on the orientation or on where the robot is,
so all of this is computed with a centre of mass that does not move, the base at the origin and without gravity.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import flint
import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.plans.record import PlanRecord
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.reduced_model import ReducedModel


@dataclass(frozen=True, eq=False)
class ModelState:
    """Coordinates (nq,) of the reduced model at one instant and two rates (nv,), the base's first."""

    positions: Array
    velocities: Array
    accelerations: Array


class PlanFileMotion(ABC):
    """The motion of a record, evaluated at any time; has Pinocchio's scratch data, so use one per thread."""

    position_entries: ClassVar[slice]  # of a configuration: where the base is
    attitude_entries: ClassVar[slice]  # and its attitude

    def __init__(self, record: PlanRecord, reduced: ReducedModel) -> None:
        self.record = record
        self.reduced = reduced
        self._model = reduced.model.copy()
        self._model.gravity = pin.Motion.Zero()
        self._data = self._model.createData()
        self._position_selection = np.zeros((reduced.model.nq, reduced.selection.shape[1]))
        self._position_selection[reduced.of_joints[0]] = reduced.joint_selection
        self._below = np.tril_indices(reduced.of_joints[1].start, -1)
        self._middle = 0.5 * record.duration
        p = _recentred(record.coefficients, self._middle)
        self._exponents = np.arange(len(p))
        self._polynomials = np.concatenate((p, _derivative(p), _derivative(_derivative(p))), axis=1)

    @property
    @abstractmethod
    def start_attitude(self) -> Array:
        """The base's attitude at takeoff, as configurations have it."""

    @abstractmethod
    def in_base_axes(self, attitude: Array, vector: Any) -> Any:
        """A vector of the world in the axes that the base's velocities have at an attitude."""

    @abstractmethod
    def momentum_in_base(self, time: float) -> Any:
        """The record's angular momentum at a time, s, in those axes."""

    @abstractmethod
    def off_goal(self, landed: Array) -> float:
        """By how much a configuration misses the goal's attitude, rad."""

    @abstractmethod
    def off_path(self, times: Array, configurations: Array) -> tuple[Array, float]:
        """By how much (N,) configurations miss the path's attitude at times (N,), rad, and its sensitivity to h."""

    def planned(self, time: float) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations (n,) of the planned joints at a time, s: (12) and its derivatives."""
        p, rate, curvature = ((time - self._middle) ** self._exponents @ self._polynomials).reshape(3, -1)
        sine = self.record.amplitude * np.sin(p)
        cosine = self.record.amplitude * np.cos(p)
        return self.record.centre + sine, cosine * rate, cosine * curvature - sine * rate**2

    def joints(self, time: float) -> ModelState:
        """All joints at a time, s; the base where the reference has it, without velocity."""
        planned, rates, curvatures = self.planned(time)
        selection = self.reduced.selection
        positions = self.reduced.reference + self._position_selection @ planned
        return ModelState(positions, selection @ rates, selection @ curvatures)

    def base_velocity(self, state: ModelState, angular_momentum: Any) -> tuple[Array, Array, Array]:
        """Velocity of the base with no momentum but this angular one, in the base's axes.

        Also of the inertia matrix's first rows, which are those of the momenta: the inverse of the base's block, and
        that of the joints.
        """
        of_joints = self.reduced.of_joints[1]
        rows = pin.crba(self._model, self._data, state.positions)[: of_joints.start]
        base = rows[:, : of_joints.start].copy()
        base[self._below] = base.T[self._below]  # what is below the diagonal is not set
        inverse = np.linalg.inv(base)
        coupling = rows[:, of_joints]
        momentum = np.zeros(of_joints.start)
        momentum[self.position_entries.stop :] = angular_momentum
        return inverse @ (momentum - coupling @ state.velocities[of_joints]), inverse, coupling

    def torques(self, time: float) -> Array:
        """Torques (m,) of all joints, coupled ones each with their own, N m.

        The base accelerates as the momenta's constancy demands: no wrench is on it.
        """
        state = self.joints(time)
        velocity, inverse, coupling = self.base_velocity(state, self.momentum_in_base(time))
        base = len(velocity)
        state.velocities[:base] = velocity
        forces = pin.rnea(self._model, self._data, state.positions, state.velocities, state.accelerations)
        return np.asarray(forces[base:] - coupling.T @ (inverse @ forces[:base]))

    def takeoff(self, angular_momentum: Any, rise: float = 1.0) -> tuple[Array, Array]:
        """Configuration and velocity at time zero; ``rise`` is a factor of the planned vertical velocity."""
        state = self.joints(0.0)
        velocity = np.array(self.record.com["velocity0"])
        velocity[-1] *= rise
        attitude = self.start_attitude
        state.positions[self.attitude_entries] = attitude
        base = self.base_velocity(state, self.in_base_axes(attitude, angular_momentum))[0]
        state.velocities[: len(base)] = base
        state.velocities[self.position_entries] += self.in_base_axes(attitude, velocity)
        com = self.reduced.axes @ pin.centerOfMass(self._model, self._data, state.positions)
        state.positions[self.position_entries] = np.asarray(self.record.com["position0"]) - com
        return state.positions, state.velocities

    def com_position(self, time: float) -> Array:
        """Where the centre of mass (2,), (3,) in space, is on its parabola, m."""
        com = self.record.com
        position: Array = np.asarray(com["position0"]) + time * np.asarray(com["velocity0"])
        position[-1] -= 0.5 * com["gravity"] * time**2
        return position


class PlanarPlanMotion(PlanFileMotion):
    """The motion of a record in a plane; configurations and velocities are (3 + m,), in the world's axes."""

    position_entries = slice(0, BASE_COORDINATES - 1)
    attitude_entries = slice(BASE_COORDINATES - 1, BASE_COORDINATES)

    @property
    def start_attitude(self) -> Array:
        """Orientation (1,) at takeoff, rad."""
        return np.array([self.record.orientation["start"]])

    def in_base_axes(self, attitude: Array, vector: Any) -> Any:
        """The same: they are the world's."""
        return vector

    def momentum_in_base(self, time: float) -> Any:
        """The record's h at any time."""
        return self.record.angular_momentum

    def off_goal(self, landed: Array) -> float:
        """Distance of the orientation of a configuration from the goal's, whole turns included, rad."""
        return abs(float(landed[BASE_COORDINATES - 1]) - float(self.record.orientation["goal"]))

    def off_path(self, times: Array, configurations: Array) -> tuple[Array, float]:
        """By how much (N,) configurations miss the path's orientation at times (N,), rad, and its sensitivity to h."""
        orientation, sensitivity = self.orientation(times)
        return np.abs(configurations[:, BASE_COORDINATES - 1] - orientation), sensitivity

    def orientation(self, times: Array) -> tuple[Array, float]:
        """Orientations (N,) at rising times (N,), and d orientation / d h at the last, by quadrature of (15).

        With the joints on their paths, the orientation rate is ``(h - sum_i D_i q_i') / D_0``: its derivative by h is
        ``1 / D_0``, and so is, integrated, that of the orientation (its variational equation has no other term).
        """
        # As many nodes integrate to rounding between two times, whatever the plan's motion.
        nodes, weights = np.polynomial.legendre.leggauss(96)
        angle = BASE_COORDINATES - 1
        orientation = float(self.record.orientation["start"])
        sensitivity = 0.0
        begin = 0.0
        orientations = []
        for time in times.tolist():
            half = (time - begin) / 2
            for node, weight in zip(nodes, weights, strict=True):
                state = self.joints(begin + half * (1 + node))
                velocity, inverse, _ = self.base_velocity(state, self.record.angular_momentum)
                orientation += half * weight * velocity[angle]
                sensitivity += half * weight * inverse[angle, angle]
            begin = time
            orientations.append(orientation)
        return np.array(orientations), float(sensitivity)


def _derivative(powers: Array) -> Array:
    """Coefficients (k + 1, n) of the derivative, powers of t in rows."""
    derived = np.zeros_like(powers)
    derived[:-1] = powers[1:] * np.arange(1, len(powers))[:, None]
    return derived


def _recentred(coefficients: Array, middle: float) -> Array:
    """Powers (k+1, n) of ``t - middle`` from those of t (n, k+1): far fewer digits cancel in their sums."""
    shift = flint.fmpq_poly([_fraction(middle), 1])
    powers = np.zeros(coefficients.shape[::-1])
    for joint, row in enumerate(coefficients.tolist()):
        shifted = flint.fmpq_poly(list(map(_fraction, row)))(shift)
        for power, value in enumerate(shifted.coeffs()):
            powers[power, joint] = int(value.p) / int(value.q)
    return powers


def _fraction(value: float) -> Any:
    return flint.fmpq(*value.as_integer_ratio())
