"""Columns and matrices of Arb's balls: products of columns, rotations from axes, and principal axes of an inertia."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import flint
import numpy as np

from floatplan.errors import InputError

LETTERS = "xyz"  # names of the axes


def diagonal(entries: Sequence[Any]) -> Any:
    """Matrix (3, 3) of these on its diagonal."""
    xx, yy, zz = entries
    return flint.arb_mat([[xx, 0, 0], [0, yy, 0], [0, 0, zz]])


def dot(a: Any, b: Any) -> Any:
    """Scalar product of columns (3, 1)."""
    return (a.transpose() * b)[0, 0]


def cross(a: Any, b: Any) -> Any:
    """Vector product of columns (3, 1)."""
    (ax, ay, az) = a.entries()
    (bx, by, bz) = b.entries()
    return flint.arb_mat(3, 1, [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def unit(column: Any) -> Any:
    """A column (3, 1) made of length 1."""
    length = dot(column, column).sqrt()
    if not length > 0:
        raise InputError("an axis has no length")
    return column * (1 / length)


def of_axes(x: Any, y: Any) -> Any:
    """Rotation (3, 3) whose x is along the first, and whose y is in the plane of both."""
    x = unit(x)
    y = unit(y - x * dot(x, y))
    return flint.arb_mat([x.entries(), y.entries(), cross(x, y).entries()]).transpose()


def principal(inertia: Any) -> tuple[Any, list[Any]]:
    """Axes (3, 3) of length 1, and moments: an inertia is ``axes diag(moments) axes^T`` for some within the balls.

    Moments raised to a least one stay within: in Frobenius' norm matrices come no farther apart by that.
    """
    middle = np.empty((3, 3))
    for row, column in np.ndindex(middle.shape):
        middle[row, column] = float(inertia[row, column].mid())
    rough = np.linalg.eigh(middle)[1].T
    axes = of_axes(*(flint.arb_mat(3, 1, row.tolist()) for row in rough[:2]))
    seen = axes.transpose() * inertia * axes
    off = flint.arb(0)
    for row, column in permutations(range(3), 2):
        off += abs(seen[row, column])
    return axes, [seen[k, k] + flint.arb(0, off.upper()) for k in range(3)]
