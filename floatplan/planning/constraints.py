"""What must hold during the flight, as blocks of inequalities: what they are about, labels and units.

A block has r rows at each of K instants; a row holds where its value is at least zero. Values are divided by the
block's ``scale``, so that 1 is much in every row. Joint ranges need no block: they hold by construction of (12).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray, distinct, read_only
from floatplan.motion.dynamics import FlightDynamics
from floatplan.planning.kernel_input.rows import Block, DistanceRows, SumRows
from floatplan.planning.variables import AtEnds
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem, Shares, shares_of_limits
from floatplan.tables import CLEARANCE, RELATIVE

FIRST_LOOK = 129  # [-] instants of the first look between the nodes
NEAR = 0.05  # [-] of a row's scale: local minima above this are left alone
FIRST_GRID = read_only(np.linspace(0, 1, FIRST_LOOK))
LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a torque or rate limit

Window: TypeAlias = tuple[float, float]  # fractions of the flight, within [0, 1], both included
ALWAYS: Window = (0.0, 1.0)
EVERYTHING: frozenset[AtEnds] = frozenset({"momentum", "velocities", "accelerations"})
Pairs: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]  # indices of capsules: every first one with every second


@dataclass(frozen=True)
class MotionQuantity:
    """What limits and objectives are about.

    ``depends_at_ends_on`` : on what, beside the posture, it depends at takeoff and landing. ``sums`` : as what matrices
    times the kernel's quantities it is written, where it is none of these itself.
    """

    depends_at_ends_on: frozenset[AtEnds] = EVERYTHING
    sums: Callable[[FlightDynamics], Mapping[str, Array]] = lambda flight: {}


QUANTITIES: dict[str, MotionQuantity] = {
    "velocities": MotionQuantity(frozenset({"velocities"})),
    "accelerations": MotionQuantity(frozenset({"accelerations"})),
    "torques": MotionQuantity(),
    "motor_torques": MotionQuantity(),
    "orientation_rate": MotionQuantity(frozenset({"velocities", "momentum"})),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Constraint(ABC):
    """A block of inequalities, with all that the search and its explanations need to know of it.

    Attributes
    ----------
    labels : name (r,) of each row, for a person
    unit : of value times scale
    scale : natural units per unit of the value (r,)
    tolerance : what a value may be below zero where the row counts as kept: the certificate's tolerance
    relaxed : what would have to be for a violated row to be kept, of its ``{label}`` and an ``{amount}``
    cause : why a row can be violated at an ``{end}`` already, the "start" or the "goal"
    window : between which instants the block applies
    """

    labels: tuple[str, ...]
    unit: str
    scale: Array
    tolerance: float
    relaxed: str
    cause: str
    window: Window = ALWAYS

    @property
    @abstractmethod
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """On what, beside the posture, the values at takeoff and landing depend."""

    @abstractmethod
    def compiled(self, flight: FlightDynamics) -> Block:
        """Return the rows as the kernel computes them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Clearance(Constraint):
    """Distances of links to an obstacle, (19)-(23), or between capsules, by their indices, less a ``margin``, m.

    Holds: for all t in the obstacle's window, by exchange of instants.
    """

    between: Obstacle | Pairs
    margin: float
    unit: str = "m"
    tolerance: float = CLEARANCE / LENGTH_SCALE
    relaxed: str = "the {label} {amount} smaller"

    @property
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """On nothing else."""
        return frozenset()

    def compiled(self, flight: FlightDynamics) -> Block:
        """Return the same distances."""
        return DistanceRows(self.between, self.margin, LENGTH_SCALE)


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit(Constraint):
    """``1 - sum of weights @ quantity >= 0``: no more than the whole of a limit is used.

    Holds: for all t, by exchange of instants. ``weights`` (r, m) are of quantities by their names: a motor's torque or
    a joint's rate on its own, the torque of a leader and its followers together, or a motor's torque and rate.
    """

    weights: Mapping[str, Array]

    @classmethod
    def of(cls, shares: Shares) -> Limit:
        """Return limits with each combination of the signs of what is used: upper limits before lower ones."""
        signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)] if shares.also else [(1, 0), (-1, 0)]
        weights = {
            name: np.concatenate([sign[which] * rows for sign in signs], axis=-2)
            for which, part in enumerate((shares.used, shares.also))
            for name, rows in part.items()
        }
        return cls(
            labels=shares.labels * len(signs),
            unit=shares.unit,
            scale=np.concatenate([shares.limit] * len(signs), axis=-1),
            tolerance=RELATIVE,
            relaxed="the limit on the {label} {amount} higher",
            cause="it follows from the {end}'s rates and accelerations",
            weights=weights,
        )

    @property
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """As of the quantities."""
        return frozenset[AtEnds]().union(*(QUANTITIES[name].depends_at_ends_on for name in self.weights))

    def compiled(self, flight: FlightDynamics) -> SumRows:
        """Return the same sums."""
        used: dict[str, Array] = {}
        for name, weights in self.weights.items():
            for part, by_part in QUANTITIES[name].sums(flight).items() or ((name, None),):
                rows = weights if by_part is None else weights @ by_part
                used[part] = used.get(part, 0.0) - rows
        return SumRows(np.ones(len(self.labels)), used)


