"""The search for a motion: attempts from many starts, at rising degrees; the best is kept.

The attempts are a sequence that the problem and the seed settle: the number of solutions wanted does not change it.
More solutions wanted make it longer, so that its best is never worse. Unless a budget of seconds is given, it ends by
the work done in its order.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from floatplan.arguments import SEED, Check, Checked, function, optional, positive, whole
from floatplan.arrays import Array
from floatplan.kernel.tolerances import EXCHANGE, SETTINGS
from floatplan.planning.attempt import ATTEMPTS, Attempts
from floatplan.planning.starts import Start
from floatplan.planning.transcription.compiled_attempt import MOMENTUM_FRACTIONS
from floatplan.planning.transcription.result import AttemptResult, best
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
    """What came of a search: its attempts, and why there were no more of them.

    Attributes
    ----------
    prepared : Attempts
        The problem.
    results : sequence of AttemptResult
        In the order of the attempts.
    ran_out_of_time, ran_out_of_patience, interrupted : bool
        Why there are no more.
    momentum_found : (e,) kg m^2/s, optional
        An h with which there is a plan, where the given one led to none.
    seconds : float
        What the search took.
    """

    prepared: Attempts
    results: Sequence[AttemptResult]
    ran_out_of_time: bool = False
    ran_out_of_patience: bool = False
    interrupted: bool = False
    momentum_found: Array | None = None
    seconds: float = 0.0

    @cached_property
    def best(self) -> AttemptResult:
        """The best of them, the first of equals."""
        return best(self.results)

    @cached_property
    def holding(self) -> tuple[AttemptResult, ...]:
        """All that hold, in the order of their objectives, which a single one need not have evaluated."""
        holding = [result for result in self.results if result.holds]
        return tuple(sorted(holding, key=lambda result: result.objective_value) if len(holding) > 1 else holding)

    @property
    def impossible(self) -> list[str]:
        """Sentences about why no motion whatever can be a plan, where none was found."""
        return [] if self.best.holds else self.prepared.impossible

    @property
    def work(self) -> float:
        """What all attempts took, instants of one body."""
        return sum(result.work for result in self.results)

    @property
    def counts(self) -> dict[str, int]:
        """Starts followed and those solved, iterations of the solver and motions evaluated, in all attempts."""
        return {
            "iterations": sum(result.iterations for result in self.results),
            "evaluations": sum(result.evaluations for result in self.results),
            "starts": _starts(self.results),
            "solved": sum(result.solved for result in self.results if result.holds),
        }


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
        "starts": whole(Range(1, MOST_SOLVED, "")),
        "budget": optional(positive(unit="s")),
        "progress": optional(function),
        "attempts": optional(whole(Range(1, ATTEMPTS, ""))),
    }

    @property
    def work(self) -> float:
        """Most work of a search, instants of one body: the usual, unless a budget is given."""
        return DEFAULT_WORK if self.budget is None else np.inf


def search(prepared: Attempts, options: SearchOptions, most: int = MOST_ATTEMPTS) -> SearchResult:
    """Try starts until so many of them are solved, the budget is used up, or no start is left.

    The budget is of seconds, or of the default work where it is None. ``most`` limits the starts; where the first fails
    and the problem is known to have no solution, at most a near miss is wanted. The first starts may have been followed
    together: of these the best alone is kept. Ctrl-C ends the search with the best motion so far; the plain one where
    there is none.
    """
    expired = expiry(options.budget)
    allowance = Allowance.of(options)
    results: list[AttemptResult] = []
    interrupted = False
    announced = time.monotonic()
    try:
        for result in _results(prepared, options, expired, allowance, most):
            results.append(result)
            log_attempt(prepared, results)
            if options.progress and time.monotonic() - announced > ANNOUNCED_EVERY:
                announced, counts = time.monotonic(), SearchResult(prepared, results).counts
                tried = f"{counts['starts']} starts tried, {counts['solved']} solved"
                options.progress(f"{tried}, degree {max(result.variables.degrees)}")
            if _are_enough(results, options.starts, prepared) or expired():
                break
            tried_enough = not options.near_miss or len(results) >= ATTEMPTS_FOR_THE_IMPOSSIBLE
            if tried_enough and not results[0].holds and prepared.impossible:
                if not options.near_miss:
                    return SearchResult(prepared, [_untried(prepared) if results[0].starts else results[0]])
                break
    except KeyboardInterrupt:
        interrupted = True
    if not results:
        results.append(_untried(prepared))
        results[0].starts = int(interrupted)
    out_of_patience = allowance.gave_up or (allowance.is_used_up and allowance.held_back > 0)
    return SearchResult(
        prepared=prepared,
        results=results,
        ran_out_of_time=allowance.is_used_up or expired(),
        ran_out_of_patience=out_of_patience,
        interrupted=interrupted,
    )


def _untried(prepared: Attempts) -> AttemptResult:
    """Return the plain motion as it is."""
    result = prepared.attempt(prepared.plain_start, lambda: True)
    result.starts = 0
    return result


def log_attempt(prepared: Attempts, results: Sequence[AttemptResult]) -> None:
    """Log the last attempt in a line: number, degree, end, what it violates most, and the least violation so far."""
    if LOG.isEnabledFor(logging.INFO):
        LOG.info("%s", _said(prepared, results))


def _said(prepared: Attempts, results: Sequence[AttemptResult]) -> str:
    result = results[-1]
    degrees = " to ".join(map(str, sorted(set(result.variables.degrees))))
    start = _starts(results)
    steps = f"start {start}, degree {degrees}, {result.iterations} steps"
    least = f"best violation {min(each.violation for each in results):.3g}"
    if result.holds:
        return f"{steps}; {result.status}, {result.objective} {result.objective_value:.6g}; {least}"
    if result.violation == np.inf:
        return f"{steps}; no motion to the goal"
    of = " rad of the goal's orientation"
    if -result.worst.least >= result.violation:
        block, row, _, s = result.worst.lowest
        of = f" of {prepared.constraints[block].labels[row]} at {s * prepared.problem.flight.duration:.3g} s"
    return f"{steps}; violation {result.violation:.3g}{of}; {least}"


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


def _are_enough(results: list[AttemptResult], wanted: int, prepared: Attempts) -> bool:
    """Whether ``wanted`` starts are solved and more of them promise little."""
    solved = [index for index, result in enumerate(results) if result.holds]
    if solved and results[0].is_exhaustive:
        return True
    if len(solved) < max(wanted, 1):
        return False
    constrained = prepared.problem.has_inequalities
    easy = [result.is_optimal and result.iterations <= SETTINGS.easy_iterations for result in results]
    if constrained and prepared.momentum.free:
        values = np.sort([results[index].objective_value for index in solved])
        agreeing = int((values - values[0] <= AGREEMENT * values).sum())
        enough = AGREEING if agreeing == len(values) and all(easy[index] for index in solved) else AGREEING_BEST
        return _starts(results) >= STARTS_OF_FREE_MOMENTUM or agreeing >= enough
    if easy[0] or len(solved) >= SETTINGS.wanted_after_failure:
        return True
    return constrained and (
        any(result.is_optimal for result in results) or len(results) - solved[0] > STARTS_AFTER_THE_FIRST
    )


def _stages(problem: Problem) -> Iterator[tuple[tuple[int, ...], int]]:
    """Degrees and how many starts to try with them."""
    if not problem.raises_degree:
        yield problem.degrees, ATTEMPTS
        return
    for degree in range(problem.degrees[0], HIGHEST_AUTOMATIC_DEGREE, DEGREE_STEP):
        yield (degree,) * len(problem.degrees), ATTEMPTS_BEFORE_RAISING
    yield (HIGHEST_AUTOMATIC_DEGREE,) * len(problem.degrees), ATTEMPTS


def _results(
    prepared: Attempts,
    options: SearchOptions,
    expired: Callable[[], bool],
    allowance: Allowance,
    most: int,
) -> Iterator[AttemptResult]:
    """Results of the attempts, in their order; of so many starts at most.

    The nearest motions of one degree are the first starts of the next. An attempt that needs more work than is left is
    none: how far it came would depend on what was done before.
    """
    tried: list[AttemptResult] = []
    is_first = True

    def in_turn(degrees: tuple[int, ...], given: list[Start], numbers: range) -> Iterator[AttemptResult | None]:
        """One after the other as long as it matters where each ends, then together."""
        number = numbers.start
        while number < numbers.stop:
            alone = ATTEMPTS_FOR_THE_IMPOSSIBLE if options.near_miss else 1
            matters = len(tried) < alone or any(each.holds for each in tried)
            most = min(options.attempts, FEW if _starts(tried) < FEW else ATTEMPTS) if options.attempts else ATTEMPTS
            count = 1 if matters or prepared.problem.raises_degree else most - _starts(tried)
            these = range(number, min(number + count, numbers.stop))
            result = prepared.attempts(degrees, given, these, expired, allowance.left, not options.near_miss)
            yield result
            number += result.starts if result else 1

    for degrees, attempts in _stages(prepared.problem):
        nearest = _nearest(tried)
        raised = [replace(prepared.raised(each, degrees), at_once=each is nearest[0]) for each in nearest]
        numbers = range(min(attempts, most))
        tried = []
        for result in in_turn(degrees, raised, numbers):
            if result is None:  # there are not so many starts
                break
            if not allowance.grants(result, is_first):
                return
            is_first = False
            most -= result.starts
            yield result
            tried.append(result)
            allowance.gave_up = options.attempts is not None and _are_hopeless(tried, options.attempts)
            if allowance.gave_up:
                break


def _are_hopeless(tried: list[AttemptResult], most: int) -> bool:
    """Whether so many starts at a degree, of which none holds, are enough; few are where none has come near a plan."""
    nearest, starts = min(each.violation for each in tried), _starts(tried)
    return nearest > 0 and (starts == most or (starts >= FEW and nearest > FAR))


def _starts(results: Sequence[AttemptResult]) -> int:
    """How many were followed."""
    return sum(result.starts for result in results)


def _nearest(results: list[AttemptResult]) -> list[AttemptResult]:
    """The results of least violation, each at another motion."""
    distinct: list[AttemptResult] = []
    for result in sorted(results, key=lambda result: (result.violation, result.objective_value)):
        value = result.objective_value
        if all(abs(value - other.objective_value) > EXCHANGE.same * abs(value) for other in distinct):
            distinct.append(result)
    return distinct[:RAISED]


def expiry(budget: float | None) -> Callable[[], bool]:
    """Return a function that is true once a budget of seconds, counted from now, is used up; never without one."""
    if budget is None:
        return lambda: False
    end = time.monotonic() + budget
    return lambda: time.monotonic() > end
