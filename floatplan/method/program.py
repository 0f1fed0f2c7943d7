"""The nonlinear program of a flight at some instants: (17), subject to (14), (23) and the limits of the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.method.clearance import Segments, obstacle_distances, segment_distances
from floatplan.method.dynamics import Dynamics, Points, Quantity
from floatplan.method.motion import Motions
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Ground
from floatplan.problem.problem import Problem, shares_of_limits
from floatplan.tables import OBJECTIVE_TABLE

LENGTH_SCALE = 0.1  # [m] of clearance count as much as the whole of a torque or rate limit
LONGEST_STEP = 0.5  # [rad] of p, to which the program's linearisation is trusted
BACK_OFF = 2e-7  # [-] of its scale, by which a row is kept: the plan then holds between the instants too


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The program at a point x (m,): minimise ``|residuals|^2 / 2`` where ``missed = 0`` and ``rows >= 0``.

    ``residuals`` (k,) and their derivatives (k, m); ``missed`` (1,), by how much (14) fails, rad; ``rows`` (r,).
    """

    residuals: Array
    residuals_jacobian: Array
    missed: Array
    missed_jacobian: Array
    rows: Array
    rows_jacobian: Array

    @property
    def objective(self) -> float:
        """Half the square of the residuals."""
        return float(self.residuals @ self.residuals) / 2

    @property
    def gradient(self) -> Array:
        """Of the objective, (m,)."""
        return self.residuals_jacobian.T @ self.residuals

    @property
    def violation(self) -> float:
        """Sum of what the constraints lack."""
        return float(np.abs(self.missed).sum() - np.minimum(self.rows, 0).sum())


