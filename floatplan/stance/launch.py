"""Whether a robot can bring itself to a plan's takeoff, or to rest after its landing: the least limits that do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from floatplan.arguments import SEED, made, one_of, optional, whole
from floatplan.errors import InputError
from floatplan.plans.plan import Plan, given_plan
from floatplan.plans.presentation import Row
from floatplan.pool.threads import one_thread
from floatplan.problem.jump import JumpRequest
from floatplan.stance.check import judged, stance_figures
from floatplan.stance.exact import exact_stances
from floatplan.stance.exchange import solved
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.model import PlanarModel, casadi
from floatplan.stance.motion import Stance, flight_state
from floatplan.stance.phases import Meeting
from floatplan.stance.program import JumpProgram, Solution
from floatplan.stance.setup import Room, Setup, corrected, side_setup
from floatplan.tables import Range

End: TypeAlias = Literal["takeoff", "landing"]

STARTS = 3
ITERATIONS = 130  # of IPOPT, of each program
MOST_STARTS = Range(1, 1000, "")
ROOM = Room(1.0, 1.0, 0.9, 1.1, clear=3e-3, range=0.02)  # of the nodes: limits are those of the factor
AT_REST = 1e-6  # [m/s; over the time unit m/s^2] of the frame in flight
WORDS = {"torque": "torque of {}", "torque_speed": "torque-speed curve of {}", "velocity": "{}'s rate"}


@dataclass(frozen=True, eq=False)
class Launch:
    """A stance from rest to a takeoff, or from a landing to rest, with the least common factor on the limits.

    Attributes
    ----------
    ok : whether one was found within the limits, and holds at 2 kHz
    ratio : largest share of its limits that a torque or rate takes; infinite where none was found
    limit : "torque", "torque_speed" or "velocity": which share that is; "" where there is none
    joint : the motor whose share it is; "" where there is none
    sentences : for a person
    figures : as of :class:`floatplan.stance.check.JumpCheck`
    impossible : whether it is shown that there is none, because of what the flight itself asks
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
        ratio = self.ratio if math.isfinite(self.ratio) else None
        return {**told, "ratio": ratio, "sentences": list(self.sentences)}


