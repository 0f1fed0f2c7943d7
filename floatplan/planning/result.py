"""The results of an attempt, which is one call of the kernel with one start or several, and of a search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import SinePolynomials, WrittenMotion, basis
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import DecisionVariables, decision_variables
from floatplan.plans.plan import Plan
from floatplan.plans.plans import PlanEntry
from floatplan.problem.reference import REFERENCE_NODES, distance_from


@dataclass(frozen=True, eq=False)
class Worst:
    """Local minima of constraint rows over time: ``block``, ``row``, ``s``, ``value`` (L,)."""

    block: IntArray
    row: IntArray
    s: Array
    value: Array

    @property
    def least(self) -> float:
        """The lowest value; infinite where nothing is near."""
        return float(self.value.min(initial=np.inf))

    @property
    def lowest(self) -> tuple[int, int, float, float]:
        """Block, row, value and s of the lowest, where there is one."""
        index = int(np.argmin(self.value))
        return int(self.block[index]), int(self.row[index]), float(self.value[index]), float(self.s[index])


@dataclass(eq=False)
class Work:
    """Work that was done, instants of one body: a measure without a clock, the same on every machine, busy or quiet.

    Where plans are compared or repeated, a search must end at the same place each time; the instants evaluated cost
    nearly all of its time.
    """

    done: float = 0.0

    def evaluated(self, instants: float, entries: int | None = None) -> None:
        """Count the evaluation of a motion at so many instants of one body, and of a Jacobian of so many entries."""
        self.done += EXCHANGE.evaluation + instants
        if entries is not None:
            self.done += EXCHANGE.differentiation + EXCHANGE.entry * entries


@dataclass(eq=False)
class AttemptResult:
    """The best motion that an attempt led to.

    Attributes
    ----------
    spec : FlightSpec
    start_variables : DecisionVariables
        Of the motions of the start; those of the result are ``variables``.
    x : (size,)
        The motion.
    status : "optimal", "feasible" or "infeasible"
    iterations, evaluations : of all starts
    level : of the grid that the motion was judged on
    violation : rad, or of a row's scale
        The largest one of (14) or of a constraint's row; 0 where everything holds.
    worst : local minima of the constraints' rows
    residual : (e,) rad
        Residual of (14), with its sign.
    work : instants of one body
        What the attempt took, the sampling of its starts included.
    starts, solved : number of starts, and of those whose motions hold
    coefficients : (n, k+1), optional
        b of (12), powers of t in seconds, where the kernel has computed them.
    integral : float, optional
        The objective, where it is an integral that the kernel has computed.
    branch : (n,), optional
        Of the arcsine at landing, against that of ``start_variables``; None where it is the same.
    """

    spec: FlightSpec
    start_variables: DecisionVariables
    x: Array
    status: str
    iterations: int
    evaluations: int
    level: int
    violation: float
    worst: Worst
    residual: Array = field(default_factory=lambda: np.array([np.nan]))
    work: float = 0.0
    starts: int = 1
    solved: int = 1
    coefficients: Array | None = None
    integral: float | None = None
    branch: IntArray | None = None

    @property
    def holds(self) -> bool:
        """Whether (14) and every constraint hold."""
        return self.violation <= 0

    @property
    def is_optimal(self) -> bool:
        """Whether it holds, and no motion near it costs less."""
        return self.holds and self.status == "optimal"

    @property
    def is_exhaustive(self) -> bool:
        """Whether one call of the kernel has followed several starts: without rows, as many as promise anything."""
        return self.starts > 1

    @cached_property
    def variables(self) -> DecisionVariables:
        """How x makes the motion."""
        if self.branch is None:
            return self.start_variables
        branches = np.stack((np.zeros_like(self.branch), self.branch))
        degrees = self.start_variables.degrees
        momentum = self.start_variables.momentum
        return decision_variables(self.spec.problem, degrees, branches, momentum)

    @property
    def motion(self) -> tuple[SinePolynomials, Array, Array]:
        """The motion: a class of motions, their free coefficients z (n, width), and h (e,), kg m^2/s."""
        variables = self.variables
        x = self.x
        h = variables.angular_momentum(x)
        return variables.motion_class(h), variables.free_coefficients(x), h

    @cached_property
    def written(self) -> Array:
        """Coefficients b (n, k+1) of (12), powers of t in seconds."""
        if self.coefficients is not None:
            return self.coefficients
        motions, z, _ = self.motion
        return motions.powers_of_seconds(z)

    @cached_property
    def objective_value(self) -> float:
        """The user's objective, which compares motions of any degree and branch."""
        if self.integral is not None:
            return self.integral
        if self.spec.problem.reference is not None:
            return self._distance_from(self.spec.problem.reference)
        if self.spec.problem.minimises_b:
            return float(np.linalg.norm(self.written))
        if self.spec.problem.motion.objective == "robust":
            return self._robust_size()
        return float(np.linalg.norm(self.x[: self.variables.coefficients]))

    def _robust_size(self) -> float:
        """The objective "robust", rad."""
        from floatplan.motion.spatial.whole import SpatialMotion  # here, because flights in a plane do without

        problem = self.spec.problem
        motions, z, h = self.motion
        joints = WrittenMotion.from_powers(motions.centre, motions.amplitude, self.written, problem.flight.duration)
        whole = self.spec.flight.whole_motion(joints, h, problem.path)
        assert isinstance(whole, SpatialMotion), "the robot flies in space"
        return whole.robust_size(float(np.linalg.norm(z)))

    def _distance_from(self, reference: Array) -> float:
        """Root mean square, rad, of the joints' differences from a recorded motion (K, n)."""
        motions, z, _ = self.motion
        grid = gauss_legendre(REFERENCE_NODES)
        values = basis(motions.form).values(grid.nodes)
        positions = motions.motion(z, values).positions
        return distance_from(reference, grid.nodes, grid.weights, positions)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What came of a search: its attempts, and why there were no more of them.

    Attributes
    ----------
    spec : FlightSpec
        The problem.
    seed : of the random starts
    results : sequence of AttemptResult
        In the order of the attempts.
    impossible : list of str
        Sentences about why no motion whatever can be a plan, as far as that is proved, where there is none.
    ran_out_of_time, ran_out_of_patience, interrupted : bool
        Why there are no more.
    other_momentum : (e,) kg m^2/s, optional
        An h with which there is a plan, where the fixed one led to none.
    seconds : float
        What the search took.
    """

    spec: FlightSpec
    seed: int
    results: Sequence[AttemptResult]
    impossible: Sequence[str] = ()
    ran_out_of_time: bool = False
    ran_out_of_patience: bool = False
    interrupted: bool = False
    other_momentum: Array | None = None
    seconds: float = 0.0

    @cached_property
    def best(self) -> AttemptResult:
        """The result of the least violation, of equals the best, the first of these; others have no objective.

        Of several with the same motion it is one that is optimal.
        """
        least = min(result.violation for result in self.results)
        nearest = [result for result in self.results if result.violation == least]
        if len(nearest) == 1:
            return nearest[0]
        lowest = min(nearest, key=lambda result: result.objective_value)
        most = lowest.objective_value + EXCHANGE.same * abs(lowest.objective_value)
        same = (result for result in nearest if result.is_optimal and result.objective_value <= most)
        return lowest if lowest.is_optimal else min(same, key=lambda result: result.objective_value, default=lowest)

    @cached_property
    def holding(self) -> tuple[AttemptResult, ...]:
        """All that hold, in the order of their objectives, which a single one need not have evaluated."""
        holding = [result for result in self.results if result.holds]
        return tuple(sorted(holding, key=lambda result: result.objective_value) if len(holding) > 1 else holding)

    @property
    def counts(self) -> dict[str, int]:
        """Starts and those solved, iterations of the solver and motions evaluated, in all attempts."""
        return {
            "iterations": sum(result.iterations for result in self.results),
            "evaluations": sum(result.evaluations for result in self.results),
            "starts": sum(result.starts for result in self.results),
            "solved": sum(result.solved for result in self.results if result.holds),
        }


@dataclass(frozen=True, eq=False)
class SearchedPlan:
    """A plan, and the attempt that it was made of.

    Attributes
    ----------
    plan : Plan
    result : AttemptResult, or a function that makes it where most do without
    others : further solutions, from the second best on
    gave_up : whether the search's patience ended: a longer one may find another plan
    work : instants of one body, of the whole search
    """

    plan: Plan
    result: AttemptResult | Callable[[], AttemptResult]
    others: tuple[AttemptResult, ...] = ()
    gave_up: bool = False
    work: float = 0.0

    @property
    def answer(self) -> PlanEntry:
        """In numbers."""
        return PlanEntry.of_plan(self.plan, self.plan.status)

    @cached_property
    def best(self) -> AttemptResult:
        """The attempt that the plan was made of."""
        return self.result() if callable(self.result) else self.result


def count_starts(results: Sequence[AttemptResult]) -> int:
    """How many starts there were."""
    return sum(result.starts for result in results)


def summary(results: Sequence[AttemptResult]) -> str:
    """The last attempt in a line: number, degree, end, what it violates most, and the least violation so far."""
    result = results[-1]
    spec = result.spec
    degrees = " to ".join(map(str, sorted(set(result.variables.degrees))))
    start = count_starts(results)
    steps = f"start {start}, degree {degrees}, {result.iterations} steps"
    least = f"best violation {min(attempt.violation for attempt in results):.3g}"
    if result.holds:
        return f"{steps}; {result.status}, {spec.problem.motion.objective} {result.objective_value:.6g}; {least}"
    if result.violation == np.inf:
        return f"{steps}; no motion to the goal"
    of = " rad of the goal's orientation"
    if -result.worst.least >= result.violation:
        block, row, _, s = result.worst.lowest
        of = f" of {spec.constraints[block].labels[row]} at {s * spec.problem.flight.duration:.3g} s"
    return f"{steps}; violation {result.violation:.3g}{of}; {least}"
