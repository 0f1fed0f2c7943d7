"""A first flight of any robot: of a jump from standing to standing where one is found, else one afloat."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from floatplan.errors import InputError
from floatplan.initial.problems import flight_of_jump, jump_problem, turns_afloat
from floatplan.initial.robots import ChosenRobot
from floatplan.planning.planned import planned
from floatplan.planning.planner import plan
from floatplan.planning.repair import proved_plan
from floatplan.planning.search import SearchOptions
from floatplan.plans.plan import Plan
from floatplan.problem.problem import Problem
from floatplan.stance.jump import Jump
from floatplan.stance.model import casadi
from floatplan.stance.planner import jump

AFLOAT_WORK = 5e7  # [instants of one body] with flights afloat, about 1 s each 6e6
PATIENCE = 8e6  # [instants of one body] with one of them, until a motion is found
SMALLEST_TURN = math.radians(3)  # [rad] that is worth a flight
CORRECTIONS = 2  # [-] with lower accelerations, where a locked joint cannot be held
CALMER = 0.8  # [-] of the acceleration that would just do


@dataclass(frozen=True, eq=False)
class FirstFlight:
    """A problem whose plan was found, proved and has no warnings.

    Attributes
    ----------
    problem : Problem
    plan : Plan
    reasons : why it is no more than it is; empty where it is of a jump with a whole turn
    jump : the jump around it; None where it is afloat
    """

    problem: Problem
    plan: Plan
    reasons: tuple[str, ...]
    jump: Jump | None = None

    @property
    def turn(self) -> float:
        """Of the base, rad; of a jump in whole turns."""
        asked = self.problem if self.jump is None else self.jump.problem
        return asked.final.orientation - asked.initial.orientation


def first_flight(chosen: ChosenRobot, *, seed: int = 0, progress: Callable[[str], None] | None = None) -> FirstFlight:
    """Search for the flight of a jump, with a whole turn, else without; where none is found, for one in free fall.

    Parameters
    ----------
    chosen : ChosenRobot
    seed : int
        Of the search's random numbers.
    progress : callable, optional
        Told in a few words what is tried.

    Raises
    ------
    InputError
        The robot's geometry is wrong, it does not keep to its plane, or none of the flights tried has a plan that is
        proved and without warnings.
    """
    chosen.robot.check_shapes()
    say = progress or (lambda _: None)
    reasons = _no_jump(chosen)
    for turns in () if reasons else (int(chosen.robot.plane.turn), 0):
        what = "with a whole turn" if turns else "without a turn"
        say(f"jump {what}")
        answer = _jump(chosen, turns, seed)
        if isinstance(answer, FirstFlight):
            return replace(answer, reasons=tuple(reasons))
        reasons.append(f"A jump {what} was not found: {answer}")
    work = farthest = 0.0
    for problem in turns_afloat(chosen):
        turn = abs(problem.final.orientation - problem.initial.orientation)
        farthest = max(farthest, turn)
        if turn < SMALLEST_TURN or work > AFLOAT_WORK:
            continue
        say(f"turn of {math.degrees(turn):.0f} degrees afloat")
        found, took = _afloat(problem)
        work += took
        if found is not None:
            return replace(found, reasons=tuple(reasons))
    reasons.append(f"Afloat, its joints would turn the base by at most {math.degrees(farthest):.2g} degrees.")
    raise InputError(
        f"no flight was found that is proved and without warnings. {' '.join(reasons)}".removesuffix("."),
        source=chosen.robot.source,
        advice="write the problem yourself, with joints that move more of the robot; floatplan info lists them",
    )


def _no_jump(chosen: ChosenRobot) -> list[str]:
    """Why no jump can be looked for."""
    if not chosen.feet:
        return ["No feet were found that it could stand on."]
    try:
        casadi()
    except InputError as error:
        return [f"No jump was looked for: {error.reason}; {error.advice}."]
    return []


def _jump(chosen: ChosenRobot, turns: int, seed: int) -> FirstFlight | str:
    """A jump's flight that is planned again from its problem in round numbers; or why there is none."""
    try:
        found = jump(jump_problem(chosen, turns), seed=seed, starts=1)
        if not found.ok or found.flight is None:
            return found.explanation
        problem = flight_of_jump(found, found.flight)
        flight = plan(problem, seed=seed, prove=True)
    except InputError as error:
        return f"{error}."
    if not flight.ok or flight.certificate is None or not flight.certificate.proved:
        return f"Its flight is not proved: {flight.explanation}"
    if flight.warnings:
        return flight.warnings[0].message
    return FirstFlight(problem, flight, (), found)


def _afloat(problem: Problem) -> tuple[FirstFlight | None, float]:
    """A proved plan without warnings, and what it took, instants of one body.

    It is the plan that ``floatplan plan`` finds, given up where that takes long. Where only a locked joint cannot be
    held, it is one that moves more calmly.
    """
    work = 0.0
    for _ in range(1 + CORRECTIONS):
        try:
            found = planned(problem, SearchOptions(patience=PATIENCE))
        except InputError:
            break
        work += found.work
        proved = proved_plan(found)
        if found.gave_up or not proved.ok or proved.certificate is None or not proved.certificate.proved:
            break
        if not proved.warnings:
            return FirstFlight(problem, proved, ()), work
        calmer = _calmer(problem, proved)
        if calmer is None:
            break
        problem = calmer
    return None, work


def _calmer(problem: Problem, plan: Plan) -> Problem | None:
    """The problem with accelerations low enough for locked joints to hold; None where other warnings remain."""
    shares = [w.limit / w.value for w in plan.warnings if w.kind == "holding_torque" and w.value and w.limit]
    if len(shares) < len(plan.warnings):
        return None
    acceleration = CALMER * min(shares) * float(plan.peaks.joints["acceleration"].max())
    rounded = math.radians(float(f"{math.degrees(acceleration):.2g}"))
    return replace(problem, limits=replace(problem.limits, acceleration=rounded))
