"""From a problem to a jump: one program over all phases, its flight planned, its stances made exact and checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np

from floatplan.arguments import SEED, TRIES, made, optional
from floatplan.arrays import Array
from floatplan.errors import InputError, naming
from floatplan.jumps.check import FIGURES, SHARES, JumpCheck, limit_shares, sentences_on
from floatplan.jumps.conflicts import Conflict, conflict_sentence, conflicting_limits, relaxed, violated_kinds
from floatplan.jumps.exact import NoExactStanceError, exact_stances, released_solution
from floatplan.jumps.flight import flight_problem, planned_flight, tighter_limits
from floatplan.jumps.jump import Jump
from floatplan.jumps.jump_motion import NextFlight
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import Stance, moved
from floatplan.jumps.phases import instants
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.rounds import (
    CORRECTIONS,
    NEAR_FAILED,
    NodeMargins,
    refined_until_checked,
    saying_on,
    solve_in_rounds,
    solved_again,
)
from floatplan.jumps.setup import Setup, jump_setup
from floatplan.jumps.spatial.planner import jump_in_space
from floatplan.jumps.variables import FOOT_LIFT, LOW_FOOT_LIFT, JumpSolution
from floatplan.kernel.library import kernel
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.file import as_problem
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem

# Of the first program; then as its jump's check demands. Between its nodes jumps take more: of what they are allowed an
# A1's backflip takes 0.83 of the friction, 0.9 of torques and 0.97 of rates, three backflips of a Go2 0.76, 0.91, 0.97.
MARGINS = NodeMargins(torque=0.9, velocity=0.96, friction=0.7)
STARTS = 4  # [-] guesses that are tried, see ``_search``


@one_thread
def jump(
    problem: Problem | str | Path,
    request: JumpRequest | None = None,
    *,
    seed: int = 0,
    starts: int = STARTS,
    progress: Callable[[str], None] | None = None,
    helps: bool = True,
    near: Jump | None = None,
) -> Jump:
    """Plan a whole jump: from standing through a flight to standing again.

    The goal's orientation fixes the whole turns; postures, durations and momentum of the flight are optimised unless
    the request fixes them. The sum of the motors' squared torques is minimised, in space of their shares of the limits,
    or the largest share of a limit.

    Parameters
    ----------
    problem : Problem, or path of a problem file
    request : JumpRequest, optional
        Instead of the problem's own; a problem without one needs it.
    seed : int
        Of the starts after the first, which is generic, and of the flight's plan.
    starts : int
        At most so many, until one succeeds; in a plane none is begun once the last programs of those before it took
        300 iterations times ``starts`` in all.
    progress : callable, optional
        Called with a few words on what is being done; after a search ``near`` a jump that failed, with its conflicts.
    helps : bool
        Whether conflicting limits are explained where no jump is found; in a plane relaxed ones are tried too, as long
        again.
    near : Jump, optional
        One of nearly the same problem, with the same phases, from which the search begins; starts follow where that
        fails. In a plane one with other phases is left aside, in space it is refused.

    Returns
    -------
    Jump
        Always: ``ok``, ``status``, ``explanation``.

    Raises
    ------
    InputError
        The problem or the request is wrong, or requires what no jump does; there is no request, nothing can stand as
        requested, ``near`` is of another robot or, in space, has other phases, or CasADi is not installed.
    """
    casadi()
    kernel()  # an error of its own is none of a flight's
    file = None if isinstance(problem, Problem) else problem
    problem = as_problem(problem)
    requested = _requested(problem, request, file)
    if requested is not problem.jump:
        problem = replace(problem, jump=requested)
    seed = SEED(seed, "seed")
    starts = TRIES(starts, "starts")
    near = optional(made(Jump))(near, "near")
    say = progress or (lambda _: None)
    if problem.robot.base == "free-flyer":
        with naming(file):
            return jump_in_space(problem, requested, seed, starts, say, helps, near)
    with naming(file):
        setup = jump_setup(problem, requested)
        first = setup.program(MARGINS)
        first.separation.check_standing(first.node_rows, first.motion(first.guess()))
    start_time = process_time()
    guess = guess_near(first, near)
    if guess is not None:
        result = _search_near(setup, first, guess, seed, say, helps)
        if result.ok:
            return result
        say = saying_on(result, say)
    search = _search(setup, first, seed, starts, say)
    last = search.jump
    if last is None and setup.base_rotation == 0.0 and not requested.rise:
        last = _low_hop(setup, seed, say)
    if last is not None and last.ok:
        return last
    until = 2 * process_time() - start_time  # as long again as the search took
    return _explained(setup, search, last, seed, until, helps, say)


def _explained(
    setup: Setup,
    search: _Search,
    last: Jump | None,
    seed: int,
    until: float,
    helps: bool,
    say: Callable[[str], None],
) -> Jump:
    """The result of a search that found no jump, or the last one, which does not hold; what conflicts, and would do."""
    if last is None:
        last, conflicts = _not_found_in_starts(setup.problem, setup.request, search, helps, say)
    else:
        conflicts = violated_kinds(setup.request, last.check.figures)
    if conflicts and helps:
        attempts = _try_relaxed(setup.problem, conflicts, seed, until, say)
        last = last.explained(f"{last.explanation} {attempts}")
    return last


def _requested(problem: Problem, request: JumpRequest | None, file: str | Path | None) -> JumpRequest:
    """The request that is passed, or else the problem's own; the file is named where there is none."""
    requested: JumpRequest | None = optional(made(JumpRequest))(request, "request") or problem.jump
    if requested is None:
        advice = "add a table [jump], or give a JumpRequest; floatplan plan plans a flight alone"
        raise InputError("no jump is asked for", source=file, element="jump", advice=advice)
    return requested


