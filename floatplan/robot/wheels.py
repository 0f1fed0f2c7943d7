"""Joints of wheels: without a range, and about the centre of mass of the bodies they carry."""

import numpy as np

from floatplan.robot.robot import Robot


def wheels(robot: Robot) -> dict[str, str]:
    """Return the wheels' links by their joints' names, also of joints that are not planned.

    Their rotation moves no mass: it changes how the robot rotates, and not where it can land.
    """
    tree = robot.joint_tree
    placements = tree.placements({})
    result: dict[str, str] = {}
    for joint in tree.joints:
        if not joint.turns or np.isfinite([joint.lower, joint.upper]).any():
            continue
        mass = 0.0
        moment = np.zeros(3)
        for name, link in tree.links.items():
            carries = name == joint.child or joint in tree.path(name)
            if carries and link.inertial is not None:
                mass += link.inertial.mass
                moment += link.inertial.mass * (placements[name] * link.inertial.origin.placement.translation)
        if mass > 0:
            center = placements[joint.child].actInv(moment / mass)
            if np.linalg.norm(np.cross(center, joint.axis)) <= 1e-3:  # [m] off the axis
                result[joint.name] = joint.child
    return result


def explain_wheels(robot: Robot) -> list[str]:
    """Return how wheels are planned: a sentence about those that are planned, one about those that are locked.

    Those that follow another joint rotate as that does, in its range.
    """
    names = wheels(robot)
    text = "wheels, which turn about their own centres of mass"
    sentences = []
    for roles, how in (
        (robot.joints, "planned in the range of limits.position, -180 to 180 degrees where it gives none"),
        (
            robot.locked,
            "held, as they do not turn about the plane's normal, or were left out: they spin neither in plans nor in "
            "proofs",
        ),
    ):
        listed = [name for name in names if name in roles]
        if listed:
            sentences.append(f"{text}: {', '.join(listed)}: {how}")
    return sentences
