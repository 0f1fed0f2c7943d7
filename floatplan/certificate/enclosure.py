"""Enclosures in double precision: numbers as midpoint and radius, functions as polynomials with a remainder.

A :class:`Taylor` stands for every function f on [-1, 1] with ``|f(u) - sum_k c_k u^k| <= e``. Every operation returns
a model that contains the exact result for all functions that its operands stand for (Makino and Berz 2003; Revol,
Makino and Berz 2005), so rounding may never be forgotten:

- A double operation has relative error at most 2^-53 (IEEE 754, to nearest). A sum of n products, in any order and
  with or without fused operations, is off by at most ``n 2^-53 / (1 - n 2^-53) sum |a_i b_i|`` (Higham 2002, 3.1).
  :data:`ROUND` is twice the unit, which pays for the denominator and for the error of the bound itself.
- Radii are sums and products of non-negative doubles; :func:`up` enlarges each result by more than all of their
  rounding, and by more than anything that underflows.

Transcendental constants come from Arb. Whatever overflows ends as an infinite or undefined radius, with which no
comparison proves anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array, read_only

ROUND = 2.0**-52  # [-] twice the unit roundoff of doubles
PRECISION = 128  # [bits] of Arb


def up(radius: Array) -> Array:
    """Enlarge radii by more than the rounding of the few hundred non-negative operations that they result from."""
    enlarged = radius * (1.0 + 2.0**-40)
    enlarged += 1e-290  # more than any sum of products that underflow is off by
    return enlarged


@dataclass(frozen=True, eq=False)
class Balls:
    """Real numbers known to within a radius: arrays of one shape."""

    mid: Array
    rad: Array

    @classmethod
    def from_arb(cls, values: Iterable[Any], shape: tuple[int, ...]) -> Balls:
        """Round Arb's balls to doubles; the radius takes in the rounding."""
        balls = list(values)
        mid = np.array(list(map(float, balls)), dtype=np.float64).reshape(shape)
        rad = np.array([float(ball.rad()) for ball in balls], dtype=np.float64).reshape(shape)
        return cls(mid, up(rad + ROUND * np.abs(mid)))

    @classmethod
    def exact(cls, values: Any) -> Balls:
        """Doubles as they are."""
        mid = np.asarray(values, dtype=np.float64)
        return cls(mid, np.zeros_like(mid))

    def broadcast(self, shape: tuple[int, ...]) -> Balls:
        """The same balls for every entry of a shape."""
        return Balls(np.broadcast_to(self.mid, shape), np.broadcast_to(self.rad, shape))

    @property
    def transposed(self) -> Balls:
        """The matrix transposed."""
        return Balls(self.mid.T, self.rad.T)

    @classmethod
    def joined(cls, balls: Sequence[Balls]) -> Balls:
        """The rows of all."""
        return cls(np.concatenate([ball.mid for ball in balls]), np.concatenate([ball.rad for ball in balls]))

    def __neg__(self) -> Balls:
        return Balls(-self.mid, self.rad)

    def __add__(self, other: Balls) -> Balls:
        total = self.mid + other.mid
        return Balls(total, up(self.rad + other.rad + ROUND * np.abs(total)))

    def __getitem__(self, index: Any) -> Balls:
        return Balls(self.mid[index], self.rad[index])


