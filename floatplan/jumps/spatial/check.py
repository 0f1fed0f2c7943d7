"""Whether a jump in space holds between its nodes: its motion at 2 kHz, judged by Pinocchio."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.check import (
    LIGHT,
    RATE,
    TOUCHDOWN,
    JumpCheck,
    Value,
    limit_shares,
    sentences_on,
    unlimited_figures,
    worst_values,
)
from floatplan.jumps.motion import JumpState, flight_state
from floatplan.jumps.spatial.jump_motion import (
    JOINTS,
    SpatialJumpMotion,
    planned_joints,
    poses_of,
    state_of,
)
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.stance import SpatialStance
from floatplan.jumps.spatial.standing import Foot, feet_links
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.clearance import pair_distances_in_space, shapes_in_space
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.plans.planned_motion import least_distances
from floatplan.robot.robot import Robot


def check_jump_in_space(jump: SpatialJumpMotion) -> JumpCheck:
    """Check the stances of a jump at 2 kHz, independently of the program that they come from."""
    with np.errstate(all="ignore"):  # what files may hold overflows: such figures are infinite, and do not hold
        return _checked(jump)


def _checked(jump: SpatialJumpMotion) -> JumpCheck:
    assert jump.flight is not None
    grounds = [stance.ground for stance in jump.stances]
    times = jump.takeoff_time + np.linspace(0.0, jump.flight.duration, int(jump.flight.duration * RATE) + 2)
    in_flight = flight_state(jump.flight, jump.takeoff_time, times)
    values = [
        *_stances(jump),
        *_touchdown(jump),
        *_surroundings(jump, in_flight, min(grounds), ()),
        *_seams(jump),
        ("level", float(np.ptp(grounds))),
    ]
    figures = worst_values(values)
    unlimited = unlimited_figures(jump.problem)
    failing, holding = sentences_on(jump.request, figures, unlimited)
    broken = [", ".join(words) for words in failing]
    if not jump.flight.ok:
        broken.append("the flight's plan does not hold")
    sentences = (*broken, *(", ".join(words) for words in holding))
    return JumpCheck(not broken, figures, sentences, unlimited)


def _stances(jump: SpatialJumpMotion) -> Iterator[Value]:
    """Figures of all stances, at even instants and at those between which the motion is smooth."""
    for stance in jump.stances:
        begin, end = stance.span
        times = np.linspace(begin, end, max(int(np.ceil((end - begin) * RATE)), 8) + 1)
        kinks = stance.grid.times  # there third derivatives may step
        nearest = kinks[np.searchsorted((kinks[1:] + kinks[:-1]) / 2, times)]
        even = times[np.abs(times - nearest) > 1e-5]  # s: instants that are nearer are one
        state = stance.at(np.sort(np.concatenate((even, kinks))))
        yield from _dynamics(jump, stance, state)
        yield from _feet(jump, stance, state)
        yield from _surroundings(jump, state, stance.ground, stance.contacts)


def _torques(stance: SpatialStance, state: JumpState) -> tuple[Array, dict[str, tuple[Array, Array]]]:
    """Forces (N, nv) on all coordinates less what the feet take; and of each foot its places and velocities (N, 3).

    The feet are the frames of the robot's own model; points of soles, which have none, get some.
    """
    model = stance.robot.model.copy()
    model.gravity.linear = np.array([0.0, 0.0, -stance.gravity])
    frames = {foot.name: _frame(model, foot) for foot in stance.contacts}
    data = model.createData()
    torques = np.empty_like(state.torques)
    moves = {name: (np.empty((len(state.times), 3)), np.empty((len(state.times), 3))) for name in frames}
    rows = zip(state.positions, state.velocities, state.accelerations, strict=True)
    for index, (q, v, a) in enumerate(rows):
        torques[index] = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name, frame in frames.items():
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
            torques[index] -= jacobian.T @ state.forces[name][index]
            moves[name][0][index] = data.oMf[frame].translation
            moves[name][1][index] = jacobian @ v
    return torques, moves


def _frame(model: Any, foot: Foot) -> int:
    """Number of a foot's frame in a model; one more where it is a point of a sole."""
    if not foot.suffix:
        return int(model.getFrameId(foot.frame))
    placement = pin.SE3(np.eye(3), np.array(foot.local))
    return int(model.addFrame(pin.Frame(foot.name, foot.body, 0, placement, pin.FrameType.OP_FRAME)))


