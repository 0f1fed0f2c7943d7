"""Whether a robot can bring itself to a plan's takeoff, or to standing after its landing: the least limits that do."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from floatplan.arguments import SEED, TRIES, function, made, one_of, optional
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.check import SHARES
from floatplan.jumps.exact import NoExactStanceError, StanceDynamics, exact_stances, may_fail
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.launches.in_space import launch_in_space
from floatplan.jumps.launches.result import LIMIT_WORDS, Launch, launch_of_stances
from floatplan.jumps.model import PlanarModel, casadi
from floatplan.jumps.motion import Grid, Stance, flight_state, quintic
from floatplan.jumps.phases import FixedEnd, instants
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.rounds import NodeMargins, refined_until_checked, solve_in_rounds, solved_again
from floatplan.jumps.setup import Setup, side_setup
from floatplan.jumps.variables import JumpSolution
from floatplan.motion.planar.contact_rates import ContactEquations, End, rates_at
from floatplan.plans.plan import Plan, as_plan
from floatplan.plans.presentation import Row
from floatplan.pool import one_thread
from floatplan.problem.jump import JumpRequest
from floatplan.tables import RELATIVE

STARTS = 3  # [-] guesses that are tried, of which the best counts
# Of programs whose factor is minimised: what they take of limits is judged, not bounded.
MARGINS = NodeMargins(torque=1.0, velocity=1.0, friction=0.95, refinement=0.8, clearance=3e-3)
CALM_MARGINS = NodeMargins(torque=0.95, velocity=0.97, friction=0.8, clearance=3e-3)  # where squared torques are


@one_thread
def launch(
    plan: Plan | str | Path,
    request: JumpRequest | None = None,
    *,
    end: End = "takeoff",
    seed: int = 0,
    starts: int = STARTS,
    progress: Callable[[str], None] | None = None,
) -> Launch:
    """Find the stance from standing that reaches a plan's takeoff with the least common factor on torques and rates.

    Posture, angular momentum and velocity of the centre of mass are the plan's; the joints' rates too, where its frame
    does not move then, else those with which it does not. Obstacles are ignored. Contacts and friction are those of the
    request, else of the problem's jump, else the usual ones; margins do not count.

    Parameters
    ----------
    plan : Plan, or path of a plan file
    request : JumpRequest, optional
    end : "takeoff", or "landing": from the plan's landing to standing
    seed : of the starts after the first
    starts : how many are tried; the best counts
    progress : callable, optional
        Called with a few words on what is being done.

    Returns
    -------
    Launch
        Not ``ok`` is "none was found"; "there is none" only where ``impossible``, which rates at the end already show.

    Raises
    ------
    InputError
        The plan or the request is wrong, nothing can stand as requested, or CasADi is not installed.
    """
    casadi()
    plan = as_plan(plan)
    request = optional(made(JumpRequest))(request, "request") or plan.problem.jump
    if request is None:  # flights know frames and no feet
        request = JumpRequest(feet="points")
    request = _of_one_flight(request)
    end = one_of("takeoff", "landing")(end, "end")
    seed = SEED(seed, "seed")
    starts = TRIES(starts, "starts")
    say = optional(function)(progress, "progress") or (lambda _: None)
    if plan.robot.base == "free-flyer":
        return launch_in_space(plan, request, end, seed, starts, say)
    factor_request = replace(
        request,
        margin=dict.fromkeys(request.margin, 1.0),
        objective="limits",
        clearance=0.0,
        pitch_error=0.0,
        least_force=0.0,
    )
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    setup, met = _setup_and_fixed_end(plan, factor_request, end, np.append(state.orientation, state.positions))
    rates, impossible = _least_rates(plan, setup, met, end)
    posture = []
    for name, angle in zip(plan.robot.joints, setup.ends[0 if end == "takeoff" else -1, 1:], strict=True):
        posture.append(f"{name} {angle:.4g}")
    stands = f"Friction {request.friction:g}, at rest with {', '.join(posture)} rad."
    result = impossible
    if result is None:
        problem = replace(plan.problem, obstacles=(), self_clearances=())
        setup = replace(setup, problem=problem, fixed_ends=(met,), fixed_momentum=plan.angular_momentum)
        complete = partial(_launch_of_solution, plan, request, end)
        result = _search(setup, end, rates, complete, seed, starts, say)
    return replace(result, sentences=(*result.sentences, stands))


def _search(
    setup: Setup,
    end: End,
    rates: Array,
    complete: Callable[[JumpProgram, JumpSolution], tuple[Launch, dict[str, float] | None]],
    seed: int,
    starts: int,
    say: Callable[[str], None],
) -> Launch:
    """The best stance of all starts, from standing either way around."""
    (met,) = setup.fixed_ends
    variants = [(variant, variant.program(MARGINS)) for variant in _either_way_around(setup, end)]
    results: list[Launch] = []
    solutions: list[Array] = []
    for start, (variant, first) in itertools.product(range(starts), variants):
        say(f"start {start + 1} of {starts}")
        # Shares of the usual durations, of all phases in the first two starts, then of each.
        shares: Array = np.random.default_rng((seed, start)).uniform(0.25, 1.05, len(first.phases) - 1)
        if start < 2:
            shares = np.full(len(shares), (0.8, 1.5)[start])
        program, solution = solve_in_rounds(first, smooth_guess(first, met, rates, shares))
        if not solution.is_motion or any(np.abs(other - solution.y).max() < 1e-5 for other in solutions):  # rad
            continue
        solutions.append(solution.y)
        solved = (program, solution)
        result = refined_until_checked(MARGINS, setup.request, solved, variant.program, complete, solved_again)
        results.append(result)
        if not results[-1].ok and results[-1].ratio <= 1:
            say(f"start {start + 1} of {starts}, with less torque in all")
            results += _calmer(variant, program, solution, complete)
        if results[-1].ok:
            break
    none = Launch(False, np.inf, "", "", (f"{end.capitalize()}: no stance was found.",), {})
    return min(results, key=lambda result: (not result.ok, bool(result.broken), result.ratio), default=none)


def _setup_and_fixed_end(plan: Plan, request: JumpRequest, end: End, posture: Array) -> tuple[Setup, FixedEnd]:
    """The stances to search for, and what is fixed where they meet the flight in a posture (1 + n,), rad.

    Feet that may roll are points where no rates roll them and points are possible: the flight's frame does not move.
    """
    setup = side_setup(plan.problem, request, end, posture)
    fixed_end = _fixed_end(plan, setup, end)
    if fixed_end.v is None and request.feet == "auto":
        on_points = side_setup(plan.problem, replace(request, feet="points"), end, posture)
        end_on_points = _fixed_end(plan, on_points, end)
        if end_on_points.v is not None:
            return on_points, end_on_points
    return setup, fixed_end


def _calmer(
    setup: Setup,
    program: JumpProgram,
    solution: JumpSolution,
    complete: Callable[[JumpProgram, JumpSolution], tuple[Launch, dict[str, float] | None]],
) -> list[Launch]:
    """Return the stance of minimal squared torques within the limits, from one of the least share of them.

    Where the share is minimised, feet may hardly press on the ground for a while, and friction does not hold between
    nodes.
    """
    calm = replace(setup, request=replace(setup.request, objective="torque"))
    first = calm.program(CALM_MARGINS)
    solved = solve_in_rounds(first, first.resampled(solution, program.phases))
    if not solved[1].is_motion:
        return []
    return [refined_until_checked(CALM_MARGINS, calm.request, solved, calm.program, complete, solved_again)]


def _of_one_flight(request: JumpRequest) -> JumpRequest:
    """A request without other flights and grounds: of a stance from standing, or to standing, they say nothing."""
    landing = replace(request.landing, height=None, to="standing" if request.is_periodic else request.landing.to)
    takeoff = replace(request.takeoff.from_standing, height=None)
    return replace(request, flights=None, edge=None, takeoff=takeoff, landing=landing)


def _either_way_around(setup: Setup, end: End) -> list[Setup]:
    """Return the setup; and where the flight is met far from standing, one that stands a whole turn further on.

    A robot that takes off upside down may have rotated there forwards or backwards.
    """
    stands = 0 if end == "takeoff" else -1
    meets = -1 if end == "takeoff" else 0
    rotation = float(setup.ends[meets, 0] - setup.ends[stands, 0])
    if abs(rotation) < math.pi / 2:
        return [setup]
    ends = setup.ends.copy()
    ends[stands, 0] += math.copysign(math.tau, rotation)
    return [setup, replace(setup, ends=ends)]


def launches(
    plan: Plan, seed: int = 0, starts: int = STARTS, progress: Callable[[str], None] | None = None
) -> tuple[list[Row], dict[str, Any]]:
    """Rows for a person, and facts by end, of the stances that reach a plan's takeoff and follow its landing."""
    rows: list[Row] = []
    facts: dict[str, Any] = {}
    ends: tuple[End, ...] = get_args(End)
    for end in ends:
        if end not in [contact.end for contact in plan.contacts]:
            rows.append(Row(f"{end} stance", "none was looked for: no frame stands on the ground", "open"))
            continue
        say = None if progress is None else partial(_say_of, end, progress)
        try:
            result = launch(plan, end=end, seed=seed, starts=starts, progress=say)
        except InputError as error:
            rows.append(Row(f"{end} stance", f"none was looked for: {error}", "open"))
            continue
        facts[end] = result.to_dict()
        rows.append(Row(f"{end} stance", result.sentences[0], "good" if result.ok else "open"))
    return rows, facts


