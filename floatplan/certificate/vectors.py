"""Vectors of the plane: constants as complex numbers, and pairs of Taylor models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.enclosure import Balls, Taylor, products, stack


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
        if direction.x.e.shape == self.x.e.shape:
            x_x, y_y, x_y, y_x = products(
                [(direction.x, self.x), (direction.y, self.y), (direction.x, self.y), (direction.y, self.x)]
            )
        else:  # one direction for all items
            both = stack([self.x, self.y])
            of_x, of_y = direction.x * both, direction.y * both
            count = self.x.e.shape[-1]
            x_x, x_y = of_x[..., :count], of_x[..., count:]
            y_x, y_y = of_y[..., :count], of_y[..., count:]
        return Vectors(x_x + y_y, x_y - y_x)

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


@dataclass(frozen=True, eq=False)
class ComplexBalls:
    """Complex numbers known to within a radius in each part."""

    re: Balls
    im: Balls

    @classmethod
    def from_acb(cls, values: Sequence[Any], shape: tuple[int, ...]) -> ComplexBalls:
        """Round Arb's complex balls to doubles."""
        return cls(
            Balls.from_arb([value.real for value in values], shape),
            Balls.from_arb([value.imag for value in values], shape),
        )

    def __getitem__(self, index: Any) -> ComplexBalls:
        return ComplexBalls(self.re[index], self.im[index])

    @cached_property
    def adjoint(self) -> ComplexBalls:
        """The matrix transposed and conjugate."""
        return ComplexBalls(self.re.transposed, -self.im.transposed)

    def joined(self, other: ComplexBalls) -> ComplexBalls:
        """The rows of both."""
        return ComplexBalls(self.re.joined(other.re), self.im.joined(other.im))

    @cached_property
    def _parts(self) -> Balls:
        """Rows of the real parts, then those of the imaginary parts."""
        return self.re.joined(self.im)

    def times(self, re: Taylor, im: Taylor) -> Vectors:
        """The matrix (out, in) times complex models (K, cells, in), as vectors (K, cells, out)."""
        count = len(self.re.mid)
        of_re, of_im = re.linear(self._parts), im.linear(self._parts)
        return Vectors(of_re[..., :count] - of_im[..., count:], of_re[..., count:] + of_im[..., :count])