def _dynamics(jump: SpatialJumpMotion, stance: SpatialStance, state: JumpState) -> Iterator[Value]:
    """Balance of forces, shares of limits, joint ranges, and whether derivatives belong to the positions."""
    robot = stance.robot
    problem = jump.problem
    weight = robot.mass * stance.gravity
    model = robot.model
    com_height = float(pin.centerOfMass(model, model.createData(), state.positions[0])[2]) - stance.ground
    lever = com_height if com_height > 0 else float(np.finfo(float).tiny)  # what is not above the ground is no stance
    torques, moves = _torques(stance, state)
    scales = np.repeat([weight, weight * lever], 3)
    yield "residual", (np.abs(torques[:, :BASE]) / scales).max()
    yield "residual", np.abs(torques - state.torques)[:, BASE:].max() / (weight * lever)
    for name, shares in limit_shares(problem, state).items():
        yield name, shares.max(initial=0.0)
    yield "torque", np.abs(torques @ robot.selection / problem.torque_limits).max()
    joints = planned_joints(robot, state)[0]
    low, high = np.asarray(problem.position_limits).T
    yield "range", np.minimum(joints - low, high - joints).min()
    for places, velocities in moves.values():
        yield "drift", float(np.ptp(places, axis=0).max())
        yield "foot_speed", float(np.linalg.norm(velocities, axis=1).max())
    yield from _derivatives(state)


def _derivatives(state: JumpState) -> Iterator[Value]:
    """By how much rates and accelerations differ from differences of positions and rates."""
    steps = np.diff(state.times)[:, None]
    rotations = of_quaternions(state.positions[:, 3:JOINTS])
    speed = np.einsum("nij,nj->ni", rotations, state.velocities[:, :3])
    turned = [pin.log3(one.T @ two) for one, two in itertools.pairwise(rotations)]
    pairs = (
        (np.diff(state.positions[:, :3], axis=0), speed),
        (np.array(turned), state.velocities[:, 3:BASE]),
        (np.diff(state.positions[:, JOINTS:], axis=0), state.velocities[:, BASE:]),
        (np.diff(state.velocities, axis=0), state.accelerations),
    )
    for differences, derivative in pairs:
        mean = (derivative[1:] + derivative[:-1]) / 2
        yield "derivative", np.abs(mean - differences / steps).max() / (np.abs(derivative).max() + 1e-9)


def _feet(jump: SpatialJumpMotion, stance: SpatialStance, state: JumpState) -> Iterator[Value]:
    """Friction cone and pressure of what is on the ground."""
    weight = stance.robot.mass * stance.gravity
    friction = jump.request.friction
    for force in state.forces.values():
        horizontal = np.linalg.norm(force[:, :2], axis=1)
        vertical = force[:, 2]
        pressed = vertical > LIGHT * weight
        yield "friction", (horizontal[pressed] / vertical[pressed]).max(initial=0.0)
        yield "slip", (horizontal - friction * np.maximum(vertical, 0)).max() / weight
        yield "pull", vertical.min() / weight


def _surroundings(
    jump: SpatialJumpMotion, state: JumpState, ground: float, standing: Sequence[Foot]
) -> Iterator[Value]:
    """Heights over the ground, m, by the links' solids; least distances from obstacles, and between links."""
    robot = jump.robot
    poses = poses_of(robot, state_of(robot, state))
    feet = feet_links(robot, [foot for stance in jump.stances for foot in stance.contacts])
    stands = feet_links(robot, standing)
    yield "ground", np.inf
    yield "feet", np.inf
    yield "lifted", 0.0
    for link, heights in _heights(robot, poses).items():
        yield "feet" if link in feet else "ground", (heights - ground).min()
        if link in stands:
            yield "lifted", (heights - ground).max()
    segments = shapes_in_space(robot).place(poses)
    links = np.array([capsule.link for capsule in robot.solid_capsules])
    for pair in jump.problem.self_clearances:
        first, second = (segments.of(np.flatnonzero(links == link)) for link in pair.links)
        yield "self_distance", pair_distances_in_space(first, second).min() - pair.margin
    for obstacle in jump.problem.obstacles:
        least = least_distances(segments, obstacle, state.times - jump.takeoff_time).min() - obstacle.margin
        if np.isfinite(least):
            yield "obstacles", least


