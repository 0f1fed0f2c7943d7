"""The search for a motion: from many starts, feasible first where need be, the best kept.

An attempt is one start followed to its end. Attempts depend on the problem, the degrees, the seed and their own number
alone, so that they can run in any process and the answer is the same for the same seed.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.constraints import Constraint, constraints
from floatplan.planning.decision_variables import DecisionVariables
from floatplan.planning.feasibility import Nearest, reduce_violations
from floatplan.planning.nonlinear_program import Derivatives, Solution
from floatplan.planning.objectives import Objective
from floatplan.planning.program import BACK_OFF, FlightProgram, decision_variables, objective
from floatplan.planning.semi_infinite import FINE, Worst, local_minima, nodes_needed, solve
from floatplan.planning.starts import Start, starts
from floatplan.planning.trajectory import (
    FlightModel,
    Sampling,
    Trajectory,
    flight_model,
    sample_nodes,
    trajectory,
)
from floatplan.problem import Bar, Circle, Problem

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

ATTEMPTS = 60  # starts tried before the search gives up, at each degree
ATTEMPTS_FOR_THE_IMPOSSIBLE = 2
ATTEMPTS_BEFORE_RAISING = 4  # the same where the degree may be raised
RAISED = 2  # nearest motions of one degree that are starts at the next
DEGREE_STEP = 2
HIGHEST_AUTOMATIC_DEGREE = 13
BUDGET = 6.0  # s of work, where none is given
BUDGET_FOR_RAISING = 9.0  # the same where the degree may be raised
SAME = 1e-6  # relative difference of objectives, below which two attempts ended at the same motion
WANTED_AFTER_FAILURE = 4  # solutions to choose from where the plain start did not come easily
STARTS_AFTER_THE_FIRST = 1  # with constraints: tried after one that is solved but not optimal
EASY_ITERATIONS = 40
CONSTRAINED_LEVEL = 2  # index into NODE_COUNTS, at least, where constraints are watched
SMALLEST_STEP = 0.02  # m, that a link may travel between two nodes even beside a smaller obstacle
WATCHED_AT_MOST = 6  # index into NODE_COUNTS
PROMISING = 1e-3  # sum of squared violations below which a motion is worth following to the objective
CAUTIOUS = replace(FINE, longest_step=0.2)  # with obstacles a long step lands beyond them
ORIENTATION_MISSED = 1e-9  # rad, at the end: more than this is no plan
UNRESOLVED = 1e-6  # tail of the Legendre coefficients of theta0', relative to its largest value: its square is lost


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where an attempt ended.

    ``lacking`` is the largest violation of (14), rad, or of a constraint's row; 0 where everything holds.
    """

    variables: DecisionVariables
    solution: Solution
    lacking: float
    worst: Worst
    number: int
    degrees: tuple[int, ...]

    @property
    def holds(self) -> bool:
        """Whether (14) and every constraint hold."""
        return self.lacking <= 0

    @property
    def is_optimal(self) -> bool:
        """Whether it holds, and no motion beside it costs less."""
        return self.holds and self.solution.status == "optimal"

    @property
    def came_easily(self) -> bool:
        """Whether it is optimal, and took so few iterations that other starts promise little."""
        return self.is_optimal and self.solution.iterations <= EASY_ITERATIONS

    @property
    def rank(self) -> tuple[float, float]:
        """Sorts outcomes: what holds before what does not, then by objective."""
        return (self.lacking, self.solution.evaluation.objective)


@dataclass(frozen=True, eq=False)
class Found:
    """What the search brings back: the best outcome and what it took."""

    best: Outcome
    attempts: int
    solved: int
    iterations: int
    evaluations: int
    ran_out_of_time: bool
    interrupted: bool


