"""Polynomials beyond double precision: the basis of (12), the coefficients b that are written, and b read back.

The b of (12) are powers of t in seconds. Of a polynomial of degree k that stays of the order of one on [0, T] the terms
``b_j T^j`` grow like 6^k and cancel, so that sums of doubles would lose all digits near degree 20. Hence two rules:

- b is rounded so that rounding does not add up (:func:`powers_of_seconds`);
- b is never summed in doubles: it is turned into Chebyshev polynomials first (:func:`chebyshev_of_seconds`).

The basis is made of fractions. What is done for every plan is done in fixed point: whole numbers of ``2^-FIXED_POINT``.
"""

import math
import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache, lru_cache

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array

CONDITIONS = 6  # [-] p, p', p'' at s = 0 and at s = 1
HERMITE = (  # powers of s of the quintics with p, p', p'' at 0 and at 1 equal to the unit vectors, times two
    (2, 0, 0, -20, 30, -12),
    (0, 2, 0, -12, 16, -6),
    (0, 0, 1, -3, 3, -1),
    (0, 0, 0, 20, -30, 12),
    (0, 0, 0, -8, 14, -6),
    (0, 0, 0, 1, -2, 1),
)
FIXED_POINT = 256  # [bits] after the point


@cache
def basis_columns(free: int) -> npt.NDArray[np.object_]:
    """Powers of s (6+free, 6+free), as fractions: the six Hermite quintics, then the ``free`` free polynomials.

    The free ones are ``s^3 (1-s)^3 J_k(s)``, of length one to within rounding in the mean square on [0, 1]: shifted
    Jacobi polynomials with both parameters 6, from Rodrigues' formula (Abramowitz and Stegun 22.3.1).
    """
    size = CONDITIONS + free
    columns = np.full((size, size), Fraction(0))
    bubble = np.array([0, 0, 0, 1, -3, 3, -1], dtype=object)  # powers of s^3 (1-s)^3
    for index, quintic in enumerate(HERMITE):
        columns[:CONDITIONS, index] = [Fraction(value, 2) for value in quintic]
    for k in range(free):
        jacobi = [Fraction(1)]
        for j in range(k):
            jacobi.append(jacobi[-1] * (j - k) * (k + 13 + j) / ((7 + j) * (j + 1)))
        powers = np.convolve(bubble, np.array(jacobi, dtype=object))
        square = np.convolve(powers, powers)
        length = math.sqrt(sum(value / (power + 1) for power, value in enumerate(square)))
        columns[: len(powers), CONDITIONS + k] = powers / Fraction(length)
    return columns


def powers_of_seconds(combination: Sequence[float], duration: float) -> list[float]:
    """Coefficients b in powers of seconds, as doubles, of a combination of the columns of the basis.

    Rounded from the highest down. The rounding of b_k, ``r_k s^k``, is compensated by lower powers, but for
    ``r_k L_k(s)``. L_k is small, and vanishes with two derivatives at both ends where its degree allows it: (13) does
    not suffer from the rounding of large terms, and p hardly does.
    """
    size = len(combination)
    factors = list(map(_fixed, combination))
    rows = _fixed_rows(basis_columns, size - CONDITIONS)
    lost = _fixed_rows(compensations, size)
    remainder = [sum(map(operator.mul, row, factors)) >> FIXED_POINT for row in rows]
    written = [0.0] * size
    for k in range(size - 1, -1, -1):
        unit, halvings = _unit(duration, k)
        written[k] = (remainder[k] << halvings) / unit
        value, divisor = written[k].as_integer_ratio()
        rounding = remainder[k] - (value * unit >> divisor.bit_length() - 1 + halvings)
        for power, weight in enumerate(lost[k][:k]):
            if weight:
                remainder[power] -= rounding * weight >> FIXED_POINT
    return written


@lru_cache(maxsize=1024)
def _unit(duration: float, k: int) -> tuple[int, int]:
    """A whole number, and how often it must be halved to be ``duration^k`` in fixed point."""
    numerator, denominator = duration.as_integer_ratio()
    return numerator**k << FIXED_POINT, k * (denominator.bit_length() - 1)


def _fixed(value: Fraction | float) -> int:
    """In fixed point."""
    numerator, denominator = value.as_integer_ratio()
    return (numerator << FIXED_POINT) // denominator


@cache
def _fixed_rows(matrix: Callable[[int], npt.NDArray[np.object_]], size: int) -> tuple[tuple[int, ...], ...]:
    """Rows of a matrix of fractions, of a size."""
    return tuple(tuple(map(_fixed, row)) for row in matrix(size).tolist())


@cache
def compensations(size: int) -> npt.NDArray[np.object_]:
    """Matrix (size, size), as fractions: row k are the factors of the powers below s^k in L_k, where s^k has factor 1.

    L_k is ``s^3 (s-1)^3`` times the Jacobi polynomial of degree k - 6. For lower k, as many of the factors s and s - 1
    as there can be.
    """
    matrix = np.full((size, size), Fraction(0))
    columns = basis_columns(max(size - CONDITIONS, 0))
    for k in range(size):
        if k >= CONDITIONS:
            matrix[k, :k] = columns[:k, k] / columns[k, k]
            continue
        powers = np.array([Fraction(0)] * min(k, 3) + [Fraction(1)])
        for _ in range(k - 3):
            powers = np.convolve(powers, np.array([-1, 1], dtype=object))
        matrix[k, :k] = powers[:k]
    return matrix


def chebyshev_of_seconds(coefficients: Array, duration: float) -> Array:
    """Turn b (n, k+1) of (12) into coefficients (k+1, n) of Chebyshev polynomials of 2 t/T - 1, each rounded once."""
    rows = _fixed_rows(chebyshev_map, coefficients.shape[1])
    units = [_unit(duration, k) for k in range(len(rows))]
    joints = []
    for b in coefficients.tolist():
        ratios = [value.as_integer_ratio() for value in b]
        powers = [
            value * unit >> divisor.bit_length() - 1 + halvings
            for (value, divisor), (unit, halvings) in zip(ratios, units, strict=True)
        ]
        joints.append([sum(map(operator.mul, row, powers)) / (1 << 2 * FIXED_POINT) for row in rows])
    return np.array(joints).T.copy()


@cache
def chebyshev_map(size: int) -> npt.NDArray[np.object_]:
    """Matrix from powers of s to Chebyshev polynomials of 2 s - 1: ``s^k = 2^(1-2k) sum_j' C(2k, k-j) T_j``."""
    matrix = np.full((size, size), Fraction(0))
    for k in range(size):
        for j in range(k + 1):
            matrix[j, k] = Fraction(math.comb(2 * k, k - j), 2 ** (2 * k - (1 if j else 0)))
    return matrix
