"""Why there is no plan: what is violated least in the nearest motion, and what no motion could mend."""

from __future__ import annotations

import math

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.flight import difficulties, impossibilities, motion_into_ground
from floatplan.planning.attempt import Attempts
from floatplan.planning.search import SearchResult
from floatplan.planning.transcription.constraints import applies
from floatplan.planning.transcription.program import changes_at_ends
from floatplan.planning.transcription.trajectory import sample_also, trajectory
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION

INTERRUPTED = "The search was interrupted before it found a plan; there may be one."
NEARLY = 1e-3  # [-] of a row's scale: a smaller violation is nearly a plan


def proven_impossible(prepared: Attempts) -> list[str]:
    """Reasons, one sentence each, why no motion whatever can be a plan; empty where none is known."""
    return [*_impossible_ends(prepared), *impossibilities(prepared.problem)]


def explain(prepared: Attempts, found: SearchResult, reasons: list[str]) -> str:
    """Say, in sentences for a person, what the search found and why it is no plan where it is none.

    ``reasons`` are those of :func:`proven_impossible`.
    """
    if found.best.holds:
        return "Every constraint holds at all times." if prepared.constraints else "The goal is met."
    problem = prepared.problem
    interrupted = [INTERRUPTED] if found.interrupted and not reasons else []
    sentences = [*interrupted, *reasons, *difficulties(problem), *_nearest(prepared, found)]
    momentum = found.best.variables.angular_momentum(found.best.solution.x)
    sentences += [
        f"With {_numbers(momentum, '.4g')} kg m^2/s, {error.reason}." for error in motion_into_ground(problem, momentum)
    ]
    if found.interrupted:
        return " ".join(sentences)
    if found.ran_out_of_time and not found.ran_out_of_patience:
        sentences.append("The search ran out of time; a larger budget may help.")
    if not reasons and found.best.variables.coefficients:
        sentences += _hardly_missed(prepared, found) or _more_freedom(problem)
    return " ".join(sentences)


def _hardly_missed(prepared: Attempts, found: SearchResult) -> list[str]:
    """What would make a plan of a nearest motion that violates next to nothing: more freedom is no answer to that."""
    best, missed = found.best, _missed_turn(found)
    if not best.violation < NEARLY:
        return []
    wishes = [f"the goal's orientation {_numbers(missed, '+.6g')} rad further"] if missed.any() else []
    for number, block in enumerate(prepared.constraints):
        violated = np.flatnonzero((best.worst.block == number) & (best.worst.value < -block.tolerance))
        if violated.size:
            lowest = violated[np.argmin(best.worst.value[violated])]
            row = int(best.worst.row[lowest])
            amount = -best.worst.value[lowest] * block.scale[row]
            rounded = f"{amount + 0.05 * 10.0 ** math.floor(math.log10(amount)):.1e}"  # two digits, not below it
            wishes.append(block.relaxed.format(label=block.labels[row], amount=f"{rounded} {block.unit}"))
    return [f"It would be a plan with {' and '.join(wishes)}; another seed, or more starts, may find one without that."]


def _missed_turn(found: SearchResult) -> Array:
    """By how much (e,) the nearest motion misses the goal's orientation, rad; 0 within the tolerance."""
    missed = found.best.solution.evaluation.detail.residual[0]
    return np.where(np.abs(missed) > ORIENTATION, missed, 0.0)


def _numbers(values: Array, form: str) -> str:
    return ", ".join(format(value, form) for value in values.tolist())


def _more_freedom(problem: Problem) -> list[str]:
    """Advice on what the problem fixes of the motion without need."""
    freedom = [] if problem.raises_degree else ['motion.degree = "auto"']
    if problem.flight.angular_momentum != "free":
        freedom.append('flight.angular_momentum = "free"')
    return [f"More freedom may help: {' or '.join(freedom)}."] if freedom else []


def _impossible_ends(prepared: Attempts) -> list[str]:
    """What already fails at takeoff or landing, where positions, rates and accelerations are given.

    What the search can still change there, with a free h or free accelerations, does not count.
    """
    start = prepared.plain_start
    ends = sample_also(prepared.model.nodes(0, start.variables.polynomials.form), np.array([0.0, 1.0]))
    motion = trajectory(prepared.model, start.variables, ends, start.x).at_goal()
    sentences = []
    for block in prepared.constraints:
        if changes_at_ends(start.variables, block):
            continue
        values = block.values(motion)[-2:]
        exists = applies(block, motion.sampling.grid.s[-2:])
        for end, (name, verb) in enumerate((("start", "takeoff"), ("goal", "landing"))):
            row = int(np.argmin(values[end]))
            if exists[end] and values[end, row] < -block.tolerance:
                amount = -values[end, row] * block.scale[row]
                violated = f"{block.labels[row]} is violated by {amount:.4g} {block.unit}"
                cause = block.cause.format(end=name)
                sentences.append(f"At {verb} the {name} itself is impossible: {violated} ({cause}).")
    return sentences


def _nearest(prepared: Attempts, found: SearchResult) -> list[str]:
    """What is least violated in the nearest motion, and what to try."""
    best, missed, sentences = found.best, _missed_turn(found), []
    if missed.any():
        sentences.append(f"The nearest motion found misses the goal's orientation by {_numbers(missed, '+.6g')} rad.")
    if best.worst.least < 0:
        number, row, value, s = best.worst.lowest
        block, time = prepared.constraints[number], s * prepared.problem.flight.duration
        amount = f"{-value * block.scale[row]:.4g} {block.unit}"
        violated = f"{block.labels[row]} is violated by {amount}"
        sentences.append(f"In the nearest motion found, {violated} at t = {time:.4f} s.")
    if not best.variables.coefficients:
        sentences.append("Degree 5 leaves nothing free to steer with, (16); raise motion.degree to 7.")
    return [*sentences, f"{found.counts['starts']} starts were tried, up to degree {max(best.variables.degrees)}."]