def obstacle_clearance(obstacle: Obstacle, name: str, links: Sequence[str], window: Window = ALWAYS) -> Clearance:
    """Return the distances of the links measured to an obstacle, less its margin."""
    return Clearance(
        labels=tuple(f"clearance of {link} to {name}" for link in links),
        scale=np.full(len(links), LENGTH_SCALE),
        cause="the obstacle covers the {end} posture",
        between=obstacle,
        margin=obstacle.margin,
        window=window,
    )


def link_clearance(first: tuple[int, ...], second: tuple[int, ...], names: tuple[str, str], margin: float) -> Clearance:
    """Return the distances between the capsules of two links, one row for each pair, less a margin, m."""
    count = len(first) * len(second)
    return Clearance(
        labels=(f"clearance of {names[0]} to {names[1]}",) * count,
        scale=np.full(count, LENGTH_SCALE),
        cause="it follows from the {end}'s positions",
        between=(first, second),
        margin=margin,
    )


def constraints(problem: Problem, flight: FlightDynamics) -> tuple[Constraint, ...]:
    """All constraints that a problem asks for and that need watching."""
    duration = problem.flight.duration
    named = [(f"obstacle {index} ({each.kind})", each) for index, each in enumerate(problem.obstacles)]
    if problem.ground:
        named.append(("the ground", problem.ground_plane))
    blocks: list[Constraint] = []
    for name, obstacle in named:
        low, high = obstacle.window or (0.0, duration)
        window = max(low / duration, 0.0), min(high / duration, 1.0)  # as far as the flight lasts
        blocks.append(obstacle_clearance(obstacle, name, flight.links_measured(obstacle), window))
    for pair in problem.self_clearances:
        first, second = (tuple(i for i, link in enumerate(flight.links) if link == name) for name in pair.links)
        blocks.append(link_clearance(first, second, pair.links, pair.margin))
    return (*blocks, *map(Limit.of, shares_of_limits(problem)))


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
    near: float = NEAR
    span: float = 1 / (FIRST_LOOK - 1)

    @classmethod
    def of(cls, blocks: Sequence[Constraint]) -> RowTable:
        """Return the rows of blocks."""
        rows = [len(block.labels) for block in blocks]
        ends = sorted({end for block in blocks for end in block.window if end not in ALWAYS})
        low, high = np.repeat([block.window for block in blocks] or np.empty((0, 2)), rows, axis=0).T
        return cls(
            block=np.repeat(np.arange(len(rows)), rows),
            row=np.array([row for count in rows for row in range(count)], np.int64),
            low=low,
            high=high,
            tolerance=np.repeat([block.tolerance for block in blocks], rows),
            window_ends=tuple(ends),
            grid=distinct(np.concatenate((FIRST_GRID, ends))) if ends else FIRST_GRID,
        )
