"""Where attempts of a search run: in this process, or in several, in the order of their numbers all the same."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeAlias

from floatplan.motion.dynamics import MomentumSet
from floatplan.optimization.nonlinear_program import Derivatives
from floatplan.planning.attempt import Attempts, Outcome
from floatplan.planning.starts import Start
from floatplan.pool.threads import one_thread
from floatplan.problem.problem import Problem

Run: TypeAlias = Callable[[tuple[int, ...], list[Start], range], Iterator[Outcome]]


def expiry(budget: float | None) -> Callable[[], bool]:
    """Return a function that is true once a budget of seconds, counted from now, is used up; never without one."""
    if budget is None:
        return lambda: False
    end = time.monotonic() + budget
    return lambda: time.monotonic() > end


@contextmanager
def runner(
    prepared: Attempts, jobs: int, budget: float | None, expired: Callable[[], bool], work_left: Callable[[], float]
) -> Iterator[Run]:
    """What follows starts at some degrees by their numbers: the given ones come first, then random ones."""

    def follow(degrees: tuple[int, ...], given: list[Start], number: int) -> Outcome | None:
        return _follow(prepared, given, number, degrees, expired, work_left())

    def run_here(degrees: tuple[int, ...], given: list[Start], numbers: range) -> Iterator[Outcome]:
        for number in numbers:
            outcome = follow(degrees, given, number)
            if outcome is None:
                return
            yield outcome

    if jobs == 1:
        yield run_here
        return
    from concurrent.futures import BrokenExecutor  # here, because most plans do without

    from floatplan.pool import processes

    ready = (prepared.problem, prepared.seed, prepared.momentum, budget, work_left())
    with processes(jobs, (__name__,), _prepare, *ready) as pool:

        def run_there(degrees: tuple[int, ...], given: list[Start], numbers: range) -> Iterator[Outcome]:
            try:
                futures = [pool.submit(_attempt, degrees, given, number) for number in numbers]
            except BrokenExecutor:  # the system has killed a process of it: this one goes on alone
                yield from run_here(degrees, given, numbers)
                return
            for number, future in zip(numbers, futures, strict=True):
                try:
                    outcome = future.result()
                except BrokenExecutor:
                    outcome = follow(degrees, given, number)
                if outcome:
                    yield outcome

        yield run_there


def _follow(
    prepared: Attempts,
    given: list[Start],
    number: int,
    degrees: tuple[int, ...],
    expired: Callable[[], bool],
    most_work: float,
) -> Outcome | None:
    """Follow a start by its number: the given ones come first; None where there are not so many."""
    known = [*given, *prepared.first_starts(degrees, max(number + 1 - len(given), 0))]
    return prepared.attempt(known[number], number, degrees, expired, most_work) if number < len(known) else None


_prepared: Attempts
_expired: Callable[[], bool]
_most_work: float


@one_thread
def _prepare(problem: Problem, seed: int, momentum: MomentumSet, budget: float | None, most_work: float) -> None:
    """Make a process ready for attempts."""
    global _prepared, _expired, _most_work
    _prepared, _expired, _most_work = Attempts(problem, seed, momentum), expiry(budget), most_work


@one_thread
def _attempt(degrees: tuple[int, ...], given: list[Start], number: int) -> Outcome | None:
    outcome = _follow(_prepared, given, number, degrees, _expired, _most_work)
    return _portable(outcome) if outcome else None


def _portable(outcome: Outcome) -> Outcome:
    """Strip an outcome of what cannot go from one process to another: its derivatives, and what its motion caches."""
    solution = outcome.solution
    motion = solution.evaluation.detail
    evaluation = replace(solution.evaluation, differentiate=_no_derivatives, detail=replace(motion))
    return replace(outcome, solution=replace(solution, evaluation=evaluation))


def _no_derivatives() -> Derivatives:
    raise AssertionError("the derivatives of an outcome stay in the process that computed them")
