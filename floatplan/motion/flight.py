"""What planning asks about a problem's flight, before it flies one: the only place that says which module answers.

All flights are in a plane until there is a second module; see :mod:`floatplan.motion.dynamics`.
"""

from __future__ import annotations

from floatplan.motion.planar.end_rates import end_rates, motion_into_ground
from floatplan.motion.planar.flight import momentum_set
from floatplan.motion.planar.flight import planar_flight as flight_dynamics
from floatplan.motion.planar.impossibility import difficulties, impossibilities

__all__ = ["difficulties", "end_rates", "flight_dynamics", "impossibilities", "momentum_set", "motion_into_ground"]
