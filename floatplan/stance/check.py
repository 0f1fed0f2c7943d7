"""Whether a jump holds between its nodes: its motion at 2 kHz, judged by Pinocchio alone."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.motion.planar.clearance import LinkShapes, pair_distances
from floatplan.plans.planned_motion import least_distances
from floatplan.problem.jump import JumpRequest
from floatplan.robot import Robot
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import JumpState, Stance, flight_state
from floatplan.tables import POINT_FEET

RATE = 2000.0  # [1/s]
RESIDUAL = 1e-3  # [-] of the weight, and of the weight times the standing height
DRIFT = 1e-3  # [m]
SPEED = 0.02  # [m/s] of a foot that stands
GROUND = -1e-6  # [m] of what never stands
LIFTED = 0.01  # [m] that the lowest point of a link that stands may be above the ground
SEAM = 1e-6  # [m, rad, per second; over the time unit per second squared] of steps of the motion
LEAST = ("range", "pull", "ground", "feet", "obstacles", "self_distance")  # figures that are worst where they are least
PULL = -1e-3  # [-] of the weight
SLIP = 1e-3  # [-] of the weight, of horizontal force beyond the cone
LIGHT = 0.02  # [-] of the weight: the ratio of forces that are less says nothing
DERIVATIVE = 1e-3  # [-] by which differences of places disagree with rates
AROUND = 4e-3  # [s] two steps of a controller at 500 Hz, within which torques change where contacts do
APART = 1e-5  # [s] instants that are nearer are one
ROUNDING = 1e-9

Touching = Mapping[str, tuple[Array, Array]]  # places and Jacobians of what is on the ground, by point's name
Words = tuple[str, str]  # a figure in words, and its limit


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
        s. ``torque_step``: by which torques change within 4 ms where contacts do, over limits.
    sentences : for a person, what does not hold first
    """

    ok: bool
    figures: Mapping[str, float]
    sentences: tuple[str, ...]


def check_jump(jump: JumpMotion) -> JumpCheck:
    """Check the stances of a jump at 2 kHz, independently of the program that found them."""
    assert jump.flight is not None
    lines = [stance.place.imag - stance.contacts[0].depth for stance in jump.stances]
    times = jump.takeoff_time + np.linspace(0.0, jump.flight.duration, int(jump.flight.duration * RATE) + 2)
    flight = _surroundings(jump, flight_state(jump.flight, times, jump.takeoff_time), min(lines))
    figures = {**_worst([stance_figures(jump), flight]), **_seams(jump), "level": float(np.ptp(lines))}
    broken, held = ([", ".join(words) for words in said] for said in judged(jump.request, figures))
    if not jump.flight.ok:
        broken.append("the flight's plan does not hold")
    return JumpCheck(not broken, figures, (*broken, *held))


def _worst(found: Iterable[Mapping[str, float]]) -> dict[str, float]:
    figures: dict[str, float] = {}
    for each in found:
        for name, value in each.items():
            figures[name] = (min if name in LEAST else max)(figures.get(name, value), value)
    return figures


def stance_figures(jump: JumpMotion) -> dict[str, float]:
    """Figures of :class:`JumpCheck`, but for those of seams."""
    found = []
    for stance in jump.stances:
        begin, end = stance.span
        times = np.linspace(begin, end, max(int(np.ceil((end - begin) * RATE)), 8) + 1)
        kinks = stance.grid.times  # there third derivatives may step
        apart = np.abs(times - kinks[np.searchsorted((kinks[1:] + kinks[:-1]) / 2, times)]) > APART
        times = np.sort(np.concatenate((times[apart], kinks)))
        state = stance.at(times)
        touching = stance.touching(state.positions)
        found.append(_dynamics(jump, stance, state, touching))
        found.append(_feet(stance, state, touching, jump.request.friction))
        found.append(_surroundings(jump, state, stance.place.imag - stance.contacts[0].depth, stance))
    return _worst(found)


