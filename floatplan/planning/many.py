"""Many plans at once: batches through the compiled kernel, and what it does not solve through the search."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from floatplan.arguments import flag, many
from floatplan.arrays import BoolArray, IntArray
from floatplan.certificate.certificate import certify
from floatplan.errors import InputError
from floatplan.planning.batch import Batch, follow_batch, follow_unconstrained
from floatplan.planning.kernel_input.numbers import Numbers, goes_together, is_together, key
from floatplan.planning.kernel_problem import INFEASIBLE, STATUS
from floatplan.planning.options import JOBS, SearchOptions
from floatplan.planning.planner import found_for, planned, searched_answer
from floatplan.planning.repair import judged, proved_plan
from floatplan.planning.result import SearchedPlan, SearchResult
from floatplan.planning.search import Allowance, Search
from floatplan.planning.spec import FlightSpec
from floatplan.plans.plans import COUNTS, SOLVED, PlanEntry, Plans
from floatplan.pool import in_order, one_thread, processes
from floatplan.problem.family import Family
from floatplan.problem.file import as_problem
from floatplan.problem.problem import Problem

CHUNK, WITH_ROWS = 2048, 256  # problems of a batch, plain or with inequalities
AT_ONCE = 8  # problems that go alone, which a process is given at a time
SHARES = 4  # [-] of a batch with inequalities, that each process has, so that all end at about the same time
LONGER = "search=True searches longer"
_T = TypeVar("_T")
PATIENCE = 1 / 20  # [-] of the usual work, before a start is solved: about 0.05 s in a plane
UNSOLVED = 16  # [-] starts at a degree: 0.4 % of the rows of the studies pole and weak_motors that 40 solve take more


@dataclass(frozen=True)
class _Task:
    """Problems to answer by their indices: together, ``like`` one of them, or one by one, ``known`` ones to prove."""

    indices: list[int]
    like: int | None = None
    known: Sequence[PlanEntry] = ()


@one_thread
def plan_many(
    problems: Iterable[Problem | str | Path] | Family,
    *,
    starts: int = 1,
    jobs: int = 1,
    search: bool = False,
    prove: bool = False,
    seed: int = 0,
    attempts: int = UNSOLVED,
) -> Plans:
    """Plan many flights.

    Problems without inequalities, at a given angular momentum and with the objective "coefficients", are planned in
    batches by the compiled kernel: from the plain motion, and from up to 64 random starts where that
    fails or converges slowly; fewer where several end equally far from the goal. Of others with that objective, which
    differ in numbers alone, the plain motions are followed in batches too. What these do not solve has the search of
    :func:`floatplan.plan`, each on its own, given up after ``attempts`` starts or a twentieth of its work where none
    is solved by then; what is proved impossible is not searched for. The answer to a problem depends on that problem,
    ``starts``, ``search``, ``prove``, ``seed`` and ``attempts`` alone.

    Parameters
    ----------
    problems : sequence of Problem or of paths of problem files, or Family
        Those of a family are not made, unless one needs the search.
    starts : int
        Solved starts to choose the best from, at most 1000, as of :func:`floatplan.plan`.
    jobs : int
        Threads of the kernel, processes of the search.
    search : bool
        Whether problems that are not solved so have the whole search, which takes up to 10 s each; its bound is work,
        not a clock.
    prove : bool
        Whether to prove each plan found, and to correct it where little is missing.
    seed : int
        Of the random starts.
    attempts : int
        Unsolved starts at a degree, after which a search tries no more there, at most 300, or five where none comes
        near a plan; with ``search`` it does.

    Returns
    -------
    Plans
        A problem that is wrong is an answer too, of status "error".

    Raises
    ------
    InputError
        What is to be planned is no sequence of problems, or a number is none, or out of its range.
    """
    options = SearchOptions(seed=seed, starts=starts, attempts=attempts, near_miss=False)
    jobs = JOBS(jobs, "jobs")
    problems = problems if isinstance(problems, Family) else many(as_problem, "problems")(problems, "problems")
    search, prove = flag(search, "search"), flag(prove, "prove")
    return planned_together(problems, options, lambda index: seed, search, prove, jobs)


def planned_together(
    problems: Sequence[Problem] | Family,
    options: SearchOptions,
    seed: Callable[[int], int],
    search: bool,
    prove: bool,
    jobs: int = 1,
) -> Plans:
    """Plan many flights as :func:`plan_many` does, where a search of one has its own ``seed``, by its index."""
    plans = Plans.of(problems, *_shape(problems), options.seed)
    brief, whole = _efforts(options, search)
    batches, alone = _sorted_out(problems)
    tasks: list[_Task] = []
    for indices in batches:
        first = int(indices[0])
        if _like(problems, first).is_plain:
            alone += _plan_plain(plans, indices, options, jobs)
        else:
            size = WITH_ROWS if jobs == 1 else min(WITH_ROWS, -(-len(indices) // (SHARES * jobs)))
            tasks += [_Task(part.tolist(), first) for part in _parts(indices, size)]
    _finish(plans, [*tasks, *_alone(alone)], brief, jobs, seed)
    if search:
        missed = set(np.flatnonzero(plans.status == "not_found").tolist())
        searched = {index for task in tasks for index in task.indices}.union(alone)
        _finish(plans, _alone(missed - searched), whole, jobs, seed)
    if prove:
        solved = np.flatnonzero(np.isin(plans.status, SOLVED)).tolist()
        _finish(plans, _alone(solved, plans), whole, jobs, seed)
    return plans


def _efforts(options: SearchOptions, search: bool) -> tuple[SearchOptions, SearchOptions]:
    """How to search for what is not planned in a batch, and the whole search."""
    whole = replace(options, attempts=None)
    return whole if search else replace(options, patience=PATIENCE * Allowance.of(SearchOptions()).left), whole


def _shape(problems: Sequence[Problem] | Family) -> tuple[int, int]:
    """Most joints, and most coefficients of one; refused for flights in space."""
    asked = [problems.base] if isinstance(problems, Family) else problems
    degrees = [each.degrees for each in asked if each.robot.layout]
    return max(map(len, degrees), default=0), max((max(each, default=0) for each in degrees), default=0) + 1


def _sorted_out(problems: Sequence[Problem] | Family) -> tuple[list[IntArray], list[int]]:
    """Indices of problems that go together, batch by batch, and those of the others."""
    if isinstance(problems, Family):
        indices = np.arange(len(problems))
        return ([indices], []) if is_together(problems) and len(problems) else ([], indices.tolist())
    groups: dict[object, list[int]] = {}
    others = []
    for index, problem in enumerate(problems):
        if goes_together(problem):
            groups.setdefault(key(problem), []).append(index)
        else:
            others.append(index)
    return [np.array(group) for group in groups.values()], others


def _like(problems: Sequence[Problem] | Family, index: int) -> Problem:
    """One of those that a problem goes together with."""
    return problems.base if isinstance(problems, Family) else problems[index]


def _numbers(problems: Sequence[Problem] | Family, indices: IntArray) -> tuple[Numbers, BoolArray]:
    """What problems that go together differ in, and which (N,) of them have good numbers; of the good ones alone."""

    def numbers(some: IntArray) -> Numbers:
        if isinstance(problems, Family):
            return Numbers.of_family(problems, some)
        return Numbers.of_problems([problems[index] for index in some.tolist()])

    all_numbers = numbers(indices)
    good = ~all_numbers.doubtful()
    return numbers(indices[good]) if good.any() and not good.all() else all_numbers, good


def _plan_plain(plans: Plans, indices: IntArray, options: SearchOptions, jobs: int) -> list[int]:
    """Plan plain problems in chunks; those with doubtful numbers, which a Problem checks, are returned."""
    like, problems = _like(plans.problems, int(indices[0])), plans.problems

    def followed(chunk: IntArray) -> tuple[BoolArray, Batch | None]:
        numbers, good = _numbers(problems, chunk)
        return good, follow_unconstrained(like, numbers, options.starts, options.seed) if good.any() else None

    chunks, doubtful = _parts(indices, CHUNK), []
    with ThreadPoolExecutor(jobs) as pool:
        each = (map if jobs == 1 else pool.map)(followed, chunks)
        for chunk, (good, batch) in zip(chunks, each, strict=True):
            doubtful += chunk[~good].tolist()
            if batch:
                _keep(plans, chunk[good], batch)
    return doubtful


def _parts(indices: IntArray, size: int) -> list[IntArray]:
    return [indices[first : first + size] for first in range(0, len(indices), size)]


def _alone(indices: Iterable[int], plans: Plans | None = None) -> list[_Task]:
    """Tasks of problems that go alone, with the answers to prove."""
    parts = _parts(np.array(sorted(indices), np.int64), AT_ONCE)
    return [_Task(each.tolist(), known=[plans.answer(i) for i in each.tolist()] if plans else ()) for each in parts]


def _keep(plans: Plans, indices: IntArray, followed: Batch) -> None:
    """Take the solutions of a chunk."""
    numbers = followed.attempts.numbers
    status, started = followed.status, numbers["started"]
    solved = status != INFEASIBLE
    for code, word in STATUS.items():
        plans.status[indices[status == code]] = "not_found" if code == INFEASIBLE else word
    plans.objective[indices[solved]] = numbers["objective"][solved]
    plans.angular_momentum[indices] = followed.motions.momentum
    plans.residual[indices] = followed.residual
    _, n, columns = followed.coefficients.shape
    plans.coefficients[indices, :n, :columns] = followed.coefficients
    for name in COUNTS:
        getattr(plans, name)[indices] = numbers["started" if name == "starts" else name]
    for index, starts in zip(indices[~solved].tolist(), started[~solved].tolist(), strict=True):
        plans.messages[index] = f"No plan was found from {starts} starts; {LONGER}."


def _finish(
    plans: Plans, tasks: Sequence[_Task], options: SearchOptions, jobs: int, seed: Callable[[int], int]
) -> None:
    """PlanEntry problems in this process or several; see :func:`_answering`."""
    seeded = [(task, [seed(index) for index in task.indices]) for task in tasks]
    ready = (plans.problems, options)
    several = jobs > 1 and len(tasks) > 1
    with processes(jobs, (__name__,), _answering, *ready) if several else nullcontext() as pool:
        for task, answers in zip(tasks, in_order(pool, seeded, _answering(*ready)), strict=True):
            for index, answer in zip(task.indices, answers, strict=True):
                plans.keep(index, answer)


def _answering(
    problems: Sequence[Problem] | Family, options: SearchOptions
) -> Callable[[_Task, Sequence[int]], list[PlanEntry]]:
    """Return what answers a task, its problems with a seed each; one that is wrong has an answer too."""

    @cache
    def spec(index: int) -> FlightSpec:
        return FlightSpec(_like(problems, index))

    def made(task: _Task, seeds: Sequence[int]) -> list[PlanEntry]:
        if task.like is not None:
            return _made_together(spec(task.like), problems, options, task.indices, seeds)
        known: Sequence[PlanEntry | None] = task.known or [None] * len(seeds)
        how = [replace(options, seed=seed) for seed in seeds]
        return [_made(_made_alone, problems, *each) for each in zip(task.indices, how, known, strict=True)]

    return one_thread(made)


def _made(make: Callable[..., _T], *given: Any) -> _T | PlanEntry:
    """Return what is made, or the answer to what is wrong."""
    try:
        return make(*given)
    except InputError as error:
        return PlanEntry("error", message=str(error))


def _made_alone(
    problems: Sequence[Problem] | Family, index: int, options: SearchOptions, known: PlanEntry | None = None
) -> PlanEntry:
    problem = problems[index]
    return _proved(problem, known, options) if known else _told(found_for(problem, options))


def _made_together(
    like: FlightSpec,
    problems: Sequence[Problem] | Family,
    options: SearchOptions,
    indices: Sequence[int],
    seeds: Sequence[int],
) -> list[PlanEntry]:
    """PlanEntry problems that go together: by their plain motions where those are enough, else each by a search."""
    numbers, good = _numbers(problems, np.array(indices))
    found = follow_batch(like, numbers, Allowance.of(options).left) if good.any() else None
    enough = set(found.solved.tolist()) if found and options.starts == 1 else set()
    places = iter(range(len(indices)))

    def begin(index: int, seed: int, is_good: bool) -> PlanEntry | Search:
        seeded = replace(options, seed=seed)
        if not (is_good and found):
            return _made_alone(problems, index, seeded)
        place = next(places)
        answer = found.answer(place) if place in enough else None
        return answer or found.search(place, problems[index], seeded)

    made: list[Any] = [_made(begin, *each) for each in zip(indices, seeds, good.tolist(), strict=True)]
    for step in (Search.run, _told):  # each for all, which is quicker than one after the other
        made = [each if isinstance(each, PlanEntry) else _made(step, each) for each in made]
    return made


def _told(found: SearchResult | SearchedPlan) -> PlanEntry:
    if isinstance(found, SearchedPlan):
        return found.answer
    answer = searched_answer(found)
    if not found.ran_out_of_patience or answer.status != "not_found":
        return answer
    return replace(answer, message=f"The search ended at {answer.evaluations} evaluations; {LONGER}. {answer.message}")


def _proved(problem: Problem, answer: PlanEntry, options: SearchOptions) -> PlanEntry:
    """Prove a plan; where it is not proved, search again, which corrects what is missing or takes the next best."""
    plan = answer.plan(problem, options.seed)
    certificate = certify(plan)
    if certificate.proved:
        return replace(PlanEntry.of_plan(judged(plan, certificate), answer.status), residual=answer.residual)
    better = proved_plan(planned(problem, options))
    if better.certificate is None or (not better.certificate.proved and certificate.verdict == "undecided"):
        better = judged(plan, certificate)
    return PlanEntry.of_plan(better, better.status if better.ok else answer.status)
