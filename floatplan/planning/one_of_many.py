"""One of many problems through the whole search, in this process or in others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, replace

from floatplan.certificate.certificate import certify
from floatplan.errors import InputError
from floatplan.planning.planned import planned
from floatplan.planning.repair import judged, proved_plan
from floatplan.planning.search import SearchOptions
from floatplan.plans.plans import Answer
from floatplan.pool import processes
from floatplan.pool.threads import one_thread
from floatplan.problem.problem import Problem

AT_ONCE = 8  # problems that a process is given at a time
LONGER = "search=True searches longer"


@dataclass(frozen=True)
class Effort:
    """How hard to try: seed and solved starts as of :func:`floatplan.plan`.

    Most starts and patience are the usual where they are None.
    """

    seed: int
    starts: int
    attempts: int | None = None
    patience: float | None = None


@dataclass(frozen=True)
class Task:
    """A problem by its index, and the plan to prove; without one, it is searched for."""

    index: int
    effort: Effort
    found: Answer | None = None


def answered(problems: Sequence[Problem], task: Task) -> Answer:
    """Answer one problem; one that is wrong has an answer too."""
    try:
        problem = problems[task.index]
        if task.found:
            return _proved(problem, task.found, task.effort)
        effort = task.effort
        found = planned(problem, SearchOptions(effort.seed, effort.starts, patience=effort.patience), effort.attempts)
    except InputError as error:
        return Answer("error", message=str(error))
    plan = found.plan
    answer = Answer.of_plan(plan, plan.status if plan.ok else "impossible" if found.is_impossible else "not_found")
    if not found.gave_up or answer.status != "not_found":
        return answer
    return replace(answer, message=f"The search ended at {answer.evaluations} evaluations; {LONGER}. {answer.message}")


def _proved(problem: Problem, found: Answer, effort: Effort) -> Answer:
    """Prove a plan; where it is not proved, search again, which corrects what is missing or takes the next best."""
    plan = found.plan(problem, effort.seed)
    certificate = certify(plan)
    if certificate.proved:
        plan = judged(plan, certificate)
        return replace(Answer.of_plan(plan, found.status), residual=found.residual)
    better = proved_plan(planned(problem, SearchOptions(effort.seed, effort.starts)))
    if better.certificate is None or (not better.certificate.proved and certificate.verdict == "undecided"):
        better = judged(plan, certificate)
    return Answer.of_plan(better, better.status if better.ok else found.status)


_problems: Sequence[Problem]


def _receive(problems: Sequence[Problem]) -> None:
    """Make a process ready."""
    global _problems
    _problems = problems


@one_thread
def _answer(tasks: Sequence[Task]) -> list[Answer]:
    return [answered(_problems, task) for task in tasks]


def answers(problems: Sequence[Problem], tasks: Sequence[Task], jobs: int) -> Iterator[tuple[int, Answer]]:
    """Yield the index and the answer of each task, in their order, from this process or several."""
    groups = [tasks[first : first + AT_ONCE] for first in range(0, len(tasks), AT_ONCE)]
    if jobs == 1 or len(tasks) < 2:
        yield from ((task.index, answered(problems, task)) for task in tasks)
        return
    with processes(jobs, (__name__,), _receive, problems) as pool:
        futures = [pool.submit(_answer, group) for group in groups]
        for group, future in zip(groups, futures, strict=True):
            try:
                found = future.result()
            except BrokenExecutor:  # the system has killed a process of it: this one goes on alone
                found = [answered(problems, task) for task in group]
            yield from ((task.index, answer) for task, answer in zip(group, found, strict=True))
