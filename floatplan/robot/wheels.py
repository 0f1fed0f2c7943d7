"""Joints that turn a wheel: without a range, and about the centre of mass of what they carry."""

import numpy as np

from floatplan.robot.robot import Robot

ON_AXIS = 1e-3  # [m] that the centre of mass of a wheel is off its axis


def wheels(robot: Robot) -> dict[str, str]:
    """Return the wheels' links by their joints' names, also of joints that are not planned.

    Their turns move no mass away from where it was: they change how the robot turns, and not what it reaches.
    """
    tree = robot.layout.tree
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
        masses, places = np.array([mass for mass, _ in carried]), np.array([place for _, place in carried])
        if masses.sum() > 0:
            away = placements[joint.child].actInv(masses @ places / masses.sum())
            if np.linalg.norm(np.cross(away, joint.axis)) <= ON_AXIS:
                found[joint.name] = joint.child
    return found
