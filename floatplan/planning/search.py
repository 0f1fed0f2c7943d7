"""The search for a motion: attempts from many starts, at rising degrees, in one process or several; the best kept.

The attempts are a sequence that the problem and the seed settle: neither the number of solutions wanted nor that of the
processes changes it. More solutions wanted make it longer, so that its best is never worse. Unless a budget of seconds
is given, it ends by the work done in its order.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from floatplan.arguments import SEED, Check, Checked, function, optional, positive, whole
from floatplan.arrays import Array
from floatplan.compiled.batch import EASY_ITERATIONS, WANTED_AFTER_FAILURE
from floatplan.motion.dynamics import MomentumSet
from floatplan.planning.attempt import ATTEMPTS, Attempts, Followed, Outcome, best
from floatplan.planning.starts import Start
from floatplan.planning.transcription.compiled_attempt import MOMENTUM_FRACTIONS, SAME
from floatplan.pool import in_order, one_thread, processes
from floatplan.problem.problem import Problem
from floatplan.tables import Range

LOG = logging.getLogger(__name__)
DEFAULT_WORK = 6e7  # [instants of one body] of a search whose budget is left out: 1 to 2 s
MOST_JOBS = 64  # [-] processes
MOST_ATTEMPTS = 10**6  # [-] at all degrees
MOST_SOLVED = 1000  # [-] solved starts to choose the best from
JOBS = whole(Range(1, MOST_JOBS, ""))
ATTEMPTS_FOR_THE_IMPOSSIBLE = 2  # [-] where no motion can meet the problem
ATTEMPTS_BEFORE_RAISING = 4  # [-] the same where the degree may be raised
RAISED = 2  # [-] nearest motions of one degree that are starts at the next
DEGREE_STEP = 2  # [-]
HIGHEST_AUTOMATIC_DEGREE = 13  # [-]
STARTS_OF_FREE_MOMENTUM = 1 + 2 * len(MOMENTUM_FRACTIONS)  # [-] where h is free, unless the best solutions agree before
AGREEING = 2  # [-] easy solutions that are the same motion, where h is free: with no other it is taken for the best
AGREEING_BEST = 3  # [-] of the best among others
AGREEMENT = 1e-5  # [-] relative difference of their objectives
FEW = 5  # [-] starts at a degree, of which one comes near wherever one of at most 16 holds
FAR = 1.0  # [-] of a row's scale, or [rad]: a larger violation is not near
ANNOUNCED_EVERY = 1.0  # [s] words about the progress
STARTS_AFTER_THE_FIRST = 1  # [-] with constraints: tried after one that is solved but not optimal


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Where the attempts of a search ended, in their order, and why there are no more of them.

    Where the given h led to no plan, ``momentum_found`` (e,), kg m^2/s, is one that did.
    """

    outcomes: Sequence[Outcome]
    ran_out_of_time: bool = False
    ran_out_of_patience: bool = False
    interrupted: bool = False
    momentum_found: Array | None = None

    @cached_property
    def best(self) -> Outcome:
        """The best outcome, the first of equals."""
        return best(self.outcomes)

    @cached_property
    def holding(self) -> tuple[Outcome, ...]:
        """All that hold, in the order of their objectives, which a single one need not have evaluated."""
        holding = [outcome for outcome in self.outcomes if outcome.holds]
        return tuple(sorted(holding, key=lambda outcome: outcome.objective_value) if len(holding) > 1 else holding)

    @property
    def counts(self) -> dict[str, int]:
        """Starts followed and those solved, iterations of the solver and motions evaluated, in all attempts."""
        solutions = [outcome.solution for outcome in self.outcomes]
        return {
            "iterations": sum(solution.iterations for solution in solutions),
            "evaluations": sum(solution.evaluations for solution in solutions),
            "starts": _starts(self.outcomes),
            "solved": sum(outcome.solved for outcome in self.outcomes if outcome.holds),
        }


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
    patience : instants of one body, how much of the usual work may be done before a start is solved; None: all of it
        Only with one process. A search that ends sooner is otherwise the same.
    attempts : unsolved starts at a degree, after which no more are tried there, or five where none comes near a plan;
        None: as many as the work allows
        With one process too.
    near_miss : whether a motion is searched that nearly meets a problem which is proved impossible

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
    patience: float | None = None
    attempts: int | None = None
    near_miss: bool = True

    checks: ClassVar[Mapping[str, Check]] = {
        "seed": SEED,
        "starts": whole(Range(1, MOST_SOLVED, "")),
        "budget": optional(positive(unit="s")),
        "jobs": JOBS,
        "progress": optional(function),
        "attempts": optional(whole(Range(1, ATTEMPTS, ""))),
    }

    @property
    def work(self) -> float:
        """Most work of a search, instants of one body: the usual, unless a budget is given."""
        return DEFAULT_WORK if self.budget is None else np.inf


