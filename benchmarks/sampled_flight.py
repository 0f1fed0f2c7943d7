"""Flights in a plane in NumPy, sampled at instants, with derivatives: what tests hold the kernel to.

Benchmarks draw problems around motions that are evaluated here, and give other solvers a program of their own.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.tolerances import SETTINGS
from floatplan.motion.planar import clearance
from floatplan.motion.planar.clearance import Segments
from floatplan.motion.planar.flight import GaussGrid, PlanarFlight, gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, JointMotion, basis
from floatplan.planning.constraints import Constraint
from floatplan.planning.kernel_input.rows import SumRows
from floatplan.planning.variables import DecisionVariables
from floatplan.problem.parts import Obstacle

TINY = 1e-300  # keeps a quotient of zeros from being none


class Partials(NamedTuple):
    """Derivatives of r quantities at K instants by the robot's state there.

    ``by_position, by_velocity, by_acceleration`` (K, r, n); ``by_attitude, by_momentum`` (K, r, e), by zeta and by h.
    None is zero.
    """

    by_position: Array | None = None
    by_velocity: Array | None = None
    by_acceleration: Array | None = None
    by_attitude: Array | None = None
    by_momentum: Array | None = None


class FlightGrid(Hashable, Protocol):
    """Instants of a flight: N nodes, which the attitude is integrated on, then any others; hashed as an object."""

    @property
    def s(self) -> Array:
        """All instants (K,), fractions of the flight."""

    @property
    def nodes(self) -> int:
        """Number N of nodes."""

    @property
    def weights(self) -> Array:
        """Quadrature weights (N,) of the nodes, for integrals over [0, 1]."""

    def also(self, instants: Array) -> FlightGrid:
        """Return the same grid with more instants of [0, 1]."""


class BaseMotion(Protocol):
    """The base's motion; everything is computed when asked for."""

    @property
    def rate(self) -> Array:
        """Angular velocity (K, e) of the base, rad/s."""

    @property
    def attitude(self) -> Array:
        """Attitudes (K, ...), in a form of the module's own: angles, rad, in a plane."""

    @property
    def residual(self) -> Array:
        """By how much the attitude at landing misses the goal (e,), rad."""

    @property
    def missed(self) -> float:
        """The largest of them, rad; infinite where whole turns are not those asked for."""

    @property
    def wrong_way(self) -> str:
        """What is wrong with the way from takeoff to landing for a person; empty for nothing."""

    @property
    def unresolved(self) -> float:
        """What the nodes may miss of the motion, relative to its size."""

    def level_needed(self, error: float) -> int:
        """Level of grids that integrates the attitude at landing to an error, rad; the finest where none does."""

    @property
    def torques(self) -> Array:
        """Generalised joint torques (K, n) N m: of a leader and its followers together."""

    @property
    def motor_torques(self) -> Array:
        """Each motor's own torque (K, m) N m."""

    def obstacle_distances(self, obstacle: Obstacle) -> Array:
        """Distances (K, r) of the links to an obstacle, r as of :meth:`FlightDynamics.links_measured`.

        In m, between surfaces; negative where the surfaces overlap.
        """

    def pair_distances(self, first: tuple[int, ...], second: tuple[int, ...]) -> Array:
        """Distances (K, r) between shapes, given by their indices: each of the first to each of the second."""

    def at_goal(self) -> BaseMotion:
        """Return the same motion, with the attitudes asked for at s = 0 and s = 1 in the place of its own."""


