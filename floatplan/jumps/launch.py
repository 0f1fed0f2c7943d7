"""Whether a robot can bring itself to a plan's takeoff, or to rest after its landing: the least limits that do."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from floatplan.arguments import SEED, TRIES, function, made, one_of, optional
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.check import SHARES, judged, limit_shares, stance_figures
from floatplan.jumps.exact import NoExactStanceError, StanceDynamics, exact_stances, may_fail
from floatplan.jumps.exchange import solved
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.model import PlanarModel, casadi
from floatplan.jumps.motion import Grid, Stance, flight_state, quintic
from floatplan.jumps.phases import Meeting, instants
from floatplan.jumps.program import JumpProgram, Solution
from floatplan.jumps.setup import TURN, Room, Setup, corrected, side_setup
from floatplan.motion.planar.contact_rates import ContactEquations, End, rates_at
from floatplan.plans.plan import Plan, given_plan
from floatplan.plans.presentation import Row
from floatplan.pool import one_thread
from floatplan.problem.jump import JumpRequest
from floatplan.tables import RELATIVE

STARTS = 3
FRAMES_AT_REST = JumpRequest(feet="points")  # of flights alone, which know frames and no feet
ITERATIONS = 250  # of IPOPT, of each program
ROOM = Room(1.0, 1.0, 0.95, 0.8, clear=3e-3)  # of the nodes: limits are those of the factor
CALM = Room(0.95, 0.97, 0.8, clear=3e-3)  # of the nodes, where squared torques are least within the limits
LASTS = (0.8, 1.5)  # [-] of the usual durations, in the first two starts
DRAWN = (0.25, 1.05)  # [-] of the usual durations, between which later starts are sampled
FAR_TURNED = math.pi / 2  # [rad] from standing, beyond which the other way around is tried too
FARTHEST = 2.0  # [rad] that a joint may be off for feet to be where they stand
SAME = 1e-5  # [rad] solutions of starts that are nearer are one
FACTOR = 3.0  # [-] on limits, so that the guess is within most of them
AT_REST = 1e-6  # [m/s; over the time unit m/s^2] of the frame in flight
WORDS = dict(zip(SHARES, ("torque of {}", "torque-speed curve of {}", "{}'s rate", "torque of {}, held"), strict=True))


@dataclass(frozen=True, eq=False)
class Launch:
    """A stance from rest to a takeoff, or from a landing to rest, with the least common factor on the limits.

    Attributes
    ----------
    ok : whether one was found within the limits, and holds at 2 kHz
    ratio : largest share of its limits that a torque or rate takes, at least; infinite where none was found
    limit : of the figures ``torque``, ``torque_speed``, ``velocity`` and ``held_torque`` the one; "" where none is
    joint : the motor whose share it is; "" where there is none
    sentences : for a person
    figures : as of :class:`floatplan.jumps.check.JumpCheck`
    impossible : whether it is shown that there is none, because of what stands where the flight begins or ends
    broken : what does not hold at 2 kHz, but for the limits
    """

    ok: bool
    ratio: float
    limit: str
    joint: str
    sentences: tuple[str, ...]
    figures: dict[str, float]
    impossible: bool = False
    broken: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return what was found out, as plain data: what ``floatplan plan --launch --json`` prints of an end."""
        told = {name: getattr(self, name) for name in ("ok", "joint", "limit", "impossible")}
        return {**told, "ratio": self.ratio if math.isfinite(self.ratio) else None, "sentences": list(self.sentences)}


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
    """Find the stance from rest that reaches a plan's takeoff with the least common factor on torque and rate limits.

    Posture, angular momentum and velocity of the centre of mass are the plan's; the joints' rates too, where its frame
    is at rest then, else those with which it is. Obstacles are not looked at. Contacts and friction are those of the
    request, else of the problem's jump, else the usual ones; margins do not count.

    Parameters
    ----------
    plan : Plan, or path of a plan file
    request : JumpRequest, optional
    end : "takeoff", or "landing": from the plan's landing to rest
    seed : of the starts after the first
    starts : how many are tried; the best counts
    progress : callable, optional
        Told in a few words what is done.

    Returns
    -------
    Launch
        Not ``ok`` is "none was found"; "there is none" only where ``impossible``, which rates at the end alone show.

    Raises
    ------
    InputError
        The plan or the request is wrong, nothing can stand as asked, or CasADi is not installed.
    """
    casadi()
    plan = given_plan(plan)
    request = optional(made(JumpRequest))(request, "request") or plan.problem.jump or FRAMES_AT_REST
    end = one_of("takeoff", "landing")(end, "end")
    seed = SEED(seed, "seed")
    starts = TRIES(starts, "starts")
    say = optional(function)(progress, "progress") or (lambda _: None)
    margins = replace(
        request, margin=dict.fromkeys(request.margin, 1.0), objective="limits", clearance=0.0, pitch_error=0.0
    )
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    meeting = np.append(state.orientation, state.positions)
    setup, met = _setup_and_meeting(plan, margins, end, meeting)
    v, shown = _least(plan, setup, met, end)
    standing = zip(plan.robot.joints, setup.standing[0 if end == "takeoff" else -1, 1:], strict=True)
    posture = ", ".join(f"{name} {at:.4g}" for name, at in standing)
    told = f"Friction {request.friction:g}, at rest with {posture} rad."
    if shown is not None:
        return replace(shown, sentences=(*shown.sentences, told))
    alone = replace(plan.problem, obstacles=(), self_clearances=())
    setup = replace(setup, problem=alone, fixed=(met,), momentum=plan.angular_momentum)
    answers: list[Launch] = []
    found: list[Array] = []
    complete = partial(_answer, plan, request, end)
    ways = [(way, way.program(ROOM, ITERATIONS)) for way in _turned_either_way(setup, end)]
    for start, (way, first) in itertools.product(range(starts), ways):
        say(f"start {start + 1} of {starts}")
        drawn = np.random.default_rng((seed, start)).uniform(*DRAWN, len(first.phases) - 1)
        guess = plainest(first, met, v, drawn if start >= len(LASTS) else LASTS[start])
        solution = solved(first, guess)
        if not solution[1].converged or any(np.abs(each - solution[1].y).max() < SAME for each in found):
            continue
        found.append(solution[1].y)
        answers.append(corrected(ROOM, margins, solution, partial(way.program, iterations=ITERATIONS), complete))
        if not answers[-1].ok and answers[-1].ratio <= 1:
            say(f"start {start + 1} of {starts}, with less torque in all")
            answers += _calmer(way, solution, margins, complete)
        if answers[-1].ok:
            break
    none = Launch(False, np.inf, "", "", (f"{end.capitalize()}: no stance was found.",), {})
    answer = min(answers, key=lambda each: (not each.ok, bool(each.broken), each.ratio), default=none)
    return replace(answer, sentences=(*answer.sentences, told))


