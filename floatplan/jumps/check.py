"""Whether a jump, in a plane or in space, holds between its nodes: its motion at 2 kHz.

Forces, torques and the motion of feet are Pinocchio's; distances from the ground, from obstacles and between links are
of the jump's geometry, of the shapes that its program uses too.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.contacts import is_ground
from floatplan.jumps.jump_motion import JumpMotion, TimedFlight
from floatplan.jumps.motion import AnyStance, JumpState
from floatplan.jumps.phases import begin_state
from floatplan.motion.dynamics import FlightState
from floatplan.plans.planned_motion import least_distances
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem
from floatplan.robot import Robot
from floatplan.tables import POINT_FEET

RATE = 2000.0  # [1/s]
SEAM = 1e-6  # [m, rad; rates and accelerations times sqrt(1 m / g) and 1 m / g] of steps of the motion
LIGHT = 0.02  # [-] of the weight: the ratio of forces that are less says nothing
TOUCHDOWN = 0.06  # [s] from landing on, after which one that is not as planned has become a stance

Value: TypeAlias = tuple[str, float]  # of a figure, somewhere and at some time
Words: TypeAlias = tuple[str, str]  # a figure in words, and its limit


class Figure(NamedTuple):
    """A figure's sentence, what it is, with its unit, its limit in that, and whether it is worst where it is least."""

    sentence: str
    meaning: str
    limit: float | Callable[[JumpRequest], float]
    least: bool = False
    unlimited: str = ""  # the sentence of a share where there is no limit to share; empty for none

    def limit_of(self, request: JumpRequest) -> float:
        """The limit of a jump."""
        return self.limit(request) if callable(self.limit) else self.limit


SHARES = ("torque", "torque_speed", "velocity", "held_torque")  # figures that are shares of limits
FIGURES = {
    "residual": Figure(
        "forces are out of balance by {:z.2g} of the weight",
        "balance of forces and moments, over weight (and height)",
        1e-3,
    ),
    "torque": Figure(
        "torques take {:z.0%} of their limits",
        "share of the limits of torques",
        lambda request: request.margin["torque"],
        unlimited="torques have no limit",
    ),
    "torque_speed": Figure(
        "torques and rates take {:z.0%} of the motors' curves",
        "share of the motors' torque-speed curves",
        lambda request: request.margin["torque"],
    ),
    "held_torque": Figure(
        "joints that are held take {:z.0%} of their efforts", "share of the efforts of joints that are locked", 1.0
    ),
    "velocity": Figure(
        "rates take {:z.0%} of their limits",
        "share of the limits of rates",
        lambda request: request.margin["velocity"],
        unlimited="rates have no limit",
    ),
    "friction": Figure(
        "friction is {:z.2f}", "largest ratio of horizontal to vertical force", lambda request: request.friction
    ),
    "slip": Figure(
        "horizontal forces leave the cone by {:z.2g} of the weight",
        "horizontal force beyond the cone, over weight",
        1e-3,
    ),
    "drift": Figure(
        "feet that stand drift by {:z.2g} m",
        "way of feet that stand, m; where they roll, of centres beyond what was rolled",
        1e-3,
    ),
    "foot_speed": Figure(
        "feet that stand move at {:z.2g} m/s",
        "speed of feet that stand, m/s; where they roll, of points on the ground",
        0.005,
    ),
    "derivative": Figure(
        "rates and differences of places differ by {:z.2g}", "disagreement of positions, rates and accelerations", 1e-3
    ),
    "takeoff_seam": Figure(
        "the takeoff's seam is {:z.2g}",
        "step of the motion there: m, rad; of rates times sqrt(1 m / g), of accelerations times 1 m / g",
        SEAM,
    ),
    "landing_seam": Figure(
        "the landing's seam is {:z.2g}",
        "step of the motion there, as of takeoff_seam; of an impact, of places only",
        SEAM,
    ),
    "impact": Figure(
        "feet come to the ground with {:z.2g} m/s",
        "greatest speed of feet that land first, m/s",
        lambda request: request.landing.impact,
    ),
    "impulse": Figure(
        "at the impact rates change by {:z.2g} that no impulses make",
        "change of rates at the impact that no impulses inside the friction cones make, m/s and rad/s",
        1e-3,
    ),
    "junction": Figure(
        "where feet come or leave, the motion steps by {:z.2g}",
        "step of the motion where feet come or leave, as of takeoff_seam",
        SEAM,
    ),
    "gap": Figure("from the end of a phase to the next one are at most {:z.2g} s", "time between phases, s", SEAM),
    "rest": Figure(
        "at its ends it moves by {:z.2g}",
        "rates and accelerations at the ends at which it stands still, times sqrt(1 m / g) and 1 m / g",
        SEAM,
    ),
    "begin": Figure(
        "it begins {:z.2g} off the requested state",
        "difference of the state in which it begins from the requested one: rad, of rates times sqrt(1 m / g)",
        SEAM,
    ),
    "periodic": Figure(
        "from one period to the next the motion steps by {:z.2g}",
        "step of the motion from one period to the next, as of takeoff_seam",
        SEAM,
    ),
    "level": Figure("what stands is on grounds {:z.2g} m apart", "by which what stands differs in height, m", SEAM),
    "torque_step": Figure(
        "torques change by {:z.0%} of their limits within 4 ms where contacts do",
        "by which torques change within 4 ms where contacts do, over limits",
        np.inf,
    ),
    "lifted": Figure(
        "feet that stand are up to {:z.2g} m above the ground",
        "largest height of the shapes of feet that stand, m",
        0.01,
    ),
    "circle": Figure(
        "outlines of feet that roll are circles to {:z.2g} m",
        "distance from the ground of the shapes of feet that roll, m",
        POINT_FEET,
    ),
    "range": Figure(
        "joints keep {:z.2g} rad from the ends of their ranges",
        "least distance from the ends of joint ranges, rad",
        0.0,
        least=True,
    ),
    "pull": Figure(
        "the least vertical force is {:z.2g} of the weight", "least vertical force, over weight", -1e-3, least=True
    ),
    "ground": Figure(
        "everything else is at least {:z.2g} m above the ground", "least height of all but feet, m", -1e-6, least=True
    ),
    "touchdown": Figure(
        "where it lands turned by the pitch error, everything else is at least {:z.2g} m above the ground",
        "the same of a robot that is rotated by the pitch error about its feet, from its landing on for 60 ms",
        -1e-6,
        least=True,
    ),
    "feet": Figure(
        "the feet's shapes are at least {:z.2g} m above the ground",
        "least height of the feet's shapes, m",
        -POINT_FEET,
        least=True,
    ),
    "obstacles": Figure(
        "obstacles are {:z.2g} m away beyond their margins", "least distance beyond the margins, m", 0.0, least=True
    ),
    "self_distance": Figure(
        "links are {:z.2g} m apart beyond their margins",
        "least distance of links beyond the margins, m",
        0.0,
        least=True,
    ),
}


