"""Flight in a plane as the search sees it, see :mod:`floatplan.motion.dynamics`: e = 1.

The orientation is a quadrature, (14) and (18), of the rate theta0' of (4), which the kernel evaluates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.planar import bounds, clearance
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.motion.planar.closed_form import Dynamics, tree_dynamics
from floatplan.motion.planar.end_rates import EndRates, end_rates, motion_into_ground
from floatplan.motion.planar.whole import PlanarMotion
from floatplan.motion.quadrature import NODE_COUNTS, GaussLegendre, gauss_legendre
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.parts import Ground, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree

shapes_of = lru_cache(maxsize=64)(LinkShapes)  # those of a robot are made once


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


@dataclass(eq=False)  # not frozen, for its speed: there is one for every plan
class PlanarFlight:
    """What a problem fixes of every motion in its plane; orientations and their change in rad, the duration in s.

    What each member is, :class:`~floatplan.motion.dynamics.FlightDynamics` says. Where ``other_shapes`` or
    ``other_equations`` are not None, they take the place of the robot's.
    """

    problem: Problem
    tree: PlanarTree
    ballistics: Ballistics
    initial_orientation: float
    final_orientation: float
    duration: float
    change: float
    bodies: int
    tangent: int = 1
    node_counts: tuple[int, ...] = NODE_COUNTS
    other_shapes: LinkShapes | None = None
    other_equations: Dynamics | None = None

    @cached_property
    def momentum_set(self) -> MomentumSet:
        """The h that is given, or (10), the middle of (9), or a free one in (9).

        A free h has at least the reach that turns the whole robot by a radian in the time of the flight.
        """
        if self.problem.angular_momentum is not None:
            return MomentumSet(read_only([self.problem.angular_momentum]), read_only(np.empty((1, 0))))
        low, high = self.problem.momentum_interval
        _, largest = self.problem.inertia_extremes
        reach = max((high - low) / 2, largest[0] / self.duration)
        return MomentumSet(read_only([(low + high) / 2]), read_only([[reach]]))

    @property
    def central_reach(self) -> float:
        """How far the robot's point that stays nearest to the centre of mass is from it, m."""
        return bounds.central_reach(self.problem.robot)

    @property
    def equations(self) -> Dynamics:
        """Momentum and torques in closed form."""
        return self.other_equations or tree_dynamics(self.tree)

    @cached_property
    def link_shapes(self) -> LinkShapes:
        """The links' capsules, made when first asked for: a mesh that cannot be read stops nothing that needs none."""
        if self.other_shapes:
            return self.other_shapes
        robot = self.problem.robot
        hulls = self.problem.ground_shapes if self.problem.ground else ()
        return shapes_of(robot.tree, robot.shapes, hulls)

    @property
    def links(self) -> tuple[str, ...]:
        """Link of each capsule."""
        return self.link_shapes.links

    def links_measured(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Return each capsule's link; for a half-plane each twice, since it is measured to both ends."""
        shapes = self.link_shapes
        links = shapes.hull_links if isinstance(obstacle, Ground) else shapes.links
        rows_of_each = 0
        for piece in obstacle.pieces:
            rows_of_each += clearance.OBSTACLE_DISTANCES[piece.kind][1]
        return links * rows_of_each

    def end_rates(self, momentum: MomentumSet) -> EndRates:
        """The joints' rates at both ends."""
        return end_rates(self.problem, momentum)

    def motion_into_ground(self, angular_momentum: Array) -> list[InputError]:
        """What on the ground moves down at takeoff, or up at landing, for h (1,)."""
        return motion_into_ground(self.problem, angular_momentum)

    def difficulties(self) -> list[str]:
        """Whether h lies outside (9)."""
        return bounds.difficulties(self.problem)

    def impossibilities(self, path_is_clear: bool = False) -> list[str]:
        """Necessary conditions that the problem violates."""
        return bounds.impossibilities(self.problem, path_is_clear)

    def whole_motion(self, joints: WrittenMotion, angular_momentum: Any, path: Ballistics) -> PlanarMotion:
        """The whole robot's motion, by Pinocchio."""
        return PlanarMotion(self.problem, joints, float(angular_momentum), path)


@lru_cache(maxsize=8)
def planar_flight(problem: Problem) -> PlanarFlight:
    """Prepare a problem's flight once for all motions."""
    initial = problem.initial.orientation
    final = problem.final.orientation
    return PlanarFlight(
        problem=problem,
        tree=problem.robot.tree,
        ballistics=problem.path,
        initial_orientation=initial,
        final_orientation=final,
        duration=problem.flight.duration,
        change=final - initial,
        bodies=len(problem.robot.tree.mass),
    )
