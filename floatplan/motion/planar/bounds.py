"""Extremes of D over the joint ranges, and the angular momentum that suits a flight of monotonic joints: (7)-(10).

Every D_i is a trigonometric polynomial of the planned positions; its extremes are enclosed by branch and bound, never
by sampling.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, ComplexArray, read_only
from floatplan.motion.planar.closed_form import TurningBodies
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot

RELATIVE_GAP = 1e-9  # of the sum of amplitudes: where an enclosure counts as exact
MOST_WORK = 50_000  # cosines per extreme, after which the enclosure reached is taken; it is safe at any time
BOXES_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class TrigonometricPolynomial:
    """``constant + sum_l amplitude_l cos(frequency_l . q + phase_l)``, amplitudes positive.

    ``amplitude``, ``phase`` (L,), ``frequency`` (L, n).
    """

    constant: float
    amplitude: Array
    frequency: Array
    phase: Array

    def negated(self) -> TrigonometricPolynomial:
        """Minus the polynomial."""
        return TrigonometricPolynomial(-self.constant, self.amplitude, self.frequency, self.phase + np.pi)

    def lower_bounds(self, centres: Array, half_widths: Array) -> tuple[Array, Array]:
        """Lower bounds (N,) on boxes, and values at their centres (N,).

        The better of the sum of the cosines' own bounds and the second-order Taylor bound about the centre.
        """
        argument = centres @ self.frequency.T + self.phase
        reach = half_widths @ np.abs(self.frequency).T
        value = self.constant + np.cos(argument) @ self.amplitude
        termwise = self.constant + _cosine_minimum(argument, reach) @ self.amplitude
        gradient = (np.sin(argument) * self.amplitude) @ self.frequency
        taylor = value - (np.abs(gradient) * half_widths).sum(axis=1) - reach**2 @ (self.amplitude / 2)
        return np.maximum(termwise, taylor), value

    def minimum(self, ranges: Array) -> float:
        """Return a lower bound of the minimum over the box ``ranges`` (n, 2).

        Tight to ``RELATIVE_GAP`` unless ``MOST_WORK`` ends the search first.
        """
        n, gap = len(ranges), RELATIVE_GAP * float(self.amplitude.sum())
        centre, half_width = ranges.mean(axis=1), (ranges[:, 1] - ranges[:, 0]) / 2
        boxes = np.concatenate((centre, half_width, [-np.inf]))[None, :]  # rows: centre, half-widths, lower bound
        untried, tried, best, work = boxes, boxes[:0], np.inf, 0
        while True:
            lower, value = self.lower_bounds(untried[:, :n], untried[:, n:-1])
            np.maximum(lower, untried[:, -1], out=untried[:, -1])
            best = min(best, float(value.min()))
            boxes = np.concatenate((tried, untried))
            least = float(boxes[:, -1].min())
            work += lower.size * self.amplitude.size
            if work >= MOST_WORK or least >= best - gap:
                return min(least, best)
            boxes = boxes[boxes[:, -1] < best - gap]
            if len(boxes) > BOXES_AT_ONCE:
                boxes = boxes[np.argpartition(boxes[:, -1], BOXES_AT_ONCE)]
            untried, tried = self._halved(boxes[:BOXES_AT_ONCE]), boxes[BOXES_AT_ONCE:]

    def _halved(self, boxes: Array) -> Array:
        """Both halves of every box, cut across the joint that moves the polynomial most."""
        count, n = len(boxes), self.frequency.shape[1]
        influence = boxes[:, n : 2 * n] * (self.amplitude @ np.abs(self.frequency))
        rows, axis = np.arange(count), np.argmax(influence, axis=1)
        half_width = boxes[rows, n + axis] / 2
        halves = np.concatenate((boxes, boxes))
        halves[rows, axis] -= half_width
        halves[count + rows, axis] += half_width
        halves[rows, n + axis] = halves[count + rows, n + axis] = half_width
        return halves


def _cosine_minimum(argument: Array, reach: Array) -> Array:
    """Minimum of the cosine over [argument - reach, argument + reach]."""
    distance_to_pi = np.abs(np.mod(argument, 2 * np.pi) - np.pi)
    return np.asarray(-np.cos(np.maximum(distance_to_pi - reach, 0)))


def momentum_polynomials(robot: Robot) -> tuple[TrigonometricPolynomial, ...]:
    """D_0, ..., D_n of (4) as trigonometric polynomials of the planned positions; (A.4), (A.5) for n = 2."""
    bodies = TurningBodies.of(robot.tree)
    i, j = np.triu_indices(len(bodies.turns), 1)
    rates, pairs = bodies.rates, bodies.coupling[i, j]
    constants = bodies.coupling.diagonal().real @ rates
    phasors = np.abs(pairs)[:, None] * (rates[i] + rates[j]) * np.exp(1j * bodies.turn * np.angle(pairs))[:, None]
    frequencies = bodies.turns[j] - bodies.turns[i]
    return tuple(
        _polynomial(constant, frequencies, column) for constant, column in zip(constants, phasors.T, strict=True)
    )


def _polynomial(constant: float, frequencies: Array, phasors: ComplexArray) -> TrigonometricPolynomial:
    """``constant + Re(sum_l phasor_l exp(i frequency_l . q))``, with one term for each +-frequency."""
    terms: dict[tuple[float, ...], complex] = {}
    for frequency, phasor in zip(map(tuple, (frequencies + 0.0).tolist()), phasors.tolist(), strict=True):
        leading = next(filter(None, frequency), 0.0)
        if not leading:
            constant += phasor.real
            continue
        if leading < 0:
            frequency, phasor = tuple(0.0 - part for part in frequency), phasor.conjugate()
        terms[frequency] = terms.get(frequency, 0j) + phasor
    kept = {frequency: phasor for frequency, phasor in terms.items() if phasor}
    values = np.array(list(kept.values()), dtype=np.complex128)
    return TrigonometricPolynomial(
        constant,
        read_only(np.abs(values)),
        read_only(np.array(list(kept)).reshape(len(kept), frequencies.shape[1])),
        read_only(np.angle(values)),
    )


def inertia_extremes(robot: Robot, position_limits: Array) -> tuple[Array, Array]:
    """Least and largest D_i over the joint ranges: two arrays (n+1,), kg m^2.

    Exact to ``RELATIVE_GAP`` for a few joints; for many, safe outer bounds.

    Parameters
    ----------
    position_limits : (n, 2) rad
    """
    return _inertia_extremes(robot, tuple(map(tuple, position_limits.tolist())))


@lru_cache(maxsize=64)
def _inertia_extremes(robot: Robot, position_limits: tuple[tuple[float, float], ...]) -> tuple[Array, Array]:
    ranges = np.array(position_limits)
    polynomials = momentum_polynomials(robot)
    low = np.array([polynomial.minimum(ranges) for polynomial in polynomials])
    low[0] = max(low[0], robot.tree.inertia.sum())  # D_0 is that and a sum of mass times squared distance
    high = read_only([-polynomial.negated().minimum(ranges) for polynomial in polynomials])
    return read_only(low), high


def angular_momentum_interval(problem: Problem) -> tuple[float, float]:
    """(9): where h lies if orientation and joints all move monotonically, kg m^2/s; its middle is (10).

    (7) and (8) bound the integrals of ``D_i q_i'`` by the extremes of D_i times the change of q_i, which holds only
    where q_i does not turn back. Outside (9) a flight may exist, whose joints swing out and back: a falling cat's.
    """
    turn = problem.final.orientation - problem.initial.orientation
    changes = np.array([turn, *(problem.final.positions - problem.initial.positions)])
    return momentum_interval(problem, changes, problem.flight.duration)


def momentum_interval(problem: Problem, changes: Array, duration: float) -> tuple[float, float]:
    """(9) for other ``changes`` (n+1,) of orientation and joints, rad, or another duration, s."""
    low, high = inertia_extremes(problem.robot, problem.position_limits)
    ends = [(c * a, c * b) for c, a, b in zip(changes.tolist(), low.tolist(), high.tolist(), strict=True)]  # (7), (8)
    return sum(map(min, ends)) / duration, sum(map(max, ends)) / duration


def monotonic_midpoints(extremes: tuple[Array, Array], changes: Array, durations: Array) -> Array:
    """Return (10), the middle of :func:`angular_momentum_interval`, of N problems, kg m^2/s.

    Parameters
    ----------
    extremes : of :func:`inertia_extremes`
    changes : (N, n+1) rad, of orientation and positions
    durations : (N,) s
    """
    low, high = extremes
    ends = changes * low, changes * high
    return np.asarray((np.minimum(*ends).sum(axis=1) + np.maximum(*ends).sum(axis=1)) / (2 * durations))
