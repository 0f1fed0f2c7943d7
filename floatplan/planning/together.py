"""Problems that go together: of each the kernel follows the plain motion, or so many starts as it needs, in one call.

They differ from one that is made ready for attempts in numbers alone. What holds is an answer; the others are ready for
more starts.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.attempts import INFEASIBLE, OPTIMAL, STATUS, powers_of_basis
from floatplan.compiled.constraints import CompiledConstraints
from floatplan.compiled.numbers import Numbers, Rows, key
from floatplan.kernel.structs import Struct, StructRows, doubles
from floatplan.kernel.tolerances import MOST_STARTS
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.planning.attempt import ATTEMPTS, Attempts
from floatplan.planning.starts import Start
from floatplan.planning.transcription.compiled_attempt import (
    CompiledProblem,
    Inputs,
    MinimaArrays,
    PreparedStarts,
)
from floatplan.planning.transcription.constraints import Limit
from floatplan.planning.transcription.result import AttemptResult
from floatplan.planning.transcription.variables import DecisionVariables, whitened
from floatplan.plans.plans import ALL_HOLDS, Answer
from floatplan.problem.problem import Problem, shares_of_limits


@dataclass(frozen=True, eq=False)
class Alike:
    """What problems that go together share, as the kernel takes it: the structs of one, which the others copy."""

    prepared: Attempts
    compiled: CompiledProblem
    inputs: Inputs
    powers: Struct
    constraints: StructRows
    attempt: Struct
    motions: Struct
    draws: Struct

    @classmethod
    def of(cls, prepared: Attempts) -> Alike:
        """Of a problem prepared for attempts."""
        compiled, variables = prepared.compiled, prepared.plain_start.variables
        inputs, motions = compiled.inputs(variables)
        branch = np.empty(len(variables.polynomials.free), np.int64)
        return cls(
            prepared=prepared,
            compiled=compiled,
            inputs=inputs,
            powers=powers_of_basis(variables.polynomials.width),
            constraints=StructRows(compiled.watch.struct, 1),
            attempt=compiled.attempt_struct(variables, np.empty(variables.size), True),
            motions=motions,
            draws=compiled.draws_struct(variables, branch),
        )


@dataclass(eq=False)  # not frozen, for its speed: there is one for every plan without inequalities
class BatchedStarts:
    """N problems of which the kernel has followed starts, each prepared for further ones.

    Attributes
    ----------
    alike : Alike
        Of one problem, from which they differ in numbers alone.
    rows : Rows
    offset, scaling, offset_map : (N, ..)
        Of each problem's variables.
    attempts, draws, motions, constraints : StructRows
    plain, x : (N, size)
        Where each began, and ended.
    branch : (N, n)
    minima : MinimaArrays
    coefficients : (N, n, k+1)
        b of (12).
    """

    alike: Alike
    rows: Rows
    offset: Array
    scaling: Array
    offset_map: Array
    attempts: StructRows
    draws: StructRows
    motions: StructRows
    constraints: StructRows
    plain: Array
    x: Array
    branch: IntArray
    minima: MinimaArrays
    coefficients: Array

    def follow(self) -> None:
        """Follow starts of each problem."""
        alike = self.alike
        inputs = alike.inputs
        kernel = alike.compiled.watch.kernel
        no_memory = kernel.attempt(
            *inputs.flying,
            self.constraints.pointer,
            self.motions.pointer,
            inputs.levels,
            inputs.settings,
            inputs.rules,
            alike.powers.pointer,
            self.attempts.pointer,
            self.draws.pointer,
            len(self.plain),
            kernel.instructions,
        )
        if no_memory:
            raise MemoryError("no memory to follow starts")

    @property
    def solved(self) -> IntArray:
        """Those that need no more starts: the best of several holds, or the plain motion led to the optimum."""
        status = self.status
        return np.flatnonzero(status == OPTIMAL if self.alike.prepared.constraints else status != INFEASIBLE)

    @property
    def status(self) -> IntArray:
        """INFEASIBLE, FEASIBLE or OPTIMAL (N,)."""
        numbers = self.attempts.numbers
        return np.where(numbers["violation"] <= 0, numbers["status"], INFEASIBLE)

    @property
    def residual(self) -> Array:
        """By how much (N,) each misses the goal, rad; infinite where the nodes do not resolve the motion."""
        numbers = self.attempts.numbers
        return np.where(numbers["violation"] < np.inf, np.abs(numbers["missed"][:, 0]), np.inf)

    def holds(self, row: int) -> bool:
        """Whether the best start of one of them led to a plan."""
        return bool(self.attempts.row(row).violation <= 0)

    def answer(self, row: int) -> Answer:
        """Where the best start of one that is solved led."""
        b = self.coefficients[row]
        attempt = self.attempts.row(row)
        return Answer(
            status=STATUS[attempt.status],
            objective=attempt.objective if attempt.wanted else float(np.linalg.norm(b)),
            angular_momentum=float(self.rows.momentum[row]),
            residual=abs(attempt.missed[0]),
            coefficients=b,
            evaluations=attempt.evaluations,
            iterations=attempt.iterations,
            starts=attempt.started,
            solved=attempt.solved,
            message=ALL_HOLDS if self.alike.prepared.constraints else "",
        )

    def result(self, row: int, problem: Problem, seed: int) -> AttemptResult:
        """What came of the starts of one of the problems."""
        prepared = self.prepared(row, problem, seed)
        return prepared.attempt(prepared.plain_start)

    def prepared(self, row: int, problem: Problem, seed: int) -> Attempts:
        """One of the problems, prepared for attempts, of which the first is done."""
        alike = self.alike
        momentum = MomentumSet(self.rows.momentum[row : row + 1], np.empty((1, 0)))
        polynomials = replace(
            alike.prepared.plain_start.variables.polynomials,
            duration=float(self.rows.duration[row]),
            boundary=self.rows.boundary[row],
        )
        variables = DecisionVariables(
            polynomials, self.offset[row], self.scaling[row], momentum, offset_map=self.offset_map[row]
        )
        inputs = replace(alike.inputs, constraints=self.constraints.row(row), motions=self.motions.row(row))
        start = Start(variables, self.plain[row], at_once=True)
        starts = PreparedStarts(
            compiled=alike.compiled,
            variables=variables,
            plain=start.x,  # by which attempts know that it is the same
            inputs=inputs,
            powers=alike.powers.pointer,
            attempt=self.attempts.row(row),
            draws=self.draws.row(row),
            x=self.x[row],
            branch=self.branch[row],
            minima=self.minima[row],
            coefficients=self.coefficients[row],
            kept=self,
        )
        prepared = Attempts(problem, seed, momentum, (start, starts))
        if not starts.attempt.violation <= 0:
            prepared.prepare()
        return prepared


@dataclass(frozen=True)
class _Kind:
    """What problems without inequalities share that are followed together, and one of them."""

    key: tuple[Any, ...]
    problem: Problem = field(compare=False)


@lru_cache(maxsize=32)
def _alike(kind: _Kind) -> Alike:
    """Return what the problems of a kind share: any of them serves all."""
    return Alike.of(Attempts(kind.problem, 0))


def follow_unconstrained(problem: Problem, numbers: Numbers, wanted: int, seed: int) -> BatchedStarts:
    """Follow starts of problems without inequalities, which ``problem`` is one of, until so many of each are solved."""
    alike = _alike(_Kind(key(problem), problem))
    most = min(MOST_STARTS + wanted - 1, ATTEMPTS)
    rows = numbers.rows()
    count = len(rows.duration)
    attempts = StructRows(alike.attempt, count)
    attempts.set_numbers(count=most, wanted=wanted, most_work=np.inf)
    constraints = alike.constraints if count == 1 else StructRows(alike.compiled.watch.struct, count)
    return _follow(alike, rows, attempts, constraints, MinimaArrays.empty(count, 0), seed=seed)


def follow_batch(like: Attempts, numbers: Numbers, most_work: float) -> BatchedStarts:
    """Follow the plain motions of problems with inequalities; each as if it were alone."""
    alike = Alike.of(like)
    compiled, rows = alike.compiled, numbers.rows()
    count = len(rows.duration)
    arrays = MinimaArrays.empty(count, compiled.most_minima)

    attempts = StructRows(alike.attempt, count)
    attempts.set_numbers(count=1, most_work=most_work, thickness=_thickness(numbers, count))
    attempts.set_numbers(reach=compiled.reach)  # it is asked first whether there is a chance
    attempts.set_structs(minima=_minima_rows(compiled, arrays, count))

    constraints = StructRows(compiled.watch.struct, count)
    constraints.point_to(path=doubles(numbers.paths()), **_of_constraints(compiled, numbers, count))
    return _follow(alike, rows, attempts, constraints, arrays, orientation=numbers.values["orientation"][:, 0])


def _follow(
    alike: Alike,
    rows: Rows,
    attempts: StructRows,
    constraints: StructRows,
    minima: MinimaArrays,
    seed: int = 0,
    orientation: Array | float = 0.0,
) -> BatchedStarts:
    """Follow starts of problems, each as if it were alone; the orientation at takeoff (N,) matters to rows alone."""
    polynomials = alike.prepared.plain_start.variables.polynomials
    count, n = rows.boundary.shape[:2]
    durations = tuple(rows.duration[: 1 if count == 1 or (rows.duration == rows.duration[0]).all() else count].tolist())
    offset, scaling, offset_map = map(doubles, whitened(polynomials.form, polynomials.free, durations, rows.boundary))
    plain = doubles(np.linalg.solve(scaling, -offset[..., None])[..., 0])
    x = plain.copy()
    branch = np.zeros((count, n), np.int64)
    coefficients = np.empty((count, n, CONDITIONS + polynomials.width))
    attempts.point_to(plain=plain, x=x, coefficients=coefficients)

    motions = StructRows(alike.motions, count)
    motions.set_numbers(duration=rows.duration, momentum=rows.momentum, change=rows.change, orientation=orientation)
    motions.point_to(boundary=doubles(rows.boundary), offset=offset, scaling=scaling)

    draws = StructRows(alike.draws, count)
    draws.set_numbers(seed=seed)
    draws.point_to(branch=branch, offset_map=offset_map)

    followed = BatchedStarts(
        alike=alike,
        rows=rows,
        offset=offset,
        scaling=scaling,
        offset_map=offset_map,
        attempts=attempts,
        draws=draws,
        motions=motions,
        constraints=constraints,
        plain=plain,
        x=x,
        branch=branch,
        minima=minima,
        coefficients=coefficients,
    )
    followed.follow()
    return followed


def _minima_rows(compiled: CompiledProblem, arrays: MinimaArrays, count: int) -> StructRows:
    """Where the kernel writes the minima of each problem."""
    rows = StructRows(compiled.minima, count)
    rows.point_to(row=arrays.row, s=arrays.s, least=arrays.least)
    return rows


def _thickness(numbers: Numbers, count: int) -> Array:
    """The least thickness (count,) of an obstacle of each problem, m; infinite where there is none."""
    obstacles = numbers.obstacles or [()] * count
    return np.array([min((obstacle.thickness for obstacle in own), default=np.inf) for own in obstacles])


def _of_constraints(compiled: CompiledProblem, numbers: Numbers, count: int) -> dict[str, Array]:
    """What of the rows each problem has for itself: obstacles, the margins to them, limits."""
    watch = compiled.watch
    assert isinstance(watch, CompiledConstraints), "flights in space go alone"
    found: dict[str, Array] = {}
    if numbers.obstacles:
        margins = np.array([[each.margin for each in own] for own in numbers.obstacles])
        least = np.tile(watch.least, (count, 1))
        of_obstacles = np.diff(watch.block_first)[: margins.shape[1]]
        least[:, : of_obstacles.sum()] = np.repeat(margins, of_obstacles, axis=1)
        found = {"obstacles": doubles(numbers.obstacle_numbers()), "least": least}
    if numbers.limits and numbers.limits is not numbers.like:
        blocks = [Limit.of(shares).compiled(watch.flight) for shares in shares_of_limits(numbers.limits)]
        shape = (len(block.constant) for block in blocks)
        sums = [np.broadcast_to(watch.sums(b), (count, k, watch.terms)) for b, k in zip(blocks, shape, strict=True)]
        found["sums"] = doubles(np.concatenate((np.empty((count, 0, watch.terms)), *sums), axis=1))
    return found
