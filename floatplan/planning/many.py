"""Many plans at once: batches through the compiled kernel, and what it does not solve through the search."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np

from floatplan.arguments import flag, many
from floatplan.arrays import IntArray
from floatplan.certificate.certificate import certify
from floatplan.compiled import batch as plain
from floatplan.compiled.batch import INFEASIBLE, MOST_STARTS, STATUS, Answers, Search
from floatplan.errors import InputError
from floatplan.planning.planned import answered, planned
from floatplan.planning.repair import judged, proved_plan
from floatplan.planning.search import SearchOptions
from floatplan.plans.plans import COUNTS, SOLVED, Answer, Plans
from floatplan.pool import in_order, one_thread, processes
from floatplan.problem.family import Family
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem

CHUNK = 2048  # problems of a batch
AT_ONCE = 8  # problems that a process is given at a time
LONGER = "search=True searches longer"
# Plain problems of one robot, joint ranges and degrees: their indices (M,) among all, one of them, the numbers of some.
_Batch: TypeAlias = tuple[IntArray, Problem, Callable[[IntArray], plain.Numbers]]
PATIENCE = 1 / 20  # [-] of the usual work, before a start is solved: about 0.05 s in a plane
UNSOLVED = 16  # [-] starts at a degree: no row of the studies pole and weak_motors that is solved takes more


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
    fails or converges slowly; fewer where several end equally far from the goal. All others have the search of
    :func:`floatplan.plan`, each on its own, given up after ``attempts`` starts or a twentieth of its work where none is
    solved by then; what is proved impossible is not searched for. The answer to a problem depends on that problem,
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
        Unsolved starts at a degree, after which a search tries no more there, at most 300; with ``search`` it does.

    Returns
    -------
    Plans
        A problem that is wrong is an answer too, of status "error".

    Raises
    ------
    InputError
        What is to be planned is no sequence of problems, or a number is none, or out of its range.
    """
    options = SearchOptions(seed=seed, starts=starts, jobs=jobs, attempts=attempts, near_miss=False)
    search, prove = flag(search, "search"), flag(prove, "prove")
    problems = problems if isinstance(problems, Family) else many(given_problem, "problems")(problems, "problems")
    plans = Plans.of(problems, *_shape(problems), seed)
    brief, whole = _efforts(options, search)
    batches, alone = _sorted_out(problems)
    for batch in batches:
        alone += _plan_batch(plans, batch, options)
    _finish(plans, [(index, None) for index in alone], brief, jobs)
    if search:
        missed = set(np.flatnonzero(plans.status == "not_found").tolist()) - set(alone)
        _finish(plans, [(index, None) for index in sorted(missed)], whole, jobs)
    if prove:
        solved = np.flatnonzero(np.isin(plans.status, SOLVED)).tolist()
        _finish(plans, [(index, plans.answer(index)) for index in solved], whole, jobs)
    return plans


def planned_alone(
    problem: Problem, seed: int, *, starts: int = 1, search: bool = False, prove: bool = False, attempts: int = UNSOLVED
) -> Answer:
    """Plan one flight by a search of its own, as :func:`plan_many` does; errors as :func:`floatplan.plan`."""
    brief, whole = _efforts(SearchOptions(seed=seed, starts=starts, attempts=attempts, near_miss=False), search)
    answer = _searched(problem, brief)
    return _proved(problem, answer, whole) if prove and answer.status in SOLVED else answer


def _efforts(options: SearchOptions, search: bool) -> tuple[SearchOptions, SearchOptions]:
    """How to search for what is not planned in a batch, and the whole search."""
    whole = replace(options, jobs=1, attempts=None)
    return whole if search else replace(options, jobs=1, patience=PATIENCE * SearchOptions().work), whole


def _shape(problems: Sequence[Problem] | Family) -> tuple[int, int]:
    """Most joints, and most coefficients of one; refused for flights in space."""
    asked = [problems.base] if isinstance(problems, Family) else problems
    degrees = [each.degrees for each in asked if each.robot.layout]
    return max(map(len, degrees), default=0), max((max(each, default=0) for each in degrees), default=0) + 1


def _sorted_out(problems: Sequence[Problem] | Family) -> tuple[list[_Batch], list[int]]:
    """Batches of plain problems, and the indices of the others."""
    if isinstance(problems, Family):
        indices = np.arange(len(problems))
        if not (plain.is_plain_family(problems) and len(problems)):
            return [], indices.tolist()
        return [(indices, problems.base, lambda some: plain.Numbers.of_family(problems, some))], []
    groups: dict[object, list[int]] = {}
    others = []
    for index, problem in enumerate(problems):
        if plain.is_plain(problem):
            groups.setdefault(plain.key(problem), []).append(index)
        else:
            others.append(index)

    def numbers(some: IntArray) -> plain.Numbers:
        return plain.Numbers.of_problems([problems[index] for index in some.tolist()])

    return [(np.array(group), problems[group[0]], numbers) for group in groups.values()], others


