"""Problems of one kind in one call of the kernel: from the nominal motions, or from as many starts as they need.

They differ in numbers only, so that the structs of one of them are copied for all. What holds is a solution; the others
can have a search of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.structs import Pointer, Struct, StructArray, doubles
from floatplan.kernel.tolerances import MOST_STARTS
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.sine_polynomial import Form, SinePolynomials, boundary_arguments
from floatplan.planning.constraints import limit
from floatplan.planning.kernel_input.numbers import Numbers, key
from floatplan.planning.kernel_input.rows import SumRows
from floatplan.planning.kernel_problem import KernelProblem, Status
from floatplan.planning.options import ATTEMPTS, SearchOptions
from floatplan.planning.result import AttemptResult
from floatplan.planning.search import Search
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import DecisionVariables, Start, whitened
from floatplan.plans.plans import ALL_HOLDS, PlanEntry
from floatplan.problem.problem import Problem, shares_of_limits


@dataclass(frozen=True, eq=False)
class NominalMotions:
    """Motions of N problems without free coefficients, the arcsine on its first branch, as the variables of a search.

    Attributes
    ----------
    like : Problem
        One of them; they share joint ranges and degrees.
    free : (n,) int
        Free polynomials of the joints.
    duration, momentum, change : (N,) s, kg m^2/s, rad
        The last one is of the orientation.
    boundary : (N, n, 6)
        Of :class:`~floatplan.motion.sine_polynomial.SinePolynomials`.
    offset, scaling, offset_map : (N, ..)
        Of :class:`~floatplan.planning.variables.DecisionVariables`.
    x : (N, size)
    """

    like: Problem
    free: tuple[int, ...]
    duration: Array
    momentum: Array
    change: Array
    boundary: Array
    offset: Array
    scaling: Array
    offset_map: Array
    x: Array

    @classmethod
    def of(cls, numbers: Numbers) -> NominalMotions:
        """Return the motions of problems that differ in these numbers."""
        values = numbers.values
        like = numbers.like
        low, high = like.position_limits.T
        duration = values["duration"]
        orientation = values["orientation"]
        count = len(duration)
        n = len(low)
        p, rate, curvature = boundary_arguments(
            values["positions"],
            values["velocities"],
            values["accelerations"],
            (low + high) / 2,
            (high - low) / 2,
            np.zeros(n, np.int64),
        )
        time = duration[:, None, None]
        ends = np.empty((count, n, 2, 3))
        for order, argument in enumerate((p, time * rate, time**2 * curvature)):
            ends[..., order] = argument.swapaxes(1, 2)
        boundary = ends.reshape(count, n, CONDITIONS)
        free = tuple(degree - CONDITIONS + 1 for degree in like.degrees)
        is_one = count == 1 or bool((duration == duration[0]).all())
        durations = tuple(duration[: 1 if is_one else count].tolist())
        offset, scaling, offset_map = map(doubles, whitened(Form(max(free)), free, durations, boundary))
        return cls(
            like=like,
            free=free,
            duration=duration,
            momentum=numbers.angular_momentum(),
            change=orientation[:, 1] - orientation[:, 0],
            boundary=boundary,
            offset=offset,
            scaling=scaling,
            offset_map=offset_map,
            x=doubles(np.linalg.solve(scaling, -offset[..., None])[..., 0]),
        )

    def start(self, row: int) -> Start:
        """Return the motion of one of the problems as a start."""
        low, high = self.like.position_limits.T
        polynomials = SinePolynomials(
            centre=(low + high) / 2,
            amplitude=(high - low) / 2,
            duration=float(self.duration[row]),
            boundary=self.boundary[row],
            free=self.free,
        )
        momentum = MomentumSet(self.momentum[row : row + 1], np.empty((1, 0)))
        variables = DecisionVariables(
            polynomials, self.offset[row], self.scaling[row], momentum, offset_map=self.offset_map[row]
        )
        return Start(variables, self.x[row], at_once=True)


@dataclass(frozen=True, eq=False)
class StructRow:
    """One of several structs, which live as long."""

    pointer: Pointer
    rows: Struct | StructArray


@dataclass(eq=False)  # not frozen, for its speed: there is one for every plan without inequalities
class Batch:
    """N problems of which the kernel has followed starts, and can follow more.

    Attributes
    ----------
    template : KernelProblem
        Of one problem, from which they differ in numbers only.
    motions : PlainMotions
        Their nominal motions.
    searches, sampling, classes, constraints : structs (N,)
    x, branch, coefficients : (N, size), (N, n), (N, n, k+1)
        Their results, with b of (12).
    minima : three arrays (N, most)
    """

    template: KernelProblem
    motions: NominalMotions
    searches: StructArray
    sampling: StructArray
    classes: StructArray
    constraints: Struct | StructArray
    x: Array
    branch: IntArray
    coefficients: Array
    minima: tuple[IntArray, Array, Array]

    @classmethod
    def of(cls, template: KernelProblem, motions: NominalMotions, constraints: Struct | StructArray) -> Batch:
        """Copy the structs of one problem for those of the motions, with rows of their own."""
        count, n = motions.boundary.shape[:2]
        x = motions.x.copy()
        branch = np.zeros((count, n), np.int64)
        coefficients = np.empty((count, n, CONDITIONS + max(motions.free)))
        searches = StructArray([template.search], count)
        searches.give(plain=motions.x, x=x, coefficients=coefficients)
        classes = StructArray([template.motions], count)
        classes.give(
            duration=motions.duration,
            momentum=motions.momentum,
            change=motions.change,
            boundary=doubles(motions.boundary),
            offset=motions.offset,
            scaling=motions.scaling,
        )
        sampling = StructArray([template.sampling], count)
        sampling.give(branch=branch, offset_map=motions.offset_map)
        most = len(template.minima[0])
        minima = np.empty((count, most), np.int64), np.empty((count, most)), np.empty((count, most))
        return cls(template, motions, searches, sampling, classes, constraints, x, branch, coefficients, minima)

    def problem(self, row: int) -> KernelProblem:
        """One of the problems, whose structs and arrays are those of the batch."""
        number, s, least = self.minima
        return replace(
            self.template,
            start=self.motions.start(row),
            constraints=StructRow(self.constraints.pointer + row, self.constraints),
            motions=StructRow(self.classes.pointer + row, self.classes),
            search=StructRow(self.searches.pointer + row, self.searches),
            sampling=StructRow(self.sampling.pointer + row, self.sampling),
            x=self.x[row],
            branch=self.branch[row],
            coefficients=self.coefficients[row],
            minima=(number[row], s[row], least[row]),
        )

    def follow(self) -> None:
        """Follow starts of every problem, as the structs say."""
        whole = replace(
            self.template,
            constraints=self.constraints,
            motions=self.classes,
            search=self.searches,
            sampling=self.sampling,
        )
        whole.call(len(self.x))

    @property
    def solved(self) -> IntArray:
        """Those that need no more starts: the best of several holds, or the nominal motion led to the optimum."""
        status = self.status
        return np.flatnonzero(
            status == Status["optimal"] if self.template.rows.rows else status != Status["infeasible"]
        )

    @property
    def status(self) -> IntArray:
        """A ``Status`` of the kernel (N,)."""
        numbers = self.searches.numbers
        return np.where(numbers["violation"] <= 0, numbers["status"], Status["infeasible"])

    @property
    def residual(self) -> Array:
        """By how much (N,) they miss the goal, rad; infinite where the nodes do not resolve the motion."""
        numbers = self.searches.numbers
        return np.where(numbers["violation"] < np.inf, np.abs(numbers["missed"][:, 0]), np.inf)

    def answer(self, row: int) -> PlanEntry | None:
        """Where the best start of one of them led; None where that is no plan."""
        search = self.searches.pointer[row]
        if not search.violation <= 0:  # which may be no number
            return None
        b = self.coefficients[row]
        return PlanEntry(
            status=Status(search.status).name,
            objective=search.objective if search.wanted else float(np.linalg.norm(b)),
            angular_momentum=float(self.motions.momentum[row]),
            residual=abs(search.missed[0]),
            coefficients=b,
            evaluations=search.evaluations,
            iterations=search.iterations,
            starts=search.started,
            solved=search.solved,
            message=ALL_HOLDS if self.template.rows.rows else "",
        )

    def result(self, row: int, problem: Problem) -> AttemptResult:
        """What came of the starts of one of the problems."""
        own = self.problem(row)
        return own.result(FlightSpec(problem, own.start.variables.momentum))

    def search(self, row: int, problem: Problem, options: SearchOptions) -> Search:
        """A search of one of the problems, whose first attempt was in the batch."""
        own = self.problem(row)
        return Search(problem, options, FlightSpec(problem, own.start.variables.momentum), batched=own)


@dataclass(frozen=True)
class _Kind:
    """What problems without inequalities share that are planned in one batch, and one of them."""

    key: tuple[Any, ...]
    problem: Problem = field(compare=False)


@lru_cache(maxsize=32)
def _template(kind: _Kind) -> KernelProblem:
    """Return one of the problems of a kind for the kernel: any of them serves all."""
    motions = NominalMotions.of(Numbers.of_problems([kind.problem]))
    return KernelProblem.of(FlightSpec(kind.problem), motions.start(0))


def follow_unconstrained(problem: Problem, numbers: Numbers, wanted: int, seed: int) -> Batch:
    """Follow starts of problems without inequalities, as ``problem``, until so many of every one are solved."""
    template = _template(_Kind(key(problem), problem))
    motions = NominalMotions.of(numbers)
    count = len(motions.x)
    struct = template.rows.struct
    batch = Batch.of(template, motions, struct if count == 1 else StructArray([struct], count))
    batch.searches.give(count=min(MOST_STARTS + wanted - 1, ATTEMPTS), wanted=wanted, most_work=np.inf)
    batch.sampling.give(seed=seed)
    batch.follow()
    return batch


def follow_batch(spec: FlightSpec, numbers: Numbers, most_work: float) -> Batch:
    """Follow the nominal motions of problems with inequalities, which that of ``spec`` is one of."""
    motions = NominalMotions.of(numbers)
    count = len(motions.x)
    template = KernelProblem.of(spec, motions.start(0))
    constraints = StructArray([spec.rows.struct], count)
    constraints.give(path=doubles(numbers.paths()), **_of_constraints(spec, numbers, count))
    batch = Batch.of(template, motions, constraints)
    batch.classes.give(orientation=numbers.values["orientation"][:, 0])
    thickness = np.full(count, np.inf)
    for row, obstacles in enumerate(numbers.obstacles):
        for obstacle in obstacles:
            thickness[row] = min(thickness[row], obstacle.thickness)
    minima = StructArray([template.minima_struct], count)
    number, s, least = batch.minima
    minima.give(row=number, s=s, value=least)
    batch.searches.give(
        count=1,
        most_work=most_work,
        thickness=thickness,
        reach=spec.flight.central_reach,  # to examine first whether there is a chance
        minima=minima,
    )
    batch.follow()
    return batch


def _of_constraints(spec: FlightSpec, numbers: Numbers, count: int) -> dict[str, Array]:
    """What of the rows every problem has for itself: obstacles, the margins to them, limits."""
    rows = spec.rows
    members: dict[str, Array] = {}
    if numbers.obstacles:
        margins = np.empty((count, len(numbers.obstacles[0])))
        for margins_of_one, obstacles in zip(margins, numbers.obstacles, strict=True):
            margins_of_one[:] = [obstacle.margin for obstacle in obstacles]
        margin = np.tile(rows.margin, (count, 1))
        of_obstacles = np.diff(rows.block_first)[: margins.shape[1]]
        margin[:, : of_obstacles.sum()] = np.repeat(margins, of_obstacles, axis=1)
        members = {"obstacles": doubles(numbers.obstacle_numbers()), "margin": margin}
    if numbers.limits and numbers.limits is not numbers.like:
        sums = [np.empty((count, 0, rows.sums.terms))]
        for shares in shares_of_limits(numbers.limits):
            of_limit = limit(shares, spec.flight).rows
            assert isinstance(of_limit, SumRows), "limits are of sums"
            own = rows.sums.rows(of_limit)
            sums.append(np.broadcast_to(own, (count, *own.shape[-2:])))
        members["sums"] = doubles(np.concatenate(sums, axis=1))
    return members
