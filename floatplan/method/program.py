"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.method.dynamics import Dynamics, Quantity
from floatplan.method.motion import Motions
from floatplan.motion.flight import flight_of
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem, shares_of_limits
from floatplan.tables import OBJECTIVE_TABLE

QUADRATURE = gauss_legendre(96)  # of (14) and (18): exact to 1e-12 rad but for motions that nobody wants
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit
BACK_OFF = 2e-7  # [-] of these, by which the search keeps inside: its plan then holds between instants too


class Evaluation(NamedTuple):
    """At x (m,): minimise ``|residuals|^2 / 2`` where ``missed = 0`` and ``rows >= 0``; with derivatives by x."""

    residuals: Array
    residuals_by_x: Array
    missed: Array
    missed_by_x: Array
    rows: Array
    rows_by_x: Array

    @property
    def objective(self) -> float:
        """Half the square of the residuals."""
        return float(self.residuals @ self.residuals) / 2

    @property
    def gradient(self) -> Array:
        """Of the objective, (m,)."""
        return np.asarray(self.residuals_by_x.T @ self.residuals)

    @property
    def violation(self) -> float:
        """Sum of what the constraints lack."""
        return float(np.abs(self.missed).sum() - np.minimum(self.rows, 0).sum())


class Program:
    """A problem's flights on one branch of the arcsine: x is w and, where h is free, its share of ``reach``.

    Inequalities hold at ``instants`` of [0, 1]. Where a motion is given as ``near``, the objective is to stay near it.
    """

    def __init__(self, problem: Problem, motions: Motions, momentum: float, reach: float) -> None:
        self.problem = problem
        self.motions = motions
        self.momentum = momentum  # [kg m^2/s]
        self.reach = reach  # [kg m^2/s], 0 where h is given
        self.size = motions.size + (reach > 0)
        self.scale = np.eye(self.size)  # by which a unit of x is a root mean square of 1 rad of p
        self.scale[: motions.size, : motions.size] = motions.R
        self.dynamics = Dynamics(problem.robot)
        self.used = limit_shares(problem, self.dynamics)
        capsules = problem.robot.shapes if problem.obstacles else ()
        bodies = np.array([capsule.body for capsule in capsules], dtype=np.int64)
        ends = np.array([[capsule.start, capsule.end] for capsule in capsules], dtype=np.complex128)
        self.weights = problem.robot.tree.point_weights(np.tile(bodies, 2), ends.T.ravel())
        self.radius = np.array([capsule.radius for capsule in capsules])
        self.path = flight_of(problem).ballistics  # (2), (3), (6)
        self.instants = np.zeros(0)
        self.near: Array | None = None

    def angular_momentum(self, x: Array) -> float:
        """h, kg m^2/s."""
        return self.momentum + self.reach * float(x[self.motions.size :].sum())

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at the nodes, then at s, and their derivatives (N, 3n+2, m) by x; theta_0 by (18)."""
        instants = np.concatenate((QUADRATURE.nodes, s))
        joints, joints_by_x = self.motions.at(instants, x[: self.motions.size])
        u = np.zeros((len(instants), joints.shape[1] + 2))
        u_by_x = np.zeros((*u.shape, self.size))
        u[:, :-2] = joints
        u_by_x[:, :-2, : self.motions.size] = joints_by_x
        u[:, -2] = self.angular_momentum(x)
        u_by_x[:, -2, self.motions.size :] = self.reach
        rates = [self.dynamics.base_rate(state) for state in u[: len(QUADRATURE.nodes)]]
        integrals = self.motions.duration * QUADRATURE.integrals(instants)
        u[:, -1] = self.problem.initial.orientation + integrals @ [rate.values[0] for rate in rates]
        u_by_x[:, -1] = integrals @ [rate.jacobian[0] @ u_by_x[k] for k, rate in enumerate(rates)]
        return u, u_by_x

    def evaluate(self, x: Array) -> Evaluation:
        """Values and derivatives at x (m,)."""
        u, u_by_x = self.states(x, np.append(self.instants, 1.0))
        nodes = len(QUADRATURE.nodes)
        missed = u[-1:, -1] - self.problem.final.orientation  # (14)
        rows = [self.rows(s, state) for s, state in zip(self.instants, u[nodes:-1], strict=True)]
        values = np.array([row.values for row in rows]).ravel()
        jacobians = np.array([row.jacobian @ u_by_x[nodes + k] for k, row in enumerate(rows)])
        by_x = jacobians.reshape(len(values), self.size)
        return Evaluation(*self.residuals(x, u[:nodes], u_by_x[:nodes]), missed, u_by_x[-1:, -1], values, by_x)

    def residuals(self, x: Array, u: Array, u_by_x: Array) -> tuple[Array, Array]:
        """The w of (17), or what is integrated at the nodes, so that half the sum of squares is the integral."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if self.near is not None:
            to_near: Array = np.asarray(np.linalg.inv(self.scale), dtype=np.float64)
            return to_near @ (x - self.near), to_near
        if quantity is None:
            return x[: self.motions.size], np.eye(self.motions.size, self.size)
        weights = np.sqrt(2 * self.motions.duration * QUADRATURE.weights)[:, None]
        own = self.dynamics.quantity[quantity]
        parts = [self.dynamics.quantities(state) for state in u]
        values = weights * np.array([part.values[own] for part in parts])
        by_x = weights[:, None] * np.array([part.jacobian[own] @ u_by_x[k] for k, part in enumerate(parts)])
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
        if len(self.used):
            quantities = self.dynamics.quantities(u)
            parts.append(Quantity(1 - self.used @ quantities.values, -self.used @ quantities.jacobian))
        if len(self.radius):
            time = s * self.motions.duration
            places, places_by_u = self.dynamics.places(u, self.weights)
            places = places + complex(*self.path.positions(np.array([time]))[0])
            for obstacle in self.problem.obstacles:
                low, high = obstacle.window or (0.0, math.inf)
                seen = places - complex(*obstacle.velocity) * time
                distance, by_u = obstacle_distances(obstacle, seen, places_by_u, self.radius)
                slack = Quantity((distance - obstacle.margin) / LENGTH_SCALE, by_u / LENGTH_SCALE)
                parts.append(slack if low <= time <= high else Quantity(np.ones_like(distance), 0 * by_u))
        values = np.concatenate([part.values for part in parts]) - back_off(s)
        return Quantity(values, np.concatenate([part.jacobian for part in parts]))


def back_off(s: Any) -> Any:
    """What rows are kept free by, in their scales, at an instant of [0, 1]: as much as motions may change there."""
    return BACK_OFF * (4 * s * (1 - s)) ** 3


def limit_shares(problem: Problem, dynamics: Dynamics) -> Array:
    """The matrix (r, Q) from the dynamics' quantities to the shares of limits that they use, with either sign."""
    rows = [np.zeros((0, dynamics.count))]
    for limit in shares_of_limits(problem):
        for own, also in ((1, 1), (1, -1), (-1, 1), (-1, -1)) if limit.also else ((1, 0), (-1, 0)):
            row = np.zeros((len(limit.limit), dynamics.count))
            for sign, weights in ((own, limit.used), (also, limit.also)):
                for name, part in weights.items():
                    row[:, dynamics.quantity[name]] += sign * part
            rows.append(row)
    return np.concatenate(rows)


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
