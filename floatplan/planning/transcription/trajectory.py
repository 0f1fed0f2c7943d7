"""The motion of the whole robot at chosen instants, and its derivatives by the decision variables of the search.

How much a search has done is measured here without a clock, the same on every machine, busy or quiet. Where answers are
compared or repeated, a search must end at the same place each time; processor time is no such measure, but the instants
evaluated are, and they cost nearly all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import cast

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.motion.dynamics import BaseMotion, DifferentiableMotion, FlightDynamics, FlightGrid, Partials
from floatplan.motion.flight import flight_dynamics
from floatplan.motion.sine_polynomial import Form, JointMotion, basis
from floatplan.planning.transcription.variables import AtEnds, DecisionVariables
from floatplan.problem.problem import Problem

CUBED = 0.012  # [instants of one body] of a quadratic program, times the cube of the number of its variables
CHANGE = (0.045, 0.0027)  # [instants of one body] of a row's change, times variables squared; times variables and rows
ITERATED = 0.12  # [instants of one body] of an iteration of ProxQP, times the square of variables and rows together


@dataclass(frozen=True, eq=False)
class Sampling:
    """The K instants at which a motion is looked at, first the N nodes, and the ``values`` of a form's basis there."""

    grid: FlightGrid
    form: Form
    values: tuple[Array, Array, Array]

    @property
    def given(self) -> int:
        """Number g of columns of the basis that belong to given conditions."""
        return len(self.form.given)


@lru_cache(maxsize=64)
def sample_nodes(grid: FlightGrid, form: Form) -> Sampling:
    """Sample at the instants of a grid."""
    return Sampling(grid, form, basis(form).values(grid.s))


def sample_also(sampling: Sampling, extra: Array) -> Sampling:
    """Add ``extra`` instants of [0, 1] to a sampling."""
    value, rate, curvature = map(np.concatenate, zip(sampling.values, basis(sampling.form).values(extra), strict=True))
    return Sampling(sampling.grid.also(extra), sampling.form, (value, rate, curvature))


@lru_cache(maxsize=64)
def sample_ends(sampling: Sampling) -> Sampling:
    """Add takeoff and landing to a sampling."""
    return sample_also(sampling, np.array([0.0, 1.0]))


@dataclass(eq=False)
class FlightModel:
    """What a problem fixes of every motion, and the ``work`` done with it: evaluations of one body at one instant."""

    flight: FlightDynamics
    work: float = 0.0

    def evaluated(self, instants: int) -> None:
        """Count the evaluation of a motion at so many instants."""
        self.work += EXCHANGE.evaluation + instants * self.flight.bodies

    def differentiated(self, entries: int) -> None:
        """Count a Jacobian."""
        self.work += EXCHANGE.differentiation + EXCHANGE.entry * entries

    def solved(self, variables: int, rows: int, changes: int) -> None:
        """Count a quadratic program by the changes of its active rows."""
        self.work += variables * (CUBED * variables**2 + changes * (CHANGE[0] * variables + CHANGE[1] * rows))

    def iterated(self, numbers: int, iterations: int) -> None:
        """Count iterations of ProxQP, by variables and rows together."""
        self.work += ITERATED * iterations * numbers**2

    def nodes(self, level: int, form: Form) -> Sampling:
        """Sample at the nodes of a level, for motions of a form."""
        return sample_nodes(self.flight.grid(level), form)


