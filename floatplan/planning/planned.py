"""Plans with where the search for them ended, so that it can go on from there."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from floatplan.arrays import Array
from floatplan.errors import refuse
from floatplan.kernel.batch import MOST_STARTS, Search
from floatplan.motion.flight import motion_into_ground
from floatplan.motion.sine_polynomial import SinePolynomials
from floatplan.planning.attempt import ATTEMPTS, Attempts, Outcome
from floatplan.planning.compiled import Followed, follow_together
from floatplan.planning.explanation import explain, proven_impossible
from floatplan.planning.search import ATTEMPTS_FOR_THE_IMPOSSIBLE, SAME, SearchOptions, SearchResult, search
from floatplan.planning.starts import Start
from floatplan.plans.plan import Plan
from floatplan.pool.threads import one_thread
from floatplan.problem.problem import Problem

LOG = logging.getLogger(__name__)
COUNTS = ("starts", "solved", "iterations")


@dataclass(frozen=True, eq=False)
class Planned:
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


def planned(problem: Problem, options: SearchOptions, attempts: int | None = None) -> Planned:
    """Plan a flight and keep where the search ended; ``attempts`` limits the starts.

    Raises
    ------
    InputError
        What stands on the ground moves down at takeoff, or up at landing.
    """
    began = time.perf_counter()
    most = min(MOST_STARTS + options.starts - 1, ATTEMPTS)
    followed = follow_together(problem, Search(options.starts, most, options.seed))
    if followed and followed.holds:
        plan = followed.plan(problem, options.seed, time.perf_counter() - began)
        LOG.info("starts %d, solved %d, steps %d: %s", *map(plan.solver.get, COUNTS), plan.status)
        return Planned(plan, followed, work=followed.work)
    return _searched(problem, options, attempts, followed, began)


@one_thread
def _searched(
    problem: Problem, options: SearchOptions, attempts: int | None, followed: Followed | None, began: float
) -> Planned:
    """Search for what the kernel alone has not found; its sums are long enough for several threads of BLAS."""
    prepared = Attempts(problem, options.seed)
    if not prepared.momentum.free:
        refuse(motion_into_ground(problem, prepared.momentum.centre))
    reasons = proven_impossible(problem, prepared) if prepared.constraints else []
    for reason in reasons:
        LOG.info("impossible: %s", reason)
    found = search(prepared, options, ATTEMPTS_FOR_THE_IMPOSSIBLE if reasons else attempts, followed)
    plan = plan_of(prepared, found, reasons, time.perf_counter() - began)
    return Planned(plan, found.best, found.holding[1:], bool(reasons), found.ran_out_of_patience, found.work)


def plan_of(prepared: Attempts, found: SearchResult, reasons: list[str], seconds: float) -> Plan:
    """Return the plan that a search ended at; ``reasons`` say why there can be none."""
    best = found.best
    unsolved = "interrupted" if found.interrupted and not reasons else "infeasible"
    return Plan.of_motion(
        prepared.problem,
        *_motion(best),
        status=best.solution.status if best.holds else unsolved,
        ok=best.holds,
        explanation=explain(prepared.problem, prepared, found, reasons),
        solver={
            "iterations": found.iterations,
            "evaluations": found.evaluations,
            "seconds": seconds,
            "seed": prepared.seed,
            "starts": found.attempts,
            "solved": found.solved,
        },
    )


def alternatives(found: Planned) -> Iterator[Planned]:
    """Yield the plans that the other solutions would make."""
    for outcome in found.others or _not_kept(found):
        yield Planned(replace(_moving_as(found.plan, outcome), status=outcome.solution.status), outcome)


def _not_kept(found: Planned) -> tuple[Outcome, ...]:
    """Solutions worse than the best, of starts that the kernel has followed together: now one by one."""
    solver, best = found.plan.solver, found.best
    if found.best.starts == 1 or solver["solved"] < 2:
        return ()
    prepared = Attempts(found.plan.problem, solver["seed"])
    options = SearchOptions(solver["seed"], solver["solved"])
    again = search(prepared, options, solver["starts"])
    return tuple(other for other in again.holding if other.objective_value > best.objective_value * (1 + SAME))


def polished(found: Planned, tighter: Problem) -> Planned | None:
    """Follow the motion found to the nearest one that meets a tighter problem; None where that leads to none.

    The plan answers the problem that it answered before.
    """
    plan, best = found.plan, found.best
    prepared = Attempts(tighter, plan.solver["seed"], best.variables.momentum)
    outcome = prepared.attempt(Start(best.variables, best.solution.x), 0, best.degrees)
    if not outcome.holds:
        return None
    solver = {
        **plan.solver,
        "iterations": plan.solver["iterations"] + outcome.solution.iterations,
        "evaluations": plan.solver["evaluations"] + outcome.solution.evaluations,
    }
    return Planned(replace(_moving_as(plan, outcome), solver=solver), outcome)


def _moving_as(plan: Plan, outcome: Outcome) -> Plan:
    return plan.moving_as(*_motion(outcome))


def _motion(outcome: Outcome) -> tuple[SinePolynomials, Array, Array, Array | None]:
    """Where an attempt ended: its polynomials, their free coefficients z (n, width), h (e,), kg m^2/s, and b."""
    variables, x = outcome.variables, outcome.solution.x
    h = variables.angular_momentum(x)
    return variables.motion_class(h), variables.free_coefficients(x), h, outcome.coefficients
