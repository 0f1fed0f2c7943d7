"""Which plane, joints and couplings of a robot a first flight takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.errors import InputError, naming
from floatplan.initial.limbs import LEG_JOINTS, feet
from floatplan.robot.leak import MEANINGLESS, out_of_plane_leak
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.check import check_urdf
from floatplan.robot.urdf.example_robots import urdf_path
from floatplan.robot.urdf.read import read_urdf, reference_postures

PLANES = ("xz", "yz", "xy")
POSTURES = ("standing", "half_sitting", "homing", "home", "default")  # how the names of reference postures begin
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
    options = [{"coupled": "mirror"}, {}]
    tried: list[ChosenRobot] = []
    errors: list[InputError] = []
    for plane in (None, *PLANES):
        for option in options:
            try:
                found = _loaded(source, {**({"plane": plane} if plane else {}), **option, **posture})
            except InputError as error:
                errors.append(error)
                continue
            tried.append(found)
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
    robot = Robot.from_urdf(source, **choices)
    kept = [joint for joint, mass in zip(robot.joints, _carried(robot), strict=True) if mass >= LIGHT * robot.mass]
    if kept and len(kept) < len(robot.joints):
        choices = {**choices, "joints": kept}
        robot = Robot.from_urdf(source, **choices)
    return ChosenRobot(robot, choices, feet(robot))


def _carried(robot: Robot) -> list[float]:
    """Mass, kg, of the bodies that each planned joint turns."""
    return [float(robot.tree.mass[robot.tree.turns[:, joint] != 0].sum()) for joint in range(len(robot.joints))]


def _posture(source: str | Path) -> dict[str, str]:
    """The reference posture to stand in, where the robot has one."""
    path = urdf_path(source)
    known = reference_postures(check_urdf(read_urdf(path).root), path)
    for word in POSTURES:
        for name in known:
            if name.startswith(word):
                return {"reference": name}
    return {}
