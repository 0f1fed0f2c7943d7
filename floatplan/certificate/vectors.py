"""Vectors of the plane as pairs of Taylor models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.enclosure import Taylor, stack


@dataclass(frozen=True, eq=False)
class Rough:
    """Vectors (cells, items) in the middle of cells, how well they are known there, and how far from there they get."""

    x: Array
    y: Array
    radius: Array
    spread: Array


@dataclass(frozen=True, eq=False)
class Vectors:
    """Models of vectors, (K, cells, items) or (K, items) each; one item may stand for all."""

    x: Taylor
    y: Taylor

    def __sub__(self, other: Vectors) -> Vectors:
        return Vectors(self.x - other.x, self.y - other.y)

    def turned_back(self, direction: Vectors) -> Vectors:
        """Components along ``direction`` (unit vectors) and across it, to its left."""
        return Vectors(
            direction.x * self.x + direction.y * self.y,
            direction.x * self.y - direction.y * self.x,
        )

    def chosen(self, items: Sequence[int]) -> Vectors:
        """Some of the items; the one that stands for all stays."""
        if self.x.e.shape[-1] == 1:
            return self
        index = (slice(None), list(items))
        return Vectors(self.x[index], self.y[index])

    def picked(self, cell: IntArray, item: IntArray) -> Vectors:
        """Models (K, len(cell)) of single items on single cells."""
        item = item if self.x.e.shape[-1] > 1 else np.zeros_like(item)
        return Vectors(self.x[cell, item], self.y[cell, item])

    def repeated(self, count: int) -> Vectors:
        """``count`` items, where one stands for all."""
        if self.x.e.shape[-1] == count:
            return self
        index = (slice(None), [0] * count)
        return Vectors(self.x[index], self.y[index])

    def on(self, cells: IntArray) -> Rough:
        """A rough view on some cells."""
        x, y = self.x[cells], self.y[cells]
        radius = x.e + y.e
        spread = np.abs(x.c[1:]).sum(axis=0) + np.abs(y.c[1:]).sum(axis=0) + radius
        return Rough(x.c[0], y.c[0], radius, spread)


def join_vectors(parts: Sequence[Vectors]) -> Vectors:
    """Join along the last axis."""
    return Vectors(stack([part.x for part in parts]), stack([part.y for part in parts]))