def flight_model(problem: Problem) -> FlightModel:
    """Prepare a problem's model once for all motions."""
    return FlightModel(flight_dynamics(problem))


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class Trajectory:
    """A motion sampled: everything that constraints and objectives ask, computed when asked.

    ``motion`` holds the K instants of the sampling; ``angular_momentum`` (e,).
    """

    model: FlightModel
    variables: DecisionVariables
    sampling: Sampling
    motion: JointMotion
    angular_momentum: Array
    _jacobians: dict[str, Array] = field(default_factory=dict, init=False)

    @cached_property
    def flown(self) -> BaseMotion:
        """How the base turns."""
        return self.model.flight.fly(self.sampling.grid, self.motion, self.angular_momentum)

    @property
    def residual(self) -> Array:
        """By how much the attitude at landing misses the goal (e,), rad."""
        return self.flown.residual

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return self.variables.polynomials.duration

    @property
    def differentiable(self) -> DifferentiableMotion:
        """The flown motion, where it is one in space: derivatives in a plane are the kernel's."""
        return cast("DifferentiableMotion", self.flown)

    def quantity_jacobian(self, name: str) -> Array:
        """Derivatives (K, r, size) of a quantity of :data:`QUANTITIES` by x."""
        if name not in self._jacobians:
            self._jacobians[name] = QUANTITIES[name].jacobian(self)
        return self._jacobians[name]

    @property
    def turning_rate(self) -> Array:
        """The base's rate (K, 1), rad/s; in space its length."""
        rate = self.flown.rate
        return rate if rate.shape[1] == 1 else np.linalg.norm(rate, axis=1, keepdims=True)

    @property
    def turning_rate_jacobian(self) -> Array:
        """Derivatives (K, 1, size) of it by x."""
        by_x, rate = self.jacobian(self.differentiable.rate_partials), self.flown.rate
        if rate.shape[1] == 1:
            return by_x
        along = rate / np.maximum(self.turning_rate, np.finfo(float).tiny)
        return along[:, None] @ by_x

    @property
    def each_joint(self) -> Array:
        """Derivatives (K, n, n) of a quantity of the joints by itself."""
        count, n = self.motion.velocities.shape
        return np.broadcast_to(np.eye(n), (count, n, n))

    def at_goal(self) -> Trajectory:
        """Return the same motion, with the attitudes asked for at takeoff and landing in the place of its own."""
        other = replace(self)
        other.__dict__["flown"] = self.flown.at_goal()
        return other

    @cached_property
    def residual_jacobian(self) -> Array:
        """Derivatives (e, size) of the residual by x."""
        by_x = self._chained(self.differentiable.residual_partials)
        return self.duration * np.tensordot(self.sampling.grid.weights, by_x, 1)

    @cached_property
    def attitude_jacobian(self) -> Array:
        """Derivative (K, e, size) by x of the attitude, as small turns."""
        return self.differentiable.transport(self._chained(self.differentiable.drift))

    def jacobian(self, partials: Partials) -> Array:
        """Derivatives (K, r, size) by x of quantities with the given partials."""
        result = self._chained(partials)
        if partials.by_attitude is not None:
            for direction in range(self.model.flight.tangent):
                result += partials.by_attitude[..., direction, None] * self.attitude_jacobian[:, None, direction, :]
        self.model.differentiated(result.size)
        return result

    def _chained(self, partials: Partials) -> Array:
        """Derivatives (L, r, size) by x through joints and h alone, of partials at the first L instants."""
        motion = self.motion
        weights: dict[int, Array] = {}  # by p, its rate and its curvature

        def add(derivative: int, partial: Array, slope: Array) -> None:
            weight = partial * slope[: len(partial), None]
            weights[derivative] = weights[derivative] + weight if derivative in weights else weight

        if partials.by_position is not None:
            add(0, partials.by_position, motion.position_by_p)
        if partials.by_velocity is not None:
            add(0, partials.by_velocity, motion.velocity_by_p)
            add(1, partials.by_velocity, motion.velocity_by_rate)
        if partials.by_acceleration is not None:
            add(0, partials.by_acceleration, motion.acceleration_by_p)
            add(1, partials.by_acceleration, motion.acceleration_by_rate)
            add(2, partials.by_acceleration, motion.acceleration_by_curvature)
        values, given = self.sampling.values, self.sampling.given
        by_z = np.asarray(sum(w[..., None] * values[d][: len(w), None, None, given:] for d, w in weights.items()))
        return self.variables.gradient(by_z, partials.by_momentum)


def trajectory(model: FlightModel, variables: DecisionVariables, sampling: Sampling, x: Array) -> Trajectory:
    """Evaluate the motion of x at the sampling's instants."""
    model.evaluated(len(sampling.grid.s))
    h = variables.angular_momentum(x)
    motion = variables.motion_class(h).motion(variables.free_coefficients(x), sampling.values)
    return Trajectory(model, variables, sampling, motion, h)


EVERYTHING: frozenset[AtEnds] = frozenset({"momentum", "velocities", "accelerations"})


@dataclass(frozen=True)
class MotionQuantity:
    """What limits and objectives are about: values (K, m) of a trajectory, and their derivatives (K, m, size) by x.

    ``depends_at_ends_on`` : on what, beside the posture, it depends at takeoff and landing. ``sums`` : as what matrices
    times the kernel's quantities it is written in a plane, where it is none of these itself.
    """

    values: Callable[[Trajectory], Array]
    jacobian: Callable[[Trajectory], Array]
    depends_at_ends_on: frozenset[AtEnds] = EVERYTHING
    sums: Callable[[FlightDynamics], Mapping[str, Array]] = lambda flight: {}


QUANTITIES: dict[str, MotionQuantity] = {
    "velocities": MotionQuantity(
        lambda it: it.motion.velocities,
        lambda it: it.jacobian(Partials(by_velocity=it.each_joint)),
        frozenset({"velocities"}),
    ),
    "accelerations": MotionQuantity(
        lambda it: it.motion.accelerations,
        lambda it: it.jacobian(Partials(by_acceleration=it.each_joint)),
        frozenset({"accelerations"}),
    ),
    "torques": MotionQuantity(lambda it: it.flown.torques, lambda it: it.jacobian(it.differentiable.torque_partials)),
    "motor_torques": MotionQuantity(
        lambda it: it.flown.motor_torques, lambda it: it.jacobian(it.differentiable.motor_torque_partials)
    ),
    "orientation_rate": MotionQuantity(
        lambda it: it.turning_rate,
        lambda it: it.turning_rate_jacobian,
        frozenset({"velocities", "momentum"}),
    ),
}
