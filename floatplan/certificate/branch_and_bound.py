"""Smallest values over time: branch and bound on Bernstein forms, for many groups at once; verdicts from these.

The coefficients of a Bernstein form bound the values, and are the values at the ends. Splitting an interval costs one
product with a constant matrix, and each halving shrinks the gap between coefficients and values by four (Garloff 1986).
Where a polynomial is monotone near the end of the interval, the end's value *is* the bound: this is what decides a
foot that leaves the ground at t = 0, where the clearance is zero.

A limit or a tolerance that is not finite proves nothing, and a bound that is unknown is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, IntArray, read_only
from floatplan.certificate.cells import TimeCells
from floatplan.certificate.enclosure import ROUND, Balls, Taylor, up
from floatplan.plans.verdicts import Finding, Kind, Subject

SAME = 1e-12  # [-] two numbers in the file that say the same
RECORDED_PEAK = 2e-3  # [-] recorded torque and velocity peaks, which were sampled on a grid
RECORDED_CLEARANCE = 2e-4  # [m] the same of a recorded clearance
ROUGH = 1e-9  # [m] more than the rounding of a distance in the first look at all cells


@cache
def _from_powers(order: int) -> Array:
    """Matrix (K, K) from powers of u on [-1, 1] to Bernstein coefficients; entries within [-1, 1]."""
    degree = order - 1

    def blossom(row: int, power: int) -> float:
        """That of u^power at (degree - row) times -1 and row times +1."""
        ways = 0
        for plus in range(power + 1):
            minus = power - plus
            ways += math.comb(row, plus) * math.comb(degree - row, minus) * (-1) ** minus
        return float(ways / math.comb(degree, power))

    matrix = np.empty((order, order))
    for row, power in np.ndindex(matrix.shape):
        matrix[row, power] = blossom(row, power)
    return read_only(matrix)


@cache
def _splitting(order: int, halvings: int) -> Array:
    """Matrix (2^halvings K, K) from the coefficients on an interval to those on its equal parts; each row sums to 1.

    A product of integers, so that each entry is rounded once at most.
    """
    left = np.zeros((order, order), dtype=object)
    for row, column in np.ndindex(left.shape):
        left[row, column] = math.comb(row, column) << order - 1 - row
    matrix = np.eye(order, dtype=object)
    for _ in range(halvings):
        matrix = np.concatenate([matrix @ left, matrix @ left[::-1, ::-1]])
    return read_only(matrix / 2 ** ((order - 1) * halvings))


def bernstein(model: Taylor) -> Taylor:
    """Return the Bernstein coefficients, instead of those of powers, on [-1, 1]."""
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


@dataclass(frozen=True)
class Minimum:
    """Smallest value of a group: it is at least ``bound``, and at ``instant`` (s) it is at most ``attained``."""

    bound: float
    attained: float
    instant: float
    member: int


@dataclass(frozen=True, eq=False)
class Items:
    """Pieces of the search: (K, forms, items) on [start, start + width] of a cell, for a member of a group."""

    forms: Taylor
    cell: IntArray
    member: IntArray
    start: Array
    width: float

    @classmethod
    def whole_cells(cls, forms: Sequence[Taylor], cells: IntArray) -> Items:
        """All members (last axis) on the given cells, for forms (K, cells, members)."""
        count = forms[0].e.shape[1]
        flat = [Taylor(f.c[:, cells].reshape(f.order, -1), f.e[cells].ravel()) for f in forms]
        return cls.on_cells(flat, np.repeat(cells, count), np.tile(np.arange(count), len(cells)))

    @classmethod
    def on_cells(cls, forms: Sequence[Taylor], cell: IntArray, member: IntArray) -> Items:
        """Items that are whole cells, for forms (K, items)."""
        joined = Taylor(np.stack([form.c for form in forms], axis=1), np.stack([form.e for form in forms]))
        return cls(joined, cell, member, np.full(len(cell), -1.0), 2.0)

    @property
    def ends(self) -> Balls:
        """Values (forms, 2, items) at the beginning and at the end."""
        c = self.forms.c
        return Balls(c[:: len(c) - 1].swapaxes(0, 1), self.forms.e[:, None])

    def at_end(self, u: float) -> Items:
        """Items of one instant, the beginning (u = -1) or the end (+1) of each."""
        end = self.forms.c[[0 if u < 0.0 else -1]]
        forms = Taylor(np.repeat(end, self.forms.order, axis=0), self.forms.e)
        return Items(forms, self.cell, self.member, np.full_like(self.start, u), 0.0)

    def split(self, keep: IntArray, halvings: int) -> Items:
        """Equal parts of the items to keep."""
        parts = 2**halvings
        width = self.width / parts
        return Items(
            split(self.forms[:, keep], halvings),
            np.concatenate([self.cell[keep]] * parts),
            np.concatenate([self.member[keep]] * parts),
            np.add.outer(width * np.arange(parts), self.start[keep]).ravel(),
            width,
        )


def may_be_least(low: Array, high: Array, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Cells and members, among (cells, members), that the smallest value of all may belong to; unknowns included."""
    row, member = np.nonzero(~(low > np.fmin.reduce(high, axis=None, initial=np.inf)))
    return cells[row], member


