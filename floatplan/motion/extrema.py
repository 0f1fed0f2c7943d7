"""Local minima of analytic functions of time, from their values at Chebyshev nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from floatplan.arrays import Array, IntArray, read_only

FINENESS = 8  # points of the search grid per node
NEWTON_STEPS = 4
GRID = 257  # instants of the first look for the least value of a function that is not smooth
REFINEMENTS = 4  # times that the look at each candidate narrows, 8-fold each
LOWEST = 8  # candidates


@lru_cache(maxsize=16)
def chebyshev_nodes(count: int) -> Array:
    """``count`` Chebyshev-Lobatto nodes on [0, 1], rising from 0 to 1."""
    return read_only((1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2)


@lru_cache(maxsize=16)
def _coefficient_map(count: int) -> Array:
    """Values at the nodes to Chebyshev coefficients."""
    return read_only(np.linalg.inv(chebyshev.chebvander(2 * chebyshev_nodes(count) - 1, count - 1)))


@lru_cache(maxsize=16)
def _grid_values(count: int) -> tuple[Array, Array]:
    grid = chebyshev_nodes(FINENESS * (count - 1) + 1)
    return grid, read_only(chebyshev.chebvander(2 * grid - 1, count - 1))


def resolution(values: Array) -> float:
    """Size of the last three Chebyshev coefficients of functions (count, r), relative to the largest value."""
    tail = np.abs(_coefficient_map(len(values))[-3:] @ values).max()
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
    coefficients = _coefficient_map(count) @ values
    grid, at_grid = _grid_values(count)
    fine = at_grid @ coefficients
    padded = np.pad(fine, ((1, 1), (0, 0)), constant_values=np.inf)
    row, column = np.nonzero((fine <= padded[:-2]) & (fine <= padded[2:]))
    s, found = grid[row], fine[row, column]
    low, high = grid[np.maximum(row - 1, 0)], grid[np.minimum(row + 1, len(grid) - 1)]
    first = np.asarray(chebyshev.chebder(coefficients, scl=2), dtype=np.float64)
    second = np.asarray(chebyshev.chebder(first, scl=2), dtype=np.float64)
    refined = s.copy()
    for _ in range(NEWTON_STEPS):
        slope = _evaluate(first, column, refined)
        curvature = _evaluate(second, column, refined)
        safe = np.where(curvature > 0, curvature, 1.0)
        refined = np.clip(np.where(curvature > 0, refined - slope / safe, refined), low, high)
    value = _evaluate(coefficients, column, refined)
    better = value < found
    return column, np.where(better, refined, s), np.where(better, value, found)


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
    known, first = np.unique(column[order], return_index=True)
    least, where = np.full((2, 2 * r), np.nan)
    least[known], where[known] = value[order][first], s[order][first]
    return least[:r], where[:r], -least[r:], where[r:]


def least_by_grids(values: Callable[[Array], Array], duration: float, instants: Iterable[float]) -> tuple[float, float]:
    """Least value of a function (N,) of times (N,) in [0, duration], s, and where: grids, ever finer where it is low.

    ``instants`` are looked at too: where the function may jump. Infinite where it is infinite throughout.
    """
    grid = np.unique(np.clip([*np.linspace(0, duration, GRID), *instants], 0, duration))
    found = values(grid)
    reach = duration / (GRID - 1)
    for _ in range(REFINEMENTS):
        padded = np.pad(found, 1, constant_values=np.inf)
        lowest = np.flatnonzero((found <= padded[:-2]) & (found <= padded[2:]) & np.isfinite(found))
        lowest = lowest[np.argsort(found[lowest])[:LOWEST]]
        near = grid[lowest][:, None] + reach * np.linspace(-1, 1, 17)
        grid = np.unique(np.concatenate((grid[lowest], np.clip(near, 0, duration).ravel())))
        if not grid.size:
            return np.inf, 0.0
        found = values(grid)
        reach /= 8
    least = int(np.argmin(found))
    return float(found[least]), float(grid[least])


def _evaluate(coefficients: Array, column: IntArray, s: Array) -> Array:
    polynomials = chebyshev.chebvander(2 * s - 1, len(coefficients) - 1)
    return np.asarray(np.einsum("lk,kl->l", polynomials, coefficients[:, column]))
