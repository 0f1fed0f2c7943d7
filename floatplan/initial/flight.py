"""A first flight of any robot: of a jump from standing to standing where there is one, else one afloat."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import without
from floatplan.arrays import Array
from floatplan.errors import FloatplanError, InputError
from floatplan.initial.afloat import limits_of, planned_afloat, problems_afloat, warnings_in_plane
from floatplan.initial.feet import standing_height, upright
from floatplan.initial.options import InitOptions, wrong
from floatplan.initial.robots import ChosenRobot, chosen_robot
from floatplan.initial.separation import separated
from floatplan.initial.shortcomings import shortcomings, with_largest_pitch_error
from floatplan.jumps.jump import Jump
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import Stance
from floatplan.jumps.planner import jump
from floatplan.planning.planner import plan
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Flight, JointState, Landing, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.tables import GRAVITY

DIGITS = 6  # [-] of numbers of a jump in the problem file


class NoFlightError(FloatplanError):
    """The search has no requested jump whose flight is proved, nor a flight afloat without warnings."""


def jump_problem(chosen: ChosenRobot, turns: int, options: InitOptions) -> Problem:
    """Return the problem of a jump from standing to standing, with whole turns of the base, of which 0 are a hop.

    It begins on the feet on the side to which it rotates, unless options name others; its flight is but a guess, except
    for a duration that is set.
    """
    robot = chosen.robot
    foot = options.foot or chosen.feet[0 if turns * robot.plane.turn >= 0 else -1]
    angle = upright(robot, foot)
    unit = math.sqrt(standing_height(robot, foot, chosen.posture) / GRAVITY)
    usual = 2.57 * unit if turns else 1.2 * unit  # s, of flights of many robots
    return Problem(
        robot,
        Posture(angle, chosen.posture),
        Posture(angle + turns * math.tau, chosen.posture),
        Flight(options.duration or usual, angular_momentum="free", takeoff=Takeoff(foot)),
        Motion(objective="torque"),
        limits_of(chosen),
        name=robot.name,
        jump=options.request(chosen, foot),
    )


def flight_of_jump(jump: Jump, flight: Plan) -> Problem:
    """Return the problem of a jump: its flight between the feet that stand, in round numbers."""
    problem = flight.problem
    free = problem.flight
    request = replace(
        jump.request,
        takeoff=replace(jump.request.takeoff, contacts=list(map(_contacts, jump.before))),
        landing=replace(jump.request.landing, contacts=list(map(_contacts, jump.after))),
    )
    micrometres = 6  # digits of a height, m
    rounded = replace(
        free,
        duration=jump.problem.flight.duration if "duration" in request.fixed else _round(free.duration),
        angular_momentum=_round(flight.angular_momentum),
        horizontal_velocity=_round(free.speed_in_plane),
        landing=Landing(problem.landing.frame, round(problem.landing_height, micrometres)),
    )
    return replace(
        jump.problem,
        start=_round_posture(problem.initial),
        goal=_round_posture(problem.final),
        flight=rounded,
        motion=problem.motion,
        jump=request,
    )


def _contacts(stance: Stance) -> tuple[str, ...]:
    """Frames that stand, as problem files name them: of a sole that stands only on its toe, that."""
    frames = [contact.frame for contact in stance.contacts]
    names: dict[str, None] = {}
    for contact in stance.contacts:
        is_whole = frames.count(contact.frame) > 1
        names[contact.frame if is_whole else contact.name] = None
    return tuple(names)


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _round_posture(state: JointState) -> Posture:
    """Return a posture whose angles and their rates are round numbers in degrees."""

    def rounded(values: Array) -> Array:
        return np.array([math.radians(_round(degrees)) for degrees in np.rad2deg(values).tolist()])

    orientation = float(rounded(np.array([state.orientation]))[0])
    return Posture(orientation, rounded(state.positions), rounded(state.velocities), rounded(state.accelerations))


@dataclass(frozen=True, eq=False)
class FirstFlight:
    """A problem with its proved plan; afloat it has no warnings but of links that overlap.

    Attributes
    ----------
    problem : Problem
    plan : Plan
        That of a jump may have warnings, which are reported: a jump is not replaced by less.
    reasons : why it is no more than it is; empty where it is of a jump with a whole rotation
    jump : the jump around it; None where it is afloat
    """

    problem: Problem
    plan: Plan
    reasons: tuple[str, ...]
    jump: Jump | None = None

    @property
    def warnings(self) -> list[str]:
        """What is not as it should be, in sentences."""
        messages = [warning.message for warning in self.plan.warnings]
        return messages if self.jump is None else [*messages, *shortcomings(self.jump)]

    @property
    def base_rotation(self) -> float:
        """Of the base, rad; of a jump in whole turns."""
        problem = self.problem if self.jump is None else self.jump.problem
        return problem.final.orientation - problem.initial.orientation


def requested_flight(
    source: str | Path,
    options: InitOptions,
    robot_options: Mapping[str, Any],
    words: Mapping[str, str],
    seed: int,
    progress: Callable[[str], None],
) -> tuple[ChosenRobot, FirstFlight]:
    """Choose a robot and search for a first flight as requested; where there is none, say without what there is one.

    ``robot_options`` are as of :func:`chosen_robot`, and ``words`` are those, as they are typed.
    """
    chosen = chosen_robot(source, robot_options, options.foot, options.posture)
    try:
        return chosen, first_flight(chosen, options, seed=seed, progress=progress)
    except NoFlightError as error:
        failures = list[str]()
        most = 4  # options without which a jump is tried
        for name, word in list({**options.typed, **words}.items())[:most]:
            progress(f"without {word}")
            fewer = replace(options, **{name: getattr(InitOptions, name)}) if name in options.typed else options
            others = without(robot_options, (name,))
            try:
                other = chosen_robot(source, others, fewer.foot, fewer.posture)
                first_flight(other, fewer, seed=seed, progress=progress, afloat=False)
            except (InputError, NoFlightError):
                failures.append(word)
            else:
                raise NoFlightError(f"{error} Without {word} a jump was found.") from None
        if failures:
            raise NoFlightError(f"{error} Nor was one found without {', or without '.join(failures)}.") from None
        raise NoFlightError(error) from None


def first_flight(
    chosen: ChosenRobot,
    options: InitOptions | None = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    afloat: bool = True,
) -> FirstFlight:
    """Search for the flight of a jump, with a whole rotation, else without; where there is none, for one in free fall.

    Parameters
    ----------
    chosen : ChosenRobot
    options : InitOptions, optional
        They are satisfied, or it fails: a jump that they are about is not exchanged for a flight afloat.
    seed : int
        Of the search's random numbers.
    progress : callable, optional
        Called with a few words on what is tried.
    afloat : bool
        Whether a flight in free fall will do.

    Raises
    ------
    InputError
        The robot's geometry is wrong, it leaves its plane, or the options are impossible.
    NoFlightError
        None of the jumps tried has a flight that is proved, and no flight afloat has no warnings.
    """
    options = options or InitOptions()
    options.check(chosen)
    say = progress or (lambda _: None)
    reasons = _no_jump(chosen)
    of_jump = [name for name in options.typed if name != "duration"]
    if reasons and of_jump:
        raise wrong(of_jump[0], f"it is about a jump. {reasons[0]}".removesuffix("."))
    tries = () if reasons else options.whole_turns(chosen)
    for turns in tries:
        count = abs(turns)
        words = {0: "jump without a turn", 1: "jump with a whole turn"}.get(count, f"jump with {count} whole turns")
        say(words)
        result = _jump(chosen, turns, options, seed, turns == tries[-1], partial(_say_after, words, say))
        if isinstance(result, FirstFlight):
            return replace(result, reasons=tuple(reasons))
        reasons.append(f"A {words} was not found: {result}")
    if (tries and options.typed) or not afloat:
        raise NoFlightError(f"no jump was found with {' '.join(options.typed.values())}. {' '.join(reasons)}")
    return _first_afloat(chosen, options, reasons, say)


def _first_afloat(
    chosen: ChosenRobot, options: InitOptions, reasons: list[str], say: Callable[[str], None]
) -> FirstFlight:
    """The first flight afloat without warnings, else the first whose links overlap."""
    smallest = math.radians(3)  # rotation that is worth a flight
    most_work = 5e7  # [instants of one body] about 1 s each 6e6
    work = 0.0
    farthest = 0.0
    overlapping: FirstFlight | None = None
    for problem in problems_afloat(chosen, options.duration):
        rotation = abs(problem.final.orientation - problem.initial.orientation)
        farthest = max(farthest, rotation)
        if rotation < smallest or work > most_work:
            continue
        say(f"turn of {math.degrees(rotation):.0f} degrees afloat")
        result, spent = planned_afloat(problem)
        work += spent
        if result is None:
            continue
        flight = FirstFlight(*result, tuple(reasons))
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
    """Why no jump can be searched for."""
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


def _say_after(prefix: str, say: Callable[[str], None], words: str) -> None:
    say(f"{prefix}: {words}")


def _jump(
    chosen: ChosenRobot, turns: int, options: InitOptions, seed: int, helps: bool, say: Callable[[str], None]
) -> FirstFlight | str:
    """A jump's flight that is planned again from its problem in round numbers; or why there is none, and what helps.

    Raises
    ------
    InputError
        The options are impossible.
    """
    try:
        problem = jump_problem(chosen, turns * int(chosen.robot.plane.turn), options)
        result = with_largest_pitch_error(jump(problem, seed=seed, starts=1, helps=helps, progress=say))
        result = _with_separated_links(result, seed, partial(_say_after, "links apart", say))
        if not result.ok or result.flight is None:
            return result.explanation
        say("proof of its flight")
        problem, flight = _planned_flight(flight_of_jump(result, result.flight), seed)
    except InputError as error:
        options.refuse_own(error)
        return options.reason(error, chosen)
    if not _is_proved(flight):
        return f"Its flight is not proved: {flight.explanation}"
    return FirstFlight(problem, flight, (), result)


def _planned_flight(problem: Problem, seed: int) -> tuple[Problem, Plan]:
    """Plan the flight of a jump from its problem in round numbers; above the ground where it has fewer warnings so."""
    flight = plan(problem, seed=seed, prove=True)
    warnings = warnings_in_plane(flight)
    # Only limits on distances separate links: the ground does not.
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


def _with_separated_links(first: Jump, seed: int, say: Callable[[str], None]) -> Jump:
    """A jump whose links do not overlap, if there is one near the first; else that one, with its warning."""
    result = first
    for _ in range(2):  # since then other links may overlap
        problem = separated(result.problem, result.planned_positions, result.duration) if result.ok else None
        if problem is None:
            return result
        try:
            other = jump(problem, seed=seed, starts=1, helps=False, near=result, progress=say)
        except InputError:  # they are as near where the robot stands
            return result
        if not other.ok:
            return result
        result = other
    return result
