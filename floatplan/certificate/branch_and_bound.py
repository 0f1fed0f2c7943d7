"""Smallest values over time: branch and bound on Bernstein forms, for many groups at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.bernstein import split
from floatplan.certificate.cells import TimeCells
from floatplan.certificate.enclosure import Balls, Taylor

DEEPEST = 30  # halvings of a cell
MOST_ITEMS = 60_000
FEW_ITEMS = 512  # up to here a round costs its calls, not its arithmetic, and three halvings at once cost no more


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
        together = Taylor(np.stack([form.c for form in forms], axis=1), np.stack([form.e for form in forms]))
        return cls(together, cell, member, np.full(len(cell), -1.0), 2.0)

    @property
    def ends(self) -> Balls:
        """Values (forms, 2, items) at the beginning and at the end."""
        c = self.forms.c
        return Balls(c[:: len(c) - 1].swapaxes(0, 1), self.forms.e[:, None])

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
    count, depth = len(goal.gap), 0
    bound, attained = np.full(count, np.inf), np.full(count, np.inf)
    cell, member, u = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64), np.full(count, -1.0)
    while True:
        group = groups[items.member]
        low = np.fmax(below(items.forms, items.member), -np.inf)
        values = at_point(items.ends, items.member)  # (2, items)
        end, item = np.nonzero(values < attained[group])
        falling = np.argsort(values[end, item], kind="stable")[::-1]
        end, item = end[falling], item[falling]
        g = group[item]  # of one that is there several times, what is assigned last remains: the smallest
        attained[g] = values[end, item]
        cell[g], member[g], u[g] = items.cell[item], items.member[item], items.start[item] + end * items.width
        enough = np.maximum(attained - goal.gap, np.where(attained < goal.threshold, -np.inf, goal.threshold))
        keep = ~(low >= enough[group]) & np.isfinite(low)
        kept = np.flatnonzero(keep)
        halvings = min(3 if 8 * len(kept) <= FEW_ITEMS else 1, DEEPEST - depth)
        if halvings == 0 or 2 * len(kept) > MOST_ITEMS:
            keep[:] = False
        np.minimum.at(bound, group[~keep], low[~keep])
        if not keep.any():
            break
        items, depth = items.split(kept, halvings), depth + halvings
    return tuple(
        Minimum(bound, attained, cells.time(cell, u), member)
        for bound, attained, cell, u, member in zip(
            *(each.tolist() for each in (bound, attained, cell, u, member)), strict=True
        )
    )
