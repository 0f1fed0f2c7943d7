"""Which plane, joints, couplings, feet and posture of a robot a first flight takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import without
from floatplan.arrays import Array
from floatplan.errors import InputError, naming
from floatplan.initial.feet import feet, named_foot, wheel_feet
from floatplan.initial.legs import Leg
from floatplan.initial.standing import Standing, has_legs, posture_fault, standing
from floatplan.problem.parts import Limits
from floatplan.problem.resolution import position_limits
from floatplan.robot.leak import MEANINGLESS, out_of_plane_leak
from floatplan.robot.robot import Coupling, Robot
from floatplan.robot.source import read_source
from floatplan.robot.urdf.check import Changes, taken_urdf
from floatplan.robot.urdf.srdf import reference_postures
from floatplan.robot.urdf.tree import urdf_path
from floatplan.robot.wheels import wheels

# How the names of reference postures begin, the likeliest to stand in first.
MOST_POSTURES = 8  # [-] of a file, that are tried
ALIKE = 1e-6  # [kg, m, kg m^2, rad] bodies that differ by no more are alike


@dataclass(frozen=True, eq=False)
class ChosenRobot:
    """A robot for a first flight.

    Attributes
    ----------
    robot : Robot
    choices : the keys of ``[robot]`` that choose it, but for its file
    feet : frames on which it stands, the rearmost first
    on_wheels : whether these are wheels whose joints are locked
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
        names: dict[str, None] = {}
        for foot in self.feet:
            leg = Leg(self.robot, foot, self.robot.resting)
            if leg.steps:
                names.update(dict.fromkeys(self.robot.joints[joint] for joint in leg.joints))
        return list(names)


def chosen_robot(
    source: str | Path,
    options: Mapping[str, Any] | None = None,
    foot: str | None = None,
    posture: Mapping[str, float] | None = None,
) -> ChosenRobot:
    """Load a robot with left and right coupled, in the plane in which its legs step, in a posture to jump from.

    ``options`` are arguments of ``Robot.from_urdf`` that are settled; ``foot`` is one that it stands on;
    ``posture`` has positions, rad, of planned joints, or of those that follow them, where it stands.

    Raises
    ------
    InputError
        The file is not sound, in none of the planes does the robot keep to it, or ``posture`` has what is no planned
        joint, or a position out of range.
    """
    options = options or {}
    if "locked" in options and "coupled" not in options:
        unlocked = without(options, ("locked",))
        _refuse_halves(chosen_robot(source, unlocked, foot).robot, options["locked"])
    of_file = _FromFile.read(source, bool(options.get("balance_inertias")))
    reference: dict[str, str] = {}
    others: list[str] = []
    if "reference" not in options:
        others = [*of_file.references[1:], *of_file.others]
        if of_file.references:
            reference = {"reference": of_file.references[0]}
    chosen = _in_best_plane(source, options, reference, of_file.planes, foot)
    chosen = replace(chosen, postures=(*of_file.references, *of_file.others)[:MOST_POSTURES])
    if not chosen.feet:
        chosen = _on_wheels(source, chosen, options)
    return _standing(source, chosen, foot, posture or {}, others)


@dataclass(frozen=True)
class _FromFile:
    """What a robot's file says about the choice.

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
            postures = reference_postures(tree, text)
        likely: list[str] = []
        for word in ("stand", "half_sitting", "crouch", "squat", "knees_bent", "homing", "home", "default"):
            likely += [name for name in postures if name.startswith(word) and name not in likely]
        planes = ["xz", "yz", "xy"]  # where the file does not say which way is up
        if text.gravity_direction is not None:
            vertical = "xyz"[int(np.abs(text.gravity_direction).argmax())]
            planes = [f"{horizontal}{vertical}" for horizontal in "xyz" if horizontal != vertical]
        return cls(likely, [name for name in postures if name not in likely], planes)


def _in_best_plane(
    source: str | Path,
    options: Mapping[str, Any],
    reference: Mapping[str, str],
    planes: Sequence[str],
    foot: str | None,
) -> ChosenRobot:
    """The robot in the plane of the options, or in the usual one; in another where its legs step only in that."""
    candidates: list[ChosenRobot] = []
    errors: list[InputError] = []
    for plane in [None] if "plane" in options else (None, *planes):
        for coupled in [{}] if "coupled" in options else ({"coupled": "mirror"}, {}):
            choices = {**({"plane": plane} if plane else {}), **coupled, **reference, **options}
            try:
                robot = _loaded(source, choices, foot)
                pairs = {} if "coupled" in choices else side_by_side(robot.robot)
                candidates.append(_loaded(source, {**choices, "coupled": pairs}, foot) if pairs else robot)
            except InputError as error:
                errors.append(error)
                continue
            break
        if candidates and plane is None:
            stays_in_plane, leg_joints, *_ = _merit(candidates[0])
            if stays_in_plane and leg_joints >= 2:
                break
    if not candidates:
        raise errors[0]
    return max(candidates, key=_merit)


def _on_wheels(source: str | Path, chosen: ChosenRobot, options: Mapping[str, Any]) -> ChosenRobot:
    """The robot on the wheels of legs that step, where it has such, with the wheels' joints locked."""
    own = {name for name in wheels(chosen.robot) if name in (*chosen.robot.joints, *chosen.robot.coupled)}
    if not own or "joints" in options:
        return chosen
    choices = {**chosen.choices, "locked": {**dict.fromkeys(sorted(own), 0.0), **chosen.choices.get("locked", {})}}
    if "joints" in choices:
        choices["joints"] = [name for name in choices["joints"] if name not in own]
    try:
        robot = Robot.from_file(source, **choices)
        # With free wheels, no joint above them is locked where it would tilt them; nor is it with locked ones.
        upright = {name: angle for name, angle in chosen.robot.locked.items() if robot.locked[name] != angle}
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
    """The robot in a posture to jump from: its reference, another one of its file, or one that is searched for."""
    limits = position_limits(chosen.robot, Limits())
    fixed = _fixed_positions(chosen.robot, posture, limits)
    may_search = not fixed and has_legs(chosen.robot, chosen.feet)
    if not (others and may_search and posture_fault(chosen.robot, chosen.feet, chosen.robot.resting, limits)):
        others = ()
    for name in others[:MOST_POSTURES]:  # before the search, which takes longer
        choices = {**chosen.choices, "reference": name}
        try:
            robot = Robot.from_file(source, **choices)
            stands_on = wheel_feet(robot) if chosen.on_wheels else feet(robot, foot)
        except InputError:
            continue
        if stands_on and not posture_fault(robot, stands_on, robot.resting, position_limits(robot, Limits())):
            return replace(chosen, robot=robot, choices=choices, feet=stands_on)
    return replace(chosen, stance=standing(chosen.robot, chosen.feet, limits, fixed))


