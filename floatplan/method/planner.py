"""From a problem to a plan: starts, instants that are added, and the verdict."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import SEED
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.method.dynamics import QUANTITIES
from floatplan.method.program import Program
from floatplan.method.sqp import FEASIBLE, Solution, minimise
from floatplan.motion.exact_polynomials import CONDITIONS
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
SPREAD = 0.2  # [rad] root mean square of each variable, by which each start is wilder than the one before
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
        Of the first start that leads to one; else the nearest motion, and ``ok`` is False.

    Raises
    ------
    InputError
        The problem is none, its file is wrong, or it asks for what is not taken.
    """
    began = time.perf_counter()
    problem = as_problem(problem)
    refuse(problem)
    tried = []
    steps = 0
    for program, x in starts(problem, np.random.default_rng(SEED(seed, "seed"))):
        solution = solve(program, x)
        motion = Plan.of_motion(
            problem,
            program.motions.polynomials,
            program.motions.coefficients(solution.x[: program.motions.size])[:, CONDITIONS:],
            program.angular_momentum(solution.x),
            status="optimal" if solution.converged else "feasible",
            ok=True,
            explanation="Every constraint holds at all times.",
            solver={},
        )
        violation = max(motion.whole.missed, solution.violation)  # (14) by the plan's own dynamics
        tried.append((violation, motion))
        steps += solution.steps
        if violation <= ORIENTATION and solution.converged:
            break
    violation, nearest = min(tried, key=lambda one: max(one[0], ORIENTATION))
    ok = violation <= ORIENTATION
    seconds = time.perf_counter() - began
    solver = {"starts": len(tried), "solved": int(ok), "iterations": steps, "seed": seed, "seconds": seconds}
    if ok:
        return replace(nearest, solver=solver)
    reason = f"The nearest motion of {len(tried)} starts violates a constraint by {violation:.3g} rad or of its scale."
    return replace(nearest, ok=False, status="infeasible", explanation=reason, solver=solver)


def refuse(problem: Problem) -> None:
    """Refuse what is not taken: InputError names the key."""
    others: dict[str, Any] = {
        "robot.base": problem.robot.in_plane is None,
        "ground": problem.ground,
        "jump": problem.jump,
        "self_clearance": problem.self_clearances,
        "motion.clip": problem.reference is not None,
    }
    for end, state in (("start", problem.initial), ("goal", problem.final)):
        others |= {f"{end}.velocities": state.frame_rests, f"{end}.accelerations": state.free_accelerations}
    for index, obstacle in enumerate(problem.obstacles):
        others[f"obstacles.{index}.kind"] = not isinstance(obstacle, Circle | HalfPlane)
        others[f"obstacles.{index}.window"] = obstacle.window
    for limit in problem.limit_shares:
        others[f"limits.{'motor' if limit.also else limit.key}"] = limit.also or {*limit.used} - {*QUANTITIES}
    reason = "the reference method plans flights in a plane, between given states, past circles and half-planes, "
    reason += f"with limits of {', '.join(QUANTITIES)} alone"
    for key in filter(others.get, others):
        raise InputError(reason, element=key, advice='use the method "kernel"')


def starts(problem: Problem, rng: np.random.Generator) -> Iterator[tuple[Program, Array]]:
    """Yield a program and its x: quintics (13) first, then random motions, on other branches too; degrees by (16)."""
    lowest = max(problem.degrees)
    rises = range(0, max(HIGHEST_DEGREE - lowest, 0) + 1, 2) if problem.raises_degree else [0]
    for rise in rises:
        for number in range(STARTS // len(rises)):
            branch = np.zeros(len(problem.degrees), dtype=np.int64)
            branch[rng.integers(len(branch))] = rng.choice([-1, 1]) if number % 2 else 0
            program = Program(problem, [degree + rise for degree in problem.degrees], branch)
            yield program, SPREAD * number * rng.normal(size=program.size)


def solve(program: Program, x: Array) -> Solution:
    """Solve a program from x without inequalities; where some are violated, at instants and where they still are."""
    solution = minimise(program, x, np.zeros(0))
    violation, added = violated(program, solution.x)
    instants = INSTANTS
    for _ in range(EXCHANGES if len(added) else 0):  # from x again: past an obstacle there are several ways
        following = minimise(program, x, instants)
        solution = following._replace(steps=solution.steps + following.steps)
        violation, added = violated(program, solution.x)
        if not len(added) or solution.violation > ORIENTATION:
            break
        instants = np.union1d(instants, added)
        x = solution.x
    return solution._replace(violation=max(solution.violation, violation))


def violated(program: Program, x: Array) -> tuple[float, Array]:
    """Largest violation of an inequality in flight, and the instants of [0, 1] where those violated are least."""
    values = program.inequalities(x, GRID)
    k, row = lowest_of_neighbours(np.where(values < NEARLY, values, np.inf))
    s, least = narrowed(lambda s: program.inequalities(x, s), row, GRID[k], values[k, row], GRID[1], 1.0)
    return max(0.0, -least.min(initial=0.0)), np.unique(s[least < -FEASIBLE / 2])