@dataclass(frozen=True, eq=False)
class JumpCheck:
    """Figures of a jump's stances, and whether all of them hold.

    Attributes
    ----------
    ok : bool
    figures : name -> value, the worst of all stances; of distances, of the flight too
        What each is, :attr:`meanings` says.
    sentences : for a person, what does not hold first
    unlimited : names of figures that are shares of limits which nothing has; their values are 0
    """

    ok: bool
    figures: Mapping[str, float]
    sentences: tuple[str, ...]
    unlimited: frozenset[str] = frozenset()

    @property
    def meanings(self) -> dict[str, str]:
        """What each of the figures is, with its unit; shares and ratios have none."""
        return {name: FIGURES[name].meaning for name in self.figures}


def check_jump(jump: JumpMotion) -> JumpCheck:
    """Check the stances of a jump, in a plane or in space, at 2 kHz, at instants of its own.

    Forces, torques and the motion of feet are by Pinocchio, independently of the program that the jump comes from;
    distances are by the shapes of its robot, as in the program.
    """
    with np.errstate(all="ignore"):  # what files may hold overflows: such figures are infinite, and do not hold
        return _checked(jump)


def _checked(jump: JumpMotion) -> JumpCheck:
    assert jump.flight is not None
    flights: list[Value] = []
    for flight in jump.timed_flights:
        times = flight.begin + np.linspace(0.0, flight.plan.duration, int(flight.plan.duration * RATE) + 2)
        flights += _surroundings(jump, jump.state_of(flight.state(times)), jump.ground, ())
    error = jump.request.pitch_error
    touchdown = [("touchdown", height) for height in _touchdown(jump, error)] if error else []
    figures = worst_values([*_stances(jump), *touchdown, *flights, *_seams(jump), ("level", _unevenness(jump))])
    unlimited = unlimited_figures(jump.problem)
    failing, holding = sentences_on(jump.request, figures, unlimited)
    broken = [", ".join(words) for words in failing]
    if not all(plan.ok for plan in jump.flights):
        broken.append("the flight's plan does not hold")
    sentences = (*broken, *(", ".join(words) for words in holding))
    return JumpCheck(not broken, figures, sentences, unlimited)