@dataclass(frozen=True, eq=False)
class Goal:
    """A group's search ends when bound and attained value are within ``gap`` and on one side of ``threshold``."""

    gap: Array
    threshold: Array


Below: TypeAlias = Callable[[Taylor, IntArray], Array]
AtPoint: TypeAlias = Callable[[Balls, IntArray], Array]


def smallest(
    items: Items, groups: IntArray, below: Below, at_point: AtPoint, goal: Goal, cells: TimeCells
) -> tuple[Minimum, ...]:
    """Enclose the smallest value of each group over all of its items.

    Parameters
    ----------
    items : Items
    groups : (members,)
        Group of each member.
    below : (forms, members) -> (items,)
        A lower bound on the values over the items.
    at_point : (values, members) -> (..., items)
        An upper bound on the values where the forms have these values, (forms, ..., items).
    """
    count = len(goal.gap)
    depth = 0
    bound = np.full(count, np.inf)
    attained = np.full(count, np.inf)
    cell = np.zeros(count, dtype=np.int64)
    member = np.zeros(count, dtype=np.int64)
    u = np.full(count, -1.0)
    while True:
        group = groups[items.member]
        low = np.fmax(below(items.forms, items.member), -np.inf)
        values = at_point(items.ends, items.member)  # (2, items)
        end, item = np.nonzero(values < attained[group])
        falling = np.argsort(values[end, item], kind="stable")[::-1]
        end = end[falling]
        item = item[falling]
        g = group[item]  # of one that is there several times, what is assigned last remains: the smallest
        attained[g] = values[end, item]
        cell[g] = items.cell[item]
        member[g] = items.member[item]
        u[g] = items.start[item] + end * items.width
        enough = np.maximum(attained - goal.gap, np.where(attained < goal.threshold, -np.inf, goal.threshold))
        keep = ~(low >= enough[group]) & np.isfinite(low)
        remaining = np.flatnonzero(keep)
        # up to 512 items a round costs its calls, not its arithmetic: then three halvings at once cost no more
        halvings = min(3 if 8 * len(remaining) <= 512 else 1, 30 - depth)  # no cell is halved more than 30 times
        if halvings == 0 or 2 * len(remaining) > 60_000:  # as many fit into memory
            keep[:] = False
        np.minimum.at(bound, group[~keep], low[~keep])
        if not keep.any():
            break
        items = items.split(remaining, halvings)
        depth = depth + halvings
    minima = []
    for index in range(len(bound)):
        instant = cells.time(int(cell[index]), float(u[index]))
        minima.append(Minimum(float(bound[index]), float(attained[index]), instant, int(member[index])))
    return tuple(minima)


def at_most(
    kind: Kind, subject: Subject, upper: float, attained: float, limit: float, tolerance: float, instant: float | None
) -> Finding:
    """Finding on a quantity that is at most ``upper`` and somewhere at least ``attained``."""
    upper = math.inf if math.isnan(upper) else upper
    allowed = limit + tolerance
    if upper <= allowed and math.isfinite(allowed):
        return Finding(kind, subject, "proved", upper, instant, limit)
    if attained > allowed:
        return Finding(kind, subject, "refuted", attained, instant, limit)
    return Finding(kind, subject, "undecided", upper, instant, limit, upper - allowed)


def at_least(
    kind: Kind, subject: Subject, lower: float, attained: float, limit: float, tolerance: float, instant: float | None
) -> Finding:
    """Finding on a quantity that is at least ``lower`` and somewhere at most ``attained``."""
    mirrored = at_most(kind, subject, -lower, -attained, -limit, tolerance, instant)
    bound = attained if mirrored.verdict == "refuted" else -math.inf if math.isnan(lower) else lower
    return replace(mirrored, bound=bound, limit=limit)


def near(
    kind: Kind, subject: Subject, values: Balls, exact: Any, tolerance: float, instant: float | None = None
) -> Finding:
    """Finding on numbers that should equal the exact ones; the bound is on the largest deviation."""
    upper, attained = deviations(values, exact)
    return at_most(kind, subject, float(upper), float(attained), 0.0, tolerance, instant)


def deviations(values: Balls, exact: Any) -> tuple[Array, Array]:
    """What the largest deviation in each row is at most, and at least."""
    deviation = np.abs(values.mid - exact)
    radius = values.rad + 2.0**-51 * (np.abs(values.mid) + deviation)
    return (deviation + radius).max(axis=-1, initial=0.0), (deviation - radius).max(axis=-1, initial=0.0)
