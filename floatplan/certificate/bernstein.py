"""Ranges of polynomials by their Bernstein form: coefficients that bound the values, and are the values at the ends.

Splitting an interval costs one product with a constant matrix, and each halving shrinks the gap between coefficients
and values by four (Garloff 1986). Where a polynomial is monotone near the end of the interval, the end's value *is* the
bound: this is what decides a foot that leaves the ground at t = 0, where the clearance is zero.
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

    def blossom(row: int, power: int) -> float:
        """That of u^power at (degree - row) times -1 and row times +1."""
        ways = (
            math.comb(row, plus) * math.comb(degree - row, power - plus) * (-1) ** (power - plus)
            for plus in range(power + 1)
        )
        return float(sum(ways) / math.comb(degree, power))

    return read_only([[blossom(row, power) for power in range(order)] for row in range(order)])


@cache
def _splitting(order: int, halvings: int) -> Array:
    """Matrix (2^halvings K, K) from the coefficients on an interval to those on its equal parts; each row sums to 1.

    A product of integers, so that each entry is rounded once at most.
    """
    left = np.array([[math.comb(r, c) << order - 1 - r for c in range(order)] for r in range(order)], dtype=object)
    matrix = np.eye(order, dtype=object)
    for _ in range(halvings):
        matrix = np.concatenate([matrix @ left, matrix @ left[::-1, ::-1]])
    return read_only(matrix / 2 ** ((order - 1) * halvings))


def bernstein(model: Taylor) -> Taylor:
    """Return the Bernstein coefficients, in place of those of powers, on [-1, 1]."""
    order = model.order
    c = (_from_powers(order) @ model.c.reshape(order, -1)).reshape(model.c.shape)
    return Taylor(c, up(model.e + (order + 4) * ROUND * model.size))


def split(form: Taylor, halvings: int) -> Taylor:
    """Split (K, ..., items) into 2^halvings parts, all first ones, then all second ones: (K, ..., parts items)."""
    order, *others, items = form.c.shape
    parts = 2**halvings
    pieces = (_splitting(order, halvings) @ form.c.reshape(order, -1)).reshape(parts, order, -1, items)
    c = pieces.transpose(1, 2, 0, 3).reshape(order, *others, parts * items)
    e = up(form.e + (order + 2) * ROUND * np.abs(form.c).max(axis=0))
    return Taylor(c, np.concatenate([e] * parts, axis=-1))


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
