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
from floatplan.robot.standing import corners, heights_over_com, undersides
from floatplan.robot.wheels import wheels

FOOT_WORDS = ("sole", "foot(?!print)", "toe", "ankle")  # the first that a link's name holds goes before others
NOT_FEET = re.compile("imu|sensor|wheel|caster|torso|virtual", re.IGNORECASE)
SMALLEST = 1e-3  # [m] that a robot stands high
ROUNDING = 1e-6  # [m] that meshes' heights differ by
BELOW = 0.15  # [-] of the robot's height: a limb that ends so near to its lowest point is a leg


def feet(robot: Robot, asked: str | None = None) -> tuple[str, ...]:
    """Return the frames that the robot can stand on, one for each leg that moves on its own; the rearmost first.

    A foot is the end of a limb, on a body that carries no other and is no wheel, and reaches about as low as anything
    in the reference posture. Where names of links are those of feet, these are legs and other limbs are not; where none
    is, all are if the robot could stand on them as it is: its centre of mass is over their span. Of a pair it is the
    foot that reaches lower: meshes of left and right may differ by a tenth of a millimetre. A frame that is ``asked``
    is one whatever it looks like, in place of that on the same leg.
    """
    tree, bottom = robot.tree, _bottoms(robot)
    rolling = {robot.layout.body_of[link] for link in wheels(robot).values()}
    ends = [body for body in range(len(tree.names)) if not body or body not in {*tree.parent[1:].tolist(), *rolling}]
    named = {body: _reaching_down(robot, body, name, bottom) for body in ends if (name := named_foot(robot, body))}
    others = {body: _lowest(robot, body, bottom) for body in ends if body}
    top, lowest = max(place(robot, frame).imag for frame in robot.frames), min(bottom.values())
    room = BELOW * (top - lowest)
    low = [{body: frame for body, frame in of.items() if bottom[frame] <= lowest + room} for of in (named, others)]
    legs = low[0] or named or (low[1] if lowest < -SMALLEST and _over(robot, low[1].values(), room) else {})
    distinct: dict[tuple[float, ...], str] = {}
    if asked is not None and asked in robot.frames:
        distinct[tuple(tree.turns[robot.frames[asked].body].tolist())] = asked
    for body, frame in sorted(legs.items(), key=lambda leg: bottom[leg[1]]):
        distinct.setdefault(tuple(tree.turns[body].tolist()), frame)
    return tuple(sorted(distinct.values(), key=lambda frame: round(place(robot, frame).real, 3)))


def wheel_feet(robot: Robot) -> tuple[str, ...]:
    """Return the wheels, held by their joints, on which legs that step stand, one for each; the rearmost first."""
    tree, bottom = robot.tree, _bottoms(robot)
    carrying = {*tree.parent[1:].tolist()}
    distinct: dict[tuple[float, ...], str] = {}
    for name, link in sorted(wheels(robot).items(), key=lambda wheel: bottom.get(wheel[1], np.inf)):
        body = robot.layout.body_of[link]
        held = name in robot.locked and body not in carrying
        if held and link in robot.link_hulls and Leg(robot, link, robot.resting).steps:
            distinct.setdefault(tuple(tree.turns[body].tolist()), link)
    return tuple(sorted(distinct.values(), key=lambda frame: round(place(robot, frame).real, 3)))


def upright(robot: Robot, foot: str) -> float:
    """Orientation, rad, in which the robot stands on a foot: turned only where the foot is on the base itself."""
    on_base = robot.frames[foot].body == 0
    return float(robot.tree.turn * (np.pi / 2 - np.angle(-place(robot, foot)))) if on_base else 0.0


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
    links = [link for link in links_of(robot, body) if not NOT_FEET.search(link)]
    for word in FOOT_WORDS:
        matching = [link for link in links if re.search(word, link, re.IGNORECASE)]
        if matching:
            return max(matching, key=lambda link: abs(robot.frames[link].local))
    return None


def _bottoms(robot: Robot) -> dict[str, float]:
    """Heights of the lowest points with which links stand over the centre of mass, in the resting posture, m."""
    shaped = {link: corners(hull) for link, hull in robot.link_hulls.items() if hull}
    under = iter(undersides(robot, [spot for spots in shaped.values() for spot in spots], _posture(robot)).tolist())
    own = {link: min(next(under) for _ in spots) for link, spots in shaped.items()}
    standing = {link: robot.contact_link(link) for link in robot.layout.body_of if link in robot.frames}
    return {link: place(robot, link).imag if on is None else own[on] for link, on in standing.items()}


def _lowest(robot: Robot, body: int, bottom: Mapping[str, float]) -> str:
    """The link of a body that reaches lowest; of those that stand on one shape, that whose frame is lowest."""
    links = [link for link in links_of(robot, body) if robot.contact_link(link) in (None, *robot.touching_links)]
    reach = min(bottom[link] for link in links) + ROUNDING
    return min((link for link in links if bottom[link] <= reach), key=lambda link: place(robot, link).imag)


def _over(robot: Robot, frames: Iterable[str], room: float) -> bool:
    """Whether the centre of mass is over the span of links, or no farther from it than the room, m."""
    spots = [corner for frame in frames for corner in corners(robot.link_hulls.get(frame, ()))]
    along = heights_over_com(robot, spots, _posture(robot)).real if spots else np.array([np.inf])
    return bool(along.min() - room <= 0 <= along.max() + room)


def _reaching_down(robot: Robot, body: int, frame: str, bottom: Mapping[str, float]) -> str:
    """The link itself, or that of its body which reaches lower, where shapes around meshes do."""
    shaped = [link for link in links_of(robot, body) if link in robot.touching_links]
    lowest = min((frame, *shaped), key=lambda link: bottom[link])
    return lowest if bottom[lowest] < bottom[frame] - ROUNDING else frame


def _posture(robot: Robot) -> Array:
    return np.append(0.0, robot.resting)


def _state(robot: Robot, positions: Array | None) -> JointState:
    """The base level and all at rest, in the resting posture or in another one."""
    at = robot.resting if positions is None else positions
    return JointState(0.0, at, *np.zeros((2, len(robot.joints))))


def place(robot: Robot, frame: str, positions: Array | None = None) -> complex:
    """Return a frame's place relative to the centre of mass, m, in the resting posture or in another one (n,), rad."""
    return frame_from_com(robot, robot.frames[frame], _state(robot, positions))
