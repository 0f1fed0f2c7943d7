"""The names that a user gives: do these joints exist, and can they be what they are to be?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from floatplan.errors import InputError
from floatplan.robot.parts import Coupling
from floatplan.robot.urdf.tree import UrdfJoint, UrdfTree


def checked_locks(tree: UrdfTree, locked: Mapping[str, float]) -> dict[str, float]:
    """Return the positions of locked joints, each of which moves and is within its limits."""
    for name, position in locked.items():
        where = f'locked "{name}"'
        joint = moving_joint(tree, name, where)
        if not joint.lower <= position <= joint.upper:
            reason = f"position {position:g} is outside its limits [{joint.lower:g}, {joint.upper:g}]"
            raise InputError(reason, element=where, advice="give a position within them")
    return {name: float(position) for name, position in locked.items()}


def checked_couplings(
    tree: UrdfTree, coupled: Mapping[str, str | Coupling], locked: Mapping[str, float]
) -> dict[str, Coupling]:
    """Return couplings by follower, none of which is circular, a chain, or of a joint that is locked."""
    couplings = {name: _coupling(tree, value) for name, value in coupled.items()}
    for name, coupling in couplings.items():
        where = f'coupled "{name}"'
        turning_joint(tree, name, where)
        turning_joint(tree, coupling.leader, where)
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


def _coupling(tree: UrdfTree, value: str | Coupling) -> Coupling:
    """A name is a coupling of ratio 1; a name after a minus sign one of ratio -1."""
    if isinstance(value, Coupling):
        return value
    if value.startswith("-") and value not in tree.joint:
        return Coupling(value[1:].strip(), -1.0)
    return Coupling(value)


def check_joints(
    tree: UrdfTree, joints: Sequence[str] | None, locked: Mapping[str, float], coupled: Mapping[str, Coupling]
) -> None:
    """Check the names of joints to be planned: each turns, is named once, and has no other role."""
    if joints is None:
        return
    if not joints:
        raise InputError("is empty: no joint is left to plan", element="joints")
    for number, name in enumerate(joints):
        where = f'joints "{name}"'
        joint = turning_joint(tree, name, where)
        if name in joints[:number]:
            raise InputError("is named twice", element=where, advice="keep one of them")
        if name in locked or name in coupled:
            role = "locked" if name in locked else "coupled"
            raise InputError(f"the joint is also {role}", element=where, advice="leave it out of one of the two")
        if is_fixed(joint):
            raise InputError(f"cannot move: its limits are both {joint.lower:g}", element=where)


def moving_joint(tree: UrdfTree, name: str, where: str) -> UrdfJoint:
    """The joint called ``name``, which exists and moves; ``where`` is the element that errors name."""
    joint = tree.joint.get(name)
    if joint is None:
        known = ", ".join(known.name for known in tree.joints if known.moves)
        raise InputError(f'no joint is called "{name}"', element=where, advice=f"the joints that move are: {known}")
    if not joint.moves:
        raise InputError(f'joint "{name}" is fixed', element=where, advice="leave it out")
    return joint


def turning_joint(tree: UrdfTree, name: str, where: str) -> UrdfJoint:
    """The joint called ``name``, which turns."""
    joint = moving_joint(tree, name, where)
    if not joint.turns:
        raise InputError(
            f'joint "{name}" is {joint.type}; only joints that turn can be planned or coupled', element=where
        )
    return joint


def is_fixed(joint: UrdfJoint) -> bool:
    """Whether its limits hold the joint fast."""
    return joint.lower == joint.upper