def _heights(robot: Robot, poses: BodyPoses) -> dict[str, Array]:
    """Heights (N,) of the lowest point of each link, m."""
    heights: dict[str, Array] = {}
    for solid in robot.solids:
        own = poses.lowest(solid)
        heights[solid.link] = np.minimum(heights[solid.link], own) if solid.link in heights else own
    return heights


def _touchdown(jump: SpatialJumpMotion) -> Iterator[Value]:
    """Least heights over the ground of all but feet of a robot that lands turned by the pitch error about its feet.

    The robot is turned as a rigid body, about either horizontal axis and either way, until its lowest foot is on the
    ground.
    """
    error = jump.request.pitch_error
    if not error:
        return
    robot = jump.robot
    feet = list({foot.frame: foot for foot in jump.contacts}.values())
    links = feet_links(robot, feet)
    landing = jump.after[0].span[0]
    for stance in jump.after:
        begin = stance.span[0]
        end = min(stance.span[1], landing + TOUCHDOWN)
        if begin >= end:
            continue
        state = stance.at(np.linspace(begin, end, int((end - begin) * RATE) + 2))
        poses = poses_of(robot, state_of(robot, state))
        for axis in np.vstack((np.eye(3)[:2], -np.eye(3)[:2])):
            rotation = pin.exp3(error * axis)
            turned = BodyPoses(poses.places @ rotation.T, rotation @ poses.rotations)
            ground = np.min(
                [turned.points(foot.body, np.array([foot.local]))[:, 0, 2] - foot.depth for foot in feet], axis=0
            )
            for link, heights in _heights(robot, turned).items():
                if link not in links:
                    yield "touchdown", (heights - ground).min()


def _seams(jump: SpatialJumpMotion) -> Iterator[Value]:
    """Steps of positions, rates and accelerations at the flight's ends and between stances; what moves at both ends."""
    assert jump.flight is not None
    flight = jump.flight
    limits = jump.problem.motor_torque_limits
    unit = float(np.sqrt(1.0 / jump.problem.flight.gravity))
    takeoff = flight_state(flight, 0.0, np.array([0.0]))
    landing = flight_state(flight, 0.0, np.array([flight.duration]))
    seams = [("takeoff_seam", jump.before[-1], 1, takeoff), ("landing_seam", jump.after[0], 0, landing)]
    yield "gap", abs(jump.before[0].span[0])
    yield "gap", abs(jump.takeoff_time + flight.duration - jump.after[0].span[0])
    for one, two in itertools.chain(itertools.pairwise(jump.before), itertools.pairwise(jump.after)):
        seams.append(("junction", one, 1, two.at(np.array(two.span[:1]))))
        yield "gap", abs(one.span[1] - two.span[0])
    around = np.array([-2e-3, 2e-3])  # s: two steps of a controller at 500 Hz
    for name, stance, end, other in seams:
        yield name, _step(stance.at(np.array([stance.span[end]])), other, unit)
        times = np.clip(stance.span[end] + around, 0.0, jump.duration)
        change = np.diff(jump.at(times).torques @ jump.robot.transmission, axis=0) / limits
        yield "torque_step", np.abs(change).max()
    for stance, end in ((jump.before[0], 0), (jump.after[-1], 1)):
        state = stance.at(np.array([stance.span[end]]))
        yield "rest", max(np.abs(state.velocities).max() * unit, np.abs(state.accelerations).max() * unit**2)


def _step(one: JumpState, other: JumpState, unit: float) -> float:
    """Largest step of poses, rates and accelerations, over the time unit."""
    first, second = (of_quaternions(state.positions[:, 3:JOINTS])[0] for state in (one, other))
    turned = np.abs(pin.log3(first.T @ second)).max()
    moved = np.abs(np.delete(one.positions - other.positions, range(3, JOINTS), axis=1)).max()
    rates = np.abs(one.velocities - other.velocities).max() * unit
    accelerations = np.abs(one.accelerations - other.accelerations).max() * unit**2
    return float(max(turned, moved, rates, accelerations))
