"""From a problem to a jump: one program over all phases, its flight planned, its stances made exact and checked."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from floatplan.arguments import SEED, TRIES, made, optional
from floatplan.arrays import Array
from floatplan.errors import InputError, naming
from floatplan.jumps.check import FIGURES, SHARES, JumpCheck, judged, limit_shares
from floatplan.jumps.exact import NoExactStanceError, exact_stances, released
from floatplan.jumps.exchange import solved
from floatplan.jumps.flight import flight_problem, planned_flight, tighter_limits
from floatplan.jumps.jump import Jump
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import flight_state
from floatplan.jumps.phases import instants
from floatplan.jumps.program import LIFT, LOW_LIFT, JumpProgram, Solution
from floatplan.jumps.relief import Given, broken, eased, in_the_way, sentence
from floatplan.jumps.setup import CORRECTIONS, Room, Setup, corrected, jump_setup
from floatplan.kernel.library import kernel
from floatplan.pool import one_thread
from floatplan.problem.file import given_problem
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem

ROOM = Room(0.9, 0.96, 0.7)  # of the first program; the next depends on what its jump breaks
STARTS = 4
WORK = 300  # [-] times the starts: iterations after which no other is tried
BEYOND = (1.5, 2.5)  # [-] times what has to give is tried, one after the other
MOST_WITHOUT_FLIGHT = 2  # [-] programs whose flight is not found: more nodes do not bring it nearer
INSTANTS = 1001  # [-] of the flight, where its shares of limits are measured
FAILED = "no jump was found near the one at hand"
MINOR = 0.2  # [-] of the largest share that gives: what gives less is not changed


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
    the request fixes them. The sum of the motors' squared torques is least, or the largest share of a limit.

    Parameters
    ----------
    problem : Problem, or path of a problem file
    request : JumpRequest, optional
        In place of the problem's own; a problem without one needs it.
    seed : int
        Of the starts after the first, which is generic, and of the flight's plan.
    starts : int
        How many are tried at most, until one is found: fewer where together they take 300 iterations each.
    progress : callable, optional
        Told in a few words what is done; after a search ``near`` a jump that found none, what is in the way there too.
    helps : bool
        Whether it is told what stands in the way where no jump is found, and tried what would help, which takes as
        long again at most, or little more.
    near : Jump, optional
        One of nearly the same problem, with the same phases: the search begins from it, and only where that finds
        nothing with the starts.

    Returns
    -------
    Jump
        Always: ``ok``, ``status``, ``explanation``.

    Raises
    ------
    InputError
        The problem or the request is wrong, or asks for what no jump keeps; there is no request, nothing can stand as
        requested, or CasADi is not installed.
    """
    casadi()
    kernel()  # an error of its own is none of a flight's
    file = None if isinstance(problem, Problem) else problem
    problem = given_problem(problem)
    requested = _requested(problem, request, file)
    if requested is not problem.jump:
        problem = replace(problem, jump=requested)
    seed = SEED(seed, "seed")
    starts = TRIES(starts, "starts")
    near = optional(made(Jump))(near, "near")
    say = progress or (lambda _: None)
    with naming(file):
        setup = jump_setup(problem, requested)
        first = setup.program(ROOM)
        first.separation.check_standing(first.node, first.motion(first.guess()))
    began = process_time()
    begun = None if near is None else beside(first, near)
    if begun is not None:
        found = _near(setup, first, begun, seed, say, helps)
        if found.ok:
            return found
        missed = f"{FAILED}. {found.explanation} Searching on: "
        say = partial(lambda told, words: told(missed + words), say)
    answer, best, tried = _searched(setup, first, seed, starts, say)
    if answer is None and setup.turn == 0.0:
        answer = _low(setup, seed, say)
    if answer is not None and answer.ok:
        return answer
    until = 2 * process_time() - began
    if answer is not None:
        gives = broken(requested, answer.check.figures)
    else:
        answer, gives = _none_found(problem, requested, best if helps else None, tried, say)
    if not (gives and helps):
        return answer
    return _saying(answer, f"{answer.explanation} {_tried(problem, gives, seed, until, say)}")


def _requested(problem: Problem, request: JumpRequest | None, file: str | Path | None) -> JumpRequest:
    """The request that is passed, or else the problem's own; the file is named where there is none."""
    requested: JumpRequest | None = optional(made(JumpRequest))(request, "request") or problem.jump
    if requested is None:
        advice = "add a table [jump], or give a JumpRequest; floatplan plan plans a flight alone"
        raise InputError("no jump is asked for", source=file, element="jump", advice=advice)
    return requested


