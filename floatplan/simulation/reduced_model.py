"""The robot for forward dynamics: on its planar free-flyer, with gravity, its locked joints made rigid."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """A robot of m moving joints, the locked ones rigid; its configuration is ``reference + selection @ positions``.

    Attributes
    ----------
    model : pinocchio.Model with nq = nv = 3 + m, gravity on
    reference : (3 + m,) rad
    selection : (3 + m, n)
        With zeros for the base.
    axes : (2, 3)
        The plane's horizontal and vertical axis.
    """

    model: Any
    reference: Array
    selection: Array
    axes: Array


def reduced_model(robot: Robot, gravity: float, rigid: Collection[str] | None = None) -> ReducedModel:
    """Return the robot's model falling with ``gravity`` (m/s^2) down the plane.

    Its locked joints, or those that ``rigid`` names, are made rigid where the reference has them. Built joint by joint:
    ``buildReducedModel`` fails where a link and a joint share a name.
    """
    source = robot.model
    rigid = robot.locked if rigid is None else rigid
    data = source.createData()
    pin.forwardKinematics(source, data, np.array(robot.reference))
    model = pin.Model()
    model.gravity = pin.Motion(-gravity * np.asarray(robot.plane.vertical), np.zeros(3))
    carrier = {0: (0, pin.SE3.Identity())}  # joint of the source -> joint here, and where in its frame
    kept = []
    for joint in range(1, source.njoints):
        parent, placement = carrier[source.parents[joint]]
        name = source.names[joint]
        if name in rigid:
            carrier[joint] = (parent, placement * data.liMi[joint])
        else:
            added = model.addJoint(parent, source.joints[joint], placement * source.jointPlacements[joint], name)
            carrier[joint] = (added, pin.SE3.Identity())
            kept.append(source.joints[joint].idx_v)
        model.appendBodyToJoint(carrier[joint][0], source.inertias[joint], carrier[joint][1])
    axes = np.stack([robot.plane.horizontal, robot.plane.vertical])
    return ReducedModel(model, read_only(robot.reference[kept]), read_only(robot.selection[kept]), read_only(axes))
