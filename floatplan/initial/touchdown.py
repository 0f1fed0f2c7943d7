"""A jump that was found, but is not clear of the ground where it lands turned by as much as is usual.

What it lacks is room for an error, not a motion: it is asked for the errors at which it is clear, and that is said.
"""

import math
from dataclasses import replace

from floatplan.problem.jump import JumpRequest
from floatplan.stance.check import FIGURES, touchdown_height
from floatplan.stance.jump import Jump

STEP = math.radians(0.1)  # of a pitch error, which is written in degrees
USUAL = JumpRequest().pitch_error  # rad


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


def touchdown_warning(request: JumpRequest) -> list[str]:
    """Say that a jump lands clear only where it is turned by less than usual, where its request says so."""
    if request.pitch_error >= USUAL:
        return []
    only = f"up to {math.degrees(request.pitch_error):.2g} degrees off" if request.pitch_error else "as planned"
    return [
        f"Nothing but its feet touches the ground where it lands {only}; {math.degrees(USUAL):.0f} degrees are asked of"
        " other jumps."
    ]
