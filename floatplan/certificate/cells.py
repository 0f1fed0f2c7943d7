"""Cells of time, and polynomials of time recentred on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import flint
import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.enclosure import PRECISION, ROUND, Balls, Taylor, up

ORDER = 16  # coefficients of each model


@dataclass(frozen=True, eq=False)
class Cells:
    """Intervals of time [low, high], s, between exact doubles; half their length enclosed.

    On a cell, ``t = (low + high) / 2 + half u`` with u in [-1, 1].
    """

    low: Array
    high: Array
    half: Balls

    @classmethod
    def between(cls, low: Array, high: Array) -> Cells:
        """Cells from their ends."""
        length = high - low
        return cls(low, high, Balls(0.5 * length, up(ROUND * np.abs(length))))

    def __len__(self) -> int:
        return len(self.low)

    def __getitem__(self, index: Array) -> Cells:
        return Cells(self.low[index], self.high[index], self.half[index])

    def time(self, cell: int, u: float) -> float:
        """Instant in a cell, rounded; the ends are themselves."""
        if u >= 1.0:
            return float(self.high[cell])
        return float(self.low[cell] + (self.high[cell] - self.low[cell]) * 0.5 * (u + 1.0))


def recentred(polynomials: Sequence[flint.arb_poly], cells: Cells, length: int) -> Balls:
    """Coefficients (length, cells, polynomials) in u of polynomials in t of fewer than ``length`` + 1 coefficients."""
    values = []
    zero = flint.arb(0)
    with flint.ctx.workprec(PRECISION):
        for low, high in zip(cells.low.tolist(), cells.high.tolist(), strict=True):
            first, last = flint.arb(low), flint.arb(high)
            line = flint.arb_poly([(first + last) / 2, (last - first) / 2])
            for polynomial in polynomials:
                local = polynomial(line).coeffs()
                values += local
                values += [zero] * (length - len(local))
        balls = Balls.from_arb(values, (len(cells), len(polynomials), length))
    return Balls(balls.mid.transpose(2, 0, 1), balls.rad.transpose(2, 0, 1))


def path(polynomials: Sequence[flint.arb_poly], cells: Cells) -> Taylor:
    """Model (K, cells, polynomials) of polynomials in t of degree 2 at most."""
    balls = recentred(polynomials, cells, 3)
    return Taylor.polynomial(balls.mid, balls.rad, ORDER)
