"""Constraints for all times: solve at some instants, look for what fails between them, add those instants, repeat.

The exchange method of semi-infinite programming (Hettich and Kortanek, SIAM Review 35 (1993), section 7).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.batch import (
    COARSE,
    COARSELY_RESOLVED,
    FINE,
    HOPELESS,
    MOST_ITERATIONS,
    MOST_ROUNDS,
    NEARLY_RESOLVED,
    QUADRATURE_ERROR,
    ROUGH,
    nearly_resolved,
)
from floatplan.kernel.quadratic import step_by_active_rows
from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.optimization.feasibility import reduce_violations
from floatplan.optimization.hessian import hessian_approximation
from floatplan.optimization.nonlinear_program import Evaluation, Settings
from floatplan.optimization.sqp import Solution, minimise
from floatplan.planning.transcription.compiled_rows import compiled_minima, first_instants, watch_of
from floatplan.planning.transcription.constraints import Constraint, applies, window_ends
from floatplan.planning.transcription.objectives import Objective
from floatplan.planning.transcription.program import (
    BACK_OFF,
    FlightProgram,
    instants_beside_nodes,
    scaled,
    steerable,
    watching,
)
from floatplan.planning.transcription.trajectory import (
    FlightModel,
    Sampling,
    Trajectory,
    sample_also,
    trajectory,
)
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.tables import ORIENTATION

FIRST_LOOK = 129  # instants of the first look between the nodes
NEAR = 0.05  # of a row's scale: local minima above this are left alone
INSIDE_ENOUGH = 0.5  # of what the search aims inside: nothing is nearer to its limit between the nodes
TIGHT = 10 * BACK_OFF  # of violation: below it there may be no room to be inside
WATCHED = 0.005  # of a row's scale: local minima below this become instants of the next round
SAME_INSTANT = 1e-6  # of the duration
BESIDE = 0.02  # of the duration: how far a local minimum is taken to move from one round to the next
CHEAP = 192  # bodies times nodes, below which the time of an evaluation hardly depends on them


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


NOTHING_NEAR = Worst(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))


def local_minima(
    model: FlightModel,
    variables: DecisionVariables,
    constraints: tuple[Constraint, ...],
    level: int,
    x: Array,
    known: Trajectory | None = None,
) -> Worst:
    """True local minima below ``NEAR`` of every row of the motion x, between the nodes and at the ends.

    ``level`` is that of a grid that resolves the motion; ``known`` is the motion at some grid, which may be that one.
    """
    if not constraints:
        return NOTHING_NEAR
    nodes = model.nodes(level, variables.polynomials.form)
    if watch_of(model.flight, constraints, ""):
        resolved = known if known and known.sampling.nodes == nodes.nodes else trajectory(model, variables, nodes, x)
        return Worst(*compiled_minima(resolved, constraints, FIRST_LOOK, NEAR))

    def values(sampling: Sampling) -> list[Array]:
        motion = trajectory(model, variables, sampling, x)
        result = []
        for block in constraints:
            rows = block.values(motion)[sampling.nodes :]
            exists = applies(block, sampling.s[sampling.nodes :])
            result.append(rows if exists.all() else np.where(exists[:, None], rows, np.inf))
        return result

    first_look = _first_look(nodes, window_ends(constraints))
    return _refined(values(first_look), first_look.s[nodes.nodes :], lambda s: values(sample_also(nodes, s)))


@lru_cache(maxsize=64)
def _first_look(nodes: Sampling, ends: tuple[float, ...]) -> Sampling:
    return sample_also(nodes, first_instants(FIRST_LOOK, ends))


def _refined(first: list[Array], grid: Array, values: Callable[[Array], list[Array]]) -> Worst:
    """Narrow down the local minima of values (K, r) on a grid, by ever finer grids about each of them."""
    columns = np.cumsum([0, *(rows.shape[1] for rows in first)])
    value = np.concatenate(first, axis=1)
    at, column = lowest_of_neighbours(value)
    near = (value - _rise(value))[at, column] < NEAR
    at, column = at[near], column[near]
    s, low = narrowed(
        lambda instants: np.concatenate(values(instants), axis=1),
        column,
        grid[at],
        value[at, column],
        1 / (FIRST_LOOK - 1),
        1.0,
    )
    block = np.searchsorted(columns, column, side="right") - 1
    return Worst(block, column - columns[block], s, low)


def _rise(value: Array) -> Array:
    """Steps (K, r) up from each value to its neighbours, the larger one.

    A distance falls and rises as a V where a link sweeps by: its true minimum may be as much below the lowest value.
    """
    exists = np.isfinite(value)
    step = np.zeros((len(value) + 1, value.shape[1]))
    np.subtract(value[1:], value[:-1], out=step[1:-1], where=exists[1:] & exists[:-1])
    return np.asarray(np.maximum(np.abs(step[:-1]), np.abs(step[1:])))


def solve(
    model: FlightModel,
    variables: DecisionVariables,
    make_objective: Callable[[Sampling], Objective],
    constraints: tuple[Constraint, ...],
    x: Array,
    settings: Settings = FINE,
    stop: Callable[[], bool] = lambda: False,
    first_level: int = 0,
) -> Solution[Trajectory]:
    """Minimise the objective subject to (14) and to the constraints at all times, from x.

    ``first_level`` is the level of grids to start from.
    """

    def program_at(level: int, extra: Array, x: Array) -> FlightProgram:
        nodes = model.nodes(level, variables.polynomials.form)
        beside = np.concatenate((always, extra))
        sampling = watching(nodes, constraints, beside)
        return scaled(FlightProgram(model, variables, sampling, make_objective(nodes), constraints, back_off), x)

    back_off, extra = BACK_OFF, np.empty(0)
    always = instants_beside_nodes(variables, constraints)
    counts = model.flight.node_counts
    for level in range(max(first_level, _cheap_level(counts, model.flight.bodies)), len(counts)):
        program = program_at(level, extra, x)
        start = program.evaluate(x)
        if _is_resolved(start):
            break
    guess = hessian_approximation(program.hessian(start), inequalities=bool(constraints), first=step_by_active_rows)
    stages = _stages(settings, start, level, bool(constraints))
    stage = next(stages)
    iterations = evaluations = 0
    for _ in range(MOST_ROUNDS):
        solution = minimise(program, x, guess, stage.settings, stop, start)
        iterations += solution.iterations
        evaluations += solution.evaluations
        if constraints and solution.status == "infeasible" and solution.evaluation.worst_violation < HOPELESS:
            solution = _made_feasible(program, solution, stop)
        x, start, guess = solution.x, solution.evaluation, solution.hessian or guess
        motion = start.detail
        was_last, stage = stage.settings == settings, next(stages, stage)
        needed = max(level, motion.flown.level_needed(stage.quadrature_error))
        finished = was_last and needed == level
        if iterations > MOST_ITERATIONS:
            break
        if solution.status == "infeasible" and (was_last or start.worst_violation > HOPELESS):
            if not (constraints and back_off and start.worst_violation < TIGHT):
                break
            back_off, finished = 0.0, False
        if constraints:
            worst = local_minima(model, variables, constraints, needed, x, motion)
            inside = steerable(worst.s)
            if finished and not (inside & (worst.value < _kept(constraints, back_off)[worst.block])).any():
                break
            extra = _still_near(worst, extra, inside)
        elif finished:
            break
        if needed > level or constraints:
            level, program = needed, program_at(needed, extra, x)
            start = program.evaluate(x)
    return Solution(x, solution.evaluation, solution.status, iterations, evaluations)


@dataclass(frozen=True)
class _Stage:
    """A part of the way: when it ends, and the error of the attitude at landing, rad, that its nodes may leave."""

    settings: Settings
    quadrature_error: float


def _stages(settings: Settings, start: Evaluation[Trajectory], level: int, constrained: bool) -> Iterator[_Stage]:
    """The way to a solution, from nodes at ``level``: the fewer nodes, the cheaper the iterations.

    Where the nodes are enough from the beginning, there is but the last stage.
    """
    motion = start.detail
    if constrained:
        yield _Stage(replace(COARSE, longest_step=settings.longest_step), QUADRATURE_ERROR)
    elif motion.flown.level_needed(NEARLY_RESOLVED) > level:
        same = ROUGH.longest_step == settings.longest_step
        yield _Stage(ROUGH if same else replace(ROUGH, longest_step=settings.longest_step), NEARLY_RESOLVED)
    if not constrained and motion.flown.level_needed(QUADRATURE_ERROR) > level:
        yield _Stage(nearly_resolved(settings), NEARLY_RESOLVED)
    yield _Stage(settings, QUADRATURE_ERROR)


def _made_feasible(
    program: FlightProgram, solution: Solution[Trajectory], stop: Callable[[], bool]
) -> Solution[Trajectory]:
    """Give up the objective of a nearly feasible motion to make it feasible, where that can be done."""
    nearest = reduce_violations(program, solution.x, stop)
    if nearest.squared_violation > solution.evaluation.worst_violation**2:
        return solution
    turned = np.abs(nearest.evaluation.equality).max(initial=0) <= ORIENTATION / 2
    status = "feasible" if turned and nearest.evaluation.worst_violation <= program.back_off / 4 else "infeasible"
    return replace(
        solution,
        x=nearest.x,
        evaluation=nearest.evaluation,
        status=status,
        evaluations=solution.evaluations + nearest.evaluations,
    )


def _kept(constraints: tuple[Constraint, ...], back_off: float) -> Array:
    """Least value, by block, of a motion that keeps the constraints between the nodes: inside, if that is aimed at."""
    return np.array([INSIDE_ENOUGH * (back_off or -block.tolerance) for block in constraints])


def _still_near(worst: Worst, extra: Array, inside: BoolArray) -> Array:
    """Instants to watch next: the local minima that matter, and of the old instants those beside one of them."""
    new = np.unique(worst.s[inside & (worst.value < WATCHED)])
    if not extra.size or not new.size:
        return _thinned(new)
    beside = np.abs(extra[:, None] - new).min(axis=1) < BESIDE
    return _thinned(np.unique(np.concatenate((extra[beside], new))))


def _thinned(instants: Array) -> Array:
    """Of rising instants (K,) those that are ``SAME_INSTANT`` apart: rows at one instant twice say nothing more."""
    return instants[np.diff(instants, prepend=-np.inf) > SAME_INSTANT]


@lru_cache(maxsize=32)
def _cheap_level(node_counts: tuple[int, ...], bodies: int) -> int:
    """Level of grids up to which fewer nodes would hardly be faster."""
    return max((level for level, count in enumerate(node_counts) if count * bodies <= CHEAP), default=0)


def _is_resolved(start: Evaluation[Trajectory]) -> bool:
    """Whether the nodes resolve the motion well enough to start from."""
    motion = start.detail
    return motion.flown.unresolved < COARSELY_RESOLVED
