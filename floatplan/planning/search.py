"""The search for a motion: attempts from many starts, at rising degrees, in one process or several; the best kept.

The attempts are a sequence that the problem and the seed settle: neither the number of solutions wanted nor that of the
processes changes it. More solutions wanted make it longer, so that its best is never worse. Unless a budget of seconds
is given, it ends by the work done in its order.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

import numpy as np

from floatplan.arguments import SEED, Check, Checked, function, optional, positive, whole
from floatplan.kernel.batch import WANTED_AFTER_FAILURE
from floatplan.planning.attempt import ATTEMPTS, Attempts, Outcome, best
from floatplan.planning.compiled import Followed
from floatplan.planning.runner import expiry, runner
from floatplan.planning.starts import MOMENTUM_FRACTIONS
from floatplan.planning.work import DEFAULT_WORK
from floatplan.problem.problem import Problem
from floatplan.tables import Range

LOG = logging.getLogger(__name__)
MOST_JOBS = 64  # [-] processes
MOST_SOLVED = 1000  # [-] solved starts to choose the best from
JOBS = whole(Range(1, MOST_JOBS, ""))
ATTEMPTS_FOR_THE_IMPOSSIBLE = 2  # [-] where no motion can meet the problem
ATTEMPTS_BEFORE_RAISING = 4  # [-] the same where the degree may be raised
RAISED = 2  # [-] nearest motions of one degree that are starts at the next
DEGREE_STEP = 2  # [-]
HIGHEST_AUTOMATIC_DEGREE = 13  # [-]
SAME = 1e-6  # [-] relative difference of objectives, below which two attempts ended at the same motion
STARTS_OF_FREE_MOMENTUM = 1 + 2 * len(MOMENTUM_FRACTIONS)  # [-] where h is free, unless the best solutions agree before
AGREEING = 3  # [-] best solutions that are the same motion, where h is free: then it is taken for the best there is
AGREEMENT = 1e-5  # [-] relative difference of their objectives
STARTS_AFTER_THE_FIRST = 1  # [-] with constraints: tried after one that is solved but not optimal


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search: the best outcome, all that hold in order of their objectives, and the work it took."""

    best: Outcome
    holding: tuple[Outcome, ...]
    attempts: int
    solved: int
    iterations: int
    evaluations: int
    work: float
    ran_out_of_time: bool
    ran_out_of_patience: bool
    interrupted: bool


@dataclass(frozen=True)
class SearchOptions(Checked):
    """How to search; see :func:`floatplan.plan`.

    Attributes
    ----------
    seed : of the random starts
    starts : solved starts to choose the best from
    budget : s, or None: the usual work
    jobs : processes
    progress : told in a few words what the search is doing
    work : instants of one body, where there is no budget; None: the usual work
    patience : of that work, how much may be done before a start is solved; None: all of it
        Only with one process. A search that ends sooner is otherwise the same.

    Raises
    ------
    InputError
        A number is none, or out of its range; or ``progress`` cannot be called.
    """

    seed: int = 0
    starts: int = 1
    budget: float | None = None
    jobs: int = 1
    progress: Callable[[str], None] | None = None
    work: float | None = None
    patience: float | None = None

    checks: ClassVar[Mapping[str, Check]] = {
        "seed": SEED,
        "starts": whole(Range(1, MOST_SOLVED, "")),
        "budget": optional(positive(unit="s")),
        "jobs": JOBS,
        "progress": optional(function),
    }


def search(
    prepared: Attempts, options: SearchOptions, attempts: int | None = None, followed: Followed | None = None
) -> SearchResult:
    """Try starts until so many of them are solved, the budget is used up, or no start is left.

    The budget is of seconds, or of the default work where it is None. ``attempts`` limits the starts, where the problem
    is known to have no solution and only a near miss is wanted. The first starts may have been followed together: of
    these the best alone is kept. Ctrl-C ends the search with the best motion so far.
    """
    expired = expiry(options.budget)
    work = (options.work or DEFAULT_WORK) if options.budget is None else np.inf
    allowance = Allowance(work) if options.patience is None else Allowance.with_patience(work, options.patience)
    outcomes: list[Outcome] = []
    interrupted = False
    announced = time.monotonic()
    try:
        for outcome in islice(_outcomes(prepared, options, expired, allowance, followed), attempts):
            outcomes.append(outcome)
            tried, solved = _counts(outcomes)
            if LOG.isEnabledFor(logging.INFO):
                LOG.info("%s", _said(prepared, outcomes))
            if options.progress and time.monotonic() - announced > 1:
                announced = time.monotonic()
                options.progress(f"{tried} starts tried, {solved} solved, degree {max(outcome.degrees)}")
            if _are_enough(outcomes, options.starts, prepared) or expired():
                break
    except KeyboardInterrupt:
        interrupted = True
        if not outcomes:
            outcomes.append(prepared.attempt(prepared.plain_start, 0, prepared.problem.degrees, lambda: True))
    holding = [outcome for outcome in outcomes if outcome.holds]
    tried, solved = _counts(outcomes)
    return SearchResult(
        best(outcomes),
        tuple(sorted(holding, key=lambda outcome: outcome.objective_value) if len(holding) > 1 else holding),
        attempts=tried,
        solved=solved,
        iterations=sum(outcome.solution.iterations for outcome in outcomes),
        evaluations=sum(outcome.solution.evaluations for outcome in outcomes),
        work=sum(outcome.work for outcome in outcomes),
        ran_out_of_time=allowance.is_used_up or expired(),
        ran_out_of_patience=allowance.is_used_up and allowance.held_back > 0,
        interrupted=interrupted,
    )


