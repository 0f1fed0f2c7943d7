"""The QP of a step, compiled: all its rows at once, by the dual method of Goldfarb and Idnani."""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.library import address, kernel
from floatplan.optimization.nonlinear_program import AnyEvaluation
from floatplan.optimization.quadratic_program import QP_ACCURACY, Multipliers, Step, solve_qp

MOST_ROUNDS = 100  # [-] looks at all rows, and rows added at each
LARGEST_MULTIPLIER = 1e-3  # [-] of the slack penalty: beyond it rows nearly contradict each other


class QuadraticStructure(Structure):
    """Of ``qp_kernel.hpp``."""

    _fields_ = (
        *((name, c_int64) for name in ("size", "equalities", "rows", "most")),
        ("tolerance", c_double),
        *(
            (name, c_void_p)
            for name in (
                *("hessian", "gradient", "equality_rows", "equality", "inequality_rows", "inequality"),
                *("x", "multipliers", "room", "active", "violated"),
            )
        ),
    )


def quadratic_step(current: AnyEvaluation, hessian: Array, active: IntArray, slack_penalty: float) -> Step:
    """Solve the QP of a linearised program, see :func:`floatplan.optimization.quadratic_program.solve_qp`.

    That one takes over where there is no kernel, or the dual method fails, or rows nearly contradict each other: it
    then bends them, where an exact step would be of no use.
    """
    found, inequality = kernel(), current.inequality
    if found is None or not inequality.size:
        return solve_qp(current, hessian, active, slack_penalty)
    size, equalities, rows = len(hessian), len(current.equality), len(inequality)
    kept = [
        np.ascontiguousarray(values)
        for values in (
            *(hessian, current.gradient, current.equality_jacobian, current.equality),
            *(current.inequality_jacobian, inequality),
        )
    ]
    x, multipliers = np.empty(size), np.empty(equalities + rows)
    room, integers = np.empty(2 * size * size + 5 * (size + 1)), np.empty(size + rows, dtype=np.int64)
    integers_begin = address(integers)
    structure = QuadraticStructure(
        *(size, equalities, rows, MOST_ROUNDS, QP_ACCURACY, *map(address, kept)),
        *(address(x), address(multipliers), address(room), integers_begin, integers_begin + 8 * size),
    )
    failed = found.quadratic(byref(structure), found.instructions)
    if failed or not np.abs(multipliers).max() <= LARGEST_MULTIPLIER * slack_penalty:
        return solve_qp(current, hessian, active, slack_penalty)
    return Step(x, Multipliers(multipliers[:equalities], multipliers[equalities:]))
