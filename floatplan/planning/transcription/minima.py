"""Local minima of constraint rows over a flight, as the kernel finds them, and where it looks for them first."""

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray, distinct, read_only
from floatplan.compiled.constraints import Look
from floatplan.planning.transcription.constraints import Constraint, window_ends

FIRST_LOOK = 129  # [-] instants of the first look between the nodes
NEAR = 0.05  # [-] of a row's scale: local minima above this are left alone
FIRST_GRID = read_only(np.linspace(0, 1, FIRST_LOOK))


@dataclass(frozen=True, eq=False)
class Worst:
    """Local minima of constraint rows over time: ``block``, ``row``, ``s``, ``value`` (L,)."""

    block: IntArray
    row: IntArray
    s: Array
    value: Array

    @property
    def least(self) -> float:
        """The lowest value; infinite where nothing is near."""
        return float(self.value.min(initial=np.inf))

    @property
    def lowest(self) -> tuple[int, int, float, float]:
        """Block, row, value and s of the lowest, where there is one."""
        index = int(np.argmin(self.value))
        return int(self.block[index]), int(self.row[index]), float(self.value[index]), float(self.s[index])


def where_to_look(constraints: tuple[Constraint, ...]) -> tuple[IntArray, IntArray, Look]:
    """Block and row (rows,) of each row of all constraints, and where to look first: a grid, and ends of windows."""
    block = [number for number, each in enumerate(constraints) for _ in each.labels]
    row = [row for each in constraints for row in range(len(each.labels))]
    low, high = (np.array([constraints[number].window[end] for number in block]) for end in (0, 1))
    ends = window_ends(constraints)
    grid = distinct(np.concatenate((FIRST_GRID, ends))) if ends else FIRST_GRID
    return np.array(block, np.int64), np.array(row, np.int64), Look(grid, low, high, NEAR, 1 / (FIRST_LOOK - 1))
