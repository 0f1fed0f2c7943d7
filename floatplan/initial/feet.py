"""What a robot stands on: ends of limbs that reach as low as anything; names tell legs from arms that reach as low."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.initial.legs import Leg
from floatplan.motion.flight import frame_from_com
from floatplan.problem.parts import JointState
from floatplan.problem.resolution import lowest_point
from floatplan.robot.robot import Robot
from floatplan.robot.standing import Spot, corners, positions_from_com, undersides
from floatplan.robot.wheels import wheels

SMALLEST = 1e-3  # [m] height of a robot that stands
ROUNDING = 1e-6  # [m] by which heights of meshes may differ


def feet(robot: Robot, requested: str | None = None) -> tuple[str, ...]:
    """Return the frames that the robot can stand on, one for each leg that moves on its own; the rearmost first.

    A foot is the end of a limb, on a body that carries no other and is no wheel, and reaches about as low as anything
    in the reference posture. Where names of links are those of feet, these are legs and other limbs are not; where none
    is, all are if the robot could stand on them as it is: its centre of mass is over their span. Of a pair it is the
    foot that reaches lower: meshes of left and right may differ by a tenth of a millimetre. A ``requested`` frame is
    one whatever it looks like, instead of that on the same leg.
    """
    tree = robot.tree
    bottom = _bottoms(robot)
    lowest = min(bottom.values())
    top = max(position(robot, frame).imag for frame in robot.frames)
    near = 0.15 * (top - lowest)  # [m] a limb that ends so near to the lowest point is a leg
    named: dict[int, str] = {}
    others: dict[int, str] = {}
    not_ends = {*tree.parent[1:].tolist(), *(robot.layout.body_of[link] for link in wheels(robot).values())}
    for body in range(len(tree.names)):
        if body and body in not_ends:
            continue
        name = named_foot(robot, body)
        if name:
            named[body] = _reaching_down(robot, body, name, bottom)
        if body:
            others[body] = _lowest(robot, body, bottom)
    legs = _low(named, bottom, lowest + near) or named
    if not legs and lowest < -SMALLEST:
        low_limbs = _low(others, bottom, lowest + near)
        if _over(robot, low_limbs.values(), near):
            legs = low_limbs
    distinct: dict[tuple[float, ...], str] = {}  # by how they rotate: one of left and right
    if requested is not None and requested in robot.frames:
        distinct[tuple(tree.turns[robot.frames[requested].body].tolist())] = requested
    for body, frame in sorted(legs.items(), key=lambda leg: bottom[leg[1]]):
        distinct.setdefault(tuple(tree.turns[body].tolist()), frame)
    return _rearmost_first(robot, distinct.values())


def _low(frames: Mapping[int, str], bottom: Mapping[str, float], most: float) -> dict[int, str]:
    """Frames, by body, that reach as low as a height, m."""
    return {body: frame for body, frame in frames.items() if bottom[frame] <= most}


def _rearmost_first(robot: Robot, frames: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(frames, key=lambda frame: round(position(robot, frame).real, 3)))


def wheel_feet(robot: Robot) -> tuple[str, ...]:
    """Return the locked wheels on which legs that step stand, one for each; the rearmost first."""
    tree = robot.tree
    bottom = _bottoms(robot)
    carrying = {*tree.parent[1:].tolist()}
    distinct: dict[tuple[float, ...], str] = {}
    for name, link in sorted(wheels(robot).items(), key=lambda wheel: bottom.get(wheel[1], np.inf)):
        body = robot.layout.body_of[link]
        is_locked = name in robot.locked and body not in carrying
        if is_locked and link in robot.link_hulls and Leg(robot, link, robot.resting).steps:
            distinct.setdefault(tuple(tree.turns[body].tolist()), link)
    return _rearmost_first(robot, distinct.values())


def upright(robot: Robot, foot: str) -> float:
    """Orientation, rad, in which the robot stands on a foot: 0 unless the foot is on the base itself."""
    if robot.frames[foot].body != 0:
        return 0.0
    return float(robot.tree.turn * (np.pi / 2 - np.angle(-position(robot, foot))))


def standing_height(robot: Robot, foot: str, positions: Array | None = None) -> float:
    """Height of the centre of mass over the ground on which the robot stands on a foot, m.

    It is in the resting posture, or in that of planned positions (n,), rad.
    """
    standing = replace(_state(robot, positions), orientation=upright(robot, foot))
    return max(-lowest_point(robot, foot, standing), SMALLEST)


def links_of(robot: Robot, body: int) -> list[str]:
    """Names of the links fixed to a body, in the order of the file."""
    return [link for link, home in robot.layout.body_of.items() if home == body and link in robot.frames]


def named_foot(robot: Robot, body: int) -> str | None:
    """Return the link of a body whose name is that of a foot; of several the one farthest from the body's joint."""
    others = "imu|sensor|wheel|caster|torso|virtual"
    links = [link for link in links_of(robot, body) if not re.search(others, link, re.IGNORECASE)]
    for word in ("sole", "foot(?!print)", "toe", "ankle"):  # the first in a link's name goes before others
        matching = [link for link in links if re.search(word, link, re.IGNORECASE)]
        if matching:
            return max(matching, key=lambda link: abs(robot.frames[link].local))
    return None


