"""From a problem to a plan."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from floatplan.arguments import flag
from floatplan.planning.options import SearchOptions
from floatplan.planning.planned import planned
from floatplan.plans.plan import Plan
from floatplan.problem.file import given_problem
from floatplan.problem.jump import FLIGHT_ALONE
from floatplan.problem.problem import Problem


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
        about 2 s at most, counted without a clock: the same problem and seed then have the same answer everywhere.
    progress : callable, optional
        Told in a few words what the search is doing, about once a second.
    prove : bool
        Whether to prove the plan too, at every instant: where the best motion found is not proved, it is corrected, or
        the next best is tried. Flights in space are not proved yet.

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
    found = planned(given_problem(problem), SearchOptions(seed, starts, budget, progress))
    plan = found.plan
    if flag(prove, "prove") and plan.robot.in_plane:
        from floatplan.planning.repair import proved_plan  # here, because most plans do without

        plan = proved_plan(found)
    if plan.problem.jump:
        return plan.with_record(replace(plan.record, explanation=f"{plan.explanation} {FLIGHT_ALONE}"))
    return plan
