"""Quadratic programs by the dual active-set method of Goldfarb and Idnani, compiled."""

from collections.abc import Callable

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.optimization.programs import AnyEvaluation, Multipliers, Step


def dual_step(
    current: AnyEvaluation, hessian: Array, counted: Callable[[int], None] = lambda changes: None
) -> Step | None:
    """Make violated rows active one by one: None where rows contradict one another, or it takes too many changes.

    How many changes there were is ``counted`` in either case.
    """
    size = len(hessian)
    equalities = len(current.equality)
    active = np.empty(size, dtype=np.int64)
    solution = np.empty(2 * size + equalities)
    count = len(current.inequality)
    rows = -(-count // 8) * 8  # rows beyond the last hold whatever x is
    inequality = np.full(rows, np.inf)
    inequality[:count] = current.inequality
    packs = np.zeros((rows, size))
    packs[:count] = current.inequality_jacobian
    struct = Struct(
        "Quadratic",
        size=size,
        equalities=equalities,
        rows=rows,
        changes=EXCHANGE.qp_changes,
        tolerance=EXCHANGE.qp_tolerance,
        hessian=doubles(hessian),
        gradient=doubles(current.gradient),
        equality=doubles(current.equality),
        equality_rows=doubles(current.equality_jacobian),
        inequality=inequality,
        inequality_rows=doubles(packs.reshape(-1, 8, size).swapaxes(1, 2)),
        active=active,
        solution=solution,
    )
    compiled = kernel()
    solved = compiled.quadratic(struct.pointer, compiled.instructions)
    counted(struct.pointer.changes)
    if not solved:
        return None
    multipliers = np.zeros(count)
    found = struct.pointer.count
    multipliers[active[:found]] = solution[size + equalities : size + equalities + found]
    return Step(solution[:size], Multipliers(solution[size : size + equalities], multipliers))
