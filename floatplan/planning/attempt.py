"""One start followed to its end: feasible first where need be, then to the objective, then judged.

Attempts depend on the problem, the degrees, the seed and their own number alone, so that they can run in any process
and the answer is the same for the same seed.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.compiled import batch
from floatplan.compiled.batch import STATUS, Answers, Rows, Search, is_planar, solver
from floatplan.compiled.numbers import Numbers, is_plain
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import impossibilities, momentum_set
from floatplan.planning.starts import Start, on_branch, plain_start
from floatplan.planning.transcription.compiled_attempt import (
    SAME,
    CompiledAttempts,
    Ended,
    Ready,
    compiled_attempts,
)
from floatplan.planning.transcription.constraints import Constraint, applies, changes_at_ends, constraints
from floatplan.planning.transcription.minima import Worst
from floatplan.planning.transcription.variables import DecisionVariables, decision_variables, scaled_variables
from floatplan.planning.transcription.work import EVALUATION, FlightModel, flight_model
from floatplan.plans.plans import COUNTS, Answer
from floatplan.problem.problem import Problem
from floatplan.tables import Objective as ObjectiveName

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
        return float(self.answers.evaluations[0] * EVALUATION + self.answers.instants[0] * self.bodies)

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
    settings = batch.FINE if start.at_once else batch.CAUTIOUS
    rows = Rows(
        duration=np.array([variables.polynomials.duration]),
        momentum=variables.angular_momentum(start.x),
        change=np.array([problem.final.orientation - problem.initial.orientation]),
        boundary=variables.polynomials.boundary[None],
        start=variables.free_coefficients(start.x)[None],
    )
    answers = compiled.plan(rows, Search(longest_step=settings.longest_step))
    return Followed(rows.momentum, answers, compiled.bodies)


class Reached(NamedTuple):
    """A point x, why it is one to stop at (see ``STATUS``), and what it took."""

    x: Array
    status: str
    iterations: int
    evaluations: int


@dataclass(eq=False)
class Outcome:
    """Where an attempt ended: of motions as it was ``begun`` with, or of another branch, on which it ``landed``.

    ``level`` is that of the grid that it was judged on. ``violation`` is the largest one of (14), rad, or of a
    constraint's row; 0 where everything holds. ``objective`` names what is minimised; ``work`` is what the attempt
    took, the drawing of its start included. ``starts`` were followed together, of which ``solved`` hold.
    The kernel has told ``coefficients``, b (n, k+1), and an objective's ``integral``; (14) is ``missed`` by (e,) rad.
    """

    begun: DecisionVariables
    solution: Reached
    model: FlightModel
    level: int
    violation: float
    worst: Worst
    objective: ObjectiveName
    work: float = 0.0
    starts: int = 1
    solved: int = 1
    coefficients: Array | None = None
    integral: float | None = None
    missed: Array = field(default_factory=lambda: np.array([np.nan]))
    landed: Callable[[], DecisionVariables] | None = None

    @property
    def holds(self) -> bool:
        """Whether (14) and every constraint hold."""
        return self.violation <= 0

    @property
    def is_optimal(self) -> bool:
        """Whether it holds, and no motion beside it costs less."""
        return self.holds and self.solution.status == "optimal"

    @cached_property
    def variables(self) -> DecisionVariables:
        """How the solution's x makes its motion."""
        return self.landed() if self.landed else self.begun

    @cached_property
    def written(self) -> Array:
        """Coefficients b (n, k+1) of (12), powers of t in seconds."""
        if self.coefficients is not None:
            return self.coefficients
        variables, x = self.variables, self.solution.x
        motions = variables.motion_class(variables.angular_momentum(x))
        return motions.powers_of_seconds(variables.free_coefficients(x))

    @cached_property
    def objective_value(self) -> float:
        """The user's objective, which compares motions of any degree and branch."""
        if self.integral is not None:
            return self.integral
        if is_planar(self.model.flight):
            return float(np.linalg.norm(self.written))
        return float(np.linalg.norm(self.solution.x[: self.variables.coefficients]))


def best(outcomes: Sequence[Outcome]) -> Outcome:
    """Return the outcome of the least violation, of equals the best; others have no objective.

    Of several that ended at the same motion it is one that is known to be optimal, the first of these.
    """
    least = min(outcome.violation for outcome in outcomes)
    nearest = [outcome for outcome in outcomes if outcome.violation == least]
    if len(nearest) == 1:
        return nearest[0]
    lowest = min(nearest, key=lambda outcome: outcome.objective_value)
    most = lowest.objective_value + SAME * abs(lowest.objective_value)
    same = (outcome for outcome in nearest if outcome.is_optimal and outcome.objective_value <= most)
    return lowest if lowest.is_optimal else min(same, key=lambda outcome: outcome.objective_value, default=lowest)