@dataclass(frozen=True, eq=False)
class _Search:
    """What the starts of a search end with.

    Attributes
    ----------
    jump : the first whose check holds, else the last whose check does not; None where no program has a solution
    nearest : the program that is nearest to a solution, and where it ended, where another has none
    starts : how many were tried
    """

    jump: Jump | None
    nearest: tuple[JumpProgram, JumpSolution] | None
    starts: int


def _not_found_in_starts(
    problem: Problem, request: JumpRequest, search: _Search, helps: bool, say: Callable[[str], None]
) -> tuple[Jump, list[Conflict]]:
    """The result where no program has a solution, and, if that ``helps``, the limits that conflict in the nearest."""
    counted = "1 start" if search.starts == 1 else f"{search.starts} starts"
    if search.nearest is None or not helps:
        return Jump(problem, request, explanation=f"No jump was found in {counted}."), []
    say("what stands in the way")
    program, last = search.nearest
    conflicts = conflicting_limits(program, last, request)
    sentences = [conflict_sentence(conflict, problem) for conflict in conflicts] or [last.worst[1]]
    explanation = f"No jump was found in {counted}. In the way: {'; '.join(sentences)}."
    return Jump(problem, request, explanation=explanation), conflicts


def _try_relaxed(
    problem: Problem, conflicts: Sequence[Conflict], seed: int, until: float, say: Callable[[str], None]
) -> str:
    """A sentence on jumps with wider limits, each tried from the generic guess."""
    minor = 0.2  # [-] of the largest share: limits that are exceeded by less stay as they are
    largest = max(conflict.share for conflict in conflicts)
    conflicts = [conflict for conflict in conflicts if conflict.share >= minor * largest]
    failures: list[str] = []
    for beyond in (1.5, 2.5):  # times the least change
        words, other = relaxed(problem, conflicts, beyond)
        if words in failures or (failures and process_time() > until):
            break
        say(f"trying {words}")
        assert other.jump is not None
        setup = jump_setup(other, other.jump)
        first = setup.program(MARGINS)
        program, solution = solve_in_rounds(first, first.guess())
        if solution.is_motion and jump_of_solution(setup, program, solution, seed).ok:
            return f"With {words} a jump was found and checked."
        failures.append(words)
    return f"Tried without finding one: {'; '.join(failures)}."


def _search_near(
    setup: Setup, first: JumpProgram, guess: Array, seed: int, say: Callable[[str], None], helps: bool
) -> Jump:
    """The jump from the guess of another one; where it fails, with the limits that conflict there, if that helps.

    Elsewhere other limits may conflict, or none.
    """
    say("from the jump at hand")
    program, solution = solve_in_rounds(first.warm(), guess)
    if solution.is_motion:
        return checked_jump(setup, (program, solution), lambda margins: setup.program(margins).warm(), seed, say)
    say(f"{NEAR_FAILED}; what is in the way there")
    conflicts = conflicting_limits(program, solution, setup.request, guess) if helps else []
    words = "; ".join(conflict_sentence(conflict, setup.problem) for conflict in conflicts)
    explanation = f"In the way there: {words}." if words else ""
    return Jump(setup.problem, setup.request, explanation=explanation)


