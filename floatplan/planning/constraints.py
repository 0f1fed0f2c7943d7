"""What must hold during the flight, as blocks of inequalities: what they are about, labels and units.

A block has r rows at each of K instants; a row holds where its value is at least zero. Values are divided by the
block's ``scale``, so that 1 is much in every row. Joint ranges need no block: they hold by construction of (12).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias, get_args

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray, distinct, read_only
from floatplan.motion.dynamics import FlightDynamics
from floatplan.planning.kernel_input.rows import DistanceRows, SumRows
from floatplan.planning.variables import AtEnds
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Shares
from floatplan.tables import CLEARANCE, RELATIVE

FIRST_GRID = read_only(np.linspace(0, 1, 129))  # [-] instants of the first look between the nodes
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a torque or rate limit

Window: TypeAlias = tuple[float, float]  # fractions of the flight, within [0, 1], both included
ALWAYS: Window = (0.0, 1.0)
Pairs: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]  # indices of capsules: every first one with every second


@dataclass(frozen=True)
class MotionQuantity:
    """What limits and objectives are about.

    ``depends_at_ends_on`` : on what, beside the posture, it depends at takeoff and landing. ``sums`` : as what matrices
    times the kernel's quantities it is written, where it is none of these itself.
    """

    depends_at_ends_on: frozenset[AtEnds] = frozenset(get_args(AtEnds))
    sums: Callable[[FlightDynamics], Mapping[str, Array]] = lambda flight: {}


QUANTITIES: dict[str, MotionQuantity] = {
    "velocities": MotionQuantity(frozenset({"velocities"})),
    "accelerations": MotionQuantity(frozenset({"accelerations"})),
    "torques": MotionQuantity(),
    "motor_torques": MotionQuantity(),
    "orientation_rate": MotionQuantity(frozenset({"velocities", "momentum"})),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Constraint:
    """A block of inequalities, with all that the search and its explanations need to know of it.

    Holds: for all t in its window, by exchange of instants.

    Attributes
    ----------
    rows : DistanceRows or SumRows
        The values, as the kernel computes them.
    labels : name (r,) of each row, for a person
    unit : of value times scale
    scale : natural units per unit of the value (r,)
    tolerance : what a value may be below zero where the row counts as satisfied: the certificate's tolerance
    relaxed : what would have to be for a violated row to hold, of its ``{label}`` and an ``{amount}``
    cause : why a row can be violated at an ``{end}`` already, the "start" or the "goal"
    depends_at_ends_on : on what, in addition to the posture, the values at takeoff and landing depend
    window : between which instants the block applies
    """

    rows: DistanceRows | SumRows
    labels: tuple[str, ...]
    unit: str
    scale: Array
    tolerance: float
    relaxed: str
    cause: str
    depends_at_ends_on: frozenset[AtEnds] = frozenset()
    window: Window = ALWAYS


def clearance(
    between: Obstacle | Pairs, margin: float, labels: Sequence[str], cause: str, window: Window = ALWAYS
) -> Constraint:
    """Return distances of links to an obstacle, (19)-(23), or between capsules by their indices, less a margin, m."""
    return Constraint(
        rows=DistanceRows(between, margin, LENGTH_SCALE),
        labels=tuple(labels),
        unit="m",
        scale=np.full(len(labels), LENGTH_SCALE),
        tolerance=CLEARANCE / LENGTH_SCALE,
        relaxed="the {label} {amount} smaller",
        cause=cause,
        window=window,
    )


def limit(shares: Shares, flight: FlightDynamics) -> Constraint:
    """Return limits as ``1 - sum of weights @ quantity >= 0``: no more than the whole of a limit is used.

    Weights (r, m) are of quantities by their names: a motor's torque or a joint's rate on its own, the torque of a
    leader and its followers together, or a motor's torque and rate. There is a row for each combination of the signs
    of what is used: upper limits before lower ones.
    """
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)] if shares.also else [(1, 0), (-1, 0)]
    depends_on: set[AtEnds] = set()
    weights: dict[str, Array] = {}
    for which, used in enumerate((shares.used, shares.also)):
        for name, rows in used.items():
            signed = -np.concatenate([sign[which] * rows for sign in signs], axis=-2)
            quantity = QUANTITIES[name]
            depends_on |= quantity.depends_at_ends_on
            for of_kernel, matrix in quantity.sums(flight).items() or ((name, None),):
                terms = signed if matrix is None else signed @ matrix
                weights[of_kernel] = weights.get(of_kernel, 0.0) + terms
    labels = shares.labels * len(signs)
    return Constraint(
        rows=SumRows(np.ones(len(labels)), weights),
        labels=labels,
        unit=shares.unit,
        scale=np.concatenate([shares.limit] * len(signs), axis=-1),
        tolerance=RELATIVE,
        relaxed="the limit on the {label} {amount} higher",
        cause="it follows from the {end}'s rates and accelerations",
        depends_at_ends_on=frozenset(depends_on),
    )


def applies(block: Constraint, s: Array) -> BoolArray:
    """Whether (K,) a block applies at instants (K,) of [0, 1]."""
    low, high = block.window
    return np.asarray((s >= low) & (s <= high))


@dataclass(frozen=True, eq=False)
class RowTable:
    """All rows (R,) of some constraints, and where their least values are looked for.

    Attributes
    ----------
    block, row : (R,) int
        The block of each, and its number there.
    low, high : (R,)
        Between which instants of [0, 1] each applies.
    tolerance : (R,)
        What its value may be below zero.
    window_ends : ends of the blocks' windows, rising, the ends of the flight left out
    grid : (K,)
        Instants of the first look. What may be below ``near`` is narrowed down by ``span`` to both sides.
    """

    block: IntArray
    row: IntArray
    low: Array
    high: Array
    tolerance: Array
    window_ends: tuple[float, ...]
    grid: Array
    near: float = 0.05  # [-] of a row's scale: local minima above this are left alone
    span: float = 1 / (len(FIRST_GRID) - 1)

    @classmethod
    def of(cls, blocks: Sequence[Constraint]) -> RowTable:
        """Return the rows of blocks."""
        rows = [len(block.labels) for block in blocks]
        ends = sorted(set().union(*(block.window for block in blocks)).difference(ALWAYS))
        low, high = np.repeat([block.window for block in blocks] or np.empty((0, 2)), rows, axis=0).T
        return cls(
            block=np.repeat(np.arange(len(rows)), rows),
            row=np.array(list(chain.from_iterable(map(range, rows))), np.int64),
            low=low,
            high=high,
            tolerance=np.repeat([block.tolerance for block in blocks], rows),
            window_ends=tuple(ends),
            grid=distinct(np.concatenate((FIRST_GRID, ends))) if ends else FIRST_GRID,
        )