def _bottoms(robot: Robot) -> dict[str, float]:
    """Heights of the lowest points with which links stand over the centre of mass, in the resting posture, m."""
    spots: list[Spot] = []
    owners: list[str] = []
    for link, hull in robot.link_hulls.items():
        of_link = corners(hull)
        spots += of_link
        owners += [link] * len(of_link)
    lowest: dict[str, float] = {}
    for link, height in zip(owners, undersides(robot, spots, _posture(robot)).tolist(), strict=True):
        lowest[link] = min(height, lowest.get(link, np.inf))
    bottoms = {}
    for link in robot.layout.body_of:
        if link in robot.frames:
            contact = robot.contact_link(link)
            bottoms[link] = position(robot, link).imag if contact is None else lowest[contact]
    return bottoms


def _lowest(robot: Robot, body: int, bottom: Mapping[str, float]) -> str:
    """The link of a body that reaches lowest; of those that stand on one shape, that whose frame is lowest."""
    links = [link for link in links_of(robot, body) if robot.contact_link(link) in (None, *robot.touching_links)]
    reach = min(bottom[link] for link in links) + ROUNDING
    lowest = [link for link in links if bottom[link] <= reach]
    return min(lowest, key=lambda link: position(robot, link).imag)


def _over(robot: Robot, frames: Iterable[str], near: float) -> bool:
    """Whether the centre of mass is over the span of links, or ``near`` to it, m."""
    spots = []
    for frame in frames:
        spots += corners(robot.link_hulls.get(frame, ()))
    if not spots:
        return False
    along = positions_from_com(robot, spots, _posture(robot)).real
    return bool(along.min() - near <= 0 <= along.max() + near)


def _reaching_down(robot: Robot, body: int, frame: str, bottom: Mapping[str, float]) -> str:
    """The link itself, or that of its body which reaches lower, where shapes around meshes do."""
    shaped = [link for link in links_of(robot, body) if link in robot.touching_links]
    lowest = min((frame, *shaped), key=lambda link: bottom[link])
    return lowest if bottom[lowest] < bottom[frame] - ROUNDING else frame


def _posture(robot: Robot) -> Array:
    return np.append(0.0, robot.resting)


def _state(robot: Robot, positions: Array | None) -> JointState:
    """The base level and no rates, in the resting posture or in another one."""
    zero = np.zeros(len(robot.joints))
    return JointState(0.0, robot.resting if positions is None else positions, zero, zero)


def position(robot: Robot, frame: str, positions: Array | None = None) -> complex:
    """Return a frame's position relative to the centre of mass, m, in the resting posture or in another (n,), rad."""
    return frame_from_com(robot, robot.frames[frame], _state(robot, positions))
