"""From a problem to a plan: starts, the instants at which inequalities hold, and the verdict."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from floatplan.arguments import whole
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.method.motion import Motions
from floatplan.method.program import BACK_OFF, Program
from floatplan.method.sqp import Solution, minimise
from floatplan.motion.flight import angular_momentum_interval
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION, REST, Range

NODES = 32  # of quadrature, to begin with; doubled until (14) is no other with twice as many
MOST_NODES = 256
ALIKE = 1e-10  # [rad] by which (14) may differ then
GRID = 401  # instants at which inequalities are looked at
EXCHANGES = 30  # times that instants are added
STARTS = 24  # motions to begin with, at each degree
SPREAD = 1.0  # [rad] root mean square of p's free part in random ones
HIGHEST_DEGREE = 11  # to which "auto" is raised, by 2 at a time
SEED = whole(Range(0, 2**63 - 1, ""))


@dataclass(frozen=True, eq=False)
class Attempt:
    """Where a start led."""

    program: Program
    solution: Solution
    violation: float  # largest of (14), rad, and of rows at all times, in shares of limits

    @property
    def holds(self) -> bool:
        """Whether everything holds at all times."""
        return self.violation <= ORIENTATION


def refuse_what_is_not_taken(problem: Problem) -> None:
    """Refuse flights in space, and ends that the search is to choose.

    Raises
    ------
    InputError
        Names the key, and what to do.
    """
    advice = 'or plan with the method "kernel"'
    if problem.robot.in_plane is None:
        reason = "the reference method plans flights in a plane alone"
        raise InputError(reason, element="robot.base", advice=f"leave base out, {advice}")
    for end, state in (("start", problem.initial), ("goal", problem.final)):
        for key, chosen in (("velocities", state.frame_rests), ("accelerations", state.free_accelerations)):
            if chosen:
                word = REST[end] if key == "velocities" else "free"
                reason = f'the reference method takes numbers, not "{word}"'
                raise InputError(reason, element=f"{end}.{key}", advice=f"give numbers, {advice}")


@one_thread
def plan(problem: Problem | str | Path, *, seed: int = 0) -> Plan:
    """Plan a flight in a plane by the method of the paper, as a reader would write it.

    Parameters
    ----------
    problem : Problem, or path of a problem file
        A free h is one more variable. Refused are flights in space, ``velocities = "takeoff"`` or ``"landing"``, and
        ``accelerations = "free"``.
    seed : int
        Of the random starts.

    Returns
    -------
    Plan
        Of the first start that leads to one; else the nearest motion, and ``ok`` is False.

    Raises
    ------
    InputError
        The problem is none, its file is wrong, or it asks for what is refused.
    """
    began = time.perf_counter()
    problem = given_problem(problem)
    seed = SEED(seed, "seed")
    refuse_what_is_not_taken(problem)
    best: Attempt | None = None
    counts = {"starts": 0, "iterations": 0, "evaluations": 0}
    for program, x in starts(problem, seed):
        attempt = followed(program, x)
        counts["starts"] += 1
        counts["iterations"] += attempt.solution.steps
        counts["evaluations"] += attempt.solution.evaluations
        if best is None or attempt.violation < best.violation:
            best = attempt
        if best.holds:
            break
    assert best is not None, "there is a first start"
    solver = {**counts, "solved": int(best.holds), "seconds": time.perf_counter() - began, "seed": seed}
    return plan_of(problem, best, solver)


def plan_of(problem: Problem, attempt: Attempt, solver: dict[str, float]) -> Plan:
    """The plan that moves as an attempt has ended."""
    motions = attempt.program.motions
    x = attempt.solution.x
    h = attempt.program.momentum + attempt.program.reach * x[motions.size :].sum()
    optimal = "optimal" if attempt.solution.converged else "feasible"
    missed = f"The nearest motion found violates a constraint by {attempt.violation:.3g} of its scale; "
    return Plan.of_motion(
        problem,
        motions.polynomials,
        motions.free_part(x[: motions.size]),
        np.array([h]),
        status=optimal if attempt.holds else "infeasible",
        ok=attempt.holds,
        explanation="Every constraint holds." if attempt.holds else f"{missed}{solver['starts']} starts were tried.",
        solver=solver,
    )


def starts(problem: Problem, seed: int) -> Iterator[tuple[Program, Array]]:
    """Yield programs and points to begin with: the plain motion, then random ones, on other branches of the arcsine."""
    low, high = angular_momentum_interval(problem) or (0.0, 0.0)
    h = problem.flight.momentum_in_plane
    momentum = (low + high) / 2 if isinstance(h, str) else h  # (10)
    rng = np.random.default_rng(seed)
    joints = len(problem.robot.joints)
    lowest = max(problem.degrees)
    for degree in range(lowest, HIGHEST_DEGREE + 1, 2) if problem.raises_degree else [lowest]:
        degrees = [degree] * joints if problem.raises_degree else problem.degrees
        for number in range(STARTS):
            branch = np.zeros(joints, dtype=np.int64)
            if number % 2:
                branch[rng.integers(joints)] = rng.choice([-1, 1])
            motions = Motions(problem, degrees, branch)
            program = Program(problem, motions, momentum, (high - low) / 2 if h == "free" else 0.0, NODES)
            x = np.zeros(program.size)
            z = SPREAD * rng.normal(size=motions.size) if number else np.zeros(motions.size)
            x[: motions.size] = motions.variables(z)
            yield program, x


def followed(program: Program, x: Array) -> Attempt:
    """Follow a start to a solution, with more nodes and instants until (14) and all rows hold between them too."""
    solution = minimise(program, x)
    for _ in range(EXCHANGES):
        finer = program.with_nodes(2 * len(program.quadrature.nodes))
        missed = float(np.abs(finer.evaluate(solution.x).missed).max())
        lacking, instants = violated(program, solution.x)
        violation = max(missed, lacking)
        if solution.evaluation.violation > ORIENTATION:
            break
        if abs(missed) > ALIKE and len(finer.quadrature.nodes) <= MOST_NODES:
            program = finer
        elif len(instants):
            program.instants = np.union1d(program.instants, instants)
        else:
            break
        steps, evaluations = solution.steps, solution.evaluations
        solution = minimise(program, solution.x, solution.hessian)
        solution = replace(solution, steps=solution.steps + steps, evaluations=solution.evaluations + evaluations)
    return Attempt(program, solution, violation)


def violated(program: Program, x: Array) -> tuple[float, Array]:
    """Largest violation of a row at any time, and the instants of [0, 1] where rows are violated and least.

    The least values of a grid are refined by the vertex of the parabola through a grid's value and its neighbours.
    """
    grid = np.linspace(0, 1, GRID)
    values = program.values_of_rows(grid, x)
    if not values.size:
        return 0.0, np.zeros(0)
    padded = np.pad(values, ((1, 1), (0, 0)), mode="reflect")
    before, after = padded[:-2], padded[2:]
    least = (values <= before) & (values <= after)
    curvature = before - 2 * values + after
    shift = np.where(curvature > 0, (before - after) / (2 * np.where(curvature > 0, curvature, 1.0)), 0.0)
    value = values - (before - after) * shift / 4
    wrong = least & (value < -BACK_OFF / 2)
    instants = np.unique(np.clip(grid[:, None] + shift / (GRID - 1), 0, 1)[wrong])
    refined = program.values_of_rows(instants, x)
    return float(max(0.0, -min(values.min(), refined.min(initial=0.0)) - BACK_OFF)), instants
