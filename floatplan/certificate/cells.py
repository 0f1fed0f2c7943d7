"""Cells of time, polynomials of time recentred on them, and vectors of the plane: constants and Taylor models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.certificate.enclosure import PRECISION, ROUND, Balls, Taylor, products, stack, up

FIRST_CELLS = 24  # [-] of a flight, before any is halved
ORDER = 16  # [-] coefficients of each model


@dataclass(frozen=True, eq=False)
class TimeCells:
    """Intervals of time [low, high], s, between exact doubles; half their length enclosed.

    On a cell, ``t = (low + high) / 2 + half u`` with u in [-1, 1].
    """

    low: Array
    high: Array
    half: Balls

    @classmethod
    def between(cls, low: Array, high: Array) -> TimeCells:
        """Cells from their ends."""
        length = high - low
        return cls(low, high, Balls(0.5 * length, up(ROUND * np.abs(length))))

    def __len__(self) -> int:
        return len(self.low)

    @property
    def are_divisible(self) -> BoolArray:
        """Whether there is a double between both ends (cells,)."""
        middle = 0.5 * (self.low + self.high)
        return np.asarray((self.low < middle) & (middle < self.high))

    def time(self, cell: int, u: float) -> float:
        """Instant in a cell, rounded; the ends are themselves."""
        if u >= 1.0:
            return float(self.high[cell])
        return float(self.low[cell] + (self.high[cell] - self.low[cell]) * 0.5 * (u + 1.0))


def recentred(polynomials: Sequence[flint.arb_poly], cells: TimeCells, length: int) -> Balls:
    """Coefficients (length, cells, polynomials) in u of polynomials in t of fewer than ``length`` + 1 coefficients."""
    values = []
    zero = flint.arb(0)
    with flint.ctx.workprec(PRECISION):
        for low, high in zip(cells.low.tolist(), cells.high.tolist(), strict=True):
            first = flint.arb(low)
            last = flint.arb(high)
            line = flint.arb_poly([(first + last) / 2, (last - first) / 2])
            for polynomial in polynomials:
                local = polynomial(line).coeffs()
                values += local
                values += [zero] * (length - len(local))
        balls = Balls.from_arb(values, (len(cells), len(polynomials), length))
    return Balls(balls.mid.transpose(2, 0, 1), balls.rad.transpose(2, 0, 1))


@dataclass(frozen=True, eq=False)
class Vectors:
    """Models of vectors, (K, cells, items) or (K, items) each; one item may stand for all."""

    x: Taylor
    y: Taylor

    def __sub__(self, other: Vectors) -> Vectors:
        return Vectors(self.x - other.x, self.y - other.y)

    def __getitem__(self, index: Any) -> Vectors:
        return Vectors(self.x[index], self.y[index])

    def turned_back(self, direction: Vectors) -> Vectors:
        """Components along ``direction`` (unit vectors) and across it, to its left."""
        if direction.x.e.shape == self.x.e.shape:
            x_x, y_y, x_y, y_x = products(
                [(direction.x, self.x), (direction.y, self.y), (direction.x, self.y), (direction.y, self.x)]
            )
        else:  # one direction for all items
            both = stack([self.x, self.y])
            of_x = direction.x * both
            of_y = direction.y * both
            count = self.x.e.shape[-1]
            x_x = of_x[..., :count]
            x_y = of_x[..., count:]
            y_x = of_y[..., :count]
            y_y = of_y[..., count:]
        return Vectors(x_x + y_y, x_y - y_x)

    def items(self, items: Sequence[int]) -> Vectors:
        """Some of the items, maybe repeatedly; one that stands for all stays."""
        return self if self.x.e.shape[-1] == 1 else self[:, list(items)]

    def on(self, cell: IntArray, item: IntArray) -> Vectors:
        """Models (K, len(cell)) of single items on single cells."""
        return self[cell, item if self.x.e.shape[-1] > 1 else np.zeros_like(item)]


def join_vectors(vectors: Sequence[Vectors], counts: Sequence[int]) -> Vectors:
    """Join along the last axis; a single item that stands for all is repeated to its count."""
    broadcast = []
    for v, count in zip(vectors, counts, strict=True):
        broadcast.append(v if v.x.e.shape[-1] == count else v[:, [0] * count])
    return Vectors(stack([v.x for v in broadcast]), stack([v.y for v in broadcast]))


@dataclass(frozen=True, eq=False)
class ComplexBalls:
    """Complex numbers known to within a radius in its real and imaginary components."""

    re: Balls
    im: Balls

    @classmethod
    def from_acb(cls, values: Sequence[Any], shape: tuple[int, ...]) -> ComplexBalls:
        """Round Arb's complex balls to doubles."""
        re = [value.real for value in values]
        im = [value.imag for value in values]
        return cls(Balls.from_arb(re, shape), Balls.from_arb(im, shape))

    @cached_property
    def adjoint(self) -> ComplexBalls:
        """The matrix transposed and conjugate."""
        return ComplexBalls(self.re.transposed, -self.im.transposed)

    def times(self, re: Taylor, im: Taylor) -> Vectors:
        """The matrix (out, in) times complex models (K, cells, in), as vectors (K, cells, out)."""
        count = len(self.re.mid)
        of_re = re.linear(self._parts)
        of_im = im.linear(self._parts)
        return Vectors(of_re[..., :count] - of_im[..., count:], of_re[..., count:] + of_im[..., :count])

    @cached_property
    def _parts(self) -> Balls:
        """Rows of the real parts, then those of the imaginary parts."""
        return Balls.joined([self.re, self.im])
