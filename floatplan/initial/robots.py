"""Which plane, joints and couplings of a robot a first flight takes; its feet, by names and by where the links are."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.errors import InputError, naming
from floatplan.motion.flight import frame_from_com
from floatplan.problem.parts import JointState
from floatplan.problem.resolution import lowest_point
from floatplan.robot.leak import MEANINGLESS, out_of_plane_leak
from floatplan.robot.robot import Robot
from floatplan.robot.source import read_source
from floatplan.robot.urdf.check import check_urdf
from floatplan.robot.urdf.tree import reference_postures, urdf_path

PLANES = ("xz", "yz", "xy")
POSTURES = ("standing", "half_sitting", "homing", "home", "default")  # how the names of reference postures begin
FOOT_WORDS = ("sole", "foot(?!print)", "toe", "ankle")  # the first that a link's name holds goes before others
NOT_FEET = re.compile("imu|sensor|wheel|caster|torso|virtual", re.IGNORECASE)
LEG_JOINTS = 2  # [-] planned, at least, of a leg that no name tells
SMALLEST = 1e-3  # [m] that a robot stands high
ROUNDING = 1e-6  # [m] that meshes' heights differ by
BELOW = 0.15  # [-] of the robot's height: a limb that ends so near to its lowest point is a leg
LIGHT = 0.01  # [-] of the robot's mass: joints that carry less, such as fingers, stay locked


@dataclass(frozen=True, eq=False)
class ChosenRobot:
    """A robot, the keys of ``[robot]`` beside ``urdf`` that choose it, and its feet, the rearmost first."""

    robot: Robot
    choices: Mapping[str, Any]
    feet: tuple[str, ...]


def chosen_robot(source: str | Path) -> ChosenRobot:
    """Load a robot with left and right coupled, in the plane in which its legs bend, in its standing posture.

    Raises
    ------
    InputError
        The file is not a sound URDF, or in none of the planes does the robot keep to it.
    """
    with naming(urdf_path(source)):
        posture = _posture(source)
    tried: list[ChosenRobot] = []
    errors: list[InputError] = []
    for plane in (None, *PLANES):
        for coupled in ({"coupled": "mirror"}, {}):
            try:
                tried.append(_loaded(source, {**({"plane": plane} if plane else {}), **coupled, **posture}))
            except InputError as error:
                errors.append(error)
                continue
            break
        if tried and plane is None and _merit(tried[0])[:2] >= (True, LEG_JOINTS):
            break
    if not tried:
        raise errors[0]
    return max(tried, key=_merit)


def _merit(chosen: ChosenRobot) -> tuple[bool, int, float, int]:
    """Keeps to its plane, then how many joints its legs have, then whether the plane is the only one, then joints."""
    robot = chosen.robot
    legs = max((np.count_nonzero(robot.tree.turns[robot.frames[foot].body]) for foot in chosen.feet), default=0)
    keeps = out_of_plane_leak(robot) < MEANINGLESS
    return keeps, int(legs), float("plane" not in chosen.choices), len(robot.joints)


def _loaded(source: str | Path, choices: dict[str, Any]) -> ChosenRobot:
    robot = Robot.from_file(source, **choices)
    carried = robot.tree.mass @ (robot.tree.turns != 0)  # kg, of the bodies that each planned joint turns
    kept = [joint for joint, mass in zip(robot.joints, carried, strict=True) if mass >= LIGHT * robot.mass]
    if kept and len(kept) < len(robot.joints):
        choices = {**choices, "joints": kept}
        robot = Robot.from_file(source, **choices)
    return ChosenRobot(robot, choices, feet(robot))


def _posture(source: str | Path) -> dict[str, str]:
    """The reference posture to stand in, where the robot has one."""
    text = read_source(urdf_path(source))
    known = reference_postures(check_urdf(text.root), text)
    fitting = [name for word in POSTURES for name in known if name.startswith(word)]
    return {"reference": fitting[0]} if fitting else {}


def feet(robot: Robot) -> tuple[str, ...]:
    """Return the frames that the robot can stand on, one for each leg that moves on its own; the rearmost first.

    Of a pair it is the foot that reaches lower: meshes of left and right may differ by a tenth of a millimetre.

    A foot is on a body that carries no other. It is the link whose name says so; where no name does, the end of a limb
    that has a mirror image and reaches down to the lowest point.
    """
    tree = robot.tree
    ends = [body for body in range(len(tree.names)) if body not in tree.parent[1:] or not body]
    named = {body: name for body in ends if (name := _named(robot, body))}
    alike = (tree.turns[:, None] == tree.turns).all(axis=2).sum(axis=1)  # bodies that turn as each one does
    limbs = (np.count_nonzero(tree.turns, axis=1) >= LEG_JOINTS) & (alike > 1)  # of which there is another side's
    found = named or _lowest(robot, [body for body in ends if limbs[body]])
    reaching = [_reaching_down(robot, body, frame) for body, frame in found.items()]
    distinct: dict[tuple[float, ...], str] = {}
    for frame in sorted(reaching, key=lambda frame: _lowest_height(robot, frame)):
        distinct.setdefault(tuple(tree.turns[robot.frames[frame].body].tolist()), frame)
    return tuple(sorted(distinct.values(), key=lambda frame: round(_place(robot, frame).real, 3)))


def upright(robot: Robot, foot: str) -> float:
    """Orientation, rad, in which the robot stands on a foot: turned only where the foot is on the base itself."""
    on_base = robot.frames[foot].body == 0
    return float(robot.tree.turn * (np.pi / 2 - np.angle(-_place(robot, foot)))) if on_base else 0.0


def standing_height(robot: Robot, foot: str) -> float:
    """Height of the centre of mass over the ground on which the robot stands on a foot, m, in its resting posture."""
    standing = replace(_resting(robot), orientation=upright(robot, foot))
    return max(-lowest_point(robot, foot, standing), SMALLEST)


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
    return lowest_point(robot, link, _resting(robot))


def _resting(robot: Robot) -> JointState:
    return JointState(0.0, robot.resting, *np.zeros((2, len(robot.joints))))


def _place(robot: Robot, frame: str) -> complex:
    """Place relative to the centre of mass in the resting posture, m."""
    return frame_from_com(robot, robot.frames[frame], _resting(robot))