@dataclass(frozen=True, eq=False)
class Taylor:
    """Functions on [-1, 1] as polynomials with a uniform remainder.

    Attributes
    ----------
    c : (K, ...)
        Coefficients of powers of u, lowest first.
    e : (...)
        Radius: a bound on ``|f(u) - sum_k c_k u^k|`` for all u in [-1, 1].
    """

    c: Array
    e: Array

    @classmethod
    def polynomial(cls, coefficients: Array, radii: Array, order: int) -> Taylor:
        """Model of polynomials with ``coefficients`` (L, ...) known to within ``radii`` (L, ...); K = ``order``."""
        tail = np.abs(coefficients[order:]).sum(axis=0)
        leading = np.zeros((order, *coefficients.shape[1:]))
        leading[: len(coefficients)] = coefficients[:order]
        return cls(leading, up(radii.sum(axis=0) + tail))

    @classmethod
    def constant(cls, balls: Balls, order: int) -> Taylor:
        """Model of constants."""
        c = np.zeros((order, *balls.mid.shape))
        c[0] = balls.mid
        return cls(c, balls.rad)

    @property
    def size(self) -> Array:
        """Bound on ``|sum_k c_k u^k|``: the sum of the coefficients' magnitudes, not rounded up."""
        return np.asarray(np.add.reduce(np.abs(self.c), axis=0))

    @property
    def order(self) -> int:
        """Number of coefficients K."""
        return len(self.c)

    def __getitem__(self, index: Any) -> Taylor:
        return Taylor(self.c[(slice(None), *(index if isinstance(index, tuple) else (index,)))], self.e[index])

    def __neg__(self) -> Taylor:
        return Taylor(-self.c, self.e)

    def __add__(self, other: Taylor) -> Taylor:
        c = self.c + other.c
        return Taylor(c, up(self.e + other.e + ROUND * np.add.reduce(np.abs(c), axis=0)))

    def __sub__(self, other: Taylor) -> Taylor:
        c = self.c - other.c
        return Taylor(c, up(self.e + other.e + ROUND * np.add.reduce(np.abs(c), axis=0)))

    def __mul__(self, other: Taylor) -> Taylor:
        """Product; what exceeds degree K - 1 goes into the radius."""
        c = np.einsum("i...,ik...->k...", self.c, _delayed(other.c))
        a = np.abs(self.c)
        b = np.abs(other.c)
        size_a = np.add.reduce(a, axis=0)
        size_b = np.add.reduce(b, axis=0)
        rounding = (self.order + 2) * ROUND * size_a * size_b
        radius = self.e * (size_b + other.e) + size_a * other.e
        return Taylor(c, up(radius + rounding + _tail(a, b)))

    def times(self, factor: Balls) -> Taylor:
        """Product with constants that broadcast against ``e``."""
        size = self.size
        radius = np.abs(factor.mid) * (self.e + ROUND * size) + factor.rad * (size + self.e)
        return Taylor(self.c * factor.mid, up(radius))

    def linear(self, matrix: Balls) -> Taylor:
        """Apply a matrix (out, in) to the last axis: ``y_o = sum_i A_oi x_i``."""
        size = self.size
        magnitude = np.abs(matrix.mid).T
        count = matrix.mid.shape[1] + 2
        radius = (self.e + count * ROUND * size) @ magnitude + (size + self.e) @ matrix.rad.T
        return Taylor(self.c @ matrix.mid.T, up(radius))

    def sum(self) -> Taylor:
        """Sum over the last axis, which stays with length 1."""
        count = self.c.shape[-1]
        radius = self.e + count * ROUND * self.size
        return Taylor(self.c.sum(axis=-1, keepdims=True), up(radius.sum(axis=-1, keepdims=True)))

    def at_end(self, u: float) -> Balls:
        """Value at u = -1 or +1."""
        mid = np.einsum("k,k...->...", _signs(self.order) if u < 0.0 else np.ones(self.order), self.c)
        return Balls(mid, up(self.e + self.order * ROUND * self.size))


def stack(models: Sequence[Taylor]) -> Taylor:
    """Join models along the last axis."""
    return Taylor(np.concatenate([m.c for m in models], axis=-1), np.concatenate([m.e for m in models], axis=-1))


def products(pairs: Sequence[tuple[Taylor, Taylor]]) -> list[Taylor]:
    """Products of pairs of models of one shape (K, ..., items): as one by one, in fewer and longer operations."""
    joined = stack([pair[0] for pair in pairs]) * stack([pair[1] for pair in pairs])
    c = joined.c.reshape(*joined.c.shape[:-1], len(pairs), -1)
    e = joined.e.reshape(*joined.e.shape[:-1], len(pairs), -1)
    return [Taylor(c[..., index, :], e[..., index, :]) for index in range(len(pairs))]


