"""Where the bodies of a robot in space are, and how low its links reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.motion.spatial.dynamics import spatial_dynamics
from floatplan.problem.attitude import required
from floatplan.problem.parts import JointState
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid, frame_position


@dataclass(frozen=True, eq=False)
class BodyPoses:
    """The frames of the joints of a robot's model at K instants, in the world.

    Attributes
    ----------
    places : (K, B, 3) m
    rotations : (K, B, 3, 3)
    """

    places: Array
    rotations: Array

    @classmethod
    def of(cls, robot: Robot, attitudes: Array, positions: Array, com: Array) -> BodyPoses:
        """Poses of attitudes (K, 3, 3), positions (K, n) rad, and a centre of mass (K, 3), m."""
        dynamics = spatial_dynamics(robot)
        model = dynamics.model
        data = model.createData()  # of its own, as others may be computing with the robot's
        count = len(positions)
        bodies = model.njoints
        places = np.empty((count, bodies, 3))
        rotations = np.empty((count, bodies, 3, 3))
        for k, q in enumerate(dynamics.configurations(positions)):
            middle = pin.centerOfMass(model, data, q)
            for body, placement in enumerate(data.oMi):
                places[k, body] = placement.translation - middle
                rotations[k, body] = placement.rotation
        turned = np.einsum("kab,kib->kia", attitudes, places)
        return cls(turned + com[:, None], attitudes[:, None] @ rotations)

    @classmethod
    def posed(cls, robot: Robot, state: JointState, com: Array) -> BodyPoses:
        """Poses of a given posture, K = 1, with the centre of mass at (3,), m."""
        return cls.of(robot, required(state.attitude).matrix[None], state.positions[None], com[None])

    def points(self, body: int, local: Array) -> Array:
        """Places (K, k, 3) of points (k, 3) of a body, m."""
        return np.asarray(self.places[:, None, body] + np.einsum("kab,ib->kia", self.rotations[:, body], local))

    def frame(self, robot: Robot, name: str) -> Array:
        """Places (K, 3) of a link's or joint's origin, m."""
        body, place = frame_position(robot.model, robot.joint_tree, name)
        return self.points(body, place[None])[:, 0]

    def lowest(self, solid: LinkSolid) -> Array:
        """Heights (K,) of a solid's lowest point, m."""
        down = np.array([0.0, 0.0, -1.0])
        heights: Array = self.places[:, solid.body, 2] - solid.reach(down @ self.rotations[:, solid.body])
        return heights