def _dynamics(jump: JumpMotion, stance: Stance, state: JumpState, touching: Touching) -> dict[str, float]:
    robot, problem = stance.robot, jump.problem
    weight = robot.mass * stance.gravity
    model, data = robot.model, robot.model.createData()
    standing = pin.centerOfMass(model, data, state.positions[0]) @ robot.plane.vertical
    height = float(standing - stance.place.imag + stance.contacts[0].depth)
    wrench = np.empty_like(state.positions)
    for row, (q, v, a) in enumerate(zip(state.positions, state.velocities, state.accelerations, strict=True)):
        lifted = a.copy()
        lifted[1] += stance.gravity
        wrench[row] = pin.rnea(model, data, q, v, lifted)
    for name, (_, jacobians) in touching.items():
        wrench -= np.einsum("ni,nij->nj", state.forces[name], jacobians)
    residual = np.abs(wrench[:, :3]) / [weight, weight, weight * height]
    motors = wrench @ robot.transmission
    planned = np.linalg.pinv(robot.selection).T
    rates = state.velocities @ planned
    shares = (motors / problem.motor_torque_limits, wrench @ robot.selection / problem.torque_limits)
    found = {"residual": float(residual.max()), "torque": max(float(np.abs(each).max()) for each in shares)}
    own = np.abs(motors) + problem.motor_slope * np.abs(rates @ robot.motor_ratios.T)
    found["torque_speed"] = float((own / problem.motor_stall).max())
    found["velocity"] = float((np.abs(rates) / problem.velocity_limits).max())
    efforts = np.where(robot.model.effortLimit > 0, robot.model.effortLimit, np.inf)
    locked = [model.joints[model.getJointId(name)].idx_v for name in robot.locked]
    found["held_torque"] = float((np.abs(wrench[:, locked]) / efforts[locked]).max(initial=0.0))
    joints = _joints(robot, state)
    low, high = np.asarray(problem.position_limits).T
    found["range"] = float(np.minimum(joints - low, high - joints).min())
    for ahead, behind in ((state.velocities, state.positions), (state.accelerations, state.velocities)):
        mean = (ahead[1:] + ahead[:-1]) / 2
        difference = np.diff(behind, axis=0) / np.diff(state.times)[:, None]
        scale = np.abs(ahead).max() + 1e-9
        found["derivative"] = max(found.get("derivative", 0.0), float(np.abs(mean - difference).max() / scale))
    return found


def _feet(stance: Stance, state: JumpState, touching: Touching, friction: float) -> dict[str, float]:
    """Cone, drift and speed of what is on the ground, by forward kinematics; drifts are less what was rolled."""
    tree, weight = stance.robot.tree, stance.robot.mass * stance.gravity
    angles = tree.absolute_angles(state.positions[:, 2], _joints(stance.robot, state))
    drifts, speeds = [], []
    for contact in stance.contacts:
        for name, spot in zip(contact.names, contact.spots, strict=True):
            places, jacobians = touching[name]
            along = places @ stance.robot.plane.horizontal + tree.turn * spot.radius * angles[:, spot.body]
            drifts += [np.ptp(along), np.ptp(places @ stance.robot.plane.vertical)]
            speeds.append(np.abs(np.einsum("nij,nj->ni", jacobians, state.velocities)).max())
    found = {"friction": 0.0, "slip": -np.inf, "pull": np.inf}
    found |= {"drift": float(max(drifts)), "foot_speed": float(max(speeds))}
    for horizontal, vertical in (each.T for each in state.forces.values()):
        pressed = vertical > LIGHT * weight
        found["friction"] = max(found["friction"], float((np.abs(horizontal) / vertical)[pressed].max(initial=0.0)))
        found["slip"] = max(
            found["slip"], float((np.abs(horizontal) - friction * np.maximum(vertical, 0)).max() / weight)
        )
        found["pull"] = min(found["pull"], float(vertical.min() / weight))
    return found