def _search(setup: Setup, first: JumpProgram, seed: int, starts: int, say: Callable[[str], None]) -> _Search:
    """Try one start after the other, until the check of a jump holds."""
    work = 300 * starts  # iterations of their last programs, after which no other start is tried
    spent = 0
    number = 0
    jump: Jump | None = None
    nearest: tuple[JumpProgram, JumpSolution] | None = None
    previous: JumpProgram | None = None  # what it could not separate is separated from the start
    for start in range(starts):
        if spent >= work:
            break
        number = start + 1
        say(f"start {number} of {starts}")
        program, solution = solve_in_rounds(first, first.guess(_generator(seed, start)), previous)
        previous = program
        spent += solution.iterations
        if not solution.is_motion:
            if nearest is None or (solution.shortfall, solution.worst) < (nearest[1].shortfall, nearest[1].worst):
                nearest = (program, solution)
            continue
        jump = checked_jump(setup, (program, solution), setup.program, seed, say)
        hits_ground = jump.flight is not None and jump.check.figures.get("touchdown", 0.0) < 0.0
        if not jump.ok and hits_ground:
            say(f"start {number} of {starts}, clear of the ground where it lands turned")
            margins = replace(MARGINS, rotated_landing=True)
            program = setup.program(margins)
            program, solution = solve_in_rounds(program, program.guess(_generator(seed, start)))
            spent += solution.iterations
            if solution.is_motion:
                other = checked_jump(setup, (program, solution), setup.program, seed, say, margins)
                jump = max(jump, other, key=_merit)
        if jump.ok:
            break
    return _Search(jump, nearest, number)


def _low_hop(setup: Setup, seed: int, say: Callable[[str], None]) -> Jump | None:
    """The hop in which feet rise by less, from the generic guess; None where it has none either."""
    say(f"with feet that rise by {1e3 * LOW_FOOT_LIFT:.0f} mm in place of {1e3 * FOOT_LIFT:.0f} mm")
    margins = replace(MARGINS, lift=LOW_FOOT_LIFT)
    first = setup.program(margins)
    program, solution = solve_in_rounds(first, first.guess())
    if not solution.is_motion:
        return None
    jump = checked_jump(setup, (program, solution), setup.program, seed, say, margins)
    lift = f"Its feet were asked to rise by {1e3 * LOW_FOOT_LIFT:.0f} mm only."
    return jump.explained(f"{jump.explanation} {lift}")


def _merit(jump: Jump) -> tuple[bool, bool, float]:
    """Whether its check holds; whether nothing fails but the height at touchdown, rotated; and that height.

    Such a one is a jump for somebody who requires less there.
    """
    height = jump.check.figures.get("touchdown", 0.0)
    least = FIGURES["touchdown"].limit_of(jump.request)
    failing, _ = sentences_on(jump.request, jump.check.figures, jump.check.unlimited)
    only_touchdown = jump.flight is not None and len(failing) == 1 and height < least
    return jump.ok, only_touchdown, height


def _generator(seed: int, start: int) -> np.random.Generator | None:
    """Random numbers of a start's guess; the first guess has none."""
    return np.random.default_rng((seed, start)) if start else None


def guess_near(program: JumpProgram, near: Jump | None) -> Array | None:
    """Return a jump with a program's phases as a guess (size,), as slow as these may be; None if it has others."""
    if near is None or near.problem.robot.joints != program.model.robot.joints:
        return None
    if len(near.phases) != len(program.phases):
        return None
    for phase, other in zip(program.phases, near.phases, strict=True):
        if other.contacts != phase.points:
            return None
    assert near.flight is not None
    guess = program.split(program.guess())
    of_near = np.array([phase.end - phase.begin for phase in near.phases])
    durations = np.clip(of_near, *np.transpose([phase.bounds for phase in program.phases]))
    state = near.at(np.minimum(instants(program.phases, of_near), near.duration))
    for index, phase in enumerate(program.phases):
        nodes = program.nodes_of(index)
        guess.forces[index] = phase.stacked({name: force[nodes] for name, force in state.forces.items()})
    guess.y, guess.v, guess.a = state.planned(near.problem.robot)
    guess.durations[:, 0] = durations
    guess.momenta[:, 0] = [plan.angular_momentum for plan in near.flights]
    return program.join(guess)


