"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.method.dynamics import Dynamics, Quantity
from floatplan.method.motion import Motions
from floatplan.motion.flight import ballistics
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem, shares_of_limits
from floatplan.tables import OBJECTIVE_TABLE

QUADRATURE = gauss_legendre(96)  # of (14) and (18): exact to 1e-12 rad but for motions that nobody wants
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit
BACK_OFF = 2e-7  # [-] of these, by which the search keeps inside: its plan then holds between instants too
LONGEST_STEP = 0.5  # [rad] root mean square of p, for which a linearisation is trusted


@dataclass(frozen=True, eq=False)
class Evaluation:
    """At x (m,): minimise ``|residuals|^2 / 2`` where ``missed = 0``, ``rows >= 0``; J are derivatives by x."""

    residuals: Array
    residuals_J: Array
    missed: Array
    missed_J: Array
    rows: Array
    rows_J: Array

    @property
    def objective(self) -> float:
        """Half the square of the residuals."""
        return float(self.residuals @ self.residuals) / 2

    @cached_property
    def gradient(self) -> Array:
        """Of the objective, (m,)."""
        return np.asarray(self.residuals_J.T @ self.residuals)

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
        self.limits = list(shares_of_limits(problem))
        capsules = problem.robot.shapes if problem.obstacles else ()
        bodies = np.array([capsule.body for capsule in capsules], dtype=np.int64)
        ends = np.array([[capsule.start, capsule.end] for capsule in capsules], dtype=np.complex128)
        self.weights = problem.robot.tree.point_weights(np.tile(bodies, 2), ends.T.ravel())
        self.radius = np.array([capsule.radius for capsule in capsules])
        self.path = ballistics(problem)  # (2), (3), (6)
        self.instants = np.zeros(0)
        self.near: Array | None = None

    def angular_momentum(self, x: Array) -> float:
        """h, kg m^2/s."""
        return self.momentum + self.reach * float(x[self.motions.size :].sum())

    def step_size(self, step: Array) -> float:
        """Length of a step (m,), of which 1 is trusted."""
        return float(np.linalg.norm(np.linalg.solve(self.scale, step))) / LONGEST_STEP

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at the nodes, then at s, and their derivatives (N, 3n+2, m) by x; theta_0 by (18)."""
        instants = np.concatenate((QUADRATURE.nodes, s))
        joints, joints_J = self.motions.at(instants, x[: self.motions.size])
        u = np.zeros((len(instants), joints.shape[1] + 2))
        u_J = np.zeros((*u.shape, self.size))
        u[:, :-2] = joints
        u_J[:, :-2, : self.motions.size] = joints_J
        u[:, -2] = self.angular_momentum(x)
        u_J[:, -2, self.motions.size :] = self.reach
        rates = [self.dynamics.base_rate(state) for state in u[: len(QUADRATURE.nodes)]]
        integrals = self.motions.duration * QUADRATURE.integrals(instants)
        u[:, -1] = self.problem.initial.orientation + integrals @ [rate.values[0] for rate in rates]
        u_J[:, -1] = integrals @ [rate.jacobian[0] @ u_J[k] for k, rate in enumerate(rates)]
        return u, u_J

    def evaluate(self, x: Array) -> Evaluation:
        """Values and derivatives at x (m,)."""
        u, u_J = self.states(x, np.append(self.instants, 1.0))
        nodes = len(QUADRATURE.nodes)
        missed = u[-1:, -1] - self.problem.final.orientation  # (14)
        rows = [self.rows(s, state) for s, state in zip(self.instants, u[nodes:-1], strict=True)]
        values = np.array([row.values for row in rows]).ravel()
        values_J = np.array([row.jacobian @ u_J[nodes + k] for k, row in enumerate(rows)]).reshape(-1, self.size)
        return Evaluation(*self.residuals(x, u[:nodes], u_J[:nodes]), missed, u_J[-1:, -1], values, values_J)

    def rows_at(self, instants: Array, x: Array) -> Array:
        """Inequalities (N, r) at instants (N,) of [0, 1]."""
        u = self.states(x, instants)[0][len(QUADRATURE.nodes) :]
        return np.array([self.rows(s, state).values for s, state in zip(instants, u, strict=True)])

    def residuals(self, x: Array, u: Array, u_J: Array) -> tuple[Array, Array]:
        """The w of (17), or what is integrated at the nodes, so that half the sum of squares is the integral."""
        if self.near is not None:
            to_near = np.linalg.inv(self.scale)
            return to_near @ (x - self.near), to_near
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            return x[: self.motions.size], np.eye(self.motions.size, self.size)
        weights = np.sqrt(2 * self.motions.duration * QUADRATURE.weights)
        parts = [self.quantities(state)[quantity] for state in u]
        values = np.concatenate([weight * part.values for weight, part in zip(weights, parts, strict=True)])
        jacobians = [weights[k] * part.jacobian @ u_J[k] for k, part in enumerate(parts)]
        return values, np.concatenate(jacobians)

    def quantities(self, u: Array) -> dict[str, Quantity]:
        """What objectives and limits are about, at a state."""
        n = self.dynamics.n
        unit = np.eye(len(u))
        torques = self.dynamics.torques(u)
        robot = self.problem.robot
        return {
            "velocities": Quantity(u[n : 2 * n], unit[n : 2 * n]),
            "accelerations": Quantity(u[2 * n : 3 * n], unit[2 * n : 3 * n]),
            "orientation_rate": self.dynamics.base_rate(u),
            "torques": Quantity(*(robot.selection.T @ part for part in torques)),
            "motor_torques": Quantity(*(robot.transmission.T @ part for part in torques)),
        }

    def rows(self, s: float, u: Array) -> Quantity:
        """Inequalities (r,) at an instant s of [0, 1], less what is kept free."""
        parts = [Quantity(np.zeros(0), np.zeros((0, len(u)))), *self.limits_left(u), *self.clearances(s, u)]
        values = np.concatenate([part.values for part in parts])
        return Quantity(values - back_off(s), np.concatenate([part.jacobian for part in parts]))

    def limits_left(self, u: Array) -> Iterator[Quantity]:
        """What is left of each limit, as a share of it."""
        quantities = self.quantities(u) if self.limits else {}
        for limit in self.limits:
            for own, also in ((1, 1), (1, -1), (-1, 1), (-1, -1)) if limit.also else ((1, 0), (-1, 0)):
                used = [(own, *item) for item in limit.used.items()] + [(also, *item) for item in limit.also.items()]
                share = sum(sign * weights @ quantities[name].values for sign, name, weights in used)
                share_J = sum(sign * weights @ quantities[name].jacobian for sign, name, weights in used)
                yield Quantity(1 - share, -share_J)

    def clearances(self, s: float, u: Array) -> Iterator[Quantity]:
        """(23): distances of all links to each obstacle that is there, less its margin, in ``LENGTH_SCALE``."""
        time = s * self.motions.duration
        com = complex(*self.path.positions(np.array([time]))[0])
        places, places_J = self.dynamics.places(u, self.weights)
        for obstacle in self.problem.obstacles:
            low, high = obstacle.window or (0.0, math.inf)
            seen = places + com - complex(*obstacle.velocity) * time
            distance, distance_J = obstacle_distances(obstacle, seen, places_J, self.radius)
            slack = Quantity((distance - obstacle.margin) / LENGTH_SCALE, distance_J / LENGTH_SCALE)
            yield slack if low <= time <= high else Quantity(np.ones_like(distance), 0 * distance_J)


def back_off(s: Any) -> Any:
    """What rows are kept free by, in their scales, at instants of [0, 1]: as much as motions may change there."""
    return BACK_OFF * (4 * s * (1 - s)) ** 3


def obstacle_distances(obstacle: Obstacle, ends: ComplexArray, ends_J: ComplexArray, radius: Array) -> Quantity:
    """Distances (19) of capsules from their ends, m: at the nearest u of (22), a small change of which changes none."""
    if isinstance(obstacle, HalfPlane):
        normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
        height = (normal.conjugate() * (ends - complex(*obstacle.point))).real
        return Quantity(height - np.tile(radius, 2), (normal.conjugate() * ends_J).real)
    assert isinstance(obstacle, Circle), "others are refused"
    start, end = np.split(ends, 2)
    start_J, end_J = np.split(ends_J, 2)
    along = end - start
    reached = (along.conj() * (complex(*obstacle.center) - start)).real
    u = np.clip(reached / np.maximum(np.abs(along) ** 2, np.finfo(float).tiny), 0, 1)
    away = start + u * along - complex(*obstacle.center)
    nearest_J = (1 - u)[:, None] * start_J + u[:, None] * end_J
    distance_J = ((away.conj() / np.abs(away))[:, None] * nearest_J).real
    return Quantity(np.abs(away) - radius - obstacle.radius, distance_J)