def _say_of(end: str, progress: Callable[[str], None], words: str) -> None:
    progress(f"{end}, {words}")


def _fixed_end(plan: Plan, setup: Setup, end: str) -> FixedEnd:
    """What a plan's takeoff or landing fixes; rates and accelerations where they are those of a foot that stands."""
    time = 0.0 if end == "takeoff" else plan.duration
    full = flight_state(plan, 0.0, np.array([time]))
    state = plan.at(time)
    spot = setup.phases[-2 if end == "takeoff" else 1].anchor.spots[0]
    gravity = float(plan.problem.flight.gravity)
    model = PlanarModel(plan.robot, gravity)
    y = np.append(state.orientation, state.positions)
    v = np.append(state.orientation_rate, state.velocities)
    a = np.append(full.accelerations[0, 2], state.accelerations)
    # Velocity and acceleration of the centre of mass, were the anchor fixed.
    velocity = np.array(model.function("velocity", model.com_from(spot, 1))(y, v, a), np.float64).ravel()
    acceleration = np.array(model.function("acceleration", model.com_from(spot, 2))(y, v, a), np.float64).ravel()
    tolerance = 1e-6  # [m/s; over the time unit m/s^2]
    unit = np.sqrt(1.0 / gravity)
    stands = np.abs(velocity - state.com_velocity).max() < tolerance
    falls = stands and np.abs(acceleration + np.array([0.0, gravity])).max() * unit < tolerance
    horizontal, vertical = map(float, state.com_velocity)
    return FixedEnd(
        0 if end == "takeoff" else -1,
        y,
        v=v if stands else None,
        a=a if falls else None,
        com_velocity=None if stands else (horizontal, vertical),
    )


