"""Quadratic programs by changes of the rows that are active, compiled.

The same as :func:`floatplan.optimization.quadratic_program.by_changes_of_active_rows`, which large ones are left to.
"""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.library import address, kernel
from floatplan.optimization.nonlinear_program import AnyEvaluation
from floatplan.optimization.quadratic_program import (
    CHANGES,
    QP_ACCURACY,
    ROW_TOLERANCE,
    Multipliers,
    Step,
    by_changes_of_active_rows,
)

LARGEST = 48  # [-] variables: beyond, NumPy's factorisation is faster


class QuadraticStructure(Structure):
    """Of ``quadratic_kernel.hpp``."""

    _fields_ = (
        *((name, c_int64) for name in ("size", "equalities", "rows", "changes")),
        *((name, c_double) for name in ("accuracy", "tolerance")),
        *(
            (name, c_void_p)
            for name in ("hessian", "gradient", "equality", "equality_rows", "inequality", "inequality_rows")
        ),
        ("count", c_int64),
        *((name, c_void_p) for name in ("active", "solution", "matrix")),
    )


def step_by_active_rows(current: AnyEvaluation, hessian: Array, active: IntArray) -> Step | None:
    """Solve the QP of a linearised program by a few changes of the ``active`` rows; None where these do not end."""
    size, equalities, found = len(hessian), len(current.equality), kernel()
    if found is None or size > LARGEST:
        return by_changes_of_active_rows(current, hessian, active)
    if active.size > size:
        return None
    total = 2 * size + equalities
    rows = np.empty(size + 1, dtype=np.int64)
    rows[: active.size] = active
    solution, matrix = np.empty(total), np.empty(2 * total * total)
    given = [
        np.ascontiguousarray(values, dtype=np.float64)
        for values in (
            *(hessian, current.gradient, current.equality, current.equality_jacobian),
            *(current.inequality, current.inequality_jacobian),
        )
    ]
    structure = QuadraticStructure(
        *(size, equalities, len(current.inequality), CHANGES, QP_ACCURACY, ROW_TOLERANCE),
        *map(address, given),
        active.size,
        *map(address, (rows, solution, matrix)),
    )
    if not found.quadratic(byref(structure), found.instructions):
        return None
    multipliers = np.zeros(len(current.inequality))
    multipliers[rows[: structure.count]] = -solution[size + equalities : size + equalities + structure.count]
    return Step(solution[:size], Multipliers(solution[size : size + equalities], multipliers))
