"""Whether a jump holds between its nodes: its motion at 2 kHz, judged by Pinocchio alone."""

import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.contacts import is_ground, links_of, near_contact
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import BASE, JumpState, Stance, flight_state
from floatplan.motion.planar.clearance import LinkShapes, pair_distances
from floatplan.plans.planned_motion import least_distances
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem
from floatplan.robot.standing import Spot, corners, heights_over_com, undersides
from floatplan.tables import POINT_FEET

RATE = 2000.0  # [1/s]
SEAM = 1e-6  # [m, rad, per second; over the time unit per second squared] of steps of the motion
SLIP = 1e-3  # [-] of the weight, of horizontal force beyond the cone
LIGHT = 0.02  # [-] of the weight: the ratio of forces that are less says nothing
AROUND = 4e-3  # [s] two steps of a controller at 500 Hz, within which torques change where contacts do
TOUCHDOWN = 0.06  # [s] from landing on, after which one that is not as planned has become a stance
APART = 1e-5  # [s] instants that are nearer are one
ROUNDING = 1e-9

Value: TypeAlias = tuple[str, float]  # of a figure, at some place and time
Words: TypeAlias = tuple[str, str]  # a figure in words, and its limit


class Figure(NamedTuple):
    """What is said of a figure, its limit, in its unit, and whether it is worst where it is least."""

    sentence: str
    limit: float | Callable[[JumpRequest], float]
    least: bool = False
    unlimited: str = ""  # what is said of a share where there is no limit to share; nothing where it is empty

    def most(self, request: JumpRequest) -> float:
        """The limit of a jump."""
        return self.limit(request) if callable(self.limit) else self.limit


SHARES = ("torque", "torque_speed", "velocity", "held_torque")  # figures that are shares of limits
FIGURES = {
    "residual": Figure("forces are out of balance by {:z.2g} of the weight", 1e-3),
    "torque": Figure(
        "torques take {:z.0%} of their limits",
        lambda request: request.margin["torque"],
        unlimited="torques have no limit",
    ),
    "torque_speed": Figure(
        "torques and rates take {:z.0%} of the motors' curves", lambda request: request.margin["torque"]
    ),
    "held_torque": Figure("joints that are held take {:z.0%} of their efforts", 1.0),
    "velocity": Figure(
        "rates take {:z.0%} of their limits",
        lambda request: request.margin["velocity"],
        unlimited="rates have no limit",
    ),
    "friction": Figure("friction is {:z.2f}", lambda request: request.friction),
    "slip": Figure("horizontal forces leave the cone by {:z.2g} of the weight", SLIP),
    "drift": Figure("feet that stand drift by {:z.2g} m", 1e-3),
    "foot_speed": Figure("feet that stand move at {:z.2g} m/s", 0.02),
    "derivative": Figure("rates and differences of places differ by {:z.2g}", 1e-3),
    "takeoff_seam": Figure("the takeoff's seam is {:z.2g}", SEAM),
    "landing_seam": Figure("the landing's seam is {:z.2g}", SEAM),
    "junction": Figure("where feet come or leave, the motion steps by {:z.2g}", SEAM),
    "gap": Figure("from the end of a phase to the next one are at most {:z.2g} s", SEAM),
    "rest": Figure("at its ends it moves by {:z.2g}", SEAM),
    "level": Figure("what stands is on grounds {:z.2g} m apart", SEAM),
    "torque_step": Figure("torques change by {:z.0%} of their limits within 4 ms where contacts do", np.inf),
    "lifted": Figure("feet that stand are up to {:z.2g} m above the ground", 0.01),
    "circle": Figure("outlines of feet that roll are circles to {:z.2g} m", POINT_FEET),
    "range": Figure("joints keep {:z.2g} rad from the ends of their ranges", 0.0, least=True),
    "pull": Figure("the least vertical force is {:z.2g} of the weight", -1e-3, least=True),
    "ground": Figure("everything else is at least {:z.2g} m above the ground", -1e-6, least=True),
    "touchdown": Figure(
        "where it lands turned by the pitch error, everything else is at least {:z.2g} m above the ground",
        -1e-6,
        least=True,
    ),
    "feet": Figure("the feet's shapes are at least {:z.2g} m above the ground", -POINT_FEET, least=True),
    "obstacles": Figure("obstacles are {:z.2g} m away beyond their margins", 0.0, least=True),
    "self_distance": Figure("links are {:z.2g} m apart beyond their margins", 0.0, least=True),
}