def _none_found(
    problem: Problem,
    request: JumpRequest,
    best: tuple[JumpProgram, Solution] | None,
    starts: int,
    say: Callable[[str], None],
) -> tuple[Jump, list[Given]]:
    """The result where no start ended well, and the limits that conflict in the best of them, if there is one."""
    counted = "1 start" if starts == 1 else f"{starts} starts"
    if best is None:
        return _not_found(problem, request, f"No jump was found in {counted}."), []
    say("what stands in the way")
    conflicting = in_the_way(*best, request)
    words = [sentence(limit, problem) for limit in conflicting] or [best[1].worst[1]]
    explanation = f"No jump was found in {counted}. In the way: {'; '.join(words)}."
    return _not_found(problem, request, explanation), conflicting


def _saying(answer: Jump, explanation: str) -> Jump:
    """The same motion, with its check, and what is said of it."""
    told = replace(answer, explanation=explanation)
    vars(told)["check"] = answer.check
    return told


def _tried(problem: Problem, gives: Sequence[Given], seed: int, until: float, say: Callable[[str], None]) -> str:
    """What is said of jumps with limits that give more, each tried from the generic guess."""
    gives = [each for each in gives if each.share >= MINOR * max(other.share for other in gives)]
    vain: list[str] = []
    for beyond in BEYOND:
        words, other = eased(problem, gives, beyond)
        if words in vain or (vain and process_time() > until):
            break
        say(f"trying {words}")
        assert other.jump is not None
        setup = jump_setup(other, other.jump)
        first = setup.program(ROOM)
        program, solution = solved(first, first.guess())
        if solution.converged and completed(setup, program, solution, seed).ok:
            return f"With {words} a jump was found and checked."
        vain.append(words)
    return f"Tried without finding one: {'; '.join(vain)}."


def _near(setup: Setup, first: JumpProgram, begun: Array, seed: int, say: Callable[[str], None], helps: bool) -> Jump:
    """The jump that is found from one at hand; or none, and what is in the way there, which elsewhere need not be."""
    say("from the jump at hand")
    found = program, solution = solved(first.warm(), begun)
    if solution.converged:
        return _corrected(setup, found, lambda room: setup.program(room).warm(), seed, say)
    say(f"{FAILED}; what is in the way there")
    gives = in_the_way(program, solution, setup.request, begun) if helps else []
    words = "; ".join(sentence(each, setup.problem) for each in gives)
    return _not_found(setup.problem, setup.request, f"In the way there: {words}." if words else "")


def _searched(
    setup: Setup, first: JumpProgram, seed: int, starts: int, say: Callable[[str], None]
) -> tuple[Jump | None, tuple[JumpProgram, Solution] | None, int]:
    """The first jump that is found, or what a solution came to; the nearest without one; and how many were tried."""
    best: tuple[JumpProgram, Solution] | None = None
    answer: Jump | None = None
    known: JumpProgram | None = None  # of the start before: what it could not keep apart is kept apart from the start
    spent = tried = 0
    for start in range(starts):
        if spent >= WORK * starts:
            break
        tried = start + 1
        say(f"start {tried} of {starts}")
        found = known, solution = solved(first, first.guess(_generator(seed, start)), known)
        spent += solution.iterations
        if not solution.converged:
            if best is None or (solution.missing, solution.worst) < (best[1].missing, best[1].worst):
                best = found
            continue
        answer = _corrected(setup, found, setup.program, seed, say)
        if not answer.ok and answer.flight is not None and answer.check.figures.get("touchdown", 0.0) < 0.0:
            say(f"start {tried} of {starts}, clear of the ground where it lands turned")
            room = replace(ROOM, turned=True)
            program = setup.program(room)
            found = solved(program, program.guess(_generator(seed, start)))
            spent += found[1].iterations
            if found[1].converged:
                answer = max(answer, _corrected(setup, found, setup.program, seed, say, room), key=_merit)
        if answer.ok:
            break
    return answer, best, tried


def _low(setup: Setup, seed: int, say: Callable[[str], None]) -> Jump | None:
    """The hop in which feet rise by less, from the generic guess; None where it has none either."""
    say(f"with feet that rise by {1e3 * LOW_LIFT:.0f} mm in place of {1e3 * LIFT:.0f} mm")
    room = replace(ROOM, lift=LOW_LIFT)
    first = setup.program(room)
    found = solved(first, first.guess())
    if not found[1].converged:
        return None
    answer = _corrected(setup, found, setup.program, seed, say, room)
    return _saying(answer, f"{answer.explanation} Its feet were asked to rise by {1e3 * LOW_LIFT:.0f} mm only.")


