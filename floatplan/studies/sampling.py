"""Which rows a study has: a grid, or points drawn at random or by Sobol's sequence; by their index, repeatable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array
from floatplan.studies.numbers import Quantity

Kind: TypeAlias = Literal["grid", "random", "sobol"]
Values: TypeAlias = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Axis:
    """A number that varies: the values of a grid, or the ends of its range, in the file's unit."""

    path: str
    quantity: Quantity
    values: Array

    def column(self, values: Array) -> npt.NDArray[Any]:
        """Values as the table has them, and the problem takes them."""
        return values.astype(np.int64) if self.quantity.whole else values


@dataclass(frozen=True, eq=False)
class Samples:
    """The rows: those of a grid in the order of its keys, the last one fastest.

    A row drawn is the same whatever their number is.
    """

    axes: Sequence[Axis]
    kind: Kind
    count: int
    seed: int

    def values(self, first: int, stop: int) -> Values:
        """Values (stop - first,) of the rows from ``first`` on, by path, in the file's units."""
        if self.kind == "grid":
            places = np.unravel_index(np.arange(first, stop), [len(axis.values) for axis in self.axes])
            return {axis.path: axis.column(axis.values[at]) for axis, at in zip(self.axes, places, strict=True)}
        shares = self._drawn[first:stop]
        ends = [(axis.values[0], axis.values[-1]) for axis in self.axes]
        return {
            axis.path: axis.column(low + (high - low) * shares[:, index])
            for index, (axis, (low, high)) in enumerate(zip(self.axes, ends, strict=True))
        }

    @cached_property
    def _drawn(self) -> Array:
        """Shares (count, axes) of the ranges, from 0 to 1."""
        if self.kind == "random":
            return np.random.default_rng(self.seed).random((self.count, len(self.axes)))
        from scipy.stats import qmc  # slow to load

        sequence = qmc.Sobol(len(self.axes), scramble=True, rng=np.random.default_rng(self.seed))
        return np.asarray(sequence.random_base2(math.ceil(math.log2(self.count)))[: self.count])
