"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.method.dynamics import Dynamics, Quantity
from floatplan.method.motion import Motions
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem, shares_of_limits
from floatplan.tables import OBJECTIVE_TABLE

QUADRATURE = gauss_legendre(96)  # of (14) and (18): exact to 1e-12 rad but for motions that nobody wants
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit
BACK_OFF = 2e-7  # [-] of these, by which the search keeps inside: its plan then holds between instants too
NEAR_ENDS = 0.05  # [-] of the flight: there motions may change less, as the cube of the time to the end


class Evaluation(NamedTuple):
    """At x (m,): the objective, half a sum of squares; its gradient (m,) and Gauss's and Newton's Hessian; rows (r,).

    Rows must not be negative: what (14) misses, with either sign, then the inequalities. Their scales are 1 rad, the
    limits and LENGTH_SCALE.
    """

    objective: float
    gradient: Array
    hessian: Array
    rows: Array
    rows_by_x: Array

    @property
    def violation(self) -> float:
        """Most that a row lacks."""
        return max(-float(self.rows.min()), 0.0)

    def merit(self, penalty: float) -> float:
        """The objective and the penalty times the violation."""
        return self.objective + penalty * self.violation


class Program:
    """A problem's flights on one branch of the arcsine: x is z and, where h is free, its share of ``reach``.

    Inequalities hold at ``instants`` of [0, 1]. Where an x is given as ``near``, the objective is to stay near it.
    """

    def __init__(self, problem: Problem, motions: Motions, momentum: float, reach: float) -> None:
        self.problem = problem
        self.motions = motions
        self.momentum = momentum  # [kg m^2/s]
        self.reach = reach  # [kg m^2/s], 0 where h is given
        self.size = motions.size + (reach > 0)
        self.dynamics = Dynamics(problem.robot)
        self.limits = [(name, used) for shares in shares_of_limits(problem) for name, used in shares.used.items()]
        capsules = problem.robot.shapes if problem.obstacles else ()
        bodies = np.array([capsule.body for capsule in capsules], dtype=np.int64)
        ends = np.array([[capsule.start, capsule.end] for capsule in capsules], dtype=np.complex128)
        self.weights = problem.robot.tree.point_weights(np.tile(bodies, 2), ends.T.ravel())
        self.radius = np.array([capsule.radius for capsule in capsules])
        self.path = problem.path  # (2), (3), (6)
        self.instants = np.zeros(0)
        self.near: Array | None = None

    def angular_momentum(self, x: Array) -> float:
        """h, kg m^2/s."""
        return self.momentum + self.reach * float(x[self.motions.size :].sum())

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at the nodes, then at s, and their derivatives (N, 3n+2, m) by x; theta_0 by (18)."""
        instants = np.concatenate((QUADRATURE.nodes, s))
        joints, joints_by_z = self.motions.at(instants, x[: self.motions.size])
        u = np.zeros((len(instants), joints.shape[1] + 2))
        u_by_x = np.zeros((*u.shape, self.size))
        u[:, :-2] = joints
        u_by_x[:, :-2, : self.motions.size] = joints_by_z
        u[:, -2] = self.angular_momentum(x)
        u_by_x[:, -2, self.motions.size :] = self.reach
        rates = [self.dynamics.base_rate(state) for state in u[: len(QUADRATURE.nodes)]]
        integrals = self.problem.flight.duration * QUADRATURE.integrals(instants)
        u[:, -1] = self.problem.initial.orientation + integrals @ [rate.values[0] for rate in rates]
        u_by_x[:, -1] = integrals @ [rate.jacobian[0] @ u_by_x[k] for k, rate in enumerate(rates)]
        return u, u_by_x

    def evaluate(self, x: Array) -> Evaluation:
        """Values and derivatives at x (m,)."""
        u, u_by_x = self.states(x, np.append(self.instants, 1.0))
        nodes = len(QUADRATURE.nodes)
        missed = u[-1:, -1] - self.problem.final.orientation  # (14)
        values = [missed, -missed]
        by_x = [u_by_x[-1:, -1], -u_by_x[-1:, -1]]
        for s, state, state_by_x in zip(self.instants, u[nodes:-1], u_by_x[nodes:-1], strict=True):
            rows = self.rows(s, state)
            values.append(rows.values)
            by_x.append(rows.jacobian @ state_by_x)
        residuals, J = self.residuals(x, u[:nodes], u_by_x[:nodes])
        objective = float(residuals @ residuals) / 2
        return Evaluation(objective, J.T @ residuals, J.T @ J, np.concatenate(values), np.concatenate(by_x))

    def residuals(self, x: Array, u: Array, u_by_x: Array) -> tuple[Array, Array]:
        """The b of (17), or what is integrated at the nodes, so that half the sum of squares is the integral."""
        if self.near is not None:
            return x - self.near, np.eye(self.size)
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            b, b_by_z = self.motions.b(x[: self.motions.size])
            return b, np.pad(b_by_z, ((0, 0), (0, self.size - self.motions.size)))
        weights = np.sqrt(2 * self.problem.flight.duration * QUADRATURE.weights)[:, None]
        at_nodes = [self.dynamics.quantities(state)[quantity] for state in u]
        values = weights * np.array([at_node.values for at_node in at_nodes])
        by_x = weights[:, None] * np.array([at_node.jacobian @ u_by_x[k] for k, at_node in enumerate(at_nodes)])
        return values.ravel(), by_x.reshape(values.size, self.size)

    def rows_at(self, instants: Array, x: Array) -> Array:
        """Inequalities (N, r) at instants (N,) of [0, 1]."""
        u = self.states(x, instants)[0][len(QUADRATURE.nodes) :]
        return np.array([self.rows(s, state).values for s, state in zip(instants, u, strict=True)])

    def rows(self, s: float, u: Array) -> Quantity:
        """Inequalities (r,) at an instant s of [0, 1], less what is kept free: limits, then clearances (23).

        Of limits it is the share that is left, of clearances what is left of the margin, in ``LENGTH_SCALE``.
        """
        parts = [Quantity(np.zeros(0), np.zeros((0, len(u))))]
        quantities = self.dynamics.quantities(u) if self.limits else {}
        for name, weights in self.limits:
            used = weights @ quantities[name].values
            used_by_u = weights @ quantities[name].jacobian
            parts.append(Quantity(np.concatenate((1 - used, 1 + used)), np.concatenate((-used_by_u, used_by_u))))
        if self.problem.obstacles:
            time = s * self.problem.flight.duration
            points, points_by_u = self.dynamics.points(u, self.weights)
            points = points + complex(*self.path.positions(np.array([time]))[0])
            for obstacle in self.problem.obstacles:
                seen = points - complex(*obstacle.velocity) * time
                distance, by_u = obstacle_distances(obstacle, seen, points_by_u, self.radius)
                parts.append(Quantity((distance - obstacle.margin) / LENGTH_SCALE, by_u / LENGTH_SCALE))
        values = np.concatenate([part.values for part in parts]) - back_off(s)
        return Quantity(values, np.concatenate([part.jacobian for part in parts]))


def back_off(s: Any) -> Any:
    """What rows are kept free by, in their scales, at an instant of [0, 1]: as much as motions may change there."""
    return BACK_OFF * np.minimum(1, s * (1 - s) / NEAR_ENDS) ** 3


def obstacle_distances(obstacle: Obstacle, ends: ComplexArray, ends_by_u: ComplexArray, radius: Array) -> Quantity:
    """Distances (19) of capsules from their ends, m: at the nearest u of (22), a small change of which changes none."""
    if isinstance(obstacle, HalfPlane):
        normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
        height = (normal.conjugate() * (ends - complex(*obstacle.point))).real
        return Quantity(height - np.tile(radius, 2), (normal.conjugate() * ends_by_u).real)
    assert isinstance(obstacle, Circle), "others are refused"
    start, end = np.split(ends, 2)
    start_by_u, end_by_u = np.split(ends_by_u, 2)
    along = end - start
    reached = (along.conj() * (complex(*obstacle.center) - start)).real
    u = np.clip(reached / np.maximum(np.abs(along) ** 2, np.finfo(float).tiny), 0, 1)
    away = start + u * along - complex(*obstacle.center)
    nearest_by_u = (1 - u)[:, None] * start_by_u + u[:, None] * end_by_u
    distance_by_u = ((away.conj() / np.abs(away))[:, None] * nearest_by_u).real
    return Quantity(np.abs(away) - radius - obstacle.radius, distance_by_u)
