"""The nonlinear program of a flight: (17), or another objective, subject to (14), (23) and the robot's limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.method.dynamics import Dynamics, Quantity
from floatplan.method.motion import Motions
from floatplan.motion.flight import ballistics
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Problem, shares_of_limits
from floatplan.tables import OBJECTIVE_TABLE

LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a limit
BACK_OFF = 2e-7  # [-] of these, by which the search keeps inside: its plan then holds between instants too
INSTANTS = 65  # of [0, 1], equally apart: inequalities hold at these, and at those that are added
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

    @property
    def gradient(self) -> Array:
        """Of the objective, (m,)."""
        return np.asarray(self.residuals_J.T @ self.residuals)

    @property
    def violation(self) -> float:
        """Sum of what the constraints lack."""
        return float(np.abs(self.missed).sum() - np.minimum(self.rows, 0).sum())

    @property
    def squared_violation(self) -> float:
        """Sum of the squares of that."""
        return float((self.missed**2).sum() + (np.minimum(self.rows, 0) ** 2).sum())


class Program:
    """A problem's flights on one branch of the arcsine: x is w, and where h is free its share of ``reach`` too.

    Inequalities hold at ``instants`` of [0, 1]; (18) is by Gauss-Legendre quadrature with so many ``nodes``.
    """

    def __init__(self, problem: Problem, motions: Motions, momentum: float, reach: float, nodes: int) -> None:
        self.problem = problem
        self.motions = motions
        self.momentum = momentum  # [kg m^2/s]
        self.reach = reach  # [kg m^2/s], 0 where h is given
        self.size = motions.size + (reach > 0)
        self.quadrature = gauss_legendre(nodes)
        self.limits = list(shares_of_limits(problem))
        self.scale = np.eye(self.size)  # by which a unit of x is a root mean square of 1 rad of p
        self.scale[: motions.size, : motions.size] = motions.R
        self.capsules = problem.robot.shapes if problem.obstacles else ()
        self.radius = np.array([capsule.radius for capsule in self.capsules])
        self.dynamics = Dynamics(problem.robot, self.capsules)
        self.path = ballistics(problem)  # (2), (3), (6)
        self.instants = np.zeros(0)

    def angular_momentum(self, x: Array) -> float:
        """h, kg m^2/s."""
        return self.momentum + self.reach * float(x[self.motions.size :].sum())

    def with_nodes(self, nodes: int) -> Program:
        """Return the same program with another number of nodes, and the instants as they were."""
        other = Program(self.problem, self.motions, self.momentum, self.reach, nodes)
        other.instants = self.instants
        return other

    def rows_at(self, s: Array, x: Array) -> Array:
        """Inequalities (N, r) at instants s (N,) of [0, 1]."""
        u, u_J = self.states(x, s)
        nodes = len(self.quadrature.nodes)
        return self.rows(s, u[nodes:], u_J[nodes:])[0]

    def step_size(self, step: Array) -> float:
        """Length of a step (m,), of which 1 is trusted."""
        return float(np.linalg.norm(self.motions.by_w @ step[: self.motions.size])) / LONGEST_STEP

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at the nodes, then at s, and their derivatives (N, 3n+2, m) by x; theta_0 by (18)."""
        instants = np.concatenate((self.quadrature.nodes, s))
        joints, joints_J = self.motions.at(instants, x[: self.motions.size])
        u = np.zeros((len(instants), joints.shape[1] + 2))
        u_J = np.zeros((*u.shape, self.size))
        u[:, :-2] = joints
        u_J[:, :-2, : self.motions.size] = joints_J
        u[:, -2] = self.angular_momentum(x)
        u_J[:, -2, self.motions.size :] = self.reach
        nodes = len(self.quadrature.nodes)
        rates = [self.dynamics.base_rate(state) for state in u[:nodes]]
        integrals = self.motions.polynomials.duration * self.quadrature.integrals(instants)
        u[:, -1] = self.problem.initial.orientation + integrals @ [rate.values[0] for rate in rates]
        u_J[:, -1] = integrals @ [rate.jacobian[0] @ u_J[k] for k, rate in enumerate(rates)]
        return u, u_J

    def evaluate(self, x: Array) -> Evaluation:
        """Values and derivatives at x (m,)."""
        u, u_J = self.states(x, np.append(self.instants, 1.0))
        nodes = len(self.quadrature.nodes)
        missed = u[-1:, -1] - self.problem.final.orientation  # (14)
        rows, rows_J = self.rows(self.instants, u[nodes:-1], u_J[nodes:-1])
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if quantity is None:
            residuals, residuals_J = x[: self.motions.size], np.eye(self.motions.size, self.size)
        else:
            integrated = [self.quantities(state)[quantity] for state in u[:nodes]]
            weights = np.sqrt(2 * self.motions.polynomials.duration * self.quadrature.weights)
            residuals = np.concatenate([weights[k] * part.values for k, part in enumerate(integrated)])
            residuals_J = np.concatenate([weights[k] * part.jacobian @ u_J[k] for k, part in enumerate(integrated)])
        return Evaluation(residuals, residuals_J, missed, u_J[-1:, -1], rows.ravel(), rows_J.reshape(-1, self.size))

    def rows(self, s: Array, u: Array, u_J: Array) -> tuple[Array, Array]:
        """Inequalities (N, r) at states (N, 3n+2), and their derivatives (N, r, m) by x."""
        count, width = u.shape
        parts = [[*self.limits_left(u[k]), *self.clearances(u[k], s[k])] for k in range(count)]
        values = [np.concatenate([np.zeros(0), *(part.values for part in row)]) - BACK_OFF for row in parts]
        by_u = [np.concatenate([np.zeros((0, width)), *(part.jacobian for part in row)]) for row in parts]
        return np.array(values), np.array([by_u[k] @ u_J[k] for k in range(count)])

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

    def limits_left(self, u: Array) -> Sequence[Quantity]:
        """What is left of each limit, as a share of it."""
        rows = []
        quantities = self.quantities(u) if self.limits else {}
        for limit in self.limits:
            for own, also in ((1, 1), (1, -1), (-1, 1), (-1, -1)) if limit.also else ((1, 0), (-1, 0)):
                used = [(own, *item) for item in limit.used.items()] + [(also, *item) for item in limit.also.items()]
                share = sum(sign * weights @ quantities[name].values for sign, name, weights in used)
                share_J = sum(sign * weights @ quantities[name].jacobian for sign, name, weights in used)
                rows.append(Quantity(1 - share, -share_J))
        return rows

    def clearances(self, u: Array, s: float) -> Sequence[Quantity]:
        """(23): distances of all links to each obstacle that is there, less its margin, in ``LENGTH_SCALE``."""
        rows = []
        time = s * self.motions.polynomials.duration
        places, places_J = self.dynamics.places(u) if self.capsules else (np.zeros(0), np.zeros((0, len(u))))
        places = places + complex(*self.path.positions(np.array([time]))[0])
        for obstacle in self.problem.obstacles:
            low, high = obstacle.window or (0.0, math.inf)
            shift = complex(*obstacle.velocity) * time
            distance, distance_J = obstacle_distances(obstacle, places - shift, places_J, self.radius)
            slack = (distance - obstacle.margin) / LENGTH_SCALE
            there = Quantity(slack, distance_J / LENGTH_SCALE)
            rows.append(there if low <= time <= high else Quantity(np.ones_like(slack), 0 * distance_J))
        return rows


def obstacle_distances(obstacle: Obstacle, ends: ComplexArray, ends_J: ComplexArray, radius: Array) -> Quantity:
    """Distances (19) of S capsules from their ends (2S,), m: at the u of (22) that is nearest, found without a grid.

    There a small change of u changes no distance. Of a half-plane both ends count.
    """
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
    distance = np.abs(away)
    nearest_J = (1 - u)[:, None] * start_J + u[:, None] * end_J
    distance_J = ((away.conj() / distance)[:, None] * nearest_J).real
    return Quantity(distance - radius - obstacle.radius, distance_J)
