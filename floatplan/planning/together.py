"""Problems with inequalities that go together: the plain motion of each is followed, by the kernel in one call.

They differ from one that is made ready for attempts in numbers alone. What holds is an answer; of the others the search
knows how the first attempt ended.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.attempts import WATCHED_AT_MOST, watching_levels
from floatplan.compiled.batch import OPTIMAL, powers_of_basis
from floatplan.compiled.numbers import Numbers
from floatplan.kernel.layout import FilledRows
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import central_reach
from floatplan.planning.attempt import Attempts
from floatplan.planning.transcription.compiled_attempt import CLOSER, CompiledAttempts, Ended, draws_of
from floatplan.planning.transcription.constraints import Limit
from floatplan.planning.transcription.variables import whitened
from floatplan.problem.problem import shares_of_limits


@dataclass(frozen=True, eq=False)
class Together:
    """Where N problems' plain motions led: ``x`` (N, m), b (N, n, k+1) of (12), and what the kernel says of each."""

    compiled: CompiledAttempts
    attempts: FilledRows
    x: Array
    branch: IntArray
    coefficients: Array
    found: list[Any]

    @property
    def solved(self) -> IntArray:
        """Those that need no more starts."""
        numbers = self.attempts.numbers
        return np.flatnonzero((numbers["violation"] <= 0) & (numbers["status"] == OPTIMAL))

    def ended(self, row: int) -> Ended:
        """Where one ended."""
        of = [each[row].copy() for each in (self.x, self.branch, *self.found)]
        return Ended.of(self.attempts.structures[row], self.compiled.rows, of, self.coefficients[row].copy())


def followed_together(like: Attempts, numbers: Numbers, most_work: float) -> Together:
    """Follow the plain motions of problems; each as if it were alone."""
    compiled, variables = like.compiled, like.plain_start.variables
    assert compiled, "flights in space go alone"
    rows, polynomials, given = numbers.rows(), variables.polynomials, numbers.values["orientation"][:, 0]
    count, n = rows.boundary.shape[:2]
    durations = tuple(rows.duration[: 1 if (rows.duration == rows.duration[0]).all() else count].tolist())
    offset, scaling, _ = whitened(polynomials.form, polynomials.free, durations, rows.boundary)
    x = np.asarray(np.linalg.solve(scaling, -offset[..., None])[..., 0], np.float64)
    branch = np.zeros((count, n), np.int64)
    coefficients = np.empty((count, n, CONDITIONS + polynomials.width))
    thickness = [min((each.thickness for each in own), default=np.inf) for own in numbers.obstacles or [()] * count]
    paths = numbers.paths()
    level = watching_levels(compiled.watch.flight, polynomials, rows, (given, paths, np.array(thickness)))
    start, attempt, motions = compiled.prepared(variables, x[0], True, most_work)
    minima, found = compiled.room(count)
    own_minima = FilledRows(minima, count, **dict(zip(("row", "s", "least"), found, strict=True)))
    ends = {"minima": own_minima, "x": x, "coefficients": coefficients, "first": 0, "count": 1}
    ends["reach"] = central_reach(like.problem.robot)  # it is asked first whether there is a chance
    levels = {"level": level, "closer_level": np.minimum(level + CLOSER, WATCHED_AT_MOST)}
    of_motions = {"boundary": rows.boundary, "offset": offset, "scaling": scaling, "orientation": given}
    of_flights = {name: getattr(rows, name) for name in ("duration", "momentum", "change")}
    every_attempt = FilledRows(attempt, count, **ends, **levels)
    every_motion = FilledRows(motions, count, **of_motions, **of_flights)
    draws = FilledRows(draws_of(variables, 0, True, branch[0]), count, branch=branch)
    constraints = FilledRows(compiled.watch.filled, count, path=paths, **_of_constraints(compiled, numbers, count))
    robot, _, _, *others = start
    powers, kernel = powers_of_basis(polynomials.width), compiled.watch.kernel
    batch = (constraints, every_motion, every_attempt, draws)
    of = [each.structures for each in batch]
    if kernel.attempt(robot, *of[:2], *others, powers.structure, *of[2:], count, kernel.instructions):
        raise MemoryError("no memory to follow starts")
    return Together(compiled, every_attempt, x, branch, coefficients, found)


def _of_constraints(compiled: CompiledAttempts, numbers: Numbers, count: int) -> dict[str, Array]:
    """What of the rows each problem has for itself: obstacles, the margins to them, limits."""
    watch, found = compiled.watch, {}
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
