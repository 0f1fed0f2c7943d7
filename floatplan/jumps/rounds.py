"""Rounds of programs, each with rows for what the solution before violates: distances, efforts of locked joints."""

from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.separation import TOLERATED_SHORTFALL
from floatplan.jumps.variables import JumpSolution


def solve_in_rounds(
    first: JumpProgram, guess: Array, previous: JumpProgram | None = None
) -> tuple[JumpProgram, JumpSolution]:
    """Solve from a guess; again with rows for what the solution violates, until nothing is.

    Those are distances that are too small, where either way around is tried, and what else should have been a row. A
    solution whose distances fall short is where the next program begins, in which the shortfall costs more.

    Parameters
    ----------
    first : JumpProgram
    guess : (size,)
    previous : the program that the guess comes from, or one that failed
        Its distances and rows are required from the start.

    Returns
    -------
    program : the last
    solution : its own; not ``converged`` where something is violated
    """
    rounds = 8  # [-] at most after the first program
    least_progress = 0.7  # [-] of the shortfall is left by the next program at most, or no other is tried
    program = first
    if previous is not None and (previous.separation.lines or previous.node.extra):
        separation = replace(first.separation, lines=previous.separation.lines).at(first.node, first.motion(guess))
        program = first.extended(separation, previous.node.extra)
    solution = program.solve(guess)
    for _ in range(rounds):
        if solution.overloaded:
            program = first.extended(program.separation, (*program.node.extra, *solution.overloaded))
            solution = program.solve(first.resampled(solution, first.phases))
            continue
        shortfall = solution.shortfall
        if shortfall == np.inf:
            break
        start = first.resampled(solution, first.phases)
        wider = program.separation.wider(first.node, first.motion(start), shortfall)
        motion = (solution.y, solution.v, solution.a)
        missing_rows = program.node.missing_rows(motion, solution.forces, solution.factor)
        if not wider and not missing_rows:
            break
        extra = (*program.node.extra, *missing_rows)
        candidates: list[tuple[JumpProgram, JumpSolution]] = []
        for separation in wider or [program.separation]:
            other = first.extended(separation, extra)
            candidates.append((other, other.solve(start)))
            if candidates[-1][1].converged:
                break
        program, solution = min(candidates, key=lambda candidate: candidate[1].shortfall)
        if shortfall > TOLERATED_SHORTFALL and solution.shortfall > least_progress * shortfall:
            break
    return program, solution
