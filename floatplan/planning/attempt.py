"""One start followed to its end: feasible first where need be, then to the objective, then judged.

Attempts depend on the problem, the degrees, the seed and their own number alone, so that they can run in any process
and the answer is the same for the same seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.batch import EASY_ITERATIONS, FINE, QUADRATURE_ERROR, UNRESOLVED
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import momentum_set
from floatplan.optimization.feasibility import LeastViolation, reduce_violations
from floatplan.optimization.sqp import Solution
from floatplan.planning.compiled import Compiled, Followed, compiled_solution, solution_of
from floatplan.planning.starts import Start, starts
from floatplan.planning.transcription.asked import constraints
from floatplan.planning.transcription.constraints import Constraint
from floatplan.planning.transcription.exchange import Worst, local_minima, solve
from floatplan.planning.transcription.objectives import Objective, objective_value
from floatplan.planning.transcription.program import (
    FlightProgram,
    instants_beside_nodes,
    objective,
    scaled_variables,
    watching,
)
from floatplan.planning.transcription.trajectory import (
    FlightModel,
    Sampling,
    Trajectory,
    flight_model,
    trajectory,
)
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION
from floatplan.tables import Objective as ObjectiveName

CONSTRAINED_LEVEL = 2  # level of grids, at least, where constraints are watched
SMALLEST_STEP = 0.02  # m, that a link may travel between two nodes even beside a smaller obstacle
CLOSER = 2  # levels of grids, by which constraints are watched more closely after the plain start
WATCHED_AT_MOST = 6  # level of grids
ATTEMPTS = 300  # [-] most starts tried at each degree
PROMISING = 1e-3  # sum of squared violations below which a motion is worth following to the objective
CAUTIOUS = replace(FINE, longest_step=0.2)  # with obstacles a long step lands beyond them


@dataclass(eq=False)
class Outcome:
    """Where an attempt ended.

    ``violation`` is the largest one of (14), rad, or of a constraint's row; 0 where everything holds. ``objective``
    names what is minimised; ``work`` is what the attempt took, the drawing of its start included. ``starts`` were
    followed together, of which ``solved`` hold. ``coefficients`` are b (n, k+1), where what solved it has written them.
    """

    variables: DecisionVariables
    solution: Solution[Trajectory]
    violation: float
    worst: Worst
    number: int
    degrees: tuple[int, ...]
    objective: ObjectiveName
    work: float = 0.0
    starts: int = 1
    solved: int = 1
    coefficients: Array | None = None

    @property
    def holds(self) -> bool:
        """Whether (14) and every constraint hold."""
        return self.violation <= 0

    @property
    def is_optimal(self) -> bool:
        """Whether it holds, and no motion beside it costs less."""
        return self.holds and self.solution.status == "optimal"

    @property
    def converged_quickly(self) -> bool:
        """Whether it is optimal, and took so few iterations that other starts promise little."""
        return self.is_optimal and self.solution.iterations <= EASY_ITERATIONS

    @cached_property
    def objective_value(self) -> float:
        """The user's objective, which compares motions of any degree and branch."""
        motion = self.solution.evaluation.detail
        return objective_value(self.objective, motion, self.solution.x)

    @property
    def rank(self) -> tuple[float, float]:
        """Sorts outcomes: what holds before what does not, then by objective."""
        return (self.violation, self.objective_value)


def best(outcomes: Sequence[Outcome]) -> Outcome:
    """Return the outcome of the lowest rank, the first of equals; objectives are evaluated only of equal violations."""
    least = min(outcome.violation for outcome in outcomes)
    nearest = [outcome for outcome in outcomes if outcome.violation == least]
    return min(nearest, key=lambda outcome: outcome.objective_value) if len(nearest) > 1 else nearest[0]


