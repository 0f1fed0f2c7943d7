"""Problems with inequalities that go together: the plain motion of each is followed, by the kernel in one call.

They differ from one that is made ready for attempts in numbers alone. What holds is an answer; the others are ready for
more starts.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.batch import OPTIMAL, Rows, powers_of_basis
from floatplan.compiled.constraints import CompiledConstraints
from floatplan.compiled.numbers import Numbers
from floatplan.kernel.layout import FilledRows
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.planning.attempt import Attempts
from floatplan.planning.starts import Start
from floatplan.planning.transcription.compiled_attempt import CompiledAttempts, Ready, draws_of
from floatplan.planning.transcription.constraints import Limit
from floatplan.planning.transcription.variables import DecisionVariables, whitened
from floatplan.plans.plans import ALL_HOLDS, Answer
from floatplan.problem.problem import Problem, shares_of_limits


@dataclass(frozen=True, eq=False)
class Together:
    """Where N problems' plain motions led, b (N, n, k+1) of (12), and what further starts of each are followed with.

    ``like`` is what they differ from, by ``rows`` and their ``whitened`` variables. ``given`` is what the kernel takes
    of all, or of each its own; ``found`` where they ended, from ``plain`` (N, m): x (N, m), branch and minima.
    """

    like: Attempts
    rows: Rows
    whitened: tuple[Array, Array, Array]
    given: tuple[Any, ...]
    attempts: FilledRows
    draws: FilledRows
    plain: Array
    found: tuple[Array | IntArray, ...]
    coefficients: Array

    @property
    def solved(self) -> IntArray:
        """Those that need no more starts."""
        numbers = self.attempts.numbers
        return np.flatnonzero((numbers["violation"] <= 0) & (numbers["status"] == OPTIMAL))

    def answer(self, row: int) -> Answer:
        """Where the plain motion of one that is solved led."""
        b, it, h = self.coefficients[row], self.attempts.structures[row], float(self.rows.momentum[row])
        of_end = float(np.linalg.norm(b)), h, abs(it.missed[0]), b, it.evaluations, it.iterations
        return Answer("optimal", *of_end, starts=1, solved=1, message=ALL_HOLDS)

    def at(self, row: int, problem: Problem, seed: int) -> Attempts:
        """One of the problems, ready for attempts: the first, from the plain motion, is done."""
        given = tuple(each.structures[row] if isinstance(each, FilledRows) else each for each in self.given)
        found, compiled = tuple(each[row] for each in self.found), self.like.compiled
        of_starts = self.attempts.structures[row], self.draws.structures[row]
        plain = self.plain[row]
        ready = Ready(compiled, plain, given, *of_starts, found, self.coefficients[row], self)
        momentum = MomentumSet(self.rows.momentum[row : row + 1], np.empty((1, 0)))
        polynomials, numbers = self.like.plain_start.variables.polynomials, self.rows
        own = replace(polynomials, duration=float(numbers.duration[row]), boundary=numbers.boundary[row])
        offset, scaling, offset_map = (each[row] for each in self.whitened)
        variables = DecisionVariables(own, offset, scaling, momentum, offset_map=offset_map)
        prepared = Attempts(problem, seed, momentum, (Start(variables, plain, at_once=True), ready))
        if not self.attempts.structures[row].violation <= 0:
            _ = prepared.model, prepared.impossible  # the search asks for them: for all is quicker than one by one
        return prepared


def followed_together(like: Attempts, numbers: Numbers, most_work: float) -> Together:
    """Follow the plain motions of problems; each as if it were alone."""
    compiled, variables = like.compiled, like.plain_start.variables
    watch = compiled.watch
    assert isinstance(watch, CompiledConstraints), "flights in space go alone"
    rows, polynomials, given = numbers.rows(), variables.polynomials, numbers.values["orientation"][:, 0]
    count, n = rows.boundary.shape[:2]
    durations = tuple(rows.duration[: 1 if (rows.duration == rows.duration[0]).all() else count].tolist())
    offset, scaling, offset_map = whitened(polynomials.form, polynomials.free, durations, rows.boundary)
    plain = np.asarray(np.linalg.solve(scaling, -offset[..., None])[..., 0], np.float64)
    x, branch = plain.copy(), np.zeros((count, n), np.int64)
    coefficients = np.empty((count, n, CONDITIONS + polynomials.width))
    thickness = [min((each.thickness for each in own), default=np.inf) for own in numbers.obstacles or [()] * count]
    paths = numbers.paths()
    start, attempt, motions = compiled.prepared(variables, x[0], True)
    minima, found = compiled.room(count)
    own_minima = FilledRows(minima, count, **dict(zip(("row", "s", "least"), found, strict=True)))
    ends = {"minima": own_minima, "x": x, "coefficients": coefficients, "first": 0, "count": 1}
    ends |= {"most_work": most_work, "reach": compiled.reach}  # it is asked first whether there is a chance
    of_motions = {"boundary": rows.boundary, "offset": offset, "scaling": scaling, "orientation": given}
    of_flights = {name: getattr(rows, name) for name in ("duration", "momentum", "change")}
    every_attempt = FilledRows(attempt, count, **ends, plain=plain, thickness=np.array(thickness))
    every_motion = FilledRows(motions, count, **of_motions, **of_flights)
    draws = FilledRows(draws_of(variables, True, branch[0]), count, branch=branch, offset_map=offset_map)
    constraints = FilledRows(watch.filled, count, path=paths, **_of_constraints(compiled, numbers, count))
    robot, _, _, *others = start
    together = (robot, constraints, every_motion, *others, powers_of_basis(polynomials.width).structure)
    of = [each.structures if isinstance(each, FilledRows) else each for each in (*together, every_attempt, draws)]
    kernel = watch.kernel
    if kernel.attempt(*of, count, kernel.instructions):
        raise MemoryError("no memory to follow starts")
    ended = plain, (x, branch, *found), coefficients
    return Together(like, rows, (offset, scaling, offset_map), together, every_attempt, draws, *ended)


def _of_constraints(compiled: CompiledAttempts, numbers: Numbers, count: int) -> dict[str, Array]:
    """What of the rows each problem has for itself: obstacles, the margins to them, limits."""
    watch = compiled.watch
    found: dict[str, Array] = {}
    assert isinstance(watch, CompiledConstraints), "flights in space go alone"
    if numbers.obstacles:
        margins = np.array([[each.margin for each in own] for own in numbers.obstacles])
        least = np.tile(watch.least, (count, 1))
        of_obstacles = np.diff(watch.block_first)[: margins.shape[1]]
        least[:, : of_obstacles.sum()] = np.repeat(margins, of_obstacles, axis=1)
        found = {"obstacles": numbers.obstacle_numbers(), "least": least}
    if numbers.limits and numbers.limits is not numbers.like:
        blocks = [Limit.of(shares).compiled(watch.flight) for shares in shares_of_limits(numbers.limits)]
        shape = (len(block.constant) for block in blocks)
        sums = [np.broadcast_to(watch.sums(b), (count, k, watch.terms)) for b, k in zip(blocks, shape, strict=True)]
        found["sums"] = np.concatenate((np.empty((count, 0, watch.terms)), *sums), axis=1)
    return found
