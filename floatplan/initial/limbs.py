"""Feet, and the upright posture on them: found by names and by where the links are."""

from __future__ import annotations

import re

import numpy as np

from floatplan.arrays import ComplexArray
from floatplan.motion.planar.ballistics import frame_weights
from floatplan.problem.checks import lowest_point
from floatplan.problem.parts import JointState
from floatplan.robot.robot import Robot

FOOT_WORDS = ("sole", "foot(?!print)", "toe", "ankle")  # the first that a link's name holds goes before others
NOT_FEET = re.compile("imu|sensor|wheel|caster|torso|virtual", re.IGNORECASE)
LEG_JOINTS = 2  # [-] planned, at least, of a leg that no name tells
ROUNDING = 1e-6  # [m]
BELOW = 0.15  # [-] of the robot's height: a limb that ends so near to its lowest point is a leg


def feet(robot: Robot) -> tuple[str, ...]:
    """Return the frames that the robot can stand on, one for each leg that moves on its own; the rearmost first.

    Of a pair it is the foot that reaches lower: meshes of left and right may differ by a tenth of a millimetre.

    A foot is on a body that carries no other. It is the link whose name says so; where no name does, the end of a limb
    that has a mirror image and reaches down to the lowest point.
    """
    tree = robot.tree
    ends = [body for body in range(len(tree.names)) if body not in tree.parent[1:] or not body]
    named = {body: name for body in ends if (name := _named(robot, body))}
    found = named or _lowest(robot, [body for body in ends if _is_limb(robot, body)])
    reaching = [_reaching_down(robot, body, frame) for body, frame in found.items()]
    distinct: dict[tuple[float, ...], str] = {}
    for frame in sorted(reaching, key=lambda frame: _lowest_height(robot, frame)):
        distinct.setdefault(tuple(tree.turns[robot.frames[frame].body].tolist()), frame)
    places = {frame: _place(robot, frame) for frame in distinct.values()}
    return tuple(sorted(places, key=lambda frame: round(places[frame].real, 3)))


def upright(robot: Robot, foot: str) -> float:
    """Orientation, rad, in which the robot stands on a foot: turned only where the foot is on the base itself."""
    if robot.frames[foot].body:
        return 0.0
    place = -_place(robot, foot)
    return float(robot.tree.turn * (np.pi / 2 - np.angle(place)))


def links_of(robot: Robot, body: int) -> list[str]:
    """Names of the links fixed to a body, in the order of the file."""
    return [link for link, home in robot.layout.body_of.items() if home == body and link in robot.frames]


def _named(robot: Robot, body: int) -> str | None:
    """The link of a body whose name is that of a foot; of several the one farthest from the body's joint."""
    links = [link for link in links_of(robot, body) if not NOT_FEET.search(link)]
    for word in FOOT_WORDS:
        matching = [link for link in links if re.search(word, link, re.IGNORECASE)]
        if matching:
            return max(matching, key=lambda link: abs(robot.frames[link].local))
    return None


def _lowest(robot: Robot, bodies: list[int]) -> dict[int, str]:
    """Of bodies the ends of those that reach down to the robot's lowest point."""
    farthest = {body: max(links_of(robot, body), key=lambda link: abs(robot.frames[link].local)) for body in bodies}
    heights = {body: _place(robot, link).imag for body, link in farthest.items()}
    every = [_place(robot, frame).imag for frame in robot.frames]
    reach = min(every) + BELOW * (max(every) - min(every))
    return {body: link for body, link in farthest.items() if heights[body] <= reach}


def _reaching_down(robot: Robot, body: int, frame: str) -> str:
    """The link itself, or that of its body which reaches lower, where shapes around meshes do."""
    links = [frame, *(link for link in links_of(robot, body) if any(shape.link == link for shape in robot.shapes))]
    lowest = min(links, key=lambda link: _lowest_height(robot, link))
    return lowest if _lowest_height(robot, lowest) < _lowest_height(robot, frame) - ROUNDING else frame


def _lowest_height(robot: Robot, link: str) -> float:
    """Height of the lowest point with which a link stands over the centre of mass, in the resting posture, m."""
    return lowest_point(robot, link, JointState(0.0, robot.resting, *np.zeros((2, len(robot.joints)))))


def _is_limb(robot: Robot, body: int) -> bool:
    """Whether a body hangs on joints enough, and another one turns with the same planned joints: the other side's."""
    turns = robot.tree.turns
    mirrored = sum(np.array_equal(turns[body], other) for other in turns) > 1
    return bool(mirrored and np.count_nonzero(turns[body]) >= LEG_JOINTS)


def _place(robot: Robot, frame: str) -> complex:
    """Place relative to the centre of mass in the resting posture, m."""
    return complex(_rotations(robot) @ frame_weights(robot, robot.frames[frame]))


def _rotations(robot: Robot) -> ComplexArray:
    return robot.tree.rotations(robot.tree.absolute_angles(np.array(0.0), robot.resting))
