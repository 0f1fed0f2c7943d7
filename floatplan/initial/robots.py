"""Which plane, joints, couplings, feet and posture of a robot a first flight takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError, naming
from floatplan.initial.feet import feet, named_foot, wheel_feet
from floatplan.initial.legs import Leg
from floatplan.initial.standing import Standing, posture_fault, standing
from floatplan.problem.parts import Limits
from floatplan.problem.resolution import position_limits
from floatplan.robot.leak import MEANINGLESS, out_of_plane_leak
from floatplan.robot.planar.choice import LETTERS
from floatplan.robot.robot import Coupling, Robot
from floatplan.robot.source import read_source
from floatplan.robot.urdf.check import Changes, taken_urdf
from floatplan.robot.urdf.srdf import reference_postures
from floatplan.robot.urdf.tree import urdf_path
from floatplan.robot.wheels import wheels

PLANES = ("xz", "yz", "xy")  # where the file does not say which way is up
POSTURES = (  # how the names of reference postures begin, the likeliest to stand in first
    *("stand", "half_sitting", "crouch", "squat", "knees_bent"),
    *("homing", "home", "default"),
)
MOST_POSTURES = 8  # [-] of a file, that are looked at
LEG_JOINTS = 2  # [-] planned, at least, of a leg that no name tells
ALIKE = 1e-6  # [kg, m, kg m^2, rad] bodies that differ by no more are alike
LIGHT = 0.01  # [-] of the robot's mass: joints that carry less, such as fingers, stay locked


@dataclass(frozen=True, eq=False)
class ChosenRobot:
    """A robot for a first flight.

    Attributes
    ----------
    robot : Robot
    choices : the keys of ``[robot]`` beside its file that choose it
    feet : frames on which it stands, the rearmost first
    on_wheels : whether these are wheels that their joints hold
    stance : in which it stands before a jump; None is the reference posture
    postures : names of the first few reference postures of its file
    """

    robot: Robot
    choices: Mapping[str, Any]
    feet: tuple[str, ...]
    on_wheels: bool = False
    stance: Standing | None = None
    postures: tuple[str, ...] = ()

    @property
    def posture(self) -> Array:
        """Positions (n,), rad, in which it stands before a jump."""
        return self.robot.resting if self.stance is None else self.stance.positions

    @property
    def stepping(self) -> list[str]:
        """Names of the joints that bend the legs in the plane; none where they do not step in it."""
        legs = [Leg(self.robot, foot, self.robot.resting) for foot in self.feet]
        return list(dict.fromkeys(self.robot.joints[joint] for leg in legs if leg.steps for joint in leg.joints))


def chosen_robot(
    source: str | Path,
    given: Mapping[str, Any] | None = None,
    foot: str | None = None,
    posture: Mapping[str, float] | None = None,
) -> ChosenRobot:
    """Load a robot with left and right coupled, in the plane in which its legs step, in a posture to jump from.

    What is ``given`` of the arguments of ``Robot.from_urdf`` is settled; ``foot`` is one that it stands on;
    ``posture`` holds positions, rad, of planned joints, or of those that follow them, where it stands.

    Raises
    ------
    InputError
        The file is not sound, in none of the planes does the robot keep to it, or ``posture`` has what is no planned
        joint, or a position out of range.
    """
    given = given or {}
    if "locked" in given and "coupled" not in given:
        free = chosen_robot(source, {key: value for key, value in given.items() if key != "locked"}, foot)
        _refuse_halves(free.robot, given["locked"])
    known = _FromFile.read(source, bool(given.get("balance_inertias")))
    references = [] if "reference" in given else known.references
    reference = {"reference": references[0]} if references else {}
    chosen = _in_best_plane(source, given, reference, known.planes, foot)
    chosen = replace(chosen, postures=(*known.references, *known.others)[:MOST_POSTURES])
    if not chosen.feet:
        chosen = _on_wheels(source, chosen, given)
    others = [] if "reference" in given else [*references[1:], *known.others]
    return _standing(source, chosen, foot, posture or {}, others)


@dataclass(frozen=True)
class _FromFile:
    """What a robot's file says of the choice.

    ``references`` are the names of postures that a robot is likely to stand in, ``others`` those of all others, and
    ``planes`` all whose vertical is that of the file, where it has one.
    """

    references: list[str]
    others: list[str]
    planes: list[str]

    @classmethod
    def read(cls, source: str | Path, balance_inertias: bool) -> _FromFile:
        path = urdf_path(source)
        with naming(path):
            text = read_source(path, None, balance_inertias)
            text, tree = taken_urdf(text, Changes(balance_inertias=balance_inertias))
            known = reference_postures(tree, text)
        likely = list(dict.fromkeys(name for word in POSTURES for name in known if name.startswith(word)))
        planes = list(PLANES)
        if text.gravity_direction is not None:
            vertical = LETTERS[int(np.abs(text.gravity_direction).argmax())]
            planes = [f"{horizontal}{vertical}" for horizontal in LETTERS if horizontal != vertical]
        return cls(likely, [name for name in known if name not in likely], planes)


def _in_best_plane(
    source: str | Path,
    given: Mapping[str, Any],
    reference: Mapping[str, str],
    planes: Sequence[str],
    foot: str | None,
) -> ChosenRobot:
    """The robot in the plane that is given, or in the usual one; in another where its legs step in that alone."""
    tried: list[ChosenRobot] = []
    errors: list[InputError] = []
    for plane in [None] if "plane" in given else (None, *planes):
        for coupled in [{}] if "coupled" in given else ({"coupled": "mirror"}, {}):
            choices = {**({"plane": plane} if plane else {}), **coupled, **reference, **given}
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


def _on_wheels(source: str | Path, chosen: ChosenRobot, given: Mapping[str, Any]) -> ChosenRobot:
    """The robot on the wheels of legs that step, where it has such: their joints hold them, and are locked for that."""
    own = {name for name in wheels(chosen.robot) if name in (*chosen.robot.joints, *chosen.robot.coupled)}
    if not own or "joints" in given:
        return chosen
    choices = {**chosen.choices, "locked": {**dict.fromkeys(sorted(own), 0.0), **chosen.choices.get("locked", {})}}
    if "joints" in choices:
        choices["joints"] = [name for name in choices["joints"] if name not in own]
    try:
        robot = Robot.from_file(source, **choices)
        # with wheels that turn, no joint above them is where it would tilt them; nor is it with wheels that are held
        upright = {name: at for name, at in chosen.robot.locked.items() if robot.locked[name] != at}
        if upright:
            choices["locked"] |= upright
            robot = Robot.from_file(source, **choices)
        standing_on = wheel_feet(robot)
    except InputError:
        return chosen
    return replace(chosen, robot=robot, choices=choices, feet=standing_on, on_wheels=True) if standing_on else chosen


def _standing(
    source: str | Path, chosen: ChosenRobot, foot: str | None, posture: Mapping[str, float], others: Sequence[str]
) -> ChosenRobot:
    """The robot in a posture to jump from: its reference, another one of its file, or one that is looked for."""
    limits = position_limits(chosen.robot, Limits())
    kept = _kept_positions(chosen.robot, posture, limits)
    stance = standing(chosen.robot, chosen.feet, limits, kept)
    for name in others[:MOST_POSTURES] if stance.sought and not kept else ():
        choices = {**chosen.choices, "reference": name}
        try:
            robot = Robot.from_file(source, **choices)
            stands_on = wheel_feet(robot) if chosen.on_wheels else feet(robot, foot)
        except InputError:
            continue
        if stands_on and not posture_fault(robot, stands_on, robot.resting, position_limits(robot, Limits())):
            return replace(chosen, robot=robot, choices=choices, feet=stands_on)
    return replace(chosen, stance=stance)


def _kept_positions(robot: Robot, posture: Mapping[str, float], limits: Array) -> dict[int, float]:
    """Positions of planned joints by index, from those of planned joints and of joints that follow them, rad."""
    kept: dict[int, float] = {}
    for name, position in posture.items():
        coupling = robot.coupled.get(name, Coupling(name))
        if coupling.leader not in robot.joints:
            known = "it is locked; give --locked for it" if name in robot.locked else "no joint has this name"
            advice = f"joints that are planned: {', '.join(robot.joints)}"
            raise InputError(f"{name!r} is not a planned joint: {known}", element="posture", advice=advice)
        index = robot.joints.index(coupling.leader)
        leading = (position - coupling.offset) / coupling.ratio
        low, high = limits[index]
        if not low <= leading <= high:
            reason = f"{name} = {position:.4g} rad is outside its range, {low:.4g} to {high:.4g} rad"
            raise InputError(reason, element="posture", advice="give a position within it")
        if abs(kept.get(index, leading) - leading) > ALIKE:
            reason = f"{name!r} and {coupling.leader!r} move as one, and are given apart"
            raise InputError(reason, element="posture", advice="give one of them")
        kept[index] = leading
    return kept


def _refuse_halves(robot: Robot, locked: Mapping[str, float]) -> None:
    """Refuse to lock a joint whose mirror image would move."""
    own = {name: each.leader for name, each in robot.coupled.items() if robot.layout.tree.joint[name].mimic is None}
    for name, other in [*own.items(), *((leader, follower) for follower, leader in own.items())]:
        if name in locked and other not in locked:
            reason = f"{other!r}, its mirror image, would move alone"
            raise InputError(reason, element=f'locked "{name}"', advice=f"lock {other!r} too")


def _merit(chosen: ChosenRobot) -> tuple[bool, int, float, float, int]:
    """Keeps to its plane; joints of legs that step in it; how far legs bend; whether it is the usual plane; joints.

    Legs count that their names or their pairs tell. Hips and ankles that roll are joints of a leg too, in a plane in
    which it only sways: there its foot comes no nearer to the hip.
    """
    robot, turns = chosen.robot, chosen.robot.tree.turns
    of_foot = {foot: robot.frames[foot].body for foot in chosen.feet}
    sure = [
        foot
        for foot, body in of_foot.items()
        if named_foot(robot, body) or (turns == turns[body]).all(axis=1).sum() > 1
    ]
    legs = [Leg(robot, foot, robot.resting) for foot in sure]
    keeps = out_of_plane_leak(robot) < MEANINGLESS
    most = max((len(leg.joints) for leg in legs if leg.steps), default=0)
    bends = max((round(leg.shortens(), 2) for leg in legs), default=0.0)
    return keeps, most, bends, float("plane" not in chosen.choices), len(robot.joints)


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