def _plan_batch(plans: Plans, batch: _Batch, options: SearchOptions) -> list[int]:
    """Plan a batch in chunks; indices of the problems whose numbers may be bad are returned, not planned."""
    all_indices, like, numbers_of = batch
    solver = plain.solver(like, like.degrees)
    search = Search(starts=options.starts, most_starts=MOST_STARTS + options.starts - 1, seed=options.seed)

    def answered(chunk: IntArray) -> tuple[IntArray, plain.Numbers, Answers, list[int]]:
        numbers, left = numbers_of(chunk), []
        doubtful = numbers.doubtful()
        if doubtful.any():
            left, chunk = chunk[doubtful].tolist(), chunk[~doubtful]
            numbers = numbers.some(np.flatnonzero(~doubtful))
        return chunk, numbers, solver.plan(numbers.rows(), search), left

    chunks = [all_indices[first : first + CHUNK] for first in range(0, len(all_indices), CHUNK)]
    left: list[int] = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for indices, numbers, answers, doubtful in (map if options.jobs == 1 else pool.map)(answered, chunks):
            left += doubtful
            _keep(plans, indices, numbers, answers)
    return left


def _keep(plans: Plans, indices: IntArray, numbers: plain.Numbers, answers: Answers) -> None:
    """Take the answers of a chunk."""
    solved = answers.status != INFEASIBLE
    for code, word in STATUS.items():
        plans.status[indices[answers.status == code]] = "not_found" if code == INFEASIBLE else word
    plans.objective[indices[solved]] = answers.objective[solved]
    plans.angular_momentum[indices] = numbers.angular_momentum()
    plans.residual[indices] = answers.residual
    _, n, columns = answers.coefficients.shape
    plans.coefficients[indices, :n, :columns] = answers.coefficients
    for name in COUNTS:
        getattr(plans, name)[indices] = getattr(answers, name)
    for index, starts in zip(indices[~solved].tolist(), answers.starts[~solved].tolist(), strict=True):
        plans.messages[index] = f"No plan was found from {starts} starts; {LONGER}."


def _finish(plans: Plans, tasks: Sequence[tuple[int, Answer | None]], options: SearchOptions, jobs: int) -> None:
    """Answer problems one by one, in this process or several; see :func:`_answering`."""
    groups = [(tasks[first : first + AT_ONCE],) for first in range(0, len(tasks), AT_ONCE)]
    several = jobs > 1 and len(tasks) > 1
    ready = (plans.problems, options)
    with processes(jobs, (__name__,), _answering, *ready) if several else nullcontext() as pool:
        answers = in_order(pool, groups, _answering(*ready))
        for (index, _), answer in zip(tasks, chain.from_iterable(answers), strict=True):
            plans.keep(index, answer)


def _answering(
    problems: Sequence[Problem], options: SearchOptions
) -> Callable[[Sequence[tuple[int, Answer | None]]], list[Answer]]:
    """Return what answers problems by their indices, some with a plan to prove; one that is wrong has an answer too."""

    def answered(index: int, known: Answer | None) -> Answer:
        try:
            problem = problems[index]
            return _proved(problem, known, options) if known else _searched(problem, options)
        except InputError as error:
            return Answer("error", message=str(error))

    return one_thread(lambda tasks: [answered(*task) for task in tasks])


def _searched(problem: Problem, options: SearchOptions) -> Answer:
    answer, gave_up = answered(problem, options)
    if not gave_up or answer.status != "not_found":
        return answer
    return replace(answer, message=f"The search ended at {answer.evaluations} evaluations; {LONGER}. {answer.message}")


def _proved(problem: Problem, answer: Answer, options: SearchOptions) -> Answer:
    """Prove a plan; where it is not proved, search again, which corrects what is missing or takes the next best."""
    plan = answer.plan(problem, options.seed)
    certificate = certify(plan)
    if certificate.proved:
        return replace(Answer.of_plan(judged(plan, certificate), answer.status), residual=answer.residual)
    better = proved_plan(planned(problem, options))
    if better.certificate is None or (not better.certificate.proved and certificate.verdict == "undecided"):
        better = judged(plan, certificate)
    return Answer.of_plan(better, better.status if better.ok else answer.status)
