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
from floatplan.compiled.batch import INFEASIBLE, MOST_STARTS, OPTIMAL, STATUS, Answers, Search, solver
from floatplan.compiled.numbers import Numbers, goes_together, is_plain, is_together, key
from floatplan.errors import InputError
from floatplan.planning.attempt import Attempts
from floatplan.planning.planned import answered, planned
from floatplan.planning.repair import judged, proved_plan
from floatplan.planning.search import Allowance, SearchOptions
from floatplan.planning.together import Together, followed_together
from floatplan.planning.transcription.compiled_attempt import Ended
from floatplan.plans.plans import ALL_HOLDS, COUNTS, SOLVED, Answer, Plans
from floatplan.pool import in_order, one_thread, processes
from floatplan.problem.family import Family
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem

CHUNK, WITH_ROWS = 2048, 256  # problems of a batch, plain or with inequalities
AT_ONCE = 8  # problems that a process is given at a time
LONGER = "search=True searches longer"
# Problems that go together: their indices (M,) among all, one of them, the numbers of some.
_Batch: TypeAlias = tuple[IntArray, Problem, Callable[[IntArray], Numbers]]
# What is to be answered alone: its index, and a plan to prove, or where the first attempt ended, where that is known.
_Task: TypeAlias = tuple[int, Answer | Ended | None]
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
    problems = problems if isinstance(problems, Family) else many(given_problem, "problems")(problems, "problems")
    search, prove = flag(search, "search"), flag(prove, "prove")
    return planned_together(problems, options, lambda index: seed, search, prove)


def planned_together(
    problems: Sequence[Problem] | Family, options: SearchOptions, seed: Callable[[int], int], search: bool, prove: bool
) -> Plans:
    """Plan many flights as :func:`plan_many` does, where a search of one has its own ``seed``, by its index."""
    plans = Plans.of(problems, *_shape(problems), options.seed)
    brief, whole = _efforts(options, search)
    batches, indices = _sorted_out(problems)
    alone: list[_Task] = [(index, None) for index in indices]
    for batch in batches:
        alone += _plan_batch(plans, batch, options, brief)
    _finish(plans, sorted(alone, key=lambda task: task[0]), brief, options.jobs, seed)
    if search:
        missed = set(np.flatnonzero(plans.status == "not_found").tolist()) - {index for index, _ in alone}
        _finish(plans, [(index, None) for index in sorted(missed)], whole, options.jobs, seed)
    if prove:
        solved = np.flatnonzero(np.isin(plans.status, SOLVED)).tolist()
        _finish(plans, [(index, plans.answer(index)) for index in solved], whole, options.jobs, seed)
    return plans


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
    """Batches of problems that go together, and the indices of the others."""
    if isinstance(problems, Family):
        indices = np.arange(len(problems))
        if not (is_together(problems) and len(problems)):
            return [], indices.tolist()
        return [(indices, problems.base, lambda some: Numbers.of_family(problems, some))], []
    groups: dict[object, list[int]] = {}
    others = []
    for index, problem in enumerate(problems):
        if goes_together(problem):
            groups.setdefault(key(problem), []).append(index)
        else:
            others.append(index)

    def numbers(some: IntArray) -> Numbers:
        return Numbers.of_problems([problems[index] for index in some.tolist()])

    return [(np.array(group), problems[group[0]], numbers) for group in groups.values()], others


def _plan_batch(plans: Plans, batch: _Batch, options: SearchOptions, brief: SearchOptions) -> list[_Task]:
    """Plan a batch in chunks; what is to be searched for is returned: doubtful numbers too, which a Problem checks."""
    all_indices, like, numbers_of = batch
    plain, follow = is_plain(like), _following(like, options, brief)

    def answered(chunk: IntArray) -> tuple[IntArray, Numbers, Answers | Together | None, list[_Task]]:
        numbers = numbers_of(chunk)
        bad = numbers.doubtful()
        doubtful: list[_Task] = [(index, None) for index in chunk[bad].tolist()]
        if doubtful:
            chunk = chunk[~bad]
            numbers = numbers_of(chunk) if len(chunk) else numbers
        return chunk, numbers, follow(numbers) if len(chunk) else None, doubtful

    size = CHUNK if plain else WITH_ROWS
    chunks = [all_indices[first : first + size] for first in range(0, len(all_indices), size)]
    left: list[_Task] = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for indices, numbers, answers, doubtful in (map if options.jobs == 1 else pool.map)(answered, chunks):
            left += doubtful
            if isinstance(answers, Answers):
                _keep(plans, indices, numbers, answers)
            elif answers:
                left += _keep_solved(plans, indices, numbers, answers, options.starts)
    return left