@dataclass(frozen=True, eq=False)
class JumpCheck:
    """What was found out about a jump's stances, and whether all of it holds.

    Attributes
    ----------
    ok : bool
    figures : name -> value, the worst of all stances; of what is near, of the flight too
        ``residual``: balance of forces and moments, over weight (and height). ``torque``, ``torque_speed``,
        ``velocity``: shares of the limits; ``held_torque``: of the efforts of joints that are locked. ``range``: least
        distance from the ends of joint ranges, rad. ``friction``: largest ratio of forces; ``slip``: horizontal force
        beyond the cone, and ``pull``: least vertical force, over weight. ``drift``, m, and ``foot_speed``, m/s: of feet
        that stand; where they roll, of centres beyond what was rolled, and of parts on the ground. ``ground``: least
        height of all but feet, ``feet``: of their shapes, ``lifted``: largest height of those that stand, ``circle``:
        distance from the ground of those that roll, ``level``: by which what stands differs in height; ``obstacles``,
        ``self_distance``: least distances beyond the margins, m. ``derivative``: disagreement of places, rates and
        accelerations. ``takeoff_seam``, ``landing_seam``, ``junction``: steps there, and where feet come or leave, m,
        rad, and over the time unit; ``rest``: rates and accelerations at both ends, the same; ``gap``: between phases,
        s. ``torque_step``: by which torques change within 4 ms where contacts do, over limits. ``touchdown``: as
        ``ground``, of a robot that is turned by the pitch error about its feet, from its landing on for 60 ms.
    sentences : for a person, what does not hold first
    unlimited : names of figures that are shares of limits which nothing has; their values are 0
    """

    ok: bool
    figures: Mapping[str, float]
    sentences: tuple[str, ...]
    unlimited: frozenset[str] = frozenset()


def check_jump(jump: JumpMotion) -> JumpCheck:
    """Check the stances of a jump at 2 kHz, independently of the program that found them."""
    with np.errstate(all="ignore"):  # what files may hold overflows: such figures are infinite, and do not hold
        return _checked(jump)


def _checked(jump: JumpMotion) -> JumpCheck:
    assert jump.flight is not None
    grounds = [stance.ground for stance in jump.stances]
    times = jump.takeoff_time + np.linspace(0.0, jump.flight.duration, int(jump.flight.duration * RATE) + 2)
    flown = flight_state(jump.flight, jump.takeoff_time, times)
    flight = _surroundings(jump, flown, min(grounds))
    error = jump.request.pitch_error
    touchdown = [("touchdown", height) for height in _touchdown(jump, error)] if error else []
    figures = _worst([*_stances(jump), *touchdown, *flight, *_seams(jump), ("level", np.ptp(grounds))])
    unlimited = _unlimited(jump.problem)
    broken, held = ([", ".join(words) for words in said] for said in judged(jump.request, figures, unlimited))
    if not jump.flight.ok:
        broken.append("the flight's plan does not hold")
    return JumpCheck(not broken, figures, (*broken, *held), unlimited)


def _worst(found: Iterable[Value]) -> dict[str, float]:
    figures: dict[str, float] = {}
    for name, value in found:
        least = FIGURES[name].least
        if np.isnan(value):  # of numbers beyond all sense, as files may hold: nothing holds of them
            value = -np.inf if least else np.inf
        figures[name] = (min if least else max)(figures.get(name, float(value)), float(value))
    return figures


