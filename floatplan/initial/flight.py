"""A first flight of any robot: a flip that it can push off and land, else the largest turn, else one afloat."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import FloatplanError, InputError
from floatplan.initial.candidates import GRAVITY, Candidate, Flights
from floatplan.initial.limbs import upright
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.stance import FAST, Stance
from floatplan.motion.planar.momentum import momentum_mapping
from floatplan.planning.planned import planned
from floatplan.planning.repair import proved_plan
from floatplan.planning.search import SearchOptions
from floatplan.plans.plan import Plan
from floatplan.problem.limits import position_limits
from floatplan.problem.parts import Flight, Landing, Limits, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem

LONG, SHORT, LEAPING = (3.0, 3.8), (2.3, 3.0), (1.2, 2.4)  # [-] durations over sqrt(height / g)
WORK = 8e6  # [instants of one body] of a search for one flight's motion
LEAN = math.radians(35)  # [rad] of the base at both ends of a flip
LEANS_OF_LEAPS = tuple(math.radians(lean) for lean in (60, 30, 12, 4))  # [rad] the same of leaps, which turn by it
FLIPS = 4  # [-] motions tried of flips, and
LEAPS = 6  # [-] of leaps
CORRECTIONS = 2  # [-] with lower accelerations, where a locked joint cannot be held
CALMER = 0.8  # [-] of the acceleration that would just do
SWINGS = (1.0, 0.6, 0.3)  # [-] of half a joint's range, in free fall
WIDEST_SWING = math.radians(60)  # [rad]
UNHURRIED = 3.0  # [-] times the duration at the velocity limits
SLOWER = (1.0, 2.0, 4.0)  # [-] of that duration
SHORTEST = 1.0  # [s] of a turn in free fall
NODES = 40  # [-] of the turn that straight swings make
INSIDE = 0.05  # [-] of a joint's range, kept free at its ends


@dataclass(frozen=True, eq=False)
class FirstFlight:
    """A problem whose plan was found, proved and has no warnings.

    Attributes
    ----------
    problem : Problem
    plan : Plan
    reasons : why the flight turns no farther; empty where it is a full flip
    """

    problem: Problem
    plan: Plan
    reasons: tuple[str, ...]

    @property
    def turn(self) -> float:
        """Of the base, rad."""
        return self.problem.final.orientation - self.problem.initial.orientation


def first_flight(chosen: ChosenRobot, *, seed: int = 0, progress: Callable[[str], None] | None = None) -> FirstFlight:
    """Search for a flight that can begin and end: on a foot a full flip, else the largest turn; else in free fall.

    Parameters
    ----------
    chosen : ChosenRobot
    seed : int
        Of the postures tried.
    progress : callable, optional
        Told in a few words what is tried.

    Raises
    ------
    FloatplanError
        None of the flights tried has a plan that is proved and without warnings.
    InputError
        The robot's geometry is wrong, or it does not keep to its plane.
    """
    chosen.robot.check_shapes()
    reasons: list[str] = []
    least = math.inf
    for kind, flights, most in _families(chosen):
        tries = 0
        for family in flights:
            candidate = family.search(seed)
            if progress:
                progress(f"{kind} of {math.degrees(candidate.turn):.0f} degrees on {family.stance.frame}")
            if not candidate.begins_and_ends:
                least = min(least, float(candidate.ratios.max()) if not candidate.depth else math.inf)
                continue
            tries += 1
            answer = _planned(_problem(chosen, family, candidate))
            if answer is not None:
                return FirstFlight(*answer, () if kind == "flip" else tuple(reasons))
            if tries == most:
                break
        reasons.append(_why(kind, tries, least))
    if not chosen.feet:
        reasons.append("No feet were found that it could stand on.")
    elif len(chosen.robot.joints) == 1:
        reasons.append("For a flip one joint is too few: no rates of it and the base stop the foot.")
    for problem in _in_free_fall(chosen):
        answer = _planned(problem)
        if answer is not None:
            return FirstFlight(*answer, tuple(reasons))
    raise FloatplanError(f"{chosen.robot.source}: no flight was found that is proved and without warnings")


def _why(kind: str, tries: int, least: float) -> str:
    if tries:
        return f"Of {tries} {kind}s that could begin and end, no motion was found within the limits."
    if math.isfinite(least):
        return f"For a {kind} the joints would have to turn at {least:.2g} times a velocity limit to push off or land."
    return f"For a {kind} no posture was found from which to push off or land."


def _families(chosen: ChosenRobot) -> Iterator[tuple[str, Iterator[Flights], int]]:
    """What to try: flips backwards, then forwards, then leaps; each on all feet, long flights first."""
    robot = chosen.robot
    if not chosen.feet or len(robot.joints) == 1:
        return
    stances = {foot: (Stance(robot, foot), upright(robot, foot)) for foot in chosen.feet}
    backwards = int(robot.plane.turn)

    def flights(turns: int, lean: float, band: tuple[float, float], foot: str) -> Flights:
        stance, up = stances[foot]
        unit = math.sqrt(max(stance.height(up, robot.resting), 1e-3) / GRAVITY)
        return Flights(robot, stance, up, turns, (band[0] * unit, band[1] * unit), lean)

    flips = product((backwards, -backwards), (LEAN,), (LONG, SHORT), chosen.feet)
    yield "flip", (flights(*choice) for choice in flips), FLIPS
    leaps = product((0,), LEANS_OF_LEAPS, (LEAPING,), chosen.feet)
    yield "leap", (flights(*choice) for choice in leaps), LEAPS


def _problem(chosen: ChosenRobot, flights: Flights, candidate: Candidate) -> Problem:
    begin, end = candidate.orientations.tolist()
    start = Posture(begin, candidate.positions[0], "takeoff", "free")
    goal = Posture(end, candidate.positions[1], "landing", "free")
    frame = flights.stance.frame
    return Problem(
        chosen.robot,
        start,
        goal,
        Flight(
            candidate.duration,
            angular_momentum=candidate.angular_momentum if flights.turns else "free",
            takeoff=Takeoff(frame),
            landing=Landing(frame),
            horizontal_velocity=candidate.horizontal_velocity,
        ),
        Motion(degree="auto", objective="acceleration"),
        _limits(chosen),
        name=chosen.robot.name,
        ground=True,
    )


def _limits(chosen: ChosenRobot) -> Limits:
    """The URDF's; where it gives no velocities, what is fast."""
    robot = chosen.robot
    known = np.isfinite(robot.motor_velocity_limits).any()
    return Limits(
        velocity="urdf" if known else FAST, torque="urdf" if np.isfinite(robot.motor_torque_limits).any() else "none"
    )


