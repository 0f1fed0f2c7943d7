"""The search for a motion, from one start after the other, at rising degrees; the best motion is the result.

Where a start leads depends on the problem, the degrees, the seed and its number only: the number of required solutions
does not change it. More of them make the search longer, so that its best is never worse. Unless a budget of
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
from floatplan.planning.spec import FlightSpec, nominal_start, spec_of
from floatplan.planning.variables import Start
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
Stop: TypeAlias = Callable[[], bool]
DEFAULT_WORK = 6e7  # [instants of one body] of a search whose budget is left out: 1 to 2 s
MOST_ATTEMPTS = 10**6  # [-] at all degrees
ANNOUNCED_EVERY = 1.0  # [s] words about the progress


@dataclass(frozen=True)
class SearchRules:
    """When a search ends, and what it tries."""

    starts_of_the_impossible: int = 2  # [-] where no motion can meet the problem
    starts_before_raising: int = 4  # [-] at a degree, where the degree may be raised
    raised: int = 2  # [-] nearest motions of one degree that are starts at the next
    degree_step: int = 2  # [-]
    highest_degree: int = 13  # [-] that is raised to
    starts_of_free_momentum: int = 1 + 2 * len(MOMENTUM_FRACTIONS)  # [-] where h is free and solutions do not agree
    agreeing: int = 2  # [-] easy solutions that are the same motion, where h is free: with no other it is the best
    agreeing_best: int = 3  # [-] of the best among others
    agreement: float = 1e-5  # [-] relative difference of their objectives
    few: int = 5  # [-] starts at a degree, of which one comes near wherever one of at most 16 holds
    far: float = 1.0  # [-] of a row's scale, or [rad]: a larger violation is not near
    starts_after_the_first: int = 1  # [-] with constraints: tried after one that is solved but not optimal


RULES = SearchRules()


class Search:
    """A search for a motion of a problem.

    Attributes
    ----------
    spec : FlightSpec
        The problem; a ``spec`` takes its place among the arguments.
    options : SearchOptions
    batched : KernelProblem, optional
        The problem with the structs of a batch, in which the kernel has tried starts of it: its result is the first.
    nominal_start : Start
        The nominal motion of the problem's own degrees.
    work : Work
        That was done.
    """

    def __init__(
        self,
        problem: Problem,
        options: SearchOptions | None = None,
        spec: FlightSpec | None = None,
        batched: KernelProblem | None = None,
    ) -> None:
        self.spec = spec or spec_of(problem)
        self.options = options or SearchOptions()
        self.work = Work()
        self._ends_hold = False  # as far as the kernel has said
        self._path_is_clear = False
        self._kernel_problem = batched
        self._has_result = batched is not None  # which has not been read yet
        self.nominal_start = batched.start if batched else nominal_start(self.spec, self.spec.problem.degrees)

    def run(self, most_starts: int = MOST_ATTEMPTS) -> SearchResult:
        """Follow starts until so many of them are solved, the budget is used up, or no start is left.

        The budget is of seconds, or of the default work where it is None. Where the first start fails and the problem
        is proved to have no solution, at most a near miss is of use. Of the starts of one call of the kernel the best
        is in the results. Ctrl-C ends the search with the best motion so far; the nominal one where there is none.
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
                    solved = sum(result.solved for result in results if result.holds)
                    tried = f"{count_starts(results)} starts tried, {solved} solved"
                    options.progress(f"{tried}, degree {max(result.variables.degrees)}")
                if self._are_enough(results) or expired():
                    break
                tried_enough = not options.near_miss or len(results) >= RULES.starts_of_the_impossible
                if tried_enough and not results[0].holds and self.impossible:
                    if options.near_miss:
                        break
                    untried = self._untried() if results[0].starts else results[0]
                    return SearchResult(self.spec, options.seed, [untried], self.impossible)
        except KeyboardInterrupt:
            interrupted = True
        if not results:
            results.append(self._untried())
            results[0].starts = int(interrupted)  # the one that was interrupted
        return SearchResult(
            spec=self.spec,
            seed=options.seed,
            results=results,
            impossible=[] if any(result.holds for result in results) else self.impossible,
            ran_out_of_time=allowance.is_used_up or expired(),
            ran_out_of_patience=allowance.gave_up or (allowance.is_used_up and allowance.reserve > 0),
            interrupted=interrupted,
        )

    def _results(self, expired: Stop, allowance: Allowance, most_starts: int) -> Iterator[AttemptResult]:
        """Yield results of the attempts, in their order; of so many starts at most.

        The nearest motions of one degree are the first starts of the next. A call that needs more work than is left
        does not count: how far it came would depend on what was done before.
        """
        options = self.options
        tried: list[AttemptResult] = []
        is_first = True
        own = self.spec.problem.degrees
        stages = [own]
        if self.spec.problem.raises_degree:
            rising = range(own[0] + RULES.degree_step, RULES.highest_degree + 1, RULES.degree_step)
            stages += [(degree,) * len(own) for degree in rising]
        for degrees in stages:
            nearest = _nearest(tried) if tried else []
            raised = [self.spec.raised(result.variables, result.x, degrees) for result in nearest]
            raised[:1] = [replace(start, at_once=True) for start in raised[:1]]
            tried = []
            number = 0
            last = min(ATTEMPTS if degrees == stages[-1] else RULES.starts_before_raising, most_starts)
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

        One, as long as it matters where every one ends: it may be the best, or tell that the problem is impossible, or
        its end be raised to the next degree. Else as many as are left before the search may be given up.
        """
        options = self.options
        first = RULES.starts_of_the_impossible if options.near_miss else 1
        all_matter = len(tried) < first or any(result.holds for result in tried)
        if all_matter or self.spec.problem.raises_degree:
            return 1
        most = ATTEMPTS
        if options.attempts:
            most = min(options.attempts, RULES.few if count_starts(tried) < RULES.few else ATTEMPTS)
        return most - count_starts(tried)

    def _are_enough(self, results: list[AttemptResult]) -> bool:
        """Whether as many starts are solved as are required, and more of them promise little."""
        solved = [result for result in results if result.holds]
        if solved and results[0].is_exhaustive:
            return True
        if len(solved) < self.options.starts:
            return False
        are_easy = [result.is_optimal and result.iterations <= SETTINGS.easy_iterations for result in results]
        constrained = self.spec.problem.has_inequalities
        if constrained and self.spec.momentum.axes.size:
            # Every h may have a best motion of its own: several must lead to the same, or h has been tried throughout.
            values = np.sort([result.objective_value for result in solved])
            agreeing = int((values - values[0] <= RULES.agreement * values).sum())
            all_agree = agreeing == len(values) and sum(are_easy) == len(solved)
            enough = RULES.agreeing if all_agree else RULES.agreeing_best
            return agreeing >= enough or count_starts(results) >= RULES.starts_of_free_momentum
        if are_easy[0] or len(solved) >= SETTINGS.wanted_after_failure:
            return True
        if not constrained:
            return False
        after_the_first = len(results) - results.index(solved[0])
        return any(result.is_optimal for result in results) or after_the_first > RULES.starts_after_the_first

    def _untried(self) -> AttemptResult:
        """Return the nominal motion as it is."""
        result = self.follow(self.nominal_start, lambda: True)
        result.starts = 0
        return result

    @cached_property
    def impossible(self) -> list[str]:
        """Sentences about why no motion whatever meets the problem, as far as that is proved."""
        reasons: list[str] = []
        if self.spec.problem.has_inequalities:
            if not self._ends_hold:
                from floatplan.planning.explanation import impossible_ends  # here, since most searches need none

                kernel_problem = self._of_start(self.nominal_start)
                kernel_problem.follow(range(0), np.inf, 0, reach=self.spec.flight.central_reach)
                reasons += impossible_ends(self.spec, self.nominal_start, kernel_problem.end_values.copy())
            reasons += self.spec.flight.impossibilities(self._path_is_clear)
        for reason in reasons:
            LOG.info("impossible: %s", reason)
        return reasons

    def follow(self, start: Start, stop: Stop = lambda: False, most_work: float = np.inf) -> AttemptResult:
        """Follow one start; from when it is stopped, or has done the most work, it takes what it has."""
        return self._call_kernel(start, range(1), most_work, expired=stop())

    def follow_near(self, start: Start, stop: Stop) -> AttemptResult | None:
        """Follow a motion that nearly meets the problem; None where, in space, it cannot be integrated."""
        return self.follow(start, stop)

    def follow_numbered(
        self,
        degrees: tuple[int, ...],
        first_starts: Sequence[Start],
        numbers: range,
        stop: Stop,
        most_work: float = np.inf,
        examines: bool = False,
    ) -> AttemptResult | None:
        """Follow starts by number, the ``first_starts`` before others; None where there are not so many.

        The kernel goes on until one holds, or as many as take a moment. Where it ``examines`` the problem first, and
        that is proved to have no solution, the result is the nominal motion as it is, of no start.
        """
        if numbers.start < len(first_starts):
            return self.follow(first_starts[numbers.start], stop, most_work)
        numbers = range(numbers.start - len(first_starts), numbers.stop - len(first_starts))
        own = degrees == self.spec.problem.degrees
        nominal = self.nominal_start if own else nominal_start(self.spec, degrees)
        if numbers.start and not nominal.variables.size:
            return None
        expired = stop()
        before = self.work.done
        result = self._call_kernel(nominal, numbers, most_work, examines=examines, expired=expired)
        if not result.starts and not self.impossible:
            result = self._call_kernel(nominal, numbers, most_work, expired=expired)
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
        self, start: Start, numbers: range, most_work: float, *, examines: bool = False, expired: bool = False
    ) -> AttemptResult:
        """Follow starts by number, of which 0 is this one, unless the result of a batch is at hand."""
        kernel_problem = self._of_start(start)
        if not self._has_result:
            reach = self.spec.flight.central_reach if examines else 0.0
            kernel_problem.follow(numbers, most_work, self.options.seed, reach=reach, expired=expired)
        self._has_result = False
        result = kernel_problem.result(self.spec)
        self.work.done += result.work
        # What the kernel proved before the first start.
        self._ends_hold |= bool(kernel_problem.search.pointer.ends_hold)
        self._path_is_clear |= bool(kernel_problem.search.pointer.path_is_clear)
        return result

    def _of_start(self, start: Start) -> KernelProblem:
        """The problem as the kernel takes it, with this start as number 0: filled anew for another one."""
        if not (self._kernel_problem and self._kernel_problem.start.x is start.x):
            self._kernel_problem = KernelProblem.of(self.spec, start)
        return self._kernel_problem


def _are_hopeless(tried: list[AttemptResult], most: int) -> bool:
    """Whether so many starts at a degree, of which none holds, are enough; few are where none has come near a plan."""
    nearest = min(result.violation for result in tried)
    starts = count_starts(tried)
    return nearest > 0 and (starts == most or (starts >= RULES.few and nearest > RULES.far))


def _nearest(results: list[AttemptResult]) -> list[AttemptResult]:
    """The results of least violation, all at different motions."""
    distinct: list[AttemptResult] = []
    for result in sorted(results, key=lambda result: (result.violation, result.objective_value)):
        value = result.objective_value
        if all(abs(value - other.objective_value) > EXCHANGE.same * abs(value) for other in distinct):
            distinct.append(result)
    return distinct[: RULES.raised]


@dataclass
class Allowance:
    """Work that all calls of a search may do, counted in their order; the ``reserve`` once a start is solved.

    ``gave_up`` says that at the last degree too few starts were solved.
    """

    left: float
    reserve: float = 0.0
    is_used_up: bool = False
    gave_up: bool = False

    @classmethod
    def of(cls, options: SearchOptions) -> Allowance:
        """As the options of a search say."""
        work = DEFAULT_WORK if options.budget is None else np.inf
        patience = np.inf if options.patience is None else options.patience
        return cls(min(work, patience), reserve=work - patience if patience < work else 0.0)

    def grants(self, result: AttemptResult, is_first: bool) -> bool:
        """Whether the work of a call was still allowed; that of the first always is, so that there is a result."""
        self.left -= result.work
        self.is_used_up = self.left < 0
        if result.holds and not self.is_used_up:
            self.left = self.left + self.reserve
            self.reserve = 0.0
        return is_first or not self.is_used_up


def expiry(budget: float | None) -> Stop:
    """Return a function that is true once a budget of seconds, counted from now, is used up; never without one."""
    if budget is None:
        return lambda: False
    end = time.monotonic() + budget
    return lambda: time.monotonic() > end
