"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.method.dynamics import Dynamics
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import planar_flight
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import SinePolynomials, basis, powers_map
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE

QUADRATURE = gauss_legendre(96)  # of (14) and (18): exact to 1e-12 rad but for motions that nobody wants
NODES = len(QUADRATURE.nodes)
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit
EPSILON = 2e-7  # [-] of these, the paper's: with so much left at its instants a plan holds between them too


class Motions:
    """All motions (12) between a problem's ends that land on one branch of the arcsine.

    There (13) are six linear equations for the polynomial of a joint, with s = t / T:
    ``p = Hermite polynomials of (13) + s^3 (1 - s)^3 sum_k z_k J_k(s)``, with J_k that make a unit of z_k a root mean
    square of 1 rad. The variables x (m,) are the z of all joints in one row, then what the angular momentum leaves.
    """

    def __init__(self, problem: Problem, degrees: Sequence[int], branch: IntArray) -> None:
        self.polynomials = SinePolynomials.between_ends(problem, [k + 1 - CONDITIONS for k in degrees], branch)
        self.momenta = planar_flight(problem).momentum_set  # (7) to (10)
        z = self.polynomials.nominal_coefficients
        z_by_x = np.eye(z.size)[:, self.polynomials.free_indices]
        self.h_by_x = np.pad(self.momenta.axes, ((0, 0), (z_by_x.shape[1], 0)))
        self.size: int = self.h_by_x.shape[1]
        self.z_by_x = np.pad(z_by_x, ((0, 0), (0, self.momenta.axes.shape[1]))).reshape(*z.shape, self.size)

    def momentum(self, x: Array) -> Array:
        """The h (1,), kg m^2/s."""
        return np.asarray(self.momenta.centre + self.h_by_x @ x)

    def coefficients(self, x: Array) -> Array:
        """The free coefficients z (n, width) of each joint's p, with zeros where its degree is lower."""
        return np.asarray(self.z_by_x @ x)

    def b(self, x: Array) -> tuple[Array, Array]:
        """All b of (12), powers of seconds, whose norm is least in (17), and their derivatives by x."""
        powers = powers_map(self.polynomials.form, self.polynomials.duration)
        b = np.hstack((self.polynomials.boundary, self.coefficients(x))) @ powers.T
        return b.ravel(), (powers[:, CONDITIONS:] @ self.z_by_x).reshape(b.size, self.size)

    def at(self, s: Array, x: Array) -> tuple[Array, Array]:
        """q, q', q'' (N, 3n) of (12) at instants s (N,) of [0, 1], and their derivatives (N, 3n, m) by x."""
        columns = basis(self.polynomials.form).values(s)
        motion = self.polynomials.motion(self.coefficients(x), columns)
        T = self.polynomials.duration
        p_by_x, p1_by_x, p2_by_x = (
            np.tensordot(column[:, CONDITIONS:], self.z_by_x, (1, 1)) / T**order for order, column in enumerate(columns)
        )
        p1 = motion.p_rate[..., None] / T
        p2 = motion.p_curvature[..., None] / T**2
        sine = motion.sine[..., None]
        cosine = motion.cosine[..., None]
        q_by_x = cosine * p_by_x
        v_by_x = cosine * p1_by_x - sine * p1 * p_by_x
        a_by_x = cosine * p2_by_x - 2 * sine * p1 * p1_by_x - (sine * p2 + cosine * p1**2) * p_by_x
        joints = np.hstack((motion.positions, motion.velocities, motion.accelerations))
        return joints, np.concatenate((q_by_x, v_by_x, a_by_x), axis=1)


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
    """A problem's flights on one branch of the arcsine, by the variables x of their motions."""

    def __init__(self, problem: Problem, degrees: Sequence[int], branch: IntArray) -> None:
        self.problem = problem
        self.motions = Motions(problem, degrees, branch)
        self.dynamics = Dynamics(problem.robot)
        self.size = self.motions.size

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at the nodes, then at s, and their derivatives (N, 3n+2, m) by x; theta_0 by (18)."""
        instants = np.concatenate((QUADRATURE.nodes, s))
        joints, joints_by_x = self.motions.at(instants, x)
        u = np.pad(joints, ((0, 0), (0, 2)))
        u_by_x = np.pad(joints_by_x, ((0, 0), (0, 2), (0, 0)))
        u[:, -2] = self.motions.momentum(x)
        u_by_x[:, -2] = self.motions.h_by_x
        rates, rates_by_u = self.dynamics.base_rate(u[:NODES])
        integrals = self.problem.flight.duration * QUADRATURE.integrals(instants)
        u[:, -1] = self.problem.initial.orientation + integrals @ rates[:, 0]
        u_by_x[:, -1] = integrals @ (rates_by_u @ u_by_x[:NODES])[:, 0]
        return u, u_by_x

    def evaluate(self, x: Array, instants: Array) -> Evaluation:
        """Values and derivatives at x (m,): the first two rows are what (14) misses, with either sign.

        The others are the inequalities at one of the instants (N,) of [0, 1] after the other.
        """
        to_landing = np.append(instants, 1.0)
        u, u_by_x = self.states(x, to_landing)
        missed = u[-1:, -1] - self.problem.final.orientation
        missed_by_x = u_by_x[-1:, -1]
        left, left_by_u = self.rows(to_landing, u[NODES:])
        left_by_x = left_by_u @ u_by_x[NODES:]
        residuals, J = self.residuals(x, u[:NODES], u_by_x[:NODES])
        return Evaluation(
            objective=float(residuals @ residuals) / 2,
            gradient=J.T @ residuals,
            hessian=J.T @ J,
            rows=np.concatenate((missed, -missed, left[:-1].ravel() - EPSILON)),
            rows_by_x=np.concatenate((missed_by_x, -missed_by_x, *left_by_x[:-1])),
        )

    def residuals(self, x: Array, u: Array, u_by_x: Array) -> tuple[Array, Array]:
        """The b of (17), or what is integrated at the nodes, so that half the sum of squares is the integral."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            return self.motions.b(x)
        values, by_u = self.dynamics.quantity(quantity, u)
        weights = np.sqrt(2 * self.problem.flight.duration * QUADRATURE.weights)[:, None]
        return (weights * values).ravel(), np.concatenate(weights[..., None] * (by_u @ u_by_x))

    def inequalities(self, x: Array, instants: Array) -> Array:
        """What the inequalities leave (N, r) at instants (N,) of [0, 1]."""
        return self.rows(instants, self.states(x, instants)[0][NODES:])[0]

    def rows(self, s: Array, u: Array) -> tuple[Array, Array]:
        """Inequalities (N, r) at instants s (N,) of [0, 1] and their derivatives (N, r, 3n+2) by the states.

        They are the shares of limits that are left, with either sign, and clearances (23), in LENGTH_SCALE.
        """
        rows = [(np.zeros((len(u), 0)), np.zeros((len(u), 0, u.shape[1])))]
        for shares in self.problem.limit_shares:
            for name, weights in shares.used.items():
                values, by_u = self.dynamics.quantity(name, u)
                rows += [(1 - values @ weights.T, -weights @ by_u), (1 + values @ weights.T, weights @ by_u)]
        for obstacle in self.problem.obstacles:
            distances, by_u = self.distances(obstacle, s * self.problem.flight.duration, u)
            rows.append(((distances - obstacle.margin) / LENGTH_SCALE, by_u / LENGTH_SCALE))
        of_all, of_all_by_u = zip(*rows, strict=True)
        return np.concatenate(of_all, axis=1), np.concatenate(of_all_by_u, axis=1)

    def distances(self, obstacle: Obstacle, t: Array, u: Array) -> tuple[Array, Array]:
        """Distances (19) of capsules, m, at times t (N,) s: of the nearest points (22), which small changes leave.

        The path of the centre of mass is (2), (3), (6); a half-plane is as near as a capsule's ends.
        """
        shapes = planar_flight(self.problem).link_shapes
        ends, by_u = self.dynamics.points(u, np.concatenate(shapes.weights))
        com = self.problem.path.positions(t) - np.outer(t, obstacle.velocity)
        ends = ends + com @ [[1], [1j]]
        if isinstance(obstacle, HalfPlane):
            ends = ends - complex(*obstacle.point)
            down = complex(*obstacle.normal).conjugate() / abs(complex(*obstacle.normal))
            return (down * ends).real - np.tile(shapes.radius, 2), (down * by_u).real
        assert isinstance(obstacle, Circle), "others are refused"
        start, end = np.split(ends - complex(*obstacle.center), 2, axis=1)
        start_by_u, end_by_u = np.split(by_u, 2, axis=1)
        along = end - start
        share = np.clip(-(along.conj() * start).real / np.maximum(np.abs(along) ** 2, np.finfo(float).tiny), 0, 1)
        away = start + share * along
        away_by_u = start_by_u + share[..., None] * (end_by_u - start_by_u)
        distance = np.abs(away)
        return distance - shapes.radius - obstacle.radius, ((away.conj() / distance)[..., None] * away_by_u).real
