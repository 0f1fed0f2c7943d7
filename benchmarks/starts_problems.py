"""Problems for which more starts must never be worse: random chains, every objective, with and without constraints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np
from forward_problems import draw, obstacle_between

import floatplan as fp
from floatplan.tables import OBJECTIVES

KINDS = ("free of constraints", "torque", "obstacle", "free h")
HEADROOM = (1.05, 1.5)  # of torque limits, relative to the peaks of the motion drawn


def starts_problem(seed: int) -> fp.Problem | None:
    """Return a feasible problem, or None where the draw leaves no obstacle; every other one may raise its degree."""
    rng = np.random.default_rng([seed, 10])
    kind, objective = KINDS[seed % len(KINDS)], OBJECTIVES[seed // len(KINDS) % len(OBJECTIVES)]
    drawn = draw(rng, joints=int(rng.integers(2, 5)))
    torque = rng.uniform(*HEADROOM) * np.abs(drawn.motion.flown.torques).max(axis=0)
    obstacle = obstacle_between(rng, drawn, fp.plan(drawn.problem))
    if kind == "obstacle" and obstacle is None:
        return None
    momentum = "free" if kind == "free h" else drawn.problem.flight.angular_momentum
    return replace(
        drawn.problem,
        flight=replace(drawn.problem.flight, angular_momentum=momentum),
        motion=fp.Motion("auto" if rng.random() < 0.5 else 7, objective),
        limits=fp.Limits(torque=torque) if kind in ("torque", "free h") else fp.Limits(),
        obstacles=(obstacle,) if kind == "obstacle" and obstacle is not None else (),
        name=f"starts_{seed}_{kind.replace(' ', '_')}_{objective}",
    )


def starts_problems() -> Iterator[fp.Problem]:
    """Yield problems without end, the kinds and objectives in turn."""
    for seed in count():
        problem = starts_problem(seed)
        if problem is not None:
            yield problem
