"""Ranges of polynomials by their Bernstein form: coefficients that bound the values, and are the values at the ends.

Halving an interval costs one product with a constant matrix and shrinks the gap between coefficients and values by
four (Garloff 1986). Where a polynomial is monotone near the end of the interval, the end's value *is* the bound: this
is what decides a foot that leaves the ground at t = 0, where the clearance is zero.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.certificate.enclosure import ROUND, Taylor, up


@cache
def _from_powers(order: int) -> Array:
    """Matrix (K, K) from powers of u on [-1, 1] to Bernstein coefficients; entries within [-1, 1]."""
    degree = order - 1
    matrix = np.zeros((order, order))
    for power in range(order):
        for row in range(order):
            # blossom of u^power at (degree - row) times -1 and row times +1
            total = sum(
                math.comb(row, plus) * math.comb(degree - row, power - plus) * (-1) ** (power - plus)
                for plus in range(power + 1)
            )
            matrix[row, power] = total / math.comb(degree, power)
    return read_only(matrix)


@cache
def _halving(order: int) -> Array:
    """Matrices (2, K, K) from the coefficients on an interval to those on its halves; each row sums to 1."""
    left = np.zeros((order, order))
    for row in range(order):
        left[row, : row + 1] = [math.comb(row, column) / 2.0**row for column in range(row + 1)]
    return read_only(np.stack([left, left[::-1, ::-1]]))


def bernstein(model: Taylor) -> Taylor:
    """Return the Bernstein coefficients, in place of those of powers, on [-1, 1]."""
    order = model.order
    c = (_from_powers(order) @ model.c.reshape(order, -1)).reshape(model.c.shape)
    return Taylor(c, up(model.e + (order + 4) * ROUND * model.size))


def halves(form: Taylor) -> Taylor:
    """Split (K, items) into the left halves and, after them, the right halves: (K, 2 items)."""
    c = np.concatenate(list(_halving(form.order) @ form.c), axis=-1)
    e = up(form.e + (form.order + 2) * ROUND * np.abs(form.c).max(axis=0))
    return Taylor(c, np.concatenate([e, e]))


def lower(form: Taylor) -> Array:
    """Lower bound over the interval."""
    return _down(form.c.min(axis=0), form.e)


def upper(form: Taylor) -> Array:
    """Upper bound over the interval."""
    return -_down(-form.c.max(axis=0), form.e)


def magnitude(form: Taylor) -> Array:
    """Upper bound of the absolute value over the interval."""
    return -_down(-np.abs(form.c).max(axis=0), form.e)


def _down(value: Array, radius: Array) -> Array:
    """A lower bound of ``value - radius``."""
    bound = value - radius
    return np.asarray(bound - 2.0 * ROUND * np.abs(bound) - radius * 2.0**-40)
