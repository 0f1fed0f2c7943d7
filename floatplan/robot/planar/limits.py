"""Limits of the planned joints; those of a follower are carried over to its leader."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.parts import Coupling
from floatplan.robot.urdf.tree import UrdfTree


def planned_limits(
    tree: UrdfTree, planned: tuple[str, ...], coupled: Mapping[str, Coupling], geared: Collection[str]
) -> tuple[Array, Array, Array]:
    """Return limits of position (n, 2) rad, velocity (n,) rad/s and torque (n,) N m; infinite where not given.

    Positions and velocities of a leader are those that keep its followers within their limits too. The torque of a
    planned coordinate is that of all its motors together, by ratio; its limit is the sum of ``|ratio| * limit`` over
    them. Followers that are ``geared`` to their leader by the file have no motor, and add nothing.

    Raises
    ------
    InputError
        If a leader and its followers have no common range.
    """
    position = np.array([[tree.joint[name].lower, tree.joint[name].upper] for name in planned])
    velocity = np.array([tree.joint[name].velocity for name in planned])
    torque = np.array([tree.joint[name].effort for name in planned])
    for name, coupling in coupled.items():
        row = planned.index(coupling.leader)
        joint = tree.joint[name]
        ends = sorted((limit - coupling.offset) / coupling.ratio for limit in (joint.lower, joint.upper))
        position[row] = max(position[row, 0], ends[0]), min(position[row, 1], ends[1])
        velocity[row] = min(velocity[row], joint.velocity / abs(coupling.ratio))
        torque[row] += 0.0 if name in geared else joint.effort * abs(coupling.ratio)
        if not position[row, 0] < position[row, 1]:
            reason = f'its limits leave its leader "{coupling.leader}" no range to move in'
            raise InputError(reason, element=f'coupled "{name}"', advice="check the ratio's sign and the offset")
    return read_only(position), read_only(velocity), read_only(torque)
