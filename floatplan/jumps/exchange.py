"""Programs one after the other, each with what the solution before breaks: what is too near, what held joints bear."""

from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.program import JumpProgram, Solution
from floatplan.jumps.separation import SLIGHT

EXCHANGES = 8  # [-] programs at most after the first
LESS = 0.7  # [-] of what is missing is left at most by the next, or no other is tried


def solved(first: JumpProgram, guess: Array, known: JumpProgram | None = None) -> tuple[JumpProgram, Solution]:
    """Solve from a guess; again with what the solution breaks, until nothing is.

    That is what comes too near, where either way around is tried, and what else should have been a row. A solution in
    which distances are missing is where the next program begins, in which this costs more.

    Parameters
    ----------
    first : JumpProgram
    guess : (size,)
    known : the program that the guess comes from, or one that failed
        What it keeps is kept from the start.

    Returns
    -------
    program : the last
    solution : its own; not ``converged`` where something is left
    """
    program = first
    if known is not None and (known.separation.lines or known.node.held):
        lines = replace(first.separation, lines=known.separation.lines).at(first.node, first.motion(guess))
        program = first.kept(lines, known.node.held)
    solution = program.solve(guess)
    for _ in range(EXCHANGES):
        if solution.strained:
            program = first.kept(program.separation, (*program.node.held, *solution.strained))
            solution = program.solve(first.resampled(solution, first.phases))
            continue
        missing = solution.missing
        if missing == np.inf:
            break
        before = first.resampled(solution, first.phases)
        wider = program.separation.wider(first.node, first.motion(before), missing)
        strained = program.node.strained((solution.y, solution.v, solution.a), solution.forces, solution.factor)
        if not wider and not strained:
            break
        held = (*program.node.held, *strained)
        tried: list[tuple[JumpProgram, Solution]] = []
        for separation in wider or [program.separation]:
            other = first.kept(separation, held)
            tried.append((other, other.solve(before)))
            if tried[-1][1].converged:
                break
        program, solution = min(tried, key=lambda each: each[1].missing)
        if missing > SLIGHT and solution.missing > LESS * missing:
            break
    return program, solution