def _setup_and_meeting(plan: Plan, request: JumpRequest, end: End, state: Array) -> tuple[Setup, Meeting]:
    """The stances to search for, and how they meet the flight, whose state there is (1 + n,), rad.

    Feet that may roll are points where no rates roll them and points are possible: the flight's frame is at rest.
    """
    setup = side_setup(plan.problem, request, end, state)
    meeting = _meeting(plan, setup, end)
    if meeting.v is None and request.feet == "auto":
        on_points = side_setup(plan.problem, replace(request, feet="points"), end, state)
        meeting_on_points = _meeting(plan, on_points, end)
        if meeting_on_points.v is not None:
            return on_points, meeting_on_points
    return setup, meeting


def _calmer(
    setup: Setup,
    found: tuple[JumpProgram, Solution],
    request: JumpRequest,
    complete: Callable[[JumpProgram, Solution], tuple[Launch, dict[str, float] | None]],
) -> list[Launch]:
    """Return what the least squared torques within the limits come to, from a stance of the least share of them.

    Where shares are least, feet may hardly press on the ground for a while, and friction does not hold between nodes.
    """
    calm = replace(request, objective="torque")
    program = partial(replace(setup, request=calm).program, iterations=ITERATIONS)
    first = program(CALM)
    solution = solved(first, first.resampled(found[1], found[0].phases))
    return [corrected(CALM, calm, solution, program, complete)] if solution[1].converged else []