def _unevenness(jump: JumpMotion) -> float:
    """By how much what stands differs in height, m, but for the step of the ground."""
    rise = jump.request.rise
    grounds = []
    for index, stance in enumerate(jump.stances):
        has_landed = index >= len(jump.before)
        grounds.append(stance.ground - (rise if has_landed else 0.0))
    return float(np.ptp(grounds))


def worst_values(values: Iterable[Value]) -> dict[str, float]:
    """The worst value of each figure."""
    figures: dict[str, float] = {}
    for name, value in values:
        least = FIGURES[name].least
        if np.isnan(value):  # of numbers beyond all sense, as files may hold: nothing holds of them
            value = -np.inf if least else np.inf
        figures[name] = (min if least else max)(figures.get(name, float(value)), float(value))
    return figures


def stance_figures(jump: JumpMotion) -> dict[str, float]:
    """Figures of :class:`JumpCheck`, but for those of seams."""
    return worst_values(_stances(jump))


def _stances(jump: JumpMotion) -> Iterator[Value]:
    """Figures of all stances, at even instants and at those between which the motion is smooth."""
    for stance in jump.stances:
        begin, end = stance.span
        times = np.linspace(begin, end, max(int(np.ceil((end - begin) * RATE)), 8) + 1)
        kinks = stance.grid.times  # there third derivatives may step
        nearest = kinks[np.searchsorted((kinks[1:] + kinks[:-1]) / 2, times)]
        even = times[np.abs(times - nearest) > 1e-5]  # s: instants that are nearer are one
        full = stance.at(np.sort(np.concatenate((even, kinks))))
        state = jump.state_of(full)
        yield from _dynamics(jump, stance, full, state)
        yield from _forces(jump, stance, full)
        ground = stance.ground if jump.step is None else jump.ground
        yield from _surroundings(jump, state, ground, stance.contacts)


def _dynamics(jump: JumpMotion, stance: AnyStance, full: JumpState, state: FlightState) -> Iterator[Value]:
    """Balance of forces, shares of limits, joint ranges, motion of feet, and whether derivatives belong to positions.

    ``state`` is the same as ``full`` in the quantities of a plan.
    """
    robot = stance.robot
    problem = jump.problem
    weight = robot.mass * stance.gravity
    height = float(state.com_position[0, -1]) - stance.ground
    lever = height if height > 0 else float(np.finfo(float).tiny)  # what is not above the ground does not stand on it
    torques, feet = stance.inverse_dynamics(full)
    base = torques.shape[1] - len(robot.model_joints)  # of its coordinates the first ones are positions, then angles
    directions = state.com_position.shape[1]
    yield "residual", np.abs(torques[:, :directions]).max() / weight
    yield "residual", np.abs(torques[:, directions:base]).max() / (weight * lever)
    yield "residual", np.abs(torques - full.torques)[:, base:].max() / (weight * lever)
    for name, shares in limit_shares(problem, replace(full, torques=torques)).items():
        yield name, shares.max(initial=0.0)
    low, high = np.asarray(problem.position_limits).T
    yield "range", np.minimum(state.positions - low, high - state.positions).min()
    for positions, speeds in feet.values():
        yield "drift", np.ptp(positions, axis=0).max()
        yield "foot_speed", speeds.max()
    for derivative, differences in (
        (full.velocities, _steps(robot, full.positions[:-1], full.positions[1:])),
        (full.accelerations, np.diff(full.velocities, axis=0)),
    ):
        mean = (derivative[1:] + derivative[:-1]) / 2
        difference = differences / np.diff(full.times)[:, None]
        yield "derivative", np.abs(mean - difference).max() / (np.abs(derivative).max() + 1e-9)


def _steps(robot: Robot, first: Array, second: Array) -> Array:
    """Steps (N, nv) from configurations (N, nq) to others; a base in space is moved and turned in its own axes."""
    return np.array([pin.difference(robot.model, *pair) for pair in zip(first, second, strict=True)])


