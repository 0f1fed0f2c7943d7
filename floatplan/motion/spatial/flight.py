"""Flight in space as the search sees it, see :mod:`floatplan.motion.dynamics`: e = 3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.dynamics import MomentumSet, RatesAtEnds
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.motion.spatial.attitude import LEVELS
from floatplan.motion.spatial.clearance import SPATIAL_DISTANCES, SpatialShapes, shapes_in_space
from floatplan.motion.spatial.dynamics import SpatialDynamics, spatial_dynamics
from floatplan.motion.spatial.ground import motion_into_ground
from floatplan.motion.spatial.momentum import spatial_momentum_set
from floatplan.motion.spatial.whole import SpatialMotion
from floatplan.problem.attitude import Reorientation
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.problem.spatial_obstacles import LevelGround
from floatplan.robot.urdf.base import FREE_FLYER

SLOWEST = 1e-3  # [rad] turned in a flight: the rates of less are not resolved relative to themselves


@dataclass(frozen=True, eq=False)
class SpatialFlight:
    """What a problem fixes of every motion in space.

    Dynamics, attitudes (3, 3) at takeoff and as requested for landing, and the duration, s. What the other members are,
    :class:`~floatplan.motion.dynamics.FlightDynamics` says.
    """

    problem: Problem
    dynamics: SpatialDynamics
    transmission: Array
    ballistics: Ballistics
    reorientation: Reorientation
    initial_attitude: Array
    final_attitude: Array
    duration: float
    bodies: int
    tangent: int = 3
    central_reach: float = np.inf
    node_counts: tuple[int, ...] = tuple(count * stages for count, stages in LEVELS)

    @cached_property
    def momentum_set(self) -> MomentumSet:
        """The h (3,) that the problem leaves to choose."""
        return spatial_momentum_set(self.problem)

    def end_rates(self, momentum: MomentumSet) -> RatesAtEnds:
        """The joints' rates at both ends, which are given."""
        given = np.array([self.problem.initial.velocities, self.problem.final.velocities])
        return lambda h: given

    def motion_into_ground(self, angular_momentum: Array) -> Sequence[InputError]:
        """What on the ground moves down at takeoff, or up at landing, for h (3,)."""
        return motion_into_ground(self.problem, angular_momentum) if self.problem.ground else ()

    def difficulties(self) -> list[str]:
        """None are known."""
        return []

    def impossibilities(self, path_is_clear: bool = False) -> list[str]:
        """None are known."""
        return []

    def whole_motion(self, joints: WrittenMotion, angular_momentum: Any, path: Ballistics) -> SpatialMotion:
        """The whole robot's motion."""
        return SpatialMotion(self.problem, joints, np.asarray(angular_momentum), path)

    @property
    def link_shapes(self) -> SpatialShapes:
        """The links' capsules, made when first asked for: a mesh that cannot be read stops nothing that needs none."""
        return shapes_in_space(self.problem.robot, self.problem.ground)

    @property
    def links(self) -> tuple[str, ...]:
        """Link of each capsule."""
        return self.link_shapes.links

    def links_measured(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Return each capsule's link, or each hull's; for a half-space twice, since it is measured to both ends."""
        if isinstance(obstacle, LevelGround):
            return tuple(hull.link for hull in self.link_shapes.hulls)
        return self.links * SPATIAL_DISTANCES[obstacle.kind][1]


@lru_cache(maxsize=8)
def spatial_flight(problem: Problem) -> SpatialFlight:
    """Prepare a problem's flight once for all motions."""
    robot = problem.robot
    assert problem.reorientation is not None, "the robot flies in space"
    return SpatialFlight(
        problem=problem,
        dynamics=spatial_dynamics(robot),
        transmission=robot.transmission[FREE_FLYER:],
        ballistics=problem.path,
        reorientation=problem.reorientation,
        initial_attitude=problem.reorientation.start.matrix,
        final_attitude=problem.reorientation.goal.matrix,
        duration=problem.flight.duration,
        bodies=10 * robot.model.njoints,  # what an instant of one in space costs, in instants of one of a plane
    )
