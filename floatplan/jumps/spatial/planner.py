"""From a problem in space to a jump: one program over all phases, its flight planned, its stances exact and checked."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from floatplan.errors import InputError
from floatplan.jumps.flight import planned_flight
from floatplan.jumps.setup import CORRECTIONS, NodeMargins
from floatplan.jumps.spatial.conflicts import shortfall
from floatplan.jumps.spatial.exact import NoExactStanceError, exact_stances, flight_ends, stance_ends
from floatplan.jumps.spatial.flight import flight_problem
from floatplan.jumps.spatial.guess import guess
from floatplan.jumps.spatial.jump import SpatialJump
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.nodes import SpatialSolution
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.jumps.spatial.setup import SpatialSetup, spatial_setup
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem

MARGINS = NodeMargins(torque=0.95, velocity=0.95, friction=0.85)  # of the first program; then as its check demands


def jump_in_space(
    problem: Problem,
    request: JumpRequest,
    seed: int,
    starts: int,
    say: Callable[[str], None],
    near: object = None,
) -> SpatialJump:
    """Plan a whole jump in space; see :func:`floatplan.jump`. One ``near`` is refused."""
    if near is not None:
        raise InputError("is for jumps in a plane, so far", element="near", advice="leave it out")
    setup = spatial_setup(problem, request)
    program = setup.program(MARGINS)
    failed: SpatialJump | None = None
    nearest: SpatialSolution | None = None
    for start in range(starts):
        say(f"start {start + 1} of {starts}")
        rng = np.random.default_rng((seed, start)) if start else None
        solution = program.solve(guess(program, rng))
        if not solution.converged:
            if nearest is None or solution.worst < nearest.worst:
                nearest = solution
            continue
        failed = _corrected(setup, program, solution, seed, say)
        if failed.ok:
            return failed
    if failed is not None:
        return failed
    counted = "1 start" if starts == 1 else f"{starts} starts"
    explanation = f"No jump was found in {counted}."
    if nearest is not None:
        say("what stands in the way")
        explanation += f" {shortfall(program, nearest, problem)}"
    return SpatialJump(problem, request, explanation=explanation)


def _corrected(
    setup: SpatialSetup, program: SpatialProgram, solution: SpatialSolution, seed: int, say: Callable[[str], None]
) -> SpatialJump:
    """The jump of a program's solution; where its check fails, of one with more nodes, and wider margins."""
    programs = 1 + CORRECTIONS
    margins = MARGINS
    for number in range(1, programs + 1):
        say(f"program {number} of {programs} at most: flight, stances, check")
        jump = completed(setup, program, solution, seed)
        if jump.ok or number == programs:
            break
        if jump.flight is not None:
            margins = margins.tightened(setup.request, jump.check.figures)
        else:
            margins = replace(margins, refinement=1.4 * margins.refinement)
        say(f"program {number + 1} of {programs} at most, with more nodes")
        finer = setup.program(margins)
        refined = finer.solve(finer.resampled(solution, program), is_near=True)
        if not refined.converged:
            break
        program = finer
        solution = refined
    return jump


def completed(setup: SpatialSetup, program: SpatialProgram, solution: SpatialSolution, seed: int) -> SpatialJump:
    """Return the jump of a solution: its flight planned, its stances exact from the flight's ends."""
    problem = setup.problem
    request = setup.request
    solution = solution.moved(setup.origin)
    mechanics = setup.mechanics
    try:
        ends = flight_ends(program, solution, mechanics)
        joints = np.stack((solution.y, solution.v))[:, BASE:, program.flight_nodes]
        plan = planned_flight(flight_problem(problem, program, solution, mechanics, ends), seed, joints=joints)
        if not plan.ok:
            explanation = f"No flight between the stances was found: {plan.explanation}"
            return SpatialJump(problem, request, explanation=explanation)
        outer = stance_ends(program, solution, mechanics)
        first, last = np.split(outer, 2, axis=2)
        takeoff, landing = np.split(ends.motion, 2, axis=2)
        before = exact_stances(program, solution, mechanics, "takeoff", np.concatenate((first, takeoff), axis=2))
        after = exact_stances(program, solution, mechanics, "landing", np.concatenate((landing, last), axis=2))
    except InputError as error:
        explanation = f"The flight between the stances cannot be planned: {error}"
        return SpatialJump(problem, request, explanation=explanation)
    except (NoExactStanceError, np.linalg.LinAlgError) as error:
        explanation = f"Between the program's nodes there is no stance: {error}."
        return SpatialJump(problem, request, explanation=explanation)
    jump = SpatialJump(problem, request, plan, tuple(before), tuple(after), status="found")
    check = jump.check
    sentence = "The stances hold at 2 kHz." if check.ok else f"Between the program's nodes, {check.sentences[0]}."
    explained = replace(jump, explanation=sentence)
    vars(explained)["check"] = check
    return explained
