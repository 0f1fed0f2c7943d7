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
from floatplan.planning.kernel_input.numbers import Numbers, is_batchable, is_batchable_family, key
from floatplan.planning.kernel_problem import Status
from floatplan.planning.options import JOBS, SearchOptions
from floatplan.planning.planner import planned, search_for, searched_numbers
from floatplan.planning.repair import judged, proved_plan
from floatplan.planning.result import SearchedPlan, SearchResult
from floatplan.planning.search import Allowance, Search
from floatplan.planning.spec import FlightSpec
from floatplan.plans.plans import COUNTS, SOLVED, PlanEntry, Plans
from floatplan.pool import in_order, one_thread, processes
from floatplan.problem.family import Family
from floatplan.problem.file import as_problem
from floatplan.problem.problem import Problem

CHUNK = 2048  # [-] problems of a batch without inequalities
WITH_ROWS = 256  # [-] the same with inequalities
LONGER = "search=True searches longer"
_T = TypeVar("_T")
PATIENCE = 1 / 20  # [-] of the usual work, before a start is solved: about 0.05 s in a plane
UNSOLVED = 16  # [-] starts at a degree: 0.4 % of the rows of the studies pole and weak_motors that 40 solve take more


@dataclass(frozen=True)
class _Task:
    """Problems to plan, by their indices: in a batch, ``like`` one of them, or one by one; ``solutions`` to prove."""

    indices: list[int]
    like: int | None = None
    solutions: Sequence[PlanEntry] = ()


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
    batches by the compiled kernel: from the nominal motion, and from up to 64 random starts where that
    fails or converges slowly; fewer where several end equally far from the goal. Of others with that objective, which
    differ in numbers alone, batches begin with the nominal motions too. What these do not solve has the search of
    :func:`floatplan.plan`, each on its own, given up after ``attempts`` starts or a twentieth of its work where none
    is solved by then; what is proved impossible is not searched for. The plan of a problem depends on that problem,
    ``starts``, ``search``, ``prove``, ``seed`` and ``attempts`` only.

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
        Whether to prove the plans, and to correct those where little is missing.
    seed : int
        Of the random starts.
    attempts : int
        Unsolved starts at a degree, after which a search tries no more there, at most 300, or five where none comes
        near a plan; with ``search`` it does.

    Returns
    -------
    Plans
        A problem that is wrong has a row too, of status "error".

    Raises
    ------
    InputError
        What is to be planned is no sequence of problems, or a number is none, or out of its range.
    """
    options = SearchOptions(seed=seed, starts=starts, attempts=attempts, near_miss=False)
    jobs = JOBS(jobs, "jobs")
    problems = problems if isinstance(problems, Family) else many(as_problem, "problems")(problems, "problems")
    search = flag(search, "search")
    prove = flag(prove, "prove")
    return plan_batches(problems, options, lambda index: seed, search, prove, jobs)


def plan_batches(
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
    batches, single = _sorted_out(problems)
    tasks: list[_Task] = []
    for indices in batches:
        first = int(indices[0])
        if _like(problems, first).is_plain:
            single += _plan_unconstrained(plans, indices, options, jobs)
        else:
            size = WITH_ROWS
            if jobs > 1:  # four tasks for each process, so that all end at about the same time
                size = min(WITH_ROWS, -(-len(indices) // (4 * jobs)))
            tasks += [_Task(chunk.tolist(), first) for chunk in _chunks(indices, size)]
    _finish(plans, [*tasks, *_single(single)], brief, jobs, seed)
    if search:
        unsolved = set(np.flatnonzero(plans.status == "not_found").tolist())
        searched = set(single).union(*(task.indices for task in tasks))
        _finish(plans, _single(unsolved - searched), whole, jobs, seed)
    if prove:
        solved = np.flatnonzero(np.isin(plans.status, SOLVED)).tolist()
        _finish(plans, _single(solved, plans), whole, jobs, seed)
    return plans


def _efforts(options: SearchOptions, search: bool) -> tuple[SearchOptions, SearchOptions]:
    """How to search for what is not planned in a batch, and the whole search."""
    whole = replace(options, attempts=None)
    return whole if search else replace(options, patience=PATIENCE * Allowance.of(SearchOptions()).left), whole


def _shape(problems: Sequence[Problem] | Family) -> tuple[int, int]:
    """Most joints, and most coefficients of one; refused for flights in space."""
    joints = degree = 0
    for problem in [problems.base] if isinstance(problems, Family) else problems:
        if problem.robot.layout:
            joints = max(joints, len(problem.degrees))
            degree = max(degree, *problem.degrees, 0)
    return joints, degree + 1


def _sorted_out(problems: Sequence[Problem] | Family) -> tuple[list[IntArray], list[int]]:
    """Indices of the problems of batches, batch by batch, and those of the others."""
    if isinstance(problems, Family):
        indices = np.arange(len(problems))
        return ([indices], []) if is_batchable_family(problems) and len(problems) else ([], indices.tolist())
    groups: dict[object, list[int]] = {}
    others = []
    for index, problem in enumerate(problems):
        if is_batchable(problem):
            groups.setdefault(key(problem), []).append(index)
        else:
            others.append(index)
    return [np.array(group) for group in groups.values()], others


def _like(problems: Sequence[Problem] | Family, index: int) -> Problem:
    """One of the problems of a batch, of which that of an index is one."""
    return problems.base if isinstance(problems, Family) else problems[index]


def _numbers(problems: Sequence[Problem] | Family, indices: IntArray) -> tuple[Numbers, BoolArray]:
    """What problems of a batch differ in, and which (N,) of them have good numbers; numbers of the good ones only."""

    def numbers(some: IntArray) -> Numbers:
        if isinstance(problems, Family):
            return Numbers.of_family(problems, some)
        return Numbers.of_problems([problems[index] for index in some.tolist()])

    all_numbers = numbers(indices)
    good = ~all_numbers.doubtful()
    return numbers(indices[good]) if good.any() and not good.all() else all_numbers, good


def _plan_unconstrained(plans: Plans, indices: IntArray, options: SearchOptions, jobs: int) -> list[int]:
    """Plan problems without inequalities in chunks; returned are those with doubtful numbers, for a Problem."""
    like = _like(plans.problems, int(indices[0]))
    problems = plans.problems

    def solve(chunk: IntArray) -> tuple[BoolArray, Batch | None]:
        numbers, good = _numbers(problems, chunk)
        return good, follow_unconstrained(like, numbers, options.starts, options.seed) if good.any() else None

    chunks = _chunks(indices, CHUNK)
    doubtful = []
    with ThreadPoolExecutor(jobs) as pool:
        results = (map if jobs == 1 else pool.map)(solve, chunks)
        for chunk, (good, batch) in zip(chunks, results, strict=True):
            doubtful += chunk[~good].tolist()
            if batch:
                _take(plans, chunk[good], batch)
    return doubtful


def _chunks(indices: IntArray, size: int) -> list[IntArray]:
    return [indices[first : first + size] for first in range(0, len(indices), size)]


def _single(indices: Iterable[int], plans: Plans | None = None) -> list[_Task]:
    """Tasks of problems with a search of their own, with the solutions to prove."""
    tasks = []
    for chunk in _chunks(np.array(sorted(indices), np.int64), 8):  # so many a process gets at a time
        numbers = chunk.tolist()
        tasks.append(_Task(numbers, solutions=[plans.answer(index) for index in numbers] if plans else ()))
    return tasks


def _take(plans: Plans, indices: IntArray, batch: Batch) -> None:
    """Take the solutions of a chunk."""
    numbers = batch.searches.numbers
    status = batch.status
    started = numbers["started"]
    solved = status != Status["infeasible"]
    plans.status[indices[~solved]] = "not_found"
    for code in ("feasible", "optimal"):
        plans.status[indices[status == Status[code]]] = code
    plans.objective[indices[solved]] = numbers["objective"][solved]
    plans.angular_momentum[indices] = batch.motions.momentum
    plans.residual[indices] = batch.residual
    _, n, columns = batch.coefficients.shape
    plans.coefficients[indices, :n, :columns] = batch.coefficients
    for name in COUNTS:
        getattr(plans, name)[indices] = numbers["started" if name == "starts" else name]
    for index, starts in zip(indices[~solved].tolist(), started[~solved].tolist(), strict=True):
        plans.messages[index] = f"No plan was found from {starts} starts; {LONGER}."


def _finish(
    plans: Plans, tasks: Sequence[_Task], options: SearchOptions, jobs: int, seed: Callable[[int], int]
) -> None:
    """Plan problems in this process or several; see :func:`_planner`."""
    seeded = [(task, list(map(seed, task.indices))) for task in tasks]
    shared = (plans.problems, options)
    several = jobs > 1 and len(tasks) > 1
    with processes(jobs, (__name__,), _planner, *shared) if several else nullcontext() as pool:
        for task, answers in zip(tasks, in_order(pool, seeded, _planner(*shared)), strict=True):
            for index, answer in zip(task.indices, answers, strict=True):
                plans.keep(index, answer)


def _planner(
    problems: Sequence[Problem] | Family, options: SearchOptions
) -> Callable[[_Task, Sequence[int]], list[PlanEntry]]:
    """Return the function that plans the problems of a task, every one with a seed; a wrong one has a row too."""

    @cache
    def spec(index: int) -> FlightSpec:
        return FlightSpec(_like(problems, index))

    def rows(task: _Task, seeds: Sequence[int]) -> list[PlanEntry]:
        if task.like is not None:
            return _batch_rows(spec(task.like), problems, options, task.indices, seeds)
        solutions: Sequence[PlanEntry | None] = task.solutions or [None] * len(seeds)
        made = []
        for index, seed, solution in zip(task.indices, seeds, solutions, strict=True):
            made.append(_or_error(_row, problems, index, replace(options, seed=seed), solution))
        return made

    return one_thread(rows)


def _or_error(make: Callable[..., _T], *arguments: Any) -> _T | PlanEntry:
    """Return what a function makes of arguments, or the row of an error."""
    try:
        return make(*arguments)
    except InputError as error:
        return PlanEntry("error", message=str(error))


def _row(
    problems: Sequence[Problem] | Family, index: int, options: SearchOptions, solution: PlanEntry | None = None
) -> PlanEntry:
    problem = problems[index]
    return _proved(problem, solution, options) if solution else _in_numbers(search_for(problem, options))


def _batch_rows(
    like: FlightSpec,
    problems: Sequence[Problem] | Family,
    options: SearchOptions,
    indices: Sequence[int],
    seeds: Sequence[int],
) -> list[PlanEntry]:
    """Plan the problems of a batch: by their nominal motions where those are enough, else by a search of their own."""
    numbers, good = _numbers(problems, np.array(indices))
    batch = follow_batch(like, numbers, Allowance.of(options).left) if good.any() else None
    enough = set(batch.solved.tolist()) if batch and options.starts == 1 else set()
    positions = iter(range(len(indices)))  # in the batch, of those with good numbers

    def begin(index: int, seed: int, is_good: bool) -> PlanEntry | Search:
        seeded = replace(options, seed=seed)
        if not (is_good and batch):
            return _row(problems, index, seeded)
        position = next(positions)
        solution = batch.answer(position) if position in enough else None
        return solution or batch.search(position, problems[index], seeded)

    rows: list[Any] = [_or_error(begin, *task) for task in zip(indices, seeds, good.tolist(), strict=True)]
    for step in (Search.run, _in_numbers):  # one step of all, which is quicker than all steps of one
        rows = [row if isinstance(row, PlanEntry) else _or_error(step, row) for row in rows]
    return rows


def _in_numbers(result: SearchResult | SearchedPlan) -> PlanEntry:
    if isinstance(result, SearchedPlan):
        return result.answer
    row = searched_numbers(result)
    if not result.ran_out_of_patience or row.status != "not_found":
        return row
    return replace(row, message=f"The search ended at {row.evaluations} evaluations; {LONGER}. {row.message}")


def _proved(problem: Problem, solution: PlanEntry, options: SearchOptions) -> PlanEntry:
    """Prove a plan; where it is not proved, search again, which corrects what is missing or takes the next best."""
    plan = solution.plan(problem, options.seed)
    certificate = certify(plan)
    if certificate.proved:
        return replace(PlanEntry.of_plan(judged(plan, certificate), solution.status), residual=solution.residual)
    better = proved_plan(planned(problem, options))
    if better.certificate is None or (not better.certificate.proved and certificate.verdict == "undecided"):
        better = judged(plan, certificate)
    return PlanEntry.of_plan(better, better.status if better.ok else solution.status)
