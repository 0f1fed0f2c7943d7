"""How to search."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from floatplan.arguments import SEED, TRIES, Check, Checked, function, optional, positive, whole
from floatplan.tables import Range

MOST_JOBS = 64  # [-] processes
ATTEMPTS = 300  # [-] most starts tried at each degree
JOBS = whole(Range(1, MOST_JOBS, ""))


@dataclass(frozen=True)
class SearchOptions(Checked):
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

    seed: int = 0
    starts: int = 1
    budget: float | None = None
    progress: Callable[[str], None] | None = None
    patience: float | None = None
    attempts: int | None = None
    near_miss: bool = True

    checks: ClassVar[Mapping[str, Check]] = {
        "seed": SEED,
        "starts": TRIES,
        "budget": optional(positive(unit="s")),
        "progress": optional(function),
        "attempts": optional(whole(Range(1, ATTEMPTS, ""))),
    }
