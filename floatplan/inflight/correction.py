"""What corrections in flight hand back, and those that are prepared before takeoff, when they are largest."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from floatplan.arguments import Outlined
from floatplan.arrays import Array, read_only
from floatplan.inflight.motion import RemainingMotion
from floatplan.inflight.update import FAR, KEPT, Corrected
from floatplan.motion.exact_polynomials import CONDITIONS

REACHED = 0.01  # [rad] of the goal: a landing within half a degree
REACH = 0.15  # [-] of the plan's angular momentum, either way
STEPS = 3  # [-] either way
SHORTEST = 0.25  # [-] of them, where the goal is out of reach after a whole one
EVALUATIONS = 30  # [-] of changed motions, for each
EARLY = 0.1  # [-] of the flight: later corrections do not begin so

Status: TypeAlias = Literal["applied", "limited", "refused", "invalid"]


@dataclass(frozen=True, eq=False, repr=False)
class Correction(Outlined):
    """What became of a measurement.

    Attributes
    ----------
    status : "applied", "limited", "refused" or "invalid"
        The motion was corrected, keeps all limits and obstacles and lands within ``REACHED`` of the goal; it was
        corrected in part, or lands further off, or breaks a limit that the last one breaks too; no part of a correction
        keeps the limits and the last motion stays; the measurement cannot be one, or is late, and changes nothing.
    reason : why it is not "applied"
    landing : s
        When the robot lands.
    angular_momentum : kg m^2/s
        As it is estimated.
    motion : RemainingMotion
        The joints' from now on.
    predicted_miss : rad
        Orientation at landing less the goal, under that motion.
    torque_peak : (m,) N m
        Largest magnitude of each motor's torque for the rest of the flight, in the order of ``robot.motors``.
    """

    status: Status
    reason: str
    landing: float
    angular_momentum: float
    motion: RemainingMotion
    predicted_miss: float
    torque_peak: Array
    shown: ClassVar[Sequence[str]] = ("status", "reason", "predicted_miss", "landing", "angular_momentum")


@dataclass(frozen=True, eq=False, repr=False)
class Reference(Outlined):
    """What the joints are to do at a time.

    Attributes
    ----------
    positions, velocities, accelerations : (n,) rad, rad/s, rad/s^2
    feedforward : (n,) N m
        Generalised torques: a leader's moves its followers too.
    motors : (m,) N m
        Each motor's own torque, in the order of ``robot.motors``.
    """

    positions: Array
    velocities: Array
    accelerations: Array
    feedforward: Array
    motors: Array


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
        self._latest = EARLY * motion.end
        free = motion.coefficients[CONDITIONS:]
        reach = abs(planned) * REACH

        def changes(step: float) -> list[tuple[float, Array]]:
            """Momenta one step further each, with their changes; shorter steps where the goal is out of reach."""
            found, changed, momentum, least = [], motion, planned, SHORTEST * abs(step)
            while abs(step) >= least > 0 and abs(momentum + step - planned) <= reach * (1 + 1e-9):
                there = corrected(changed, momentum + step, EVALUATIONS)
                if abs(there.miss) > FAR or (there.worst < -KEPT).any():
                    step /= 2
                    continue
                changed, momentum = there.motion, momentum + step
                found.append((momentum, changed.coefficients[CONDITIONS:] - free))
            return found

        known = [(planned, np.zeros_like(free)), *changes(-reach / STEPS), *changes(reach / STEPS)]
        known.sort(key=lambda each: each[0])
        self._momenta, self._changes = [momentum for momentum, _ in known], read_only([change for _, change in known])

    def at(self, now: float, angular_momentum: float) -> Array | None:
        """Change of the free coefficients (m, n) to begin with at ``now``, s; None where none is known."""
        momenta, last = self._momenta, len(self._momenta) - 1
        if not last or now > self._latest or not math.isfinite(angular_momentum):
            return None
        momentum = min(max(angular_momentum, momenta[0]), momenta[last])
        below = min(bisect_right(momenta, momentum) - 1, last - 1)
        share = (momentum - momenta[below]) / (momenta[below + 1] - momenta[below])
        return np.asarray((1 - share) * self._changes[below] + share * self._changes[below + 1])
