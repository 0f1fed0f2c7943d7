"""Local minima of rows of constraints by finer and finer looks in NumPy: what the kernel's are held to."""

from typing import Any

import numpy as np
from sampled_flight import Sampling, nodes_of, sample_also, trajectory, values_of

from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.planning.constraints import Constraint, RowTable, applies
from floatplan.planning.result import Worst
from floatplan.planning.variables import DecisionVariables


def local_minima(
    flight: Any, variables: DecisionVariables, constraints: tuple[Constraint, ...], level: int, x: np.ndarray
) -> Worst:
    """True local minima below ``RowTable.near`` of every row of the motion x, between the nodes and at the ends.

    ``level`` is that of a grid that resolves the motion.
    """
    nodes = nodes_of(level, variables.polynomials.form)
    table = RowTable.of(constraints)

    def values(sampling: Sampling) -> np.ndarray:
        motion = trajectory(flight, variables, sampling, x)
        s = sampling.grid.s[nodes.grid.nodes :]
        rows = [(values_of(block, motion)[nodes.grid.nodes :], applies(block, s)) for block in constraints]
        return np.concatenate([np.where(exists[:, None], row, np.inf) for row, exists in rows], axis=1)

    first = values(sample_also(nodes, table.grid))
    at, column = lowest_of_neighbours(first)
    near = (first - _rise(first))[at, column] < RowTable.near
    at, column = at[near], column[near]
    begin = table.grid[at], first[at, column], table.span
    s, least = narrowed(lambda s: values(sample_also(nodes, s)), column, *begin, last=1.0)
    return Worst(table.block[column], table.row[column], s, least)


def _rise(value: np.ndarray) -> np.ndarray:
    """Steps (K, r) up from each value to its neighbours, the larger one.

    A distance falls and rises as a V where a link sweeps by: its true minimum may be as much below the lowest value.
    """
    exists = np.isfinite(value)
    step = np.zeros((len(value) + 1, value.shape[1]))
    np.subtract(value[1:], value[:-1], out=step[1:-1], where=exists[1:] & exists[:-1])
    return np.asarray(np.maximum(np.abs(step[:-1]), np.abs(step[1:])))
