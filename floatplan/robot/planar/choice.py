"""Which joints are planned, follow another (such as that on the other side) or are locked, and where; and the plane."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from floatplan.arguments import FINITE, either, without
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.keys import Keyed
from floatplan.robot.urdf.tree import UrdfJoint, UrdfTree
from floatplan.tables import ANGLE, LARGEST_TILT, Key, Unit

USUAL_PLANES = {"x": "yz", "y": "xz", "z": "xy"}  # by the normal's letter
MOST_LEANING = math.sqrt(0.5)  # [-] cosine between a vertical and the upward line of the file


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane of the motion, in the root link's axes.

    Attributes
    ----------
    name : str
        Two letters, horizontal then vertical: "xz" has +x and +z.
    horizontal, vertical : (3,)
        Unit vectors along the two letters.
    normal : (3,)
        The axis that the planned joints share (majority sign): a unit vector along plus or minus the third letter.
    turn : float
        +1 where a positive angle about the normal rotates the horizontal axis towards the vertical one, else -1.
    """

    name: str
    horizontal: Array
    vertical: Array
    normal: Array
    turn: float

    @classmethod
    def of_axes(cls, name: str, axes: Iterable[Array]) -> Plane:
        """The plane called ``name``, its normal along most of ``axes`` (3,); a tie gives the positive one."""
        line = _unit((set("xyz") - set(name)).pop())
        votes = sum(np.sign(axis @ line) for axis in axes)
        horizontal = _unit(name[0])
        vertical = _unit(name[1])
        normal = (-line if votes < 0.0 else line) + 0.0
        turn = round(float(normal @ np.cross(horizontal, vertical)))
        return cls(name, read_only(horizontal), read_only(vertical), read_only(normal), float(turn))

    def project(self, point: Array) -> complex:
        """Horizontal + i vertical of a point (3,)."""
        return complex(self.horizontal @ point, self.vertical @ point)

    def sign(self, axis: Array) -> float:
        """+1 for an axis (3,) along the normal, -1 against it, 0 for any other."""
        return float(np.sign(axis @ self.normal)) if _is_parallel(axis, self.normal) else 0.0

    def tilt(self, axis: Array) -> float:
        """Angle between an axis (3,) and the normal's line, rad."""
        along = axis @ self.normal
        return float(np.arctan2(np.linalg.norm(axis - along * self.normal), abs(along)))


def _count_along(letter: str, axes: Iterable[Array]) -> int:
    """How many of some axes (3,) are along that of a letter."""
    return sum(_is_parallel(axis, _unit(letter)) for axis in axes)


def _planes_of(axes: Iterable[Array]) -> list[str]:
    """Planes in which some of the joints with these axes (3,) rotate, in quotation marks."""
    lines = list(axes)
    normals = [letter for letter in "xyz" if _count_along(letter, lines) > 0]
    return [f'"{USUAL_PLANES[normal]}"' for normal in normals]


def _nothing_to_plan(name: str, axes: Iterable[Array], *, is_user_s: bool) -> InputError:
    """The refusal of a plane in which no joint rotates: the user's, or the usual one; ``axes`` are (3,)."""
    others = _planes_of(axes)
    advice = f"joints turn in {either(others)}" if is_user_s and others else None
    reason = f'no joint is left to plan in the plane "{name}"'
    return InputError(reason, element="plane" if is_user_s else "joints", advice=advice)