def _launch_of_solution(
    plan: Plan, request: JumpRequest, end: str, program: JumpProgram, solution: JumpSolution
) -> tuple[Launch, dict[str, float] | None]:
    """The launch of a solution; and the figures of its check where more nodes may mend what they show."""
    node = -1 if end == "takeoff" else 0
    try:
        stances = exact_stances(program, solution, end, plan, float(solution.v[0, node]))
    except NoExactStanceError as error:
        sentence = f"{end.capitalize()}: no stance was found between the program's nodes: {error}."
        return Launch(False, np.inf, "", "", (sentence,), {}, broken=(str(error),)), {}
    sides = (stances, ()) if end == "takeoff" else ((), stances)
    result = launch_of_stances(JumpMotion(plan.problem, request, plan, *sides), end)
    if not result.broken:
        return result, None
    # Beyond the limits the least factor is what counts.
    others = {name: value for name, value in result.figures.items() if name not in SHARES}
    return result, {} if result.ratio > 1 else others


def _least_rates(plan: Plan, setup: Setup, met: FixedEnd, end: str) -> tuple[Array, Launch | None]:
    """Rates (n+1,) rad/s with which the flight is met, and the result where no stance is within their limits.

    At that instant what stands does not move, h is the flight's, and so is the velocity of the centre of mass:
    equations of the rates alone in a posture that is fixed, whatever stance it is of. Each contact's are a bound of
    their own.
    """
    com_velocity = plan.at(0.0 if end == "takeoff" else plan.duration).com_velocity
    model = PlanarModel(plan.robot)
    limits = plan.problem.velocity_limits
    bounds: list[tuple[float, str, str]] = []  # ratio, joint, contact
    rates: list[Array] = []
    for contact in setup.phases[-2 if end == "takeoff" else 1].contacts:
        moves = model.function("moves", [model.momentum(), *model.com_from(contact.spots[0], 1)])
        momentum, x, z = (np.asarray(row).ravel() for row in moves(met.y, np.eye(len(met.y)), 0 * met.y))
        equations = ContactEquations(np.stack((momentum, -x, -z)), com_velocity)
        least = rates_at(plan.robot, equations, limits, plan.angular_momentum)
        bounds.append((least.ratio or 0.0, least.joint or "", contact.name))
        rates.append(np.append(least.orientation_rate, least.rates))
    if met.v is not None:
        shares = np.abs(met.v[1:]) / limits
        bounds.append((float(shares.max()), plan.robot.joints[int(shares.argmax())], bounds[0][2]))
    ratio, joint, name = max(bounds)
    if ratio <= 1 + RELATIVE:
        return rates[0] if met.v is None else met.v, None
    reason = (
        f"{LIMIT_WORDS['velocity'].format(joint)} is at least {ratio:.2f} of its limit" if joint else "no rates meet it"
    )
    other = "came before" if end == "takeoff" else "comes after"
    sentence = f"{end.capitalize()}: no stance reaches it: with {name} at rest then, {reason}, whatever {other}."
    return rates[0], Launch(False, ratio, "velocity", joint, (sentence,), {}, impossible=True)


