"""Quadratic programs by the dual active-set method of Goldfarb and Idnani, compiled."""

from collections.abc import Callable

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.layout import Filled, kernel
from floatplan.optimization.programs import QP_CHANGES, QP_TOLERANCE, AnyEvaluation, Multipliers, Step


def dual_step(
    current: AnyEvaluation, hessian: Array, counted: Callable[[int], None] = lambda changes: None
) -> Step | None:
    """Make violated rows active one by one: None where rows contradict one another, or it takes too many changes.

    How many changes there were is ``counted`` in either case.
    """
    size, equalities, found = len(hessian), len(current.equality), kernel()
    active, solution = np.empty(size, dtype=np.int64), np.empty(2 * size + equalities)
    count = len(current.inequality)
    rows = -(-count // 8) * 8
    inequality, packs = np.full(rows, np.inf), np.zeros((rows, size))
    inequality[:count], packs[:count] = current.inequality, current.inequality_jacobian
    counts = {"size": size, "equalities": equalities, "rows": rows}
    bounds = {"changes": QP_CHANGES, "tolerance": QP_TOLERANCE}
    slopes = {"equality_rows": current.equality_jacobian, "inequality_rows": packs.reshape(-1, 8, size).swapaxes(1, 2)}
    given = {"hessian": hessian, "inequality": inequality, "active": active, "solution": solution}
    filled = Filled("Quadratic", current, **counts, **bounds, **slopes, **given)
    structure = filled.structure
    solved = found.quadratic(structure, found.instructions)
    counted(structure.changes)
    if not solved:
        return None
    multipliers = np.zeros(count)
    multipliers[active[: structure.count]] = solution[size + equalities : size + equalities + structure.count]
    return Step(solution[:size], Multipliers(solution[size : size + equalities], multipliers))
