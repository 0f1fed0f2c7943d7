"""From a problem in space to a jump: one program over all phases, its flight planned, its stances exact and checked."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.exact import NoExactStanceError
from floatplan.jumps.flight import planned_flight
from floatplan.jumps.jump import Jump
from floatplan.jumps.rounds import CORRECTIONS, NEAR_FAILED, NodeMargins, refined_until_checked, saying_on
from floatplan.jumps.spatial.conflicts import shortfall, touchdown_sentence
from floatplan.jumps.spatial.exact import (
    FlightEnds,
    exact_stances,
    feet_places,
    flight_ends,
    motion_of_side,
    rolling_stances,
    stance_ends,
)
from floatplan.jumps.spatial.flight import flight_problem
from floatplan.jumps.spatial.guess import guess, guess_near
from floatplan.jumps.spatial.jump import SpatialJump
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.nodes import SpatialSolution
from floatplan.jumps.spatial.program import SpatialProgram, solved_again
from floatplan.jumps.spatial.setup import SpatialSetup, spatial_setup
from floatplan.jumps.spatial.stance import SpatialStance
from floatplan.jumps.spatial.stance_search import StanceEnd, planned_stance, stance_setup
from floatplan.jumps.spatial.standing import shank_points
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem

# Of the first program; then as its check demands. No rows are of rotated landings: clearance makes up for them. Most
# jumps hold with feet that bear nothing for a while.
MARGINS = NodeMargins(torque=0.95, velocity=0.95, friction=0.85, least_force=0.0, rotated_landing=True)


@dataclass(frozen=True, eq=False)
class Start:
    """Where a start's programs end.

    Attributes
    ----------
    setup : SpatialSetup
    margins : of the program
    program : with these
    solution : of the program, or the last iterate of its search
    """

    setup: SpatialSetup
    margins: NodeMargins
    program: SpatialProgram
    solution: SpatialSolution


def _silent(_: str) -> None:
    """Report nothing."""


def jump_in_space(
    problem: Problem,
    request: JumpRequest,
    seed: int,
    starts: int,
    say: Callable[[str], None],
    helps: bool,
    near: Jump | None = None,
) -> SpatialJump:
    """Plan a whole jump in space; see :func:`floatplan.jump`."""
    setup = spatial_setup(problem, request)
    failed: SpatialJump | None = None
    nearest: Start | None = None
    start: Start | None = None
    if near is not None:
        say("from the jump at hand")
        start = start_near(setup, near)
        jump = _jump_near(start, seed, say, helps)
        if jump.ok:
            return jump
        say = saying_on(jump, say)
    for number in range(starts):
        say(f"start {number + 1} of {starts}")
        start = solved_start(setup, seed, number, start)
        if not start.solution.converged:
            if nearest is None or start.solution.worst < nearest.solution.worst:
                nearest = start
            continue
        failed = checked_jump(start, seed, say)
        if failed.ok:
            return failed
    if failed is not None:
        return failed
    counted = "1 start" if starts == 1 else f"{starts} starts"
    explanation = f"No jump was found in {counted}."
    if nearest is not None and helps:
        say("what stands in the way")
        sentences = [shortfall(nearest.program, nearest.solution, problem, request), touchdown_sentence(setup)]
        explanation = " ".join([explanation, *filter(None, sentences)])
    return SpatialJump(problem, request, explanation=explanation)


def solved_start(setup: SpatialSetup, seed: int, number: int, previous: Start | None = None) -> Start:
    """Return where the search of a start, by its number, ends.

    The first one has the generic guess, others random ones. Where rotations are combined the second one has the generic
    guess too; from it on the program has more nodes, and the base tilts less: flights nearer to where its angles are no
    coordinates may have no plan. The program of the ``previous`` start serves again where it has the same margins.
    """
    margins = MARGINS
    generic = 1  # starts from the generic guess
    if setup.is_combined:
        generic = 2
        if number:
            margins = replace(MARGINS, refinement=1.4, tilt=math.radians(35.0))
    rng = np.random.default_rng((seed, number)) if number >= generic else None
    program = previous.program if previous is not None and previous.margins == margins else setup.program(margins)
    return Start(setup, margins, program, program.solve(guess(program, rng)))


def start_near(setup: SpatialSetup, near: Jump) -> Start:
    """Return where the search from a jump at hand ends; InputError where that is not of nearly the same problem."""
    program = setup.program(MARGINS)
    guessed = guess_near(program, setup.mechanics, near)
    # Where there is a jump nearby, the first tight solve has it after 10 to 20 of its 60 iterations.
    return Start(setup, MARGINS, program, program.solve(guessed, is_near=True, tight_solves=2))


def _jump_near(start: Start, seed: int, say: Callable[[str], None], helps: bool) -> SpatialJump:
    """The jump of a start near one at hand; where there is none, with what binds there, if that helps."""
    if start.solution.converged:
        return checked_jump(start, seed, say)
    setup = start.setup
    say(f"{NEAR_FAILED}; what is in the way there")
    explanation = shortfall(start.program, start.solution, setup.problem, setup.request) if helps else ""
    return SpatialJump(setup.problem, setup.request, explanation=explanation)


def checked_jump(start: Start, seed: int, say: Callable[[str], None] = _silent) -> SpatialJump:
    """Return the jump of a start's solution; where its check fails, of one with more nodes, and stricter margins.

    It goes on likewise where the check holds, but links come too near to the ground. Of the jumps whose check holds
    that is returned whose links are highest above the ground.

    Parameters
    ----------
    start : whose program has a solution
    seed : of the flight's plan
    say : called with a few words on what is being done
    """
    setup = start.setup
    programs = 1 + CORRECTIONS
    number = 1
    valid: list[SpatialJump] = []  # whose check holds
    usual = 2e-3  # [m] over the ground of all but feet: these give way by a millimetre where a robot lands
    least = min(usual, setup.request.clearance)
    # Without links that are wider than the feet on them there is nothing to be mended.
    are_wider = bool(shank_points(setup.problem.robot, setup.feet, least))
    shank_height = 0.0

    def finer(margins: NodeMargins) -> SpatialProgram:
        nonlocal number, shank_height
        number += 1
        say(f"program {number} of {programs} at most, with more nodes")
        if valid:
            # Where there are rows, what the exact stance has lost comes on top.
            shank_height = shank_height + 1.5 * (least - link_height(valid[-1])) if shank_height else least
        return setup.program(replace(margins, shank_height=shank_height))

    def complete(program: SpatialProgram, solution: SpatialSolution) -> tuple[SpatialJump, Mapping[str, float] | None]:
        say(f"program {number} of {programs} at most: flight, stances, check")
        tolerated = 5e-4  # [m] less: rows are of points of a rim, not of all of it
        jump = jump_of_solution(setup, program, solution, seed)
        if not jump.ok:
            return jump, None if valid else jump.check.figures
        valid.append(jump)
        is_low = are_wider and link_height(jump) < least - tolerated
        return jump, jump.check.figures if is_low else None

    def again(
        finer: SpatialProgram, program: SpatialProgram, solution: SpatialSolution
    ) -> tuple[SpatialProgram, SpatialSolution] | None:
        if bool(finer.shank_points) == bool(program.shank_points):
            return solved_again(finer, program, solution)
        # With rows of shanks legs tilt less, which is another motion: the search begins anew.
        anew = finer.solve(guess(finer))
        return (finer, anew) if anew.converged else None

    solved = (start.program, start.solution)
    last = refined_until_checked(start.margins, setup.request, solved, finer, complete, again)
    return max(valid, key=link_height, default=last)


def link_height(jump: SpatialJump) -> float:
    """Least height over the ground of all of a checked jump but its feet, m."""
    return jump.check.figures["ground"]


def jump_of_solution(setup: SpatialSetup, program: SpatialProgram, solution: SpatialSolution, seed: int) -> SpatialJump:
    """Return the jump of a solution: its flight planned, its stances exact from the flight's ends."""
    problem = setup.problem
    request = setup.request
    solution = solution.moved(setup.origin)
    mechanics = setup.mechanics
    try:
        rolled = rolling_stances(program, solution, mechanics) if setup.feet[0].radius else None
        ends = flight_ends(program, solution, mechanics) if rolled is None else rolled.ends
        joints = np.stack((solution.y, solution.v))[:, BASE:, program.flight_nodes]
        plan = planned_flight(flight_problem(problem, program, solution, mechanics, ends), seed, joints=joints)
        if not plan.ok:
            explanation = f"No flight between the stances was found: {plan.explanation}"
            return SpatialJump(problem, request, explanation=explanation)
        if rolled is None:
            before, after = _stances_on_points(setup, program, solution, ends)
        else:
            before, after = rolled.before, rolled.after
    except InputError as error:
        explanation = f"The flight between the stances cannot be planned: {error}"
        return SpatialJump(problem, request, explanation=explanation)
    except (NoExactStanceError, np.linalg.LinAlgError) as error:
        explanation = f"Between the program's nodes there is no stance: {error}."
        return SpatialJump(problem, request, explanation=explanation)
    jump = SpatialJump(problem, request, plan, tuple(before), tuple(after), status="found")
    check = jump.check
    sentence = "The stances hold at 2 kHz." if check.ok else f"Between the program's nodes, {check.sentences[0]}."
    return jump.explained(sentence)


