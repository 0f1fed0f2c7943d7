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

from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import impossibilities, momentum_set
from floatplan.optimization.sqp import Solution, reduce_violations
from floatplan.planning.starts import Start, plain_start
from floatplan.planning.transcription.compiled_attempt import CompiledProblem, PreparedStarts, compiled_problem
from floatplan.planning.transcription.constraints import Constraint, applies, constraints
from floatplan.planning.transcription.exchange import CAUTIOUS, FINE, local_minima, solve
from floatplan.planning.transcription.program import (
    FlightProgram,
    Objective,
    changes_at_ends,
    instants_beside_nodes,
    objective,
    watching,
)
from floatplan.planning.transcription.result import AttemptResult, best
from floatplan.planning.transcription.trajectory import (
    FlightModel,
    Sampling,
    Trajectory,
    flight_model,
    sample_ends,
    trajectory,
)
from floatplan.planning.transcription.variables import DecisionVariables, scaled_variables
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION
from floatplan.tolerances import EXCHANGE, QUADRATURE_ERROR, SETTINGS

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
        self.momentum = momentum or momentum_set(problem)
        self._ends_hold = False  # as far as is known
        self._path_is_clear = False
        self._starts: PreparedStarts | None = None
        self._is_followed = followed is not None
        if followed:
            self.plain_start, self._starts = followed
            self._learn(self._starts)

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
    def compiled(self) -> CompiledProblem | None:
        """The same for the kernel; None in space."""
        return compiled_problem(self.problem, self.model, self.constraints)

    @property
    def _level(self) -> int:
        return EXCHANGE.constrained_level if self.constraints else 0

    def raised(self, result: AttemptResult, degrees: tuple[int, ...]) -> Start:
        """Return the motion of an result as a start at higher degrees."""
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
        ends = sample_ends(self.model.nodes(0, start.variables.polynomials.form))
        motion = trajectory(self.model, start.variables, ends, start.x).at_goal()
        for block in self.constraints:
            if changes_at_ends(start.variables, block):
                continue
            values = block.values(motion)[-2:]
            exists = applies(block, motion.sampling.grid.s[-2:])
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
        if starts := self._starts_from(start):
            result = self._follow_compiled(starts, range(1), most_work, expired=stop())
        else:
            result = self._follow(start, lambda: self.model.work - before > most_work or stop())
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
        if starts := self._starts_from(plain):
            expired = stop()
            result = self._follow_compiled(starts, numbers, most_work, asks=asks, expired=expired)
            if not result.starts and not self.impossible:
                result = self._follow_compiled(starts, numbers, most_work, expired=expired)
        else:
            return self.attempt(plain, stop, most_work)
        result.work = self.model.work - before
        return result

    def _starts_from(self, start: Start) -> PreparedStarts | None:
        """Starts of which this one is number 0, prepared for the kernel; None where that knows no such flight."""
        if not (self._starts and self._starts.plain is start.x):
            self._starts = self.compiled.starts(start.variables, start.x, start.at_once) if self.compiled else None
        return self._starts

    def _follow_compiled(
        self, starts: PreparedStarts, numbers: range, most_work: float, *, asks: bool = False, expired: bool = False
    ) -> AttemptResult:
        """Follow starts in the kernel, unless the first one has been followed in a batch."""
        if self._is_followed:
            self._is_followed = False
        else:
            starts.follow(numbers, most_work, self.seed, asks=asks, expired=expired)
        self._learn(starts)
        result = starts.result(self.problem, self.model)
        self.model.work += result.work
        return result

    def _learn(self, starts: PreparedStarts) -> None:
        """Keep what the kernel said before it followed starts."""
        self._ends_hold |= starts.ends_hold
        self._path_is_clear |= starts.path_is_clear

    def _follow(self, start: Start, stop: Callable[[], bool]) -> AttemptResult:
        """Follow a start in space to the objective, and by way of a feasible motion where that fails."""
        model, variables, blocks = self.model, start.variables, self.constraints

        def make_objective(nodes: Sampling) -> Objective:
            return objective(self.problem, model, variables, nodes)

        def follow(x: Array) -> AttemptResult:
            settings = CAUTIOUS if blocks else FINE
            return judge(solve(model, variables, make_objective, blocks, x, settings, stop, self._level))

        def judge(solution: Solution[Trajectory]) -> AttemptResult:
            return self.judge(
                variables,
                solution.x,
                solution.status,
                iterations=solution.iterations,
                evaluations=solution.evaluations,
                known=solution.evaluation.detail,
            )

        def begins() -> Iterator[Array]:
            """The start, and the best motion without limits."""
            yield start.x
            yield solve(model, variables, make_objective, (), start.x, FINE, stop).x

        result = follow(start.x)
        if result.holds or stop() or not blocks:
            return result
        nodes = model.nodes(self._level, variables.polynomials.form)
        sampling = watching(nodes, blocks, instants_beside_nodes(variables, blocks))
        program = FlightProgram(model, variables, sampling, make_objective(nodes), blocks)
        for x in begins():
            nearest = reduce_violations(program, x, stop)
            unsolved = Solution(nearest.x, nearest.evaluation, "infeasible", 0, nearest.evaluations)
            promises = nearest.squared_violation < EXCHANGE.promising and not nearest.stuck
            other = follow(nearest.x) if promises else judge(unsolved)
            result = best([result, other])
            if result.holds or stop():
                break
        return result

    def judge(
        self,
        variables: DecisionVariables,
        x: Array,
        status: str,
        *,
        iterations: int = 0,
        evaluations: int = 0,
        known: Trajectory | None = None,
    ) -> AttemptResult:
        """Check (14) and the constraints of a motion x, between the instants too; it is ``known`` at some grid."""
        counts = self.model.flight.node_counts

        def at_level(level: int) -> Trajectory:
            nodes = self.model.nodes(level, variables.polynomials.form)
            return trajectory(self.model, variables, nodes, x)

        motion = known or at_level(max(self._level, EXCHANGE.compiled_level))
        level = max(motion.flown.level_needed(QUADRATURE_ERROR), self._level)
        if motion.model is not self.model or counts[level] > motion.sampling.grid.nodes:
            motion = at_level(level)
        while motion.flown.unresolved > SETTINGS.unresolved and level < len(counts) - 1:
            level += 1
            motion = at_level(level)
        missed = motion.flown.missed
        if motion.flown.unresolved > SETTINGS.unresolved:
            missed = np.inf
        worst = local_minima(self.model, variables, self.constraints, level, x)
        violation = missed if missed > ORIENTATION else 0.0
        if self.constraints:
            kept = -np.array([block.tolerance for block in self.constraints])[worst.block]
            violation = max(violation, float(-worst.value[worst.value < kept].min(initial=0.0)))
        if violation <= 0 and status == "infeasible":
            status = "feasible"  # kept, though not as well inside as the search aims
        result = AttemptResult(
            problem=self.problem,
            start_variables=variables,
            model=self.model,
            x=x,
            status=status,
            iterations=iterations,
            evaluations=evaluations,
            level=level,
            violation=violation,
            worst=worst,
            missed=motion.residual,
        )
        result.__dict__["motion"] = motion  # as if it had been asked for
        return result