def limit_shares(problem: Problem, state: JumpState) -> dict[str, Array]:
    """Shares of limits at N instants, by ``SHARES``.

    (N, motors + n) of torques, of motors and then the generalised ones, each of a leader with its followers;
    (N, motors) of torque-speed curves, (N, n) of rates, (N, locked) of the efforts of locked joints. The columns are in
    the order of :func:`limited_names`.
    """
    robot = problem.robot
    model = robot.model
    locked = [model.joints[model.getJointId(name)].idx_v for name in robot.locked]
    efforts = [robot.joint_tree.joint[name].effort for name in robot.locked]
    torques = np.abs(state.torques @ robot.transmission)
    generalised = np.abs(state.torques @ robot.selection)
    rates = state.velocities @ np.linalg.pinv(robot.selection).T
    slowed = problem.motor_slope * np.abs(rates @ robot.motor_ratios.T)
    return {
        "torque": np.hstack((torques / problem.motor_torque_limits, generalised / problem.torque_limits)),
        "torque_speed": (torques + slowed) / problem.motor_stall,
        "velocity": np.abs(rates) / problem.velocity_limits,
        "held_torque": np.abs(state.torques[:, locked]) / efforts,
    }


def limited_names(robot: Robot, name: str) -> tuple[str, ...]:
    """Motors and joints of the columns of :func:`limit_shares` of a name."""
    columns = {
        "torque": (*robot.motors, *robot.joints),
        "torque_speed": robot.motors,
        "velocity": robot.joints,
        "held_torque": robot.locked,
    }
    return tuple(columns[name])


def unlimited_figures(problem: Problem) -> frozenset[str]:
    """Figures that are shares of limits which nothing has."""
    robot = problem.robot
    limits = {
        "torque": np.concatenate((problem.motor_torque_limits, problem.torque_limits)),
        "torque_speed": problem.motor_stall,
        "velocity": problem.velocity_limits,
        "held_torque": np.array([robot.joint_tree.joint[name].effort for name in robot.locked]),
        "torque_step": problem.motor_torque_limits,
    }
    return frozenset(name for name, values in limits.items() if not np.isfinite(values).any())


def _forces(jump: JumpMotion, stance: AnyStance, state: JumpState) -> Iterator[Value]:
    """Friction cone and pressure of what is on the ground."""
    weight = stance.robot.mass * stance.gravity
    for force in state.forces.values():
        horizontal = np.linalg.norm(force[:, :-1], axis=1)
        vertical = force[:, -1]
        pressed = vertical > LIGHT * weight
        yield "friction", (horizontal[pressed] / vertical[pressed]).max(initial=0.0)
        yield "slip", (horizontal - jump.request.friction * np.maximum(vertical, 0)).max() / weight
        yield "pull", vertical.min() / weight


def _surroundings(jump: JumpMotion, state: FlightState, ground: float, standing: Sequence[Any]) -> Iterator[Value]:
    """Heights over the ground, m, by the links' shapes; least distances from obstacles, and between links.

    ``standing`` are the contacts that stand, none where nothing does.
    """
    geometry = jump.geometry
    feet = geometry.links_of(jump.contacts)
    stands = geometry.links_of(standing)
    rolls = geometry.links_of([contact for contact in standing if contact.radius])
    located = geometry.locate(state)
    yield "ground", np.inf
    yield "feet", np.inf
    yield "lifted", 0.0
    for link, lowest in geometry.lowest(located):
        heights = lowest - ground
        yield "feet" if link in feet else "ground", heights.min()
        if link in stands:
            yield "lifted", heights.max()
        if link in rolls:
            yield "circle", np.abs(heights).max()
    segments = geometry.segments(located)
    for pair in jump.problem.self_clearances:
        yield "self_distance", geometry.distances(segments, pair.links).min() - pair.margin
    for obstacle in jump.obstacles:
        if is_ground(obstacle, ground):
            continue
        least = least_distances(segments, obstacle, state.times - jump.takeoff_time).min() - obstacle.margin
        if np.isfinite(least):
            yield "obstacles", least


def touchdown_height(jump: JumpMotion, error: float) -> float:
    """Least height over the ground of all but feet, m, of a robot that lands rotated by an error, rad, about its feet.

    It is infinite of a robot that is all feet.
    """
    return min(_touchdown(jump, error), default=np.inf)


def _touchdown(jump: JumpMotion, error: float) -> Iterator[float]:
    """Least heights over the ground of all but feet, m, of a robot that lands rotated by an error, rad, about its feet.

    The robot is rotated as a rigid body, until one of its feet is on the ground: the one that is the lowest then,
    whether it stands at that time or is still to come. In a plane it is rotated either way, in space about both
    horizontal axes.
    """
    landing = -np.inf
    for previous, stance in itertools.pairwise(jump.pieces):
        if isinstance(previous, TimedFlight):
            landing = stance.span[0]
        if not isinstance(stance, TimedFlight):
            begin = stance.span[0]
            end = min(stance.span[1], landing + TOUCHDOWN)
            if begin < end:
                times = np.linspace(begin, end, int((end - begin) * RATE) + 2)
                yield from jump.geometry.rotated_heights(jump.state_of(stance.at(times)), error)


