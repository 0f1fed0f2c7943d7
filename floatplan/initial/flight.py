"""A first flight of any robot: of a jump from standing to standing where one is found, else one afloat."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import FloatplanError, InputError
from floatplan.initial.afloat import limits_of, planned_afloat, turns_afloat, warnings_in_plane
from floatplan.initial.apart import kept_apart
from floatplan.initial.asked import GRAVITY, Asked, wrong
from floatplan.initial.barely import as_clear_as_it_lands, barely_kept
from floatplan.initial.feet import standing_height, upright
from floatplan.initial.robots import ChosenRobot, chosen_robot
from floatplan.jumps.jump import Jump
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import Stance
from floatplan.jumps.planner import jump
from floatplan.planning.planner import plan
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Flight, JointState, Landing, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem

LONG, SHORT = 2.57, 1.2  # [-] durations of flights over sqrt(height / g), with a turn and without
DIGITS = 6  # [-] of numbers of a jump in the problem file
PLACES = 6  # [-] of heights there, m: micrometres
AFLOAT_WORK = 5e7  # [instants of one body] with flights afloat, about 1 s each 6e6
SMALLEST_TURN = math.radians(3)  # [rad] that is worth a flight
ROUNDS = 2  # [-] in which links that overlap are kept apart: others may then do
MOST_LEFT_OUT = 4  # [-] options without which a jump is tried, where none is found


class NoFlightError(FloatplanError):
    """No jump as asked was found whose flight is proved, nor a flight afloat without warnings."""


def jump_problem(chosen: ChosenRobot, turns: int, asked: Asked) -> Problem:
    """Return the problem of a jump from standing to standing, with whole turns of the base, of which 0 are a hop.

    It begins on the feet on the side to which it turns, unless others are asked; its flight, from rest to rest, is but
    a guess, but for a duration that is asked.
    """
    robot = chosen.robot
    foot = asked.foot or chosen.feet[0 if turns * robot.plane.turn >= 0 else -1]
    angle, unit = upright(robot, foot), math.sqrt(standing_height(robot, foot, chosen.posture) / GRAVITY)
    usual = LONG * unit if turns else SHORT * unit
    return Problem(
        robot,
        Posture(angle, chosen.posture),
        Posture(angle + turns * math.tau, chosen.posture),
        Flight(asked.duration or usual, angular_momentum="free", takeoff=Takeoff(foot)),
        Motion(objective="torque"),
        limits_of(chosen),
        name=robot.name,
        jump=asked.request(chosen, foot),
    )


def flight_of_jump(found: Jump, flight: Plan) -> Problem:
    """Return the problem of a jump that was found: its flight between the feet at rest, in round numbers."""
    asked, free = flight.problem, flight.problem.flight
    sides = [[_contacts(stance) for stance in stances] for stances in (found.before, found.after)]
    request = replace(
        found.request,
        takeoff=replace(found.request.takeoff, contacts=sides[0]),
        landing=replace(found.request.landing, contacts=sides[1]),
    )
    rounded = replace(
        free,
        duration=found.problem.flight.duration if "duration" in request.fixed else _round(free.duration),
        angular_momentum=_round(flight.angular_momentum),
        horizontal_velocity=_round(free.speed_in_plane),
        landing=Landing(asked.landing.frame, round(asked.landing_height, PLACES)),
    )
    return replace(
        found.problem,
        start=_round_posture(asked.initial),
        goal=_round_posture(asked.final),
        flight=rounded,
        motion=asked.motion,
        jump=request,
    )


def _contacts(stance: Stance) -> tuple[str, ...]:
    """Frames that stand, as problem files name them: of a sole that stands on its toe alone, that."""
    frames = [contact.frame for contact in stance.contacts]
    whole = [contact.frame if frames.count(contact.frame) > 1 else contact.name for contact in stance.contacts]
    return tuple(dict.fromkeys(whole))


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _round_posture(state: JointState) -> Posture:
    """Return a posture whose angles and their rates are round numbers in degrees."""

    def rounded(values: Array) -> Array:
        return np.array([math.radians(_round(each)) for each in np.rad2deg(values).tolist()])

    orientation = float(rounded(np.array([state.orientation]))[0])
    return Posture(orientation, rounded(state.positions), rounded(state.velocities), rounded(state.accelerations))


@dataclass(frozen=True, eq=False)
class FirstFlight:
    """A problem whose plan was found and proved; afloat it has no warnings but of links that overlap.

    Attributes
    ----------
    problem : Problem
    plan : Plan
        That of a jump may have warnings, which are told: a jump that was found is not exchanged for less.
    reasons : why it is no more than it is; empty where it is of a jump with a whole turn
    jump : the jump around it; None where it is afloat
    """

    problem: Problem
    plan: Plan
    reasons: tuple[str, ...]
    jump: Jump | None = None

    @property
    def warnings(self) -> list[str]:
        """What is not as it should be, in sentences."""
        return [*(each.message for each in self.plan.warnings), *([] if self.jump is None else barely_kept(self.jump))]

    @property
    def turn(self) -> float:
        """Of the base, rad; of a jump in whole turns."""
        asked = self.problem if self.jump is None else self.jump.problem
        return asked.final.orientation - asked.initial.orientation


def asked_flight(
    source: str | Path,
    asked: Asked,
    given: Mapping[str, Any],
    words: Mapping[str, str],
    seed: int,
    progress: Callable[[str], None],
) -> tuple[ChosenRobot, FirstFlight]:
    """Choose a robot and search for a first flight as asked; where there is none, say without what there is one.

    What is ``given`` of the robot is as of :func:`chosen_robot`, in the ``words`` in which it is typed.
    """
    chosen = chosen_robot(source, given, asked.foot, asked.posture)
    try:
        return chosen, first_flight(chosen, asked, seed=seed, progress=progress)
    except NoFlightError as error:
        vain = list[str]()
        for name, word in list({**asked.given, **words}.items())[:MOST_LEFT_OUT]:
            progress(f"without {word}")
            left = {key: value for key, value in given.items() if key != name}
            try:
                less = replace(asked, **({name: getattr(Asked, name)} if name in asked.given else {}))
                other = chosen_robot(source, left, less.foot, less.posture)
                first_flight(other, less, seed=seed, progress=progress, afloat=False)
            except (InputError, NoFlightError):
                vain.append(word)
            else:
                raise NoFlightError(f"{error} Without {word} a jump was found.") from None
        raise NoFlightError(
            f"{error} Nor was one found without {', or without '.join(vain)}." if vain else error
        ) from None


def first_flight(
    chosen: ChosenRobot,
    asked: Asked | None = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    afloat: bool = True,
) -> FirstFlight:
    """Search for the flight of a jump, with a whole turn, else without; where none is found, for one in free fall.

    Parameters
    ----------
    chosen : ChosenRobot
    asked : Asked, optional
        What is kept, or nothing is found: a jump of which something is asked is not exchanged for a flight afloat.
    seed : int
        Of the search's random numbers.
    progress : callable, optional
        Told in a few words what is tried.
    afloat : bool
        Whether a flight in free fall will do.

    Raises
    ------
    InputError
        The robot's geometry is wrong, it does not keep to its plane, or what is asked cannot be.
    NoFlightError
        None of the jumps tried was found with a flight that is proved, and no flight afloat has no warnings.
    """
    asked = asked or Asked()
    asked.check(chosen)
    say = progress or (lambda _: None)
    reasons = _no_jump(chosen)
    of_jump = [name for name in asked.given if name != "duration"]
    if reasons and of_jump:
        raise wrong(of_jump[0], f"it is about a jump. {reasons[0]}".removesuffix("."))
    turns = () if reasons else asked.whole_turns(chosen)
    for each in turns:
        what = {0: "without a turn", 1: "with a whole turn"}.get(abs(each), f"with {abs(each)} whole turns")
        say(f"jump {what}")
        answer = _jump(chosen, each, asked, seed, each == turns[-1], _following(say, f"jump {what}"))
        if isinstance(answer, FirstFlight):
            return replace(answer, reasons=tuple(reasons))
        reasons.append(f"A jump {what} was not found: {answer}")
    if (turns and asked.given) or not afloat:
        raise NoFlightError(f"no jump was found with {' '.join(asked.given.values())}. {' '.join(reasons)}")
    return _first_afloat(chosen, asked, reasons, say)


def _first_afloat(chosen: ChosenRobot, asked: Asked, reasons: list[str], say: Callable[[str], None]) -> FirstFlight:
    """The first flight afloat that is found."""
    work = farthest = 0.0
    overlapping: FirstFlight | None = None
    for problem in turns_afloat(chosen, asked.duration):
        turn = abs(problem.final.orientation - problem.initial.orientation)
        farthest = max(farthest, turn)
        if turn < SMALLEST_TURN or work > AFLOAT_WORK:
            continue
        say(f"turn of {math.degrees(turn):.0f} degrees afloat")
        found, took = planned_afloat(problem)
        work += took
        if found is None:
            continue
        flight = FirstFlight(*found, tuple(reasons))
        if not warnings_in_plane(flight.plan):
            return flight
        overlapping = overlapping or flight
    if overlapping is not None:
        return overlapping
    reasons.append(f"Afloat, its joints would turn the base by at most {math.degrees(farthest):.2g} degrees.")
    raise NoFlightError(
        f"{chosen.robot.source}: no flight was found that is proved and without warnings. {' '.join(reasons)} Write the"
        " problem yourself, with joints that move more of the robot; floatplan info lists them."
    )


def _no_jump(chosen: ChosenRobot) -> list[str]:
    """Why no jump can be looked for."""
    try:
        chosen.robot.check_shapes()
    except InputError as error:
        return [f"No jump was looked for, since that takes all shapes: {error}."]
    if not chosen.feet:
        return ["No feet were found that it could stand on."]
    try:
        casadi()
    except InputError as error:
        return [f"No jump was looked for: {error.reason}; {error.advice}."]
    return []


def _following(say: Callable[[str], None], first: str) -> Callable[[str], None]:
    """What says words after the ``first``."""
    return lambda words: say(f"{first}: {words}")


def _jump(
    chosen: ChosenRobot, turns: int, asked: Asked, seed: int, helps: bool, say: Callable[[str], None]
) -> FirstFlight | str:
    """A jump's flight that is planned again from its problem in round numbers; or why there is none, and what helps.

    Raises
    ------
    InputError
        What is asked cannot be.
    """
    try:
        problem = jump_problem(chosen, turns * int(chosen.robot.plane.turn), asked)
        found = as_clear_as_it_lands(jump(problem, seed=seed, starts=1, helps=helps, progress=say))
        found = _links_apart(found, seed, _following(say, "links apart"))
        if not found.ok or found.flight is None:
            return found.explanation
        say("proof of its flight")
        problem, flight = _flight_alone(flight_of_jump(found, found.flight), seed)
    except InputError as error:
        asked.refuse_own(error)
        return asked.reason(error, chosen)
    if not _is_proved(flight):
        return f"Its flight is not proved: {flight.explanation}"
    return FirstFlight(problem, flight, (), found)


def _flight_alone(problem: Problem, seed: int) -> tuple[Problem, Plan]:
    """Plan the flight of a jump from its problem in round numbers; above the ground where it has fewer warnings so."""
    flight = plan(problem, seed=seed, prove=True)
    warnings = warnings_in_plane(flight)
    # Nothing keeps links out of one another but what is asked of them: the ground does not.
    if not flight.ok or all(warning.kind == "overlap" for warning in warnings):
        return problem, flight
    landing = Landing(problem.landing.frame)
    above = replace(problem, ground=True, flight=replace(problem.flight, landing=landing))
    try:
        other = plan(above, seed=seed, prove=True)
    except InputError:  # the rounded numbers lead into the ground: the flight stays as it is, with its warning
        return problem, flight
    if _is_proved(other) and len(warnings_in_plane(other)) < len(warnings):
        return above, other
    return problem, flight


def _is_proved(flight: Plan) -> bool:
    return flight.ok and flight.certificate is not None and flight.certificate.proved


def _links_apart(found: Jump, seed: int, say: Callable[[str], None]) -> Jump:
    """A jump whose links do not overlap, where the one that was found leads to one; else that one, with its warning."""
    for _ in range(ROUNDS):
        apart = kept_apart(found.problem, found.planned_positions, found.duration) if found.ok else None
        if apart is None:
            return found
        try:
            other = jump(apart, seed=seed, starts=1, helps=False, near=found, progress=say)
        except InputError:  # they are as near where the robot stands
            return found
        if not other.ok:
            return found
        found = other
    return found