def choose_plane(name: str | None, axes: Iterable[Array], gravity_direction: Array | None = None) -> str:
    """Return ``name``, or else that of the plane in which most joints rotate.

    Where the file has a direction of gravity, this is a plane with a vertical, if any joint rotates in such a one, and
    its vertical is the axis nearest to the line of gravity.

    Parameters
    ----------
    name : str or None
        Two letters, horizontal then vertical.
    axes : (3,) each
        The joints' axes in the root link.
    gravity_direction : (3,), optional
        In the root link.

    Raises
    ------
    InputError
        If the name is not two different letters of x, y, z; or if there is none, and no axis or more than one
        has the most joints.
    """
    if name is not None:
        if len(name) != 2 or name[0] == name[1] or not set(name) <= set("xyz"):
            reason = f'"{name}" is not two different letters of x, y and z'
            raise InputError(reason, element="plane", advice='write the horizontal and the vertical axis, such as "xz"')
        return name
    lines = list(axes)
    if not lines:
        raise InputError("no joint that turns is left to plan", element="joints")
    counts = {letter: _count_along(letter, lines) for letter in "xyz"}
    vertical = None if gravity_direction is None else "xyz"[int(np.argmax(np.abs(gravity_direction)))]
    upright = without(counts, (vertical,))
    if any(upright.values()):
        counts = upright
    most = max(counts.values())
    if most == 0:
        reason = "no joint that could be planned turns about the x, y or z axis of the root link"
        raise InputError(reason, element="plane", advice="lock the joints that tilt the others at another angle")
    winners = [letter for letter, count in counts.items() if count == most]
    if len(winners) > 1:
        planes = " or ".join(f'plane="{_plane_about(letter, vertical)}"' for letter in winners)
        reason = f"as many joints turn about {' and '.join(winners)} ({most} each)"
        raise InputError(reason, element="plane", advice=f"give {planes}")
    return _plane_about(winners[0], vertical)


def _plane_about(normal: str, vertical: str | None) -> str:
    """Name of the plane with a normal, and with a vertical where it has that axis; the usual one otherwise."""
    usual = USUAL_PLANES[normal]
    if vertical is None or vertical not in usual:
        return usual
    return usual.replace(vertical, "") + vertical


def against_gravity(vertical: Array, gravity_direction: Array | None) -> str | None:
    """Return why a vertical (3,) contradicts the one of a robot's file; None where it does not, or the file has none.

    The robot of the file may lean: up to half a right angle, another axis of its root link is no better vertical.
    """
    if gravity_direction is None or vertical @ -gravity_direction >= MOST_LEANING:
        return None
    of_file = ", ".join(f"{component:.3g}" for component in gravity_direction + 0.0)
    of_flights = ", ".join(f"{component:.3g}" for component in -vertical + 0.0)
    return (
        f"the file's gravity points along ({of_file}) in the root link's axes, "
        f"and that of flights along ({of_flights}): they contradict each other"
    )


def _is_parallel(axis: Array, direction: Array) -> bool:
    return bool(np.linalg.norm(axis - (axis @ direction) * direction) <= LARGEST_TILT)


def _unit(letter: str) -> Array:
    return np.array([float(letter == other) for other in "xyz"])


@dataclass(frozen=True)
class Coupling(Keyed):
    """A joint that follows a planned one: ``position = ratio * leader's position + offset`` (rad)."""

    about: ClassVar[str] = "How a joint follows another"
    leader: Annotated[str, Key("The planned joint that it follows")]
    ratio: Annotated[float, Key("Its position over the leader's", check=FINITE)] = 1.0
    offset: Annotated[float, Key("Its position where the leader's is zero", ANGLE, check=FINITE)] = 0.0