def stance_figures(jump: JumpMotion) -> dict[str, float]:
    """Figures of :class:`JumpCheck`, but for those of seams."""
    return _worst(_stances(jump))


def _stances(jump: JumpMotion) -> Iterator[Value]:
    for stance in jump.stances:
        begin, end = stance.span
        times = np.linspace(begin, end, max(int(np.ceil((end - begin) * RATE)), 8) + 1)
        kinks = stance.grid.times  # there third derivatives may step
        apart = np.abs(times - kinks[np.searchsorted((kinks[1:] + kinks[:-1]) / 2, times)]) > APART
        state = stance.at(np.sort(np.concatenate((times[apart], kinks))))
        yield from _dynamics(jump, stance, state)
        yield from _feet(stance, state, jump.request.friction)
        yield from _surroundings(jump, state, stance.ground, stance)


def _dynamics(jump: JumpMotion, stance: Stance, state: JumpState) -> Iterator[Value]:
    robot = stance.robot
    problem = jump.problem
    torques = state.torques
    model = robot.model
    weight = robot.mass * stance.gravity
    standing = pin.centerOfMass(model, model.createData(), state.positions[0]) @ robot.plane.vertical
    height = float(standing) - stance.ground
    lever = height if height > 0 else float(np.finfo(float).tiny)  # what is not above the ground does not stand on it
    yield "residual", (np.abs(torques[:, :BASE]) / [weight, weight, weight * lever]).max()
    yield from ((name, shares.max(initial=0.0)) for name, shares in limit_shares(problem, state).items())
    yield "torque", np.abs(torques @ robot.selection / problem.torque_limits).max()
    joints = state.planned(robot)[0, 1:].T
    low, high = np.asarray(problem.position_limits).T
    yield "range", np.minimum(joints - low, high - joints).min()
    for ahead, behind in ((state.velocities, state.positions), (state.accelerations, state.velocities)):
        mean = (ahead[1:] + ahead[:-1]) / 2
        difference = np.diff(behind, axis=0) / np.diff(state.times)[:, None]
        yield "derivative", np.abs(mean - difference).max() / (np.abs(ahead).max() + 1e-9)


def limit_shares(problem: Problem, state: JumpState) -> dict[str, Array]:
    """Shares of limits at N instants, by ``SHARES``.

    (N, motors) of torque and torque-speed curve, (N, n) of rates, (N, locked) of the efforts of joints that are held.
    """
    robot = problem.robot
    model = robot.model
    locked = [model.joints[model.getJointId(name)].idx_v for name in robot.locked]
    efforts = [robot.joint_tree.joint[name].effort for name in robot.locked]
    motors = np.abs(state.torques @ robot.transmission)
    rates = state.velocities @ np.linalg.pinv(robot.selection).T
    slowed = problem.motor_slope * np.abs(rates @ robot.motor_ratios.T)
    found = motors / problem.motor_torque_limits, (motors + slowed) / problem.motor_stall
    held = np.abs(state.torques[:, locked]) / efforts
    return dict(zip(SHARES, (*found, np.abs(rates) / problem.velocity_limits, held), strict=True))


def _unlimited(problem: Problem) -> frozenset[str]:
    """Figures that are shares of limits which nothing has."""
    robot = problem.robot
    efforts = np.array([robot.joint_tree.joint[name].effort for name in robot.locked])
    torques = np.concatenate((problem.motor_torque_limits, problem.torque_limits))
    limits = dict(zip(SHARES, (torques, problem.motor_stall, problem.velocity_limits, efforts), strict=True))
    limits["torque_step"] = problem.motor_torque_limits
    return frozenset(name for name, values in limits.items() if not np.isfinite(values).any())


