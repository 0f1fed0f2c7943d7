"""The map: duration and angular momentum around the present point, the nearest points first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

import floatplan as fp
from floatplan.arrays import Array, IntArray
from floatplan.studio.work.flown import Flown
from floatplan.studio.work.tasks import Cell, Cells

DURATION, MOMENTUM = "flight.duration", "flight.angular_momentum"
COLUMNS, ROWS = 9, 7  # [-] values of h, values of T
DURATION_STEP = 0.07  # [-] of the duration
MOMENTUM_STEP = 0.12  # [-] of the angular momentum, or of half the interval (9); the larger one counts
TOGETHER = 3  # [-] points that are asked for at a time
POINT_BUDGET = 0.4  # [s] of search at a point


@dataclass(frozen=True, eq=False)
class Map:
    """Plans around one: columns of angular momentum, rows of duration.

    Attributes
    ----------
    momenta : (COLUMNS,) kg m^2/s
    durations : (ROWS,) s
    cells : (row, column) -> Cell, as far as they were planned
    relative : whether what cells use is a share of limits; else torques, N m
    """

    problem: fp.Problem
    momenta: Array
    durations: Array
    relative: bool
    cells: dict[tuple[int, int], Cell] = field(default_factory=dict)

    @classmethod
    def around(cls, present: Flown) -> Map:
        """Return the empty map around a plan."""
        duration, momentum = present.plan.duration, present.plan.angular_momentum
        low, high = present.plan.angular_momentum_bounds
        step = MOMENTUM_STEP * max(abs(momentum), abs(high - low) / 2, 1e-3)
        return cls(
            problem=present.problem,
            momenta=np.asarray(momentum + step * (np.arange(COLUMNS) - COLUMNS // 2), dtype=np.float64),
            durations=np.asarray(duration * (1 + DURATION_STEP * (np.arange(ROWS) - ROWS // 2)), dtype=np.float64),
            relative=present.largest_use is not None,
        )

    def questions(self, problem: fp.Problem) -> Iterator[tuple[list[tuple[int, int]], Cells]]:
        """Points and the question about them, from the middle outwards; ``problem`` is the one that was asked."""
        rows, columns = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
        distance = ((rows - ROWS // 2) / ROWS) ** 2 + ((columns - COLUMNS // 2) / COLUMNS) ** 2
        for first in range(0, len(rows), TOGETHER):
            chosen: IntArray = np.argsort(distance, kind="stable")[first : first + TOGETHER]
            varied = {DURATION: self.durations[rows[chosen]], MOMENTUM: self.momenta[columns[chosen]]}
            points = list(zip(rows[chosen].tolist(), columns[chosen].tolist(), strict=True))
            yield points, Cells(problem, varied, POINT_BUDGET)

    def values(self, row: int, column: int) -> dict[str, float]:
        """The numbers of a point, by their paths."""
        return {DURATION: float(self.durations[row]), MOMENTUM: float(self.momenta[column])}
