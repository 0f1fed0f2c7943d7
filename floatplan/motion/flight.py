"""What other rooms need of flights: :func:`flight_of` says which class a problem has.

A flight is a :class:`~floatplan.motion.planar.flight.PlanarFlight` or a
:class:`~floatplan.motion.spatial.flight.SpatialFlight`; what both answer, and the symbols, are in
:mod:`floatplan.motion.dynamics`.
"""

from __future__ import annotations

from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances
from floatplan.motion.planar.closed_form import Dynamics, frame_from_com, tree_dynamics
from floatplan.motion.planar.contact import FAST, Contact, landing, no_common_momentum, reachable_sets, takeoff
from floatplan.motion.planar.contact_rates import End, Reachable
from floatplan.motion.planar.end_rates import EndRates
from floatplan.motion.planar.flight import GaussGrid, PlanarFlight, gauss_grid, planar_flight
from floatplan.motion.planar.full_model import (
    FlightCoordinates,
    FullMotion,
    MotionInFile,
    PinocchioDynamics,
    free_flyer,
)
from floatplan.motion.planar.whole import PlanarMotion
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.problem import Problem

__all__ = ["FAST", "Ballistics", "Contact", "Dynamics", "End", "EndRates"]
__all__ += ["FlightCoordinates", "FullMotion", "GaussGrid"]
__all__ += ["LinkShapes", "MotionInFile", "PinocchioDynamics", "PlanarFlight", "PlanarMotion", "Reachable", "Segments"]
__all__ += ["flight_of", "frame_from_com", "free_flyer", "gauss_grid", "landing"]
__all__ += ["no_common_momentum", "obstacle_distances", "planar_flight", "reachable_sets", "takeoff"]
__all__ += ["tree_dynamics"]


def flight_of(problem: Problem) -> FlightDynamics:
    """What a problem fixes of every motion, prepared once, and what is known of it without a search."""
    if problem.robot.in_plane:
        return planar_flight(problem)
    from floatplan.motion.spatial.flight import spatial_flight  # here, because flights in a plane do without

    return spatial_flight(problem)
