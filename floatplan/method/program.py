"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from typing import NamedTuple

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.method.dynamics import QUANTITIES, Dynamics
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import planar_flight
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import SinePolynomials, basis, powers_map
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE

NODES = 96  # of (14) and (18): exact to 1e-12 rad but for motions that nobody wants
QUADRATURE = gauss_legendre(NODES)
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit


class Evaluation(NamedTuple):
    """At x: the objective, half a sum of squares; its gradient, Gauss's and Newton's Hessian; rows (r,), at least 0."""

    objective: float
    gradient: Array
    hessian: Array
    rows: Array
    rows_by_x: Array


class Program:
    """A problem's flights whose joints move as (12) between its ends, on one branch of the arcsine.

    There (13) are six linear equations for the polynomial of a joint, with s = t / T:
    ``p = Hermite polynomials of (13) + s^3 (1 - s)^3 sum_k z_k J_k(s)``, with J_k that make a unit of z_k a root mean
    square of 1 rad. The variables x (m,) are the z of all joints in one row, then what the angular momentum leaves.
    """

    def __init__(self, problem: Problem, degrees: IntArray, branch: IntArray) -> None:
        self.problem = problem
        self.dynamics = Dynamics(problem.robot)
        self.polynomials = SinePolynomials.between_ends(problem, (degrees + 1 - CONDITIONS).tolist(), branch)
        self.momenta = planar_flight(problem).momentum_set  # (7) to (10)
        self.joint, self.number = np.divmod(self.polynomials.free_indices, self.polynomials.width)  # of each z
        self.evaluations = 0
        self.size: int = len(self.joint) + self.momenta.axes.shape[1]

    def momentum(self, x: Array) -> Array:
        """The h (1, 1+m), kg m^2/s, of variables x (m, 1+m)."""
        h = self.momenta.axes @ x[len(self.joint) :]
        h[:, 0] += self.momenta.centre
        return np.asarray(h)

    def coefficients(self, x: Array) -> Array:
        """Of each joint's p (n, 6+width, 1+m): (13), then z of x (m, 1+m), zeros where its degree is lower."""
        coefficients = np.zeros((len(self.polynomials.free), CONDITIONS + self.polynomials.width, x.shape[1]))
        coefficients[:, :CONDITIONS, 0] = self.polynomials.boundary
        coefficients[self.joint, CONDITIONS + self.number] = x[: len(self.joint)]
        return coefficients

    def b(self, x: Array) -> Array:
        """The b (n, k+1, 1+m) of (12), powers of seconds, whose norm is least in (17)."""
        return np.asarray(powers_map(self.polynomials.form, self.polynomials.duration) @ self.coefficients(x))

    def joints(self, x: Array, s: Array) -> Array:
        """q, q', q'' (N, 3n, 1+m) of (12) at instants s (N,) of [0, 1]."""
        columns = basis(self.polynomials.form).values(s)
        coefficients = self.coefficients(x)
        motion = self.polynomials.motion(coefficients[:, CONDITIONS:, 0], columns)
        p = np.einsum("dsk,jkx->dsjx", columns, coefficients)  # and its derivatives by s
        joints = np.einsum("cdsj,dsjx->scjx", motion.slopes, p)
        joints[..., 0] = np.stack((motion.positions, motion.velocities, motion.accelerations), axis=1)
        return np.asarray(joints.reshape(len(s), -1, x.shape[1]))

    def states(self, x: Array, s: Array) -> Array:
        """States u (N, 3n+2, 1+m) at the nodes, then at s; theta_0 by (18)."""
        instants = np.concatenate((QUADRATURE.nodes, s))
        u = np.pad(self.joints(x, instants), ((0, 0), (0, 2), (0, 0)))
        u[:, -2] = self.momentum(x)
        rates = self.dynamics.rates(u[:NODES])
        u[:, -1] = self.problem.flight.duration * QUADRATURE.integrals(instants) @ rates[:, 0]
        u[:, -1, 0] += self.problem.initial.orientation
        return u

    def evaluate(self, x: Array, instants: Array) -> Evaluation:
        """At x (m,): the first two rows are what (14) misses, with either sign, then inequalities at instants (N,)."""
        self.evaluations += 1
        variables = np.column_stack((x, np.eye(len(x))))
        one = np.eye(1, variables.shape[1])[0]
        to_landing = np.append(instants, 1.0)
        u = self.states(variables, to_landing)
        missed = u[-1:, -1] - self.problem.final.orientation * one
        left = self.rows(u[NODES:], to_landing)[:-1] - 2e-7 * one  # the paper's epsilon, for what is between
        rows = np.concatenate((missed, -missed, *left))
        residuals = self.residuals(variables, u[:NODES])
        squares = residuals.T @ residuals
        return Evaluation(squares[0, 0] / 2, squares[0, 1:], squares[1:, 1:], rows[:, 0], rows[:, 1:])

    def residuals(self, x: Array, u: Array) -> Array:
        """The b of (17), or what is integrated at the nodes, so that half the sum of squares is the integral."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            return np.concatenate(self.b(x))
        weights = np.sqrt(2 * self.problem.flight.duration * QUADRATURE.weights)[:, None, None]
        return np.concatenate(weights * QUANTITIES[quantity](self.dynamics, u))

    def inequalities(self, x: Array, s: Array) -> Array:
        """What the inequalities leave (N, r) at instants s (N,) of [0, 1] at x (m,)."""
        return self.rows(self.states(x[:, None], s)[NODES:], s)[..., 0]

    def rows(self, u: Array, s: Array) -> Array:
        """Inequalities (N, r, 1+m): shares of limits that are left, with either sign; clearances (23)."""
        one = np.eye(1, u.shape[2])[0]
        rows = [np.zeros((len(u), 0, len(one)))]
        for shares in self.problem.limit_shares:
            for name, weights in shares.used.items():
                share = weights @ QUANTITIES[name](self.dynamics, u)
                rows += [one - share, one + share]
        for obstacle in self.problem.obstacles:
            rows.append(self.distances(obstacle, u, s * self.problem.flight.duration) / LENGTH_SCALE)
        return np.concatenate(rows, axis=1)

    def distances(self, obstacle: Obstacle, u: Array, t: Array) -> Array:
        """Distances (19) less the margin (23) of capsules (N, r, 1+m), m, at times t (N,) on the path (2), (3), (6)."""
        shapes = planar_flight(self.problem).link_shapes
        com = self.problem.path.positions(t) - np.outer(t, obstacle.velocity)
        points = self.dynamics.points(u, np.concatenate(shapes.weights))
        points[..., 0] += com @ [[1], [1j]]
        if isinstance(obstacle, HalfPlane):
            points[..., 0] -= complex(*obstacle.point)
            direction = np.array(complex(*obstacle.normal))
            thickness = np.tile(shapes.radius, 2)  # of both ends
        else:
            assert isinstance(obstacle, Circle), "others are refused"
            points[..., 0] -= complex(*obstacle.center)
            start, end = np.split(points, 2, axis=1)
            along = end[..., :1] - start[..., :1]
            length2 = np.maximum(np.abs(along) ** 2, np.finfo(float).tiny)
            share = np.clip(-(along.conj() * start[..., :1]).real / length2, 0, 1)
            points = start + share * (end - start)  # the nearest ones (22): others nearby are as far, to first order
            direction = points[..., :1]
            thickness = shapes.radius + obstacle.radius
        distances = (direction.conj() / np.abs(direction) * points).real
        distances[..., 0] -= thickness + obstacle.margin
        return np.asarray(distances)
