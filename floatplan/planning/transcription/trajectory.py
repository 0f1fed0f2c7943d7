"""The motion of the whole robot at chosen instants, and its derivatives by the decision variables of the search."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.planar.ballistics import Ballistics, ballistics
from floatplan.motion.planar.clearance import Distances, LinkShapes, Segments
from floatplan.motion.planar.closed_form import BaseRate, Dynamics, Moments
from floatplan.motion.quadrature import GaussLegendre, gauss_legendre
from floatplan.motion.sine_polynomial import JointMotion, basis
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.planning.work import Work
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Robot

NO_CHANGE = np.zeros(())  # by h, where h is given
TINY = 1e-300  # keeps a quotient of zeros from being none


@dataclass(frozen=True, eq=False)
class Sampling:
    """The instants at which a motion is looked at: first the N quadrature nodes, then any others.

    ``s`` (K,) in [0, 1]; ``values`` of the polynomial basis there; ``integrals`` (K, N) over [0, s] from the nodes.
    """

    quadrature: GaussLegendre
    s: Array
    values: tuple[Array, Array, Array]
    integrals: Array

    @property
    def nodes(self) -> int:
        """Number N of quadrature nodes."""
        return len(self.quadrature.nodes)

    @cached_property
    def weighted(self) -> tuple[Array, Array]:
        """Free polynomials and their first derivatives at the nodes (N, width), times the quadrature weights."""
        weights = self.quadrature.weights[:, None]
        value, derivative = (part[: self.nodes, CONDITIONS:] for part in self.values[:2])
        return weights * value, weights * derivative


@lru_cache(maxsize=64)
def sample_nodes(count: int, width: int) -> Sampling:
    """Sample at ``count`` quadrature nodes."""
    quadrature = gauss_legendre(count)
    nodes = quadrature.nodes
    return Sampling(quadrature, nodes, basis(width).values(nodes), quadrature.integrals(nodes))


def sample_also(sampling: Sampling, width: int, extra: Array) -> Sampling:
    """Add ``extra`` instants of [0, 1] to a sampling."""
    values = basis(width).values(extra)
    return Sampling(
        sampling.quadrature,
        np.concatenate((sampling.s, extra)),
        (
            np.concatenate((sampling.values[0], values[0])),
            np.concatenate((sampling.values[1], values[1])),
            np.concatenate((sampling.values[2], values[2])),
        ),
        np.concatenate((sampling.integrals, sampling.quadrature.integrals(extra))),
    )


@dataclass(frozen=True, eq=False)
class Partials:
    """Derivatives of r quantities at K instants by the robot's state there.

    ``by_position, by_velocity, by_acceleration`` (K, r, n); ``by_orientation, by_momentum`` (K, r). None is zero.
    """

    by_position: Array | None = None
    by_velocity: Array | None = None
    by_acceleration: Array | None = None
    by_orientation: Array | None = None
    by_momentum: Array | None = None


@dataclass(frozen=True, eq=False)
class FlightModel:
    """What a problem fixes of every motion: the robot's dynamics and shapes, the path of the centre of mass.

    ``work`` counts the motions evaluated with it.
    """

    tree: PlanarTree
    dynamics: Dynamics
    shapes: LinkShapes
    ballistics: Ballistics
    initial_orientation: float
    final_orientation: float
    work: Work = field(default_factory=Work)


@lru_cache(maxsize=64)
def _of_robot(robot: Robot) -> tuple[Dynamics, LinkShapes]:
    return Dynamics(robot.tree), LinkShapes(robot.tree, robot.shapes)


def flight_model(problem: Problem) -> FlightModel:
    """Prepare a problem's model once for all motions."""
    return FlightModel(
        problem.robot.tree,
        *_of_robot(problem.robot),
        ballistics(problem),
        problem.initial.orientation,
        problem.final.orientation,
    )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion sampled, for one x: everything that constraints and objectives ask of it, computed when asked.

    ``motion`` holds the K instants of the sampling.
    """

    model: FlightModel
    variables: DecisionVariables
    sampling: Sampling
    motion: JointMotion
    angular_momentum: float | Array  # (K,) in a crowd

    @property
    def rate(self) -> Array:
        """theta0' (K,) rad/s."""
        return self.base_rate.rate

    @property
    def node_rates(self) -> Array:
        """theta0' (N,) rad/s at the quadrature nodes."""
        return self.rate[: self.sampling.nodes]

    @cached_property
    def fastest(self) -> float:
        """Largest theta0' at the quadrature nodes, rad/s."""
        return float(np.abs(self.node_rates).max())

    @cached_property
    def unresolved(self) -> float:
        """Tail of the Legendre coefficients of theta0', relative to its largest value."""
        return self.sampling.quadrature.tail(self.node_rates) / max(self.fastest, TINY)

    @cached_property
    def base_rate(self) -> BaseRate:
        """theta0' with its derivatives."""
        motion = self.motion
        return self.model.dynamics.base_rate_derivatives(motion.positions, motion.velocities, self.angular_momentum)

    @cached_property
    def times(self) -> Array:
        """Instants (K,) s."""
        return self.duration * self.sampling.s

    @cached_property
    def angles(self) -> Array:
        """Absolute angles (K, m) of the bodies, rad."""
        return self.model.tree.absolute_angles(self.orientation, self.motion.positions)

    @cached_property
    def segments(self) -> Segments:
        """The links' capsules where they are."""
        com = self.model.ballistics.positions(self.times)
        return self.model.shapes.place(com[:, 0] + 1j * com[:, 1], self.angles)

    @cached_property
    def distances(self) -> dict[object, Distances]:
        """What constraints have measured here, for their derivatives."""
        return {}

    @cached_property
    def torques(self) -> Array:
        """Generalised joint torques (K, n) N m: of a leader and its followers together."""
        return np.asarray(self._moments @ self.model.tree.turns)

    @cached_property
    def motor_torques(self) -> Array:
        """Each motor's own torque (K, m) N m."""
        return np.asarray(self._moments @ self.model.tree.motor_turns)

    @cached_property
    def _moments(self) -> Array:
        motion = self.motion
        return self.model.dynamics.moments(motion.positions, motion.velocities, motion.accelerations, self.rate)

    @cached_property
    def torque_jacobian(self) -> Array:
        """Derivatives (K, n, size) of the generalised torques by x."""
        return self._gathered(self.model.tree.turns)

    @cached_property
    def motor_torque_jacobian(self) -> Array:
        """Derivatives (K, m, size) of the motors' own torques by x."""
        tree = self.model.tree
        if tree.motor_turns.shape == tree.turns.shape:  # the same: each planned joint has one motor
            return self.torque_jacobian
        return self._gathered(tree.motor_turns)

    @cached_property
    def _moment_derivatives(self) -> Moments:
        motion = self.motion
        return self.model.dynamics.moment_derivatives(
            motion.positions, motion.velocities, motion.accelerations, self.base_rate
        )

    def _gathered(self, turns: Array) -> Array:
        """Derivatives (K, r, size) by x of the torques on coordinates that turn the bodies by ``turns`` (m, r)."""
        torques = self._moment_derivatives.gathered(turns)
        return self.jacobian(
            Partials(
                by_position=torques.by_position,
                by_velocity=torques.by_velocity,
                by_acceleration=torques.by_acceleration,
                by_momentum=torques.by_momentum,
            )
        )

    @cached_property
    def velocity_jacobian(self) -> Array:
        """Derivatives (K, n, size) of the joint velocities by x."""
        n = self.motion.velocities.shape[1]
        return self.jacobian(Partials(by_velocity=np.broadcast_to(np.eye(n), (len(self.times), n, n))))

    @cached_property
    def base_rate_jacobian(self) -> Array:
        """Derivatives (K, size) of theta0' by x."""
        rate = self.base_rate
        return self.jacobian(
            Partials(
                by_position=rate.by_position[:, None, :],
                by_velocity=rate.by_velocity[:, None, :],
                by_momentum=rate.by_momentum[:, None],
            )
        )[:, 0, :]

    def angle_jacobian(self, by_angle: Array) -> Array:
        """Derivatives (K, r, size) by x of quantities with derivatives ``by_angle`` (K, r, m) by the bodies' angles."""
        return self.jacobian(
            Partials(by_position=by_angle @ self.model.tree.turns, by_orientation=by_angle.sum(axis=2))
        )

    @cached_property
    def orientation(self) -> Array:
        """Orientation (K,) rad by (18)."""
        return np.asarray(self.model.initial_orientation + self.duration * (self.sampling.integrals @ self.node_rates))

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return self.variables.polynomials.duration

    def with_orientation(self, orientation: Array) -> Trajectory:
        """Return the same motion with another orientation (K,) than its integral."""
        other = replace(self)
        other.__dict__["orientation"] = orientation
        return other

    @property
    def final_orientation(self) -> float:
        """Orientation at T by (14), rad."""
        weights = self.sampling.quadrature.weights
        return float(self.model.initial_orientation + self.duration * (weights @ self.node_rates))

    @cached_property
    def final_gradient(self) -> Array:
        """Derivative (size,) of :attr:`final_orientation` by x."""
        nodes = self.sampling.nodes
        by_p, by_rate = self._rate_by_argument
        weighted, weighted_derivative = self.sampling.weighted
        by_z = by_p[:nodes].T @ weighted
        by_z += by_rate[:nodes].T @ weighted_derivative
        by_momentum = NO_CHANGE
        if self.variables.reach:
            by_momentum = self.sampling.quadrature.weights @ self.base_rate.by_momentum[:nodes]
        return self.duration * self.variables.gradient(by_z, by_momentum)

    @cached_property
    def _rate_by_argument(self) -> tuple[Array, Array]:
        """Derivatives (K, n) of theta0' by p and by dp/ds."""
        rate, motion = self.base_rate, self.motion
        by_p = rate.by_position * motion.position_by_p + rate.by_velocity * motion.velocity_by_p
        return by_p, rate.by_velocity * motion.velocity_by_rate

    @cached_property
    def orientation_jacobian(self) -> Array:
        """Derivative (K, size) of :attr:`orientation` by x."""
        nodes, values = self.sampling.nodes, self.sampling.values
        by_p, by_rate = self._rate_by_argument
        by_z = by_p[:nodes, :, None] * values[0][:nodes, None, CONDITIONS:]
        by_z += by_rate[:nodes, :, None] * values[1][:nodes, None, CONDITIONS:]
        by_x = self.variables.gradient(by_z, self.base_rate.by_momentum[:nodes])
        return self.duration * (self.sampling.integrals @ by_x)

    def jacobian(self, partials: Partials) -> Array:
        """Derivatives (K, r, size) by x of quantities with the given partials."""
        motion = self.motion
        weights: list[Array | float] = [0.0, 0.0, 0.0]
        if partials.by_position is not None:
            weights[0] += partials.by_position * motion.position_by_p[:, None, :]
        if partials.by_velocity is not None:
            weights[0] += partials.by_velocity * motion.velocity_by_p[:, None, :]
            weights[1] += partials.by_velocity * motion.velocity_by_rate[:, None, :]
        if partials.by_acceleration is not None:
            weights[0] += partials.by_acceleration * motion.acceleration_by_p[:, None, :]
            weights[1] += partials.by_acceleration * motion.acceleration_by_rate[:, None, :]
            weights[2] += partials.by_acceleration * motion.acceleration_by_curvature[:, None, :]
        by_z: Array | float = 0.0
        for weight, value in zip(weights, self.sampling.values, strict=True):
            if not isinstance(weight, float):
                by_z += weight[..., None] * value[:, None, None, CONDITIONS:]
        assert not isinstance(by_z, float), "partials are by a state of the joints"
        by_momentum = partials.by_momentum if partials.by_momentum is not None else np.zeros(by_z.shape[:2])
        result = self.variables.gradient(by_z, by_momentum)
        if partials.by_orientation is not None:
            result += partials.by_orientation[..., None] * self.orientation_jacobian[:, None, :]
        self.model.work.differentiated(result.size)
        return result


