"""From a problem to a plan: starts, instants that are added, and the verdict."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from floatplan.arguments import whole
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.method.dynamics import QUANTITIES
from floatplan.method.motion import Motions
from floatplan.method.program import Program, back_off
from floatplan.method.sqp import Solution, minimise
from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem, shares_of_limits
from floatplan.tables import OBJECTIVE_TABLE, ORIENTATION, Range

GRID = np.linspace(0, 1, 401)  # instants at which inequalities are looked at
INSTANTS = np.linspace(0, 1, 65)[1:-1]  # at which they hold, where a motion without them violates some
NEARLY = 1e-2  # [-] of rows' scales: with less on the grid they may be violated between its instants
ROUNDING = 1e-12  # [-] of rows' scales
EXCHANGES = 20  # times that instants are added
STARTS = 12  # in all, as many at each degree
SPREADS = (0.2, 0.4, 0.8, 1.6)  # [rad] root mean square of each polynomial in p, of random starts in turn
HIGHEST_DEGREE = 11  # to which "auto" rises, by 2 at a time
SEED = whole(Range(0, 2**63 - 1, ""))


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
    problem = given_problem(problem)
    refuse(problem)
    rng = np.random.default_rng(SEED(seed, "seed"))
    tried: list[tuple[float, Plan]] = []
    steps = 0
    for program, x in starts(problem, rng):
        solution = solve(program, x)
        moving = plan_of(program, solution)
        violation = max(moving.whole.missed, violated(program, solution.x)[0])  # (14) by the plan's own dynamics
        tried.append((violation, moving))
        steps += solution.steps
        if solution.converged and violation <= ORIENTATION:
            break
    violation, nearest = min(tried, key=lambda one: max(one[0], ORIENTATION))
    ok = bool(violation <= ORIENTATION)
    seconds = time.perf_counter() - began
    solver = {"starts": len(tried), "solved": int(ok), "iterations": steps, "seed": seed, "seconds": seconds}
    if ok:
        return replace(nearest, solver=solver)
    missed = f"The nearest motion of {len(tried)} starts violates a constraint by {violation:.3g} rad or of its scale."
    return replace(nearest, ok=False, status="infeasible", explanation=missed, solver=solver)


def refuse(problem: Problem) -> None:
    """Refuse what is not taken: InputError names the key."""
    unknown = ["robot.base"] if problem.robot.in_plane is None else []
    unknown += ["ground"] if problem.ground else []
    unknown += ["jump"] if problem.jump is not None else []
    unknown += ["self_clearance"] if problem.self_clearances else []
    unknown += ["motion.clip"] if problem.reference is not None else []
    for end, state in (("start", problem.initial), ("goal", problem.final)):
        unknown += [f"{end}.velocities"] if state.frame_rests else []
        unknown += [f"{end}.accelerations"] if state.free_accelerations else []
    for index, shape in enumerate(problem.obstacles):
        unknown += [] if shape.kind in ("circle", "half-plane") else [f"obstacles.{index}.kind"]
        unknown += [] if shape.window is None else [f"obstacles.{index}.window"]
    minimised = OBJECTIVE_TABLE[problem.motion.objective].quantity
    unknown += [] if minimised in (None, *QUANTITIES) else ["motion.objective"]
    for limit in shares_of_limits(problem):
        unknown += ["limits.motor"] if limit.also else []
        unknown += [] if set(limit.used) <= set(QUANTITIES) else [f"limits.{limit.key}"]
    if unknown:
        reason = "the reference method plans flights in a plane, between given states, past circles and half-planes, "
        reason += f"with limits of {', '.join(QUANTITIES)} alone"
        raise InputError(reason, element=unknown[0], advice='use the method "kernel"')


def starts(problem: Problem, rng: np.random.Generator) -> Iterator[tuple[Program, Array]]:
    """Yield a program and its x: quintics (13) first, then random motions, on other branches too; degrees by (16)."""
    low, high = problem.momentum_interval  # (7) to (9)
    h = problem.angular_momentum  # (10) where none is given
    momentum, reach = (h, 0.0) if h is not None else ((low + high) / 2, (high - low) / 2)
    joints = len(problem.robot.joints)
    lowest = max(problem.degrees)
    rising = range(lowest, max(HIGHEST_DEGREE, lowest) + 1, 2) if problem.raises_degree else [lowest]
    for degree in rising:
        degrees = [degree] * joints if problem.raises_degree else problem.degrees
        for number in range(STARTS // len(rising)):
            branch = np.zeros(joints, dtype=np.int64)
            branch[rng.integers(joints)] = rng.choice([-1, 1]) if number % 2 else 0
            program = Program(problem, Motions(problem, degrees, branch), momentum, reach)
            x = np.zeros(program.size)
            if number:
                program.near = SPREADS[number % len(SPREADS)] * rng.normal(size=program.size)
                x = minimise(program, program.near).x  # (14) first
                program.near = None
            yield program, x


def solve(program: Program, x: Array) -> Solution:
    """Solve a program from x; at more instants, wherever rows are violated between them, until none is."""
    solution = minimise(program, x)
    for _ in range(EXCHANGES):
        _, instants = violated(program, solution.x)
        exchanged = len(program.instants) > 0
        if not len(instants) or (exchanged and solution.violation > ORIENTATION):
            break
        if exchanged:
            program.instants = np.union1d(program.instants, instants)
            x = solution.x
        else:
            program.instants = INSTANTS  # from x again: past an obstacle there are several ways
        following = minimise(program, x)
        solution = following._replace(steps=solution.steps + following.steps)
    return solution


def violated(program: Program, x: Array) -> tuple[float, Array]:
    """Largest violation of a row at any time, and the instants of [0, 1] where rows are least that are violated."""
    values = program.rows_at(GRID, x)
    k, row = lowest_of_neighbours(np.where(values < NEARLY, values, np.inf))
    s, least = narrowed(lambda closer: program.rows_at(closer, x), row, GRID[k], values[k, row], GRID[1], 1.0)
    worst = max(0.0, float((-least - back_off(s)).max(initial=0.0)))
    return worst, np.unique(s[least < -0.9 * back_off(s) - ROUNDING])


def plan_of(program: Program, solution: Solution) -> Plan:
    """The plan that moves as an SQP has ended."""
    z = program.motions.free_part(solution.x[: program.motions.size])
    h = np.array([program.angular_momentum(solution.x)])
    status = "optimal" if solution.converged else "feasible"
    explanation = "Every constraint holds at all times."
    motion = program.problem, program.motions.polynomials, z, h
    return Plan.of_motion(*motion, status=status, ok=True, explanation=explanation, solver={})
