"""What other rooms ask about flights: the only place that says which module answers.

In a plane it is :mod:`floatplan.motion.planar`, in space :mod:`floatplan.motion.spatial`, which is loaded when it is
asked; see :mod:`floatplan.motion.dynamics`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.dynamics import FlightDynamics, MomentumSet, RatesAtEnds, WholeMotion
from floatplan.motion.planar import bounds, closed_form
from floatplan.motion.planar import end_rates as planar_ends
from floatplan.motion.planar import flight as planar
from floatplan.motion.planar.bounds import central_reach, inertia_extremes
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances
from floatplan.motion.planar.closed_form import Ballistics, Dynamics, frame_from_com, tree_dynamics
from floatplan.motion.planar.contact import FAST, Contact, landing, no_common_momentum, reachable_sets, takeoff
from floatplan.motion.planar.contact_rates import End, Reachable
from floatplan.motion.planar.flight import GaussGrid, PlanarFlight, gauss_grid, planar_flight
from floatplan.motion.planar.full_model import (
    FlightCoordinates,
    FullMotion,
    MotionInFile,
    PinocchioDynamics,
    free_flyer,
)
from floatplan.motion.planar.whole import PlanarMotion
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.problem.problem import Problem

__all__ = ["FAST", "Ballistics", "Contact", "Dynamics", "End", "FlightCoordinates", "FullMotion", "GaussGrid"]
__all__ += ["LinkShapes", "MotionInFile", "PinocchioDynamics", "PlanarFlight", "PlanarMotion", "Reachable", "Segments"]
__all__ += ["angular_momentum_interval", "ballistics", "central_reach", "difficulties", "end_rates", "flight_dynamics"]
__all__ += ["frame_from_com", "free_flyer", "gauss_grid", "impossibilities", "inertia_extremes", "landing"]
__all__ += ["missed_in_space", "momentum_set", "motion_into_ground", "no_common_momentum", "obstacle_distances"]
__all__ += ["planar_flight", "reachable_sets", "takeoff", "tree_dynamics", "whole_motion"]


def flight_dynamics(problem: Problem) -> FlightDynamics:
    """Prepare a problem's flight once for all motions."""
    if problem.robot.in_plane:
        return planar_flight(problem)
    from floatplan.motion.spatial.flight import spatial_flight

    return spatial_flight(problem)


def momentum_set(problem: Problem) -> MomentumSet:
    """The angular momenta that a problem leaves to choose, kg m^2/s."""
    if problem.robot.in_plane:
        return planar.momentum_set(problem)
    from floatplan.motion.spatial.momentum import spatial_momentum_set

    return spatial_momentum_set(problem)


def ballistics(problem: Problem) -> Ballistics:
    """Path of the centre of mass, (2), (3), (6), or the same in space."""
    if problem.robot.in_plane:
        return closed_form.ballistics(problem)
    from floatplan.motion.spatial.whole import spatial_ballistics

    return spatial_ballistics(problem)


def whole_motion(problem: Problem, joints: WrittenMotion, angular_momentum: Any, path: Ballistics) -> WholeMotion:
    """The whole robot's motion, of joints that move as written."""
    if problem.robot.in_plane:
        return PlanarMotion(problem, joints, float(angular_momentum), path)
    from floatplan.motion.spatial.whole import SpatialMotion

    return SpatialMotion(problem, joints, np.asarray(angular_momentum), path)


def missed_in_space(motion: PlanarMotion) -> Array:
    """What a plan in a plane leaves out; see :mod:`floatplan.motion.spatial.out_of_plane`."""
    from floatplan.motion.spatial import out_of_plane

    return out_of_plane.missed_in_space(motion)


def angular_momentum_interval(problem: Problem) -> tuple[float, float] | None:
    """(low, high) of (9), kg m^2/s; None in space, where there is none."""
    return bounds.angular_momentum_interval(problem) if problem.robot.in_plane else None


def difficulties(problem: Problem) -> list[str]:
    """Return sentences about what makes the problem hard, as far as it is known."""
    return bounds.difficulties(problem) if problem.robot.in_plane else []


def impossibilities(problem: Problem, path_is_clear: bool = False) -> list[str]:
    """Return sentences about why no motion whatever meets the problem, as far as that is known.

    It may be known already that the centre of mass is never too deep in an obstacle.
    """
    return bounds.impossibilities(problem, path_is_clear) if problem.robot.in_plane else []


def motion_into_ground(problem: Problem, angular_momentum: Array) -> Sequence[InputError]:
    """What on the ground moves down at takeoff, or up at landing, for h (e,) kg m^2/s; not known in space."""
    return list(planar_ends.motion_into_ground(problem, angular_momentum)) if problem.robot.in_plane else []


def end_rates(problem: Problem, momentum: MomentumSet) -> RatesAtEnds:
    """The joints' rates at both ends: as given, or those with which a frame is at rest."""
    if problem.robot.in_plane:
        return planar_ends.end_rates(problem, momentum)
    given = np.array([problem.initial.velocities, problem.final.velocities])
    return lambda h: given
