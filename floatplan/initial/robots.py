"""Which plane, joints and couplings of a robot a first flight takes."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.errors import InputError, naming
from floatplan.initial.feet import feet, named_foot
from floatplan.robot.leak import MEANINGLESS, out_of_plane_leak
from floatplan.robot.robot import Robot
from floatplan.robot.source import read_source
from floatplan.robot.urdf.check import Changes, taken_urdf
from floatplan.robot.urdf.srdf import reference_postures
from floatplan.robot.urdf.tree import urdf_path

PLANES = ("xz", "yz", "xy")
POSTURES = ("standing", "half_sitting", "homing", "home", "default")  # how the names of reference postures begin
LEG_JOINTS = 2  # [-] planned, at least, of a leg that no name tells
ALIKE = 1e-6  # [kg, m, kg m^2, rad] bodies that differ by no more are alike
LIGHT = 0.01  # [-] of the robot's mass: joints that carry less, such as fingers, stay locked


@dataclass(frozen=True, eq=False)
class ChosenRobot:
    """A robot, the keys of ``[robot]`` beside its file that choose it, and its feet, the rearmost first."""

    robot: Robot
    choices: Mapping[str, Any]
    feet: tuple[str, ...]


def chosen_robot(source: str | Path, given: Mapping[str, Any] | None = None, foot: str | None = None) -> ChosenRobot:
    """Load a robot with left and right coupled, in the plane in which its legs bend, in its standing posture.

    What is ``given`` of the arguments of ``Robot.from_urdf`` is settled; ``foot`` is one that it stands on.

    Raises
    ------
    InputError
        The file is not sound, or in none of the planes does the robot keep to it.
    """
    given = given or {}
    if "locked" in given and "coupled" not in given:
        free = chosen_robot(source, {key: value for key, value in given.items() if key != "locked"}, foot)
        _refuse_halves(free.robot, given["locked"])
    with naming(urdf_path(source)):
        posture = {} if "reference" in given else _posture(source, bool(given.get("balance_inertias")))
    tried: list[ChosenRobot] = []
    errors: list[InputError] = []
    for plane in [None] if "plane" in given else (None, *PLANES):
        for coupled in [{}] if "coupled" in given else ({"coupled": "mirror"}, {}):
            choices = {**({"plane": plane} if plane else {}), **coupled, **posture, **given}
            try:
                found = _loaded(source, choices, foot)
                pairs = {} if "coupled" in choices else side_by_side(found.robot)
                tried.append(_loaded(source, {**choices, "coupled": pairs}, foot) if pairs else found)
            except InputError as error:
                errors.append(error)
                continue
            break
        if tried and plane is None and _merit(tried[0])[:2] >= (True, LEG_JOINTS):
            break
    if not tried:
        raise errors[0]
    return max(tried, key=_merit)


def _refuse_halves(robot: Robot, locked: Mapping[str, float]) -> None:
    """Refuse to lock a joint whose mirror image would move."""
    own = {name: each.leader for name, each in robot.coupled.items() if robot.layout.tree.joint[name].mimic is None}
    for name, other in [*own.items(), *((leader, follower) for follower, leader in own.items())]:
        if name in locked and other not in locked:
            reason = f"{other!r}, its mirror image, would move alone"
            raise InputError(reason, element=f'locked "{name}"', advice=f"lock {other!r} too")


def _merit(chosen: ChosenRobot) -> tuple[bool, int, float, int]:
    """Keeps to its plane; joints of its legs, those by name or in pairs; whether no other plane is as good; joints."""
    robot, turns = chosen.robot, chosen.robot.tree.turns
    bodies = [robot.frames[foot].body for foot in chosen.feet]
    sure = [each for each in bodies if named_foot(robot, each) or (turns == turns[each]).all(axis=1).sum() > 1]
    legs = max((np.count_nonzero(turns[body]) for body in sure), default=0)
    keeps = out_of_plane_leak(robot) < MEANINGLESS
    return keeps, int(legs), float("plane" not in chosen.choices), len(robot.joints)


def side_by_side(robot: Robot) -> dict[str, str]:
    """Return joints whose bodies are as others in the same places, as of legs in a planar model; with these joints."""
    tree, same = robot.tree, dict[int, int]()
    for body, other in combinations(range(1, len(tree.names)), 2):
        parents = [int(tree.parent[each]) for each in (body, other)]
        if body in same or other in same or same.get(parents[1], parents[1]) != parents[0]:
            continue
        ways = [tree.turns[each] - tree.turns[above] for each, above in zip((body, other), parents, strict=True)]
        own = (tree.anchor, tree.mass, tree.center, tree.inertia, tree.offsets)
        if all(abs(each[body] - each[other]) < ALIKE for each in own) and ways[0].sum() == ways[1].sum():
            same[other] = body
    joints = [robot.layout.tree.carrier[name].name for name in tree.names[1:]]
    return {joints[other - 1]: joints[body - 1] for other, body in same.items()}


def _loaded(source: str | Path, choices: dict[str, Any], foot: str | None) -> ChosenRobot:
    robot = Robot.from_file(source, **choices)
    carried = robot.tree.mass @ (robot.tree.turns != 0)  # kg, of the bodies that each planned joint turns
    kept = [joint for joint, mass in zip(robot.joints, carried, strict=True) if mass >= LIGHT * robot.mass]
    if kept and len(kept) < len(robot.joints):
        choices = {**choices, "joints": kept}
        robot = Robot.from_file(source, **choices)
    return ChosenRobot(robot, choices, feet(robot, foot))


def _posture(source: str | Path, balance_inertias: bool) -> dict[str, str]:
    """The reference posture to stand in, where the robot has one."""
    text = read_source(urdf_path(source), None, balance_inertias)
    text, tree = taken_urdf(text, Changes(balance_inertias=balance_inertias))
    known = reference_postures(tree, text)
    fitting = [name for word in POSTURES for name in known if name.startswith(word)]
    return {"reference": fitting[0]} if fitting else {}
