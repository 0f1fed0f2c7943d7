"""Starts of plans without inequalities, in the kernel's order (``starts.hpp``): so the answers are the same without it.

Candidates land on branches of the arcsine drawn at random, first with no free part, later with one drawn too. Of each
of the first rounds those are followed that miss (14) least after a few steps towards where it would hold, were it
linear. Where all of these fail, all that are drawn are followed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import count

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.batch import (
    CANDIDATES,
    CHANGED_BRANCHES,
    FOLLOWED,
    LEVEL_OF_STARTS,
    RANKED_ROUNDS,
    SPREADS_OF_STARTS,
    STEP_TO_RANK,
    STEPS_TO_RANK,
    TOO_WILD,
)
from floatplan.planning.transcription.objectives import Objective
from floatplan.planning.transcription.program import FlightProgram
from floatplan.planning.transcription.trajectory import FlightModel, Sampling
from floatplan.planning.transcription.variables import DecisionVariables

WORD = 2**64 - 1
STREAM = 0x632BE59BD9B4E019  # from one candidate's random numbers to the next's


class SplitMix:
    """Random numbers of Steele, Lea and Flood (2014), normal ones by Box and Muller: those of ``kernel.cpp``."""

    def __init__(self, seed: int) -> None:
        self._state = seed & WORD

    def uniform(self) -> float:
        """Return a number between 0 and 1."""
        self._state = (self._state + 0x9E3779B97F4A7C15) & WORD
        z = self._state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & WORD
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
        z ^= z >> 31
        return (z >> 11) * 2.0**-53 + 2.0**-54

    def normal(self) -> float:
        """Return a number of mean 0 and variance 1."""
        length = math.sqrt(-2 * math.log(self.uniform()))
        return length * math.cos(6.283185307179586 * self.uniform())


def ranked_starts(
    model: FlightModel,
    variables_on: Callable[[IntArray], DecisionVariables],
    make_objective: Callable[[DecisionVariables, Sampling], Objective],
    seed: int,
    joints: int,
) -> Iterator[tuple[DecisionVariables, Array]]:
    """Yield starts (variables and x), the most promising of each round first.

    ``variables_on`` takes branches (2, n) of the arcsine at takeoff and landing.
    """

    def drawn(candidate: int) -> tuple[DecisionVariables, Array]:
        branches, draw = _drawn(candidate, seed, joints)
        variables = variables_on(np.array([np.zeros(joints, np.int64), branches]))
        z = draw((joints, variables.polynomials.width))
        return variables, variables.variables(z, variables.momentum.centre)

    for round_ in range(RANKED_ROUNDS):
        candidates = []
        for place in range(CANDIDATES):
            variables, x = drawn(1 + round_ * CANDIDATES + place)
            sampling = model.nodes(LEVEL_OF_STARTS, variables.polynomials.form)
            missed = _missed(FlightProgram(model, variables, sampling, make_objective(variables, sampling)), x)
            candidates.append((missed, place, variables, x))
        for _, _, variables, x in sorted(candidates, key=lambda each: each[:2])[:FOLLOWED]:
            yield variables, x
    yield from (drawn(candidate) for candidate in count(1 + RANKED_ROUNDS * CANDIDATES))


def _drawn(candidate: int, seed: int, joints: int) -> tuple[IntArray, Callable[[tuple[int, int]], Array]]:
    """Branches (n,) of a candidate at landing, and what draws its free part."""
    random = SplitMix(seed + STREAM * candidate)
    branches = np.zeros(joints, np.int64)
    if 3**joints <= CANDIDATES:
        branches[:] = [(0, 1, -1)[candidate // 3**joint % 3] for joint in range(joints)]
    else:
        for joint in range(joints):
            drawn = random.uniform() / CHANGED_BRANCHES
            branches[joint] = 1 if drawn < 0.5 else -1 if drawn < 1 else 0
    spread = 0.0 if candidate <= CANDIDATES else SPREADS_OF_STARTS[candidate % len(SPREADS_OF_STARTS)]
    return branches, lambda shape: np.reshape([spread * random.normal() for _ in range(math.prod(shape))], shape)


def _missed(program: FlightProgram, x: Array) -> float:
    """By how much (14) is missed after steps towards where it would hold, were it linear."""
    metric = program.variables.metric
    for _ in range(STEPS_TO_RANK):
        evaluation = program.evaluate(x)
        row = evaluation.equality_jacobian[0]
        square = float(row @ row)
        if not square > 0:
            return math.inf
        step = (float(row @ x) - float(evaluation.equality[0])) / square * row - x
        x = x + min(1.0, STEP_TO_RANK / max(float(np.linalg.norm(metric @ step)), 1e-300)) * step
    evaluation = program.evaluate(x)
    return math.inf if evaluation.detail.flown.unresolved > TOO_WILD else abs(float(evaluation.equality[0]))
