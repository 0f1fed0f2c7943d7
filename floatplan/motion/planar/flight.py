"""Flight in a plane as search and constraints see it, see :mod:`floatplan.motion.dynamics`: e = 1.

The orientation is a quadrature, (14) and (18), of the rate theta0' of (4); nothing that drifts is carried on. All
derivatives are the kernel's.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.kernel.tolerances import SETTINGS
from floatplan.motion.dynamics import FlightGrid, MomentumSet
from floatplan.motion.planar import clearance
from floatplan.motion.planar.bounds import angular_momentum_interval, inertia_extremes, momentum_asked
from floatplan.motion.planar.clearance import LinkShapes, Segments
from floatplan.motion.planar.closed_form import Ballistics, Dynamics, ballistics, tree_dynamics
from floatplan.motion.quadrature import NODE_COUNTS, GaussLegendre, gauss_legendre
from floatplan.motion.sine_polynomial import JointMotion
from floatplan.problem.parts import Ground, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import LinkCapsule, Robot

TINY = 1e-300  # keeps a quotient of zeros from being none


@dataclass(frozen=True, eq=False)
class GaussGrid:
    """Gauss-Legendre nodes, then other instants; ``integrals`` (K, N) over [0, s] from values at the nodes."""

    quadrature: GaussLegendre
    s: Array
    integrals: Array

    @cached_property
    def nodes(self) -> int:
        """Number N of nodes."""
        return len(self.quadrature.nodes)

    @property
    def weights(self) -> Array:
        """Quadrature weights (N,)."""
        return self.quadrature.weights

    def also(self, instants: Array) -> GaussGrid:
        """Return the grid with more instants."""
        return GaussGrid(
            self.quadrature,
            np.concatenate((self.s, instants)),
            np.concatenate((self.integrals, self.quadrature.integrals(instants))),
        )


@lru_cache(maxsize=32)
def gauss_grid(count: int) -> GaussGrid:
    """Return the grid of ``count`` nodes alone."""
    quadrature = gauss_legendre(count)
    return GaussGrid(quadrature, quadrature.nodes, quadrature.integrals(quadrature.nodes))


@dataclass(frozen=True, eq=False)
class PlanarFlight:
    """What a problem fixes of every motion in its plane; orientations and their change in rad, the duration in s."""

    tree: PlanarTree
    equations: Dynamics
    link_shapes: LinkShapes
    ballistics: Ballistics
    initial_orientation: float
    final_orientation: float
    duration: float
    change: float
    tangent: int = 1
    node_counts: tuple[int, ...] = NODE_COUNTS

    @cached_property
    def bodies(self) -> int:
        """Number of bodies."""
        return len(self.tree.mass)

    @property
    def links(self) -> tuple[str, ...]:
        """Link of each capsule."""
        return self.link_shapes.links

    def links_measured(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Return each capsule's link; for a half-plane each twice, since it is measured to both ends."""
        links = self.link_shapes.hull_links if isinstance(obstacle, Ground) else self.links
        return links * clearance.distance_rows(obstacle)

    def grid(self, level: int) -> GaussGrid:
        """Return the Gauss-Legendre nodes of a level."""
        return gauss_grid(NODE_COUNTS[level])

    def fly(self, grid: FlightGrid, joints: JointMotion, angular_momentum: Array) -> PlanarBaseMotion:
        """Turn the base as joints and angular momentum (1,), kg m^2/s, make it."""
        assert isinstance(grid, GaussGrid), "the grids of a flight are its own"
        return PlanarBaseMotion(self, grid, joints, angular_momentum)


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class PlanarBaseMotion:
    """The base's motion in the plane."""

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


@lru_cache(maxsize=64)
def _link_shapes(robot: Robot, hulls: tuple[LinkCapsule, ...]) -> LinkShapes:
    return LinkShapes(robot.tree, robot.shapes, hulls)


def planar_flight(problem: Problem) -> PlanarFlight:
    """Prepare a problem's flight once for all motions."""
    return PlanarFlight(
        problem.robot.tree,
        tree_dynamics(problem.robot.tree),
        _link_shapes(problem.robot, problem.ground_shapes if problem.ground else ()),
        ballistics(problem),
        problem.initial.orientation,
        problem.final.orientation,
        problem.flight.duration,
        problem.final.orientation - problem.initial.orientation,
    )


@lru_cache(maxsize=8)
def momentum_set(problem: Problem) -> MomentumSet:
    """The h of a problem, kg m^2/s: given, or (10), the middle of (9), or free in (9).

    A free h has at least the reach that turns the whole robot by a radian in the time of the flight.
    """
    asked = problem.flight.momentum_in_plane
    centre = momentum_asked(problem, asked)
    if asked != "free":
        return MomentumSet(read_only([centre]), read_only(np.empty((1, 0))))
    low, high = angular_momentum_interval(problem)
    _, most = inertia_extremes(problem.robot, problem.position_limits)
    return MomentumSet(read_only([centre]), read_only([[max((high - low) / 2, most[0] / problem.flight.duration)]]))
