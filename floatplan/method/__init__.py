"""The paper's planner, to be read beside the paper: for any tree of links in a plane.

Pinocchio gives momentum and torques with their derivatives, ProxQP solves the quadratic programs; nothing is the
kernel's, which tests hold to this. Numbers in parentheses are the paper's equations, as ``docs/theory/paper.md``
corrects them. SI units and rad throughout; ``x_by_y`` are derivatives.

q, theta_0, h   angles of the n joints, orientation of the base, angular momentum about the centre of mass
D_0, ..., D_n   the momentum that a unit rate of theta_0, q_1, ..., q_n makes, (4)
p, b, z         polynomials of (12), their coefficients, and what (13) leave free of them
s               the time as a share of the flight, [0, 1]
x               variables (m,) of the search: z and, where h is free, its share of the way to an end of (9)
jets            arrays (.., 1+m): a value, then its m derivatives by x; sums and matrices act on all of them alike
u               jets (N, 3n+2, 1+m) of the state ``(q, q', q'', h, theta_0)`` at N instants
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from floatplan.arguments import SEED
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.method.dynamics import QUANTITIES
from floatplan.method.program import Program
from floatplan.method.sqp import FEASIBLE, MOST_STEPS, minimise
from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.plans.plan import Plan
from floatplan.plans.plans import ALL_HOLDS, COUNTS, PlanEntry
from floatplan.pool import one_thread
from floatplan.problem.file import as_problem
from floatplan.problem.parts import Circle, HalfPlane
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION

__all__ = ["plan"]

GRID = np.linspace(0, 1, 401)  # instants of the flight at which inequalities are looked at


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
    solutions: list[PlanEntry] = []
    for program, x in starts(problem, np.random.default_rng(SEED(seed, "seed"))):
        solutions.append(solve(program, x))
        if solutions[0].solved:
            break
    best = min(solutions, key=lambda solution: (max(solution.residual, ORIENTATION), solution.objective))
    counts = {name: sum(getattr(solution, name) for solution in solutions) for name in COUNTS}
    plan = replace(best, **counts).plan(problem, seed, time.perf_counter() - began)
    violation = max(plan.whole.missed, best.residual)  # (14) by the plan's own dynamics
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
    """Yield 12 programs with an x: quintics (13) first, then random motions on random branches; degrees by (16)."""
    rises = range(0, 11 - max(problem.degrees) + 1, 2) if problem.raises_degree else [0]  # "auto" is 11 at most
    for rise in rises:
        for number in range(12 // len(rises)):
            branch = rng.choice([-1, 0, 0, 1] if number else [0], len(problem.degrees))
            program = Program(problem, np.array(problem.degrees) + rise, branch)
            yield program, rng.normal(scale=0.1 * number, size=program.size)  # [rad], wilder each time


def solve(program: Program, x: Array) -> PlanEntry:
    """Solve a program from x without inequalities; where some are violated, at instants and where they still are."""
    instants = np.zeros(0)
    steps = 0
    for _ in range(20):  # most have all the instants they need after 2 or 3
        solution, there, last_steps = minimise(program, x, instants)
        steps += last_steps
        inequalities = partial(program.inequalities, solution)
        values = inequalities(GRID)
        k, row = lowest_of_neighbours(np.where(values < 1e-2, values, np.inf))  # others hold between GRID's instants
        s, least = narrowed(inequalities, row, GRID[k], values[k, row], GRID[1], 1.0)
        added = s[least < -FEASIBLE / 2]
        if not len(added) or there.rows.min() < -ORIENTATION:
            break
        if len(instants):  # else from x again: past an obstacle there are several ways
            x = solution
        instants = np.union1d(np.arange(1, 64) / 64, np.append(instants, added))
    violation = -min(there.rows.min(), least.min(initial=0.0))
    is_minimum = violation <= ORIENTATION and last_steps < MOST_STEPS
    return PlanEntry(
        status="optimal" if is_minimum else "feasible",
        objective=there.objective,
        residual=violation,  # rad, or of a row's scale
        angular_momentum=float(program.momentum(solution[:, None])[0, 0]),
        coefficients=program.b(solution[:, None])[..., 0],
        evaluations=program.evaluations,
        iterations=steps,
        starts=1,
        solved=int(is_minimum),
        message=ALL_HOLDS,
    )