class Search:
    """A problem made ready for attempts."""

    def __init__(self, problem: Problem, momentum_bounds: tuple[float, float], seed: int) -> None:
        self.problem = problem
        self.model: FlightModel = flight_model(problem)
        self.constraints: tuple[Constraint, ...] = constraints(problem, self.model)
        self.momentum_bounds = momentum_bounds
        self.seed = seed
        self.plain_start = next(self.starts(problem.degrees))
        self._level = self._watching_level() if self.constraints else 0

    def starts(self, degrees: tuple[int, ...]) -> Iterator[Start]:
        """Return the starts at these degrees."""
        return starts(self.problem, self.model, self.constraints, degrees, self.momentum_bounds, self.seed)

    def raised(self, outcome: Outcome, degrees: tuple[int, ...]) -> Start:
        """Return the motion of an outcome as a start at higher degrees."""
        lower, x = outcome.variables, outcome.solution.x
        polynomials = replace(lower.polynomials, free=tuple(degree - CONDITIONS + 1 for degree in degrees))
        variables = decision_variables(self.problem, polynomials, self.momentum_bounds)
        z = lower.free_coefficients(x)
        padded = np.pad(z, ((0, 0), (0, polynomials.width - z.shape[1])))
        return Start(variables, variables.variables(padded, lower.angular_momentum(x)))

    def _watching_level(self) -> int:
        """Index into NODE_COUNTS for the constraints: no link may jump over an obstacle between two nodes.

        The plain motion tells how far the links travel.
        """
        sizes = [2 * obstacle.radius for obstacle in self.problem.obstacles if isinstance(obstacle, Circle | Bar)]
        plain = self.plain_start
        dense = sample_nodes(NODE_COUNTS[-2], plain.variables.polynomials.width)
        segments = trajectory(self.model, plain.variables, dense, plain.x).segments
        travel = max(np.abs(np.diff(ends, axis=0)).sum(axis=0).max() for ends in (segments.start, segments.end))
        step = max(min(sizes, default=np.inf), SMALLEST_STEP)
        wanted = travel / step
        return min(
            (level for level, count in enumerate(NODE_COUNTS) if count >= wanted and level >= CONSTRAINED_LEVEL),
            default=WATCHED_AT_MOST,
        )

    def attempt(
        self, start: Start, number: int, degrees: tuple[int, ...], stop: Callable[[], bool] = lambda: False
    ) -> Outcome:
        """Follow one start: straight to the objective, and by way of a feasible motion where that fails."""
        settings = CAUTIOUS if self.constraints or number > 0 else FINE

        def make_objective(nodes: Sampling) -> Objective:
            return objective(self.problem, self.model, start.variables, nodes)

        def follow(x: Array) -> Outcome:
            solution = solve(
                self.model, start.variables, make_objective, self.constraints, x, settings, stop, self._level
            )
            return self._judge(start.variables, solution, number, degrees)

        if not self.constraints:
            return follow(start.x)
        outcome = follow(start.x) if number == 0 else None
        if outcome and (outcome.holds or stop()):
            return outcome
        for point in self._nearly_feasible(start, make_objective, number, stop):
            if point.squares < PROMISING or outcome is None:
                found = follow(point.x)
                outcome = min(outcome, found, key=lambda candidate: candidate.rank) if outcome else found
            if outcome.holds or stop():
                break
        assert outcome is not None, "every start gives a point to follow"
        return outcome

    def _nearly_feasible(
        self, start: Start, make_objective: Callable[[Sampling], Objective], number: int, stop: Callable[[], bool]
    ) -> Iterator[Nearest]:
        """Motions that violate little: from the start; from the plain one also by way of the best without limits."""
        nodes = sample_nodes(NODE_COUNTS[self._level], start.variables.polynomials.width)
        program = FlightProgram(self.model, start.variables, nodes, make_objective(nodes), self.constraints)
        yield reduce_violations(program, start.x, stop)
        if number > 0:
            return
        free = solve(self.model, start.variables, make_objective, (), start.x, FINE, stop)
        yield reduce_violations(program, free.x, stop)

    def _judge(
        self, variables: DecisionVariables, solution: Solution, number: int, degrees: tuple[int, ...]
    ) -> Outcome:
        """Check (14) and the constraints, between the instants too."""
        used = solution.evaluation.detail
        assert isinstance(used, Trajectory)
        nodes = NODE_COUNTS[min(max(nodes_needed(used), self._level) + 1, len(NODE_COUNTS) - 1)]
        motion = used
        if nodes > used.sampling.nodes:
            motion = trajectory(self.model, variables, sample_nodes(nodes, variables.polynomials.width), solution.x)
        missed = abs(motion.final_orientation - self.model.final_orientation)
        if motion.sampling.quadrature.tail(motion.node_rates) > UNRESOLVED * np.abs(motion.node_rates).max():
            missed = np.inf
        worst = local_minima(self.model, variables, self.constraints, nodes, solution.x)
        lacking = max(missed if missed > ORIENTATION_MISSED else 0.0, -min(worst.least + BACK_OFF / 20, 0.0))
        return Outcome(variables, solution, lacking, worst, number, degrees)


