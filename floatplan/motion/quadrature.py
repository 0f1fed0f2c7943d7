"""Analytic functions on [0, 1] from their values at nodes: integrals up to any instant, and extremes.

Integrals are from Gauss-Legendre nodes, extremes from Chebyshev's. The integrand of (14) and (18) is analytic, so its
Legendre coefficients fall geometrically, and their tail says whether the nodes are enough (Trefethen, Approximation
Theory and Approximation Practice, ch. 8 and 19).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.polynomial import chebyshev, legendre

from floatplan.arrays import Array, IntArray, distinct, read_only
from floatplan.pool import one_thread

NODE_COUNTS = (16, 24, 32, 48, 64, 96, 128, 192, 256)
# Nodes and weights (2, 856) on [-1, 1] of the rules of NODE_COUNTS, one after the other, from NumPy's leggauss(). Every
# search needs all of them, and to compute them takes 20 ms, a hundred times as long as most plans.
TABULATED = np.load(Path(__file__).with_name("gauss_legendre.npy"))


@dataclass(frozen=True, eq=False)
class GaussLegendre:
    """Gauss-Legendre quadrature with N nodes on [0, 1].

    Attributes
    ----------
    nodes, weights : (N,)
    transform : (N, N)
        Legendre coefficients (in 2 s - 1) of the interpolant, from values at the nodes.
    antiderivative : (N+1, N)
        Chebyshev coefficients (in 2 s - 1) of the interpolant's integral, from values at the nodes; (0, N) where the
        rule was made without.
    """

    nodes: Array
    weights: Array
    transform: Array
    antiderivative: Array

    def integrals(self, instants: Array) -> Array:
        """Matrix (len(instants), N): values at the nodes to integrals of their interpolant over [0, instant]."""
        return chebyshev_values(2 * instants - 1, len(self.nodes)) @ self.antiderivative

    def tail(self, values: Array) -> float:
        """Size of the last three Legendre coefficients of the interpolant of ``values`` (N,)."""
        return float(np.abs(self.transform[-3:] @ values).max())


@lru_cache(maxsize=32)
@one_thread
def gauss_legendre(count: int, integrates: bool = True) -> GaussLegendre:
    """Return the quadrature with ``count`` nodes, with the antiderivative, which takes most of the time, or without."""
    if count in NODE_COUNTS:
        first = sum(NODE_COUNTS[: NODE_COUNTS.index(count)])
        x, w = TABULATED[:, first : first + count]
    else:
        x, w = legendre.leggauss(count)
    transform = (np.arange(count)[:, None] + 0.5) * legendre.legvander(x, count - 1).T * w
    nodes = read_only((x + 1) / 2)
    weights = read_only(w / 2)
    if not integrates:
        return GaussLegendre(nodes, weights, read_only(transform), np.empty((0, count)))

    # The integrals of Legendre polynomials have their Chebyshev coefficients from their values at the roots of a
    # Chebyshev polynomial. Chebyshev polynomials are cheap to evaluate, Legendre ones are not.
    roots = chebyshev.chebpts1(count + 1)
    legendre_values = legendre.legvander(roots, count)
    degree = np.arange(1, count)
    integrals = np.empty((count + 1, count))
    integrals[:, 0] = (roots + 1) / 2
    integrals[:, 1:] = (legendre_values[:, 2:] - legendre_values[:, :-2]) / (2 * (2 * degree + 1))
    coefficients = chebyshev.chebvander(roots, count).T @ integrals * (2 / (count + 1))
    coefficients[0] /= 2
    return GaussLegendre(
        nodes=nodes,
        weights=weights,
        transform=read_only(transform),
        antiderivative=read_only(np.triu(coefficients, -1) @ transform),
    )


def chebyshev_values(x: Array, degree: int) -> Array:
    """Chebyshev polynomials T_0, ..., T_degree at x: (len(x), degree+1).

    By ``T_(m+k) = 2 T_m T_k - T_(m-k)``, which doubles their number step by step.
    """
    values = np.ones((degree + 1, len(x)))
    values[1:2] = x
    count = 1
    while count < degree:
        more = min(count, degree - count)
        new = values[count + 1 : count + more + 1]
        np.multiply(values[1 : more + 1], 2 * values[count], out=new)
        new -= values[count - more : count][::-1]
        count += more
    return values.T


@lru_cache(maxsize=16)
def chebyshev_nodes(count: int) -> Array:
    """``count`` Chebyshev-Lobatto nodes on [0, 1], rising from 0 to 1."""
    return read_only((1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2)


@lru_cache(maxsize=16)
@one_thread
def coefficient_map(count: int) -> Array:
    """Return the matrix (count, count) from values at the nodes to Chebyshev coefficients in 2 s - 1."""
    return read_only(np.linalg.inv(chebyshev.chebvander(2 * chebyshev_nodes(count) - 1, count - 1)))


@lru_cache(maxsize=16)
@one_thread
def _search(count: int) -> tuple[Array, Array, Array]:
    """Return a grid, the matrix from values at the nodes to those on it, and that to coefficients of a derivative."""
    grid = chebyshev_nodes(8 * (count - 1) + 1)  # 8 points per node: minima lie between neighbours
    at_grid = chebyshev_values(2 * grid - 1, count - 1) @ coefficient_map(count)
    slopes = np.zeros((count, count))
    slopes[:-1] = chebyshev.chebder(np.eye(count), scl=2)
    return grid, read_only(at_grid), read_only(slopes)


def integral_of_squares(values: Array) -> float:
    """Integral over [0, 1] of the sum of squares of interpolants of ``values`` (count, r) at the Chebyshev nodes."""
    rule = gauss_legendre(len(values))
    at_rule = chebyshev_values(2 * rule.nodes - 1, len(values) - 1) @ (coefficient_map(len(values)) @ values)
    return float(rule.weights @ (at_rule**2).sum(axis=1))


def resolution(values: Array) -> float:
    """Size of the last three Chebyshev coefficients of functions (count, r), relative to the largest value."""
    tail = np.abs(coefficient_map(len(values))[-3:] @ values).max()
    return float(tail / max(float(np.abs(values).max()), 1e-300))


def local_minima(values: Array) -> tuple[IntArray, Array, Array]:
    """Local minima on [0, 1] of the interpolants of ``values`` (count, r) at the Chebyshev nodes.

    Returns
    -------
    column : (L,) which function
    s : (L,) where
    value : (L,)
    """
    count = len(values)
    grid, to_grid, slopes = _search(count)
    coefficients = coefficient_map(count) @ values
    fine = to_grid @ values
    row, column = lowest_of_neighbours(fine)
    s = grid[row]
    values_there = fine[row, column]
    low = grid[np.maximum(row - 1, 0)]
    high = grid[np.minimum(row + 1, len(grid) - 1)]
    first = slopes @ coefficients
    series = np.stack((first, slopes @ first))[:, :, column]
    refined = s.copy()
    for _ in range(4):  # steps of Newton's method, each of which squares what is left: to rounding
        slope, curvature = np.einsum("lk,dkl->dl", chebyshev_values(2 * refined - 1, count - 1), series)
        safe = np.where(curvature > 0, curvature, 1.0)
        refined = np.clip(np.where(curvature > 0, refined - slope / safe, refined), low, high)
    value = np.einsum("lk,kl->l", chebyshev_values(2 * refined - 1, count - 1), coefficients[:, column])
    better = value < values_there
    return column, np.where(better, refined, s), np.where(better, value, values_there)


def largest_magnitudes(values: Array) -> tuple[Array, Array]:
    """Largest absolute values (r,) on [0, 1] of the interpolants of ``values`` (count, r), and where (r,)."""
    low, at_low, high, at_high = extremes(values)
    below = -low > high
    return np.maximum(np.where(below, -low, high), 0.0), np.where(below, at_low, at_high)


def extremes(values: Array) -> tuple[Array, Array, Array, Array]:
    """Least values (r,) on [0, 1] of the interpolants of ``values`` (count, r), where, the largest ones, and where."""
    r = values.shape[1]
    column, s, value = local_minima(np.concatenate((values, -values), axis=1))
    order = np.lexsort((value, column))
    which, first = np.unique(column[order], return_index=True)
    least, where = np.full((2, 2 * r), np.nan)
    least[which] = value[order][first]
    where[which] = s[order][first]
    return least[:r], where[:r], -least[r:], where[r:]


def least_by_grids(values: Callable[[Array], Array], duration: float, instants: Iterable[float]) -> tuple[float, float]:
    """Least value of a function (N,) of times (N,) in [0, duration], s, and where: grids, ever finer where it is low.

    ``instants`` are looked at too: where the function may jump. Infinite where it is infinite throughout.
    """
    intervals = 256  # [-] of the first look at a function that is not smooth
    grid = distinct(np.clip([*np.linspace(0, duration, intervals + 1), *instants], 0, duration))
    values_there = values(grid)
    lowest, _ = lowest_of_neighbours(values_there[:, None])
    lowest = lowest[np.argsort(values_there[lowest])[:8]]  # those that are looked at closely
    column = np.zeros(len(lowest), dtype=np.int64)
    span = duration / intervals
    when, least = narrowed(lambda t: values(t)[:, None], column, grid[lowest], values_there[lowest], span, duration)
    if not lowest.size:
        return np.inf, 0.0
    best = int(np.argmin(least))
    return float(least[best]), float(when[best])


def lowest_of_neighbours(values: Array) -> tuple[IntArray, IntArray]:
    """Rows (L,) and columns (L,) of the finite values (K, r) that no neighbour in their column is below."""
    padded = np.pad(values, ((1, 1), (0, 0)), constant_values=np.inf)
    row, column = np.nonzero((values <= padded[:-2]) & (values <= padded[2:]) & np.isfinite(values))
    return row, column


def narrowed(
    values: Callable[[Array], Array], column: IntArray, where: Array, least: Array, span: float, last: float
) -> tuple[Array, Array]:
    """Narrow down local minima ``least`` (L,) at ``where`` (L,), in [0, last], of ``column`` (L,) of a function.

    The function gives (N, r) at (N,); ``span`` is how far the first look goes to both sides, the next ones 8 times
    closer each. Returned are where the minima are, and their values.
    """
    most = 32  # [-] candidates of a call: the function gives all its columns for every one
    if len(where) > most:
        chunks = [slice(first, first + most) for first in range(0, len(where), most)]
        minima = [narrowed(values, column[chunk], where[chunk], least[chunk], span, last) for chunk in chunks]
        where, least = map(np.concatenate, zip(*minima, strict=True))
        return where, least
    chosen = np.arange(len(where))
    narrowing = 8  # [-] of the look at a candidate, each of four times
    instants = 2 * narrowing + 1
    for _ in range(4 if len(where) else 0):
        around = np.clip(where[:, None] + span * np.linspace(-1, 1, instants), 0, last)
        near = values(around.ravel()).reshape(len(where), instants, -1)[chosen, :, column]
        best = np.argmin(near, axis=1)
        better = near[chosen, best] < least
        where = np.where(better, around[chosen, best], where)
        least = np.where(better, near[chosen, best], least)
        span /= narrowing
    return where, least