def _planned(problem: Problem) -> tuple[Problem, Plan] | None:
    """A proved plan without warnings; where only a locked joint cannot be held, one that moves more calmly.

    A short search tells whether the whole one, which the file will have, is worth while.
    """
    for _ in range(1 + CORRECTIONS):
        try:
            if not planned(problem, SearchOptions(work=WORK)).plan.ok:
                return None
            plan = proved_plan(planned(problem, SearchOptions()))
        except InputError:
            return None
        if not plan.ok or plan.certificate is None or not plan.certificate.proved:
            return None
        if not plan.warnings:
            return problem, plan
        shares = [w.limit / w.value for w in plan.warnings if w.kind == "holding_torque" and w.value and w.limit]
        if len(shares) < len(plan.warnings):
            return None
        acceleration = CALMER * min(shares) * float(plan.peaks.joints["acceleration"].max())
        rounded = math.radians(float(f"{math.degrees(acceleration):.2g}"))
        problem = replace(problem, limits=replace(problem.limits, acceleration=rounded))
    return None


def _in_free_fall(chosen: ChosenRobot) -> Iterator[Problem]:
    """Turns of the base by the joints alone, without gravity and angular momentum: smaller and slower ones later."""
    robot = chosen.robot
    limits = _limits(chosen)
    low, high = position_limits(robot, limits).T
    width = high - low
    start = np.clip(robot.resting, low + INSIDE * width, high - INSIDE * width)
    start = np.deg2rad(np.round(np.rad2deg(start)))
    upwards = np.where(high - start >= start - low, 1.0, -1.0)
    room = np.minimum(np.where(upwards > 0, high - start, start - low) / 2, WIDEST_SWING)
    rates = np.minimum(robot.velocity_limits, FAST)
    for swing, slower in product(SWINGS, SLOWER):
        goal = np.deg2rad(np.round(np.rad2deg(start + swing * upwards * room)))
        duration = round(max(UNHURRIED * float((np.abs(goal - start) / rates).max()), SHORTEST) * slower, 1)
        turn = _turn(chosen, start, goal)
        if len(robot.joints) > 1:
            turn = math.radians(round(math.degrees(turn)))
        yield Problem(
            robot,
            Posture(0.0, start),
            Posture(turn, goal),
            Flight(duration, angular_momentum=0.0, gravity=0.0),
            Motion(degree="auto", objective="acceleration"),
            limits,
            name=robot.name,
        )


def _turn(chosen: ChosenRobot, start: Array, goal: Array) -> float:
    """What straight swings from one posture to another make of the orientation, rad, without angular momentum."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    shares = (nodes + 1) / 2
    rows = momentum_mapping(chosen.robot.tree)(start + shares[:, None] * (goal - start)).rows
    return -float(weights @ (rows[:, 1:] @ (goal - start) / rows[:, 0])) / 2
