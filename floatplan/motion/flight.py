"""What other rooms ask about flights: the only place that says which module answers.

All flights are in a plane until there is a second module; see :mod:`floatplan.motion.dynamics`.
"""

from floatplan.motion.planar.bounds import angular_momentum_interval, difficulties, impossibilities, inertia_extremes
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances
from floatplan.motion.planar.closed_form import Ballistics, Dynamics, ballistics, frame_from_com, tree_dynamics
from floatplan.motion.planar.contact import FAST, Contact, landing, no_common_momentum, reachable_sets, takeoff
from floatplan.motion.planar.contact_rates import End, Reachable
from floatplan.motion.planar.end_rates import end_rates, motion_into_ground
from floatplan.motion.planar.flight import GaussGrid, PlanarFlight, gauss_grid, momentum_set
from floatplan.motion.planar.flight import planar_flight as flight_dynamics
from floatplan.motion.planar.full_model import (
    FlightCoordinates,
    FullMotion,
    MotionInFile,
    PinocchioDynamics,
    free_flyer,
)

__all__ = ["FAST", "Ballistics", "Contact", "Dynamics", "End", "FlightCoordinates", "FullMotion", "GaussGrid"]
__all__ += ["LinkShapes", "MotionInFile"]
__all__ += ["PinocchioDynamics", "PlanarFlight", "Reachable", "Segments", "angular_momentum_interval", "ballistics"]
__all__ += ["difficulties", "end_rates", "flight_dynamics", "frame_from_com", "free_flyer", "gauss_grid"]
__all__ += ["impossibilities", "inertia_extremes", "landing", "momentum_set", "motion_into_ground"]
__all__ += ["no_common_momentum", "obstacle_distances", "reachable_sets", "takeoff", "tree_dynamics"]
