"""What planning asks about a problem's flight, before it flies one: the only place that says which module answers.

All flights are in a plane until there is a second module; see :mod:`floatplan.motion.dynamics`.
"""

from __future__ import annotations

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.dynamics import EndRates, FlightDynamics, MomentumSet
from floatplan.motion.planar import contact, flight, impossibility
from floatplan.motion.planar.end_rates import end_rates as end_rates_of
from floatplan.problem.problem import Problem


def flight_dynamics(problem: Problem) -> FlightDynamics:
    """Return what the problem fixes of every motion."""
    return flight.planar_flight(problem)


def momentum_set(problem: Problem) -> MomentumSet:
    """Return the angular momenta that a search may choose."""
    return flight.momentum_set(problem)


def end_rates(problem: Problem, momentum: MomentumSet) -> EndRates:
    """Return the joints' rates at both ends, which may follow from an angular momentum of the set.

    Raises
    ------
    InputError
        A frame is to be at rest that no rates bring to rest.
    """
    return end_rates_of(problem, momentum)


def impossibilities(problem: Problem) -> list[str]:
    """Return sentences, each a reason why no motion whatever meets the problem; none where none is known."""
    return impossibility.impossibilities(problem)


def difficulties(problem: Problem) -> list[str]:
    """Return sentences, each about what makes the problem hard, though not impossible."""
    return impossibility.difficulties(problem)


def motion_into_ground(problem: Problem, angular_momentum: Array) -> list[InputError]:
    """Return what moves into the ground at takeoff or landing, with this angular momentum (e,), kg m^2/s."""
    return contact.motion_into_ground(problem, float(angular_momentum[0]))