def _following(like: Problem, options: SearchOptions, brief: SearchOptions) -> Callable[[Numbers], Answers | Together]:
    """Return what follows starts of problems like one: all that they need of plain ones, of others the plain motion."""
    if is_plain(like):
        compiled, most = solver(like, like.degrees), MOST_STARTS + options.starts - 1
        search = Search(starts=options.starts, most_starts=most, seed=options.seed)
        return lambda numbers: compiled.plan(numbers.rows(), search)
    prepared, work = Attempts(like, options.seed), Allowance.of(brief).left
    return lambda numbers: followed_together(prepared, numbers, work)


def _keep_solved(plans: Plans, indices: IntArray, numbers: Numbers, found: Together, starts: int) -> list[_Task]:
    """Take those answers of a chunk that need no more starts; return the others."""
    solved = found.solved if starts == 1 else np.empty(0, np.int64)
    kept, of_kernel, (_, n, columns) = indices[solved], found.attempts.numbers[solved], found.coefficients.shape
    plans.status[kept], plans.residual[kept] = STATUS[OPTIMAL], of_kernel["missed"]
    plans.objective[kept] = [np.linalg.norm(b) for b in found.coefficients[solved]]
    plans.angular_momentum[kept] = numbers.angular_momentum()[solved]
    plans.coefficients[kept, :n, :columns] = found.coefficients[solved]
    plans.starts[kept] = plans.solved[kept] = 1
    for name in ("evaluations", "iterations"):
        getattr(plans, name)[kept] = of_kernel[name]
    plans.messages.update(dict.fromkeys(kept.tolist(), ALL_HOLDS))
    left = np.setdiff1d(np.arange(len(indices)), solved)
    return [(int(indices[row]), found.ended(row)) for row in left.tolist()]


def _keep(plans: Plans, indices: IntArray, numbers: Numbers, answers: Answers) -> None:
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


def _finish(
    plans: Plans, tasks: Sequence[_Task], options: SearchOptions, jobs: int, seed: Callable[[int], int]
) -> None:
    """Answer problems one by one, in this process or several; see :func:`_answering`."""
    seeded = [(index, known, seed(index)) for index, known in tasks]
    groups = [(seeded[first : first + AT_ONCE],) for first in range(0, len(tasks), AT_ONCE)]
    several = jobs > 1 and len(tasks) > 1
    ready = (plans.problems, options)
    with processes(jobs, (__name__,), _answering, *ready) if several else nullcontext() as pool:
        answers = in_order(pool, groups, _answering(*ready))
        for (index, _), answer in zip(tasks, chain.from_iterable(answers), strict=True):
            plans.keep(index, answer)


def _answering(
    problems: Sequence[Problem], options: SearchOptions
) -> Callable[[Sequence[tuple[int, Answer | Ended | None, int]]], list[Answer]]:
    """Return what answers problems by their indices, some with a plan to prove; one that is wrong has an answer too."""

    def answered(index: int, known: Answer | Ended | None, seed: int) -> Answer:
        try:
            problem, how = problems[index], replace(options, seed=seed)
            return _proved(problem, known, how) if isinstance(known, Answer) else _searched(problem, how, known)
        except InputError as error:
            return Answer("error", message=str(error))

    return one_thread(lambda tasks: [answered(*task) for task in tasks])


def _searched(problem: Problem, options: SearchOptions, first: Ended | None = None) -> Answer:
    answer, gave_up = answered(problem, options, first)
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
