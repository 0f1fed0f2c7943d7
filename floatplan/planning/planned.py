"""The one way from a problem to a plan: a batch of one where there are no inequalities, else one search.

Where there is no plan it says why: what is violated least in the nearest motion, and what no motion could mend.
"""

import logging
import math
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.compiled.attempts import is_planar
from floatplan.compiled.numbers import Numbers, is_plain
from floatplan.errors import refuse
from floatplan.motion.flight import flight_of
from floatplan.motion.sine_polynomial import SinePolynomials, basis
from floatplan.planning.attempt import Attempts
from floatplan.planning.search import SearchOptions, SearchResult, expiry, search
from floatplan.planning.starts import Start
from floatplan.planning.together import BatchedStarts, follow_unconstrained
from floatplan.planning.transcription.result import AttemptResult
from floatplan.planning.transcription.variables import decision_variables
from floatplan.plans.plan import Plan
from floatplan.plans.plans import ALL_HOLDS, GOAL_MET, Answer
from floatplan.pool import one_thread
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION

LOG = logging.getLogger(__name__)
LOGGED = ("starts", "solved", "iterations")
SHARE = 0.5  # [-] of the budget that the motion at hand may take before another is searched, and that this has at least
INTERRUPTED = "The search was interrupted before it found a plan; there may be one."
NEARLY = 1e-3  # [-] of a row's scale: a smaller violation is nearly a plan


@dataclass(frozen=True, eq=False)
class SearchedPlan:
    """A plan, and the attempt that it was made of.

    Attributes
    ----------
    plan : Plan
    result : AttemptResult, or of a problem without inequalities the batch of which it is the only one
    others : further solutions, from the second best on
    gave_up : whether the search's patience ended: a longer one may find another plan
    work : instants of one body, of the whole search
    """

    plan: Plan
    result: AttemptResult | BatchedStarts
    others: tuple[AttemptResult, ...] = ()
    gave_up: bool = False
    work: float = 0.0

    @property
    def answer(self) -> Answer:
        """In numbers."""
        return Answer.of_plan(self.plan, self.plan.status)

    @cached_property
    def best(self) -> AttemptResult:
        """The attempt that the plan was made of."""
        if isinstance(self.result, AttemptResult):
            return self.result
        return self.result.result(0, self.plan.problem, self.plan.solver["seed"])


def searched_answer(result: SearchResult) -> Answer:
    """Return what a search ended with, in numbers."""
    best = result.best
    counts: dict[str, Any] = result.counts
    unsolved = "impossible" if result.impossible else "not_found"
    return Answer(
        status=best.status if best.holds else unsolved,
        objective=best.objective_value if best.holds else np.nan,
        angular_momentum=float(best.start_variables.angular_momentum(best.x)[0]),
        residual=float(np.linalg.norm(best.missed)),
        coefficients=best.written,
        **counts,
        message=explain(result),
    )


def searched_plan(result: SearchResult) -> SearchedPlan:
    """Return what a search ended with, as a plan."""
    best = result.best
    prepared = result.prepared
    unsolved = "interrupted" if result.interrupted and not result.impossible else "infeasible"
    plan = Plan.of_motion(
        prepared.problem,
        *motion_of(best),
        status=best.status if best.holds else unsolved,
        ok=best.holds,
        explanation=explain(result),
        solver={**result.counts, "seconds": result.seconds, "seed": prepared.seed},
    )
    return SearchedPlan(
        plan=plan,
        result=best,
        others=result.holding[1:],
        gave_up=result.ran_out_of_patience,
        work=result.work,
    )


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
    found = found_for(problem, options, near)
    return found if isinstance(found, SearchedPlan) else searched_plan(found)


def found_for(problem: Problem, options: SearchOptions, near: Plan | None = None) -> SearchedPlan | SearchResult:
    """What :func:`planned` makes a plan of, where the answer in numbers may be enough; errors as above."""
    began = time.perf_counter()
    prepared = None
    if is_plain(problem) and not problem.raises_degree:
        followed = follow_unconstrained(problem, Numbers.of_problems([problem]), options.starts, options.seed)
        if followed.holds(0):
            plan = followed.answer(0).plan(problem, options.seed, time.perf_counter() - began)
            LOG.info("starts %d, solved %d, steps %d: %s", *map(plan.solver.get, LOGGED), plan.status)
            return SearchedPlan(plan, followed, work=followed.attempts.row(0).work)
        prepared = followed.prepared(0, problem, options.seed)
    result = _searched(prepared or Attempts(problem, options.seed), options, near, began)
    return replace(result, seconds=time.perf_counter() - began)


@one_thread
def _searched(prepared: Attempts, options: SearchOptions, near: Plan | None, began: float) -> SearchResult:
    """Search for what the kernel alone has not found; its sums are long enough for several threads of BLAS."""
    problem = prepared.problem
    if not prepared.momentum.free:
        refuse(flight_of(problem).motion_into_ground(prepared.momentum.centre))
    result = _followed_from(near, prepared, options.budget) if near and problem.has_inequalities else None
    if result is not None:
        return result
    if near and options.budget is not None:
        left = options.budget - (time.perf_counter() - began)
        options = replace(options, budget=max(left, SHARE * options.budget))
    if problem.robot.in_plane is None:
        from floatplan.planning.in_space import search_in_space  # here, since most problems do without

        return search_in_space(prepared, options)
    return search(prepared, options)


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
    z: Array = np.linalg.solve(columns, padded.T).T[:, len(basis(variables.polynomials.form).given) :]
    start = Start(variables, variables.variables(z, near.angular_momentum), at_once=True)
    stop = expiry(None if budget is None else SHARE * budget)
    if prepared.problem.robot.in_plane is None:
        from floatplan.planning.in_space import follow_motion  # here, since most problems do without

        result = follow_motion(prepared, start, stop)
    else:
        result = prepared.attempt(start, stop)
    return SearchResult(prepared, [result]) if result and result.holds else None


