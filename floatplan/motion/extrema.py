"""Local minima of analytic functions of time, from their values at Chebyshev nodes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from floatplan.arrays import Array, IntArray, read_only

FINENESS = 8  # points of the search grid per node
NEWTON_STEPS = 4


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


def largest_magnitudes(values: Array) -> Array:
    """Largest absolute value (r,) on [0, 1] of the interpolants of ``values`` (count, r) at the Chebyshev nodes."""
    column, _, value = local_minima(np.concatenate((values, -values), axis=1))
    largest = np.zeros(values.shape[1])
    np.maximum.at(largest, column % values.shape[1], -value)
    return largest


def _evaluate(coefficients: Array, column: IntArray, s: Array) -> Array:
    polynomials = chebyshev.chebvander(2 * s - 1, len(coefficients) - 1)
    return np.asarray(np.einsum("lk,kl->l", polynomials, coefficients[:, column]))
