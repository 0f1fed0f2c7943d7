"""The conditions (13) at both ends of a flight, and how they change with h where rates follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.dynamics import MomentumSet, RatesAtEnds
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import end_rates
from floatplan.motion.sine_polynomial import CURVATURES, EDGE, SinePolynomials, boundary_arguments
from floatplan.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class Boundary:
    """The conditions (13) of a problem, for arcsine branches (2, n) at takeoff and at landing.

    ``positions, accelerations`` (2, n) rad and rad/s^2; ``centre, amplitude`` (n,) rad; ``duration`` s.
    """

    positions: Array
    accelerations: Array
    rates: RatesAtEnds
    centre: Array
    amplitude: Array
    duration: float
    branches: IntArray

    def __call__(self, angular_momentum: Array) -> Array:
        """p, dp/ds, d2p/ds2 (n, 6) at s = 0, then at s = 1, for h (e,) kg m^2/s; zero for p'' that is free."""
        rates, _ = self.rates(angular_momentum)
        p, rate, curvature = self._arguments(rates)
        return self._by_joint(p, rate, curvature)

    def by_momentum(self, angular_momentum: Array) -> Array:
        """Derivatives (n, 6, e) of them by h."""
        rates, slopes = self.rates(angular_momentum)
        p, rate, _ = self._arguments(rates)
        sine, cosine = np.sin(p), np.cos(p)
        movable = np.abs(cosine) > EDGE
        inverse = np.where(movable, 1 / np.where(movable, cosine, 1.0), 0.0)
        columns = []
        for slope in np.moveaxis(slopes, -1, 0):
            by_rate = slope * inverse / self.amplitude
            columns.append(self._by_joint(np.zeros_like(p), by_rate, 2 * sine * rate * by_rate * inverse))
        return np.stack(columns, axis=-1)

    def _arguments(self, rates: Array) -> tuple[Array, Array, Array]:
        accelerations = np.nan_to_num(self.accelerations)
        return boundary_arguments(self.positions, rates, accelerations, self.centre, self.amplitude, self.branches)

    def _by_joint(self, p: Array, rate: Array, curvature: Array) -> Array:
        given = np.where(np.isnan(self.accelerations), 0.0, self.duration**2 * curvature)
        ends = np.array([p, self.duration * rate, given])
        return ends.transpose(2, 1, 0).reshape(-1, CONDITIONS)


def boundary(problem: Problem, branches: IntArray, momentum: MomentumSet) -> Boundary:
    """Return the conditions (13) of a problem, for an angular momentum of the set."""
    states = (problem.initial, problem.final)
    low, high = problem.position_limits.T
    return Boundary(
        positions=np.array([state.positions for state in states]),
        accelerations=np.array(
            [np.full_like(s.accelerations, np.nan) if s.free_accelerations else s.accelerations for s in states]
        ),
        rates=end_rates(problem, momentum),
        centre=(low + high) / 2,
        amplitude=(high - low) / 2,
        duration=problem.flight.duration,
        branches=branches,
    )


def sine_polynomials(problem: Problem, degrees: tuple[int, ...], conditions: Array) -> SinePolynomials:
    """The class of motions of a problem with conditions (13) (n, 6)."""
    low, high = problem.position_limits.T
    states = (problem.initial, problem.final)
    free_ends = tuple(end for end, state in zip(CURVATURES, states, strict=True) if state.free_accelerations)
    return SinePolynomials(
        (low + high) / 2,
        (high - low) / 2,
        problem.flight.duration,
        conditions,
        tuple(degree - CONDITIONS + 1 + len(free_ends) for degree in degrees),
        free_ends,
    )
