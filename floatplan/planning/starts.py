"""Where a search begins: the plain motion, then motions drawn at random that already meet (14) and violate little.

theta0(T) is continuous in the decision variables: between a motion that turns too little and one that turns too much
there is one that turns just enough. A batch of random motions is evaluated at once; those pairs give starts, and the
starts that violate the constraints least are followed first.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.batch import SPREADS, Numbers, Search, is_plain, solver
from floatplan.motion.dynamics import MomentumSet
from floatplan.planning.transcription.compiled_attempt import crossings
from floatplan.planning.transcription.constraints import Constraint
from floatplan.planning.transcription.trajectory import FlightModel
from floatplan.planning.transcription.variables import DecisionVariables, decision_variables
from floatplan.problem.problem import Problem

BATCH = 160  # motions
LARGEST_BATCH = 640  # where there are constraints: each batch is twice as large as the one before
MOMENTUM_FRACTIONS = (-1.0, 1.0, -0.5, 0.5, -0.25, 0.25, -0.75, 0.75)  # of the reach of h from its middle: plain starts


@dataclass(frozen=True, eq=False)
class Start:
    """A class of motions (with its arcsine branches) and a point x in it.

    ``at_once`` says that it is followed to the objective at once, and only where that fails made feasible before, as
    promises most of plain motions and of ones that were solved already; ``work`` is what it took to draw it.
    """

    variables: DecisionVariables
    x: Array
    at_once: bool = False
    work: float = 0.0


def starts(
    problem: Problem,
    model: FlightModel,
    constraints: tuple[Constraint, ...],
    degrees: tuple[int, ...],
    momentum: MomentumSet,
    seed: int,
) -> Iterator[Start]:
    """Yield the plain start, then random ones without end where anything is free; the same for the same seed.

    Where h is free and there are constraints, the plain motion at other h takes turns with the first random ones: what
    only those find shows that the plain ones agree on too little.
    """

    def on_branches(at_landing: IntArray) -> DecisionVariables:
        return decision_variables(problem, degrees, np.stack((0 * at_landing, at_landing)), momentum)

    start = _plain_start(problem, degrees, momentum)
    plain = start.variables
    yield start
    if plain.size and is_plain(problem):
        rows = replace(Numbers.of_problems([problem]).rows(), momentum=momentum.centre)
        for number in count(1):  # those that the kernel follows after the plain one
            search = Search(first_start=number, most_starts=number + 1, only_draws=True, seed=seed)
            draw = solver(problem, degrees).plan(rows, search)
            variables = on_branches(draw.branch[0])
            yield Start(variables, variables.variables(draw.z[0], momentum.centre))
    drawn = _random_starts(model, constraints, plain, on_branches, seed)
    if momentum.free and constraints:
        coefficients = start.x[: plain.coefficients]
        for axis in np.eye(momentum.free):
            for fraction in MOMENTUM_FRACTIONS:
                yield replace(start, x=np.concatenate((coefficients, fraction * axis)))
                yield next(drawn)
    yield from drawn


@lru_cache(maxsize=8)
def _plain_start(problem: Problem, degrees: tuple[int, ...], momentum: MomentumSet) -> Start:
    """Each search of a problem begins with it: with another seed, or for another best one."""
    variables = decision_variables(problem, degrees, np.zeros((2, len(problem.robot.joints)), np.int64), momentum)
    return Start(variables, variables.plain_motion(), at_once=True)


def _random_starts(
    model: FlightModel,
    constraints: tuple[Constraint, ...],
    plain: DecisionVariables,
    on_branches: Callable[[IntArray], DecisionVariables],
    seed: int,
) -> Iterator[Start]:
    """Yield starts of batches of random motions, on the plain branches of the arcsine and on random ones in turns."""
    n = len(plain.polynomials.free)
    rng = np.random.default_rng(seed)
    for number in count() if plain.size else ():
        variables = on_branches(rng.choice([-1, 0, 0, 1], size=n)) if number % 2 else plain
        size = min(BATCH * 2**number, LARGEST_BATCH) if constraints else BATCH
        before, motions = model.work, _random_motions(variables, size, rng)
        found = crossings(model, constraints, variables, np.concatenate((variables.plain_motion()[None], motions)))
        first, *others = (Start(variables, x) for x in found)
        yield replace(first, work=model.work - before)
        yield from others


def _random_motions(variables: DecisionVariables, motions: int, rng: np.random.Generator) -> Array:
    """Random motions x (motions, size), from gentle to wild: half of them cheap for the objective, half drawn in z."""
    half, size = motions // 2, variables.coefficients
    smooth = np.resize(SPREADS, half)[:, None] * rng.normal(size=(half, size))
    z = np.resize(SPREADS, motions - half)[:, None] * rng.normal(size=(motions - half, size))
    x = np.concatenate((smooth, np.linalg.solve(variables.scaling, (z - variables.offset).T).T))
    free = variables.momentum.free
    return np.asarray(np.concatenate((x, rng.uniform(-1, 1, (motions, free))), axis=1) if free else x)