def _feet(stance: Stance, state: JumpState, friction: float) -> Iterator[Value]:
    """Cone, drift and speed of what is on the ground, by forward kinematics; drifts are less what was rolled."""
    robot = stance.robot
    tree = robot.tree
    weight = robot.mass * stance.gravity
    y = state.planned(robot)[0]
    touching = stance.touching(state.positions)
    angles = tree.absolute_angles(y[0], y[1:].T)
    for contact in stance.contacts:
        for name, spot in zip(contact.names, contact.spots, strict=True):
            places, jacobians = touching[name]
            yield "drift", np.ptp(places @ robot.plane.horizontal + tree.turn * spot.radius * angles[:, spot.body])
            yield "drift", np.ptp(places @ robot.plane.vertical)
            yield "foot_speed", np.abs(np.einsum("nij,nj->ni", jacobians, state.velocities)).max()
            horizontal = np.abs(state.forces[name][:, 0])
            vertical = state.forces[name][:, 1]
            pressed = vertical > LIGHT * weight
            yield "friction", (horizontal[pressed] / vertical[pressed]).max(initial=0.0)
            yield "slip", (horizontal - friction * np.maximum(vertical, 0)).max() / weight
            yield "pull", vertical.min() / weight


def _surroundings(jump: JumpMotion, state: JumpState, ground: float, stance: Stance | None = None) -> Iterator[Value]:
    """Heights over the ground, m, by the corners of the hulls; least distances from obstacles, and between links.

    ``stance`` is what stands, nothing where there is none.
    """
    robot = jump.problem.robot
    y = state.planned(robot)[0]
    base = state.positions[:, 0] + 1j * state.positions[:, 1]
    com = base - heights_over_com(robot, [Spot(0, 0j)], y)[:, 0]
    own = () if stance is None else stance.contacts
    feet = links_of(robot, [contact for each in jump.stances for contact in each.contacts])
    stands = links_of(robot, own)
    rolls = links_of(robot, [each for each in own if each.radius])
    yield from (("ground", np.inf), ("feet", np.inf), ("lifted", 0.0))
    for link in robot.touching_links:
        heights = undersides(robot, corners(robot.link_hulls[link]), y) + com.imag[:, None] - ground
        yield "feet" if link in feet else "ground", heights.min()
        if link in stands:
            yield "lifted", heights.min(axis=1).max()
        if link in rolls:
            yield "circle", np.abs(heights.min(axis=1)).max()
    segments = LinkShapes(robot.tree, robot.shapes).place(com, robot.tree.absolute_angles(y[0], y[1:].T))
    links = np.array([shape.link for shape in robot.shapes])
    for pair in jump.problem.self_clearances:
        first, second = (segments.of(np.flatnonzero(links == link)) for link in pair.links)
        yield "self_distance", pair_distances(first, second).min() - pair.margin
    for obstacle in (each for each in jump.problem.obstacles if not is_ground(each, ground)):
        least = least_distances(segments, obstacle, state.times - jump.takeoff_time).min() - obstacle.margin
        if np.isfinite(least):
            yield "obstacles", least


def touchdown_height(jump: JumpMotion, error: float) -> float:
    """Least height over the ground of all but feet, m, of a robot that lands turned by an error, rad, about its feet.

    It is infinite of a robot that is all feet.
    """
    return min(_touchdown(jump, error), default=np.inf)


