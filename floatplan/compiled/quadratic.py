"""Quadratic programs by changes of the rows that are active, compiled."""

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.layout import Filled, kernel
from floatplan.optimization.programs import QP_ACCURACY, ROW_TOLERANCE, AnyEvaluation, Multipliers, Step

CHANGES = 16  # [-] of the active rows, after which ProxQP solves the QP


def step_by_active_rows(current: AnyEvaluation, hessian: Array, active: IntArray) -> Step | None:
    """Hold the active rows as equalities; then rows pulled at leave, and the most violated enters: None without an end.

    Where there is none of either, the step satisfies the QP's conditions of optimality (Nocedal and Wright, Numerical
    Optimization, 2nd ed., (16.37)), which a convex QP's solution alone does.
    """
    size, equalities, found = len(hessian), len(current.equality), kernel()
    if active.size > size:
        return None
    rows = np.empty(size + 1, dtype=np.int64)
    rows[: active.size] = active
    solution = np.empty(2 * size + equalities)
    counts = {"size": size, "equalities": equalities, "rows": len(current.inequality), "count": active.size}
    bounds = {"changes": CHANGES, "accuracy": QP_ACCURACY, "tolerance": ROW_TOLERANCE}
    slopes = {"equality_rows": current.equality_jacobian, "inequality_rows": current.inequality_jacobian}
    given = {"hessian": hessian, "active": rows, "solution": solution}
    filled = Filled("Quadratic", current, **counts, **bounds, **slopes, **given)
    structure = filled.structure
    if not found.quadratic(structure, found.instructions):
        return None
    multipliers = np.zeros(len(current.inequality))
    multipliers[rows[: structure.count]] = -solution[size + equalities : size + equalities + structure.count]
    return Step(solution[:size], Multipliers(solution[size : size + equalities], multipliers))
