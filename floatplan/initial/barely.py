"""What a first jump keeps less of than others: room for errors where it lands, and feet that are well in the air.

A jump that is found, but is not clear of the ground where it lands turned by as much as is usual, lacks room for an
error, not a motion: it is asked for the errors at which it is clear, and that is said.
"""

import math
from dataclasses import replace

import numpy as np

from floatplan.jumps.check import FIGURES, touchdown_height
from floatplan.jumps.jump import Jump
from floatplan.jumps.motion import flight_state
from floatplan.problem.jump import JumpRequest
from floatplan.robot.standing import Spot, heights_over_com

STEP = math.radians(0.1)  # of a pitch error, which is written in degrees
USUAL = JumpRequest().pitch_error  # rad
LOW_RISE = 0.005  # [m] of feet: a hop that is hardly one
INSTANTS = 101  # [-] of a flight, at which feet are looked at


def as_clear_as_it_lands(found: Jump) -> Jump:
    """Return a jump that fails its check at touchdown alone as one that is asked for the errors at which it is clear.

    That is the largest pitch error, a round number of degrees, up to which nothing but its feet touches the ground.
    Others are returned as they are.
    """
    least = FIGURES["touchdown"].most(found.request)
    if found.flight is None or found.check.figures.get("touchdown", least) >= least:
        return found
    error = 0.0
    while error + STEP < found.request.pitch_error and touchdown_height(found, error + STEP) >= least:
        error += STEP
    request = replace(found.request, pitch_error=math.radians(round(math.degrees(error), 1)))
    other = replace(found, request=request, problem=replace(found.problem, jump=request))
    return other if other.ok else found


def barely_kept(found: Jump) -> list[str]:
    """Say what a jump keeps less of than is usual, in sentences; empty where it is as others are."""
    error, rise = found.request.pitch_error, feet_rise(found)
    said = []
    if error < USUAL:
        only = f"turned by {math.degrees(error):.2g} degrees at most" if error else "as planned"
        said.append(
            f"Nothing but its feet touches the ground where it lands {only}; other jumps keep that up to"
            f" {math.degrees(USUAL):.0f} degrees."
        )
    if rise < LOW_RISE:
        said.append(f"In flight its feet rise by {1e3 * rise:.2g} mm only.")
    return said


def feet_rise(found: Jump) -> float:
    """Height over the ground, m, that all feet of a jump have at once in its flight, at most."""
    assert found.flight is not None
    robot = found.problem.robot
    state = flight_state(found.flight, 0.0, np.linspace(0.0, found.flight.duration, INSTANTS))
    y = state.planned(robot)[0]
    contacts = [contact for stance in found.stances for contact in stance.contacts]
    over_com = heights_over_com(robot, [contact.spots[0] for contact in contacts], y).imag
    undersides = over_com - [contact.depth for contact in contacts]
    base_over_com = heights_over_com(robot, [Spot(0, 0j)], y).imag
    heights = undersides - base_over_com + state.positions[:, 1:2] - found.before[-1].ground
    return float(heights.min(axis=1).max())
