"""Inertia of a planar tree: D of (4) as trigonometric polynomials of the planned positions, and its extremes.

These are enclosed by branch and bound, never by sampling. They bound the angular momentum that suits a flight of
monotonic joints, (7)-(9).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, ComplexArray, read_only
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles
from floatplan.robot.planar.tree import PlanarTree

RELATIVE_GAP = 1e-9  # [-] of the sum of amplitudes: where an enclosure counts as exact
MOST_WORK = 50_000  # [-] cosines per extreme, after which the current enclosure is the result; it is safe at any time
BOXES_AT_ONCE = 256  # [-] that the kernel bounds in one call


@dataclass(frozen=True, eq=False)
class TurningBodies:
    """The g bodies of a tree that rotate differently.

    Bodies whose angles differ by a constant, as the legs of a quadruped that is coupled left to right, are one here.

    ``turns`` (g, n) as of the tree; ``coupling`` (g, g) kg m^2, C for angles that are 0 at planned positions 0, with
    the moments of inertia on its diagonal; ``turn`` the tree's; ``rates`` (g, n+1) derivatives of the absolute angles
    by orientation and planned positions.
    """

    turns: Array
    coupling: ComplexArray
    turn: float
    rates: Array

    @classmethod
    def of(cls, tree: PlanarTree, coupling: ComplexArray | None = None, inertia: Array | None = None) -> TurningBodies:
        """Sum over what rotates alike: rotations are the same there but for a constant; as of :class:`Dynamics`."""
        turns, group = tree.distinct_turns
        rotations = tree.rotations(tree.offsets)[:, None] * np.eye(len(turns))[group]
        hermitian = (tree.coupling if coupling is None else coupling) + np.diag(
            tree.inertia if inertia is None else inertia
        )
        rates = np.concatenate((np.ones((len(turns), 1)), turns), axis=1)
        return cls(turns, np.asarray(rotations.conj().T @ hermitian @ rotations), tree.turn, rates)


@dataclass(frozen=True, eq=False)
class TrigonometricPolynomial:
    """``constant + sum_l amplitude_l cos(frequency_l . q + phase_l)``, amplitudes positive.

    ``amplitude``, ``phase`` (L,), ``frequency`` (L, n).
    """

    constant: float
    amplitude: Array
    frequency: Array
    phase: Array

    def minimum(self, ranges: Array) -> float:
        """Return a lower bound of the minimum over the box ``ranges`` (n, 2), by branch and bound in the kernel.

        A box is a row: centres and half-widths, rad, and the best lower bound of it. The kernel halves boxes
        across the joint that moves the polynomial most, and bounds both halves by the better one of the sum of the
        cosines' own bounds and the second-order Taylor bound about the centre, where it also gives the value. Tight to
        ``RELATIVE_GAP`` unless ``MOST_WORK`` ends the search first.
        """
        terms, n = self.frequency.shape
        padded = np.zeros((n + 3, -(-terms // 8) * 8))  # eight terms at once, those beyond the last one zeros
        padded[:2, :terms] = (self.amplitude, self.phase)
        padded[2:-1, :terms] = self.frequency.T
        boxes = np.empty((BOXES_AT_ONCE, 2 * n + 1))
        halves = np.empty((2 * BOXES_AT_ONCE, 2 * n + 1))
        values = np.empty(len(halves))
        cosines = Struct(
            "Cosines",
            joints=n,
            terms=padded.shape[1],
            constant=self.constant,
            amplitude=padded[0],
            phase=padded[1],
            frequency=padded[2:-1],
            influence=doubles(self.amplitude @ np.abs(self.frequency)),
            boxes=boxes,
            parts=halves,
            value=values,
            pulls=padded[-1],
        )
        compiled = kernel()

        gap = RELATIVE_GAP * float(self.amplitude.sum())
        centres, widths = ranges.mean(axis=1), (ranges[:, 1] - ranges[:, 0]) / 2
        next_boxes = np.concatenate((centres, widths, [-np.inf]))[None, :]
        other_boxes = next_boxes[:0]
        is_cut = False  # at first the whole box is bounded as it is
        lowest_value = np.inf
        work = 0
        while True:
            boxes[: len(next_boxes)] = next_boxes
            cosines.pointer.count = len(next_boxes)
            cosines.pointer.cuts = is_cut
            compiled.bound(cosines.pointer, compiled.instructions)
            count = 2 * len(next_boxes) if is_cut else len(next_boxes)
            lowest_value = min(lowest_value, float(values[:count].min()))
            open_boxes = np.concatenate((other_boxes, halves[:count]))
            lowest_bound = float(open_boxes[:, -1].min())
            work += count * self.amplitude.size
            if work >= MOST_WORK or lowest_bound >= lowest_value - gap:
                return min(lowest_bound, lowest_value)
            open_boxes = open_boxes[open_boxes[:, -1] < lowest_value - gap]
            if len(open_boxes) > BOXES_AT_ONCE:
                open_boxes = open_boxes[np.argpartition(open_boxes[:, -1], BOXES_AT_ONCE)]
            next_boxes, other_boxes = open_boxes[:BOXES_AT_ONCE], open_boxes[BOXES_AT_ONCE:]
            is_cut = True


def momentum_polynomials(tree: PlanarTree) -> tuple[TrigonometricPolynomial, ...]:
    """D_0, ..., D_n of (4) as trigonometric polynomials of the planned positions; (A.4), (A.5) for n = 2."""
    bodies = TurningBodies.of(tree)
    i, j = np.triu_indices(len(bodies.turns), 1)
    pairs = bodies.coupling[i, j]
    constants = bodies.coupling.diagonal().real @ bodies.rates
    turned = np.exp(1j * bodies.turn * np.angle(pairs))
    phasors = np.abs(pairs)[:, None] * (bodies.rates[i] + bodies.rates[j]) * turned[:, None]
    frequencies = bodies.turns[j] - bodies.turns[i]

    # Pairs of bodies whose frequencies differ in no more than their sign are one term, in the order of appearance.
    leading = np.take_along_axis(frequencies, (frequencies != 0).argmax(axis=1)[:, None], axis=1)
    is_turned = leading < 0
    upright = np.where(is_turned, -frequencies, frequencies) + 0.0  # no -0
    distinct, first, number = np.unique(upright, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    sums = np.zeros((len(distinct), phasors.shape[1]), dtype=np.complex128)
    np.add.at(sums, number.ravel(), np.where(is_turned, phasors.conj(), phasors))
    frequencies, sums = distinct[order], sums[order]
    is_constant = ~frequencies.any(axis=1)

    polynomials = []
    for constant, column in zip(constants, sums.T, strict=True):
        terms = np.flatnonzero(~is_constant & (column != 0))
        polynomials.append(
            TrigonometricPolynomial(
                constant=constant + column[is_constant].real.sum(),
                amplitude=read_only(np.abs(column[terms])),
                frequency=read_only(frequencies[terms]),
                phase=read_only(np.angle(column[terms])),
            )
        )
    return tuple(polynomials)


def inertia_extremes(tree: PlanarTree, position_limits: Array) -> tuple[Array, Array]:
    """Least and largest D_i over the joint ranges: two arrays (n+1,), kg m^2.

    Exact to ``RELATIVE_GAP`` for a few joints; for many, safe outer bounds.

    Parameters
    ----------
    position_limits : (n, 2) rad
    """
    return _inertia_extremes(tree, tuple(map(tuple, position_limits.tolist())))


@lru_cache(maxsize=64)
def _inertia_extremes(tree: PlanarTree, position_limits: tuple[tuple[float, float], ...]) -> tuple[Array, Array]:
    ranges = np.array(position_limits)
    low, high = [], []
    for polynomial in momentum_polynomials(tree):
        negated = replace(polynomial, constant=-polynomial.constant, phase=polynomial.phase + np.pi)
        low.append(polynomial.minimum(ranges))
        high.append(-negated.minimum(ranges))
    low[0] = max(low[0], tree.inertia.sum())  # D_0 is that and a sum of mass times squared distance
    return read_only(low), read_only(high)


def momentum_intervals(extremes: tuple[Array, Array], changes: Array, durations: Array) -> tuple[Array, Array]:
    """(9): low and high (..) of h, kg m^2/s, for changes (.., n+1) of orientation and joints, rad, durations (..), s.

    (7) and (8) bound the integrals of ``D_i q_i'`` by the ``extremes`` of D_i times the change of q_i, which holds only
    where q_i keeps its direction. Outside (9) a flight may exist, whose joints go out and back: a falling cat's.
    """
    low, high = extremes
    ends = changes * low, changes * high  # (7), (8)
    return np.minimum(*ends).sum(axis=-1) / durations, np.maximum(*ends).sum(axis=-1) / durations
