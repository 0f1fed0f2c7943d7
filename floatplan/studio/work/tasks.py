"""What a process of the studio is asked to do, and its answers."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.errors import printable
from floatplan.kernel.rows import is_plain_family
from floatplan.planning.planned import planned
from floatplan.planning.search import SearchOptions
from floatplan.studio.work.flown import Flown, flown, largest_use


class Task(Protocol):
    """A question with its answer."""

    def answer(self) -> object:
        """Return the answer; any exception becomes a :class:`Failure`."""


@dataclass(frozen=True)
class Failure:
    """Why there is no answer, for a person."""

    words: str


@dataclass(frozen=True, eq=False)
class Quick:
    """Plan within a budget, s, from a plan at hand where there is one: the plan, or the nearest motion so far."""

    problem: fp.Problem
    budget: float
    near: fp.Plan | None = None

    def answer(self) -> Flown:
        """Plan."""
        asked = time.perf_counter()
        return flown(planned(self.problem, SearchOptions(budget=self.budget), self.near).plan, False, asked)


@dataclass(frozen=True, eq=False)
class Settle:
    """Plan and prove, as ``floatplan plan`` does."""

    problem: fp.Problem

    def answer(self) -> Flown:
        """Plan and prove."""
        asked = time.perf_counter()
        return flown(fp.plan(self.problem, prove=True), True, asked)


@dataclass(frozen=True)
class Cell:
    """One point of the map.

    Attributes
    ----------
    status : as of :func:`floatplan.plan_many`
    use : share of the limits that the plan uses; where there are none, its largest torque, N m; None without a plan
    """

    status: str
    use: float | None


@dataclass(frozen=True, eq=False)
class Cells:
    """Plan some points of the map: arrays by their paths; each within a budget, s, where they are no batch."""

    problem: fp.Problem
    varied: Mapping[str, Array]
    budget: float

    def answer(self) -> list[Cell]:
        """Plan them."""
        family = fp.Family(self.problem, self.varied)
        if is_plain_family(family):
            plans = fp.plan_many(family)
            found = zip(plans.status.tolist(), plans.ok.tolist(), strict=True)
            return [Cell(word, _use(plans[row]) if ok else None) for row, (word, ok) in enumerate(found)]
        return [self._searched(family, row) for row in range(len(family))]

    def _searched(self, family: fp.Family, row: int) -> Cell:
        try:
            plan = fp.plan(family[row], budget=self.budget)
        except fp.InputError:
            return Cell("error", None)
        return Cell(plan.status, _use(plan)) if plan.ok else Cell("not_found", None)


def _use(plan: fp.Plan) -> float:
    use = largest_use(plan.utilisation)
    return float(np.max(plan.peaks.motor_torque)) if use is None else use


def words_of(error: BaseException) -> str:
    """What went wrong, for a person: floatplan's own errors say it themselves."""
    if isinstance(error, fp.FloatplanError):
        return str(error)
    if isinstance(error, MemoryError):
        return "there is not enough memory for this"
    return printable(f"{type(error).__name__}: {error}")
