"""From a problem to a plan: starts, instants that are added, and the verdict."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from floatplan.arguments import SEED
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.method.dynamics import QUANTITIES
from floatplan.method.program import Program
from floatplan.method.sqp import FEASIBLE, Solution, minimise
from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.file import as_problem
from floatplan.problem.parts import Circle, HalfPlane
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION

INSTANTS = np.linspace(0, 1, 65)[1:-1]  # of the flight, at which inequalities hold at first
GRID = np.linspace(0, 1, 401)  # instants at which they are looked at
NEARLY = 1e-2  # [-] of rows' scales: with less on the grid they may be violated between its instants
EXCHANGES = 20  # times that instants are added
STARTS = 12  # in all, as many at each degree
SPREAD = 0.1  # [rad] root mean square of each variable, by which each start is wilder than the one before
HIGHEST_DEGREE = 11  # to which "auto" rises, by 2 at a time


@one_thread
def plan(problem: Problem | str | Path, *, seed: int = 0) -> Plan:
    """Plan a flight in a plane by the method of the paper, as a reader would write it.

    Parameters
    ----------
    problem : Problem, or path of a problem file
        Of a flight between given states, past circles and half-planes; a free h is one more variable.
    seed : int
        Of the random starts.

    Returns
    -------
    Plan
        Of the first start, or else of the best one; where none leads to a plan the nearest motion, not ``ok``.

    Raises
    ------
    InputError
        The problem is none, its file is wrong, or it asks for what is not taken.
    """
    began = time.perf_counter()
    problem = as_problem(problem)
    refuse(problem)
    solutions: list[tuple[Program, Solution]] = []
    for program, x in starts(problem, np.random.default_rng(SEED(seed, "seed"))):
        solutions.append((program, solve(program, x)))
        is_raised = program.size > solutions[0][0].size
        if solutions[0][1].converged or (is_raised and solutions[-1][1].converged):
            break
    program, best = min(solutions, key=lambda start: (max(start[1].violation, ORIENTATION), start[1].objective))
    motions = program.motions
    plan = Plan.of_motion(
        problem,
        motions.polynomials,
        motions.coefficients(best.x),
        motions.momentum(best.x),
        status="optimal" if best.converged else "feasible",
        ok=True,
        explanation="Every constraint holds at all times.",
        solver={
            "starts": len(solutions),
            "solved": sum(solution.converged for _, solution in solutions),
            "iterations": sum(solution.steps for _, solution in solutions),
            "seed": seed,
            "seconds": time.perf_counter() - began,
        },
    )
    violation = max(plan.whole.missed, best.violation)  # (14) by the plan's own dynamics
    if violation <= ORIENTATION:
        return plan
    reason = (
        f"The nearest motion of {len(solutions)} starts violates a constraint by {violation:.3g} rad or of its scale."
    )
    return replace(plan, ok=False, status="infeasible", explanation=reason)


def refuse(problem: Problem) -> None:
    """Refuse what is not taken: InputError names the key."""
    refused = {
        "robot.base": problem.robot.in_plane is None,
        "ground": problem.ground,
        "jump": problem.jump is not None,
        "self_clearance": bool(problem.self_clearances),
        "motion.clip": problem.reference is not None,
    }
    for end, state in (("start", problem.initial), ("goal", problem.final)):
        refused[f"{end}.velocities"] = state.frame_rests
        refused[f"{end}.accelerations"] = state.free_accelerations
    for index, obstacle in enumerate(problem.obstacles):
        refused[f"obstacles.{index}.kind"] = not isinstance(obstacle, Circle | HalfPlane)
        refused[f"obstacles.{index}.window"] = obstacle.window is not None
    for limit in problem.limit_shares:
        refused[f"limits.{'motor' if limit.also else limit.key}"] = bool(limit.also or set(limit.used) - {*QUANTITIES})
    reason = "the reference method plans flights in a plane, between given states, past circles and half-planes, "
    reason += f"with limits of {', '.join(QUANTITIES)} alone"
    for key in filter(refused.get, refused):
        raise InputError(reason, element=key, advice='use the method "kernel"')


def starts(problem: Problem, rng: np.random.Generator) -> Iterator[tuple[Program, Array]]:
    """Yield a program and its x: quintics (13) first, then random motions on random branches; degrees by (16)."""
    rises = range(0, HIGHEST_DEGREE - max(problem.degrees) + 1, 2) if problem.raises_degree else [0]
    for rise in rises:
        degrees = [degree + rise for degree in problem.degrees]
        for number in range(STARTS // len(rises)):
            branch = rng.choice([-1, 0, 0, 1] if number else [0], len(degrees))
            program = Program(problem, degrees, branch)
            yield program, rng.normal(scale=SPREAD * number, size=program.size)


def solve(program: Program, x: Array) -> Solution:
    """Solve a program from x without inequalities; where some are violated, at instants and where they still are."""
    instants = np.zeros(0)
    steps = 0
    for _ in range(EXCHANGES):
        solution = minimise(program, x, instants)
        steps += solution.steps
        between, added = violated(program, solution.x)
        if not len(added) or (len(instants) and solution.violation > ORIENTATION):
            break
        if len(instants):  # else from x again: past an obstacle there are several ways
            x = solution.x
        instants = np.union1d(INSTANTS, np.append(instants, added))
    violation = max(solution.violation, between)
    is_minimum = solution.converged and violation <= ORIENTATION
    return solution._replace(violation=violation, converged=is_minimum, steps=steps)


def violated(program: Program, x: Array) -> tuple[float, Array]:
    """Largest violation of an inequality in flight, and the instants of [0, 1] where those violated are least."""
    values = program.inequalities(x, GRID)
    k, row = lowest_of_neighbours(np.where(values < NEARLY, values, np.inf))
    s, least = narrowed(lambda s: program.inequalities(x, s), row, GRID[k], values[k, row], GRID[1], 1.0)
    return max(0.0, -least.min(initial=0.0)), np.unique(s[least < -FEASIBLE / 2])
