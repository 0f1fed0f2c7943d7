"""Constrained problems that leave h free, and what a scan of given h finds of them.

A motion is drawn first, at an h in (9) or somewhat beyond, and the problem is built around it, as in
:mod:`forward_problems`. The plan made at that h without constraints violates them all: it needs 1.05 to 1.7 times the
torque and rate that are left to it, and collides with the obstacles, which the motion drawn passes clear.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from forward_problems import Drawn, draw, obstacle_between

import floatplan as fp
from floatplan.tables import OBJECTIVES

KINDS = ("torque", "torque and velocity", "obstacles", "torque and obstacle")
SCARCITY = (0.6, 0.95)  # of limits, relative to the peaks of the plan without them
HEADROOM = (1.02, 1.3)  # of torque limits beside an obstacle, relative to the peaks of the drawn motion
SCANNED = 21  # given h
BEYOND = 1.2  # of the half-width of (9), how far the scan goes from its middle


def free_problem(seed: int) -> fp.Problem | None:
    """Return a problem with h free, or None where the draw leaves nothing to avoid."""
    rng = np.random.default_rng([seed, 9])
    kind = KINDS[seed % len(KINDS)]
    objective = OBJECTIVES[seed // len(KINDS) % len(OBJECTIVES)]
    drawn = draw(rng, joints=int(rng.integers(2, 5)), share=float(rng.uniform(-1.2, 1.2)))
    problem = replace(drawn.problem, motion=fp.Motion(objective=objective))
    guess = fp.plan(problem)
    if not guess.ok:
        return None
    obstacles = [obstacle_between(rng, drawn, guess) for _ in range(int(rng.integers(1, 3)))]
    if "obstacle" in kind and None in obstacles:
        return None
    return replace(
        problem,
        flight=replace(problem.flight, angular_momentum="free"),
        limits=_limits(rng, drawn, guess, kind),
        obstacles=tuple(each for each in obstacles if each is not None) if "obstacle" in kind else (),
        name=f"free_{seed}_{kind.replace(' ', '_')}",
    )


def _limits(rng: np.random.Generator, drawn: Drawn, guess: fp.Plan, kind: str) -> fp.Limits:
    scarce = rng.uniform(*SCARCITY, 2)
    enough = rng.uniform(*HEADROOM) * np.abs(drawn.motion.flown.torques).max(axis=0)
    torque = enough if "obstacle" in kind else scarce[0] * guess.peaks.torque
    return fp.Limits(
        torque=torque if "torque" in kind else "none",
        velocity=scarce[1] * guess.peaks.velocity if "velocity" in kind else "none",
    )


def free_problems() -> Iterator[fp.Problem]:
    """Yield problems without end, the kinds and objectives in turn; some of them have no solution at all."""
    for seed in count():
        problem = free_problem(seed)
        if problem is not None:
            yield problem


@dataclass(frozen=True)
class Timed:
    """A plan and the processor time, s, that it took."""

    plan: fp.Plan
    seconds: float


def timed(problem: fp.Problem, budget: float | None = None) -> Timed:
    """Plan a problem."""
    began = time.process_time()
    plan = fp.plan(problem, budget=budget)
    return Timed(plan, time.process_time() - began)


@dataclass(frozen=True)
class Scan:
    """What given h found: the best objective (infinite where none is solved) and its h, the median time of a plan."""

    best: float
    angular_momentum: float
    solved: int
    seconds: float


def scan(problem: fp.Problem, given: int = SCANNED, budget: float | None = None) -> Scan:
    """Plan a problem with ``given`` values of h, spread over (9) and somewhat beyond."""
    low, high = problem.momentum_interval
    middle, reach = (low + high) / 2, BEYOND * (high - low) / 2
    plans = [
        timed(replace(problem, flight=replace(problem.flight, angular_momentum=float(h))), budget)
        for h in np.linspace(middle - reach, middle + reach, given)
    ]
    solved = [one.plan for one in plans if one.plan.ok]
    best = min(solved, key=lambda plan: plan.objective_value, default=None)
    return Scan(
        best.objective_value if best else np.inf,
        best.angular_momentum if best else np.nan,
        len(solved),
        statistics.median(one.seconds for one in plans),
    )