class DifferentiableMotion(BaseMotion, Protocol):
    """One with its derivatives: of a motion in NumPy.

    Derivatives by shapes are by the turns of the bodies, or by 3 numbers for each of them in space.
    """

    @property
    def rate_partials(self) -> Partials:
        """Of the angular velocity, r = e."""

    @property
    def drift(self) -> Partials:
        """Of g at the nodes, K = N, r = e: by positions, velocities and h."""

    def transport(self, drift: Array) -> Array:
        """Small turns zeta (K, e, c) that c drifts (N, e, c) at the nodes make."""

    @property
    def residual_partials(self) -> Partials:
        """Of the residual, by the same: its change is ``duration * sum_j weights[j]`` of theirs, as g is carried on."""

    @property
    def torque_partials(self) -> Partials:
        """Of the generalised torques, r = n."""

    @property
    def motor_torque_partials(self) -> Partials:
        """Of the motors' own torques, r = m."""

    def obstacle_partials(self, obstacle: Obstacle) -> Partials:
        """Of the distances to an obstacle."""

    def pair_partials(self, first: tuple[int, ...], second: tuple[int, ...]) -> Partials:
        """Of the distances between shapes."""


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class PlanarBaseMotion:
    """The base's motion in the plane, see :class:`BaseMotion`."""

    flight: PlanarFlight
    grid: GaussGrid
    joints: JointMotion
    angular_momentum: Array

    @cached_property
    def base_rate(self) -> Array:
        """theta0' (K,) rad/s."""
        h, joints = float(self.angular_momentum[0]), self.joints
        return self.flight.equations.base_rate(joints.positions, joints.velocities, h)

    @property
    def rate(self) -> Array:
        """theta0' (K, 1) rad/s."""
        return self.base_rate[:, None]

    @property
    def node_rates(self) -> Array:
        """theta0' (N,) rad/s at the nodes."""
        return self.base_rate[: self.grid.nodes]

    @cached_property
    def attitude(self) -> Array:
        """Orientation (K,) rad by (18)."""
        turned = self.grid.integrals @ self.node_rates
        return np.asarray(self.flight.initial_orientation + self.flight.duration * turned)

    @property
    def residual(self) -> Array:
        """(14): orientation at landing less the goal (1,), rad."""
        turned = self.flight.duration * float(self.node_rates @ self.grid.weights)
        return np.array([turned - self.flight.change])

    @property
    def missed(self) -> float:
        """The residual without its sign, rad."""
        return abs(float(self.residual[0]))

    @property
    def wrong_way(self) -> str:
        """Nothing: in a plane whole turns are in the residual."""
        return ""

    @cached_property
    def fastest(self) -> float:
        """Largest theta0' at the nodes, rad/s."""
        return float(np.abs(self.node_rates).max())

    @cached_property
    def unresolved(self) -> float:
        """Tail of the Legendre coefficients of theta0', relative to its largest value."""
        return self.grid.quadrature.tail(self.node_rates) / max(self.fastest, TINY)

    def level_needed(self, error: float) -> int:
        """Level at which theta0(T) is exact to ``error``, rad, by extrapolating the Legendre tail.

        N Gauss nodes integrate degree 2N - 1 exactly, so their error is the tail at 2N: geometric decay squares it.
        """
        decay = math.log(min(max(self.unresolved, SETTINGS.smallest_tail), SETTINGS.largest_tail)) / self.grid.nodes
        count = math.log(error / max(self.fastest * self.flight.duration, error)) / (2 * decay)
        finest = len(NODE_COUNTS) - 1
        return finest if math.isnan(count) else min(bisect_left(NODE_COUNTS, count), finest)

    @cached_property
    def torques(self) -> Array:
        """Generalised joint torques (K, n) N m."""
        return np.asarray(self.moments @ self.flight.tree.turns)

    @cached_property
    def motor_torques(self) -> Array:
        """Each motor's own torque (K, m) N m."""
        return np.asarray(self.moments @ self.flight.tree.motor_turns)

    @cached_property
    def moments(self) -> Array:
        """Moments (K, m) that turn the bodies, N m."""
        joints = self.joints
        return self.flight.equations.moments(joints.positions, joints.velocities, joints.accelerations, self.base_rate)

    @cached_property
    def angles(self) -> Array:
        """Absolute angles (K, m) of the bodies, rad."""
        return self.flight.tree.absolute_angles(self.attitude, self.joints.positions)

    @cached_property
    def shapes(self) -> Segments:
        """The links' capsules where they are."""
        com = self.flight.ballistics.positions(self._times)
        return self.flight.link_shapes.place(com[:, 0] + 1j * com[:, 1], self.angles)

    @cached_property
    def _times(self) -> Array:
        """Instants (K,) s."""
        return self.flight.duration * self.grid.s

    def obstacle_distances(self, obstacle: Obstacle) -> Array:
        """Distances (K, r) of the capsules to an obstacle."""
        return clearance.obstacle_distances(self.shapes, obstacle, self._times)

    def pair_distances(self, first: tuple[int, ...], second: tuple[int, ...]) -> Array:
        """Distances (K, r) between capsules, given by their indices: each of the first to each of the second."""
        return clearance.pair_distances(self.shapes.of(np.array(first)), self.shapes.of(np.array(second)))

    def at_goal(self) -> PlanarBaseMotion:
        """Return the same motion with the orientations asked for at takeoff and landing."""
        s, flight = self.grid.s, self.flight
        orientation = np.where(
            s == 0, flight.initial_orientation, np.where(s == 1, flight.final_orientation, self.attitude)
        )
        other = replace(self)
        other.__dict__["attitude"] = orientation
        return other