class Program:
    """A problem on one branch of the arcsine; ``x = (w, eta)``, and h is free where it has an eta.

    Attributes
    ----------
    momentum, reach : kg m^2/s
        h is ``momentum + reach eta``; a reach of 0 where h is given.
    nodes : int
        Of the Gauss-Legendre quadrature of (18).
    instants : (a,)
        Of [0, 1], at which rows hold in addition to the nodes.
    """

    def __init__(self, problem: Problem, motions: Motions, momentum: float, reach: float, nodes: int) -> None:
        robot = problem.robot
        self.problem, self.motions, self.momentum, self.reach = problem, motions, momentum, reach
        self.quadrature = gauss_legendre(nodes)
        self.instants = np.zeros(0)
        self.dynamics = Dynamics(robot)
        self.objective = OBJECTIVE_TABLE[problem.motion.objective].quantity
        self.limits = list(shares_of_limits(problem))
        self.obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        has_shapes = self.obstacles or problem.self_clearances
        self.capsules = robot.shapes if has_shapes else ()
        self.hulls = problem.ground_shapes if problem.ground else ()
        self.points = Points.of_capsules(self.dynamics, robot, (*self.capsules, *self.hulls))
        self.radius = np.array([shape.radius for shape in (*self.capsules, *self.hulls)])
        self.path_of_com()

    @property
    def size(self) -> int:
        """Number m of variables."""
        return self.motions.size + (self.reach > 0)

    def step_size(self, step: Array) -> float:
        """Length of a step (m,): 1 where the root mean square of p changes by ``LONGEST_STEP``."""
        change = self.motions.by_variables @ step[: self.motions.size]
        return float(np.linalg.norm(change)) / LONGEST_STEP

    def with_nodes(self, nodes: int) -> Program:
        """Return the same program with another number of nodes."""
        other = Program(self.problem, self.motions, self.momentum, self.reach, nodes)
        other.instants = self.instants
        return other

    def values_of_rows(self, s: Array, x: Array) -> Array:
        """Inequalities (N, r) at instants s (N,) of [0, 1]."""
        u, by_x = self.states(x, s)
        nodes = len(self.quadrature.nodes)
        return self.rows(s, u[nodes:], by_x[nodes:])[0]

    def path_of_com(self) -> None:
        """Place and velocity at takeoff (2,) of the centre of mass: (2), (3), (6), m and m/s."""
        problem, flight = self.problem, self.problem.flight
        ends = []
        for state, frame in ((problem.initial, problem.takeoff_frame), (problem.final, problem.landing_frame)):
            u = np.concatenate((state.positions, np.zeros(2 * len(state.positions) + 1), [state.orientation]))
            ends.append(Points.of_frame(self.dynamics, problem.robot, frame).from_com(u)[0][0])
        takeoff, landing = ends
        self.com = complex(*problem.takeoff.place_in_plane) - takeoff
        rise = (problem.landing_height - (landing + self.com).imag) / flight.duration
        self.com_velocity = complex(flight.speed_in_plane, rise + flight.gravity * flight.duration / 2)

    def states(self, x: Array, s: Array) -> tuple[Array, Array]:
        """States u (N, 3n+2) at instants s (N,), and their derivatives (N, 3n+2, m); theta_0 by (18)."""
        nodes = self.quadrature.nodes
        every = np.concatenate((nodes, s))
        w = x[: self.motions.size]
        joints, joints_by_w = self.motions.at(every, w)
        h = self.momentum + self.reach * float(x[self.motions.size :].sum())
        u = np.hstack((joints, np.full((len(every), 1), h), np.zeros((len(every), 1))))
        by_x = np.zeros((*u.shape, self.size))
        by_x[:, :-2, : self.motions.size] = joints_by_w
        by_x[:, -2, self.motions.size :] = self.reach
        rates = [self.dynamics.base_rate(u[k]) for k in range(len(nodes))]
        rate = np.array([quantity.values[0] for quantity in rates])
        rate_by_x = np.array([(quantity.jacobian @ by_x[k])[0] for k, quantity in enumerate(rates)])
        integrals = self.motions.duration * self.quadrature.integrals(every)
        u[:, -1] = self.problem.initial.orientation + integrals @ rate
        by_x[:, -1] = integrals @ rate_by_x
        return u, by_x

    def evaluate(self, x: Array) -> Evaluation:
        """Values and derivatives of all that the program holds, at x (m,)."""
        s = np.concatenate((self.quadrature.nodes, self.instants))
        u, by_x = self.states(x, np.concatenate((self.instants, [1.0])))
        missed = u[-1:, -1] - self.problem.final.orientation
        rows, rows_by_x = self.rows(s, u[:-1], by_x[:-1])
        residuals, residuals_by_x = self.residuals(x, u, by_x)
        rows_by_x = rows_by_x.reshape(-1, self.size)
        return Evaluation(residuals, residuals_by_x, missed, by_x[-1:, -1], rows.ravel(), rows_by_x)

    def residuals(self, x: Array, u: Array, by_x: Array) -> tuple[Array, Array]:
        """w of (17); or what is integrated, at the nodes, weighted so that the sum of squares is its integral."""
        if self.objective is None:
            return x[: self.motions.size], np.eye(self.motions.size, self.size)
        weights = np.sqrt(2 * self.motions.duration * self.quadrature.weights)
        values, jacobians = [], []
        for k, weight in enumerate(weights):
            quantity = self.quantities(u[k])[self.objective]
            values.append(weight * quantity.values)
            jacobians.append(weight * quantity.jacobian @ by_x[k])
        return np.concatenate(values), np.concatenate(jacobians)

    def quantities(self, u: Array) -> dict[str, Quantity]:
        """What objectives and limits are about, at a state."""
        n = self.dynamics.joints
        forces = self.dynamics.forces(u)
        selection = self.dynamics.selection.T
        transmission = self.problem.robot.transmission.T
        unit = np.eye(len(u))
        return {
            "velocities": Quantity(u[n : 2 * n], unit[n : 2 * n]),
            "accelerations": Quantity(u[2 * n : 3 * n], unit[2 * n : 3 * n]),
            "orientation_rate": self.dynamics.base_rate(u),
            "torques": Quantity(selection @ forces.values, selection @ forces.jacobian),
            "motor_torques": Quantity(transmission @ forces.values, transmission @ forces.jacobian),
        }

    def rows(self, s: Array, u: Array, by_x: Array) -> tuple[Array, Array]:
        """Inequalities (N, r) at states u (N, 3n+2), to be kept at zero or above, and their derivatives (N, r, m)."""
        values, jacobians = [], []
        for k, instant in enumerate(s):
            time = float(instant * self.motions.duration)
            parts = [*self.limit_rows(u[k]), *self.clearance_rows(u[k], time)]
            values.append(np.concatenate([np.zeros(0), *(part.values for part in parts)]) - BACK_OFF)
            empty = np.zeros((0, u.shape[1]))
            jacobians.append(np.concatenate([empty, *(part.jacobian for part in parts)]) @ by_x[k])
        return np.array(values), np.array(jacobians)

    def limit_rows(self, u: Array) -> Sequence[Quantity]:
        """What is left of the limits, as shares of them."""
        rows = []
        known = self.quantities(u) if self.limits else {}
        for limit in self.limits:
            signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)] if limit.also else [(1, 0), (-1, 0)]
            for own, also in signs:
                weighted = [(own, name, weights) for name, weights in limit.used.items()]
                weighted += [(also, name, weights) for name, weights in limit.also.items()]
                used = sum(sign * weights @ known[name].values for sign, name, weights in weighted)
                by_u = sum(sign * weights @ known[name].jacobian for sign, name, weights in weighted)
                rows.append(Quantity(1 - used, -by_u))
        return rows

    def clearance_rows(self, u: Array, time: float) -> Sequence[Quantity]:
        """Distances (23) to obstacles, and between links that are to keep apart, less their margins."""
        if not self.radius.size:
            return []
        places, by_u = self.points.from_com(u)
        flight = self.problem.flight
        places = places + self.com + self.com_velocity * time - 0.5j * flight.gravity * time**2
        half = len(self.radius)
        segments = Segments(places[:half], places[half:], by_u[:half], by_u[half:])
        rows = []
        for obstacle in self.obstacles:
            first = len(self.capsules) if self.hulls and isinstance(obstacle, Ground) else 0
            facing = slice(first, half if first else len(self.capsules))
            distance, by_state = obstacle_distances(segments.of(facing), self.radius[facing], obstacle, time)
            low, high = obstacle.window or (0.0, math.inf)
            exists = 1.0 if low <= time <= high else 0.0
            slack = exists * (distance - obstacle.margin) + (1 - exists) * LENGTH_SCALE
            rows.append(Quantity(slack / LENGTH_SCALE, exists * by_state / LENGTH_SCALE))
        for pair in self.problem.self_clearances:
            owners = [[i for i, shape in enumerate(self.capsules) if shape.link == link] for link in pair.links]
            own, other = (side.ravel() for side in np.meshgrid(*owners, indexing="ij"))
            distance, by_state = segment_distances(segments.of(own), segments.of(other))
            slack = distance - self.radius[own] - self.radius[other] - pair.margin
            rows.append(Quantity(slack / LENGTH_SCALE, by_state / LENGTH_SCALE))
        return rows