def search(
    prepared: Attempts, options: SearchOptions, most: int = MOST_ATTEMPTS, followed: Followed | None = None
) -> SearchResult:
    """Try starts until so many of them are solved, the budget is used up, or no start is left.

    The budget is of seconds, or of the default work where it is None. ``most`` limits the starts; where the first fails
    and the problem is known to have no solution, at most a near miss is wanted. The first starts may have been followed
    together: of these the best alone is kept. Ctrl-C ends the search with the best motion so far; the plain one where
    there is none.
    """
    expired = expiry(options.budget)
    allowance = Allowance.of(options)
    outcomes: list[Outcome] = []
    interrupted = False
    announced = time.monotonic()
    try:
        for outcome in _outcomes(prepared, options, expired, allowance, followed, most):
            outcomes.append(outcome)
            log_attempt(prepared, outcomes)
            if options.progress and time.monotonic() - announced > ANNOUNCED_EVERY:
                announced, counts = time.monotonic(), SearchResult(outcomes).counts
                tried = f"{counts['starts']} starts tried, {counts['solved']} solved"
                options.progress(f"{tried}, degree {max(outcome.variables.degrees)}")
            if _are_enough(outcomes, options.starts, prepared) or expired():
                break
            tried_enough = not options.near_miss or len(outcomes) >= ATTEMPTS_FOR_THE_IMPOSSIBLE
            if tried_enough and not outcomes[0].holds and prepared.impossible:
                if not options.near_miss:
                    return SearchResult([_untried(prepared) if outcomes[0].starts else outcomes[0]])
                break
    except KeyboardInterrupt:
        interrupted = True
    if not outcomes:
        outcomes.append(_untried(prepared))
        outcomes[0].starts = int(interrupted)
    out_of_patience = allowance.gave_up or (allowance.is_used_up and allowance.held_back > 0)
    return SearchResult(outcomes, allowance.is_used_up or expired(), out_of_patience, interrupted)


def _untried(prepared: Attempts) -> Outcome:
    """Return the plain motion as it is."""
    outcome = prepared.attempt(prepared.plain_start, lambda: True)
    outcome.starts = 0
    return outcome


def log_attempt(prepared: Attempts, outcomes: Sequence[Outcome]) -> None:
    """Log the last attempt in a line: number, degree, end, what it violates most, and the least violation so far."""
    if LOG.isEnabledFor(logging.INFO):
        LOG.info("%s", _said(prepared, outcomes))


def _said(prepared: Attempts, outcomes: Sequence[Outcome]) -> str:
    outcome = outcomes[-1]
    degrees = " to ".join(map(str, sorted(set(outcome.variables.degrees))))
    start = _starts(outcomes)
    steps = f"start {start}, degree {degrees}, {outcome.solution.iterations} steps"
    least = f"best violation {min(each.violation for each in outcomes):.3g}"
    if outcome.holds:
        return f"{steps}; {outcome.solution.status}, {outcome.objective} {outcome.objective_value:.6g}; {least}"
    if outcome.violation == np.inf:
        return f"{steps}; no motion to the goal"
    of = " rad of the goal's orientation"
    if -outcome.worst.least >= outcome.violation:
        block, row, _, s = outcome.worst.lowest
        of = f" of {prepared.constraints[block].labels[row]} at {s * prepared.problem.flight.duration:.3g} s"
    return f"{steps}; violation {outcome.violation:.3g}{of}; {least}"


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
    constrained = prepared.problem.has_inequalities
    easy = [outcome.is_optimal and outcome.solution.iterations <= EASY_ITERATIONS for outcome in outcomes]
    if constrained and prepared.momentum.free:
        values = np.sort([outcomes[index].objective_value for index in solved])
        agreeing = int((values - values[0] <= AGREEMENT * values).sum())
        enough = AGREEING if agreeing == len(values) and all(easy[index] for index in solved) else AGREEING_BEST
        return _starts(outcomes) >= STARTS_OF_FREE_MOMENTUM or agreeing >= enough
    if easy[0] or len(solved) >= WANTED_AFTER_FAILURE:
        return True
    return constrained and (
        any(outcome.is_optimal for outcome in outcomes) or len(outcomes) - solved[0] > STARTS_AFTER_THE_FIRST
    )


def _stages(problem: Problem) -> Iterator[tuple[tuple[int, ...], int]]:
    """Degrees and how many starts to try with them."""
    if not problem.raises_degree:
        yield problem.degrees, ATTEMPTS
        return
    for degree in range(problem.degrees[0], HIGHEST_AUTOMATIC_DEGREE, DEGREE_STEP):
        yield (degree,) * len(problem.degrees), ATTEMPTS_BEFORE_RAISING
    yield (HIGHEST_AUTOMATIC_DEGREE,) * len(problem.degrees), ATTEMPTS


