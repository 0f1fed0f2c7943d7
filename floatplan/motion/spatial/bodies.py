"""Where the bodies of a robot in space are, and how low its links reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
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