def _joints(robot: Robot, state: JumpState) -> Array:
    """Planned joints (N, n), rad."""
    return (state.positions - robot.reference) @ np.linalg.pinv(robot.selection).T


def _surroundings(jump: JumpMotion, state: JumpState, line: float, stance: Stance | None = None) -> dict[str, float]:
    """Heights over the ground, m, by the corners of the hulls; least distances from obstacles, and between links.

    ``stance`` is what stands, nothing where there is none.
    """
    robot = jump.problem.robot
    tree = robot.tree
    theta, base = state.positions[:, 2], state.positions[:, 0] + 1j * state.positions[:, 1]
    angles = tree.absolute_angles(theta, _joints(robot, state))
    rotations = tree.rotations(angles)
    com = base - rotations @ tree.point_weights(np.array([0]), np.array([0j]))[0]
    own = () if stance is None else stance.contacts
    feet, stands, rolls = (
        {robot.contact_link(robot.frames[frame].link) for one in contacts for frame in one.frames}
        for contacts in ([one for on in jump.stances for one in on.contacts], own, [one for one in own if one.radius])
    )
    found = {"ground": np.inf, "feet": np.inf, "lifted": 0.0}
    for link, hull in robot.link_hulls.items():
        bodies = np.array([each.body for each in hull for _ in range(2)])
        ends = np.array([end for each in hull for end in (each.start, each.end)])
        radii = np.repeat([each.radius for each in hull], 2)
        heights = (rotations @ tree.point_weights(bodies, ends).T + com[:, None]).imag - radii - line
        kind = "feet" if link in feet else "ground"
        found[kind] = min(found[kind], float(heights.min()))
        if link in stands:
            found["lifted"] = max(found["lifted"], float(heights.min(axis=1).max()))
        if link in rolls:
            found["circle"] = max(found.get("circle", 0.0), float(np.abs(heights.min(axis=1)).max()))
    segments = LinkShapes(tree, robot.shapes).place(com, angles)
    links = [shape.link for shape in robot.shapes]
    for pair in jump.problem.self_clearances:
        first, second = (segments.of(np.flatnonzero([name == link for name in links])) for link in pair.links)
        least = float(pair_distances(first, second).min()) - pair.margin
        found["self_distance"] = min(found.get("self_distance", np.inf), least)
    if jump.problem.obstacles:
        since = state.times - jump.takeoff_time
        distances = [least_distances(segments, each, since).min() - each.margin for each in jump.problem.obstacles]
        if np.isfinite(min(distances)):
            found["obstacles"] = float(min(distances))
    return found


def _seams(jump: JumpMotion) -> dict[str, float]:
    """Steps of places, rates and accelerations at the flight's ends and between stances; what moves at both ends."""
    assert jump.flight is not None
    flight, limits = jump.flight, jump.problem.motor_torque_limits
    unit = float(np.sqrt(1.0 / jump.problem.flight.gravity))
    takes_off, lands = (flight_state(flight, np.array([time]), 0.0) for time in (0.0, flight.duration))
    seams = [("takeoff_seam", jump.before[-1], 1, takes_off), ("landing_seam", jump.after[0], 0, lands)]
    for side in (jump.before, jump.after):
        seams += [("junction", one, 1, two.at(np.array(two.span[:1]))) for one, two in itertools.pairwise(side)]
    found = dict.fromkeys(("takeoff_seam", "landing_seam", "torque_step"), 0.0)
    for name, stance, end, other in seams:
        found[name] = max(found.get(name, 0.0), _step(stance.at(np.array([stance.span[end]])), other, unit))
        around = np.clip(stance.span[end] + np.array([-0.5, 0.5]) * AROUND, 0.0, jump.duration)
        step = np.diff(jump.at(around).torques @ jump.problem.robot.transmission, axis=0) / limits
        found["torque_step"] = max(found["torque_step"], float(np.abs(step).max()))
    gaps = [jump.before[0].span[0], jump.takeoff_time + flight.duration - jump.after[0].span[0]]
    gaps += [one.span[1] - two.span[0] for side in (jump.before, jump.after) for one, two in itertools.pairwise(side)]
    found["gap"] = float(np.abs(gaps).max())
    for stance, end in ((jump.before[0], 0), (jump.after[-1], 1)):
        moves = stance.at(np.array([stance.span[end]]))
        rest = max(float(np.abs(moves.velocities).max()) * unit, float(np.abs(moves.accelerations).max()) * unit**2)
        found["rest"] = max(found.get("rest", 0.0), rest)
    return found