def _fixed_positions(robot: Robot, posture: Mapping[str, float], limits: Array) -> dict[int, float]:
    """Positions of planned joints by index, from those of planned joints and of joints that follow them, rad."""
    fixed: dict[int, float] = {}
    for name, position in posture.items():
        coupling = robot.coupled.get(name, Coupling(name))
        if coupling.leader not in robot.joints:
            reason = "it is locked; give --locked for it" if name in robot.locked else "no joint has this name"
            advice = f"joints that are planned: {', '.join(robot.joints)}"
            raise InputError(f"{name!r} is not a planned joint: {reason}", element="posture", advice=advice)
        index = robot.joints.index(coupling.leader)
        leading = (position - coupling.offset) / coupling.ratio
        low, high = limits[index]
        if not low <= leading <= high:
            reason = f"{name} = {position:.4g} rad is outside its range, {low:.4g} to {high:.4g} rad"
            raise InputError(reason, element="posture", advice="give a position within it")
        if abs(fixed.get(index, leading) - leading) > ALIKE:
            reason = f"{name!r} and {coupling.leader!r} move as one, and are given apart"
            raise InputError(reason, element="posture", advice="give one of them")
        fixed[index] = leading
    return fixed


def _refuse_halves(robot: Robot, locked: Mapping[str, float]) -> None:
    """Refuse to lock a joint whose mirror image would move."""
    pairs = []
    for follower, coupling in robot.coupled.items():
        if robot.layout.tree.joint[follower].mimic is None:
            pairs.append((follower, coupling.leader))
    for name, other in [*pairs, *((leader, follower) for follower, leader in pairs)]:
        if name in locked and other not in locked:
            reason = f"{other!r}, its mirror image, would move alone"
            raise InputError(reason, element=f'locked "{name}"', advice=f"lock {other!r} too")


def _merit(chosen: ChosenRobot) -> tuple[bool, int, float, float, int]:
    """Stays in its plane; joints of legs that step in it; how far legs bend; whether it is the usual plane; joints.

    Legs count that their names or their pairs show to be legs. Hips and ankles that roll are joints of a leg too, in a
    plane in which it only sways: there its foot comes no nearer to the hip.
    """
    robot = chosen.robot
    turns = robot.tree.turns
    most_joints = 0
    bends = 0.0
    for foot in chosen.feet:
        body = robot.frames[foot].body
        is_pair = (turns == turns[body]).all(axis=1).sum() > 1
        if not (named_foot(robot, body) or is_pair):
            continue
        leg = Leg(robot, foot, robot.resting)
        bends = max(bends, round(leg.shortens(), 2))
        if leg.steps:
            most_joints = max(most_joints, len(leg.joints))
    stays_in_plane = out_of_plane_leak(robot) < MEANINGLESS
    return stays_in_plane, most_joints, bends, float("plane" not in chosen.choices), len(robot.joints)


def side_by_side(robot: Robot) -> dict[str, str]:
    """Return joints whose bodies are as others at the same position, as of legs in a planar model, with theirs."""
    tree = robot.tree
    same: dict[int, int] = {}
    for body, other in combinations(range(1, len(tree.names)), 2):
        parent = int(tree.parent[body])
        other_parent = int(tree.parent[other])
        if body in same or other in same or same.get(other_parent, other_parent) != parent:
            continue
        joint_sum = (tree.turns[body] - tree.turns[parent]).sum()
        other_joint_sum = (tree.turns[other] - tree.turns[other_parent]).sum()
        own = (tree.anchor, tree.mass, tree.center, tree.inertia, tree.offsets)
        if joint_sum == other_joint_sum and all(abs(values[body] - values[other]) < ALIKE for values in own):
            same[other] = body
    joints = [robot.layout.tree.carrier[name].name for name in tree.names[1:]]
    return {joints[other - 1]: joints[body - 1] for other, body in same.items()}


def _loaded(source: str | Path, choices: dict[str, Any], foot: str | None) -> ChosenRobot:
    robot = Robot.from_file(source, **choices)
    carried = robot.tree.mass @ (robot.tree.turns != 0)  # kg, of the bodies that each planned joint moves
    least = 0.01 * robot.mass  # joints that carry less, such as fingers, stay locked
    heavy = list(compress(robot.joints, carried >= least))
    if heavy and len(heavy) < len(robot.joints):
        choices = {**choices, "joints": heavy}
        robot = Robot.from_file(source, **choices)
    return ChosenRobot(robot, choices, feet(robot, foot))