def planar_motion(flight: PlanarFlight, grid: FlightGrid, joints: JointMotion, momentum: Array) -> PlanarBaseMotion:
    """Turn the base as joints and angular momentum (1,), kg m^2/s, make it."""
    assert isinstance(grid, GaussGrid), "flights here are in a plane"
    return PlanarBaseMotion(flight, grid, joints, momentum)


@dataclass(frozen=True, eq=False)
class Sampling:
    """The K instants at which a motion is looked at, first the N nodes, and the ``values`` of a form's basis there."""

    grid: FlightGrid
    form: Form
    values: tuple[Array, Array, Array]

    @property
    def given(self) -> int:
        """Number g of columns of the basis that belong to given conditions."""
        return len(basis(self.form).fixed)


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


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class Trajectory:
    """A motion sampled: everything that constraints and objectives ask, computed when asked.

    ``motion`` holds the K instants of the sampling; ``angular_momentum`` (e,).
    """

    flight: Any
    variables: DecisionVariables
    sampling: Sampling
    motion: JointMotion
    angular_momentum: Array
    _jacobians: dict[str, Array] = field(default_factory=dict, init=False)

    @cached_property
    def flown(self) -> BaseMotion:
        """How the base turns."""
        flight: Any = self.flight
        fly = getattr(flight, "fly", partial(planar_motion, flight))
        return fly(self.sampling.grid, self.motion, self.angular_momentum)

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
        """The flown motion, where it has derivatives."""
        return cast("DifferentiableMotion", self.flown)

    def quantity_jacobian(self, name: str) -> Array:
        """Derivatives (K, r, size) of a quantity of :data:`QUANTITIES` by x."""
        if name not in self._jacobians:
            self._jacobians[name] = QUANTITIES[name].jacobian(self)
        return self._jacobians[name]

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
            for direction in range(self.flight.tangent):
                result += partials.by_attitude[..., direction, None] * self.attitude_jacobian[:, None, direction, :]
        return result

    def _chained(self, partials: Partials) -> Array:
        """Derivatives (L, r, size) by x through joints and h alone, of partials at the first L instants."""
        slopes = self.motion.slopes
        weights: dict[int, Array] = {}  # by p, its rate and its curvature
        by_joints = (partials.by_position, partials.by_velocity, partials.by_acceleration)
        for order, by_order in enumerate(by_joints):
            if by_order is None:
                continue
            for derivative in range(order + 1):
                weight = by_order * slopes[order, derivative, : len(by_order), None]
                weights[derivative] = weights[derivative] + weight if derivative in weights else weight
        values, given = self.sampling.values, self.sampling.given
        by_z = np.asarray(sum(w[..., None] * values[d][: len(w), None, None, given:] for d, w in weights.items()))
        return gradient(self.variables, by_z, partials.by_momentum)