def checked_jump(
    setup: Setup,
    solved: tuple[JumpProgram, JumpSolution],
    program_of: Callable[[NodeMargins], JumpProgram],
    seed: int,
    say: Callable[[str], None],
    margins: NodeMargins = MARGINS,
) -> Jump:
    """The jump of a program's solution, else of one with more nodes; ``say`` is called with the program's number."""
    programs = 1 + CORRECTIONS
    number = 1
    without_flight = 0
    most_without_flight = 2  # programs whose flight is not found: more nodes do not bring it nearer

    def finer(margins: NodeMargins) -> JumpProgram:
        nonlocal number
        number += 1
        say(f"program {number} of {programs} at most, with more nodes")
        return program_of(margins)

    def complete(program: JumpProgram, solution: JumpSolution) -> tuple[Jump, Mapping[str, float] | None]:
        nonlocal without_flight
        say(f"program {number} of {programs} at most: flight, stances, check")
        jump = jump_of_solution(setup, program, solution, seed)
        without_flight += jump.flight is None
        if jump.ok or without_flight == most_without_flight:
            return jump, None
        return jump, jump.check.figures

    return refined_until_checked(margins, setup.request, solved, finer, complete, solved_again)


def jump_of_solution(setup: Setup, program: JumpProgram, solution: JumpSolution, seed: int) -> Jump:
    """Return the jump of a solution: its flight planned, its stances exact from the flight's ends."""
    problem = setup.problem
    request = setup.request
    try:
        solution = released_solution(program, solution)
        tighter = tighter_limits(problem, program, solution)
        plans: list[Plan] = []
        for number in range(len(program.flights)):
            plan = planned_flight(flight_problem(problem, program, solution, number), seed, tighter)
            if not plan.ok:
                which = f"flight {number + 1}" if len(program.flights) > 1 else "flight"
                explanation = f"Between the stances no {which} was planned: {plan.explanation}"
                return Jump(problem, request, explanation=explanation)
            plans.append(plan)
        before = exact_stances(program, solution, "takeoff", plans[0])
        after, more = _stances_after(program, solution, plans)
    except InputError as error:
        explanation = f"The flight between the stances cannot be planned: {error}"
        return Jump(problem, request, explanation=explanation)
    except NoExactStanceError as error:
        explanation = f"Between the program's nodes no stance was found: {error}."
        return Jump(problem, request, explanation=explanation)
    jump = Jump(problem, request, plans[0], before, after, more, status="found")
    check = jump.check
    if not check.ok:
        return jump.explained(f"Between the program's nodes, {check.sentences[0]}.")
    explanation = "The stances hold at 2 kHz."
    share = _largest_share(jump, check) if request.objective == "limits" else 0.0
    if share:
        explanation += f" Of what the margins leave the jump takes {share:.0%}."
    return jump.explained(explanation)


def _stances_after(
    program: JumpProgram, solution: JumpSolution, plans: Sequence[Plan]
) -> tuple[tuple[Stance, ...], tuple[NextFlight, ...]]:
    """Exact stances after the first flight, up to the second; and what follows, in the world of the first.

    Where the stances after a flight meet those before the next, both stand on the same feet: these say where the world
    of the next flight is.
    """
    after: list[tuple[Stance, ...]] = []
    shifts = [0j]
    for number, plan in enumerate(plans):
        landed = moved(exact_stances(program, solution, "landing", plan, flight_number=number), shifts[-1])
        if number + 1 < len(plans):
            leaving = exact_stances(program, solution, "takeoff", plans[number + 1], flight_number=number + 1)
            shifts.append(landed[-1].position_of(leaving[0].contacts[0]) - leaving[0].anchor_position)
            landed += moved(leaving, shifts[-1])
        after.append(landed)
    more: list[NextFlight] = []
    for plan, shift, stances in zip(plans[1:], shifts[1:], after[1:], strict=True):
        more.append(NextFlight(plan, (shift.real, shift.imag), stances))
    return after[0], tuple(more)


def _largest_share(jump: Jump, check: JumpCheck) -> float:
    """The largest share of what the margins leave of limits, in stances and in flight; 0 where nothing is limited."""
    shares = dict(check.figures)
    for flight in jump.timed_flights:
        times = flight.begin + np.linspace(0.0, flight.plan.duration, 1001)  # half a millisecond apart
        for name, values in limit_shares(jump.problem, flight.state(times)).items():
            shares[name] = max(shares[name], float(values.max(initial=0.0)))
    largest = 0.0
    for name in SHARES:
        if name not in check.unlimited:
            largest = max(largest, shares[name] / FIGURES[name].limit_of(jump.request))
    return largest
