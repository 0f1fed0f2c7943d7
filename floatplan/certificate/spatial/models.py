"""Taylor models of matrices with two radii side by side, one of each entry and one in the Euclidean norm.

The spectral norm of a rotation is 1, so that in this norm the radii of a product of rotations add up, where radii of
entries grow by up to sqrt(3) with each factor: 700 times after the twelve joints of a chain. Entries know instead that
a slender body has little inertia about its long axis, and little error in it. Every operation carries both, and of
each the smaller one counts. Vectors are matrices of one column, for which the norm is the length, and scalars are
matrices (1, 1).

As in :mod:`~floatplan.certificate.enclosure`, every operation returns a model that contains the exact result for all
functions that its operands stand for. Two facts serve throughout: the Frobenius norm, which is computed, is no less
than the spectral norm; and ``| |A| |B| |_F <= |A|_F |B|_F`` for the matrices of magnitudes, by which rounding is
bounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.certificate.cells import ORDER
from floatplan.certificate.enclosure import Balls, Taylor, up

UNIT = 2.0**-53 * (1.0 + 2.0**-20)  # a sum of n products is off by n UNIT of their magnitudes, for n up to 2^32
DEGREES = np.arange(ORDER)


@dataclass(frozen=True, eq=False)
class Matrices:
    """Functions F on [-1, 1] with matrices as values.

    Attributes
    ----------
    c : (cells, items, K, p, q)
        Coefficients of powers of u, lowest first.
    e : (cells, items)
        Radius: a bound on the spectral norm of ``F(u) - sum_k c_k u^k`` for all u in [-1, 1].
    entries : (cells, items, p, q)
        Radii: the same of the magnitudes of its entries.
    norm : (cells, items)
        A bound on the spectral norm of F(u).
    """

    c: Array
    e: Array
    entries: Array
    norm: Array

    @classmethod
    def of(cls, c: Array, entries: Array, e: Array | None = None, norm: Array | None = None) -> Matrices:
        """Of each radius the smaller one; norms are at most what the coefficients say, or ``norm``, if it is known."""
        length = up(frobenius(entries))
        e = length if e is None else np.fmin(e, length)
        entries = np.fmin(entries, e[..., None, None])
        bound = up(frobenius(c).sum(axis=-1) + e)
        return cls(c, e, entries, bound if norm is None else np.fmin(bound, norm))

    @classmethod
    def exact(cls, c: Array) -> Matrices:
        """Polynomials (cells, items, K, p, q) as they are."""
        return cls.of(c, np.zeros(c.shape[:2] + c.shape[3:]))

    @classmethod
    def of_scalars(cls, models: Taylor) -> Matrices:
        """Models (K, cells, items) of scalars as matrices (1, 1)."""
        return cls.of(np.ascontiguousarray(models.c.transpose(1, 2, 0))[..., None, None], models.e[..., None, None])

    @classmethod
    def constant(cls, values: Balls, cells: int) -> Matrices:
        """The same constant matrices (items, p, q), whose entries are within radii, on all cells."""
        c = np.zeros((cells, len(values.mid), ORDER, *values.mid.shape[1:]))
        c[:, :, 0] = values.mid
        return cls.of(c, np.broadcast_to(values.rad, (cells, *values.rad.shape)))

    @cached_property
    def sizes(self) -> Array:
        """Frobenius norms (cells, items, K) of the coefficients."""
        return frobenius(self.c)

    @cached_property
    def size(self) -> Array:
        """Bound (cells, items) on the norm of the polynomial part, not rounded up."""
        return np.asarray(self.sizes.sum(axis=-1))

    @cached_property
    def magnitudes(self) -> Array:
        """Magnitudes (cells, items, K, p, q) of the coefficients."""
        return np.abs(self.c)

    @cached_property
    def magnitude(self) -> Array:
        """Bounds (cells, items, p, q) on the entries of the polynomial part, not rounded up."""
        return np.asarray(self.magnitudes.sum(axis=2))

    @property
    def transposed(self) -> Matrices:
        """The matrices transposed."""
        return Matrices(self.c.swapaxes(-1, -2), self.e, self.entries.swapaxes(-1, -2), self.norm)

    def __getitem__(self, items: Any) -> Matrices:
        """Some of the items, maybe repeatedly."""
        return Matrices(self.c[:, items], self.e[:, items], self.entries[:, items], self.norm[:, items])

    def on_cells(self, cells: IntArray | BoolArray) -> Matrices:
        """The models of some cells, or in another order."""
        return Matrices(self.c[cells], self.e[cells], self.entries[cells], self.norm[cells])

    def __neg__(self) -> Matrices:
        return Matrices(-self.c, self.e, self.entries, self.norm)

    def __add__(self, other: Matrices) -> Matrices:
        result = Matrices.exact(self.c + other.c)
        entries = self.entries + other.entries + UNIT * result.magnitude
        return Matrices.of(result.c, up(entries), up(self.e + other.e + UNIT * result.size))

    def __sub__(self, other: Matrices) -> Matrices:
        return self + -other

    def widened(self, radius: Array, norm: float | None = None) -> Matrices:
        """The same models, of functions that may be off by matrices of spectral norm ``radius`` (cells, items) more."""
        entries = up(self.entries + radius[..., None, None])
        bound = None if norm is None else np.full_like(radius, norm)
        return Matrices.of(self.c, entries, up(self.e + radius), bound)

    def scaled(self, factors: Balls) -> Matrices:
        """Products with constants (cells, 1)."""
        size = np.abs(factors.mid)
        e = size * (self.e + UNIT * self.size) + factors.rad * (self.size + self.e)
        size, radius = size[..., None, None], factors.rad[..., None, None]
        entries = size * (self.entries + UNIT * self.magnitude) + radius * (self.magnitude + self.entries)
        return Matrices.of(self.c * factors.mid[..., None, None, None], up(entries), up(e))

    def __matmul__(self, other: Matrices) -> Matrices:
        """Products item by item; what exceeds degree K - 1 goes into the radii.

        For the polynomial parts A and B, ``F G - A B = (F - A) G + A (G - B)``. Coefficient k of ``A B`` has sums of
        ``(k + 1) p`` products, all others being zero, and so the rounding of all of them is within
        ``p UNIT sum_i (i + 1) |A_i| sum_j (j + 1) |B_j|``, since ``i + j + 1 <= (i + 1) (j + 1)``.
        """
        inner = self.c.shape[-1]
        weights = DEGREES + 1.0
        rounding = inner * UNIT * (self.sizes @ weights) * (other.sizes @ weights)
        last = np.cumsum(other.sizes[..., :0:-1], axis=-1)
        tail = (self.sizes[..., 1:] * last).sum(axis=-1)
        e = self.e * other.norm + (self.norm + self.e) * other.e + rounding + tail
        weights = weights[:, None, None]
        of_entries = inner * UNIT * ((self.magnitudes * weights).sum(axis=2) @ (other.magnitudes * weights).sum(axis=2))
        last = np.cumsum(other.magnitudes[:, :, :0:-1], axis=2)
        of_entries += (self.magnitudes[:, :, 1:] @ last).sum(axis=2)
        of_entries += self.entries @ (other.magnitude + other.entries) + self.magnitude @ other.entries
        return Matrices.of(_convolved(self.c, other.c), up(of_entries), up(e), up(self.norm * other.norm))

    def sums(self, chosen: Array) -> Matrices:
        """Sums (out) of the items that are chosen by a matrix (out, items) of zeros and ones."""
        cells, items = self.e.shape
        count = chosen.sum(axis=1).max(initial=0.0)
        c = (chosen @ self.c.reshape(cells, items, -1)).reshape(cells, len(chosen), *self.c.shape[2:])
        radii = (self.entries + count * UNIT * self.magnitude).reshape(cells, items, -1)
        entries = (chosen @ radii).reshape(cells, len(chosen), *self.c.shape[3:])
        return Matrices.of(c, up(entries), up((self.e + count * UNIT * self.size) @ chosen.T))

    def summed(self) -> Matrices:
        """The sum over all items, one item."""
        return self.sums(np.ones((1, self.c.shape[1])))

    def of_blocks(self, constants: BlockMatrix) -> Matrices:
        """Products with a constant matrix of blocks from the right: ``G_j = sum_i F_i C_ij``.

        Sums of ``width`` products are made of sums of about as many as their root, and so rounded as often as two such.
        """
        cells, items, order, rows, columns = self.c.shape
        width = items * columns
        few = math.ceil(math.sqrt(width))
        count = few + math.ceil(width / few) - 1
        blocks = constants.sizes.shape[1]
        side = self.c.transpose(0, 2, 3, 1, 4).reshape(-1, width)
        c = np.zeros((len(side), constants.mid.shape[1]))
        for first in range(0, width, few):
            c += side[:, first : first + few] @ constants.mid[first : first + few]
        c = c.reshape(cells, order, rows, blocks, -1).transpose(0, 3, 1, 2, 4)
        radii, magnitude = (each.transpose(0, 2, 1, 3).reshape(-1, width) for each in (self.entries, self.magnitude))
        entries = (radii + count * UNIT * magnitude) @ np.abs(constants.mid) + (magnitude + radii) @ constants.rad
        entries = entries.reshape(cells, rows, blocks, -1).transpose(0, 2, 1, 3)
        e = (self.e + count * UNIT * self.size) @ constants.sizes + (self.size + self.e) @ constants.radii
        return Matrices.of(np.ascontiguousarray(c), up(entries), up(e))

    def times(self, constants: Balls) -> Matrices:
        """Products with constant matrices (items, q, r) from the right."""
        count = self.c.shape[-1]
        size = frobenius(constants.mid)
        e = size * (self.e + count * UNIT * self.size) + (self.size + self.e) * frobenius(constants.rad)
        entries = (self.entries + count * UNIT * self.magnitude) @ np.abs(constants.mid)
        entries += (self.magnitude + self.entries) @ constants.rad
        return Matrices.of(self.c @ constants.mid[:, None], up(entries), up(e))

    def at(self, u: float) -> tuple[Array, Array]:
        """Values (cells, items, p, q) of the models at a u in [-1, 1], and radii (cells, items) in the spectral norm.

        By Horner's rule, in which each coefficient is rounded less than 2 K times.
        """
        value = self.c[:, :, -1]
        for k in range(self.c.shape[2] - 2, -1, -1):
            value = value * u + self.c[:, :, k]
        return value, up(self.e + 2 * self.c.shape[2] * UNIT * self.size)

    def scalars(self) -> Taylor:
        """Models (K, cells, items p) of the entries of matrices (p, 1) as scalars."""
        cells, items, order, rows, _ = self.c.shape
        c = self.c[..., 0].transpose(2, 0, 1, 3).reshape(order, cells, items * rows)
        return Taylor(np.ascontiguousarray(c), self.entries[..., 0].reshape(cells, items * rows))


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A constant matrix of blocks, known to within radii; and of each block norm and radius (items in, items out)."""

    mid: Array
    rad: Array
    sizes: Array
    radii: Array

    @classmethod
    def of(cls, entries: Balls, rows: int, columns: int) -> BlockMatrix:
        """From the balls of all entries, in blocks (rows, columns)."""
        height, width = entries.mid.shape

        def norms(values: Array) -> Array:
            blocks = values.reshape(height // rows, rows, width // columns, columns)
            return up(frobenius(blocks.swapaxes(1, 2)))

        return cls(entries.mid, entries.rad, norms(entries.mid), norms(entries.rad))


def frobenius(matrices: Array) -> Array:
    """Frobenius norms (...) of matrices (..., p, q)."""
    return np.asarray(np.sqrt(np.einsum("...pq,...pq->...", matrices, matrices)))


def inverted(matrices: Array) -> Array:
    """Inverses (..., 3, 3) as doubles give them, not numbers where they give none."""
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        return np.full_like(matrices, np.nan)


def beside(models: Sequence[Matrices]) -> Matrices:
    """The items of all."""
    return _joined(models, axis=1)


def one_after_another(models: Sequence[Matrices]) -> Matrices:
    """The cells of all."""
    return _joined(models, axis=0)


def _joined(models: Sequence[Matrices], axis: int) -> Matrices:
    """The models of all, along an axis that all of their arrays have: cells or items."""
    return Matrices(
        c=np.concatenate([model.c for model in models], axis=axis),
        e=np.concatenate([model.e for model in models], axis=axis),
        entries=np.concatenate([model.entries for model in models], axis=axis),
        norm=np.concatenate([model.norm for model in models], axis=axis),
    )


def crossed(vectors: Matrices) -> Matrices:
    """The matrices ``[v]x`` of the cross product with vectors (3, 1); their norm is the vector's length."""
    entries = np.abs(cross_matrices(vectors.entries[..., 0]))
    return Matrices(cross_matrices(vectors.c[..., 0]), vectors.e, entries, vectors.norm)


def cross_matrices(vectors: Array) -> Array:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    c = np.zeros((*vectors.shape, 3))
    c[..., 2, 1], c[..., 0, 2], c[..., 1, 0] = (vectors[..., k] for k in range(3))
    c[..., 1, 2], c[..., 2, 0], c[..., 0, 1] = (-vectors[..., k] for k in range(3))
    return c


def axial(matrices: Matrices) -> Matrices:
    """The vectors ``sum_k x_k x y_k`` of matrices ``sum_k x_k y_k^T``: (Z_yz - Z_zy, Z_zx - Z_xz, Z_xy - Z_yx).

    Twice the norm of the antisymmetric part is the length of that vector.
    """
    pairs = ((1, 2), (2, 0), (0, 1))
    z, radii = matrices.c, matrices.entries
    result = Matrices.exact(np.stack([z[..., i, j] - z[..., j, i] for i, j in pairs], axis=-1)[..., None])
    entries = np.stack([radii[..., i, j] + radii[..., j, i] for i, j in pairs], axis=-1)[..., None]
    entries = entries + UNIT * result.magnitude
    return Matrices.of(result.c, up(entries), up(2.0 * matrices.e + UNIT * result.size))


def moments(matrices: Matrices) -> Matrices:
    """``tr(Z) 1 - Z^T`` of matrices Z (3, 3).

    Each number on the diagonal is the sum of the two others there. The trace is at most three times the spectral norm,
    so that a radius grows by four at most.
    """
    z, radii = matrices.c, matrices.entries
    others = np.ones((3, 3)) - np.eye(3)
    off = -z.swapaxes(-1, -2) * others
    result = Matrices.exact(off + (np.einsum("...pp->...p", z) @ others)[..., None] * np.eye(3))
    entries = radii.swapaxes(-1, -2) * others + (np.einsum("...pp->...p", radii) @ others)[..., None] * np.eye(3)
    entries = entries + 2.0 * UNIT * result.magnitude
    sums = np.einsum("...pp->...p", matrices.magnitude) @ others  # what is added on the diagonal may cancel
    entries = entries + 2.0 * UNIT * sums[..., None] * np.eye(3)
    return Matrices.of(result.c, up(entries), up(4.0 * matrices.e + 8.0 * UNIT * matrices.size))


def _convolved(a: Array, b: Array) -> Array:
    """Coefficients (cells, items, K, p, r) of products of polynomials (.., K, p, q) and (.., K, q, r), up to K - 1.

    One matrix of blocks ``a_(k-i)`` in row k and column i, zero where k < i, times the blocks of b.
    """
    cells, items = np.broadcast_shapes(a.shape[:2], b.shape[:2])
    order, rows, inner = a.shape[2:]
    columns = b.shape[-1]
    padded = np.zeros((*a.shape[:2], 2 * order - 1, rows, inner))
    padded[:, :, order - 1 :] = a
    cell, item, step, row, column = padded.strides
    blocks = np.lib.stride_tricks.as_strided(
        padded[:, :, order - 1 :],
        shape=(*a.shape[:2], order, rows, order, inner),
        strides=(cell, item, step, row, -step, column),
    )
    left = blocks.reshape(*a.shape[:2], order * rows, order * inner)
    right = np.ascontiguousarray(b).reshape(*b.shape[:2], order * inner, columns)
    return np.asarray((left @ right).reshape(cells, items, order, rows, columns))