def smooth_guess(program: JumpProgram, met: FixedEnd, rates: Array, shares: Array | float) -> Array:
    """Return a guess (size,) of the program of one side, whose motion is a quintic from standing to the flight.

    Legs that stand follow from where their feet are; forces are those that balance the moments.

    Parameters
    ----------
    met : where the flight is met, with ``rates`` (n+1,) rad/s
    shares : of the usual durations, of all phases or, inwards to the flight, of each
    """
    takes_off = met.node == 0
    inwards = 1 if takes_off else -1
    standing = program.ends[0 if takes_off else 1]
    guess = program.split(program.guess())
    stances = [index for index, phase in enumerate(program.phases) if phase.contacts][::inwards]
    guess.durations[stances, 0] *= shares
    times = instants(program.phases, guess.durations.ravel())
    inner = StanceDynamics(program.model, program.phases[stances[-1]], standing)
    accelerations = inner.released(met.y, rates, 0 * rates if met.a is None else met.a)
    at_flight = np.stack((met.y, rates, accelerations))
    at_end = np.stack((standing, 0 * standing, 0 * standing))
    motion = quintic(times, times[[0, -1]], *(at_end, at_flight)[::inwards])
    for index in stances:
        phase = program.phases[index]
        dynamics = StanceDynamics(program.model, phase, standing)
        nodes = program.nodes_of(index)
        try:
            with may_fail():
                closed = dynamics.close(*motion[:, :, nodes])
        except NoExactStanceError:
            break
        if not np.abs(closed - motion[:, :, nodes])[0].max() < 2.0:  # rad: the feet are out of reach
            break
        motion[:, :, nodes] = closed
        if index != stances[-1]:  # from where the other feet leave, or to where they come
            rows = dynamics.dependent
            seam = closed[:, :, -1 if takes_off else 0]
            beyond = slice(nodes.stop - 1, None) if takes_off else slice(0, nodes.start + 1)
            ends = (seam, at_flight)[::inwards]
            motion[:, rows, beyond] = quintic(times[beyond], times[beyond][[0, -1]], *ends)[:, rows]
        no_ratios = np.zeros((len(phase.others), closed.shape[2]))
        grid = Grid(times[nodes], closed[0], closed[1], closed[2], no_ratios)
        forces = Stance(program.model.robot, program.model.gravity, phase.contacts, 0j, grid).at(grid.times).forces
        guess.forces[index] = phase.stacked(forces)
    guess.y, guess.v, guess.a = motion
    guess.factor[:] = 3.0  # on limits, so that the guess is within most of them
    return program.join(guess)
