"""One start followed to its end: feasible first where need be, then to the objective, then judged.

Attempts depend on the problem, the degrees, the seed and their own number alone, so that they can run in any process
and the answer is the same for the same seed.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import flight_of
from floatplan.planning.starts import Start, plain_start
from floatplan.planning.transcription.compiled_attempt import CompiledProblem, PreparedStarts, compiled_problem
from floatplan.planning.transcription.constraints import Constraint, applies, changes_at_ends, constraints
from floatplan.planning.transcription.result import AttemptResult
from floatplan.planning.transcription.variables import scaled_variables
from floatplan.planning.transcription.work import FlightModel, flight_model
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
Stop: TypeAlias = Callable[[], bool]
ATTEMPTS = 300  # [-] most starts tried at each degree


class Attempts:
    """A problem prepared for attempts, as far as they need it; ``momentum`` left out, those of the problem.

    Of a problem of which starts have been ``followed`` in a batch, what came of these is the first attempt.
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
        self.momentum = momentum or flight_of(problem).momentum_set
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
            reasons += self.model.flight.impossibilities(self._path_is_clear)
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
        starts = self._starts_from(plain)
        expired = stop()
        result = self._follow_compiled(starts, numbers, most_work, asks=asks, expired=expired)
        if not result.starts and not self.impossible:
            result = self._follow_compiled(starts, numbers, most_work, expired=expired)
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
