"""Corrections at takeoff that are known before the flight: the first correction, which is the largest, begins there."""

import math
from bisect import bisect_right
from collections.abc import Callable

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.inflight.remaining_motion import RemainingMotion
from floatplan.inflight.update import Corrected
from floatplan.kernel.tolerances import CORRECTION_GAINS
from floatplan.motion.exact_polynomials import CONDITIONS

REACH = 0.15  # [-] of the plan's angular momentum, either way
STEPS = 3  # [-] either way
SHORTEST = 0.25  # [-] of them, where the goal is out of reach after a whole one
EVALUATIONS = 30  # [-] of changed motions, for each
WARM_PART = 0.1  # [-] of the flight: later corrections do not begin so


class WarmStarts:
    """Corrections at takeoff, by angular momentum; those between are made of the two nearest, beyond is the last.

    There are as many as reach the goal within the limits.

    Parameters
    ----------
    motion : RemainingMotion
        The plan's, from takeoff.
    corrected : callable
        A motion from takeoff corrected for an angular momentum, kg m^2/s, with so many evaluations at most.
    planned : kg m^2/s
    """

    def __init__(
        self, motion: RemainingMotion, corrected: Callable[[RemainingMotion, float, int], Corrected], planned: float
    ) -> None:
        self._latest = WARM_PART * motion.end
        free = motion.coefficients[CONDITIONS:]
        reach = abs(planned) * REACH

        def changes(step: float) -> list[tuple[float, Array]]:
            """Momenta one step further each, with their changes; shorter steps where the goal is out of reach."""
            reached = []
            changed = motion
            momentum = planned
            least = SHORTEST * abs(step)
            while abs(step) >= least > 0 and abs(momentum + step - planned) <= reach * (1 + 1e-9):
                there = corrected(changed, momentum + step, EVALUATIONS)
                if abs(there.miss) > CORRECTION_GAINS.far or (there.worst < -CORRECTION_GAINS.kept).any():
                    step /= 2
                    continue
                changed = there.motion
                momentum += step
                reached.append((momentum, changed.coefficients[CONDITIONS:] - free))
            return reached

        starts = [(planned, np.zeros_like(free)), *changes(-reach / STEPS), *changes(reach / STEPS)]
        starts.sort(key=lambda start: start[0])
        self._momenta = [momentum for momentum, _ in starts]
        self._changes = read_only([change for _, change in starts])

    def at(self, now: float, angular_momentum: float) -> Array | None:
        """Change of the free coefficients (m, n) to begin with at ``now``, s; None where none is known."""
        momenta = self._momenta
        last = len(momenta) - 1
        if not last or now > self._latest or not math.isfinite(angular_momentum):
            return None
        momentum = min(max(angular_momentum, momenta[0]), momenta[last])
        below = min(bisect_right(momenta, momentum) - 1, last - 1)
        share = (momentum - momenta[below]) / (momenta[below + 1] - momenta[below])
        return np.asarray((1 - share) * self._changes[below] + share * self._changes[below + 1])
