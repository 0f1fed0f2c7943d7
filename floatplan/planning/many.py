"""Many plans at once: batches through the compiled kernel, and what it does not solve through the search."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from floatplan.arguments import flag, many
from floatplan.arrays import IntArray
from floatplan.kernel import rows as plain
from floatplan.kernel.batch import FEASIBLE, INFEASIBLE, MOST_STARTS, OPTIMAL, Answers, Search
from floatplan.planning.one_of_many import LONGER, Effort, Task, answers
from floatplan.planning.search import SearchOptions
from floatplan.planning.work import DEFAULT_WORK
from floatplan.plans.plans import SOLVED, Plans
from floatplan.pool.threads import one_thread
from floatplan.problem.family import Family
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem

CHUNK = 2048  # problems of a batch
WORDS = {INFEASIBLE: "not_found", FEASIBLE: "feasible", OPTIMAL: "optimal"}
NOT_FOUND = f"No plan was found from {{}} starts; {LONGER}."
PATIENCE = DEFAULT_WORK / 20  # [instants of one body] before a start is solved: about 0.4 s


@one_thread
def plan_many(
    problems: Iterable[Problem | str | Path] | Family,
    *,
    starts: int = 1,
    jobs: int = 1,
    search: bool = False,
    prove: bool = False,
    seed: int = 0,
) -> Plans:
    """Plan many flights.

    Problems without inequalities, at a given angular momentum and with the objective "coefficients", are planned in
    batches by the compiled kernel: from the plain motion, and from up to 64 random starts where that
    fails or converges slowly; fewer where several end equally far from the goal. All others have the search of
    :func:`floatplan.plan`, each on its own, given up after a twentieth of its work where no start is solved by then.
    The answer to a problem depends on that problem, ``starts``, ``search``, ``prove`` and ``seed`` alone.

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

    Returns
    -------
    Plans
        A problem that is wrong is an answer too, of status "error".

    Raises
    ------
    InputError
        What is to be planned is no sequence of problems, or a number is none, or out of its range.
    """
    options = SearchOptions(seed=seed, starts=starts, jobs=jobs)
    search, prove = flag(search, "search"), flag(prove, "prove")
    problems = problems if isinstance(problems, Family) else many(given_problem, "problems")(problems, "problems")
    plans = Plans.of(problems, *_shape(problems), seed)
    whole, few = Effort(seed, starts), Effort(seed, starts, _most_starts(options))
    brief = whole if search else Effort(seed, starts, patience=PATIENCE)
    batches, others = _sorted_out(problems)
    tasks = [Task(index, brief) for index in others]
    for batch in batches:
        doubtful = _plan_batch(plans, batch, options)
        _finish(plans, [Task(index, few) for index in doubtful], jobs)
    _finish(plans, tasks, jobs)
    if search:
        searched = {task.index for task in tasks}
        missed = np.flatnonzero(plans.status == "not_found").tolist()
        _finish(plans, [Task(index, whole) for index in missed if index not in searched], jobs)
    if prove:
        found = np.flatnonzero(np.isin(plans.status, SOLVED)).tolist()
        _finish(plans, [Task(index, whole, plans.answer(index)) for index in found], jobs)
    return plans


def _most_starts(options: SearchOptions) -> int:
    return MOST_STARTS + options.starts - 1


def _shape(problems: Sequence[Problem] | Family) -> tuple[int, int]:
    """Most joints, and most coefficients of one."""
    degrees = [problems.base.degrees] if isinstance(problems, Family) else [each.degrees for each in problems]
    return max(map(len, degrees), default=0), max((max(each, default=0) for each in degrees), default=0) + 1


def _finish(plans: Plans, tasks: Sequence[Task], jobs: int) -> None:
    """Answer problems one by one."""
    for index, answer in answers(plans.problems, tasks, jobs):
        plans.keep(index, answer)


@dataclass(frozen=True, eq=False)
class _Batch:
    """Plain problems of one robot, joint ranges and degrees: their indices (M,) among all, and the numbers of some."""

    indices: IntArray
    like: Problem
    numbers: Callable[[IntArray], plain.Numbers]


def _sorted_out(problems: Sequence[Problem] | Family) -> tuple[list[_Batch], list[int]]:
    """Batches of plain problems, and the indices of the others."""
    if isinstance(problems, Family):
        indices = np.arange(len(problems))
        if not (plain.is_plain_family(problems) and len(problems)):
            return [], indices.tolist()
        return [_Batch(indices, problems.base, lambda some: plain.Numbers.of_family(problems, some))], []
    groups: dict[object, list[int]] = {}
    others = []
    for index, problem in enumerate(problems):
        if plain.is_plain(problem):
            groups.setdefault(plain.key(problem), []).append(index)
        else:
            others.append(index)

    def numbers(some: IntArray) -> plain.Numbers:
        return plain.Numbers.of_problems([problems[index] for index in some.tolist()])

    return [_Batch(np.array(group), problems[group[0]], numbers) for group in groups.values()], others


def _plan_batch(plans: Plans, batch: _Batch, options: SearchOptions) -> list[int]:
    """Plan a batch in chunks; indices of the problems whose numbers may be bad are returned, not planned."""
    solver = plain.solver(batch.like, batch.like.degrees)
    search = Search(starts=options.starts, most_starts=_most_starts(options), seed=options.seed)

    def planned(chunk: IntArray) -> tuple[IntArray, plain.Numbers, Answers, list[int]]:
        numbers = batch.numbers(chunk)
        doubtful = numbers.doubtful()
        if doubtful.any():
            good = np.flatnonzero(~doubtful)
            numbers = numbers.some(good)
            return chunk[good], numbers, solver.plan(numbers.rows(), search), chunk[doubtful].tolist()
        return chunk, numbers, solver.plan(numbers.rows(), search), []

    chunks = [batch.indices[first : first + CHUNK] for first in range(0, len(batch.indices), CHUNK)]
    doubtful: list[int] = []
    with ThreadPoolExecutor(options.jobs) as pool:
        found_in_order = map(planned, chunks) if options.jobs == 1 else pool.map(planned, chunks)
        for indices, numbers, found, doubted in found_in_order:
            doubtful += doubted
            _keep(plans, indices, numbers, found)
    return doubtful


def _keep(plans: Plans, indices: IntArray, numbers: plain.Numbers, found: Answers) -> None:
    """Take the answers of a chunk."""
    for code, word in WORDS.items():
        plans.status[indices[found.status == code]] = word
    solved = found.status != INFEASIBLE
    plans.objective[indices[solved]] = found.objective[solved]
    plans.angular_momentum[indices] = numbers.angular_momentum()
    plans.residual[indices] = found.residual
    _, n, columns = found.coefficients.shape
    plans.coefficients[indices, :n, :columns] = found.coefficients
    for name in ("evaluations", "iterations", "starts", "solved"):
        getattr(plans, name)[indices] = getattr(found, name)
    failed = zip(indices[~solved].tolist(), found.starts[~solved].tolist(), strict=True)
    plans.messages.update({index: NOT_FOUND.format(starts) for index, starts in failed})