def _seams(jump: JumpMotion) -> Iterator[Value]:
    """Steps of positions, rates and accelerations at the flight's ends and between stances; what moves at both ends.

    Where feet may land with speed, only places go on; rates change by impulses, and accelerations are others.
    """
    limits = jump.problem.motor_torque_limits
    unit = float(np.sqrt(1.0 / jump.problem.flight.gravity))  # [s] of a fall by 1 m, but for a factor
    seams: list[tuple[str, Any, int, JumpState]] = []
    yield "gap", abs(jump.before[0].span[0])
    for one, two in itertools.pairwise(jump.pieces):
        if isinstance(two, TimedFlight):
            seams.append(("takeoff_seam", one, 1, two.state(np.array([two.begin]))))
        elif isinstance(one, TimedFlight):
            seams.append(("landing_seam", two, 0, one.state(np.array([one.end]))))
            yield "gap", abs(one.end - two.span[0])
        else:
            seams.append(("junction", one, 1, two.at(np.array(two.span[:1]))))
            yield "gap", abs(one.span[1] - two.span[0])
    around = np.array([-2e-3, 2e-3])  # s: two steps of a controller at 500 Hz
    for name, stance, end, other in seams:
        own = stance.at(np.array([stance.span[end]]))
        if name == "landing_seam" and jump.request.landing.impact:
            yield name, np.abs(_steps(jump.robot, own.positions, other.positions)).max()
            speed, unbalanced = stance.impact(other, own, jump.request.friction)
            yield "impact", speed
            yield "impulse", unbalanced
        else:
            yield name, _step(jump.robot, own, other, unit)
        times = np.clip(stance.span[end] + around, 0.0, jump.duration)
        change = np.diff(jump.at(times).torques @ jump.robot.transmission, axis=0) / limits
        yield "torque_step", np.abs(change).max()
    first, last = jump.stances[0], jump.stances[-1]
    begin = first.at(np.array([first.span[0]]))
    end_state = last.at(np.array([last.span[1]]))
    if jump.request.is_periodic:
        yield "periodic", _step(jump.robot, further_on(jump, begin), end_state, unit)
        return
    still_ends = [end_state]
    if jump.request.takeoff.in_motion:
        requested = begin_state(jump.robot, jump.request.takeoff)
        off = np.abs(begin.planned(jump.robot)[:2, :, 0] - requested) * [[1.0], [unit]]
        yield "begin", off.max()
    else:
        still_ends.append(begin)
    for state in still_ends:
        yield "rest", max(np.abs(state.velocities).max() * unit, np.abs(state.accelerations).max() * unit**2)


def further_on(jump: JumpMotion, begin: JumpState) -> JumpState:
    """The state in which a periodic jump begins, as far on and with as many whole turns more as it ends."""
    ends = jump.at([0.0, jump.duration]).positions
    positions = begin.positions.copy()
    positions[:, 0] += ends[1, 0] - ends[0, 0]
    positions[:, 2] += 2 * np.pi * np.round((ends[1, 2] - ends[0, 2]) / (2 * np.pi))
    return replace(begin, positions=positions)


def _step(robot: Robot, one: JumpState, other: JumpState, unit: float) -> float:
    """Largest step of positions, rates and accelerations; of these times ``unit``, s, and its square."""
    positions = np.abs(_steps(robot, one.positions, other.positions)).max()
    rates = np.abs(one.velocities - other.velocities).max() * unit
    accelerations = np.abs(one.accelerations - other.accelerations).max() * unit**2
    return float(max(positions, rates, accelerations))


def sentences_on(
    request: JumpRequest, figures: Mapping[str, float], unlimited: Collection[str] = ()
) -> tuple[list[Words], list[Words]]:
    """Sentences on figures, each with its limit: those that do not hold, and those that do.

    A figure that is ``unlimited`` has a sentence without a limit, or none.
    """
    failing: list[Words] = []
    holding: list[Words] = []
    rounding = 1e-9  # [-]
    for name, figure in FIGURES.items():
        if name in unlimited:
            if figure.unlimited:
                holding.append((figure.unlimited, "-"))
        elif name in figures:
            value = figures[name]
            most = figure.limit_of(request)
            bound = f"{most:g} at {'least' if figure.least else 'most'}" if np.isfinite(most) else "no limit"
            holds = value >= most if figure.least else value <= most * (1 + rounding)
            (holding if holds else failing).append((figure.sentence.format(value), bound))
    return failing, holding
