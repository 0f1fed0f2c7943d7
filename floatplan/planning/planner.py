"""From a problem to a plan."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.motion.planar.ballistics import ballistics
from floatplan.motion.planar.bounds import angular_momentum_interval
from floatplan.planning.attempt import Attempts, Outcome
from floatplan.planning.contact import refuse_motion_into_ground
from floatplan.planning.explanation import explain, proven_impossible
from floatplan.planning.search import ATTEMPTS_FOR_THE_IMPOSSIBLE, search
from floatplan.planning.starts import Start
from floatplan.plans.plan import Plan
from floatplan.problem.problem import Problem
from floatplan.robot.leak import refuse_leak


def plan(
    problem: Problem,
    *,
    seed: int = 0,
    starts: int = 1,
    budget: float | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Plan a flight.

    Parameters
    ----------
    problem : Problem
    seed : int
        Of the random starts; the same seed gives the same plan.
    starts : int
        Solved starts to choose the best from; 1 is the quick way. More are never worse, unless a budget ends them.
    budget : float, optional
        Seconds, by the clock, after which the search ends with the best motion so far; left out, so much work as takes
        about 7 s, counted without a clock: the same problem and seed then have the same answer everywhere.
    jobs : int
        Processes among which the starts are shared; they find what one finds, sooner.
    progress : callable, optional
        Told in a few words what the search is doing, about once a second.

    Returns
    -------
    Plan
        Always: its ``ok``, ``status`` and ``explanation`` say whether it is one; where it is not, it is the nearest
        motion found.

    Raises
    ------
    InputError
        ``starts``, ``budget`` or ``jobs`` is not positive; the robot's joints make so much angular momentum out of
        the plane that a motion in it would mean nothing; or what stands on the ground moves down at takeoff.
    """
    return planned(problem, seed=seed, starts=starts, budget=budget, jobs=jobs, progress=progress).plan


@dataclass(frozen=True, eq=False)
class Planned:
    """A plan, and where the search for it ended; ``others`` are further solutions, from the second best on."""

    plan: Plan
    best: Outcome
    others: tuple[Outcome, ...] = ()


def planned(
    problem: Problem,
    *,
    seed: int,
    starts: int,
    budget: float | None,
    jobs: int,
    progress: Callable[[str], None] | None,
) -> Planned:
    """Plan a flight, see :func:`plan`, and keep where the search ended."""
    for name, value in (("starts", starts), ("budget", budget), ("jobs", jobs)):
        if value is not None and not value > 0:
            raise InputError(f"{value} is not positive", element=name)
    began = time.perf_counter()
    refuse_leak(problem.robot)
    bounds = angular_momentum_interval(problem)
    asked = problem.flight.angular_momentum
    if asked != "free":
        refuse_motion_into_ground(problem, sum(bounds) / 2 if isinstance(asked, str) else float(asked))
    prepared = Attempts(problem, bounds, seed)
    reasons = proven_impossible(problem, prepared) if prepared.constraints else []
    found = search(
        prepared,
        wanted=starts,
        budget=budget,
        jobs=jobs,
        attempts=ATTEMPTS_FOR_THE_IMPOSSIBLE if reasons else None,
        progress=progress,
    )
    best = found.best
    seconds = time.perf_counter() - began
    polynomials = best.variables.polynomials
    plan = Plan(
        problem=problem,
        centre=read_only(polynomials.centre),
        amplitude=read_only(polynomials.amplitude),
        coefficients=_coefficients(best),
        angular_momentum=_angular_momentum(best),
        angular_momentum_bounds=bounds,
        ballistics=ballistics(problem),
        status=best.solution.status if best.holds else "infeasible",
        ok=best.holds,
        explanation=explain(problem, prepared, found, reasons, bounds),
        solver={
            "iterations": found.iterations,
            "evaluations": found.evaluations,
            "seconds": seconds,
            "seed": seed,
            "starts": found.attempts,
            "solved": found.solved,
        },
    )
    return Planned(plan, best, found.holding[1:])


def alternatives(found: Planned) -> Iterator[Planned]:
    """Yield the plans that the other solutions would make."""
    for outcome in found.others:
        yield Planned(replace(_moving_as(found.plan, outcome), status=outcome.solution.status), outcome)


def polished(found: Planned, tighter: Problem) -> Planned | None:
    """Follow the motion found to the nearest one that meets a tighter problem; None where that leads to none.

    The plan answers the problem that it answered before.
    """
    plan, best = found.plan, found.best
    prepared = Attempts(tighter, plan.angular_momentum_bounds, plan.solver["seed"])
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
    return replace(
        plan,
        coefficients=_coefficients(outcome),
        angular_momentum=_angular_momentum(outcome),
    )


def _angular_momentum(outcome: Outcome) -> float:
    """The h, kg m^2/s, of where an attempt ended, about the plane's normal."""
    return float(outcome.variables.angular_momentum(outcome.solution.x)[0])


def _coefficients(outcome: Outcome) -> Array:
    """The paper's b (n, k+1) of where an attempt ended."""
    variables = outcome.variables
    free = variables.free_coefficients(outcome.solution.x)
    return read_only(variables.polynomials.powers_of_seconds(free))
