"""How far a robot leaves its plane: legs that swing apart roll the trunk, though their axes are in the plane."""

from __future__ import annotations

import math
from functools import lru_cache
from random import Random
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.planar.choice import choose_joints
from floatplan.robot.planar.mirror import mirror_couplings
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.planar.model_check import sample_postures
from floatplan.robot.robot import Robot

POSTURES = 64  # [-] of which the mean is taken
WORTH_A_WARNING = 0.05  # [-] of the leak: left/right coupled quadrupeds and humanoids stay below 0.02
MEANINGLESS = 0.3  # [-] with a third of the momentum out of the plane, the robot rolls before it has turned


@lru_cache(maxsize=64)
def out_of_plane_leak(robot: Robot, *, postures: int = POSTURES, seed: int = 0) -> float:
    """How much angular momentum the planned joints make out of the plane, relative to that in it.

    With the base's orientation held, joint rates q' make the angular momentum ``A q'`` about the centre of mass: one
    row of A along the normal, two rows in the plane. The leak is the ratio of the root mean squares of these two and
    of that one, over all directions of q' and over random postures within the limits. It is 0 for a robot that is its
    own mirror image in the plane.

    Parameters
    ----------
    robot : Robot
    postures : int
        How many random postures.
    seed : int
        Of their random numbers.

    Returns
    -------
    float
        From 1e-4 to 1e-2 for quadrupeds with left and right legs coupled, of order 1 with legs that move apart.
    """
    data = robot.model.createData()
    in_plane = out_of_plane = 0.0
    for positions in sample_postures(robot.position_limits, postures, Random(seed)):
        momenta = _angular_map(robot, data, positions) @ robot.selection
        in_plane += float(((robot.plane.normal @ momenta) ** 2).sum())
        out_of_plane += float(((_plane_axes(robot) @ momenta) ** 2).sum())
    return math.sqrt(out_of_plane / in_plane)


def refuse_leak(robot: Robot) -> None:
    """Refuse a robot whose planned joints make so much momentum out of the plane that a plan would mean nothing.

    Raises
    ------
    InputError
        The leak is ``MEANINGLESS`` or more; the advice names the couplings that would help.
    """
    leak = out_of_plane_leak(robot)
    if leak >= MEANINGLESS:
        reason, _, advice = str(explain_leak(robot, leak)).partition("; ")
        raise InputError(reason, source=robot.source, element="robot", advice=advice or None)


def explain_leak(robot: Robot, leak: float) -> str | None:
    """Return a sentence about a leak worth a warning, with the couplings that would help; None for a small one."""
    if leak < WORTH_A_WARNING:
        return None
    verdict = "meaningless" if leak >= MEANINGLESS else "only an approximation"
    text = f"the joints' motion makes {leak:.2g} times as much angular momentum out of the plane as in it"
    tree = robot.layout.tree
    choice = choose_joints(
        tree, plane=robot.plane.name, joints=robot.joints, coupled=robot.coupled, locked=robot.locked
    )
    try:
        pairs = mirror_couplings(tree, choice, None)
    except InputError:
        return f"{text}: a motion planned in the plane is {verdict}"
    listed = ", ".join(f"{follower} with {coupling.leader}" for follower, coupling in pairs.items())
    return f'{text}: a motion planned in the plane is {verdict}; couple {listed} (coupled = "mirror")'


def out_of_plane_momentum(robot: Robot, positions: Array, velocities: Array, orientation_rates: Array) -> Array:
    """Return the angular momentum about the centre of mass that a motion should not have.

    Parameters
    ----------
    robot : Robot
    positions, velocities : (times, n)
        Planned joints, rad and rad/s.
    orientation_rates : (times,)
        rad/s.

    Returns
    -------
    (times, 2) array
        Components along the plane's horizontal and vertical axis as they turn with the base, kg m^2/s.
    """
    data = robot.model.createData()
    momenta = np.empty((len(positions), 2))
    for row, (position, velocity, rate) in enumerate(zip(positions, velocities, orientation_rates, strict=True)):
        full = _angular_map(robot, data, position)
        momenta[row] = _plane_axes(robot) @ (full[:, BASE_COORDINATES - 1] * rate + full @ robot.selection @ velocity)
    return momenta


def leak_along(robot: Robot, positions: Array, velocities: Array, orientation_rates: Array, momentum: float) -> float:
    """Return the leak of one motion: its largest momentum out of the plane over that in it.

    In it there are two parts that may cancel, the joints' momentum with the base held and the whole (4); the largest
    magnitude of either over the motion counts. Both are 0 for a robot that does not move: so is the leak then.

    Parameters
    ----------
    robot : Robot
    positions, velocities : (times, n)
        Planned joints, rad and rad/s.
    orientation_rates : (times,)
        rad/s.
    momentum : float
        h, kg m^2/s.
    """
    data = robot.model.createData()
    largest = abs(momentum)
    for position, velocity in zip(positions, velocities, strict=True):
        in_plane = robot.plane.normal @ _angular_map(robot, data, position) @ robot.selection @ velocity
        largest = max(largest, abs(float(in_plane)))
    leaked = np.linalg.norm(out_of_plane_momentum(robot, positions, velocities, orientation_rates), axis=1)
    return float(leaked.max() / largest) if largest else 0.0


def _angular_map(robot: Robot, data: Any, positions: Array) -> Array:
    """Angular momentum (3, nv) about the centre of mass per velocity, at planned positions (n,)."""
    full = robot.reference + robot.selection @ positions
    return np.asarray(pin.computeCentroidalMap(robot.model, data, full)[3:])


def _plane_axes(robot: Robot) -> Array:
    return np.stack([robot.plane.horizontal, robot.plane.vertical])
