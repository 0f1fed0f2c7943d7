"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.method.dynamics import Dynamics
from floatplan.method.motion import Motions
from floatplan.motion.flight import planar_flight
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE

QUADRATURE = gauss_legendre(96)  # of (14) and (18): exact to 1e-12 rad but for motions that nobody wants
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit
EPSILON = 2e-7  # [-] of these, the paper's: with so much left at its instants a plan holds between them too


class Evaluation(NamedTuple):
    """At x: the objective, half a sum of squares; its gradient, Gauss's and Newton's Hessian; rows (r,), at least 0."""

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
    """A problem's flights on one branch of the arcsine; the variables x are z and, where h is free, its part of (9)."""

    def __init__(self, problem: Problem, degrees: Sequence[int], branch: IntArray) -> None:
        self.problem = problem
        self.motions = Motions(problem, degrees, branch)
        self.dynamics = Dynamics(problem.robot)
        self.flight = planar_flight(problem)  # the path of the CM (2), (3), (6), the momenta (7) to (10)
        self.size = self.motions.size + self.flight.momentum_set.axes.shape[1]
        self.limits = [(name, used) for shares in problem.limit_shares for name, used in shares.used.items()]

    def angular_momentum(self, x: Array) -> Array:
        """The h (1,), kg m^2/s."""
        momenta = self.flight.momentum_set
        return np.asarray(momenta.centre + momenta.axes @ x[self.motions.size :])

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at the nodes, then at s, and their derivatives (N, 3n+2, m) by x; theta_0 by (18)."""
        instants = np.concatenate((QUADRATURE.nodes, s))
        joints, joints_by_z = self.motions.at(instants, x[: self.motions.size])
        u = np.zeros((len(instants), joints.shape[1] + 2))
        u_by_x = np.zeros((*u.shape, self.size))
        u[:, :-2] = joints
        u_by_x[:, :-2, : self.motions.size] = joints_by_z
        u[:, -2] = self.angular_momentum(x)
        u_by_x[:, -2, self.motions.size :] = self.flight.momentum_set.axes
        rates = [self.dynamics.base_rate(state) for state in u[: len(QUADRATURE.nodes)]]
        integrals = self.problem.flight.duration * QUADRATURE.integrals(instants)
        u[:, -1] = self.problem.initial.orientation + integrals @ [rate[0] for rate, _ in rates]
        u_by_x[:, -1] = integrals @ [rate_by_u[0] @ u_by_x[k] for k, (_, rate_by_u) in enumerate(rates)]
        return u, u_by_x

    def evaluate(self, x: Array, instants: Array) -> Evaluation:
        """Values and derivatives at x (m,): the first two rows are what (14) misses, with either sign.

        The others are the inequalities at one of the instants (N,) of [0, 1] after the other.
        """
        u, u_by_x = self.states(x, np.append(instants, 1.0))
        nodes = len(QUADRATURE.nodes)
        missed = u[-1:, -1] - self.problem.final.orientation
        rows = [missed, -missed]
        rows_by_x = [u_by_x[-1:, -1], -u_by_x[-1:, -1]]
        for k, s in enumerate(instants, nodes):
            values, by_u = self.rows(s, u[k])
            rows.append(values - EPSILON)
            rows_by_x.append(by_u @ u_by_x[k])
        residuals, J = self.residuals(x, u[:nodes], u_by_x[:nodes])
        objective = float(residuals @ residuals) / 2
        return Evaluation(objective, J.T @ residuals, J.T @ J, np.concatenate(rows), np.concatenate(rows_by_x))

    def inequalities(self, x: Array, instants: Array) -> Array:
        """What the inequalities leave (N, r) at instants (N,) of [0, 1]."""
        return self.evaluate(x, instants).rows[2:].reshape(len(instants), -1) + EPSILON

    def residuals(self, x: Array, u: Array, u_by_x: Array) -> tuple[Array, Array]:
        """The b of (17), or what is integrated at the nodes, so that half the sum of squares is the integral."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            b, b_by_z = self.motions.b(x[: self.motions.size])
            return b, np.pad(b_by_z, ((0, 0), (0, self.flight.momentum_set.axes.shape[1])))
        weights = np.sqrt(2 * self.problem.flight.duration * QUADRATURE.weights)
        at_nodes = [self.dynamics.quantities(state)[quantity] for state in u]
        residuals = [weight * values for weight, (values, _) in zip(weights, at_nodes, strict=True)]
        by_x = [weights[k] * by_u @ u_by_x[k] for k, (_, by_u) in enumerate(at_nodes)]
        return np.concatenate(residuals), np.concatenate(by_x)

    def rows(self, s: float, u: Array) -> tuple[Array, Array]:
        """Inequalities (r,) at an instant s of [0, 1] and their derivatives by u.

        They are the shares of limits that are left, with either sign, and clearances (23), in LENGTH_SCALE.
        """
        rows = [(np.zeros(0), np.zeros((0, len(u))))]
        quantities = self.dynamics.quantities(u) if self.limits else {}
        for name, weights in self.limits:
            values, by_u = quantities[name]
            rows += [(1 - weights @ values, -weights @ by_u), (1 + weights @ values, weights @ by_u)]
        if self.problem.obstacles:
            time = s * self.problem.flight.duration
            points, points_by_u = self.dynamics.points(u, np.concatenate(self.flight.link_shapes.weights))
            points = points + complex(*self.problem.path.positions(np.array([time]))[0])
            for obstacle in self.problem.obstacles:
                seen = points - complex(*obstacle.velocity) * time
                distances, by_u = obstacle_distances(obstacle, seen, points_by_u, self.flight.link_shapes.radius)
                rows.append(((distances - obstacle.margin) / LENGTH_SCALE, by_u / LENGTH_SCALE))
        return np.concatenate([values for values, _ in rows]), np.concatenate([by_u for _, by_u in rows])


def obstacle_distances(
    obstacle: Obstacle, ends: ComplexArray, ends_by_u: ComplexArray, radius: Array
) -> tuple[Array, Array]:
    """Distances (19) of capsules from their ends, m: at the nearest u of (22), a small change of which changes none."""
    if isinstance(obstacle, HalfPlane):
        normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
        height = (normal.conjugate() * (ends - complex(*obstacle.point))).real
        return height - np.tile(radius, 2), (normal.conjugate() * ends_by_u).real
    assert isinstance(obstacle, Circle), "others are refused"
    start, end = np.split(ends - complex(*obstacle.center), 2)
    start_by_u, end_by_u = np.split(ends_by_u, 2)
    along = end - start
    u = np.clip(-(along.conj() * start).real / np.maximum(np.abs(along) ** 2, np.finfo(float).tiny), 0, 1)
    away = start + u * along
    away_by_u = (1 - u)[:, None] * start_by_u + u[:, None] * end_by_u
    distance = np.abs(away)
    return distance - radius - obstacle.radius, ((away.conj() / distance)[:, None] * away_by_u).real