@one_thread
def launch(
    plan: Plan | str | Path,
    request: JumpRequest | None = None,
    *,
    end: End = "takeoff",
    seed: int = 0,
    starts: int = STARTS,
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

    Returns
    -------
    Launch
        Not ``ok`` is "none was found", never "there is none".

    Raises
    ------
    InputError
        The plan or the request is wrong, nothing can stand as asked, or CasADi is not installed.
    """
    casadi()
    plan = given_plan(plan)
    request = optional(made(JumpRequest))(request, "request") or plan.problem.jump or JumpRequest()
    end = one_of("takeoff", "landing")(end, "end")
    seed, starts = SEED(seed, "seed"), whole(MOST_STARTS)(starts, "starts")
    margins = replace(request, margin=dict.fromkeys(request.margin, 1.0), objective="limits", clearance=0.0)
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    setup = side_setup(plan.problem, margins, end, np.append(state.orientation, state.positions))
    met = _meeting(plan, setup, end)
    alone = replace(plan.problem, obstacles=(), self_clearances=())
    setup = replace(setup, problem=alone, fixed=(met,), momentum=plan.angular_momentum)

    def complete(program: JumpProgram, solution: Solution) -> tuple[Launch, dict[str, float] | None]:
        return _answer(plan, request, end, program, solution)

    answer = Launch(False, np.inf, "", "", (f"{end.capitalize()}: no stance was found.",), {})
    program = partial(setup.program, iterations=ITERATIONS)
    first = program(ROOM)
    for start in range(starts):
        rng = np.random.default_rng((seed, start)) if start else None
        solution = solved(first, first.guess(rng))
        if solution[1].converged:
            found = corrected(ROOM, margins, solution, program, complete)
            answer = min(answer, found, key=lambda each: (not each.ok, bool(each.broken), each.ratio))
        if answer.ok:
            break
    shown = _shown(plan, met, end)
    standing = zip(plan.robot.joints, setup.standing[0 if end == "takeoff" else -1, 1:], strict=True)
    posture = ", ".join(f"{name} {at:.4g}" for name, at in standing)
    told = f"Friction {request.friction:g}, at rest with {posture} rad."
    return replace(answer, sentences=(*answer.sentences, *shown, told), impossible=bool(shown))


def launches(plan: Plan, seed: int = 0, starts: int = STARTS) -> tuple[list[Row], dict[str, Any]]:
    """Rows for a person, and facts by end, of the stances that reach a plan's takeoff and follow its landing."""
    rows: list[Row] = []
    facts: dict[str, Any] = {}
    stands = [contact.end for contact in plan.contacts]
    ends: tuple[End, ...] = get_args(End)
    for end in ends:
        if end not in stands:
            rows.append(Row(f"{end} stance", "none was looked for: no frame stands on the ground", "open"))
            continue
        try:
            found = launch(plan, end=end, seed=seed, starts=starts)
        except InputError as error:
            rows.append(Row(f"{end} stance", f"none was looked for: {error}", "open"))
            continue
        facts[end] = found.to_dict()
        rows.append(Row(f"{end} stance", found.sentences[0], "good" if found.ok else "open"))
    return rows, facts


def _meeting(plan: Plan, setup: Setup, end: str) -> Meeting:
    """What a plan's takeoff or landing asks; its rates and accelerations where they are those of a foot at rest."""
    full = flight_state(plan, np.array([0.0 if end == "takeoff" else plan.duration]), 0.0)
    state = plan.at(0.0 if end == "takeoff" else plan.duration)
    anchor, gravity = setup.phases[-2 if end == "takeoff" else 1].anchor, float(plan.problem.flight.gravity)
    model, y = PlanarModel(plan.robot, gravity), np.append(state.orientation, state.positions)
    v = np.append(state.orientation_rate, state.velocities)
    a = np.append(full.accelerations[0, 2], state.accelerations)
    from_com = [model.com_from(anchor.spots[0], order) for order in (1, 2)]
    rate, change = (np.array(model.function("moves", each)(y, v, a), np.float64).ravel() for each in from_com)
    unit = np.sqrt(1.0 / gravity)
    slides = float(np.abs(rate - state.com_velocity).max())
    pushed = float(np.abs(change + np.array([0.0, gravity])).max()) * unit
    horizontal, vertical = map(float, state.com_velocity)
    rests = slides < AT_REST
    falls = rests and pushed < AT_REST
    known = (v if rests else None, a if falls else None, None if rests else (horizontal, vertical))
    return Meeting(0 if end == "takeoff" else -1, y, *known)


def _answer(
    plan: Plan, request: JumpRequest, end: str, program: JumpProgram, solution: Solution
) -> tuple[Launch, dict[str, float] | None]:
    """What a solution comes to; and the figures of its check where more nodes may mend what they show."""
    node = -1 if end == "takeoff" else 0
    com = complex(*plan.at(0.0 if end == "takeoff" else plan.duration).com_position)
    stances = exact_stances(program, solution, end, solution.y[:, node], float(solution.v[0, node]), com)
    sides = (stances, ()) if end == "takeoff" else ((), stances)
    motion = JumpMotion(plan.problem, request, plan, *sides)
    figures = stance_figures(motion)
    shares = {name: figures[name] for name in ("torque", "torque_speed", "velocity")}
    limit = max(shares, key=lambda name: shares[name])
    ratio = shares[limit]
    joint = _joint(plan, stances, limit)
    figures.pop("obstacles", None)  # those of a flight may be where it begins: a ground a little below its feet
    rest = {name: value for name, value in figures.items() if name not in shares}
    said, _ = judged(request, rest)
    broken = [", ".join(words) for words in said]
    named = WORDS[limit].format(joint)
    if ratio <= 1 and not broken:
        first = f"reachable, with {1 - ratio:.0%} to spare ({named})" if ratio > 0 else "reachable; nothing is limited"
    elif broken:
        first = "no stance was found that holds between the program's nodes"
    else:
        first = f"no stance was found within the limits (least factor {ratio:.2f}, {named})"
    sentences = (f"{end.capitalize()}: {first}.", *broken)
    answer = Launch(ratio <= 1 and not broken, ratio, limit, joint, sentences, figures, broken=tuple(broken))
    return answer, rest if broken else None


def _shown(plan: Plan, met: Meeting, end: str) -> tuple[str, ...]:
    """A sentence where the flight itself turns a joint faster there than its limit: no stance then is within limits."""
    if met.v is None:
        return ()
    shares = np.abs(met.v[1:]) / plan.problem.velocity_limits
    joint, most = plan.robot.joints[int(shares.argmax())], float(shares.max())
    return (f"None can be: at {end} {joint} turns at {most:.2f} of its limit whatever the stance.",) if most > 1 else ()


def _joint(plan: Plan, stances: Sequence[Stance], limit: str) -> str:
    """The motor whose share of a limit is the largest at the stances' instants."""
    problem, robot = plan.problem, plan.robot
    states = [stance.at(stance.grid.times) for stance in stances]
    torques = np.abs(np.concatenate([state.torques for state in states]) @ robot.transmission)
    joints = np.concatenate([stance.grid.v[1:].T for stance in stances])
    rates = np.abs(joints @ robot.motor_ratios.T)
    if limit == "torque":
        shares = torques / problem.motor_torque_limits
    elif limit == "torque_speed":
        shares = (torques + problem.motor_slope * rates) / problem.motor_stall
    else:
        return robot.joints[int((np.abs(joints) / problem.velocity_limits).max(axis=0).argmax())]
    return robot.motors[int(shares.max(axis=0).argmax())]
