"""Flight in a plane as the search sees it, see :mod:`floatplan.motion.dynamics`: e = 1.

The orientation is a quadrature, (14) and (18), of the rate theta0' of (4), which the kernel evaluates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.planar import clearance
from floatplan.motion.planar.bounds import angular_momentum_interval, inertia_extremes, momentum_asked
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.motion.planar.closed_form import Ballistics, Dynamics, ballistics, tree_dynamics
from floatplan.motion.quadrature import NODE_COUNTS, GaussLegendre, gauss_legendre
from floatplan.problem.parts import Ground, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import LinkCapsule, Robot


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
    """What a problem fixes of every motion in its plane; orientations and their change in rad, the duration in s.

    Shapes are made when they are asked for: a mesh that cannot be read stops nothing that needs none.
    """

    tree: PlanarTree
    equations: Dynamics
    make_link_shapes: Callable[[], LinkShapes]
    ballistics: Ballistics
    initial_orientation: float
    final_orientation: float
    duration: float
    change: float
    tangent: int = 1
    node_counts: tuple[int, ...] = NODE_COUNTS

    @cached_property
    def link_shapes(self) -> LinkShapes:
        """The links' capsules."""
        return self.make_link_shapes()

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


@lru_cache(maxsize=64)
def _link_shapes(robot: Robot, hulls: tuple[LinkCapsule, ...]) -> LinkShapes:
    return LinkShapes(robot.tree, robot.shapes, hulls)


def planar_flight(problem: Problem) -> PlanarFlight:
    """Prepare a problem's flight once for all motions."""
    return PlanarFlight(
        problem.robot.tree,
        tree_dynamics(problem.robot.tree),
        partial(_link_shapes, problem.robot, problem.ground_shapes if problem.ground else ()),
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