class Attempts:
    """A problem made ready for attempts, as far as they need it; ``momentum`` left out, those of the problem.

    One of problems that go together is ``ready`` with them, and its plain motion has been followed.
    """

    def __init__(
        self, problem: Problem, seed: int, momentum: MomentumSet | None = None, ready: tuple[Start, Ready] | None = None
    ) -> None:
        self.problem, self.seed = problem, seed
        self.momentum = momentum or momentum_set(problem)
        self._ends_hold = self._path_is_clear = False  # as far as is known
        self._ready, self._first = None, None
        if ready:
            self.plain_start, self._ready = ready
            self._first = self._ready.ended
            self._learn(self._first)

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
    def compiled(self) -> CompiledAttempts:
        """The same for the kernel."""
        return compiled_attempts(self.problem, self.model.flight, self.constraints)

    def raised(self, outcome: Outcome, degrees: tuple[int, ...]) -> Start:
        """Return the motion of an outcome as a start at higher degrees."""
        lower, x = outcome.variables, outcome.solution.x
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
        values = self._ready_for(start).values_at_ends()
        first = 0
        for block in self.constraints:
            own = values[first : first + len(block.labels)].T
            first += len(block.labels)
            if changes_at_ends(start.variables, block):
                continue
            exists = applies(block, np.array([0.0, 1.0]))
            for end, (name, verb) in enumerate((("start", "takeoff"), ("goal", "landing"))):
                row = int(np.argmin(own[end]))
                if exists[end] and own[end, row] < -block.tolerance:
                    amount = -own[end, row] * block.scale[row]
                    violated = f"{block.labels[row]} is violated by {amount:.4g} {block.unit}"
                    cause = block.cause.format(end=name)
                    yield f"At {verb} the {name} itself is impossible: {violated} ({cause})."

    def attempt(self, start: Start, stop: Stop = lambda: False, most_work: float = np.inf) -> Outcome:
        """Follow one start; from when it is stopped, or has done the most work, it takes what it has."""
        before = self.model.work
        if is_plain(self.problem):
            outcome = self._judge_compiled(follow_compiled(self.problem, start), start.variables)
        else:
            ready, left = self._ready_for(start), -1.0 if stop() else most_work
            outcome = self._outcome(start, self._follow_compiled(ready, left, range(1)))
        outcome.work = self.model.work - before
        return outcome

    def attempts(
        self,
        degrees: tuple[int, ...],
        given: Sequence[Start],
        numbers: range,
        stop: Stop,
        most_work: float = np.inf,
        asks: bool = False,
    ) -> Outcome | None:
        """Follow starts by number, the given ones first; None where there are not so many.

        They are followed until one holds: by the kernel as many as take a moment, else one alone. Where it ``asks``
        first, and the problem is known to have no solution, the outcome is the plain motion as it is, of no start.
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
            outcome = self._judge_compiled(follow_together(self.problem, degrees, search), plain.variables)
        else:
            ready, left = self._ready_for(plain), -1.0 if stop() else most_work
            ended = self._follow_compiled(ready, left, numbers, asks)
            if not ended.starts and not self.impossible:
                ended = self._follow_compiled(self._ready_for(plain), left, numbers)
            outcome = self._outcome(plain, ended)
        outcome.work = self.model.work - before
        return outcome

    def outcome_of(self, followed: Followed) -> Outcome:
        """Return the best of the starts that the kernel has followed together."""
        before = self.model.work
        outcome = self._judge_compiled(followed, self.plain_start.variables)
        outcome.work = self.model.work - before
        return outcome

    def _ready_for(self, start: Start) -> Ready:
        """What follows a start in the kernel."""
        if not (self._ready and self._ready.plain is start.x):
            self._ready = self.compiled.ready(start.variables, start.x, start.at_once)
        return self._ready

    def _follow_compiled(self, ready: Ready, most_work: float, numbers: range, asks: bool = False) -> Ended:
        """Follow starts in the kernel, and count what it did."""
        known, self._first = self._first, None
        ended = known or ready.follow(numbers, most_work, self.seed, asks)
        self._learn(ended)
        self.model.work += ended.work
        return ended

    def _outcome(self, start: Start, ended: Ended) -> Outcome:
        """Where starts ended of which this one is number 0."""
        reached = Reached(ended.x, ended.status, ended.iterations, ended.evaluations)
        of_end = ended.level, ended.violation, ended.worst, self.problem.motion.objective
        outcome = Outcome(start.variables, reached, self.model, *of_end, starts=ended.starts)
        outcome.coefficients, outcome.integral = ended.coefficients, ended.integral
        outcome.missed = ended.missed
        if any(ended.branch.tolist()):
            outcome.landed = partial(on_branch, self.problem, start.variables, ended.branch)
        return outcome

    def _learn(self, ended: Ended) -> None:
        """Keep what the kernel answered before it followed starts."""
        self._ends_hold |= ended.ends_hold
        self._path_is_clear |= ended.path_is_clear

    def _judge_compiled(self, followed: Followed, variables: DecisionVariables) -> Outcome:
        """Evaluate and check what the kernel answered; ``variables`` are of the branches that it began on.

        Its b counts where that holds: far from a solution, b may be of another x.
        """
        answers, counts, model = followed.answers, followed.counts, self.model
        model.work += followed.work
        if answers.branch[0].any():
            branches = np.array([np.zeros_like(answers.branch[0]), answers.branch[0]])
            variables = decision_variables(self.problem, variables.degrees, branches, variables.momentum)
        x = variables.variables(answers.z[0], followed.momentum)
        outcome = self.judge(Start(variables, x), followed.status)
        outcome.solution = Reached(x, outcome.solution.status, counts["iterations"], counts["evaluations"])
        outcome.starts, outcome.solved = counts["starts"], max(counts["solved"], 1)
        outcome.coefficients = answers.coefficients[0] if outcome.holds else None
        return outcome

    def judge(self, start: Start, status: str) -> Outcome:
        """Check the attitude at landing and the constraints of a motion as it is, between the instants too.

        ``status`` is why it was stopped at; one that holds is "feasible" at least.
        """
        ended = self._ready_for(start).judge()
        self.model.work += ended.work
        holds = ended.violation <= 0
        status = "infeasible" if not holds else "feasible" if status == "infeasible" else status
        return self._outcome(start, ended._replace(status=status, starts=1))
