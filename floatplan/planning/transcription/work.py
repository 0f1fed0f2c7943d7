"""How much a search has done, measured without a clock: the same on every machine, busy or quiet.

Where answers are compared or repeated, a search must end at the same place each time; processor time is no such
measure, but the instants evaluated are, and they cost nearly all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

from floatplan.kernel.tolerances import EXCHANGE
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.flight import flight_of
from floatplan.problem.problem import Problem


@dataclass(eq=False)
class FlightModel:
    """What a problem fixes of every motion, and the ``work`` done with it: evaluations of one body at one instant."""

    flight: FlightDynamics
    work: float = 0.0

    def evaluated(self, instants: int) -> None:
        """Count the evaluation of a motion at so many instants."""
        self.work += EXCHANGE.evaluation + instants * self.flight.bodies

    def differentiated(self, entries: int) -> None:
        """Count a Jacobian."""
        self.work += EXCHANGE.differentiation + EXCHANGE.entry * entries


def flight_model(problem: Problem) -> FlightModel:
    """Prepare a problem's model once for all motions."""
    return FlightModel(flight_of(problem))
