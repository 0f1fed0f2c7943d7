"""Problems with inequalities that go together: the plain motion of each is followed, by the kernel in one call.

They differ from one that is made ready for attempts in numbers alone. What holds is an answer; the others are ready for
more starts.
"""

from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.batch import OPTIMAL, Rows, powers_of_basis
from floatplan.compiled.numbers import Numbers
from floatplan.kernel.structs import Struct, StructRows, doubles
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.planning.attempt import Attempts
from floatplan.planning.starts import Start
from floatplan.planning.transcription.compiled_attempt import (
    CompiledProblem,
    Inputs,
    MinimaArrays,
    PreparedStarts,
    draws_struct,
)
from floatplan.planning.transcription.constraints import Limit
from floatplan.planning.transcription.variables import DecisionVariables, whitened
from floatplan.plans.plans import ALL_HOLDS, Answer
from floatplan.problem.problem import Problem, shares_of_limits


@dataclass(frozen=True, eq=False)
class BatchedStarts:
    """N problems whose plain motions the kernel has followed, prepared for further starts of each.

    Attributes
    ----------
    like : Attempts
        One problem, from which they differ in numbers alone.
    rows : Rows
    offset, scaling, offset_map : (N, ..)
        Of each problem's variables.
    inputs : Inputs
        Of the problem ``like``: its robot, levels, settings and rules are those of all.
    powers : Struct
    attempts, draws, motions, constraints : StructRows
    plain, x : (N, size)
        Where each began, and ended.
    branch : (N, n)
    minima : MinimaArrays
    coefficients : (N, n, k+1)
        b of (12).
    """

    like: Attempts
    rows: Rows
    offset: Array
    scaling: Array
    offset_map: Array
    inputs: Inputs
    powers: Struct
    attempts: StructRows
    draws: StructRows
    motions: StructRows
    constraints: StructRows
    plain: Array
    x: Array
    branch: IntArray
    minima: MinimaArrays
    coefficients: Array

    @property
    def solved(self) -> IntArray:
        """Those that need no more starts."""
        numbers = self.attempts.numbers
        return np.flatnonzero((numbers["violation"] <= 0) & (numbers["status"] == OPTIMAL))

    def answer(self, row: int) -> Answer:
        """Where the plain motion of one that is solved led."""
        b = self.coefficients[row]
        attempt = self.attempts.row(row)
        return Answer(
            status="optimal",
            objective=float(np.linalg.norm(b)),
            angular_momentum=float(self.rows.momentum[row]),
            residual=abs(attempt.missed),
            coefficients=b,
            evaluations=attempt.evaluations,
            iterations=attempt.iterations,
            starts=1,
            solved=1,
            message=ALL_HOLDS,
        )

    def prepared(self, row: int, problem: Problem, seed: int) -> Attempts:
        """One of the problems, prepared for attempts: the first, from the plain motion, is done."""
        compiled = self.like.compiled
        assert compiled, "flights in space go alone"
        momentum = MomentumSet(self.rows.momentum[row : row + 1], np.empty((1, 0)))
        polynomials = replace(
            self.like.plain_start.variables.polynomials,
            duration=float(self.rows.duration[row]),
            boundary=self.rows.boundary[row],
        )
        variables = DecisionVariables(
            polynomials, self.offset[row], self.scaling[row], momentum, offset_map=self.offset_map[row]
        )
        inputs = replace(self.inputs, constraints=self.constraints.row(row), motions=self.motions.row(row))
        starts = PreparedStarts(
            compiled=compiled,
            variables=variables,
            plain=self.plain[row],
            inputs=inputs,
            powers=self.powers.pointer,
            attempt=self.attempts.row(row),
            draws=self.draws.row(row),
            x=self.x[row],
            branch=self.branch[row],
            minima=self.minima[row],
            coefficients=self.coefficients[row],
            kept=self,
        )
        prepared = Attempts(problem, seed, momentum, (Start(variables, self.plain[row], at_once=True), starts))
        if not starts.attempt.violation <= 0:
            prepared.prepare()
        return prepared


def follow_batch(
    like: Attempts, numbers: Numbers, most_work: float, wanted: int = 0, most_starts: int = 1, seed: int = 0
) -> BatchedStarts:
    """Follow the plain motions of problems; each as if it were alone."""
    compiled, variables = like.compiled, like.plain_start.variables
    assert compiled, "flights in space go alone"
    rows, polynomials = numbers.rows(), variables.polynomials
    count, n = rows.boundary.shape[:2]
    durations = tuple(rows.duration[: 1 if (rows.duration == rows.duration[0]).all() else count].tolist())
    offset, scaling, offset_map = map(doubles, whitened(polynomials.form, polynomials.free, durations, rows.boundary))
    plain = doubles(np.linalg.solve(scaling, -offset[..., None])[..., 0])
    x = plain.copy()
    branch = np.zeros((count, n), np.int64)
    coefficients = np.empty((count, n, CONDITIONS + polynomials.width))
    arrays = MinimaArrays.empty(count, compiled.most_minima)

    minima = StructRows(compiled.minima, count)
    minima.point_to(row=arrays.row, s=arrays.s, least=arrays.least)

    attempts = StructRows(compiled.attempt_struct(variables, x[0], True), count)
    obstacles = numbers.obstacles or [()] * count
    attempts.set_numbers(
        first=0,
        count=most_starts,
        wanted=wanted,
        most_work=most_work,
        reach=0.0 if wanted else compiled.reach,  # it is asked first whether there is a chance
        thickness=np.array([min((obstacle.thickness for obstacle in own), default=np.inf) for own in obstacles]),
    )
    attempts.set_structs(minima=minima)
    attempts.point_to(plain=plain, x=x, coefficients=coefficients)

    inputs, like_motions = compiled.inputs(variables)
    motions = StructRows(like_motions, count)
    motions.set_numbers(
        duration=rows.duration,
        momentum=rows.momentum,
        change=rows.change,
        orientation=numbers.values["orientation"][:, 0],
    )
    motions.point_to(boundary=doubles(rows.boundary), offset=offset, scaling=scaling)

    draws = StructRows(draws_struct(variables, not wanted, branch[0]), count)
    draws.set_numbers(seed=seed)
    draws.point_to(branch=branch, offset_map=offset_map)

    constraints = StructRows(compiled.watch.struct, count)
    if not wanted:
        constraints.point_to(path=doubles(numbers.paths()), **_of_constraints(compiled, numbers, count))

    powers = powers_of_basis(polynomials.width)
    kernel = compiled.watch.kernel
    no_memory = kernel.attempt(
        inputs.robot,
        constraints.pointer,
        motions.pointer,
        inputs.levels,
        inputs.settings,
        inputs.rules,
        powers.pointer,
        attempts.pointer,
        draws.pointer,
        count,
        kernel.instructions,
    )
    if no_memory:
        raise MemoryError("no memory to follow starts")
    return BatchedStarts(
        like=like,
        rows=rows,
        offset=offset,
        scaling=scaling,
        offset_map=offset_map,
        inputs=inputs,
        powers=powers,
        attempts=attempts,
        draws=draws,
        motions=motions,
        constraints=constraints,
        plain=plain,
        x=x,
        branch=branch,
        minima=arrays,
        coefficients=coefficients,
    )


def _of_constraints(compiled: CompiledProblem, numbers: Numbers, count: int) -> dict[str, Array]:
    """What of the rows each problem has for itself: obstacles, the margins to them, limits."""
    watch, found = compiled.watch, {}
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