@dataclass(frozen=True, eq=False)
class Choice:
    """Roles of the joints: planned, coupled or locked, and the plane; None in space.

    ``planned`` are names in order; ``coupled`` maps followers, ``locked`` all other moving joints to their positions
    (rad or m); ``geared`` are the followers that the file itself couples by ``<mimic>``: they have no motor of their
    own; ``signs`` are the directions of all rotating joints about the normal, 0 where it is another; ``resting`` the
    positions of all moving joints if none were planned.
    """

    plane: Plane | None
    planned: tuple[str, ...]
    coupled: Mapping[str, Coupling]
    geared: frozenset[str]
    locked: Mapping[str, float]
    signs: Mapping[str, float]
    resting: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def required_plane(self) -> Plane:
        """The plane, where there is one.

        Raises
        ------
        InputError
            The flight is in space.
        """
        if self.plane is None:
            raise InputError("is for flights in a plane", element='coupled "mirror"', advice="name the pairs")
        return self.plane

    @property
    def motors(self) -> tuple[str, ...]:
        """The planned joints, then the followers that have a motor of their own."""
        return (*self.planned, *(name for name in self.coupled if name not in self.geared))

    @cached_property
    def ratios(self) -> Mapping[str, Array]:
        """Derivatives of the positions of the joints to be moved by those of the planned ones, (n,) each."""
        planned = dict(zip(self.planned, np.eye(len(self.planned)), strict=True))
        followers = {name: rule.ratio * planned[rule.leader] + 0.0 for name, rule in self.coupled.items()}
        return planned | followers

    @cached_property
    def motor_ratios(self) -> Mapping[str, Array]:
        """Derivatives of the positions of the joints to be moved by those of the motors, (m,) each."""
        motors = dict(zip(self.motors, np.eye(len(self.motors)), strict=True))
        for name, rule in self.coupled.items():
            if name in self.geared:
                motors[name] = rule.ratio * motors[rule.leader] + 0.0
        return motors

    @property
    def positions_at_zero(self) -> dict[str, float]:
        """Positions of all joints where the planned ones are zero."""
        return {**self.locked, **{name: coupling.offset for name, coupling in self.coupled.items()}}


def _joints_above(tree: UrdfTree, names: Iterable[str]) -> set[str]:
    """Joints between the root link and some others."""
    above: set[str] = set()
    for name in names:
        above |= {joint.name for joint in tree.path(tree.joint[name].parent)}
    return above


def choose_joints(
    tree: UrdfTree,
    *,
    plane: str | None,
    joints: Sequence[str] | None,
    coupled: Mapping[str, str | Coupling] | None,
    locked: Mapping[str, float] | None,
    posture: Mapping[str, float] | None = None,
    base: str = "planar",
    gravity_direction: Array | None = None,
) -> Choice:
    """Settle the plane and the role of every moving joint.

    In space, with the base "free-flyer", there is no plane, and joints rotate about any axis. ``gravity_direction`` is
    as of :func:`choose_plane`.

    A joint is, in this order: locked if the user locks it; coupled if the user couples it; planned if ``joints``
    names it; coupled if the file has it ``<mimic>`` a planned joint; planned if there are no ``joints`` and it rotates
    about the plane's normal; else locked, at the position within its limits that is nearest to ``posture``'s, or to
    zero where that has none, or where it would tilt the axes of joints to be moved.

    Raises
    ------
    InputError
        If a name does not exist or has two roles, a coupling is circular or a chain, a locked position is outside its
        limits, a joint to be moved does not rotate in the plane, or nothing is left to plan.
    """
    user_locked = _checked_locks(tree, locked or {})
    user_coupled = _checked_couplings(tree, coupled or {}, user_locked)
    if joints is not None:
        _check_joints(tree, joints, user_locked, user_coupled)
    mimics = _mimics(tree, {*user_locked, *user_coupled, *(joints or ())})
    resting = _resting(tree, user_locked, mimics)
    placed = tree.placements(resting)
    axes = {}  # (3,), in the root link, of the joints that rotate
    for joint in tree.joints:
        if joint.turns:
            axes[joint.name] = placed[joint.parent].rotation @ joint.origin.placement.rotation @ joint.axis
    free = [name for name in axes if name not in user_locked and name not in user_coupled and name not in mimics]
    named = [*(joints or ()), *user_coupled, *(coupling.leader for coupling in user_coupled.values())]
    if base != "planar":
        if plane is not None:
            raise InputError("a flight in space has none", element="plane", advice='leave it out, or base = "planar"')
        return _in_space(tree, user_locked, user_coupled, mimics, free, joints, posture)
    plane_name = choose_plane(plane, [axes[name] for name in named or free], gravity_direction)
    if joints is None:  # all that rotate in the plane, but those whose limits leave no range
        ranges = tree.joint
        any_sign = Plane.of_axes(plane_name, ())
        free = [name for name in free if any_sign.sign(axes[name]) and ranges[name].lower != ranges[name].upper]
        if not free:
            raise _nothing_to_plan(plane_name, axes.values(), is_user_s=plane is not None)
    planned = tuple(free if joints is None else joints)
    chosen = Plane.of_axes(plane_name, [axes[name] for name in planned])
    signs = {name: chosen.sign(axis) for name, axis in axes.items()}
    followers = _followers(planned, user_coupled, mimics)
    geared = _geared(tree, {*user_locked, *planned}, followers)
    moving = (*planned, *followers)
    _check_moving(tree, planned, followers, axes, chosen)
    # a right angle written as 1.5708 or 1.570796 is less than 1e-5 rad off, and not worth a warning
    tilts = {name: chosen.tilt(axes[name]) for name in moving}
    tilted = [f"{name} ({angle:.2g} rad)" for name, angle in tilts.items() if angle > 1e-5]
    warnings = [*tree.warnings, *_warning("axes slightly off the plane's normal, taken to be along it", tilted)]
    if posture:
        tilting = {name for name in _joints_above(tree, moving) if not signs.get(name, 1.0)}
        left_out = [name for name in tilting & posture.keys() if posture[name] != tree.joint[name].nearest(0.0)]
        warnings += _warning("not taken to the reference posture, as they would tilt planned joints", sorted(left_out))
        used = without(posture, tilting)
        resting = _resting(tree, {**used, **user_locked}, mimics)
    fixed = without(resting, moving)
    if joints is None:
        silent = []
        for name, position in fixed.items():
            if name not in user_locked and signs.get(name) == 0.0:
                silent.append(f"{name} = {position:g}")
        warnings += _warning("locked, because they do not turn about the plane's normal", silent)
    warned = (*warnings, *_slides(tree, fixed, user_locked))
    return Choice(chosen, planned, followers, geared, fixed, signs, resting, warned)