def _stances_on_points(
    setup: SpatialSetup, program: SpatialProgram, solution: SpatialSolution, ends: FlightEnds
) -> tuple[Sequence[SpatialStance], Sequence[SpatialStance]]:
    """The stances of a solution before and after its flight, exact from the flight's ends, on feet that do not roll.

    Raises
    ------
    NoExactStanceError
        There are none.
    """
    mechanics = setup.mechanics
    outer = stance_ends(program, solution, mechanics)
    first, last = np.split(outer, 2, axis=2)
    takeoff = ends.motion[:, :, :1]
    before = exact_stances(program, solution, mechanics, "takeoff", np.concatenate((first, takeoff), axis=2))
    ends_of_landing = np.concatenate((ends.landed, last), axis=2)
    if program.phases[program.flight + 1].is_on_one_sole:
        return before, _landing_anew(setup, program, solution, ends_of_landing)
    return before, exact_stances(program, solution, mechanics, "landing", ends_of_landing)


def _landing_anew(
    setup: SpatialSetup, program: SpatialProgram, solution: SpatialSolution, ends: Array
) -> Sequence[SpatialStance]:
    """The landing between its ends (3, 6+n, 2), solved once more from where the flight brings the robot.

    That is not quite where the program had it, and on one sole the difference grows like that of an inverted pendulum.

    Raises
    ------
    NoExactStanceError
        There is none, or it does not hold.
    """
    first = program.flight + 1
    phases = []
    for phase, duration in zip(program.phases[first:], solution.durations[first:].tolist(), strict=True):
        phases.append(replace(phase, duration=duration))
    touchdown = StanceEnd(ends[:, :, 0], flies=True)
    standing = StanceEnd(ends[:, :, 1])
    places = feet_places(program, solution, "landing")
    search = stance_setup(setup.problem, setup.request, setup.axes, phases, (touchdown, standing), places)
    curve = motion_of_side(program, solution, setup.mechanics, "landing")
    begin = float(solution.durations[:first].sum())
    result = planned_stance(search, curve, begin=begin)
    if not result.ok:
        raise NoExactStanceError(f"from where it lands, {result.broken[0]}")
    return result.stances