def trajectory(flight: Any, variables: DecisionVariables, sampling: Sampling, x: Array) -> Trajectory:
    """Evaluate the motion of x at the sampling's instants."""
    h = variables.angular_momentum(x)
    motion = variables.motion_class(h).motion(variables.free_coefficients(x), sampling.values)
    return Trajectory(flight, variables, sampling, motion, h)


@dataclass(frozen=True)
class MotionQuantity:
    """What limits and objectives are about: values (K, m) of a trajectory, and their derivatives (K, m, size) by x."""

    values: Callable[[Trajectory], Array]
    jacobian: Callable[[Trajectory], Array]


QUANTITIES: dict[str, MotionQuantity] = {
    "velocities": MotionQuantity(
        lambda it: it.motion.velocities,
        lambda it: it.jacobian(Partials(by_velocity=it.each_joint)),
    ),
    "accelerations": MotionQuantity(
        lambda it: it.motion.accelerations,
        lambda it: it.jacobian(Partials(by_acceleration=it.each_joint)),
    ),
    "torques": MotionQuantity(lambda it: it.flown.torques, lambda it: it.jacobian(it.differentiable.torque_partials)),
    "motor_torques": MotionQuantity(
        lambda it: it.flown.motor_torques, lambda it: it.jacobian(it.differentiable.motor_torque_partials)
    ),
    "orientation_rate": MotionQuantity(
        lambda it: it.flown.rate,
        lambda it: it.jacobian(it.differentiable.rate_partials),
    ),
}


def gradient(variables: DecisionVariables, by_z: Array, by_momentum: Array | None) -> Array:
    """Derivatives (..., size) by x, from those by z (..., n, width) and by h (..., e), None for zeros."""
    assert not variables.following, "conditions follow h in a plane alone, where derivatives are the kernel's"
    *shape, joints, width = by_z.shape
    flat = by_z.reshape(math.prod(shape), joints * width)  # one product of matrices is faster than many
    by_x = (
        flat if flat.shape[1] == len(variables.offset) else flat[:, variables.polynomials.free_indices]
    ) @ variables.scaling
    if variables.momentum.axes.size:
        free = variables.momentum.axes.shape[1]
        chosen = np.zeros((len(flat), free)) if by_momentum is None else by_momentum @ variables.momentum.axes
        by_x = np.concatenate((by_x, chosen.reshape(-1, free)), axis=1)
    return by_x.reshape(*shape, variables.size)


def values_of(block: Constraint, motion: Trajectory) -> Array:
    """Values (K, r) of a block of constraints."""
    rows = block.rows
    if isinstance(rows, SumRows):
        sums = sum(QUANTITIES[name].values(motion) @ weights.T for name, weights in rows.weights.items())
        return np.asarray(rows.constant + sums)
    between, flown = rows.between, motion.flown
    if isinstance(between, Obstacle):
        return (flown.obstacle_distances(between) - rows.least) / rows.scale
    first, second = map(tuple, between)
    return (flown.pair_distances(first, second) - rows.least) / rows.scale


def jacobian_of(block: Constraint, motion: Trajectory) -> Array:
    """Their derivatives (K, r, size) by x."""
    rows = block.rows
    if isinstance(rows, SumRows):
        sums = sum(weights @ motion.quantity_jacobian(name) for name, weights in rows.weights.items())
        return np.asarray(sums)
    between, flown = rows.between, motion.differentiable
    if isinstance(between, Obstacle):
        return motion.jacobian(flown.obstacle_partials(between)) / rows.scale
    first, second = map(tuple, between)
    return motion.jacobian(flown.pair_partials(first, second)) / rows.scale


def nodes_of(level: int, form: Form) -> Sampling:
    """Sample at the nodes of a level, for motions of a form."""
    return sample_nodes(gauss_grid(NODE_COUNTS[level]), form)