def cos_sin(angle: Taylor) -> tuple[Taylor, Taylor]:
    """Cosine and sine of a model.

    With d the polynomial part, ``E' = i d' E`` gives the coefficients of ``E = exp(i d)`` one after the other. The
    computed E is judged by its residual: for any polynomial E, ``|E(u) - exp(i d(u))| <= |E(0) - exp(i d(0))| + sup
    |E' - i d' E|``, because ``E exp(-i d)`` has the derivative ``(E' - i d' E) exp(-i d)``. The residual consists of
    rounding in the degrees below K - 1, and of the product's tail. Coefficient k of E is a sum of k products, each
    term of which is rounded k + 3 times at most; k is no more than j times i + 1 for the product of the rates'
    coefficient j with E's coefficient i, where i + j = k. A radius of the angle moves cosine and sine by no more than
    itself.
    """
    order = angle.order
    rates = angle.c * np.arange(order).reshape(-1, *(1,) * angle.e.ndim)
    e = np.empty(angle.c.shape, dtype=np.complex128)
    e.real[0], e.imag[0], radius = _unit_circle(angle.c[0])
    turning = 1j * rates[1:]
    for k in range(1, order):
        np.multiply(np.add.reduce(turning[:k] * e[k - 1 :: -1], axis=0), 1.0 / k, out=e[k])
    size_rates = np.abs(rates)
    size_e = np.abs(e)
    weights = np.arange(order).reshape(-1, *(1,) * angle.e.ndim)
    weighed = np.add.reduce(size_rates * weights, axis=0) * np.add.reduce(size_e * (weights + 1), axis=0)
    rounding = ROUND * (weighed + 4.0 * np.add.reduce(size_rates, axis=0) * np.add.reduce(size_e, axis=0))
    residual = rounding + _tail(size_rates, size_e)
    radius = up(angle.e + radius + up(residual))
    return Taylor(e.real.copy(), radius), Taylor(e.imag.copy(), radius)


def reciprocal(x: Taylor) -> Taylor:
    """One over a model that stays away from zero; an infinite radius where that is not shown.

    For the computed polynomial y of 1/x: ``1/f - y = y (1 - f y) / (f y)``, so with ``|1 - f y| <= r < 1`` the radius
    is ``|y| r / (1 - r)``. ``1 - f y`` consists of rounding in the degrees below K, of the product's tail, and of x's
    radius.
    """
    order = x.order
    y = np.empty_like(x.c)
    y[0] = 1.0 / x.c[0]
    first = -y[0]
    for k in range(1, order):
        np.multiply(np.add.reduce(x.c[1 : k + 1] * y[k - 1 :: -1], axis=0), first, out=y[k])
    size_x = np.abs(x.c)
    size_y = np.abs(y)
    total = np.add.reduce(size_y, axis=0)
    rounding = (order + 8) * ROUND * np.add.reduce(size_x, axis=0) * total
    r = up(rounding + _tail(size_x, size_y) + x.e * total)
    return Taylor(y, up(np.where(r < 0.5, total * r / np.where(r < 0.5, 1.0 - r, 1.0), np.inf)))


def integral(rate: Taylor) -> Taylor:
    """Integral from -1 to u of a model."""
    order = rate.order
    degrees = np.arange(1, order + 1).reshape(-1, *(1,) * rate.e.ndim)
    full = rate.c / degrees
    c = np.zeros_like(rate.c)
    c[1:] = full[:-1]
    c[0] = -np.einsum("k,k...->...", _signs(order), c)
    size = np.abs(full).sum(axis=0)
    return Taylor(c, up(2.0 * rate.e + 2.0 * np.abs(full[-1]) + (order + 4) * ROUND * size))


@cache
def _signs(order: int) -> Array:
    """Powers of -1."""
    return read_only(np.where(np.arange(order) % 2, -1.0, 1.0))


def _tail(a: Array, b: Array) -> Array:
    """Sum of ``a_i b_j`` over ``i + j >= K``, for non-negative (K, ...)."""
    last = np.add.accumulate(b[:0:-1], axis=0)
    return np.asarray(np.add.reduce(a[1:] * last, axis=0))


def _delayed(b: Array) -> Array:
    """View (K, K, ...) of ``b_(k-i)`` in row i and column k, which is zero where k < i."""
    order = len(b)
    padded = np.zeros((2 * order - 1, *b.shape[1:]))
    padded[order - 1 :] = b
    step = padded.strides[0]
    return np.ndarray((order, *b.shape), np.float64, padded, (order - 1) * step, (-step, *padded.strides))


def _unit_circle(angles: Array) -> tuple[Array, Array, Array]:
    """Cosines and sines of doubles, and a radius for each."""
    with flint.ctx.workprec(PRECISION):
        values: list[Any] = []
        for angle in angles.ravel().tolist():
            values += flint.arb(angle).sin_cos()
        widest = float(sum(values, flint.arb(0)).rad())  # of a sum, which is wider than its terms
    sines, cosines = np.array(list(map(float, values))).reshape(-1, 2).T
    radius = up(np.full(angles.shape, 2.0 * ROUND + 2.0 * widest))
    return cosines.reshape(angles.shape), sines.reshape(angles.shape), radius
