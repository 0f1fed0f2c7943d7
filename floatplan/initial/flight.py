"""A first flight of any robot: of a jump from standing to standing where one is found, else one afloat."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.initial.robots import ChosenRobot, standing_height, upright
from floatplan.motion.flight import tree_dynamics
from floatplan.planning.planned import planned
from floatplan.planning.planner import plan
from floatplan.planning.repair import proved_plan
from floatplan.planning.search import SearchOptions
from floatplan.plans.plan import Plan
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Flight, JointState, Landing, Limits, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import position_limits
from floatplan.stance.jump import Jump
from floatplan.stance.model import casadi
from floatplan.stance.motion import Stance
from floatplan.stance.planner import jump

GRAVITY = 9.81  # [m/s^2]
FAST = math.radians(2000)  # [rad/s] that no joint of a legged robot turns at, whatever its URDF says
LONG, SHORT = 2.57, 1.2  # [-] durations of flights over sqrt(height / g), with a turn and without
DIGITS = 6  # [-] of numbers of a jump in the problem file
PLACES = 6  # [-] of heights there, m: micrometres
MOTION = Motion(degree="auto", objective="acceleration")
SWINGS = (1.0, 0.6, 0.3)  # [-] of half a joint's range
WIDEST_SWING = math.radians(60)  # [rad]
UNHURRIED = 3.0  # [-] times the duration at the velocity limits
SLOWER = (1.0, 2.0, 4.0)  # [-] of that duration
SHORTEST = 1.0  # [s]
NODES = 40  # [-] of the turn that straight swings make
DIRECTIONS = 512  # [-] of the joints, compared
INSIDE = 0.05  # [-] of a joint's range, kept free at its ends
AFLOAT_WORK = 5e7  # [instants of one body] with flights afloat, about 1 s each 6e6
PATIENCE = 8e6  # [instants of one body] with one of them, until a motion is found
SMALLEST_TURN = math.radians(3)  # [rad] that is worth a flight
CORRECTIONS = 2  # [-] with lower accelerations, where a locked joint cannot be held
CALMER = 0.8  # [-] of the acceleration that would just do


def jump_problem(chosen: ChosenRobot, turns: int) -> Problem:
    """Return the problem of a jump from standing to standing, with whole turns of the base, of which 0 are a hop.

    It begins on the feet on the side to which it turns; its flight, from rest to rest, is but a guess.
    """
    robot = chosen.robot
    foot = chosen.feet[0 if turns * robot.plane.turn >= 0 else -1]
    angle, unit = upright(robot, foot), math.sqrt(standing_height(robot, foot) / GRAVITY)
    return Problem(
        robot,
        Posture(angle, robot.resting),
        Posture(angle + turns * math.tau, robot.resting),
        Flight(LONG * unit if turns else SHORT * unit, angular_momentum="free", takeoff=Takeoff(foot)),
        Motion(objective="torque"),
        limits_of(chosen),
        name=robot.name,
        jump=JumpRequest(),
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
        duration=_round(free.duration),
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


def limits_of(chosen: ChosenRobot) -> Limits:
    """Return the URDF's limits; where it gives no velocities, what is fast."""
    robot = chosen.robot
    known = np.isfinite(robot.motor_velocity_limits).any()
    return Limits(
        velocity="urdf" if known else FAST, torque="urdf" if np.isfinite(robot.motor_torque_limits).any() else "none"
    )


def turns_afloat(chosen: ChosenRobot) -> Iterator[Problem]:
    """Yield problems without gravity and angular momentum, from rest to rest: smaller and slower ones later.

    Of the directions in which the joints may swing they take those that turn the base farthest.
    """
    robot = chosen.robot
    limits = limits_of(chosen)
    low, high = position_limits(robot, limits).T
    width = high - low
    start = np.clip(robot.resting, low + INSIDE * width, high - INSIDE * width)
    start = np.deg2rad(np.round(np.rad2deg(start)))
    rates = np.minimum(robot.velocity_limits, FAST)
    directions = _directions(len(robot.joints))
    room = np.minimum(np.where(directions > 0, high - start, start - low) / 2, WIDEST_SWING)
    turns = _turns(chosen, start, start + directions * room)
    best = int(np.abs(turns).argmax())
    for swing, slower in product(SWINGS, SLOWER):
        goal = np.deg2rad(np.round(np.rad2deg(start + swing * (directions * room)[best])))
        duration = round(max(UNHURRIED * float((np.abs(goal - start) / rates).max()), SHORTEST) * slower, 1)
        turn = float(_turns(chosen, start, goal[None])[0])
        if len(robot.joints) > 1:
            turn = math.radians(round(math.degrees(turn)))
        yield Problem(
            robot,
            Posture(0.0, start),
            Posture(turn, goal),
            Flight(duration, angular_momentum=0.0, gravity=0.0),
            MOTION,
            limits,
            name=robot.name,
        )


def _directions(joints: int) -> Array:
    """Signs (K, n), the first all positive: every one of a few joints, seeded ones of many."""
    if 2**joints <= DIRECTIONS:
        return np.array(list(product((1.0, -1.0), repeat=joints)))
    drawn = np.random.default_rng(0).choice((1.0, -1.0), (DIRECTIONS - 1, joints))
    return np.concatenate((np.ones((1, joints)), drawn))


def _turns(chosen: ChosenRobot, start: Array, goals: Array) -> Array:
    """What straight swings from a posture (n,) to others (K, n) make of the orientation (K,), rad."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    shares = (nodes + 1) / 2
    ways = goals - start
    positions = start + shares[:, None, None] * ways
    rows = tree_dynamics(chosen.robot.tree).momentum_map(positions.reshape(-1, len(start)))
    rows = rows.reshape(NODES, len(goals), -1)
    rates = (rows[:, :, 1:] * ways).sum(axis=2) / rows[:, :, 0]
    return np.asarray(-(weights @ rates) / 2)


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
        found = jump(jump_problem(chosen, turns), seed=seed, starts=1, helps=False)
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
