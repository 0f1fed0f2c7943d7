"""The one way from a problem to a plan: a batch of one where there are no inequalities, else one search."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import flag
from floatplan.arrays import Array
from floatplan.errors import refuse
from floatplan.motion.sine_polynomial import basis
from floatplan.planning.batch import follow_unconstrained
from floatplan.planning.kernel_input.numbers import Numbers
from floatplan.planning.options import SearchOptions
from floatplan.planning.result import SearchedPlan, SearchResult
from floatplan.planning.search import Search, expiry
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import Start, decision_variables
from floatplan.plans.plan import Plan
from floatplan.plans.plans import ALL_HOLDS, GOAL_MET, PlanEntry
from floatplan.pool import one_thread
from floatplan.problem.file import as_problem
from floatplan.problem.jump import ONLY_THE_FLIGHT
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
SHARE = 0.5  # [-] of the budget that the motion at hand may take before another is searched, and that this has at least


def plan(
    problem: Problem | str | Path,
    *,
    seed: int = 0,
    starts: int = 1,
    budget: float | None = None,
    progress: Callable[[str], None] | None = None,
    prove: bool = False,
) -> Plan:
    """Plan a flight.

    Parameters
    ----------
    problem : Problem, or path of a problem file
    seed : int
        Of the random starts; the same seed gives the same plan.
    starts : int
        Solved starts to choose the best from, at most 1000; 1 is the quick way. More are never worse, unless a
        budget ends them.
    budget : float, optional
        Seconds, by the clock, after which the search ends with the best motion so far; left out, so much work as takes
        about 2 s at most, counted without a clock: the same problem and seed then have the same plan everywhere.
    progress : callable, optional
        Called with a few words on what the search is doing, about once a second.
    prove : bool
        Whether to prove the plan too, at every instant: where the best motion is not proved, it is corrected, or
        the next best is tried.

    Returns
    -------
    Plan
        Always: its ``ok``, ``status`` and ``explanation`` say whether it is one; where it is not, it is the nearest
        motion found. With ``prove`` its ``certificate`` says what was proved, None where no plan was found; one that
        is refuted is not ``ok``, one that stays undecided is, and ``explanation`` says what is not proved.

    Raises
    ------
    InputError
        The problem is none, or its file is wrong; a number is none, or out of its range; or what stands on the ground
        moves down at takeoff.
    """
    searched = planned(as_problem(problem), SearchOptions(seed, starts, budget, progress))
    plan = searched.plan
    if flag(prove, "prove"):
        from floatplan.planning.repair import proved_plan  # here, because most plans do without

        plan = proved_plan(searched)
    if plan.problem.jump:
        return plan.with_record(replace(plan.record, explanation=f"{plan.explanation} {ONLY_THE_FLIGHT}"))
    return plan


def planned(problem: Problem, options: SearchOptions, near: Plan | None = None) -> SearchedPlan:
    """Plan a flight, and return where the search ended too.

    With limits or obstacles it begins with the motion of a plan ``near``, of the same robot, where there is one, and
    stays with that motion's kind, though a search might find a better one of another kind; it searches for another
    where that leads to none. Without limits and obstacles a search is as quick.

    Raises
    ------
    InputError
        What stands on the ground moves down at takeoff, or up at landing.
    """
    result = search_for(problem, options, near)
    return result if isinstance(result, SearchedPlan) else searched_plan(result)


def search_for(problem: Problem, options: SearchOptions, near: Plan | None = None) -> SearchedPlan | SearchResult:
    """What :func:`planned` makes a plan of, where numbers may be enough; errors as above."""
    started = time.perf_counter()
    search = None
    if problem.is_plain and not problem.raises_degree:
        batch = follow_unconstrained(problem, Numbers.of_problems([problem]), options.starts, options.seed)
        if solution := batch.answer(0):
            plan = solution.plan(problem, options.seed, time.perf_counter() - started)
            counts = [plan.solver[name] for name in ("starts", "solved", "iterations")]
            LOG.info("starts %d, solved %d, steps %d: %s", *counts, plan.status)
            return SearchedPlan(plan, lambda: batch.result(0, problem), work=batch.searches.pointer[0].work)
        search = batch.search(0, problem, options)
    elif problem.robot.in_plane is None:
        from floatplan.planning.in_space import SpatialSearch  # here, because flights in a plane do without

        search = SpatialSearch(problem, options)
    result = _searched(search or Search(problem, options), near, started)
    return replace(result, seconds=time.perf_counter() - started)


@one_thread
def _searched(search: Search, near: Plan | None, started: float) -> SearchResult:
    """Search for what the kernel has not solved in one call; its sums are long enough for several threads of BLAS."""
    spec = search.spec
    budget = search.options.budget
    if spec.problem.ground and not spec.momentum.axes.size:
        refuse(spec.flight.motion_into_ground(spec.momentum.centre))
    if near and spec.problem.has_inequalities:
        start = _start_near(near, spec)
        stop = expiry(None if budget is None else SHARE * budget)
        result = search.follow_near(start, stop) if start else None
        if result and result.holds:
            return SearchResult(spec, search.options.seed, [result])
    if near and budget is not None:
        left = budget - (time.perf_counter() - started)
        search.options = replace(search.options, budget=max(left, SHARE * budget))
    return search.run()


def _start_near(near: Plan, spec: FlightSpec) -> Start | None:
    """The motion of a plan, between the ends of the problem; None where its degree is not allowed.

    It has the same branches of the arcsine, and the same free coefficients.
    """
    degrees = spec.problem.degrees
    powers = np.arange(near.coefficients.shape[1])
    if spec.problem.raises_degree:
        degrees = (max(powers[-1].item(), *degrees),) * len(degrees)
    if powers[-1] > max(degrees):
        return None
    of_share = near.coefficients * near.duration**powers  # of p, by powers of t / T
    branches = np.floor(np.array([of_share[:, 0], of_share.sum(axis=1)]) / np.pi + 0.5).astype(np.int64)
    variables = decision_variables(spec.problem, degrees, branches, spec.momentum)
    columns = basis(variables.polynomials.form).powers
    padded = np.pad(of_share, ((0, 0), (0, len(columns) - len(powers))))
    z: Array = np.linalg.solve(columns, padded.T).T[:, len(basis(variables.polynomials.form).fixed) :]
    return Start(variables, variables.variables(z, near.angular_momentum), at_once=True)


def searched_numbers(result: SearchResult) -> PlanEntry:
    """Return what a search ended with, in numbers."""
    best = result.best
    counts: dict[str, Any] = result.counts
    unsolved = "impossible" if result.impossible else "not_found"
    return PlanEntry(
        status=best.status if best.holds else unsolved,
        objective=best.objective_value if best.holds else np.nan,
        angular_momentum=float(best.start_variables.angular_momentum(best.x)[0]),
        residual=float(np.linalg.norm(best.residual)),
        coefficients=best.written,
        **counts,
        message=_explanation(result),
    )


def _explanation(result: SearchResult) -> str:
    """Say, in sentences for a person, what came of a search."""
    if result.best.holds:
        return ALL_HOLDS if result.spec.constraints else GOAL_MET
    from floatplan.planning.explanation import explain  # here, since plans do without

    return explain(result)


def searched_plan(result: SearchResult) -> SearchedPlan:
    """Return what a search ended with, as a plan."""
    best = result.best
    unsolved = "interrupted" if result.interrupted and not result.impossible else "infeasible"
    plan = Plan.of_motion(
        result.spec.problem,
        *best.motion,
        best.coefficients,
        status=best.status if best.holds else unsolved,
        ok=best.holds,
        explanation=_explanation(result),
        solver={**result.counts, "seconds": result.seconds, "seed": result.seed},
    )
    return SearchedPlan(
        plan=plan,
        result=best,
        others=result.holding[1:],
        gave_up=result.ran_out_of_patience,
        work=sum(tried.work for tried in result.results),
    )
