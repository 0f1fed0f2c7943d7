"""Corrections at takeoff that are computed before the flight: the first, which is the largest, begins with one."""

import math
from bisect import bisect_right
from collections.abc import Callable

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.inflight.remaining_motion import RemainingMotion
from floatplan.inflight.update import Prediction
from floatplan.kernel.tolerances import CORRECTION_OPTIONS
from floatplan.motion.exact_polynomials import CONDITIONS


class WarmStarts:
    """Corrections at takeoff, by angular momentum; those between are made of the two nearest, beyond is the last.

    There are as many as lead to the goal within the limits.

    Parameters
    ----------
    motion : RemainingMotion
        The plan's, from takeoff.
    corrected : callable
        A motion from takeoff corrected for an angular momentum, kg m^2/s, with so many evaluations at most.
    planned : kg m^2/s
        Momenta are components along one direction, in space the plan's own.
    """

    def __init__(
        self, motion: RemainingMotion, corrected: Callable[[RemainingMotion, float, int], Prediction], planned: float
    ) -> None:
        self._latest = 0.1 * motion.end  # later corrections do not begin so
        free = motion.coefficients[CONDITIONS:]
        farthest = abs(planned) * 0.15  # from the plan's momentum, either way
        shortest = 0.25  # of a step, where the goal is out of reach after a whole one
        evaluations = 30  # of changed motions, for each

        def further_changes(step: float) -> list[tuple[float, Array]]:
            """Momenta one step further each, with their changes; shorter steps where the goal is out of reach."""
            changes = []
            changed = motion
            momentum = planned
            least = shortest * abs(step)
            while abs(step) >= least > 0 and abs(momentum + step - planned) <= farthest * (1 + 1e-9):
                further = corrected(changed, momentum + step, evaluations)
                if further.missed > CORRECTION_OPTIONS.far or further.breaks_a_limit:
                    step /= 2
                    continue
                changed = further.motion
                momentum += step
                changes.append((momentum, changed.coefficients[CONDITIONS:] - free))
            return changes

        step = farthest / 3
        starts = [(planned, np.zeros_like(free)), *further_changes(-step), *further_changes(step)]
        starts.sort(key=lambda start: start[0])
        self._momenta = [momentum for momentum, _ in starts]
        self._changes = read_only([change for _, change in starts])

    def at(self, now: float, angular_momentum: float) -> Array | None:
        """Change of the free coefficients (m, n) to begin with at ``now``, s; None where there is none."""
        momenta = self._momenta
        last = len(momenta) - 1
        if not last or now > self._latest or not math.isfinite(angular_momentum):
            return None
        momentum = min(max(angular_momentum, momenta[0]), momenta[last])
        below = min(bisect_right(momenta, momentum) - 1, last - 1)
        share = (momentum - momenta[below]) / (momenta[below + 1] - momenta[below])
        return np.asarray((1 - share) * self._changes[below] + share * self._changes[below + 1])
