"""The joints by which a file lets its own base float, read as the free base that every robot has here.

A URDF may say that its robot floats: by a ``floating`` or ``planar`` joint from a massless root link, or by a chain of
sliding and rotating joints with massless links between them. In flight such joints are coordinates of the base, not
joints with motors: they are fixed at zero, and the root link, which weighs nothing, moves with the base.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfJoint, UrdfTree
from floatplan.tables import FREE_TYPES, INDEPENDENT

FREE_FLYER = 6  # [-] velocities of a base in space; its configuration has one number more


def free_base(tree: UrdfTree) -> tuple[UrdfJoint, ...]:
    """Return the joints that let the robot of a file float, from the root on; none where it has no such joints.

    They are a ``floating`` or a ``planar`` joint; or three joints that slide and three that rotate, in any order, which
    reach every pose; or two that slide and one that rotates about the normal of their plane. The links before the last
    of them have neither mass nor collision geometry, and carry nothing else.
    """
    below: dict[str, list[UrdfJoint]] = {}
    for joint in tree.joints:
        below.setdefault(joint.parent, []).append(joint)
    link = tree.root
    rotation = np.eye(3)
    chain: list[UrdfJoint] = []
    axes: list[Array] = []
    base: tuple[UrdfJoint, ...] = ()
    while tree.links[link].inertial is None and not tree.links[link].collisions and len(below.get(link, ())) == 1:
        (joint,) = below[link]
        rotation = rotation @ joint.origin.placement.rotation
        if joint.type != "fixed":
            chain.append(joint)
            axes.append(rotation @ joint.axis)
            if _floats(chain, axes):
                base = tuple(chain)
        link = joint.child
    leaders = {joint.mimic.joint for joint in tree.joints if joint.mimic is not None}
    return () if any(joint.mimic or joint.name in leaders for joint in base) else base


def _floats(chain: Sequence[UrdfJoint], axes: Sequence[Array]) -> bool:
    """Whether joints with these axes (3,), in the root link at zero, move freely in a plane or in space."""
    if len(chain) == 1 and chain[0].type in FREE_TYPES:
        return True
    slides = []
    rotations = []
    for joint, axis in zip(chain, axes, strict=True):
        if joint.type == "prismatic":
            slides.append(axis)
        elif joint.turns:
            rotations.append(axis)
    return len(slides) + len(rotations) == len(chain) and moves_freely(slides, rotations)


def moves_freely(slides: Sequence[Array], rotations: Sequence[Array]) -> bool:
    """Whether joints that slide along, and rotate about, axes (3,) move freely in a plane or in space.

    Three slides that are independent at zero and three rotations of which none is about the axis of the one before
    reach every direction of motion at almost every position, though not at zero (as Euler angles z, x, z).
    """
    if (len(slides), len(rotations)) == (3, 3):
        pairs = pairwise(rotations)
        spread = all(np.linalg.norm(np.cross(one, other)) > INDEPENDENT for one, other in pairs)
        return spread and bool(abs(np.linalg.det(slides)) > INDEPENDENT)
    if (len(slides), len(rotations)) == (2, 1):
        is_normal = all(abs(axis @ rotations[0]) < INDEPENDENT for axis in slides)
        return is_normal and bool(np.linalg.norm(np.cross(slides[0], slides[1])) > INDEPENDENT)
    return False


def with_free_base(tree: UrdfTree, with_role: Collection[str] = ()) -> UrdfTree:
    """Return a robot whose joints of :func:`free_base` are fixed, and whose links before them are frames.

    Parameters
    ----------
    tree : UrdfTree
    with_role : names of joints to which the user gives a role
        Where all joints of the base are locked so, they stay as the file has them.

    Raises
    ------
    InputError
        A joint that floats, or moves in a plane, carries some links of the robot; or some joints of the base have a
        role, and others none.
    """
    base = free_base(tree)
    names = [joint.name for joint in base]
    misplaced = [joint for joint in tree.joints if joint.type in FREE_TYPES and joint.name not in names]
    if misplaced:
        reason = (
            f'has type "{misplaced[0].type}", and only a massless root link may carry the whole robot by such a joint: '
            f'what "{misplaced[0].parent}" carries by it would fly on its own'
        )
        advice = "fix it, or move its child by joints of one axis each"
        raise InputError(reason, element=f'joint "{misplaced[0].name}"', advice=advice)
    locked = [name for name in names if name in with_role]
    if not base or (locked == names and base[0].type not in FREE_TYPES):
        return tree
    if locked:
        reason = f"is one of the joints by which the robot's base floats: {', '.join(names)}"
        advice = "leave them all out" if base[0].type in FREE_TYPES else "leave them all out, or lock them all"
        raise InputError(reason, element=f'locked "{locked[0]}"', advice=advice)
    frames = {joint.parent for joint in tree.path(base[-1].child)}
    links = dict(tree.links)
    for name in frames:
        links[name] = replace(links[name], frame=True)
    joints = tuple(_fixed(joint) if joint.name in names else joint for joint in tree.joints)
    warning = f"read as the free base, and held at zero: {', '.join(names)}, by which the file lets the robot float"
    return replace(tree, links=links, joints=joints, warnings=(*tree.warnings, warning))


def _fixed(joint: UrdfJoint) -> UrdfJoint:
    """The same joint, fixed at zero."""
    return UrdfJoint(
        name=joint.name,
        type="fixed",
        parent=joint.parent,
        child=joint.child,
        origin=joint.origin,
        axis=joint.axis,
        lower=-np.inf,
        upper=np.inf,
        velocity=np.inf,
        effort=np.inf,
        mimic=None,
    )
