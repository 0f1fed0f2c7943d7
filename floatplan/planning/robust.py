"""The objective "robust" of flights in space: a small motion, with which errors at takeoff grow little until landing.

Least is ``|z|^2 + w (|K|^2 + |P|^2)``, with z the free coefficients, K the turn at landing by the logarithm of h, and P
that by a small turn at takeoff. Both follow from the derivative of the attitude at landing by h, which the kernel
computes for lifted motions; their derivatives are differences of these, along motions without gaps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.spatial.attitude import weighted_growth
from floatplan.motion.spatial.rotations import exponential
from floatplan.planning.lifting import LIFTING, LiftedFlight, LiftedMotion

DIFFERENCE = 1e-5  # [rad] of p, root mean square: with ten times more or less the derivatives agree to 1e-6


@dataclass(frozen=True, eq=False)
class RobustCost:
    """The objective "robust" at a closed motion.

    Attributes
    ----------
    motion : LiftedMotion
    growth : (12,) rad
        K and P, weighted.
    """

    motion: LiftedMotion
    growth: Array

    @classmethod
    def of(cls, motion: LiftedMotion) -> RobustCost:
        """Compute it; errors as of :func:`~floatplan.motion.spatial.attitude.turn`."""
        return cls(motion, _growth(motion, motion.x, motion.borders))

    @property
    def value(self) -> float:
        """The root of the sum of all squares, rad."""
        return float(np.hypot(np.linalg.norm(self._coefficients), np.linalg.norm(self.growth)))

    @property
    def _coefficients(self) -> Array:
        variables = self.motion.lifted.variables
        return np.asarray(variables.offset + self.motion.x[: variables.coefficients])

    @cached_property
    def _growth_slope(self) -> Array:
        """Derivative (12, size) of the growth by x, along motions without gaps."""
        motion = self.motion
        slope = np.empty((len(self.growth), len(motion.x)))
        turns = np.zeros_like(motion.gaps)  # of the borders, none at takeoff
        for index in range(len(motion.x)):
            change = np.zeros_like(motion.x)
            change[index] = DIFFERENCE
            turns[1:] = DIFFERENCE * motion.turns[:-1, :, index]
            after = _growth(motion, motion.x + change, exponential(turns) @ motion.borders)
            before = _growth(motion, motion.x - change, exponential(-turns) @ motion.borders)
            slope[:, index] = (after - before) / (2 * DIFFERENCE)
        return slope

    @property
    def is_least(self) -> bool:
        """Whether no closed motion near has a smaller cost, to first order.

        The undamped step takes hardly anything off the squares, as far as the growth changes linearly.
        """
        step = self.downhill(np.inf)
        coefficients = self._coefficients + step[: len(self._coefficients)]
        growth = self.growth + self._growth_slope @ step
        foretold = np.hypot(np.linalg.norm(coefficients), np.linalg.norm(growth)) / self.value
        return bool(1 - foretold**2 <= LIFTING.optimal_gradient**2)

    def downhill(self, radius: float) -> Array:
        """The damped Gauss-Newton step (size,) that does not change the attitude at landing.

        The damping, gradient over radius, makes no step longer than that, unless numbers of h that would leave [-1, 1]
        go to its edge.
        """
        x = self.motion.x
        free = len(self._coefficients)
        landing = self.motion.turns[-1]
        curvature = self._growth_slope.T @ self._growth_slope
        curvature[range(free), range(free)] += 1.0
        gradient = self._growth_slope.T @ self.growth
        gradient[:free] += self._coefficients
        change = np.zeros_like(x)
        movable = np.ones(len(x), bool)
        for _ in range(len(x) - free + 1):
            # Least of the quadratic model among the movable variables, the others being at the edge.
            at_edge = np.where(movable, 0.0, change)
            columns = landing[:, movable]
            of_movable = curvature[np.ix_(movable, movable)]
            level = np.linalg.svd(columns)[2][len(columns) :].T  # directions that do not change the landing
            back = -np.linalg.lstsq(columns, landing @ at_edge, rcond=LIFTING.rounding)[0]
            downwards = level.T @ -((gradient + curvature @ at_edge)[movable] + of_movable @ back)
            damping = np.linalg.norm(downwards) / radius
            damped = level.T @ of_movable @ level + damping * np.eye(len(downwards))
            change[movable] = back + level @ np.linalg.lstsq(damped, downwards, rcond=LIFTING.rounding)[0]
            beyond = movable & (np.abs(x + change) > 1 + LIFTING.rounding)
            beyond[:free] = False
            if not beyond.any():
                break
            change[beyond] = np.sign(x + change)[beyond] - x[beyond]
            movable &= ~beyond
        return change


def _growth(motion: LiftedMotion, x: Array, borders: Array) -> Array:
    """K and P (12,), rad, weighted, of x and borders (C, 3, 3) near those of a motion; errors as of :func:`turn`."""
    variables = motion.lifted.variables
    free = variables.coefficients
    h = variables.angular_momentum(x)
    near = motion.lifted.of_any_momentum.fly(motion.cells, np.append(x[:free], h), borders)
    return weighted_growth(near.turns[-1][:, free:], h)


def about(motion: LiftedMotion) -> LiftedMotion:
    """The same motion, of variables whose norm is how far they are from it; errors as of :meth:`LiftedFlight.fly`."""
    lifted = motion.lifted
    free = lifted.variables.coefficients
    x = motion.x.copy()
    x[:free] = 0.0
    offset = lifted.variables.offset + motion.x[:free]
    variables = replace(lifted.variables, offset=offset, has_reference=True)
    return LiftedFlight(lifted.spec, variables, lifted.work).fly(motion.cells, x, motion.borders)