def trajectory(model: FlightModel, variables: DecisionVariables, sampling: Sampling, x: Array) -> Trajectory:
    """Evaluate the motion of x at the sampling's instants."""
    model.work.evaluated(len(sampling.s), len(model.tree.mass))
    motion = variables.polynomials.motion(variables.free_coefficients(x), sampling.values)
    return Trajectory(model, variables, sampling, motion, variables.angular_momentum(x))


def crowd(model: FlightModel, variables: DecisionVariables, nodes: int, x: Array) -> Trajectory:
    """Evaluate S motions x (S, size) at once, one after the other at the quadrature nodes: K = S * nodes instants.

    For values only: the derivatives of such a trajectory mean nothing.
    """
    model.work.evaluated(len(x) * nodes, len(model.tree.mass))
    polynomials = variables.polynomials
    one = sample_nodes(nodes, polynomials.width)
    z = np.zeros((len(x), len(polynomials.free) * polynomials.width))
    z[:, polynomials.free_indices] = variables.offset + x[:, : variables.coefficients] @ variables.scaling.T
    boundary = np.broadcast_to(polynomials.boundary, (len(x), *polynomials.boundary.shape))
    coefficients = np.concatenate((boundary, z.reshape(*boundary.shape[:2], -1)), axis=2).transpose(0, 2, 1)
    motion = polynomials.motion_of_coefficients(coefficients, one.values)
    momentum = variables.middle + (variables.reach * x[:, -1] if variables.reach else np.zeros(len(x)))
    tiled = Sampling(one.quadrature, np.tile(one.s, len(x)), one.values, one.integrals)
    together = Trajectory(model, variables, tiled, motion, np.repeat(momentum, nodes))
    integrals = together.rate.reshape(len(x), nodes) @ one.integrals.T
    return together.with_orientation((model.initial_orientation + polynomials.duration * integrals).ravel())
