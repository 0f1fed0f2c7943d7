"""In what a first jump falls short of others: margin for errors where it lands, and feet that are well in the air.

A jump that exists, but is not clear of the ground where it lands rotated by the usual pitch error, lacks margin for
an error, not a motion: its request is changed to the errors at which it is clear, and a sentence says so.
"""

import math
from dataclasses import replace

import numpy as np

from floatplan.jumps.check import FIGURES, touchdown_height
from floatplan.jumps.contacts import contact_depths, contact_positions
from floatplan.jumps.jump import Jump
from floatplan.jumps.motion import flight_state
from floatplan.problem.jump import JumpRequest
from floatplan.robot.standing import Spot, positions_from_com

USUAL_PITCH_ERROR = JumpRequest().pitch_error  # rad


def with_largest_pitch_error(jump: Jump) -> Jump:
    """Return a jump that fails its check only at touchdown with the request of the errors at which it is clear.

    That is the largest pitch error, a round number of degrees, up to which nothing but its feet touches the ground.
    Others are returned as they are.
    """
    least = FIGURES["touchdown"].limit_of(jump.request)
    if jump.flight is None or jump.check.figures.get("touchdown", least) >= least:
        return jump
    error = 0.0
    for step in (math.radians(1.0), math.radians(0.1)):  # errors are written in degrees with a decimal
        while error + step < jump.request.pitch_error and touchdown_height(jump, error + step) >= least:
            error += step
    request = replace(jump.request, pitch_error=math.radians(round(math.degrees(error), 1)))
    other = replace(jump, request=request, problem=replace(jump.problem, jump=request))
    return other if other.ok else jump


def shortcomings(jump: Jump) -> list[str]:
    """Sentences on what a jump has less of than is usual; empty where it is as others are."""
    error = jump.request.pitch_error
    rise = feet_rise(jump)
    sentences = []
    if error < USUAL_PITCH_ERROR:
        only = f"turned by {math.degrees(error):.2g} degrees at most" if error else "as planned"
        usual = f"other jumps keep that up to {math.degrees(USUAL_PITCH_ERROR):.0f} degrees"
        sentences.append(f"Nothing but its feet touches the ground where it lands {only}; {usual}.")
    if rise < 0.005:  # m: a hop that is hardly one
        sentences.append(f"In flight its feet rise by {1e3 * rise:.2g} mm only.")
    return sentences


def feet_rise(jump: Jump) -> float:
    """Height over the ground, m, that all feet of a jump have at once in its flight, at most."""
    assert jump.flight is not None
    robot = jump.problem.robot
    state = flight_state(jump.flight, 0.0, np.linspace(0.0, jump.flight.duration, 101))
    y = state.planned(robot)[0]
    undersides = contact_positions(robot, jump.contacts, y).imag - contact_depths(jump.contacts)
    base_over_com = positions_from_com(robot, [Spot(0, 0j)], y).imag
    heights = undersides - base_over_com + state.positions[:, 1:2] - jump.before[-1].ground
    return float(heights.min(axis=1).max())
