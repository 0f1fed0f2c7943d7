"""Joints that turn a wheel: without a range, and about the centre of mass of what they carry."""

import numpy as np

from floatplan.robot.robot import Robot

ON_AXIS = 1e-3  # [m] that the centre of mass of a wheel is off its axis
PLANNED = "planned in the range of limits.position, -180 to 180 degrees where it gives none"
HELD = "held, as they do not turn about the plane's normal, or were left out: they spin neither in plans nor in proofs"


def wheels(robot: Robot) -> dict[str, str]:
    """Return the wheels' links by their joints' names, also of joints that are not planned.

    Their turns move no mass away from where it was: they change how the robot turns, and not what it reaches.
    """
    tree = robot.joint_tree
    placements = tree.placements({})
    found: dict[str, str] = {}
    for joint in tree.joints:
        if not joint.turns or np.isfinite([joint.lower, joint.upper]).any():
            continue
        carried = [
            (link.inertial.mass, placements[name] * link.inertial.origin.placement.translation)
            for name, link in tree.links.items()
            if link.inertial is not None and (name == joint.child or joint in tree.path(name))
        ]
        masses = np.array([mass for mass, _ in carried])
        places = np.array([place for _, place in carried])
        if masses.sum() > 0:
            away = placements[joint.child].actInv(masses @ places / masses.sum())
            if np.linalg.norm(np.cross(away, joint.axis)) <= ON_AXIS:
                found[joint.name] = joint.child
    return found


def explain_wheels(robot: Robot) -> list[str]:
    """Return what is done with the wheels: a sentence about those that are planned, one about those that are held.

    Those that follow another joint turn as that does, in its range.
    """
    found = wheels(robot)
    planned = [name for name in found if name in robot.joints]
    held = [name for name in found if name in robot.locked]
    told = ((planned, PLANNED), (held, HELD))
    return [f"wheels, which turn about their own centres of mass: {', '.join(of)}: {how}" for of, how in told if of]