def search(
    prepared: Search,
    *,
    wanted: int,
    budget: float | None,
    jobs: int,
    attempts: int | None,
    progress: Callable[[str], None] | None,
) -> Found:
    """Try starts until ``wanted`` of them are solved, the budget (s) is used up, or there is little hope.

    ``attempts`` limits the starts, where the problem is known to have no solution and only a near miss is wanted.
    Ctrl-C ends the search with the best motion so far.
    """
    usual = BUDGET_FOR_RAISING if prepared.problem.raises_degree else BUDGET
    budget = usual if budget is None and jobs > 1 else budget  # several processes have no common work to count
    expired = expiry(budget, usual)
    outcomes: list[Outcome] = []
    constrained = bool(prepared.constraints)
    interrupted = False
    announced = time.monotonic()
    try:
        for outcome in islice(_outcomes(prepared, jobs, budget, expired), attempts):
            outcomes.append(outcome)
            solved = sum(outcome.holds for outcome in outcomes)
            if progress and time.monotonic() - announced > 1:
                announced = time.monotonic()
                progress(f"{len(outcomes)} starts tried, {solved} solved, degree {max(outcome.degrees)}")
            if _are_enough(outcomes, wanted, constrained) or expired():
                break
    except KeyboardInterrupt:
        interrupted = True
        if not outcomes:
            outcomes.append(prepared.attempt(prepared.plain_start, 0, prepared.problem.degrees, lambda: True))
    best = min(outcomes, key=lambda outcome: outcome.rank)
    return Found(
        best,
        attempts=len(outcomes),
        solved=sum(outcome.holds for outcome in outcomes),
        iterations=sum(outcome.solution.iterations for outcome in outcomes),
        evaluations=sum(outcome.solution.evaluations for outcome in outcomes),
        ran_out_of_time=expired(),
        interrupted=interrupted,
    )


def expiry(budget: float | None, usual: float = BUDGET) -> Callable[[], bool]:
    """Return what says when a budget (s), counted from now, is used up.

    A budget that was asked for is by the clock. The usual one is of this thread's own work: a busy machine takes
    longer, but finds what a quiet one finds.
    """
    clock = time.thread_time if budget is None else time.monotonic
    end = clock() + (usual if budget is None else budget)
    return lambda: clock() > end


def _are_enough(outcomes: list[Outcome], wanted: int, constrained: bool) -> bool:
    """Whether ``wanted`` starts are solved and more of them promise little."""
    solved = [index for index, outcome in enumerate(outcomes) if outcome.holds]
    if len(solved) < max(wanted, 1):
        return False
    if outcomes[0].came_easily or len(solved) >= WANTED_AFTER_FAILURE:
        return True
    return constrained and (
        any(outcome.is_optimal for outcome in outcomes) or len(outcomes) - solved[0] > STARTS_AFTER_THE_FIRST
    )


def _stages(problem: Problem) -> Iterator[tuple[tuple[int, ...], int]]:
    """Degrees and how many starts to try with them."""
    if not problem.raises_degree:
        yield problem.degrees, ATTEMPTS
        return
    degree = problem.degrees[0]
    while degree < HIGHEST_AUTOMATIC_DEGREE:
        yield (degree,) * len(problem.degrees), ATTEMPTS_BEFORE_RAISING
        degree += DEGREE_STEP
    yield (HIGHEST_AUTOMATIC_DEGREE,) * len(problem.degrees), ATTEMPTS


