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
from floatplan.method.motion import Motions
from floatplan.method.program import Program, back_off
from floatplan.method.sqp import Solution, minimise
from floatplan.motion.flight import flight_of
from floatplan.motion.quadrature import lowest_of_neighbours, narrowed
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION, Range

GRID = np.linspace(0, 1, 401)  # instants at which inequalities are looked at
INSTANTS = np.linspace(0, 1, 65)[1:-1]  # at which they hold, where a solution without them violates some
NEARLY = 1e-2  # of rows, in their scales: with less on the grid they may be violated between its instants
ROUNDING = 1e-12  # of rows
CLOSE = 1e-3  # of [0, 1]: a new instant takes the place of one that is so near, whose row is all but the same
EXCHANGES = 20  # times that instants are added
STARTS = 12  # at each degree
BEST_OF = 4  # random starts that led to a plan, where that is quick: without inequalities
SPREADS = (1.6, 0.2, 0.4, 0.8)  # [rad] root mean square of each polynomial in p's free part, of starts in turn
DRAWN = 16  # random motions, of which the one that violates least begins
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
    seed = SEED(seed, "seed")
    refuse(problem)
    answers: list[tuple[bool, float, Plan]] = []
    steps = 0
    for program, start in starts(problem, seed):
        solution = followed(program, start)
        moving = plan_of(program, solution)
        violation = max(moving.whole.missed, violated(program, solution.x)[0])  # (14) by the plan's own dynamics
        fails = violation > ORIENTATION
        answers.append((fails, violation if fails else moving.objective_value, moving))
        steps += start.steps + solution.steps
        solved = sum(not fails for fails, _, _ in answers)
        if solved >= (1 if len(answers) == 1 or problem.has_inequalities else BEST_OF):
            break
    fails, violation, moving = min(answers, key=lambda answer: answer[:2])
    solver = {"starts": len(answers), "solved": solved, "iterations": steps, "seed": seed}
    best = replace(moving, solver={**solver, "seconds": time.perf_counter() - began})
    nearest = (
        f"The nearest motion of {len(answers)} starts violates a constraint by {violation:.3g} rad or of its scale"
    )
    return replace(best, ok=False, status="infeasible", explanation=f"{nearest}.") if fails else best


def plan_of(program: Program, solution: Solution) -> Plan:
    """The plan that moves as an SQP has ended."""
    return Plan.of_motion(
        program.problem,
        program.motions.polynomials,
        program.motions.free_part(solution.x[: program.motions.size]),
        np.array([program.angular_momentum(solution.x)]),
        status="optimal" if solution.converged else "feasible",
        ok=True,
        explanation="Every constraint holds at all times.",
        solver={},
    )


def refuse(problem: Problem) -> None:
    """Refuse what is not taken: InputError names the key."""
    ends = (("start", problem.initial), ("goal", problem.final))
    asked = {"robot.base": problem.robot.in_plane is None, "ground": problem.ground, "jump": problem.jump is not None}
    asked |= {f"{end}.velocities": state.frame_rests for end, state in ends}
    asked |= {f"{end}.accelerations": state.free_accelerations for end, state in ends}
    asked |= {f"obstacles.{i}.kind": shape.kind == "capsule" for i, shape in enumerate(problem.obstacles)}
    asked |= {"self_clearance": bool(problem.self_clearances), "motion.clip": problem.reference is not None}
    for element in filter(asked.get, asked):
        reason = (
            "the reference method plans flights in a plane, between given states, past circles and half-planes alone"
        )
        raise InputError(reason, element=element, advice='use the method "kernel"')


def starts(problem: Problem, seed: int) -> Iterator[tuple[Program, Solution]]:
    """Yield first solutions: from quintics without inequalities, then from random motions, on other branches too."""
    low, high = flight_of(problem).momentum_interval or (0.0, 0.0)  # (7) to (9)
    h = problem.flight.momentum_in_plane
    momentum = (low + high) / 2 if isinstance(h, str) else h  # (10)
    reach = (high - low) / 2 if h == "free" else 0.0
    rng = np.random.default_rng(seed)
    joints = len(problem.robot.joints)
    lowest = max(problem.degrees)
    for degree in range(lowest, max(HIGHEST_DEGREE, lowest) + 1, 2) if problem.raises_degree else [lowest]:
        degrees = [degree] * joints if problem.raises_degree else problem.degrees
        for number in range(STARTS):
            branch = np.zeros(joints, dtype=np.int64)
            branch[rng.integers(joints)] = rng.choice([-1, 1]) if number % 2 else 0
            program = Program(problem, Motions(problem, degrees, branch), momentum, reach)
            x = np.append(program.motions.quintics, np.zeros(program.size - program.motions.size))
            if number:
                program.instants = INSTANTS
                spread = SPREADS[number % len(SPREADS)] * program.scale
                drawn = [x + spread @ rng.normal(size=program.size) for _ in range(DRAWN)]
                program.near = min(drawn, key=lambda x: program.evaluate(x).violation)
                x = minimise(program, program.near).x  # feasible first, then least
                program.near = None
            yield program, minimise(program, x)


def followed(program: Program, solution: Solution) -> Solution:
    """Follow a solution, with more instants until all rows hold between them too."""
    for _ in range(EXCHANGES):
        _, instants = violated(program, solution.x)
        if solution.evaluation.violation > ORIENTATION or not len(instants):
            break
        held = program.instants if len(program.instants) else INSTANTS
        far = np.abs(held[:, None] - instants).min(axis=1) > CLOSE
        program.instants = np.union1d(held[far], instants)
        following = minimise(program, solution.x)
        solution = replace(following, steps=solution.steps + following.steps)
    return solution


def violated(program: Program, x: Array) -> tuple[float, Array]:
    """Largest violation of a row at any time, and the instants of [0, 1] where rows are least that are violated."""
    values = program.rows_at(GRID, x)
    k, row = lowest_of_neighbours(np.where(values < NEARLY, values, np.inf))
    s, least = narrowed(lambda closer: program.rows_at(closer, x), row, GRID[k], values[k, row], GRID[1], 1.0)
    worst = max(0.0, float((-least - back_off(s)).max(initial=0.0)))
    return worst, np.unique(s[least < -back_off(s) / 2 - ROUNDING])
