"""Which joints are planned, which follow another, and which are locked, and where."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.parts import Coupling, Plane
from floatplan.robot.planar.choice_check import check_joints, checked_couplings, checked_locks, is_fixed, turning_joint
from floatplan.robot.planar.plane import (
    choose_plane,
    explain_axis,
    joint_axes,
    oriented_plane,
    sign_in_plane,
    tilt,
    turns_in_plane,
)
from floatplan.robot.urdf.tree import UrdfTree

AXIS_ROUNDING = 1e-12  # [-] rotations from roll, pitch and yaw carry errors of this order
TILT_ROUNDING = 1e-5  # [rad] below it lies a right angle written as 1.5708 or 1.570796; not worth a warning


@dataclass(frozen=True, eq=False)
class Choice:
    """Roles of the joints: planned, coupled or locked, and the plane.

    ``planned`` are names in order; ``coupled`` maps followers, ``locked`` all other moving joints to their positions
    (rad or m); ``geared`` are the followers that the file itself couples by ``<mimic>``: they have no motor of their
    own; ``signs`` holds the direction of every turning joint about the normal, 0 where it is another; ``resting`` the
    positions of all moving joints if none were planned.
    """

    plane: Plane
    planned: tuple[str, ...]
    coupled: Mapping[str, Coupling]
    geared: frozenset[str]
    locked: Mapping[str, float]
    signs: Mapping[str, float]
    resting: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def moving(self) -> tuple[str, ...]:
        """The planned joints and their followers."""
        return (*self.planned, *self.coupled)

    @property
    def motors(self) -> tuple[str, ...]:
        """The planned joints, then the followers that have a motor of their own."""
        return (*self.planned, *(name for name in self.coupled if name not in self.geared))

    def positions_at_zero(self) -> dict[str, float]:
        """Positions of all joints where the planned ones are zero."""
        return {**self.locked, **{name: coupling.offset for name, coupling in self.coupled.items()}}


def choose_joints(
    tree: UrdfTree,
    *,
    plane: str | None,
    joints: Sequence[str] | None,
    coupled: Mapping[str, str | Coupling] | None,
    locked: Mapping[str, float] | None,
    posture: Mapping[str, float] | None = None,
) -> Choice:
    """Settle the plane and the role of every moving joint.

    A joint is, in this order: locked if the user locks it; coupled if the user couples it; planned if ``joints``
    names it; coupled if the file has it ``<mimic>`` a planned joint; planned if ``joints`` is not given and it turns
    about the plane's normal; else locked, at the position within its limits that is nearest to ``posture``'s, or to
    zero where that has none, or where it would tilt the axes of joints to be moved.

    Raises
    ------
    InputError
        If a name is unknown or given two roles, a coupling is circular or a chain, a locked position is outside its
        limits, a joint to be moved does not turn in the plane, or nothing is left to plan.
    """
    user_locked = checked_locks(tree, locked or {})
    user_coupled = checked_couplings(tree, coupled or {}, user_locked)
    check_joints(tree, joints, user_locked, user_coupled)
    mimics = _mimics(tree, set(user_locked) | set(user_coupled) | set(joints or ()))
    resting = _resting(tree, user_locked, mimics)
    axes = joint_axes(tree, tree.placements(resting))
    free = [name for name in axes if name not in user_locked and name not in user_coupled and name not in mimics]
    named = [*(joints or ()), *user_coupled, *(coupling.leader for coupling in user_coupled.values())]
    plane_name = choose_plane(plane, axes, named or free)
    planned = tuple(joints) if joints is not None else _in_plane(tree, free, axes, plane_name)
    chosen = oriented_plane(plane_name, [axes[name] for name in planned])
    signs = {name: sign_in_plane(axis, chosen) for name, axis in axes.items()}
    followers = {**user_coupled, **{name: mimic for name, mimic in mimics.items() if mimic.leader in planned}}
    by_file = _mimics(tree, {*user_locked, *planned})
    geared = frozenset(name for name, coupling in followers.items() if by_file.get(name) == coupling)
    moving = {*planned, *followers}
    _check_moving(tree, planned, followers, axes, chosen)
    warnings = [*tree.warnings, *_explain_tilts(moving, axes, chosen)]
    if posture:
        tilting = _above(tree, moving) & {name for name, sign in signs.items() if not sign}
        warnings += _explain_posture(tree, posture, tilting)
        kept = {name: position for name, position in posture.items() if name not in tilting}
        resting = _resting(tree, {**kept, **user_locked}, mimics)
    rest = {name: position for name, position in resting.items() if name not in moving}
    if joints is None:
        warnings += _explain_locks(rest, user_locked, signs)
    return Choice(chosen, planned, followers, geared, rest, signs, resting, tuple(warnings))


def _check_moving(
    tree: UrdfTree,
    planned: Sequence[str],
    followers: Mapping[str, Coupling],
    axes: Mapping[str, Array],
    plane: Plane,
) -> None:
    for name, coupling in followers.items():
        where = f'coupled "{name}"'
        if coupling.leader not in planned:
            raise InputError(
                f'its leader "{coupling.leader}" is not a planned joint',
                element=where,
                advice="plan it, or name another",
            )
        turning_joint(tree, name, where)
    for name in [*planned, *followers]:
        if not sign_in_plane(axes[name], plane):
            raise explain_axis(tree.joint[name], axes[name], plane)


def _in_plane(tree: UrdfTree, free: Sequence[str], axes: Mapping[str, Array], plane: str) -> tuple[str, ...]:
    """The joints among ``free`` that turn in the plane and are not fixed by their limits."""
    planned = tuple(name for name in free if turns_in_plane(axes[name], plane) and not is_fixed(tree.joint[name]))
    if not planned:
        raise InputError(f'no joint is left to plan in the plane "{plane}"', element="joints")
    return planned


def _mimics(tree: UrdfTree, settled: set[str]) -> dict[str, Coupling]:
    """The file's ``<mimic>`` joints that the user left alone, each with the leader at the end of its chain."""
    mimics: dict[str, Coupling] = {}
    for joint in tree.joints:
        if joint.mimic is None or not joint.moves or joint.name in settled:
            continue
        leader, ratio, offset = tree.joint[joint.mimic.joint], joint.mimic.multiplier, joint.mimic.offset
        seen = {joint.name}
        while leader.mimic is not None and leader.name not in settled:
            if leader.name in seen:
                raise InputError("mimics itself through others", element=f'joint "{joint.name}": mimic')
            seen.add(leader.name)
            ratio, offset = ratio * leader.mimic.multiplier, offset + ratio * leader.mimic.offset
            leader = tree.joint[leader.mimic.joint]
        if ratio:
            mimics[joint.name] = Coupling(leader.name, ratio, offset)
    return mimics