def _merit(answer: Jump) -> tuple[bool, bool, float]:
    """Whether a jump is found; whether nothing fails but at touchdown, where it lands turned; and how high it is there.

    Such a one is a jump for somebody who asks for less there.
    """
    height = answer.check.figures.get("touchdown", 0.0)
    least = FIGURES["touchdown"].most(answer.request)
    failing, _ = judged(answer.request, answer.check.figures, answer.check.unlimited)
    return answer.ok, answer.flight is not None and len(failing) == 1 and height < least, height


def _generator(seed: int, start: int) -> np.random.Generator | None:
    """Random numbers of a start's guess; the first guess has none."""
    return np.random.default_rng((seed, start)) if start else None


def beside(program: JumpProgram, near: Jump) -> Array | None:
    """Return a jump with a program's phases as a guess (size,), as slow as these may be; None of one with others."""
    stands = [tuple(name for contact in phase.contacts for name in contact.names) for phase in program.phases]
    if near.problem.robot.joints != program.model.robot.joints or [each.contacts for each in near.phases] != stands:
        return None
    assert near.flight is not None
    parts = program.split(program.guess())
    lasted = np.array([each.end - each.begin for each in near.phases])
    lasts = np.clip(lasted, *np.transpose([phase.bounds for phase in program.phases]))
    state = near.at(np.minimum(instants(program.phases, lasted), near.duration))
    for index, phase in enumerate(program.phases):
        nodes = slice(int(program.starts[index]), int(program.starts[index + 1]) + 1)
        parts[3 + index] = phase.gathered({name: force[nodes] for name, force in state.forces.items()})
    parts[:3] = state.planned(near.problem.robot)
    parts[-3][:, 0] = lasts
    parts[-2][:] = near.flight.angular_momentum
    return program.join(parts)


def _corrected(
    setup: Setup,
    found: tuple[JumpProgram, Solution],
    program: Callable[[Room], JumpProgram],
    seed: int,
    say: Callable[[str], None],
    room: Room = ROOM,
) -> Jump:
    """The jump of a program's solution, else of one with more nodes; ``say`` is told which of them is at work."""
    programs = 1 + CORRECTIONS
    number = 1
    without_flight = 0

    def finer(room: Room) -> JumpProgram:
        nonlocal number
        number += 1
        say(f"program {number} of {programs} at most, with more nodes")
        return program(room)

    def complete(program: JumpProgram, solution: Solution) -> tuple[Jump, Mapping[str, float] | None]:
        say(f"program {number} of {programs} at most: flight, stances, check")
        nonlocal without_flight
        answer = completed(setup, program, solution, seed)
        without_flight += answer.flight is None
        given_up = without_flight == MOST_WITHOUT_FLIGHT
        return answer, None if answer.ok or given_up else answer.check.figures

    return corrected(room, setup.request, found, finer, complete)


def completed(setup: Setup, program: JumpProgram, solution: Solution, seed: int) -> Jump:
    """Return the jump of a solution: its flight planned, its stances exact from the flight's ends."""
    problem = setup.problem
    request = setup.request
    try:
        solution = released(program, solution)
        tighter = tighter_limits(problem, program, solution)
        plan = planned_flight(flight_problem(problem, program, solution), seed, tighter)
        if not plan.ok:
            return _not_found(problem, request, f"No flight between the stances was found: {plan.explanation}")
        before, after = (exact_stances(program, solution, side, plan) for side in ("takeoff", "landing"))
    except InputError as error:
        return _not_found(problem, request, f"The flight between the stances cannot be planned: {error}")
    except NoExactStanceError as error:
        return _not_found(problem, request, f"Between the program's nodes no stance was found: {error}.")
    found = Jump(problem, request, plan, before, after, status="found")
    check = found.check
    share = _largest_share(found, check) if request.objective == "limits" else 0.0
    told = f" Of what the margins leave the jump takes {share:.0%}." if share else ""
    held = f"The stances hold at 2 kHz.{told}" if check.ok else f"Between the program's nodes, {check.sentences[0]}."
    return _saying(found, held)


def _largest_share(jump: Jump, check: JumpCheck) -> float:
    """The largest share of what the margins leave of limits, in stances and in flight; 0 where nothing is limited."""
    assert jump.flight is not None
    times = jump.takeoff_time + np.linspace(0.0, jump.flight.duration, INSTANTS)
    of_flight = limit_shares(jump.problem, flight_state(jump.flight, jump.takeoff_time, times))
    largest = 0.0
    for name in SHARES:
        if name not in check.unlimited:
            taken = max(check.figures[name], float(of_flight[name].max(initial=0.0)))
            largest = max(largest, taken / FIGURES[name].most(jump.request))
    return largest


def _not_found(problem: Problem, request: JumpRequest, explanation: str) -> Jump:
    return Jump(problem, request, explanation=explanation)
