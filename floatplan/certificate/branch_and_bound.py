"""Smallest values over time: branch and bound on Bernstein forms, for many groups at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.bernstein import halves
from floatplan.certificate.cells import Cells
from floatplan.certificate.enclosure import Balls, Taylor

Forms: TypeAlias = tuple[Taylor, ...]
DEEPEST = 30  # halvings of a cell
MOST_ITEMS = 60_000


@dataclass(frozen=True)
class Minimum:
    """Smallest value of a group: it is at least ``bound``, and at ``instant`` (s) it is at most ``attained``."""

    bound: float
    attained: float
    instant: float
    member: int


@dataclass(frozen=True, eq=False)
class Items:
    """Pieces of the search: Bernstein forms (K, items) on [start, start + width] of a cell, for a member of a group."""

    forms: Forms
    cell: IntArray
    member: IntArray
    start: Array
    width: Array

    @classmethod
    def whole_cells(cls, forms: Sequence[Taylor], cells: IntArray) -> Items:
        """All members (last axis) on the given cells, for forms (K, cells, members)."""
        count = forms[0].e.shape[1]
        flat = tuple(Taylor(f.c[:, cells].reshape(f.order, -1), f.e[cells].ravel()) for f in forms)
        return cls.on_cells(flat, np.repeat(cells, count), np.tile(np.arange(count), len(cells)))

    @classmethod
    def on_cells(cls, forms: Forms, cell: IntArray, member: IntArray) -> Items:
        """Items that are whole cells, for forms (K, items)."""
        return cls(forms, cell, member, np.full(len(cell), -1.0), np.full(len(cell), 2.0))

    def halved(self, keep: IntArray) -> Items:
        """The two halves of the items to keep."""
        half, start, both = 0.5 * self.width[keep], self.start[keep], np.concatenate([keep, keep])
        return Items(
            tuple(halves(form[keep]) for form in self.forms),
            self.cell[both],
            self.member[both],
            np.concatenate([start, start + half]),
            np.concatenate([half, half]),
        )


@dataclass(frozen=True, eq=False)
class Goal:
    """A group's search ends when bound and attained value are within ``gap`` and on one side of ``threshold``."""

    gap: Array
    threshold: Array


Below: TypeAlias = Callable[[Forms, IntArray], Array]
AtPoint: TypeAlias = Callable[[tuple[Balls, ...], IntArray], Array]


def smallest(
    items: Items, groups: IntArray, below: Below, at_point: AtPoint, goal: Goal, cells: Cells
) -> tuple[Minimum, ...]:
    """Enclose the smallest value of each group over all of its items.

    Parameters
    ----------
    items : Items
    groups : (members,)
        Group of each member.
    below : (forms, members) -> (items,)
        A lower bound on the values over the items.
    at_point : (values, members) -> (items,)
        An upper bound on the values where the forms have these values.
    """
    count = len(goal.gap)
    bound, attained = np.full(count, np.inf), np.full(count, np.inf)
    place: list[tuple[int, float, int]] = [(0, -1.0, 0)] * count
    for depth in range(DEEPEST + 1):
        group = groups[items.member]
        low = np.where(np.isnan(value := below(items.forms, items.member)), -np.inf, value)
        ends = tuple(
            Balls(np.concatenate([form.c[0], form.c[-1]]), np.concatenate([form.e, form.e])) for form in items.forms
        )
        values = at_point(ends, np.concatenate([items.member, items.member]))
        _improve(attained, place, np.concatenate([group, group]), values, items)
        apart = ~(low >= attained[group] - goal.gap[group])
        threshold = goal.threshold[group]
        open_question = ~(low >= threshold) & ~(attained[group] < threshold)
        keep = (apart | open_question) & np.isfinite(low)
        if depth == DEEPEST or 2 * keep.sum() > MOST_ITEMS:
            keep[:] = False
        np.minimum.at(bound, group[~keep], low[~keep])
        if not keep.any():
            break
        items = items.halved(np.flatnonzero(keep))
    return tuple(
        Minimum(float(b), float(a), cells.time(cell, u), member)
        for b, a, (cell, u, member) in zip(bound, attained, place, strict=True)
    )


def _improve(
    attained: Array, place: list[tuple[int, float, int]], group: IntArray, values: Array, items: Items
) -> None:
    """Take over what is smaller than the smallest value attained so far, in each group.

    ``values`` and ``group`` are those at the beginning of all items, then those at their ends.
    """
    better = np.flatnonzero(values < attained[group])
    falling = better[np.argsort(values[better], kind="stable")][::-1]
    for g, index in dict(zip(group[falling].tolist(), falling.tolist(), strict=True)).items():
        last, item = divmod(index, len(items.cell))
        attained[g] = values[index]
        place[g] = (
            int(items.cell[item]),
            float(items.start[item] + last * items.width[item]),
            int(items.member[item]),
        )
