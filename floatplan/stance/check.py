"""Whether a jump holds between its nodes: its motion at 2 kHz, judged by Pinocchio alone."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.motion.planar.clearance import LinkShapes, obstacle_distances
from floatplan.problem.jump import JumpRequest
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import JumpState, Stance, flight_state
from floatplan.tables import POINT_FEET

RATE = 2000.0  # [1/s]
RESIDUAL = 1e-3  # [-] of the weight, and of the weight times the standing height
DRIFT = 1e-3  # [m]
SPEED = 0.02  # [m/s] of a foot that stands
GROUND = -1e-6  # [m] of what never stands
SEAM = 1e-6  # [rad, rad/s; over the time unit rad/s^2]
PULL = -1e-3  # [-] of the weight
SLIP = 1e-3  # [-] of the weight, of horizontal force beyond the cone
LIGHT = 0.02  # [-] of the weight: the ratio of forces that are less says nothing
DERIVATIVE = 1e-3  # [-] by which differences of places disagree with rates
APART = 1e-5  # [s] instants that are nearer are one
ROUNDING = 1e-9

Words = tuple[str, str]  # a figure in words, and its limit


@dataclass(frozen=True, eq=False)
class JumpCheck:
    """What was found out about a jump's stances, and whether all of it holds.

    Attributes
    ----------
    ok : bool
    figures : name -> value, the worst of all stances
        ``residual``: balance of forces and moments, over weight (and height). ``torque``, ``torque_speed``,
        ``velocity``: shares of the limits; ``held_torque``: of the efforts of joints that are locked. ``range``: least
        distance from the ends of joint ranges, rad. ``friction``: largest ratio of forces; ``slip``: horizontal force
        beyond the cone, and ``pull``: least vertical force, over weight. ``drift``, m, and ``foot_speed``, m/s: of feet
        that stand. ``ground``: least height of all but feet, ``feet``: of their shapes, ``obstacles``: least distance
        beyond the margins, m. ``derivative``: disagreement of places, rates and accelerations. ``takeoff_seam``,
        ``landing_seam``: steps there, rad, and over the time unit. ``torque_step``: where contacts change, over limits.
    sentences : for a person, what does not hold first
    """

    ok: bool
    figures: Mapping[str, float]
    sentences: tuple[str, ...]


def check_jump(jump: JumpMotion) -> JumpCheck:
    """Check the stances of a jump at 2 kHz, independently of the program that found them."""
    return _judged(jump, {**stance_figures(jump), **_seams(jump)})


def stance_figures(jump: JumpMotion) -> dict[str, float]:
    """Figures of :class:`JumpCheck`, but for those of seams."""
    figures: dict[str, float] = {}
    for stance in jump.stances:
        begin, end = stance.span
        times = np.linspace(begin, end, max(int(np.ceil((end - begin) * RATE)), 8) + 1)
        kinks = stance.grid.times  # there third derivatives may step
        apart = np.abs(times - kinks[np.searchsorted((kinks[1:] + kinks[:-1]) / 2, times)]) > APART
        times = np.sort(np.concatenate((times[apart], kinks)))
        state = stance.at(times)
        for found in (
            _dynamics(jump, stance, state),
            _feet(stance, state, jump.request.friction),
            _surroundings(jump, stance, state),
        ):
            for name, value in found.items():
                best = min if name in ("range", "pull", "ground", "feet", "obstacles") else max
                figures[name] = best(figures.get(name, value), value)
    return figures


def _dynamics(jump: JumpMotion, stance: Stance, state: JumpState) -> dict[str, float]:
    robot, problem = stance.robot, jump.problem
    weight = robot.mass * stance.gravity
    model, data = robot.model, robot.model.createData()
    standing = pin.centerOfMass(model, data, state.positions[0]) @ robot.plane.vertical
    height = float(standing - stance.place.imag + stance.contacts[0].depth)
    wrench = np.empty_like(state.positions)
    axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
    for row, (q, v, a) in enumerate(zip(state.positions, state.velocities, state.accelerations, strict=True)):
        lifted = a.copy()
        lifted[1] += stance.gravity
        wrench[row] = pin.rnea(model, data, q, v, lifted)
        pin.computeJointJacobians(model, data, q)
        for name, (joint, local) in stance.points.items():
            at = pin.SE3(np.eye(3), local)
            frame = pin.getFrameJacobian(model, data, joint, at, pin.LOCAL_WORLD_ALIGNED)
            wrench[row] -= state.forces[name][row] @ axes @ frame[:3]
    residual = np.abs(wrench[:, :3]) / [weight, weight, weight * height]
    motors = wrench @ robot.transmission
    planned = np.linalg.pinv(robot.selection).T
    rates = state.velocities @ planned
    found = {"residual": float(residual.max()), "torque": float((np.abs(motors) / problem.motor_torque_limits).max())}
    own = np.abs(motors) + problem.motor_slope * np.abs(rates @ robot.motor_ratios.T)
    found["torque_speed"] = float((own / problem.motor_stall).max())
    found["velocity"] = float((np.abs(rates) / problem.velocity_limits).max())
    efforts = np.where(robot.model.effortLimit > 0, robot.model.effortLimit, np.inf)
    locked = [model.joints[model.getJointId(name)].idx_v for name in robot.locked]
    found["held_torque"] = float((np.abs(wrench[:, locked]) / efforts[locked]).max(initial=0.0))
    joints = (state.positions - robot.reference) @ planned
    low, high = np.asarray(problem.position_limits).T
    found["range"] = float(np.minimum(joints - low, high - joints).min())
    for ahead, behind in ((state.velocities, state.positions), (state.accelerations, state.velocities)):
        mean = (ahead[1:] + ahead[:-1]) / 2
        difference = np.diff(behind, axis=0) / np.diff(state.times)[:, None]
        scale = np.abs(ahead).max() + 1e-9
        found["derivative"] = max(found.get("derivative", 0.0), float(np.abs(mean - difference).max() / scale))
    return found


def _feet(stance: Stance, state: JumpState, friction: float) -> dict[str, float]:
    """Cone, drift and speed of the feet that stand, by forward kinematics."""
    robot = stance.robot
    model, data = robot.model, robot.model.createData()
    axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
    weight = robot.mass * stance.gravity
    found = {"friction": 0.0, "slip": -np.inf, "pull": np.inf, "drift": 0.0, "foot_speed": 0.0}
    contacts = {name: contact for contact in stance.contacts for name in contact.names}
    for name, (joint, local) in stance.points.items():
        places, speeds = np.empty((2, len(state.times), 2))
        at = pin.SE3(np.eye(3), local)
        for row, (q, v) in enumerate(zip(state.positions, state.velocities, strict=True)):
            pin.computeJointJacobians(model, data, q)
            places[row] = axes @ (data.oMi[joint] * at).translation
            jacobian = pin.getFrameJacobian(model, data, joint, at, pin.LOCAL_WORLD_ALIGNED)
            speeds[row] = axes @ jacobian[:3] @ v
        used = slice(1, 2) if contacts[name].vertical else slice(0, 2)
        found["drift"] = max(found["drift"], float(np.ptp(places[:, used], axis=0).max()))
        found["foot_speed"] = max(found["foot_speed"], float(np.abs(speeds[:, used]).max()))
        horizontal, vertical = state.forces[name].T
        pressed = vertical > LIGHT * weight
        found["friction"] = max(found["friction"], float((np.abs(horizontal) / vertical)[pressed].max(initial=0.0)))
        found["slip"] = max(
            found["slip"], float((np.abs(horizontal) - friction * np.maximum(vertical, 0)).max() / weight)
        )
        found["pull"] = min(found["pull"], float(vertical.min() / weight))
    return found


def _surroundings(jump: JumpMotion, stance: Stance, state: JumpState) -> dict[str, float]:
    """Least height of what does not stand, by the corners of the links' hulls; least distance from obstacles."""
    robot = stance.robot
    tree = robot.tree
    theta, base = state.positions[:, 2], state.positions[:, 0] + 1j * state.positions[:, 1]
    angles = tree.absolute_angles(theta, (state.positions - robot.reference) @ np.linalg.pinv(robot.selection).T)
    rotations = tree.rotations(angles)
    com = base - rotations @ tree.point_weights(np.array([0]), np.array([0j]))[0]
    contacts = [contact for each in jump.stances for contact in each.contacts]
    standing = {robot.contact_link(robot.frames[frame].link) for each in contacts for frame in each.frames}
    line = stance.place.imag - stance.contacts[0].depth
    found = {"ground": np.inf, "feet": np.inf}
    for link, hull in robot.link_hulls.items():
        bodies = np.array([each.body for each in hull for _ in range(2)])
        ends = np.array([end for each in hull for end in (each.start, each.end)])
        radii = np.repeat([each.radius for each in hull], 2)
        heights = (rotations @ tree.point_weights(bodies, ends).T + com[:, None]).imag - radii - line
        kind = "feet" if link in standing else "ground"
        found[kind] = min(found[kind], float(heights.min()))
    if jump.problem.obstacles:
        segments = LinkShapes(tree, robot.shapes).place(com, angles)
        since = state.times - jump.takeoff_time
        distances = [obstacle_distances(segments, each, since).min() - each.margin for each in jump.problem.obstacles]
        found["obstacles"] = float(min(distances))
    return found


