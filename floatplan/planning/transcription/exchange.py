"""Constraints for all times: solve at some instants, look for what fails between them, add those instants, repeat.

The exchange method of semi-infinite programming (Hettich and Kortanek, SIAM Review 35 (1993), section 7).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from floatplan.arrays import Array, IntArray, distinct, read_only
from floatplan.compiled.constraints import Look
from floatplan.compiled.quadratic import dual_step
from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.optimization.programs import AnyEvaluation, Evaluation, Settings, SolveQp, Step, solve_qp
from floatplan.optimization.sqp import Solution, minimise, reduce_violations
from floatplan.planning.transcription.constraints import Constraint, applies, window_ends
from floatplan.planning.transcription.program import (
    FlightProgram,
    Objective,
    instants_beside_nodes,
    scaled,
    steerable,
    watching,
)
from floatplan.planning.transcription.trajectory import FlightModel, Sampling, Trajectory, sample_also, trajectory
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.tables import ORIENTATION
from floatplan.tolerances import COARSE as COARSE_STAGE
from floatplan.tolerances import CONSTRAINED_SETTINGS, EXCHANGE, NEARLY_RESOLVED, QUADRATURE_ERROR, SETTINGS, Stage
from floatplan.tolerances import FINE as FINE_STAGE
from floatplan.tolerances import ROUGH as ROUGH_STAGE

FIRST_LOOK = 129  # instants of the first look between the nodes
FIRST_GRID = read_only(np.linspace(0, 1, FIRST_LOOK))
NEAR = 0.05  # of a row's scale: local minima above this are left alone


def solver_settings(stage: Stage, *, longest_step: float = SETTINGS.longest_step, polish: bool = True) -> Settings:
    """Return the settings of the solver in Python for a stage of a search."""
    return Settings(stage.feasibility, stage.optimality, stage.iterations, longest_step, polish)


COARSE = solver_settings(COARSE_STAGE, polish=False)
ROUGH = solver_settings(ROUGH_STAGE, polish=False)
FINE = solver_settings(FINE_STAGE)
CAUTIOUS = solver_settings(FINE_STAGE, longest_step=CONSTRAINED_SETTINGS.longest_step)
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

    @property
    def lowest(self) -> tuple[int, int, float, float]:
        """Block, row, value and s of the lowest, where there is one."""
        index = int(np.argmin(self.value))
        return int(self.block[index]), int(self.row[index]), float(self.value[index]), float(self.s[index])


NOTHING_NEAR = Worst(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))


def local_minima(
    model: FlightModel,
    variables: DecisionVariables,
    constraints: tuple[Constraint, ...],
    level: int,
    x: Array,
) -> Worst:
    """True local minima below ``NEAR`` of every row of the motion x, between the nodes and at the ends.

    ``level`` is that of a grid that resolves the motion.
    """
    if not constraints:
        return NOTHING_NEAR
    nodes = model.nodes(level, variables.polynomials.form)
    block, row, look = where_to_look(constraints)

    def values(sampling: Sampling) -> Array:
        motion = trajectory(model, variables, sampling, x)
        s = sampling.grid.s[nodes.grid.nodes :]
        rows = [(block.values(motion)[nodes.grid.nodes :], applies(block, s)) for block in constraints]
        return np.concatenate([np.where(exists[:, None], row, np.inf) for row, exists in rows], axis=1)

    first = values(sample_also(nodes, look.grid))
    at, column = lowest_of_neighbours(first)
    near = (first - _rise(first))[at, column] < NEAR
    at, column = at[near], column[near]
    begin = look.grid[at], first[at, column], look.span
    s, least = narrowed(lambda s: values(sample_also(nodes, s)), column, *begin, last=1.0)
    return Worst(block[column], row[column], s, least)


def where_to_look(constraints: tuple[Constraint, ...]) -> tuple[IntArray, IntArray, Look]:
    """Block and row (rows,) of each row of all constraints, and where to look first: a grid, and ends of windows."""
    block = [number for number, each in enumerate(constraints) for _ in each.labels]
    row = [row for each in constraints for row in range(len(each.labels))]
    low, high = (np.array([constraints[number].window[end] for number in block]) for end in (0, 1))
    ends = window_ends(constraints)
    grid = distinct(np.concatenate((FIRST_GRID, ends))) if ends else FIRST_GRID
    return np.array(block, np.int64), np.array(row, np.int64), Look(grid, low, high, NEAR, 1 / (FIRST_LOOK - 1))


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

    back_off, extra = EXCHANGE.back_off, np.empty(0)
    always = instants_beside_nodes(variables, constraints)
    counts = model.flight.node_counts
    for level in range(max(first_level, cheap_level(counts, model.flight.bodies)), len(counts)):
        program = program_at(level, extra, x)
        start = program.evaluate(x)
        if start.detail.flown.unresolved < SETTINGS.coarsely_resolved:
            break
    guess = program.hessian(start)
    stages = _stages(settings, start, level, bool(constraints))
    stage, error = next(stages)
    iterations = evaluations = 0
    for _ in range(SETTINGS.most_rounds):
        solution = minimise(program, x, guess, stage, stop, start, _counting(model))
        iterations += solution.iterations
        evaluations += solution.evaluations
        if constraints and solution.status == "infeasible" and solution.evaluation.worst_violation < SETTINGS.hopeless:
            solution = _made_feasible(program, solution, stop)
        x, start = solution.x, solution.evaluation
        guess = guess if solution.hessian is None else solution.hessian
        motion = start.detail
        was_last, (stage, error) = stage == settings, next(stages, (stage, error))
        needed = max(level, motion.flown.level_needed(error))
        finished = was_last and needed == level
        if iterations > SETTINGS.most_iterations:
            break
        if solution.status == "infeasible" and (was_last or start.worst_violation > SETTINGS.hopeless):
            if not (constraints and back_off and start.worst_violation < EXCHANGE.tight):
                break
            back_off, finished = 0.0, False
        if constraints:
            worst = local_minima(model, variables, constraints, needed, x)
            inside = steerable(worst.s)
            kept = np.array([EXCHANGE.inside_enough * (back_off or -block.tolerance) for block in constraints])
            if finished and not (inside & (worst.value < kept[worst.block])).any():
                break
            extra = _still_near(np.unique(worst.s[inside & (worst.value < EXCHANGE.watched)]), extra)
        elif finished:
            break
        if needed > level or constraints:
            level, program = needed, program_at(needed, extra, x)
            start = program.evaluate(x)
    return Solution(x, solution.evaluation, solution.status, iterations, evaluations)


def _counting(model: FlightModel) -> SolveQp:
    """Return what solves quadratic programs by the dual method, by ProxQP where that fails, and counts them as work."""

    def solve(current: AnyEvaluation, hessian: Array, active: IntArray, slack_penalty: float) -> Step:
        first = partial(dual_step, counted=partial(model.solved, len(hessian), len(current.inequality)))
        return solve_qp(current, hessian, active, slack_penalty, first, model.iterated)

    return solve


def _stages(
    settings: Settings, start: Evaluation[Trajectory], level: int, constrained: bool
) -> Iterator[tuple[Settings, float]]:
    """The way to a solution, from nodes at ``level``: the fewer nodes, the cheaper the iterations.

    Each part of it is when it ends, and the error of the attitude at landing, rad, that its nodes may leave. Where the
    nodes are enough from the beginning, there is but the last stage.
    """
    flown = start.detail.flown
    if constrained:
        yield replace(COARSE, longest_step=settings.longest_step), QUADRATURE_ERROR
    elif flown.level_needed(NEARLY_RESOLVED) > level:
        yield replace(ROUGH, longest_step=settings.longest_step), NEARLY_RESOLVED
    if not constrained and flown.level_needed(QUADRATURE_ERROR) > level:
        yield replace(settings, feasibility=NEARLY_RESOLVED, polish=False), NEARLY_RESOLVED
    yield settings, QUADRATURE_ERROR


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


def _still_near(new: Array, extra: Array) -> Array:
    """Instants to watch next: new ones, rising, and of the old ones those beside one of them."""
    if extra.size and new.size:
        new = np.unique(np.concatenate((extra[np.abs(extra[:, None] - new).min(axis=1) < EXCHANGE.beside], new)))
    return new[np.diff(new, prepend=-np.inf) > EXCHANGE.same_instant]  # rows at one instant twice say nothing more


@lru_cache(maxsize=32)
def cheap_level(node_counts: tuple[int, ...], bodies: int) -> int:
    """Level of grids up to which fewer nodes would hardly be faster."""
    return max((level for level, count in enumerate(node_counts) if count * bodies <= CHEAP), default=0)
