"""The robot of a flight in Pinocchio: joints that the flight locks are rigid, gravity is on."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.robot.robot import Robot

FRICTION_RATE = 0.5  # [rad/s] about which friction changes its sign: a step could not be integrated


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """A robot of m moving joints; with planned joints at ``q`` (n,) they are at ``reference + selection @ q``.

    Attributes
    ----------
    model : pinocchio.Model with nq = nv = 3 + m, gravity on; 7 + m and 6 + m in space
    reference : (nq,) rad
    selection : (nv, n)
        With zeros for the base.
    axes : (2, 3)
        The plane's horizontal and vertical axis; the identity in space.
    losses : (2, m) damping and friction of the joints, N m s/rad and N m
    """

    model: Any
    reference: Array
    selection: Array
    axes: Array
    losses: Array

    @property
    def joints(self) -> tuple[str, ...]:
        """Names (m,) of the joints that move."""
        return tuple(self.model.names)[self.base_joint + 1 :]

    @property
    def base_joint(self) -> int:
        """Number of the joint of ``model`` that carries the base's link."""
        return len(self.model.names) - 1 - len(self.losses[0])

    @property
    def is_spatial(self) -> bool:
        """Whether the base moves in space: a configuration holds its attitude as a quaternion."""
        return bool(self.model.nq > self.model.nv)

    @cached_property
    def of_joints(self) -> tuple[slice, slice]:
        """Entries of configurations and of velocities that are joints; the others are the base's."""
        m = self.losses.shape[1]
        return slice(self.model.nq - m, None), slice(self.model.nv - m, None)

    @cached_property
    def resting(self) -> Array:
        """Positions and rates (2, m) of the joints where the planned ones are at zero, without rates."""
        positions = self.reference[self.of_joints[0]]
        return read_only([positions, np.zeros_like(positions)])

    @cached_property
    def joint_selection(self) -> Array:
        """Rows (m, n) of the selection that are joints."""
        return self.selection[self.of_joints[1]]

    @cached_property
    def planned_of_joints(self) -> Array:
        """Matrix (n, m) of the planned joints (n,) nearest to joints (m,), less ``resting``."""
        return read_only(np.linalg.pinv(self.joint_selection))

    def lost(self, velocities: Array) -> Array:
        """Torques (m,) N m that the joints lose by damping and friction at velocities (m,), rad/s."""
        return np.asarray(self.losses[0] * velocities + self.losses[1] * np.tanh(velocities / FRICTION_RATE))

    def off_goal(self, joints: Array, goal: Any) -> tuple[Array, Array]:
        """Magnitudes of errors at a goal (n,), rad, of joints (m,).

        The largest (n,) of each planned joint and those that follow it, and of each joint that follows none.
        """
        off = np.abs(joints - (self.resting[0] + self.joint_selection @ np.asarray(goal, np.float64)))
        follows = self.joint_selection != 0.0
        return read_only((off[:, None] * follows).max(axis=0, initial=0.0)), off[~follows.any(axis=1)]


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
    model.gravity = pin.Motion(-gravity * robot.up, np.zeros(3))
    carrier = {0: (0, pin.SE3.Identity())}  # joint of the source -> joint here, and where in its frame
    positions: list[int] = []  # entries of the source's configurations that move here
    velocities: list[int] = []
    for number in range(1, source.njoints):
        parent, placement = carrier[source.parents[number]]
        name = source.names[number]
        if name in rigid:
            carrier[number] = (parent, placement * data.liMi[number])
        else:
            joint = source.joints[number]
            added = model.addJoint(parent, joint, placement * source.jointPlacements[number], name)
            carrier[number] = (added, pin.SE3.Identity())
            positions += range(joint.idx_q, joint.idx_q + joint.nq)
            velocities += range(joint.idx_v, joint.idx_v + joint.nv)
        model.appendBodyToJoint(carrier[number][0], source.inertias[number], carrier[number][1])
    model.armature = source.armature[velocities]
    names = [name for name in robot.model_joints if name not in rigid]
    losses = np.zeros((2, len(names)))
    for joint, name in enumerate(names):
        losses[:, joint] = robot.damping.get(name, 0.0), robot.friction.get(name, 0.0)
    return ReducedModel(
        model=model,
        reference=read_only(robot.reference[positions]),
        selection=read_only(robot.selection[velocities]),
        axes=read_only([robot.plane.horizontal, robot.plane.vertical] if robot.in_plane else np.eye(3)),
        losses=read_only(losses),
    )