def _outcomes(prepared: Search, jobs: int, budget: float | None, expired: Callable[[], bool]) -> Iterator[Outcome]:
    """Outcomes of the attempts, in their order, from this process or from several.

    The nearest motions of one degree are the first starts of the next.
    """
    nearest: list[Outcome] = []
    with _runner(prepared, jobs, budget, expired) as run:
        for degrees, attempts in _stages(prepared.problem):
            raised = [prepared.raised(outcome, degrees) for outcome in nearest]
            tried = []
            for outcome in run(degrees, raised, attempts):
                yield outcome
                tried.append(outcome)
            nearest = _nearest(tried)


def _nearest(outcomes: list[Outcome]) -> list[Outcome]:
    """The outcomes that lack least, each at another motion."""
    found: list[Outcome] = []
    for outcome in sorted(outcomes, key=lambda outcome: outcome.rank):
        cost = outcome.solution.evaluation.objective
        if all(abs(cost - other.solution.evaluation.objective) > SAME * abs(cost) for other in found):
            found.append(outcome)
    return found[:RAISED]


Run: TypeAlias = Callable[[tuple[int, ...], list[Start], int], Iterator[Outcome]]


@contextmanager
def _runner(prepared: Search, jobs: int, budget: float | None, expired: Callable[[], bool]) -> Iterator[Run]:
    """What follows starts at some degrees: the given ones, then random ones, so many in all."""

    def run_here(degrees: tuple[int, ...], given: list[Start], attempts: int) -> Iterator[Outcome]:
        for number, start in enumerate(islice(chain(given, prepared.starts(degrees)), attempts)):
            yield prepared.attempt(start, number, degrees, expired)

    if jobs == 1:
        yield run_here
        return
    from concurrent.futures import ProcessPoolExecutor  # here, because most plans do without
    from multiprocessing import get_context

    context = get_context("forkserver")
    ended = context.Event()
    ready = (prepared.problem, prepared.momentum_bounds, prepared.seed, budget, ended)
    with ProcessPoolExecutor(jobs, context, initializer=_prepare, initargs=ready) as pool:

        def run_there(degrees: tuple[int, ...], given: list[Start], attempts: int) -> Iterator[Outcome]:
            futures = [pool.submit(_attempt, degrees, given, number) for number in range(attempts)]
            return (outcome for future in futures if (outcome := future.result()))

        try:
            yield run_there
        finally:
            ended.set()
            pool.shutdown(cancel_futures=True)


_prepared: Search
_expired: Callable[[], bool]


def _prepare(
    problem: Problem, momentum_bounds: tuple[float, float], seed: int, budget: float | None, ended: Event
) -> None:
    """Make a process ready for attempts, which stop when the search has ended; Ctrl-C is for the main process."""
    global _prepared, _expired
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    expired = expiry(budget)
    _prepared, _expired = Search(problem, momentum_bounds, seed), lambda: ended.is_set() or expired()


def _attempt(degrees: tuple[int, ...], given: list[Start], number: int) -> Outcome | None:
    start = next(islice(chain(given, _prepared.starts(degrees)), number, None), None)
    if start is None:
        return None
    return _portable(_prepared.attempt(start, number, degrees, _expired))


def _portable(outcome: Outcome) -> Outcome:
    """Strip an outcome of what cannot go from one process to another: its derivatives, and what is remembered of it."""
    solution = outcome.solution
    motion = solution.evaluation.detail
    assert isinstance(motion, Trajectory)
    evaluation = replace(solution.evaluation, differentiate=_left_behind, detail=replace(motion))
    return replace(outcome, solution=replace(solution, evaluation=evaluation))


def _left_behind() -> Derivatives:
    raise AssertionError("the derivatives of an outcome stay in the process where it was found")
