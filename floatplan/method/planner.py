"""From a problem to a plan: starts, instants that are added, and the verdict."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from floatplan.arguments import whole
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.method.motion import Motions
from floatplan.method.program import BACK_OFF, Program
from floatplan.method.sqp import Solution, minimise, reduce_violations
from floatplan.motion.flight import angular_momentum_interval
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION, Range

NODES = 32  # of (18), to begin with: doubled where (14) is another with twice as many
MOST_NODES = 256
ALIKE = 1e-10  # [rad] by which it may be another
GRID = np.linspace(0, 1, 401)  # instants at which inequalities are looked at
INSTANTS = 65
EXCHANGES = 40  # times that instants are added
STARTS = 16  # at each degree
SPREAD = 1.0  # [rad] root mean square of p's free part in random starts
HIGHEST_DEGREE = 11  # to which "auto" rises, by 2 at a time
SEED = whole(Range(0, 2**63 - 1, ""))


@dataclass(frozen=True, eq=False)
class Attempt:
    """Where a start led; ``violation`` is the largest at any time, of (14), rad, and of rows, in their scales."""

    program: Program
    solution: Solution
    violation: float

    @property
    def holds(self) -> bool:
        """Whether all constraints hold at all times."""
        return self.violation < ORIENTATION


def refuse(problem: Problem) -> None:
    """Refuse what is not taken.

    Raises
    ------
    InputError
        Names the key.
    """
    in_space = problem.robot.in_plane is None
    ends = (("start", problem.initial), ("goal", problem.final))
    not_taken = {"robot.base": in_space, "ground": problem.ground, "self_clearance": problem.self_clearances}
    not_taken |= {f"{end}.velocities": state.frame_rests for end, state in ends}
    not_taken |= {f"{end}.accelerations": state.free_accelerations for end, state in ends}
    not_taken |= {f"obstacles.{i}.kind": obstacle.kind == "capsule" for i, obstacle in enumerate(problem.obstacles)}
    for element, asked in not_taken.items():
        if asked:
            reason = "the reference method takes flights in a plane between given states, past circles and half-planes"
            raise InputError(reason, element=element, advice='plan with the method "kernel", or change this')


@one_thread
def plan(problem: Problem | str | Path, *, seed: int = 0) -> Plan:
    """Plan a flight in a plane by the method of the paper, as a reader would write it.

    Parameters
    ----------
    problem : Problem, or path of a problem file
        Of a flight in a plane between given states, with circles and half-planes as obstacles. A free h is one more
        variable.
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
    attempts = []
    for program, x in starts(problem, seed):
        attempts.append(followed(program, x))
        if attempts[-1].holds:
            break
    best = min(attempts, key=lambda attempt: attempt.violation)
    motions = best.program.motions
    x = best.solution.x
    steps = sum(attempt.solution.steps for attempt in attempts)
    solver = {"starts": len(attempts), "solved": int(best.holds), "iterations": steps, "seed": seed}
    nearest = f"The nearest motion that {len(attempts)} starts led to violates a constraint by {best.violation:.3g}."
    return Plan.of_motion(
        problem,
        motions.polynomials,
        motions.free_part(x[: motions.size]),
        np.array([best.program.angular_momentum(x)]),
        status=("optimal" if best.solution.converged else "feasible") if best.holds else "infeasible",
        ok=best.holds,
        explanation="Every constraint holds at all times." if best.holds else nearest,
        solver={**solver, "seconds": time.perf_counter() - began},
    )


def starts(problem: Problem, seed: int) -> Iterator[tuple[Program, Array]]:
    """Yield programs and points to begin with: quintics alone, then random motions, some on other branches."""
    low, high = angular_momentum_interval(problem) or (0.0, 0.0)  # (7) to (9)
    h = problem.flight.momentum_in_plane
    momentum = (low + high) / 2 if isinstance(h, str) else h  # (10)
    reach = (high - low) / 2 if h == "free" else 0.0
    rng = np.random.default_rng(seed)
    joints = len(problem.robot.joints)
    most = HIGHEST_DEGREE if problem.raises_degree else max(problem.degrees)
    for degree in range(max(problem.degrees), most + 1, 2):
        degrees = [degree] * joints if problem.raises_degree else problem.degrees
        for number in range(STARTS):
            branch = np.zeros(joints, dtype=np.int64)
            branch[rng.integers(joints)] = rng.choice([-1, 1]) if number % 2 else 0
            program = Program(problem, Motions(problem, degrees, branch), momentum, reach, NODES)
            x = np.zeros(program.size)
            spread = SPREAD if number else 0.0
            free = program.motions.R @ rng.normal(scale=spread, size=program.motions.size)
            x[: program.motions.size] = program.motions.quintics + free
            yield program, x


def followed(program: Program, x: Array) -> Attempt:
    """Follow a start, with more nodes and instants until (14) and all rows hold between them too."""
    solution = minimise(program, x)
    if violated(program, solution.x)[0]:
        program.instants = np.linspace(0, 1, INSTANTS)
        solution = minimise(program, reduce_violations(program, solution.x))
    for _ in range(EXCHANGES):
        finer = program.with_nodes(2 * len(program.quadrature.nodes))
        missed = float(np.abs(finer.evaluate(solution.x).missed).max())
        lacking, instants = violated(program, solution.x)
        attempt = Attempt(program, solution, max(missed, lacking))
        coarse = missed > ALIKE and len(program.quadrature.nodes) < MOST_NODES
        if solution.evaluation.violation > ORIENTATION or not (coarse or len(instants)):
            break
        program = finer if coarse else program
        program.instants = np.union1d(program.instants, instants)
        solution = minimise(program, solution.x, solution.hessian)
    return attempt


def violated(program: Program, x: Array) -> tuple[float, Array]:
    """Largest violation of a row at any time, and the instants of [0, 1] where rows that are violated are least.

    Least values on a grid are refined by the parabola through their neighbours.
    """
    values = program.rows_at(GRID, x)
    padded = np.pad(values, ((1, 1), (0, 0)), mode="reflect")
    before, after = padded[:-2], padded[2:]
    curvature = before - 2 * values + after
    shift = np.where(curvature > 0, (before - after) / (2 * np.maximum(curvature, 1e-300)), 0.0)
    least = (values <= before) & (values <= after) & (values - (before - after) * shift / 4 < -BACK_OFF / 2)
    instants = np.unique(np.clip(GRID[:, None] + shift * GRID[1], 0, 1)[least])
    lowest = min(values.min(initial=0.0), program.rows_at(instants, x).min(initial=0.0))
    return max(0.0, -float(lowest) - BACK_OFF), instants