def _step(one: JumpState, other: JumpState, unit: float) -> float:
    """Largest step of places, rates and accelerations, over the time unit."""
    names = ("positions", "velocities", "accelerations")
    steps = [np.abs(getattr(one, name) - getattr(other, name)).max() * unit**k for k, name in enumerate(names)]
    return float(max(steps))


def judged(request: JumpRequest, figures: Mapping[str, float]) -> tuple[list[Words], list[Words]]:
    """What is said of figures, of those that are there, each with its limit: what does not hold, and what does."""
    margin, friction = request.margin, request.friction
    torque, velocity = margin["torque"], margin["velocity"]
    rules = [
        ("residual", RESIDUAL, "forces are out of balance by {:.2g} of the weight"),
        ("torque", torque, "torques take {:.0%} of their limits"),
        ("torque_speed", torque, "torques and rates take {:.0%} of the motors' curves"),
        ("held_torque", 1.0, "joints that are held take {:.0%} of their efforts"),
        ("velocity", velocity, "rates take {:.0%} of their limits"),
        ("friction", friction, "friction is {:.2f}"),
        ("slip", SLIP, "horizontal forces leave the cone by {:.2g} of the weight"),
        ("drift", DRIFT, "feet that stand drift by {:.2g} m"),
        ("foot_speed", SPEED, "feet that stand move at {:.2g} m/s"),
        ("derivative", DERIVATIVE, "rates and differences of places differ by {:.2g}"),
        ("takeoff_seam", SEAM, "the takeoff's seam is {:.2g}"),
        ("landing_seam", SEAM, "the landing's seam is {:.2g}"),
        ("junction", SEAM, "where feet come or leave, the motion steps by {:.2g}"),
        ("gap", SEAM, "phases are {:.2g} s apart"),
        ("rest", SEAM, "at its ends it moves by {:.2g}"),
        ("level", SEAM, "what stands is on grounds {:.2g} m apart"),
        ("torque_step", np.inf, "torques change by {:.0%} of their limits within 4 ms where contacts do"),
        ("lifted", LIFTED, "feet that stand are up to {:.2g} m above the ground"),
        ("circle", POINT_FEET, "outlines of feet that roll are circles to {:.2g} m"),
    ]
    least = [
        ("range", 0.0, "joints keep {:.2g} rad from the ends of their ranges"),
        ("pull", PULL, "the least vertical force is {:.2g} of the weight"),
        ("ground", GROUND, "everything else is at least {:.2g} m above the ground"),
        ("feet", -POINT_FEET, "the feet's shapes are at least {:.2g} m above the ground"),
        ("obstacles", 0.0, "obstacles are {:.2g} m away beyond their margins"),
        ("self_distance", 0.0, "links are {:.2g} m apart beyond their margins"),
    ]
    held: list[Words] = []
    broken: list[Words] = []
    for name, limit, sentence in rules:
        if name in figures:
            words = sentence.format(figures[name]), f"{limit:g} at most" if np.isfinite(limit) else "without limit"
            (held if figures[name] <= limit * (1 + ROUNDING) else broken).append(words)
    for name, limit, sentence in least:
        if name in figures:
            words = sentence.format(figures[name]), f"{limit:g} at least"
            (held if figures[name] >= limit else broken).append(words)
    return broken, held