def _outcomes(
    prepared: Attempts,
    options: SearchOptions,
    expired: Callable[[], bool],
    allowance: Allowance,
    followed: Followed | None,
    most: int,
) -> Iterator[Outcome]:
    """Outcomes of the attempts, in their order, from this process or from several; of so many starts at most.

    The nearest motions of one degree are the first starts of the next. An attempt that needs more work than is left is
    none: how far it came would depend on what ran beside it.
    """
    tried: list[Outcome] = []
    together = prepared.outcome_of(followed) if followed else None
    is_first = together is None
    if together:
        allowance.grants(together, True)
        most -= together.starts
        yield together

    def here(degrees: tuple[int, ...], given: list[Start], numbers: range) -> Outcome | None:
        return prepared.attempts(degrees, given, numbers, expired, allowance.left, not options.near_miss)

    def in_turn(degrees: tuple[int, ...], given: list[Start], numbers: range) -> Iterator[Outcome | None]:
        """One after the other as long as it matters where each ends, then together."""
        number = numbers.start
        while number < numbers.stop:
            alone = ATTEMPTS_FOR_THE_IMPOSSIBLE if options.near_miss else 1
            matters = len(tried) < alone or any(each.holds for each in tried)
            most = min(options.attempts, FEW if _starts(tried) < FEW else ATTEMPTS) if options.attempts else ATTEMPTS
            count = 1 if matters or prepared.problem.raises_degree else most - _starts(tried)
            outcome = here(degrees, given, range(number, min(number + count, numbers.stop)))
            yield outcome
            number += outcome.starts if outcome else 1

    ready = (prepared.problem, prepared.seed, prepared.momentum, options.budget, allowance.left)
    several = options.jobs > 1
    with processes(options.jobs, (__name__,), _attempting, *ready) if several else nullcontext() as pool:
        for degrees, attempts in _stages(prepared.problem):
            nearest = _nearest(tried)
            raised = [replace(prepared.raised(each, degrees), at_once=each is nearest[0]) for each in nearest]
            first = together.starts if together else 0
            numbers = range(first, min(attempts, first + most))
            tried = []
            alone = ((degrees, raised, range(number, number + 1)) for number in numbers)
            for outcome in in_order(pool, list(alone), here) if several else in_turn(degrees, raised, numbers):
                if outcome is None:  # there are not so many starts
                    break
                if not allowance.grants(outcome, is_first):
                    return
                is_first = False
                most -= outcome.starts
                yield outcome
                tried.append(outcome)
                allowance.gave_up = options.attempts is not None and _are_hopeless(tried, options.attempts)
                if allowance.gave_up:
                    break


def _are_hopeless(tried: list[Outcome], most: int) -> bool:
    """Whether so many starts at a degree, of which none holds, are enough; few are where none has come near a plan."""
    nearest, starts = min(each.violation for each in tried), _starts(tried)
    return nearest > 0 and (starts == most or (starts >= FEW and nearest > FAR))


def _starts(outcomes: Sequence[Outcome]) -> int:
    """How many were followed."""
    return sum(outcome.starts for outcome in outcomes)


def _nearest(outcomes: list[Outcome]) -> list[Outcome]:
    """The outcomes of least violation, each at another motion."""
    distinct: list[Outcome] = []
    for outcome in sorted(outcomes, key=lambda outcome: (outcome.violation, outcome.objective_value)):
        value = outcome.objective_value
        if all(abs(value - other.objective_value) > SAME * abs(value) for other in distinct):
            distinct.append(outcome)
    return distinct[:RAISED]


def expiry(budget: float | None) -> Callable[[], bool]:
    """Return a function that is true once a budget of seconds, counted from now, is used up; never without one."""
    if budget is None:
        return lambda: False
    end = time.monotonic() + budget
    return lambda: time.monotonic() > end


@one_thread
def _attempting(
    problem: Problem, seed: int, momentum: MomentumSet, budget: float | None, most_work: float
) -> Callable[..., Outcome | None]:
    """Return what follows starts in a process of its own, by degrees, given starts and number."""
    prepared, expired = Attempts(problem, seed, momentum), expiry(budget)

    @one_thread
    def attempt(degrees: tuple[int, ...], given: list[Start], numbers: range) -> Outcome | None:
        outcome = prepared.attempts(degrees, given, numbers, expired, most_work)
        return outcome and replace(outcome, begun=outcome.variables, landed=None)  # without what it caches

    return attempt