def _resting(tree: UrdfTree, posture: Mapping[str, float], mimics: Mapping[str, Coupling]) -> dict[str, float]:
    """Positions of all moving joints if none were planned."""
    resting = {joint.name: joint.nearest(posture.get(joint.name, 0.0)) for joint in tree.joints if joint.moves}
    for name, coupling in mimics.items():
        resting[name] = coupling.ratio * resting.get(coupling.leader, 0.0) + coupling.offset
    return resting


def _above(tree: UrdfTree, joints: Iterable[str]) -> set[str]:
    """Names of all joints on the paths from the root to ``joints``."""
    carrier = {joint.child: joint for joint in tree.joints}
    above: set[str] = set()
    for name in joints:
        joint = carrier.get(tree.joint[name].parent)
        while joint is not None and joint.name not in above:
            above.add(joint.name)
            joint = carrier.get(joint.parent)
    return above


def _explain_posture(tree: UrdfTree, posture: Mapping[str, float], tilting: Iterable[str]) -> list[str]:
    """One warning for the joints that are not taken to the reference posture."""
    left_out = [name for name in tilting if name in posture and posture[name] != tree.joint[name].nearest(0.0)]
    listed = ", ".join(sorted(left_out))
    return [f"not taken to the reference posture, as they would tilt planned joints: {listed}"] if left_out else []


def _explain_tilts(moving: Iterable[str], axes: Mapping[str, Array], plane: Plane) -> list[str]:
    """One warning for the axes that are not quite along the plane's normal."""
    tilts = {name: tilt(axes[name], plane) for name in moving}
    tilted = [f"{name} ({angle:.2g} rad)" for name, angle in tilts.items() if angle > TILT_ROUNDING]
    return [f"axes slightly off the plane's normal, taken to be along it: {', '.join(tilted)}"] if tilted else []


def _explain_locks(
    rest: Mapping[str, float], user_locked: Mapping[str, float], signs: Mapping[str, float]
) -> list[str]:
    """One warning for the joints that were locked by themselves, because they do not turn in the plane."""
    silent = [name for name in rest if name not in user_locked and not signs.get(name, 0.0)]
    listed = ", ".join(f"{name} = {rest[name]:g}" for name in silent)
    return [f"locked, because they do not turn about the plane's normal: {listed}"] if silent else []


def with_axes_in_plane(tree: UrdfTree, choice: Choice) -> UrdfTree:
    """Return the robot that is planned: the axes of planned and coupled joints exactly along or against the normal.

    An axis slightly off is turned onto it, and nothing else: the joints' origins are those of the file. A robot with
    tilted axes has no motion in the plane to restrict it to; this one moves in the plane exactly, and its momentum
    differs from the file's by the order of the tilt.
    """
    positions = choice.positions_at_zero()
    rotations = {tree.root: np.eye(3)}
    joints = []
    for joint in tree.joints:
        rotation = rotations[joint.parent] @ joint.origin.placement.rotation
        turned = joint
        if joint.name in choice.moving:
            exact = choice.signs[joint.name] * rotation.T @ choice.plane.normal
            if abs(exact - joint.axis).max() >= AXIS_ROUNDING:
                turned = replace(joint, axis=exact / math.hypot(*exact))
        joints.append(turned)
        rotations[joint.child] = rotation @ turned.motion(positions.get(joint.name, 0.0)).rotation
    return replace(tree, joints=tuple(joints))


def largest_turn(written: UrdfTree, turned: UrdfTree) -> float:
    """Largest angle between the axes of a joint in the one and in the other, rad."""
    pairs = [(joint.axis, turned.joint[joint.name].axis) for joint in written.joints]
    return max(math.atan2(np.linalg.norm(np.cross(one, other)), one @ other) for one, other in pairs)