def _counts(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """Starts followed, and of them those solved."""
    return sum(outcome.starts for outcome in outcomes), sum(outcome.solved for outcome in outcomes if outcome.holds)


def _said(prepared: Attempts, outcomes: list[Outcome]) -> str:
    """The last attempt in a line: its number, degree, end, what it violates most, and the least violation so far."""
    outcome = outcomes[-1]
    degrees = sorted(set(outcome.degrees))
    parts = [
        f"start {_counts(outcomes)[0]}, degree {' to '.join(map(str, degrees))}, {outcome.solution.iterations} steps"
    ]
    if outcome.holds:
        parts.append(f"{outcome.solution.status}, {outcome.objective} {outcome.objective_value:.6g}")
    else:
        parts.append(f"violation {outcome.violation:.3g}{_of(prepared, outcome)}")
    return "; ".join([*parts, f"best violation {min(each.violation for each in outcomes):.3g}"])


def _of(prepared: Attempts, outcome: Outcome) -> str:
    worst = outcome.worst
    if not worst.value.size or -worst.least < outcome.violation:
        return " rad of the goal's orientation"
    index = int(np.argmin(worst.value))
    row = prepared.constraints[worst.block[index]].labels[int(worst.row[index])]
    return f" of {row} at {worst.s[index] * prepared.problem.flight.duration:.3g} s"


@dataclass
class Allowance:
    """Work that the attempts of a search may do together, counted in their order; some of it once one is solved."""

    left: float
    held_back: float = 0.0
    is_used_up: bool = False

    @classmethod
    def with_patience(cls, work: float, patience: float) -> Allowance:
        """Hold back what is beyond the patience."""
        return cls(min(work, patience), max(work - patience, 0.0))

    def grants(self, outcome: Outcome, is_first: bool) -> bool:
        """Whether an attempt's work was still allowed; the first always is, so that there is an answer."""
        self.left -= outcome.work
        self.is_used_up = self.left < 0
        if outcome.holds and not self.is_used_up:
            self.left, self.held_back = self.left + self.held_back, 0.0
        return is_first or not self.is_used_up


def _are_enough(outcomes: list[Outcome], wanted: int, prepared: Attempts) -> bool:
    """Whether ``wanted`` starts are solved and more of them promise little."""
    solved = [index for index, outcome in enumerate(outcomes) if outcome.holds]
    if solved and outcomes[0].starts > 1:  # the kernel has followed as many as promise anything
        return True
    if len(solved) < max(wanted, 1):
        return False
    constrained = bool(prepared.constraints)
    if constrained and prepared.plain_start.variables.momentum.free:
        return len(outcomes) >= STARTS_OF_FREE_MOMENTUM or _agree([outcomes[index] for index in solved])
    if outcomes[0].converged_quickly or len(solved) >= WANTED_AFTER_FAILURE:
        return True
    return constrained and (
        any(outcome.is_optimal for outcome in outcomes) or len(outcomes) - solved[0] > STARTS_AFTER_THE_FIRST
    )


def _agree(solved: list[Outcome]) -> bool:
    """Whether several of the solutions are the best one: different starts led there."""
    values = sorted(outcome.objective_value for outcome in solved)[:AGREEING]
    return len(values) == AGREEING and values[-1] - values[0] <= AGREEMENT * values[-1]


def _stages(problem: Problem) -> Iterator[tuple[tuple[int, ...], int]]:
    """Degrees and how many starts to try with them."""
    if not problem.raises_degree:
        yield problem.degrees, ATTEMPTS
        return
    degree = problem.degrees[0]
    while degree < HIGHEST_AUTOMATIC_DEGREE:
        yield (degree,) * len(problem.degrees), ATTEMPTS_BEFORE_RAISING
        degree += DEGREE_STEP
    yield (HIGHEST_AUTOMATIC_DEGREE,) * len(problem.degrees), ATTEMPTS


def _outcomes(
    prepared: Attempts,
    options: SearchOptions,
    expired: Callable[[], bool],
    allowance: Allowance,
    followed: Followed | None,
) -> Iterator[Outcome]:
    """Outcomes of the attempts, in their order, from this process or from several.

    The nearest motions of one degree are the first starts of the next. An attempt that needs more work than is left is
    none: how far it came would depend on what ran beside it.
    """
    nearest: list[Outcome] = []
    together = prepared.outcome_of(followed) if followed else None
    is_first = together is None
    if together:
        allowance.grants(together, True)
        yield together
    with runner(prepared, options.jobs, options.budget, expired, lambda: allowance.left) as run:
        for degrees, attempts in _stages(prepared.problem):
            raised = [prepared.raised(outcome, degrees) for outcome in nearest]
            tried = []
            for outcome in run(degrees, raised, range(together.starts if together else 0, attempts)):
                if not allowance.grants(outcome, is_first):
                    return
                is_first = False
                yield outcome
                tried.append(outcome)
            nearest = _nearest(tried)


def _nearest(outcomes: list[Outcome]) -> list[Outcome]:
    """The outcomes of least violation, each at another motion."""
    distinct: list[Outcome] = []
    for outcome in sorted(outcomes, key=lambda outcome: outcome.rank):
        value = outcome.objective_value
        if all(abs(value - other.objective_value) > SAME * abs(value) for other in distinct):
            distinct.append(outcome)
    return distinct[:RAISED]