def _followers(
    planned: Sequence[str], coupled: Mapping[str, Coupling], mimics: Mapping[str, Coupling]
) -> dict[str, Coupling]:
    """The user's couplings, and those of the file whose leaders are planned."""
    return {**coupled, **{name: mimic for name, mimic in mimics.items() if mimic.leader in planned}}


def _geared(tree: UrdfTree, settled: set[str], followers: Mapping[str, Coupling]) -> frozenset[str]:
    """Followers that follow as the file itself says."""
    by_file = _mimics(tree, settled)
    return frozenset(name for name, coupling in followers.items() if by_file.get(name) == coupling)


def _in_space(
    tree: UrdfTree,
    locked: Mapping[str, float],
    coupled: Mapping[str, Coupling],
    mimics: Mapping[str, Coupling],
    free: Sequence[str],
    joints: Sequence[str] | None,
    posture: Mapping[str, float] | None,
) -> Choice:
    """The roles in space: planned are all rotating joints with a range, or those of ``joints``."""
    ranges = tree.joint
    planned = tuple(joints or [name for name in free if ranges[name].lower != ranges[name].upper])
    if not planned:
        raise InputError("no joint is left to plan", element="joints")
    followers = _followers(planned, coupled, mimics)
    geared = _geared(tree, {*locked, *planned}, followers)
    _check_followers(tree, planned, followers)
    resting = _resting(tree, {**(posture or {}), **locked}, mimics)
    fixed = without(resting, (*planned, *followers))
    warnings = (*tree.warnings, *_slides(tree, fixed, locked))
    return Choice(None, planned, followers, geared, fixed, {}, resting, warnings)


def _slides(tree: UrdfTree, fixed: Mapping[str, float], locked: Mapping[str, float]) -> list[str]:
    """The warning about sliding joints that are locked though the user has not locked them."""
    sliding = [f"{name} = {fixed[name]:g} m" for name in fixed if not tree.joint[name].turns and name not in locked]
    return _warning("locked, because joints that slide are not planned", sliding)


