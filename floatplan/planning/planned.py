"""The one way from a problem to a plan: a row of a batch where nothing is to be kept below a limit, else one search."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import refuse
from floatplan.kernel.batch import MOST_STARTS, Search
from floatplan.motion.flight import motion_into_ground
from floatplan.motion.sine_polynomial import SinePolynomials, basis
from floatplan.planning.attempt import ATTEMPTS, Attempts, Followed, Outcome, follow_together
from floatplan.planning.explanation import explain, proven_impossible
from floatplan.planning.search import ATTEMPTS_FOR_THE_IMPOSSIBLE, SearchOptions, SearchResult, expiry, search
from floatplan.planning.starts import Start
from floatplan.planning.transcription.variables import decision_variables
from floatplan.plans.plan import Plan
from floatplan.pool.threads import one_thread
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
COUNTS = ("starts", "solved", "iterations")
SHARE = 0.5  # [-] of the budget that the motion at hand may take before another is searched, and that this has at least


@dataclass(frozen=True, eq=False)
class SearchedPlan:
    """A plan, and where the search for it ended; ``others`` are further solutions, from the second best on.

    ``is_impossible`` says that no motion whatever can be a plan, ``gave_up`` that the search's patience ended: a longer
    one may find another plan. ``work`` is what the search did, instants of one body.
    """

    plan: Plan
    ended: Outcome | Followed
    others: tuple[Outcome, ...] = ()
    is_impossible: bool = False
    gave_up: bool = False
    work: float = 0.0

    @cached_property
    def best(self) -> Outcome:
        """The outcome that the plan was made of."""
        if isinstance(self.ended, Outcome):
            return self.ended
        return Attempts(self.plan.problem, self.plan.solver["seed"]).outcome_of(self.ended)


def planned(problem: Problem, options: SearchOptions, near: Plan | None = None) -> SearchedPlan:
    """Plan a flight and keep where the search ended.

    With limits or obstacles it begins with the motion of a plan ``near``, of the same robot, where there is one, and
    stays with that motion's kind, though a search might find a better one of another kind; it searches for another
    where that leads to none. Without limits and obstacles a search is as quick.

    Raises
    ------
    InputError
        What stands on the ground moves down at takeoff, or up at landing.
    """
    began = time.perf_counter()
    most = min(MOST_STARTS + options.starts - 1, ATTEMPTS)
    followed = follow_together(problem, Search(options.starts, most, options.seed))
    if followed and followed.status != "infeasible":
        plan = followed.answer.plan(problem, options.seed, time.perf_counter() - began)
        LOG.info("starts %d, solved %d, steps %d: %s", *map(plan.solver.get, COUNTS), plan.status)
        return SearchedPlan(plan, followed, work=followed.work)
    return _searched(problem, options, near, followed, began)


@one_thread
def _searched(
    problem: Problem, options: SearchOptions, near: Plan | None, followed: Followed | None, began: float
) -> SearchedPlan:
    """Search for what the kernel alone has not found; its sums are long enough for several threads of BLAS."""
    prepared = Attempts(problem, options.seed)
    if not prepared.momentum.free:
        refuse(motion_into_ground(prepared.problem, prepared.momentum.centre))
    reasons: list[str] = []
    result = _followed_from(near, prepared, options.budget) if near and prepared.constraints else None
    if result is None:
        if near and options.budget is not None:
            left = options.budget - (time.perf_counter() - began)
            options = replace(options, budget=max(left, SHARE * options.budget))
        reasons = proven_impossible(prepared) if prepared.constraints else []
        for reason in reasons:
            LOG.info("impossible: %s", reason)
        result = search(prepared, options, ATTEMPTS_FOR_THE_IMPOSSIBLE if reasons else None, followed)
    best = result.best
    unsolved = "interrupted" if result.interrupted and not reasons else "infeasible"
    plan = Plan.of_motion(
        prepared.problem,
        *motion_of(best),
        status=best.solution.status if best.holds else unsolved,
        ok=best.holds,
        explanation=explain(prepared, result, reasons),
        solver={**result.counts, "seconds": time.perf_counter() - began, "seed": prepared.seed},
    )
    work = sum(outcome.work for outcome in result.outcomes)
    return SearchedPlan(plan, best, result.holding[1:], bool(reasons), result.ran_out_of_patience, work)


def _followed_from(near: Plan, prepared: Attempts, budget: float | None) -> SearchResult | None:
    """Where the motion of a plan leads, between the ends of the problem: None where that is no plan.

    It begins on the same branches of the arcsine, with the same free coefficients.
    """
    degrees, powers = prepared.problem.degrees, np.arange(near.coefficients.shape[1])
    if prepared.problem.raises_degree:
        degrees = (max(powers[-1].item(), *degrees),) * len(degrees)
    if powers[-1] > max(degrees):
        return None
    of_share = near.coefficients * near.duration**powers  # of p, by powers of t / T
    branches = np.floor(np.array([of_share[:, 0], of_share.sum(axis=1)]) / np.pi + 0.5).astype(np.int64)
    variables = decision_variables(prepared.problem, degrees, branches, prepared.momentum)
    columns = basis(variables.polynomials.form).powers
    padded = np.pad(of_share, ((0, 0), (0, len(columns) - len(powers))))
    z: Array = np.linalg.solve(columns, padded.T).T[:, len(variables.polynomials.form.given) :]
    start = Start(variables, variables.variables(z, near.angular_momentum), at_once=True)
    outcome = prepared.attempt(start, expiry(None if budget is None else SHARE * budget))
    return SearchResult([outcome]) if outcome.holds else None


def motion_of(outcome: Outcome) -> tuple[SinePolynomials, Array, Array, Array | None]:
    """Where an attempt ended: its polynomials, their free coefficients z (n, width), h (e,), kg m^2/s, and b."""
    variables, x = outcome.variables, outcome.solution.x
    h = variables.angular_momentum(x)
    return variables.motion_class(h), variables.free_coefficients(x), h, outcome.coefficients
