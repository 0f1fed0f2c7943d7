"""One start followed to its end: feasible first where need be, then to the objective, then judged.

Attempts depend on the problem, the degrees, the seed and their own number alone, so that they can run in any process
and the answer is the same for the same seed.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.compiled.batch import STATUS, Answers, Rows, Search, solver
from floatplan.compiled.numbers import Numbers, is_plain
from floatplan.kernel.tolerances import CONSTRAINED_SETTINGS, EXCHANGE, SETTINGS
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import impossibilities, momentum_set
from floatplan.planning.starts import Start, plain_start
from floatplan.planning.transcription.compiled_attempt import CompiledProblem, PreparedStarts, compiled_problem
from floatplan.planning.transcription.constraints import Constraint, applies, changes_at_ends, constraints
from floatplan.planning.transcription.result import AttemptResult
from floatplan.planning.transcription.variables import DecisionVariables, decision_variables, scaled_variables
from floatplan.planning.transcription.work import FlightModel, flight_model
from floatplan.plans.plans import COUNTS, Answer
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
Stop: TypeAlias = Callable[[], bool]
ATTEMPTS = 300  # [-] most starts tried at each degree


@dataclass(frozen=True, eq=False)
class Followed:
    """Starts of a plain problem that the kernel has followed: h (1,), kg m^2/s, and the answers of one row."""

    momentum: Array
    answers: Answers
    bodies: int

    @property
    def status(self) -> str:
        """Of the best of them: "optimal", "feasible" or "infeasible"."""
        return STATUS[int(self.answers.status[0])]

    @property
    def work(self) -> float:
        """What it took, instants of one body."""
        return float(self.answers.evaluations[0] * EXCHANGE.evaluation + self.answers.instants[0] * self.bodies)

    @property
    def counts(self) -> dict[str, Any]:
        """Of all of them together."""
        return {name: int(getattr(self.answers, name)[0]) for name in COUNTS}

    @property
    def answer(self) -> Answer:
        """The best of them."""
        momentum, coefficients = float(self.momentum[0]), self.answers.coefficients[0]
        return Answer(self.status, angular_momentum=momentum, coefficients=coefficients, **self.counts)


def follow_together(problem: Problem, degrees: tuple[int, ...], search: Search) -> Followed:
    """Follow the plain motion of a problem without inequalities, and random starts, as the search says."""
    rows, compiled = Numbers.of_problems([problem]).rows(), solver(problem, degrees)
    return Followed(rows.momentum, compiled.plan(rows, search), compiled.bodies)


def follow_compiled(problem: Problem, start: Start) -> Followed:
    """Follow one start of a plain problem."""
    compiled, variables = solver(problem, start.variables.degrees), start.variables
    settings = SETTINGS if start.at_once else CONSTRAINED_SETTINGS
    rows = Rows(
        duration=np.array([variables.polynomials.duration]),
        momentum=variables.angular_momentum(start.x),
        change=np.array([problem.final.orientation - problem.initial.orientation]),
        boundary=variables.polynomials.boundary[None],
        start=variables.free_coefficients(start.x)[None],
    )
    answers = compiled.plan(rows, Search(longest_step=settings.longest_step))
    return Followed(rows.momentum, answers, compiled.bodies)


class Attempts:
    """A problem prepared for attempts, as far as they need it; ``momentum`` left out, those of the problem.

    Of a problem whose plain motion has been ``followed`` in a batch, that is the first attempt.
    """

    def __init__(
        self,
        problem: Problem,
        seed: int,
        momentum: MomentumSet | None = None,
        followed: tuple[Start, PreparedStarts] | None = None,
    ) -> None:
        self.problem = problem
        self.seed = seed
        self.momentum = momentum or momentum_set(problem)
        self._ends_hold = False  # as far as is known
        self._path_is_clear = False
        self._starts: PreparedStarts | None = None
        self._first: AttemptResult | None = None
        if followed:
            self.plain_start, self._starts = followed
            assert self._starts.plain is self.plain_start.x, "they are the starts of that one"
            self._learn(self._starts)
            self._first = self._starts.result(problem, self.model)

    def prepare(self) -> None:
        """Compute what a search will ask for: for many problems, all at this point is quicker than each in its turn."""
        self.model  # noqa: B018
        self.impossible  # noqa: B018

    @cached_property
    def model(self) -> FlightModel:
        """What the problem fixes of every motion, and the work done with it."""
        return flight_model(self.problem)

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """All that need watching."""
        return constraints(self.problem, self.model)

    @cached_property
    def plain_start(self) -> Start:
        """The plain motion of the problem's own degrees."""
        return plain_start(self.problem, self.problem.degrees, self.momentum)

    @cached_property
    def compiled(self) -> CompiledProblem:
        """The same for the kernel."""
        return compiled_problem(self.problem, self.model.flight, self.constraints)

    def raised(self, result: AttemptResult, degrees: tuple[int, ...]) -> Start:
        """Return the motion of a result as a start at higher degrees."""
        lower, x = result.variables, result.x
        rise = zip(lower.polynomials.free, degrees, lower.degrees, strict=True)
        polynomials = replace(lower.polynomials, free=tuple(free + new - old for free, new, old in rise))
        variables = scaled_variables(self.problem, polynomials, self.momentum, lower.following)
        z = lower.free_coefficients(x)
        padded = np.pad(z, ((0, 0), (0, polynomials.width - z.shape[1])))
        return Start(variables, variables.variables(padded, lower.angular_momentum(x)))

    @cached_property
    def impossible(self) -> list[str]:
        """Sentences about why no motion whatever meets the problem, as far as that is known."""
        reasons: list[str] = []
        if self.problem.has_inequalities:
            reasons += () if self._ends_hold else self._impossible_ends()
            reasons += impossibilities(self.problem, self._path_is_clear)
        for reason in reasons:
            LOG.info("impossible: %s", reason)
        return reasons

    def _impossible_ends(self) -> Iterator[str]:
        """What already fails at takeoff or landing, where positions, rates and accelerations are given.

        What the search can still change there, with a free h or free accelerations, does not count.
        """
        start = self.plain_start
        of_rows = self._starts_from(start).values_at_ends()
        first = 0
        for block in self.constraints:
            values = of_rows[first : first + len(block.labels)].T
            first += len(block.labels)
            if changes_at_ends(start.variables, block):
                continue
            exists = applies(block, np.array([0.0, 1.0]))
            for end, (name, verb) in enumerate((("start", "takeoff"), ("goal", "landing"))):
                row = int(np.argmin(values[end]))
                if exists[end] and values[end, row] < -block.tolerance:
                    amount = -values[end, row] * block.scale[row]
                    violated = f"{block.labels[row]} is violated by {amount:.4g} {block.unit}"
                    cause = block.cause.format(end=name)
                    yield f"At {verb} the {name} itself is impossible: {violated} ({cause})."

    def attempt(self, start: Start, stop: Stop = lambda: False, most_work: float = np.inf) -> AttemptResult:
        """Follow one start; from when it is stopped, or has done the most work, it takes what it has."""
        before = self.model.work
        if is_plain(self.problem):
            result = self._judge_compiled(follow_compiled(self.problem, start), start.variables)
        else:
            result = self._follow_compiled(self._starts_from(start), range(1), most_work, expired=stop())
        result.work = self.model.work - before
        return result

    def attempts(
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
            return self.attempt(given[numbers.start], stop, most_work)
        numbers = range(numbers.start - len(given), numbers.stop - len(given))
        number, before = numbers.start, self.model.work
        own = degrees == self.problem.degrees
        plain = self.plain_start if own else plain_start(self.problem, degrees, self.momentum)
        if number and not plain.variables.size:
            return None
        if is_plain(self.problem):
            search = Search(first_start=number, most_starts=number + 1, seed=self.seed)
            result = self._judge_compiled(follow_together(self.problem, degrees, search), plain.variables)
        else:
            starts = self._starts_from(plain)
            expired = stop()
            result = self._follow_compiled(starts, numbers, most_work, asks=asks, expired=expired)
            if not result.starts and not self.impossible:
                result = self._follow_compiled(starts, numbers, most_work, expired=expired)
        result.work = self.model.work - before
        return result

    def result_of(self, followed: Followed) -> AttemptResult:
        """Return the best of the starts that the kernel has followed together."""
        before = self.model.work
        result = self._judge_compiled(followed, self.plain_start.variables)
        result.work = self.model.work - before
        return result

    def _starts_from(self, start: Start) -> PreparedStarts:
        """Starts of which this one is number 0, prepared for the kernel."""
        if not (self._starts and self._starts.plain is start.x):
            self._starts = self.compiled.starts(start.variables, start.x, start.at_once)
        return self._starts

    def _follow_compiled(
        self, starts: PreparedStarts, numbers: range, most_work: float, *, asks: bool = False, expired: bool = False
    ) -> AttemptResult:
        """Follow starts in the kernel, unless the first one has been followed in a batch."""
        result = self._first
        self._first = None
        if result is None:
            starts.follow(numbers, most_work, self.seed, asks=asks, expired=expired)
            self._learn(starts)
            result = starts.result(self.problem, self.model)
        self.model.work += result.work
        return result

    def _learn(self, starts: PreparedStarts) -> None:
        """Keep what the kernel said before it followed starts."""
        self._ends_hold |= starts.ends_hold
        self._path_is_clear |= starts.path_is_clear

    def _judge_compiled(self, followed: Followed, variables: DecisionVariables) -> AttemptResult:
        """Evaluate and check what the kernel answered; ``variables`` are of the branches that it began on.

        Its b counts where that holds: far from a solution, b may be of another x.
        """
        answers, counts, model = followed.answers, followed.counts, self.model
        model.work += followed.work
        if answers.branch[0].any():
            branches = np.array([np.zeros_like(answers.branch[0]), answers.branch[0]])
            variables = decision_variables(self.problem, variables.degrees, branches, variables.momentum)
        x = variables.variables(answers.z[0], followed.momentum)
        result = self.judge(Start(variables, x), followed.status)
        result.iterations = counts["iterations"]
        result.evaluations = counts["evaluations"]
        result.starts = counts["starts"]
        result.solved = max(counts["solved"], 1)
        result.coefficients = answers.coefficients[0] if result.holds else None
        return result

    def judge(self, start: Start, status: str) -> AttemptResult:
        """Check the attitude at landing and the constraints of a motion as it is, between the instants too.

        ``status`` is why it was stopped at; one that holds is "feasible" at least.
        """
        starts = self._starts_from(start)
        starts.judge()
        result = starts.result(self.problem, self.model)
        self.model.work += result.work
        result.starts = 1
        result.status = status
        if not result.holds:
            result.status = "infeasible"
        elif status == "infeasible":
            result.status = "feasible"
        return result