def in_radians(tree: UrdfTree, locked: Mapping[str, float], angles: Unit) -> dict[str, float]:
    """Positions of joints, rad, from those in a unit of angles; sliding joints are in m and stay so."""
    positions = {}
    for name, position in locked.items():
        rotates = name in tree.joint and tree.joint[name].turns
        positions[name] = math.radians(position) if angles == "deg" and rotates else position
    return positions


def _checked_locks(tree: UrdfTree, locked: Mapping[str, float]) -> dict[str, float]:
    """Positions of locked joints, each of which moves and is within its limits."""
    for name, position in locked.items():
        where = f'locked "{name}"'
        joint = _moving_joint(tree, name, where)
        if not joint.lower <= position <= joint.upper:
            reason = f"position {position:g} is outside its limits [{joint.lower:g}, {joint.upper:g}]"
            raise InputError(reason, element=where, advice="give a position within them")
    return {name: float(position) for name, position in locked.items()}


def _checked_couplings(
    tree: UrdfTree, coupled: Mapping[str, str | Coupling], locked: Mapping[str, float]
) -> dict[str, Coupling]:
    """Couplings by follower, none of which is circular, a chain, or of a joint that is locked.

    A name is a coupling of ratio 1; a name after a minus sign one of ratio -1.
    """
    couplings: dict[str, Coupling] = {}
    for name, value in coupled.items():
        if isinstance(value, Coupling):
            couplings[name] = value
        else:
            opposed = value.startswith("-") and value not in tree.joint
            couplings[name] = Coupling(value[1:].strip(), -1.0) if opposed else Coupling(value)
    for name, coupling in couplings.items():
        where = f'coupled "{name}"'
        _turning_joint(tree, name, where)
        _turning_joint(tree, coupling.leader, where)
        if coupling.leader == name:
            raise InputError("a joint cannot follow itself", element=where)
        if coupling.leader in couplings:
            further = couplings[coupling.leader].leader
            reason = f'its leader "{coupling.leader}" follows "{further}" in turn'
            raise InputError(reason, element=where, advice=f'couple both to "{further}"')
        if not coupling.ratio:
            raise InputError("the ratio must not be zero", element=where)
        if name in locked:
            raise InputError("the joint is also locked", element=where, advice="leave it out of one of the two")
        if coupling.leader in locked:
            raise InputError(f'its leader "{coupling.leader}" is locked', element=where, advice="lock this joint too")
    return couplings


def _check_joints(
    tree: UrdfTree, joints: Sequence[str], locked: Mapping[str, float], coupled: Mapping[str, Coupling]
) -> None:
    """Check the names of joints to be planned: each rotates, is named once, and has no other role."""
    if not joints:
        raise InputError("is empty: no joint is left to plan", element="joints")
    for number, name in enumerate(joints):
        where = f'joints "{name}"'
        joint = _turning_joint(tree, name, where)
        if name in joints[:number]:
            raise InputError("is named twice", element=where, advice="keep one of them")
        if name in locked or name in coupled:
            role = "locked" if name in locked else "coupled"
            raise InputError(f"the joint is also {role}", element=where, advice="leave it out of one of the two")
        if joint.lower == joint.upper:
            raise InputError(f"cannot move: its limits are both {joint.lower:g}", element=where)


def _moving_joint(tree: UrdfTree, name: str, where: str) -> UrdfJoint:
    """The joint called ``name``, which exists and moves; ``where`` is the element that errors name."""
    joint = tree.joint.get(name)
    if joint is None:
        names = ", ".join(other.name for other in tree.joints if other.moves)
        raise InputError(f'no joint is called "{name}"', element=where, advice=f"the joints that move are: {names}")
    if not joint.moves:
        raise InputError(f'joint "{name}" is fixed', element=where, advice="leave it out")
    return joint


def _turning_joint(tree: UrdfTree, name: str, where: str) -> UrdfJoint:
    joint = _moving_joint(tree, name, where)
    if not joint.turns:
        reason = f'joint "{name}" is {joint.type}; only joints that turn can be planned or coupled'
        raise InputError(reason, element=where)
    return joint