def _turned_either_way(setup: Setup, end: End) -> list[Setup]:
    """Return the setup; and where the flight is met far from standing, one that comes to stand by the other way around.

    A robot that takes off upside down may have turned there forwards or backwards: it stood a whole turn apart.
    """
    stands, meets = (0, -1) if end == "takeoff" else (-1, 0)
    turned = float(setup.standing[meets, 0] - setup.standing[stands, 0])
    if abs(turned) < FAR_TURNED:
        return [setup]
    standing = setup.standing.copy()
    standing[stands, 0] += math.copysign(TURN, turned)
    return [setup, replace(setup, standing=standing)]


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
            found = launch(plan, end=end, seed=seed, starts=starts, progress=say)
        except InputError as error:
            rows.append(Row(f"{end} stance", f"none was looked for: {error}", "open"))
            continue
        facts[end] = found.to_dict()
        rows.append(Row(f"{end} stance", found.sentences[0], "good" if found.ok else "open"))
    return rows, facts


def _say_of(end: str, progress: Callable[[str], None], words: str) -> None:
    progress(f"{end}, {words}")


def _meeting(plan: Plan, setup: Setup, end: str) -> Meeting:
    """What a plan's takeoff or landing asks; its rates and accelerations where they are those of a foot at rest."""
    full = flight_state(plan, 0.0, np.array([0.0 if end == "takeoff" else plan.duration]))
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    anchor = setup.phases[-2 if end == "takeoff" else 1].anchor
    gravity = float(plan.problem.flight.gravity)
    model = PlanarModel(plan.robot, gravity)
    y = np.append(state.orientation, state.positions)
    v = np.append(state.orientation_rate, state.velocities)
    a = np.append(full.accelerations[0, 2], state.accelerations)
    from_com = [model.com_from(anchor.spots[0], order) for order in (1, 2)]
    rate, change = (np.array(model.function("moves", each)(y, v, a), np.float64).ravel() for each in from_com)
    unit = np.sqrt(1.0 / gravity)
    horizontal, vertical = map(float, state.com_velocity)
    rests = np.abs(rate - state.com_velocity).max() < AT_REST
    falls = rests and np.abs(change + np.array([0.0, gravity])).max() * unit < AT_REST
    known = (v if rests else None, a if falls else None, None if rests else (horizontal, vertical))
    return Meeting(0 if end == "takeoff" else -1, y, *known)


def _answer(
    plan: Plan, request: JumpRequest, end: str, program: JumpProgram, solution: Solution
) -> tuple[Launch, dict[str, float] | None]:
    """What a solution comes to; and the figures of its check where more nodes may mend what they show."""
    node = -1 if end == "takeoff" else 0
    try:
        stances = exact_stances(program, solution, end, plan, float(solution.v[0, node]))
    except NoExactStanceError as error:
        sentence = f"{end.capitalize()}: no stance was found between the program's nodes: {error}."
        return Launch(False, np.inf, "", "", (sentence,), {}, broken=(str(error),)), {}
    sides = (stances, ()) if end == "takeoff" else ((), stances)
    figures = stance_figures(JumpMotion(plan.problem, request, plan, *sides))
    limit = max(SHARES, key=lambda name: figures[name])
    ratio = figures[limit]
    joint = _joint(plan, stances, limit)
    figures.pop("obstacles", None)  # those of a flight may be where it begins: a ground a little below its feet
    rest = {name: value for name, value in figures.items() if name not in SHARES}
    broken = [", ".join(words) for words in judged(request, rest)[0]]
    named = WORDS[limit].format(joint)
    if ratio > 1:
        first = f"no stance was found within the limits (least factor {ratio:.2f}, {named})"
    elif broken:
        first = "no stance was found that holds between the program's nodes"
    else:
        first = f"reachable, with {1 - ratio:.0%} to spare ({named})" if ratio > 0 else "reachable; nothing is limited"
    sentences = (f"{end.capitalize()}: {first}.", *broken)
    answer = Launch(ratio <= 1 and not broken, ratio, limit, joint, sentences, figures, broken=tuple(broken))
    return answer, ({} if ratio > 1 else rest) if broken else None  # beyond the limits the least factor is asked


