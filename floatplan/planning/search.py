"""The search for a motion: starts are followed, at rising degrees; the best motion is kept.

Where a start leads depends on the problem, the degrees, the seed and its number alone: the number of solutions wanted
does not change it. More solutions wanted make the search longer, so that its best is never worse. Unless a budget of
seconds is given, it ends by the work done in its order.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from floatplan.kernel.tolerances import EXCHANGE, SETTINGS
from floatplan.planning.kernel_problem import MOMENTUM_FRACTIONS, KernelProblem
from floatplan.planning.options import ATTEMPTS, SearchOptions
from floatplan.planning.result import AttemptResult, SearchResult, Work, count_starts, summary
from floatplan.planning.spec import FlightSpec, plain_start, spec_of
from floatplan.planning.variables import Start
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
Stop: TypeAlias = Callable[[], bool]
DEFAULT_WORK = 6e7  # [instants of one body] of a search whose budget is left out: 1 to 2 s
MOST_ATTEMPTS = 10**6  # [-] at all degrees
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


class Search:
    """A search for a motion of a problem.

    Attributes
    ----------
    spec : FlightSpec
        The problem; of a ``spec`` that is given, the ``problem`` need not be.
    options : SearchOptions
    followed : KernelProblem, optional
        The problem with the structs of a batch, in which starts of it have been followed: what came of these is the
        first attempt.
    plain_start : Start
        The plain motion of the problem's own degrees.
    work : Work
        That was done.
    """

    def __init__(
        self,
        problem: Problem,
        options: SearchOptions | None = None,
        spec: FlightSpec | None = None,
        followed: KernelProblem | None = None,
    ) -> None:
        self.spec = spec or spec_of(problem)
        self.options = options or SearchOptions()
        self.work = Work()
        self._ends_hold = False  # as far as is known
        self._path_is_clear = False
        self._kernel_problem = followed
        self._is_followed = followed is not None  # and nobody has asked yet what came of it
        self.plain_start = followed.start if followed else plain_start(self.spec, self.spec.problem.degrees)

    def run(self, most_starts: int = MOST_ATTEMPTS) -> SearchResult:
        """Follow starts until so many of them are solved, the budget is used up, or no start is left.

        The budget is of seconds, or of the default work where it is None. Where the first start fails and the problem
        is known to have no solution, at most a near miss is wanted. Of starts that were followed together the best
        alone is kept. Ctrl-C ends the search with the best motion so far; the plain one where there is none.
        """
        options = self.options
        expired = expiry(options.budget)
        allowance = Allowance.of(options)
        results: list[AttemptResult] = []
        interrupted = False
        announced = time.monotonic()
        try:
            for result in self._results(expired, allowance, most_starts):
                results.append(result)
                if LOG.isEnabledFor(logging.INFO):
                    LOG.info("%s", summary(results))
                if options.progress and time.monotonic() - announced > ANNOUNCED_EVERY:
                    announced = time.monotonic()
                    solved = sum(each.solved for each in results if each.holds)
                    tried = f"{count_starts(results)} starts tried, {solved} solved"
                    options.progress(f"{tried}, degree {max(result.variables.degrees)}")
                if self._are_enough(results) or expired():
                    break
                tried_enough = not options.near_miss or len(results) >= ATTEMPTS_FOR_THE_IMPOSSIBLE
                if tried_enough and not results[0].holds and self.impossible:
                    if options.near_miss:
                        break
                    untried = self._untried() if results[0].starts else results[0]
                    return SearchResult(self.spec, options.seed, [untried], self.impossible)
        except KeyboardInterrupt:
            interrupted = True
        if not results:
            results.append(self._untried())
            results[0].starts = int(interrupted)
        return SearchResult(
            spec=self.spec,
            seed=options.seed,
            results=results,
            impossible=[] if any(result.holds for result in results) else self.impossible,
            ran_out_of_time=allowance.is_used_up or expired(),
            ran_out_of_patience=allowance.gave_up or (allowance.is_used_up and allowance.held_back > 0),
            interrupted=interrupted,
        )

    def _results(self, expired: Stop, allowance: Allowance, most_starts: int) -> Iterator[AttemptResult]:
        """Yield results of the attempts, in their order; of so many starts at most.

        The nearest motions of one degree are the first starts of the next. An attempt that needs more work than is left
        is none: how far it came would depend on what was done before.
        """
        options = self.options
        tried: list[AttemptResult] = []
        is_first = True
        own = self.spec.problem.degrees
        stages = [own]
        if self.spec.problem.raises_degree:
            rising = range(own[0] + DEGREE_STEP, HIGHEST_AUTOMATIC_DEGREE + 1, DEGREE_STEP)
            stages += [(degree,) * len(own) for degree in rising]
        for degrees in stages:
            nearest = _nearest(tried) if tried else []
            raised = [self.spec.raised(each.variables, each.x, degrees) for each in nearest]
            raised[:1] = [replace(start, at_once=True) for start in raised[:1]]
            tried = []
            number = 0
            last = min(ATTEMPTS if degrees == stages[-1] else ATTEMPTS_BEFORE_RAISING, most_starts)
            while number < last:
                numbers = range(number, min(number + self._how_many(tried), last))
                result = self.follow_numbered(degrees, raised, numbers, expired, allowance.left, not options.near_miss)
                if result is None:  # there are not so many starts
                    break
                if not allowance.grants(result, is_first):
                    return
                is_first = False
                number += result.starts
                most_starts -= result.starts
                yield result
                tried.append(result)
                allowance.gave_up = options.attempts is not None and _are_hopeless(tried, options.attempts)
                if allowance.gave_up:
                    break

    def _how_many(self, tried: list[AttemptResult]) -> int:
        """How many starts the kernel may follow in one call, after those tried at a degree.

        One, as long as it matters where each ends: it may be the best, or tell that the problem is impossible, or its
        end be raised to the next degree. Else as many as are left before it is asked whether to give up.
        """
        options = self.options
        first = ATTEMPTS_FOR_THE_IMPOSSIBLE if options.near_miss else 1
        each_matters = len(tried) < first or any(result.holds for result in tried)
        if each_matters or self.spec.problem.raises_degree:
            return 1
        most = ATTEMPTS
        if options.attempts:
            most = min(options.attempts, FEW if count_starts(tried) < FEW else ATTEMPTS)
        return most - count_starts(tried)

    def _are_enough(self, results: list[AttemptResult]) -> bool:
        """Whether as many starts are solved as are wanted, and more of them promise little."""
        solved = [result for result in results if result.holds]
        if solved and results[0].is_exhaustive:
            return True
        if len(solved) < self.options.starts:
            return False
        are_easy = [result.is_optimal and result.iterations <= SETTINGS.easy_iterations for result in results]
        constrained = self.spec.problem.has_inequalities
        if constrained and self.spec.momentum.axes.size:
            # Each h may have a best motion of its own: several must lead to the same, or h has been tried throughout.
            values = np.sort([result.objective_value for result in solved])
            agreeing = int((values - values[0] <= AGREEMENT * values).sum())
            all_agree = agreeing == len(values) and sum(are_easy) == len(solved)
            enough = AGREEING if all_agree else AGREEING_BEST
            return agreeing >= enough or count_starts(results) >= STARTS_OF_FREE_MOMENTUM
        if are_easy[0] or len(solved) >= SETTINGS.wanted_after_failure:
            return True
        if not constrained:
            return False
        after_the_first = len(results) - results.index(solved[0])
        return any(result.is_optimal for result in results) or after_the_first > STARTS_AFTER_THE_FIRST

    def _untried(self) -> AttemptResult:
        """Return the plain motion as it is."""
        result = self.follow(self.plain_start, lambda: True)
        result.starts = 0
        return result

    @cached_property
    def impossible(self) -> list[str]:
        """Sentences about why no motion whatever meets the problem, as far as that is known."""
        reasons: list[str] = []
        if self.spec.problem.has_inequalities:
            if not self._ends_hold:
                from floatplan.planning.explanation import impossible_ends  # here, since most searches need none

                kernel_problem = self._of_start(self.plain_start)
                kernel_problem.follow(range(0), np.inf, 0, reach=self.spec.flight.central_reach)
                reasons += impossible_ends(self.spec, self.plain_start, kernel_problem.end_values.copy())
            reasons += self.spec.flight.impossibilities(self._path_is_clear)
        for reason in reasons:
            LOG.info("impossible: %s", reason)
        return reasons

    def follow(self, start: Start, stop: Stop = lambda: False, most_work: float = np.inf) -> AttemptResult:
        """Follow one start; from when it is stopped, or has done the most work, it takes what it has."""
        return self._call_kernel(start, range(1), most_work, expired=stop())

    def follow_near(self, start: Start, stop: Stop) -> AttemptResult | None:
        """Follow a motion that is nearly one to the goal; None where it leads to none."""
        return self.follow(start, stop)

    def follow_numbered(
        self,
        degrees: tuple[int, ...],
        given: Sequence[Start],
        numbers: range,
        stop: Stop,
        most_work: float = np.inf,
        asks: bool = False,
    ) -> AttemptResult | None:
        """Follow starts by number, the given ones first; None where there are not so many.

        They are followed until one holds: by the kernel as many as take a moment, else one alone. Where it ``asks``
        first, and the problem is known to have no solution, the result is the plain motion as it is, of no start.
        """
        if numbers.start < len(given):
            return self.follow(given[numbers.start], stop, most_work)
        numbers = range(numbers.start - len(given), numbers.stop - len(given))
        own = degrees == self.spec.problem.degrees
        plain = self.plain_start if own else plain_start(self.spec, degrees)
        if numbers.start and not plain.variables.size:
            return None
        expired = stop()
        before = self.work.done
        result = self._call_kernel(plain, numbers, most_work, asks=asks, expired=expired)
        if not result.starts and not self.impossible:
            result = self._call_kernel(plain, numbers, most_work, expired=expired)
        result.work = self.work.done - before
        return result

    def judge(self, start: Start, status: str) -> AttemptResult:
        """Check the attitude at landing and the constraints of a motion as it is, between the instants too.

        ``status`` is why it was stopped at; one that holds is "feasible" at least.
        """
        kernel_problem = self._of_start(start)
        kernel_problem.follow(range(0), np.inf, 0)
        result = kernel_problem.result(self.spec)
        self.work.done += result.work
        result.starts = 1
        result.status = status
        if not result.holds:
            result.status = "infeasible"
        elif status == "infeasible":
            result.status = "feasible"
        return result

    def _call_kernel(
        self, start: Start, numbers: range, most_work: float, *, asks: bool = False, expired: bool = False
    ) -> AttemptResult:
        """Follow starts by number, of which 0 is the given one, unless the first one has been followed in a batch."""
        kernel_problem = self._of_start(start)
        if not self._is_followed:
            reach = self.spec.flight.central_reach if asks else 0.0
            kernel_problem.follow(numbers, most_work, self.options.seed, reach=reach, expired=expired)
        self._is_followed = False
        result = kernel_problem.result(self.spec)
        self.work.done += result.work
        # What the kernel said before it followed starts.
        self._ends_hold |= bool(kernel_problem.attempt.pointer.ends_hold)
        self._path_is_clear |= bool(kernel_problem.attempt.pointer.path_is_clear)
        return result

    def _of_start(self, start: Start) -> KernelProblem:
        """The problem as the kernel takes it, with this start as number 0: filled anew for another one."""
        if not (self._kernel_problem and self._kernel_problem.start.x is start.x):
            self._kernel_problem = KernelProblem.of(self.spec, start)
        return self._kernel_problem


def _are_hopeless(tried: list[AttemptResult], most: int) -> bool:
    """Whether so many starts at a degree, of which none holds, are enough; few are where none has come near a plan."""
    nearest, starts = min(each.violation for each in tried), count_starts(tried)
    return nearest > 0 and (starts == most or (starts >= FEW and nearest > FAR))


def _nearest(results: list[AttemptResult]) -> list[AttemptResult]:
    """The results of least violation, each at another motion."""
    distinct: list[AttemptResult] = []
    for result in sorted(results, key=lambda result: (result.violation, result.objective_value)):
        value = result.objective_value
        if all(abs(value - other.objective_value) > EXCHANGE.same * abs(value) for other in distinct):
            distinct.append(result)
    return distinct[:RAISED]


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
        work = DEFAULT_WORK if options.budget is None else np.inf
        patience = np.inf if options.patience is None else options.patience
        return cls(min(work, patience), held_back=work - patience if patience < work else 0.0)

    def grants(self, result: AttemptResult, is_first: bool) -> bool:
        """Whether an attempt's work was still allowed; the first always is, so that there is an answer."""
        self.left -= result.work
        self.is_used_up = self.left < 0
        if result.holds and not self.is_used_up:
            self.left, self.held_back = self.left + self.held_back, 0.0
        return is_first or not self.is_used_up


def expiry(budget: float | None) -> Stop:
    """Return a function that is true once a budget of seconds, counted from now, is used up; never without one."""
    if budget is None:
        return lambda: False
    end = time.monotonic() + budget
    return lambda: time.monotonic() > end
