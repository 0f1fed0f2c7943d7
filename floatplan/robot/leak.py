"""How far a robot leaves its plane: legs that move apart roll the trunk, though their axes are in the plane."""

import math
from functools import lru_cache
from random import Random

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.planar.choice import choose_joints
from floatplan.robot.planar.mirror import mirror_couplings
from floatplan.robot.planar.model import BASE_COORDINATES, sample_postures
from floatplan.robot.robot import Robot

POSTURES = 64  # [-] random ones, of which the mean is taken
WORTH_A_WARNING = 0.05  # [-] of the leak: left/right coupled quadrupeds and humanoids stay below 0.02
MEANINGLESS = 0.3  # [-] a third of the momentum out of the plane: the robot rolls before it has rotated


@lru_cache(maxsize=64)
def out_of_plane_leak(robot: Robot) -> float:
    """How much angular momentum the planned joints make out of the plane, relative to that in it.

    With a base that does not rotate, joint rates q' make the angular momentum ``A q'`` about the centre of mass: one
    row of A along the normal, two rows in the plane. The leak is the ratio of the root mean squares of these two and
    of that one, over all directions of q' and over random postures within the limits. It is 0 for a robot that is its
    own mirror image in the plane, 1e-4 to 1e-2 for quadrupeds with left and right legs coupled, and of order 1 with
    legs that move apart.
    """
    _, maps = centroidal_maps(robot, sample_postures(robot.position_limits, POSTURES, Random(0)))
    momenta = _axes(robot) @ maps @ robot.selection
    out_of_plane = (momenta[:, :2] ** 2).sum()
    return math.sqrt(out_of_plane / (momenta[:, 2] ** 2).sum())


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
    tree = robot.joint_tree
    choice = choose_joints(
        tree, plane=robot.plane.name, joints=robot.joints, coupled=robot.coupled, locked=robot.locked
    )
    try:
        pairs = mirror_couplings(tree, choice, None)
    except InputError:
        return f"{text}: a motion planned in the plane is {verdict}"
    listed = ", ".join(f"{follower} with {coupling.leader}" for follower, coupling in pairs.items())
    return f'{text}: a motion planned in the plane is {verdict}; couple {listed} (coupled = "mirror")'


def leak_along(robot: Robot, positions: Array, velocities: Array, orientation_rates: Array, momentum: float) -> float:
    """Return the leak of one motion: its largest momentum out of the plane over that in it.

    In it there are two momenta that may cancel, the joints' own and the whole (4); the largest magnitude of
    either over the motion counts. Both are 0 for a robot that does not move: so is the leak then.

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
    maps = _axes(robot) @ centroidal_maps(robot, positions)[1]
    of_joints = np.einsum("tij,tj->ti", maps @ robot.selection, velocities)
    whole = of_joints + maps[:, :, BASE_COORDINATES - 1] * orientation_rates[:, None]
    largest = max(abs(momentum), float(np.abs(of_joints[:, 2]).max()))
    return float(np.linalg.norm(whole[:, :2], axis=1).max() / largest) if largest else 0.0


def _axes(robot: Robot) -> Array:
    """The plane's horizontal, vertical and normal (3, 3), as rows."""
    return np.stack([robot.plane.horizontal, robot.plane.vertical, robot.plane.normal])


def centroidal_maps(robot: Robot, positions: Array) -> tuple[Array, Array]:
    """Inertia (K, 3, 3), kg m^2, and maps (K, 3, nv) to angular momentum, both about the centre of mass.

    They are those at planned positions (K, n): of the whole robot as if it were rigid, and by the velocities of its
    model; in the base's axes.
    """
    model = robot.model
    data = robot.model.createData()
    none = np.zeros(model.nv)
    full = robot.reference + positions @ robot.selection.T
    inertia = np.empty((len(full), 3, 3))
    maps = np.empty((len(full), 3, model.nv))
    for k, q in enumerate(full):
        maps[k] = pin.ccrba(model, data, q, none)[3:]
        inertia[k] = data.Ig.inertia
    return inertia, maps
