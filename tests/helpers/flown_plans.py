"""Plans without a search: a motion of a problem's class, its end made the goal; and flights that obey (4) alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import flight_of
from floatplan.planning.variables import decision_variables


def forward_plan(problem: fp.Problem, seed: int = 0, size: float = 0.3) -> fp.Plan:
    """Return a plan of the problem with another goal: what a random motion of its class reaches."""
    rest = {"velocities": 0.0, "accelerations": 0.0, "settled": None}
    still = {end: replace(getattr(problem, end), **rest) for end in ("start", "goal")}
    problem = replace(problem, **still)
    momentum = flight_of(problem).momentum_set.centre
    branches = np.zeros((2, len(problem.robot.joints)), dtype=np.int64)
    given = MomentumSet(momentum, np.empty((len(momentum), 0)))
    polynomials = decision_variables(problem, problem.degrees, branches, given).polynomials
    z = size * np.random.default_rng(seed).standard_normal(polynomials.nominal_coefficients.shape)
    z.ravel()[np.setdiff1d(np.arange(z.size), polynomials.free_indices)] = 0.0
    answer: dict[str, Any] = {"status": "feasible", "ok": True, "explanation": "", "solver": {}}
    reached = fp.Plan.of_motion(problem, polynomials, z, momentum, **answer).final_orientation
    problem = replace(problem, goal=replace(problem.goal, orientation=reached))
    return fp.Plan.of_motion(problem, polynomials, z, momentum, **answer)


class Drifting:
    """A robot whose joints follow the replanner's reference exactly: its base turns by (4), Pinocchio's D."""

    def __init__(self, plan: fp.Plan, momentum: float) -> None:
        self.plan, self.momentum = plan, momentum
        self.time, self.orientation = 0.0, plan.problem.initial.orientation

    def state(self, replanner: fp.Replanner) -> tuple[float, float, float, Array, Array]:
        """Return the arguments of ``update`` for now."""
        positions, velocities, _ = replanner.motion.at(self.time)
        rate = self.plan.dynamics.base_rate(positions, velocities, self.momentum)[0]
        return self.time, self.orientation, float(rate), positions[0], velocities[0]

    def fly(self, replanner: fp.Replanner, until: float, parts: int = 8) -> tuple[Array, Array, Array]:
        """Fly on; times (N,), orientations (N,), positions (N, n) on the way, by the midpoint rule."""
        step = (until - self.time) / parts
        times = self.time + step * (np.arange(parts) + 0.5)
        positions, velocities, _ = replanner.motion.at(times)
        turned = np.asarray(step * np.cumsum(self.plan.dynamics.base_rate(positions, velocities, self.momentum)))
        orientations: Array = np.asarray(self.orientation + turned, dtype=np.float64)
        self.time, self.orientation = until, float(orientations[-1])
        ends = np.asarray(times + step / 2, dtype=np.float64)
        return ends, orientations, replanner.motion.at(ends)[0]