class Attempts:
    """A problem made ready for attempts; ``momentum`` left out, those of the problem."""

    def __init__(self, problem: Problem, seed: int, momentum: MomentumSet | None = None) -> None:
        self.problem = problem
        self.model: FlightModel = flight_model(problem)
        self.constraints: tuple[Constraint, ...] = constraints(problem, self.model)
        self.momentum = momentum or momentum_set(problem)
        self.seed = seed
        self._drawn: dict[tuple[int, ...], tuple[list[Start], Iterator[Start]]] = {}
        (self.plain_start,) = self.first_starts(problem.degrees, 1)
        self._level = self._watching_level() if self.constraints else 0

    def first_starts(self, degrees: tuple[int, ...], count: int) -> list[Start]:
        """Return the first starts at these degrees: so many, or all where there are not so many."""
        if degrees not in self._drawn:
            drawing = starts(self.problem, self.model, self.constraints, degrees, self.momentum, self.seed)
            self._drawn[degrees] = ([], drawing)
        known, more = self._drawn[degrees]
        known.extend(islice(more, max(count - len(known), 0)))
        return known[:count]

    def raised(self, outcome: Outcome, degrees: tuple[int, ...]) -> Start:
        """Return the motion of an outcome as a start at higher degrees."""
        lower, x = outcome.variables, outcome.solution.x
        rise = zip(lower.polynomials.free, degrees, outcome.degrees, strict=True)
        polynomials = replace(lower.polynomials, free=tuple(free + new - old for free, new, old in rise))
        variables = scaled_variables(self.problem, polynomials, self.momentum, lower.following)
        z = lower.free_coefficients(x)
        padded = np.pad(z, ((0, 0), (0, polynomials.width - z.shape[1])))
        return Start(variables, variables.variables(padded, lower.angular_momentum(x)))

    def _watching_level(self) -> int:
        """Level of grids for the constraints: no link may jump over an obstacle between two nodes.

        The plain motion tells how far the links travel.
        """
        sizes = [obstacle.thickness for obstacle in self.problem.obstacles]
        plain = self.plain_start
        counts = self.model.flight.node_counts
        dense = self.model.nodes(-2, plain.variables.polynomials.form)
        motion = trajectory(self.model, plain.variables, dense, plain.x)
        wanted = motion.flown.longest_way / max(min(sizes, default=np.inf), SMALLEST_STEP)
        return min(
            (level for level, count in enumerate(counts) if count >= wanted and level >= CONSTRAINED_LEVEL),
            default=WATCHED_AT_MOST,
        )

    def attempt(
        self,
        start: Start,
        number: int,
        degrees: tuple[int, ...],
        stop: Callable[[], bool] = lambda: False,
        most_work: float = np.inf,
    ) -> Outcome:
        """Follow one start; from when it is stopped, or has done the most work, it takes what it has."""
        before = self.model.work.done - start.work
        outcome = self._follow(start, number, degrees, lambda: self.model.work.done - before > most_work or stop())
        outcome.work = self.model.work.done - before
        return outcome

    def outcome_of(self, followed: Followed) -> Outcome:
        """Return the best of the starts that the kernel has followed together."""
        before, degrees = self.model.work.done, self.problem.degrees
        found = solution_of(followed, self.problem, self.model, self.plain_start.variables, degrees)
        outcome = self._judge_compiled(found, 0, degrees)
        outcome.work = self.model.work.done - before
        outcome.starts, outcome.solved = found.starts, found.solved
        return outcome

    def _follow(self, start: Start, number: int, degrees: tuple[int, ...], stop: Callable[[], bool]) -> Outcome:
        """Follow a start straight to the objective, and by way of a feasible motion where that fails."""
        is_first = number == 0 or start.is_plain
        settings = FINE if is_first and not self.constraints else CAUTIOUS
        level = self._level if is_first or not self.constraints else min(self._level + CLOSER, WATCHED_AT_MOST)
        make_objective = self._objective(start)

        def follow(x: Array) -> Outcome:
            solution = solve(self.model, start.variables, make_objective, self.constraints, x, settings, stop, level)
            return self._judge(start.variables, solution, number, degrees)

        if not self.constraints:
            compiled = compiled_solution(self.problem, self.model, start, degrees, settings.longest_step)
            return self._judge_compiled(compiled, number, degrees) if compiled else follow(start.x)
        outcome = follow(start.x) if is_first else None
        if outcome and (outcome.holds or stop()):
            return outcome
        nodes = self.model.nodes(level, start.variables.polynomials.form)
        beside = instants_beside_nodes(start.variables, self.constraints)
        sampling = watching(nodes, self.constraints, beside)
        program = FlightProgram(self.model, start.variables, sampling, make_objective(nodes), self.constraints)
        for nearest in self._nearly_feasible(start, program, is_first, stop):
            if nearest.squared_violation < PROMISING:
                found = follow(nearest.x)
            else:
                unsolved = Solution(nearest.x, nearest.evaluation, "infeasible", 0, nearest.evaluations)
                found = self._judge(start.variables, unsolved, number, degrees)
            outcome = best([outcome, found]) if outcome else found
            if outcome.holds or stop():
                break
        assert outcome is not None, "every start gives a point to follow"
        return outcome

    def _objective(self, start: Start) -> Callable[[Sampling], Objective]:
        """What makes the objective for a sampling."""
        return lambda nodes: objective(self.problem, self.model, start.variables, nodes)

    def _nearly_feasible(
        self, start: Start, program: FlightProgram, is_first: bool, stop: Callable[[], bool]
    ) -> Iterator[LeastViolation[Trajectory]]:
        """Motions that violate little: from the start; from the plain one also by way of the best without limits."""
        yield reduce_violations(program, start.x, stop)
        if not is_first:
            return
        free = solve(self.model, start.variables, self._objective(start), (), start.x, FINE, stop)
        yield reduce_violations(program, free.x, stop)

    def _judge_compiled(self, found: Compiled, number: int, degrees: tuple[int, ...]) -> Outcome:
        """Check the kernel's solution; its b counts where that holds: far from one, b may be of another x."""
        outcome = self._judge(found.variables, found.solution, number, degrees)
        if outcome.holds:
            outcome.coefficients = found.coefficients
        return outcome

    def _judge(
        self, variables: DecisionVariables, solution: Solution[Trajectory], number: int, degrees: tuple[int, ...]
    ) -> Outcome:
        """Check (14) and the constraints, between the instants too."""
        motion, counts = solution.evaluation.detail, self.model.flight.node_counts
        level = max(motion.flown.level_needed(QUADRATURE_ERROR), self._level)

        def at_level(level: int) -> Trajectory:
            nodes = self.model.nodes(level, variables.polynomials.form)
            return trajectory(self.model, variables, nodes, solution.x)

        if motion.model is not self.model or counts[level] > motion.sampling.nodes:
            motion = at_level(level)
        while motion.flown.unresolved > UNRESOLVED and level < len(counts) - 1:  # the level was foretold from few nodes
            level += 1
            motion = at_level(level)
        missed = max(map(abs, motion.residual[0].tolist()))
        if motion.flown.unresolved > UNRESOLVED:
            missed = np.inf
        worst = local_minima(self.model, variables, self.constraints, level, solution.x, motion)
        violation = missed if missed > ORIENTATION else 0.0
        if self.constraints:
            kept = -np.array([block.tolerance for block in self.constraints])[worst.block]
            violation = max(violation, float(-worst.value[worst.value < kept].min(initial=0.0)))
        if violation <= 0 and solution.status == "infeasible":
            solution = replace(solution, status="feasible")  # kept, though not as well inside as the search aims
        return Outcome(variables, solution, violation, worst, number, degrees, self.problem.motion.objective)
