"""How to search, and how much may be done for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from floatplan.arguments import SEED, function, optional, positive, whole
from floatplan.keys import Keyed
from floatplan.planning.result import AttemptResult
from floatplan.tables import Range

DEFAULT_WORK = 6e7  # [instants of one body] of a search whose budget is left out: 1 to 2 s
MOST_JOBS = 64  # [-] processes
MOST_SOLVED = 1000  # [-] solved starts to choose the best from
ATTEMPTS = 300  # [-] most starts tried at each degree
JOBS = whole(Range(1, MOST_JOBS, ""))


@dataclass(frozen=True)
class SearchOptions(Keyed):
    """How to search; see :func:`floatplan.plan`.

    Attributes
    ----------
    seed : of the random starts
    starts : solved starts to choose the best from
    budget : s, or None: the usual work
    progress : told in a few words what the search is doing
    patience : instants of one body, how much of the usual work may be done before a start is solved; None: all of it
        A search that ends sooner is otherwise the same.
    attempts : unsolved starts at a degree, after which no more are tried there, or five where none comes near a plan;
        None: as many as the work allows
    near_miss : whether a motion is searched that nearly meets a problem which is proved impossible

    Raises
    ------
    InputError
        A number is none, or out of its range; or ``progress`` cannot be called.
    """

    seed: Annotated[int, SEED] = 0
    starts: Annotated[int, whole(Range(1, MOST_SOLVED, ""))] = 1
    budget: Annotated[float | None, optional(positive(unit="s"))] = None
    progress: Annotated[Callable[[str], None] | None, optional(function)] = None
    patience: float | None = None
    attempts: Annotated[int | None, optional(whole(Range(1, ATTEMPTS, "")))] = None
    near_miss: bool = True

    @property
    def work(self) -> float:
        """Most work of a search, instants of one body: the usual, unless a budget is given."""
        return DEFAULT_WORK if self.budget is None else np.inf


@dataclass
class Allowance:
    """Work that the attempts of a search may do together, counted in their order; some of it once one is solved.

    ``gave_up`` says that at the last degree as many starts as are wanted were not solved.
    """

    left: float
    held_back: float = 0.0
    is_used_up: bool = False
    gave_up: bool = False

    @classmethod
    def of(cls, options: SearchOptions) -> Allowance:
        """As the options of a search say."""
        work, patience = options.work, np.inf if options.patience is None else options.patience
        return cls(min(work, patience), held_back=work - patience if patience < work else 0.0)

    def grants(self, result: AttemptResult, is_first: bool) -> bool:
        """Whether an attempt's work was still allowed; the first always is, so that there is an answer."""
        self.left -= result.work
        self.is_used_up = self.left < 0
        if result.holds and not self.is_used_up:
            self.left, self.held_back = self.left + self.held_back, 0.0
        return is_first or not self.is_used_up


def expiry(budget: float | None) -> Callable[[], bool]:
    """Return a function that is true once a budget of seconds, counted from now, is used up; never without one."""
    if budget is None:
        return lambda: False
    end = time.monotonic() + budget
    return lambda: time.monotonic() > end
