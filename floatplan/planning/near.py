"""Plans near another one: where a problem has changed a little, the motion at hand is the best start."""

from __future__ import annotations

import time

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import refuse
from floatplan.kernel.rows import is_plain
from floatplan.motion.flight import motion_into_ground
from floatplan.motion.sine_polynomial import basis
from floatplan.planning.attempt import Attempts
from floatplan.planning.planned import plan_of, planned
from floatplan.planning.runner import expiry
from floatplan.planning.search import SearchOptions, SearchResult
from floatplan.planning.starts import Start
from floatplan.planning.transcription.program import decision_variables
from floatplan.plans.plan import Plan
from floatplan.problem.problem import Problem

SHARE = 0.5  # [-] of the budget that the motion at hand may take before another is searched, and that this has at least


def plan_near(problem: Problem, near: Plan, budget: float) -> Plan:
    """Follow the motion of a plan to one of a similar problem; search for another where it leads to none.

    It stays with that motion's kind: a search might find a better one of another kind. Without limits and obstacles a
    search is as quick.

    Parameters
    ----------
    problem : Problem
    near : Plan
        Of the same robot.
    budget : s

    Raises
    ------
    InputError
        ``budget`` is not positive; or what stands on the ground moves down at takeoff.
    """
    options, began = SearchOptions(budget=budget), time.perf_counter()
    if is_plain(problem):
        return planned(problem, options).plan
    prepared = Attempts(problem, options.seed)
    if prepared.constraints:
        if not prepared.momentum.free:
            refuse(motion_into_ground(problem, prepared.momentum.centre))
        found = _followed(prepared, near, SHARE * budget)
        if found is not None:
            return plan_of(prepared, found, [], time.perf_counter() - began)
    left = budget - (time.perf_counter() - began)
    return planned(problem, SearchOptions(budget=max(left, SHARE * budget))).plan


def _followed(prepared: Attempts, near: Plan, budget: float) -> SearchResult | None:
    """Where the motion of a plan leads; None where that is no plan."""
    degrees = prepared.problem.degrees
    degree = near.coefficients.shape[1] - 1
    if prepared.problem.raises_degree:
        degrees = (max(degree, *degrees),) * len(degrees)
    if degree > max(degrees):
        return None
    outcome = prepared.attempt(_start(prepared, near, degrees), 0, degrees, expiry(budget))
    if not outcome.holds:
        return None
    solution = outcome.solution
    return SearchResult(
        outcome,
        (outcome,),
        attempts=1,
        solved=1,
        iterations=solution.iterations,
        evaluations=solution.evaluations,
        work=outcome.work,
        ran_out_of_time=False,
        ran_out_of_patience=False,
        interrupted=False,
    )


def _start(prepared: Attempts, near: Plan, degrees: tuple[int, ...]) -> Start:
    """The motion of a plan, between the ends of the problem: on the same branches, with the same free coefficients."""
    powers = np.arange(near.coefficients.shape[1])
    of_share = near.coefficients * near.duration**powers  # of p, by powers of t / T
    branches = np.floor(np.array([of_share[:, 0], of_share.sum(axis=1)]) / np.pi + 0.5).astype(np.int64)
    variables = decision_variables(prepared.problem, degrees, branches, prepared.momentum)
    columns = basis(variables.polynomials.form).powers
    padded = np.pad(of_share, ((0, 0), (0, len(columns) - len(powers))))
    z: Array = np.linalg.solve(columns, padded.T).T[:, len(variables.polynomials.form.given) :]
    return Start(variables, variables.variables(z, near.angular_momentum))
