"""Where the first correction of a flight, the largest, begins: at one that was computed before takeoff."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.inflight.law import FAR, KEPT, Law
from floatplan.inflight.motion import RemainingMotion
from floatplan.inflight.outlook import Outlook
from floatplan.motion.sine_polynomial import CONDITIONS

REACH = 0.15  # [-] of the plan's angular momentum, either way
STEPS = 3  # [-] either way
EVALUATIONS = 30  # [-] of changed motions, for each
EARLY = 0.1  # [-] of the flight: later corrections do not begin so


class WarmStarts:
    """Corrections at takeoff, by angular momentum; those between are made of the two nearest, beyond is the last.

    There are as many as reach the goal within the limits.

    Parameters
    ----------
    law : Law
    motion : RemainingMotion
        The plan's, from takeoff.
    outlook : callable
        What will come of a motion with an angular momentum, kg m^2/s.
    planned : kg m^2/s
    """

    def __init__(
        self, law: Law, motion: RemainingMotion, outlook: Callable[[RemainingMotion, float], Outlook], planned: float
    ) -> None:
        self._planned, self._spacing = planned, planned * REACH / STEPS
        self._latest = EARLY * motion.end
        free = motion.coefficients[CONDITIONS:]

        def changes(spacing: float) -> list[Array]:
            """Of momenta one spacing further each, as far as the goal is reached within the limits."""
            found, changed = [], motion
            for step in range(1, STEPS + 1) if spacing else ():
                there = law.corrected(outlook(changed, planned + step * spacing), EVALUATIONS)[0]
                if abs(there.miss) > FAR or (there.worst < -KEPT).any():
                    break
                changed = there.motion
                found.append(changed.coefficients[CONDITIONS:] - free)
            return found

        below, above = changes(-self._spacing), changes(self._spacing)
        self._middle = len(below)
        self._changes = read_only([*reversed(below), np.zeros_like(free), *above])

    def at(self, now: float, angular_momentum: float) -> Array | None:
        """Change of the free coefficients (m, n) to begin with at ``now``, s; None where none is known."""
        last = len(self._changes) - 1
        if not last or now > self._latest or not math.isfinite(angular_momentum):
            return None
        place = min(max((angular_momentum - self._planned) / self._spacing + self._middle, 0.0), last)
        below = min(int(place), last - 1)
        share = place - below
        return np.asarray((1 - share) * self._changes[below] + share * self._changes[below + 1])
