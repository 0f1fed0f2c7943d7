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
        told = "starts %(starts)d, solved %(solved)d, steps %(iterations)d: %(status)s"
        LOG.info(told, {**plan.solver, "status": plan.status})
        return SearchedPlan(plan, followed, work=followed.work)
    return _searched(problem, options, near, followed, began)


@one_thread
def _searched(
    problem: Problem, options: SearchOptions, near: Plan | None, followed: Followed | None, began: float
) -> SearchedPlan:
    """Search for what the kernel alone has not found; its sums are long enough for several threads of BLAS."""
    prepared = Attempts(problem, options.seed)
    if not prepared.momentum.free:
        refuse(motion_into_ground(problem, prepared.momentum.centre))
    reasons: list[str] = []
    result = None
    if near and prepared.constraints:
        result, options = _followed_from(near, prepared, options, began)
    if result is None:
        reasons = proven_impossible(problem, prepared) if prepared.constraints else []
        for reason in reasons:
            LOG.info("impossible: %s", reason)
        result = search(prepared, options, ATTEMPTS_FOR_THE_IMPOSSIBLE if reasons else None, followed)
    plan = _plan_of(prepared, result, reasons, time.perf_counter() - began)
    work = sum(outcome.work for outcome in result.outcomes)
    return SearchedPlan(plan, result.best, result.holding[1:], bool(reasons), result.ran_out_of_patience, work)


def _followed_from(
    near: Plan, prepared: Attempts, options: SearchOptions, began: float
) -> tuple[SearchResult | None, SearchOptions]:
    """Where the motion of a plan leads, None where that is no plan; and how to search for another then."""
    budget = np.inf if options.budget is None else options.budget
    degrees = prepared.problem.degrees
    degree = near.coefficients.shape[1] - 1
    if prepared.problem.raises_degree:
        degrees = (max(degree, *degrees),) * len(degrees)
    if degree <= max(degrees):
        outcome = prepared.attempt(_start(prepared, near, degrees), expiry(SHARE * budget))
        if outcome.holds:
            return SearchResult([outcome]), options
    if options.budget is not None:
        left = budget - (time.perf_counter() - began)
        options = replace(options, budget=max(left, SHARE * budget))
    return None, options


def _start(prepared: Attempts, near: Plan, degrees: tuple[int, ...]) -> Start:
    """The motion of a plan, between the ends of the problem: on the same branches, with the same free coefficients."""
    powers = np.arange(near.coefficients.shape[1])
    of_share = near.coefficients * near.duration**powers  # of p, by powers of t / T
    branches = np.floor(np.array([of_share[:, 0], of_share.sum(axis=1)]) / np.pi + 0.5).astype(np.int64)
    variables = decision_variables(prepared.problem, degrees, branches, prepared.momentum)
    columns = basis(variables.polynomials.form).powers
    padded = np.pad(of_share, ((0, 0), (0, len(columns) - len(powers))))
    z: Array = np.linalg.solve(columns, padded.T).T[:, len(variables.polynomials.form.given) :]
    return Start(variables, variables.variables(z, near.angular_momentum), at_once=True)


def _plan_of(prepared: Attempts, result: SearchResult, reasons: list[str], seconds: float) -> Plan:
    """Return the plan that a search ended at; ``reasons`` say why there can be none."""
    best = result.best
    unsolved = "interrupted" if result.interrupted and not reasons else "infeasible"
    return Plan.of_motion(
        prepared.problem,
        *motion_of(best),
        status=best.solution.status if best.holds else unsolved,
        ok=best.holds,
        explanation=explain(prepared.problem, prepared, result, reasons),
        solver={**result.counts, "seconds": seconds, "seed": prepared.seed},
    )


def motion_of(outcome: Outcome) -> tuple[SinePolynomials, Array, Array, Array | None]:
    """Where an attempt ended: its polynomials, their free coefficients z (n, width), h (e,), kg m^2/s, and b."""
    variables, x = outcome.variables, outcome.solution.x
    h = variables.angular_momentum(x)
    return variables.motion_class(h), variables.free_coefficients(x), h, outcome.coefficients