def _touchdown(jump: JumpMotion, error: float) -> Iterator[float]:
    """Least heights over the ground of all but feet, m, of a robot that lands turned by an error, rad, about its feet.

    The robot is turned as a rigid body, either way, until one of its feet is on the ground: the one that is the lowest
    then, whether it stands at that time or is still to come.
    """
    robot = jump.problem.robot
    contacts = list({each.name: each for stance in jump.stances for each in stance.contacts}.values())
    feet: dict[str | None, list[Spot]] = {}
    for contact in contacts:
        for frame, spot in zip(contact.frames, contact.spots, strict=True):
            feet.setdefault(robot.contact_link(robot.frames[frame].link), []).append(spot)
    watched = [
        corner
        for link in robot.touching_links
        for corner in corners(robot.link_hulls[link])
        if not near_contact(corner, feet.get(link, []))
    ]
    landing = jump.after[0].span[0]
    for stance in jump.after if watched else ():
        begin = stance.span[0]
        end = min(stance.span[1], landing + TOUCHDOWN)
        if begin >= end:
            continue
        times = np.linspace(begin, end, int((end - begin) * RATE) + 2)
        y = stance.grid.at(times)[0]
        places = heights_over_com(robot, watched, y)
        of_feet = heights_over_com(robot, [contact.spots[0] for contact in contacts], y)
        radii = np.array([corner.radius for corner in watched])
        depths = np.array([contact.depth for contact in contacts])
        for sign in (1.0, -1.0):
            turn = np.exp(1j * sign * error)
            ground = ((of_feet * turn).imag - depths).min(axis=1)
            yield float(((places * turn).imag - radii - ground[:, None]).min())


def _seams(jump: JumpMotion) -> Iterator[Value]:
    """Steps of places, rates and accelerations at the flight's ends and between stances; what moves at both ends."""
    assert jump.flight is not None
    flight = jump.flight
    limits = jump.problem.motor_torque_limits
    unit = float(np.sqrt(1.0 / jump.problem.flight.gravity))
    takes_off, lands = (flight_state(flight, 0.0, np.array([time])) for time in (0.0, flight.duration))
    seams = [("takeoff_seam", jump.before[-1], 1, takes_off), ("landing_seam", jump.after[0], 0, lands)]
    yield "gap", abs(jump.before[0].span[0])
    yield "gap", abs(jump.takeoff_time + flight.duration - jump.after[0].span[0])
    for one, two in itertools.chain(itertools.pairwise(jump.before), itertools.pairwise(jump.after)):
        seams.append(("junction", one, 1, two.at(np.array(two.span[:1]))))
        yield "gap", abs(one.span[1] - two.span[0])
    for name, stance, end, other in seams:
        yield name, _step(stance.at(np.array([stance.span[end]])), other, unit)
        around = np.clip(stance.span[end] + np.array([-0.5, 0.5]) * AROUND, 0.0, jump.duration)
        step = np.diff(jump.at(around).torques @ jump.problem.robot.transmission, axis=0) / limits
        yield "torque_step", np.abs(step).max()
    for stance, end in ((jump.before[0], 0), (jump.after[-1], 1)):
        moves = stance.at(np.array([stance.span[end]]))
        yield "rest", max(np.abs(moves.velocities).max() * unit, np.abs(moves.accelerations).max() * unit**2)


def _step(one: JumpState, other: JumpState, unit: float) -> float:
    """Largest step of places, rates and accelerations, over the time unit."""
    names = ("positions", "velocities", "accelerations")
    steps = [np.abs(getattr(one, name) - getattr(other, name)).max() * unit**k for k, name in enumerate(names)]
    return float(max(steps))


def judged(
    request: JumpRequest, figures: Mapping[str, float], unlimited: Collection[str] = ()
) -> tuple[list[Words], list[Words]]:
    """What is said of figures, of those that are there, each with its limit: what does not hold, and what does.

    Of those that are ``unlimited`` it is said that there is no limit.
    """
    said: tuple[list[Words], list[Words]] = [], []
    for name, figure in FIGURES.items():
        if name in unlimited:
            said[1].extend([(figure.unlimited, "-")] if figure.unlimited else [])
        elif name in figures:
            value = figures[name]
            most = figure.most(request)
            bound = f"{most:g} at {'least' if figure.least else 'most'}" if np.isfinite(most) else "no limit"
            holds = value >= most if figure.least else value <= most * (1 + ROUNDING)
            said[holds].append((figure.sentence.format(value), bound))
    return said