def motion_of(result: AttemptResult) -> tuple[SinePolynomials, Array, Array, Array | None]:
    """Where an attempt ended: its polynomials, their free coefficients z (n, width), h (e,), kg m^2/s, and b."""
    variables, x = result.variables, result.x
    h = variables.angular_momentum(x)
    return variables.motion_class(h), variables.free_coefficients(x), h, result.coefficients


def explain(found: SearchResult) -> str:
    """Say, in sentences for a person, what the search found and why it is no plan where it is none."""
    prepared = found.prepared
    if found.best.holds:
        return ALL_HOLDS if prepared.constraints else GOAL_MET
    problem = prepared.problem
    reasons = found.impossible
    interrupted = [INTERRUPTED] if found.interrupted and not reasons else []
    flight = flight_of(problem)
    sentences = [*interrupted, *reasons, *flight.difficulties(), *_nearest(found)]
    momentum = found.best.start_variables.angular_momentum(found.best.x)
    sentences += [
        f"With {_numbers(momentum, '.4g')} kg m^2/s, {error.reason}." for error in flight.motion_into_ground(momentum)
    ]
    if found.interrupted:
        return " ".join(sentences)
    if found.ran_out_of_time and not found.ran_out_of_patience:
        sentences.append("The search ran out of time; a larger budget may help.")
    if found.momentum_found is not None:
        h = _numbers(found.momentum_found, ".6g")
        sentences.append(f"With flight.angular_momentum = [{h}] kg m^2/s a plan was found.")
    elif not reasons and found.best.start_variables.coefficients:
        sentences += _hardly_missed(found) or _more_freedom(problem)
    return " ".join(sentences)


def _wrong_way(best: AttemptResult) -> str:
    """What is wrong with the way to the goal in space, its turns or its tilt; empty for nothing."""
    if is_planar(best.model.flight) or not np.isfinite(best.missed).all():
        return ""
    from floatplan.planning.in_space import wrong_way  # here, since most problems do without

    return wrong_way(best)


def _hardly_missed(found: SearchResult) -> list[str]:
    """What would make a plan of a nearest motion that violates next to nothing: more freedom is no answer to that.

    All of it is said: of each limit that the motion exceeds, by how much, so that with these it is a plan.
    """
    best, missed = found.best, _missed_turn(found)
    if not best.violation < NEARLY:
        return []
    wishes = [f"the goal's orientation {_numbers(missed, '+.6g')} rad further"] if missed.any() else []
    for number, block in enumerate(found.prepared.constraints):
        violated = np.flatnonzero((best.worst.block == number) & (best.worst.value < -block.tolerance))
        amounts: dict[str, float] = {}  # in the block's unit; a limit has a row for either sign
        for at in violated.tolist():
            row = int(best.worst.row[at])
            label = block.labels[row]
            amounts[label] = max(amounts.get(label, 0.0), float(-best.worst.value[at] * block.scale[row]))
        for label, amount in amounts.items():
            wishes.append(block.relaxed.format(label=label, amount=f"{_rounded_up(amount)} {block.unit}"))
    if not wishes:
        return []
    listed = f"{', '.join(wishes[:-1])} and {wishes[-1]}" if len(wishes) > 1 else wishes[0]
    return [f"It would be a plan with {listed}; another seed, or more starts, may find one without that."]


def _rounded_up(amount: float) -> str:
    """A positive number in two digits, not below it."""
    return f"{amount + 0.05 * 10.0 ** math.floor(math.log10(amount)):.1e}"


def _missed_turn(found: SearchResult) -> Array:
    """By how much (e,) the nearest motion misses the goal's orientation, rad; 0 within the tolerance."""
    missed = found.best.missed
    return np.where(np.abs(missed) <= ORIENTATION, 0.0, missed)


def _numbers(values: Array, form: str) -> str:
    return ", ".join(format(value, form) for value in values.tolist())


def _more_freedom(problem: Problem) -> list[str]:
    """Advice on what the problem fixes of the motion without need."""
    freedom = [] if problem.raises_degree else ['motion.degree = "auto"']
    if problem.flight.angular_momentum != "free":
        freedom.append('flight.angular_momentum = "free"')
    return [f"More freedom may help: {' or '.join(freedom)}."] if freedom else []


def _nearest(found: SearchResult) -> list[str]:
    """What is least violated in the nearest motion, and what to try; nothing of one that no start was tried for."""
    prepared = found.prepared
    best, missed, sentences = found.best, _missed_turn(found), []
    tried = found.counts["starts"]
    if not tried:
        return []
    wrong = _wrong_way(best)
    if missed.any():
        off = f"The nearest motion found misses the goal's orientation by {_numbers(missed, '+.6g')} rad"
        sentences.append(f"{off}; {wrong}." if wrong else f"{off}.")
    elif wrong:
        sentences.append(f"The nearest motion found reaches the goal's orientation, but {wrong}.")
    if best.worst.least < 0:
        number, row, value, s = best.worst.lowest
        block, time = prepared.constraints[number], s * prepared.problem.flight.duration
        amount = f"{-value * block.scale[row]:.4g} {block.unit}"
        violated = f"{block.labels[row]} is violated by {amount}"
        sentences.append(f"In the nearest motion found, {violated} at t = {time:.4f} s.")
    if not best.start_variables.coefficients:
        sentences.append("Degree 5 leaves nothing free to steer with, (16); raise motion.degree to 7.")
    counted = "1 start was" if tried == 1 else f"{tried} starts were"
    return [*sentences, f"{counted} tried, up to degree {max(best.start_variables.degrees)}."]
