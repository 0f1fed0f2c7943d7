"""How much a search has done, measured without a clock: the same on every machine, busy or quiet.

Where answers are compared or repeated, a search must end at the same place each time; processor time is no such
measure, but the instants evaluated are, and they cost nearly all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.flight import flight_dynamics
from floatplan.problem.problem import Problem

EVALUATION = 1000.0  # [instants of one body] of a motion, whatever its size
DIFFERENTIATION = 1500.0  # [instants of one body] of a block of constraints, whatever its size
ENTRY = 0.5  # [instants of one body] of a Jacobian
SOLVING = 0.0  # [instants of one body] of an operation of a quadratic program: in a plane they are small
SOLVING_IN_SPACE = 0.005  # the same in space, where variables may be a hundred and more
IN_KERNEL = 0.25  # [-] what an instant in space takes in the kernel of what it takes where motions are lifted


@dataclass(eq=False)
class FlightModel:
    """What a problem fixes of every motion, and the ``work`` done with it: evaluations of one body at one instant."""

    flight: FlightDynamics
    work: float = 0.0

    def evaluated(self, instants: int) -> None:
        """Count the evaluation of a motion at so many instants."""
        self.work += EVALUATION + instants * self.flight.bodies

    def differentiated(self, entries: int) -> None:
        """Count a Jacobian."""
        self.work += DIFFERENTIATION + ENTRY * entries


def flight_model(problem: Problem) -> FlightModel:
    """Prepare a problem's model once for all motions."""
    return FlightModel(flight_dynamics(problem))