def _least(plan: Plan, setup: Setup, met: Meeting, end: str) -> tuple[Array, Launch | None]:
    """Rates (n+1,) rad/s with which the flight is met, and the answer where no stance is within their limits.

    At that instant what stands is at rest, h is the flight's, and so is the velocity of the centre of mass: equations
    of the rates alone in a posture that is known, whatever stance it is of. Each contact's are a bound of their own.
    """
    com = plan.at(0.0 if end == "takeoff" else plan.duration).com_velocity
    model = PlanarModel(plan.robot)
    limits = plan.problem.velocity_limits
    bounds: list[tuple[float, str, str]] = []
    rates: list[Array] = []
    for contact in setup.phases[-2 if end == "takeoff" else 1].contacts:
        moves = model.function("moves", [model.momentum(), *model.com_from(contact.spots[0], 1)])
        momentum, x, z = (np.asarray(each).ravel() for each in moves(met.y, np.eye(len(met.y)), 0 * met.y))
        equations = ContactEquations(np.stack((momentum, -x, -z)), com)
        found = rates_at(plan.robot, equations, limits, plan.angular_momentum)
        bounds.append((found.ratio or 0.0, found.joint or "", contact.name))
        rates.append(np.append(found.orientation_rate, found.rates))
    if met.v is not None:
        shares = np.abs(met.v[1:]) / limits
        bounds.append((float(shares.max()), plan.robot.joints[int(shares.argmax())], bounds[0][2]))
    ratio, joint, name = max(bounds)
    if ratio <= 1 + RELATIVE:
        return rates[0] if met.v is None else met.v, None
    takes = f"{WORDS['velocity'].format(joint)} is at least {ratio:.2f} of its limit" if joint else "no rates meet it"
    other = "came before" if end == "takeoff" else "comes after"
    sentence = f"{end.capitalize()}: no stance reaches it: with {name} at rest then, {takes}, whatever {other}."
    return rates[0], Launch(False, ratio, "velocity", joint, (sentence,), {}, impossible=True)


def plainest(program: JumpProgram, met: Meeting, v: Array, shares: Array | float) -> Array:
    """Return a guess (size,) of the program of one side, whose motion is a quintic from rest to the flight.

    Legs that stand follow from where their feet are; forces are those that balance the moments.

    Parameters
    ----------
    met : where the flight is met, with rates ``v`` (n+1,) rad/s
    shares : of the usual durations, of all phases or, inwards to the flight, of each
    """
    takes_off = met.node == 0
    way = 1 if takes_off else -1
    home = program.ends[0 if takes_off else 1]
    plain = program.split(program.guess())
    stances = [index for index, phase in enumerate(program.phases) if phase.contacts][::way]
    plain[-3][stances, 0] *= shares
    times = instants(program.phases, plain[-3].ravel())
    inner = StanceDynamics(program.model, program.phases[stances[-1]], home)
    flies = np.stack((met.y, v, inner.released(met.y, v, 0 * v if met.a is None else met.a)))
    motion = quintic(times, times[[0, -1]], *(np.stack((home, 0 * home, 0 * home)), flies)[::way])
    for index in stances:
        phase = program.phases[index]
        dynamics = StanceDynamics(program.model, phase, home)
        nodes = slice(int(program.starts[index]), int(program.starts[index + 1]) + 1)
        try:
            with may_fail():
                closed = dynamics.close(*motion[:, :, nodes])
        except NoExactStanceError:
            break
        if not np.abs(closed - motion[:, :, nodes])[0].max() < FARTHEST:
            break
        motion[:, :, nodes] = closed
        if index != stances[-1]:  # from where the other feet leave, or to where they come
            rows = dynamics.dependent
            seam = closed[:, :, -1 if takes_off else 0]
            beyond = slice(nodes.stop - 1, None) if takes_off else slice(0, nodes.start + 1)
            motion[:, rows, beyond] = quintic(times[beyond], times[beyond][[0, -1]], *(seam, flies)[::way])[:, rows]
        grid = Grid(times[nodes], closed[0], closed[1], closed[2], np.zeros((len(phase.others), closed.shape[2])))
        forces = Stance(program.model.robot, program.model.gravity, phase.contacts, 0j, grid).at(grid.times).forces
        plain[3 + index] = phase.gathered(forces)
    plain[-1][:] = FACTOR
    return program.join([*motion, *plain[3:]])


def _joint(plan: Plan, stances: Sequence[Stance], limit: str) -> str:
    """The motor whose share of a limit is the largest at the stances' instants."""
    shares = [limit_shares(plan.problem, stance.at(stance.grid.times))[limit] for stance in stances]
    held = list(plan.robot.locked)
    robot = plan.robot
    names = {"velocity": robot.joints, "held_torque": held}.get(limit, robot.motors)
    return names[int(np.concatenate(shares).max(axis=0).argmax())]