def _seams(jump: JumpMotion) -> dict[str, float]:
    """Steps of places, rates and accelerations at the flight's ends, and of torques where contacts change."""
    found = {"takeoff_seam": 0.0, "landing_seam": 0.0, "torque_step": 0.0}
    assert jump.flight is not None
    robot = jump.problem.robot
    limits = jump.problem.motor_torque_limits
    unit = float(np.sqrt(1.0 / jump.problem.flight.gravity))
    for name, stance, time in (
        ("takeoff_seam", jump.before[-1], 0.0),
        ("landing_seam", jump.after[0], jump.flight.duration),
    ):
        instant = stance.span[1 if name == "takeoff_seam" else 0]
        own, other = stance.at(np.array([instant])), flight_state(jump.flight, np.array([time]), 0.0)
        for power, quantity in enumerate(("positions", "velocities", "accelerations")):
            step = np.abs(getattr(own, quantity) - getattr(other, quantity)).max() * unit**power
            found[name] = max(found[name], float(step))
        step = np.abs((own.torques - other.torques) @ robot.transmission) / limits
        found["torque_step"] = max(found["torque_step"], float(step.max()))
    for side in (jump.before, jump.after):
        for first, second in itertools.pairwise(side):
            pair = [each.at(np.array([first.span[1]])).torques @ robot.transmission for each in (first, second)]
            found["torque_step"] = max(found["torque_step"], float((np.abs(pair[0] - pair[1]) / limits).max()))
    return found


def _judged(jump: JumpMotion, figures: dict[str, float]) -> JumpCheck:
    broken, held = ([", ".join(words) for words in said] for said in judged(jump.request, figures))
    if jump.flight is None or not jump.flight.ok:
        broken.append("the flight's plan does not hold")
    return JumpCheck(not broken, figures, (*broken, *held))


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
    ]
    least = [
        ("range", 0.0, "joints keep {:.2g} rad from the ends of their ranges"),
        ("pull", PULL, "the least vertical force is {:.2g} of the weight"),
        ("ground", GROUND, "everything else is at least {:.2g} m above the ground"),
        ("feet", -POINT_FEET, "the feet's shapes are at least {:.2g} m above the ground"),
        ("obstacles", 0.0, "obstacles are {:.2g} m away beyond their margins"),
    ]
    held: list[Words] = []
    broken: list[Words] = []
    for name, limit, sentence in rules:
        if name in figures:
            words = sentence.format(figures[name]), f"{limit:g} at most"
            (held if figures[name] <= limit * (1 + ROUNDING) else broken).append(words)
    for name, limit, sentence in least:
        if name in figures:
            words = sentence.format(figures[name]), f"{limit:g} at least"
            (held if figures[name] >= limit else broken).append(words)
    return broken, held
