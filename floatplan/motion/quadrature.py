"""Spectral quadrature on [0, 1]: Gauss-Legendre nodes, and integrals up to any instant between them.

The integrand of (14) and (18) is analytic, so its Legendre coefficients fall geometrically, and their tail says whether
the nodes are enough (Trefethen, Approximation Theory and Approximation Practice, ch. 8 and 19).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev, legendre

from floatplan.arrays import Array, read_only
from floatplan.pool.threads import one_thread

NODE_COUNTS = (16, 24, 32, 48, 64, 96, 128, 192, 256)
EIGENVALUES = 256  # nodes up to which NumPy's own way, by eigenvalues, is quick
NEWTON_STEPS = 3


@dataclass(frozen=True, eq=False)
class GaussLegendre:
    """Gauss-Legendre quadrature with N nodes on [0, 1].

    Attributes
    ----------
    nodes, weights : (N,)
    transform : (N, N)
        Legendre coefficients (in 2 s - 1) of the interpolant, from values at the nodes.
    """

    nodes: Array
    weights: Array
    transform: Array

    def integrals(self, instants: Array) -> Array:
        """Matrix (len(instants), N): values at the nodes to integrals of their interpolant over [0, instant]."""
        return chebyshev_values(2 * instants - 1, len(self.nodes)) @ self._antiderivative

    def integral(self, values: Array) -> Array:
        """Integral over [0, s] of the interpolant of ``values`` (N,), in Chebyshev polynomials of 2 s - 1: (N+1,)."""
        return self._antiderivative @ values

    @cached_property
    @one_thread
    def _antiderivative(self) -> Array:
        """Matrix (N+1, N): values at the nodes to Chebyshev coefficients (in 2 s - 1) of their interpolant's integral.

        The integrals of Legendre polynomials have their Chebyshev coefficients from their values at the roots of a
        Chebyshev polynomial. Chebyshev polynomials are cheap to evaluate, Legendre ones are not.
        """
        count = len(self.nodes)
        x = chebyshev.chebpts1(count + 1)
        legendre_values = legendre.legvander(x, count)
        degree = np.arange(1, count)
        integrals = np.empty((count + 1, count))
        integrals[:, 0] = (x + 1) / 2
        integrals[:, 1:] = (legendre_values[:, 2:] - legendre_values[:, :-2]) / (2 * (2 * degree + 1))
        coefficients = chebyshev.chebvander(x, count).T @ integrals * (2 / (count + 1))
        coefficients[0] /= 2
        return read_only(np.triu(coefficients, -1) @ self.transform)

    def interpolation(self, instants: Array) -> Array:
        """Matrix (len(instants), N): values at the nodes to values of their interpolant at the instants."""
        return legendre.legvander(2 * instants - 1, len(self.nodes) - 1) @ self.transform

    def tail(self, values: Array) -> float:
        """Size of the last three Legendre coefficients of the interpolant of ``values`` (N,)."""
        return float(np.abs(self.transform[-3:] @ values).max())


def chebyshev_values(x: Array, degree: int) -> Array:
    """Chebyshev polynomials T_0, ..., T_degree at x: (len(x), degree+1).

    By ``T_(m+k) = 2 T_m T_k - T_(m-k)``, which doubles their number at each step.
    """
    values = np.ones((degree + 1, len(x)))
    values[1:2] = x
    known = 1
    while known < degree:
        more = min(known, degree - known)
        new = values[known + 1 : known + more + 1]
        np.multiply(values[1 : more + 1], 2 * values[known], out=new)
        new -= values[known - more : known][::-1]
        known += more
    return values.T


def _newton(count: int) -> tuple[Array, Array]:
    """Nodes and weights on [-1, 1] by Newton's method, from Tricomi's asymptotic nodes: in count^2 operations."""
    angle = np.pi * (4 * np.arange(count, 0, -1) - 1) / (4 * count + 2)
    x = (1 - (count - 1) / (8 * count**3)) * np.cos(angle)
    for _ in range(NEWTON_STEPS):
        before, value = legendre.legvander(x, count).T[-2:]
        slope = count * (before - x * value) / (1 - x**2)
        x = x - value / slope
    x = (x - x[::-1]) / 2
    before, value = legendre.legvander(x, count).T[-2:]
    w = 2 * (1 - x**2) / (count * (before - x * value)) ** 2
    return x, 2 * w / w.sum()


@lru_cache(maxsize=32)
def gauss_legendre(count: int) -> GaussLegendre:
    """Return the quadrature with ``count`` nodes."""
    x, w = legendre.leggauss(count) if count <= EIGENVALUES else _newton(count)
    degree = np.arange(count)
    transform = (degree[:, None] + 0.5) * legendre.legvander(x, count - 1).T * w
    return GaussLegendre(read_only((x + 1) / 2), read_only(w / 2), read_only(transform))