def _check_moving(
    tree: UrdfTree, planned: Sequence[str], followers: Mapping[str, Coupling], axes: Mapping[str, Array], plane: Plane
) -> None:
    """Check that followers rotate and follow a planned joint, and that all joints to be moved rotate in the plane."""
    _check_followers(tree, planned, followers)
    for name in (*planned, *followers):
        if not plane.sign(axes[name]):
            degrees = np.degrees(plane.tilt(axes[name]))
            reason = f'its axis is {degrees:.3g} deg off the normal of the plane "{plane.name}"'
            raise InputError(reason, element=f'joint "{name}"', advice="leave it out, or give another plane")


def _check_followers(tree: UrdfTree, planned: Sequence[str], followers: Mapping[str, Coupling]) -> None:
    """Check that followers rotate and follow a planned joint."""
    for name, coupling in followers.items():
        where = f'coupled "{name}"'
        if coupling.leader not in planned:
            reason = f'its leader "{coupling.leader}" is not a planned joint'
            raise InputError(reason, element=where, advice="plan it, or name another")
        _turning_joint(tree, name, where)


def _mimics(tree: UrdfTree, settled: set[str]) -> dict[str, Coupling]:
    """The file's ``<mimic>`` joints without a role by the user, each with the leader at the end of its chain."""
    mimics: dict[str, Coupling] = {}
    for joint in tree.joints:
        if joint.mimic is None or not joint.moves or joint.name in settled:
            continue
        leader = tree.joint[joint.mimic.joint]
        ratio = joint.mimic.multiplier
        offset = joint.mimic.offset
        seen = {joint.name}
        while leader.mimic is not None and leader.name not in settled:
            if leader.name in seen:
                raise InputError("mimics itself through others", element=f'joint "{joint.name}": mimic')
            seen.add(leader.name)
            offset += ratio * leader.mimic.offset
            ratio *= leader.mimic.multiplier
            leader = tree.joint[leader.mimic.joint]
        if ratio:
            mimics[joint.name] = Coupling(leader.name, ratio, offset)
    return mimics


def _resting(tree: UrdfTree, posture: Mapping[str, float], mimics: Mapping[str, Coupling]) -> dict[str, float]:
    """Positions of all moving joints if none were planned."""
    resting = {}
    for joint in tree.joints:
        if joint.moves:
            resting[joint.name] = joint.nearest(posture.get(joint.name, 0.0))
    for name, coupling in mimics.items():
        resting[name] = coupling.ratio * resting.get(coupling.leader, 0.0) + coupling.offset
    return resting


def _warning(text: str, items: Sequence[str]) -> list[str]:
    return [f"{text}: {', '.join(items)}"] if items else []


def with_motors(
    tree: UrdfTree, choice: Choice, properties: Mapping[str, float | Mapping[str, float] | None]
) -> UrdfTree:
    """Return the robot with the user's properties of motors instead of the file's; locked joints have no motor.

    ``properties`` are "armature" and "damping" of all motors, or by joint; None is as the file has it.

    Raises
    ------
    InputError
        A joint does not exist or does not move.
    """
    joints = {name: tree.joint[name] for name in choice.ratios}
    for key, value in properties.items():
        if value is None:
            continue
        by_joint = value if isinstance(value, Mapping) else dict.fromkeys(choice.motors, value)
        for name, number in by_joint.items():
            if isinstance(value, Mapping):
                where = f'{key} "{name}"'
                _moving_joint(tree, name, where)
                if name not in joints:
                    raise InputError("the joint is locked, so that its motor does not turn", element=where)
            joints[name] = replace(joints[name], **{key: number})  # type: ignore[arg-type]
    all_joints = []
    for joint in tree.joints:
        without = replace(joint, armature=None, damping=None, friction=None)
        all_joints.append(joints.get(joint.name, without))
    return replace(tree, joints=tuple(all_joints))
