"""Where there is no plan, why: what is violated least in the nearest motion, and what no motion could mend."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from floatplan.arrays import Array
from floatplan.planning.constraints import applies
from floatplan.planning.result import AttemptResult, SearchResult
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import Start
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION


def explain(result: SearchResult) -> str:
    """Say, in sentences for a person, why the result of a search is no plan."""
    problem = result.spec.problem
    reasons = result.impossible
    interrupted = []
    if result.interrupted and not reasons:
        interrupted = ["The search was interrupted before it found a plan; there may be one."]
    flight = result.spec.flight
    sentences = [*interrupted, *reasons, *flight.difficulties(), *_nearest(result)]
    momentum = result.best.start_variables.angular_momentum(result.best.x)
    with_momentum = f"With {_numbers(momentum, '.4g')} kg m^2/s"
    sentences += [f"{with_momentum}, {error.reason}." for error in flight.motion_into_ground(momentum)]
    if result.interrupted:
        return " ".join(sentences)
    if result.ran_out_of_time and not result.ran_out_of_patience:
        sentences.append("The search ran out of time; a larger budget may help.")
    if result.other_momentum is not None:
        h = _numbers(result.other_momentum, ".6g")
        sentences.append(f"With flight.angular_momentum = [{h}] kg m^2/s a plan was found.")
    elif not reasons and result.best.start_variables.coefficients:
        sentences += _near_miss(result) or _more_freedom(problem)
    return " ".join(sentences)


def _wrong_way(best: AttemptResult) -> str:
    """What is wrong with the way to the goal in space, its turns or its tilt; empty for nothing."""
    if best.spec.problem.robot.in_plane or not np.isfinite(best.residual).all():
        return ""
    from floatplan.planning.lifting import wrong_way  # here, since most problems do without

    return wrong_way(best)


def _near_miss(result: SearchResult) -> list[str]:
    """What would make a plan of a nearest motion that violates next to nothing: more freedom does not help there.

    All of it is listed: by how much the motion exceeds every limit, so that with these it is a plan.
    """
    best = result.best
    residual = _residual(result)
    if not best.violation < 1e-3:  # [-] of a row's scale: a smaller violation is nearly a plan
        return []
    wishes = [f"the goal's orientation {_numbers(residual, '+.6g')} rad further"] if residual.any() else []
    for number, block in enumerate(result.spec.constraints):
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


def _residual(result: SearchResult) -> Array:
    """By how much (e,) the nearest motion misses the goal's orientation, rad; 0 within the tolerance."""
    residual = result.best.residual
    return np.where(np.abs(residual) <= ORIENTATION, 0.0, residual)


def _numbers(values: Array, form: str) -> str:
    return ", ".join(format(value, form) for value in values.tolist())


def _more_freedom(problem: Problem) -> list[str]:
    """Advice on what the problem fixes of the motion without need."""
    freedom = [] if problem.raises_degree else ['motion.degree = "auto"']
    if problem.flight.angular_momentum != "free":
        freedom.append('flight.angular_momentum = "free"')
    return [f"More freedom may help: {' or '.join(freedom)}."] if freedom else []


def _nearest(result: SearchResult) -> list[str]:
    """What is least violated in the nearest motion, and what to try; nothing of one that no start was tried for."""
    spec = result.spec
    best = result.best
    residual = _residual(result)
    sentences = []
    tried = result.counts["starts"]
    if not tried:
        return []
    wrong = _wrong_way(best)
    if residual.any():
        off = f"The nearest motion found misses the goal's orientation by {_numbers(residual, '+.6g')} rad"
        sentences.append(f"{off}; {wrong}." if wrong else f"{off}.")
    elif wrong:
        sentences.append(f"The nearest motion found reaches the goal's orientation, but {wrong}.")
    if best.worst.least < 0:
        number, row, value, s = best.worst.lowest
        block = spec.constraints[number]
        time = s * spec.problem.flight.duration
        amount = f"{-value * block.scale[row]:.4g} {block.unit}"
        violated = f"{block.labels[row]} is violated by {amount}"
        sentences.append(f"In the nearest motion found, {violated} at t = {time:.4f} s.")
    if not best.start_variables.coefficients:
        sentences.append("Degree 5 leaves nothing free to steer with, (16); raise motion.degree to 7.")
    counted = "1 start was" if tried == 1 else f"{tried} starts were"
    return [*sentences, f"{counted} tried, up to degree {max(best.start_variables.degrees)}."]


def impossible_ends(spec: FlightSpec, start: Start, of_rows: Array) -> Iterator[str]:
    """Yield what already fails at takeoff or landing, where positions, rates and accelerations are fixed.

    What the search can still change there, with a free h or free accelerations, does not count. ``of_rows``
    (rows, 2) are the values of all rows at both ends.
    """
    first = 0
    for block in spec.constraints:
        values = of_rows[first : first + len(block.labels)].T
        first += len(block.labels)
        if start.variables.chosen_at_ends & block.depends_at_ends_on:
            continue
        exists = applies(block, np.array([0.0, 1.0]))
        for end, (name, verb) in enumerate((("start", "takeoff"), ("goal", "landing"))):
            row = int(np.argmin(values[end]))
            if exists[end] and values[end, row] < -block.tolerance:
                amount = -values[end, row] * block.scale[row]
                violated = f"{block.labels[row]} is violated by {amount:.4g} {block.unit}"
                cause = block.cause.format(end=name)
                yield f"At {verb} the {name} itself is impossible: {violated} ({cause})."
