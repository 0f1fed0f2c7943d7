"""The links' shapes in space: convex solids, as far as collision geometry goes; of a mesh its convex hull.

A link without ``<collision>`` is the segments from its own origin to the origins of its children's joints, as in the
plane.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.shapes.collisions import read_collision
from floatplan.robot.shapes.links import MOST_COLLISIONS
from floatplan.robot.urdf.tree import UrdfTree


@dataclass(frozen=True, eq=False)
class LinkSolid:
    """The convex hull of points, grown by an ellipsoid: a ball where something is round, a disc of a cylinder.

    Attributes
    ----------
    link : whose it is
    body : which joint of the robot's model carries it
    points : (k, 3) m, in that joint's frame
    axes : (3, 3) m, the ellipsoid's semi-axes, as columns
    """

    link: str
    body: int
    points: Array
    axes: Array

    def reach(self, directions: Array) -> Array:
        """How far (N,) it reaches from the frame's origin along unit vectors (N, 3) in the frame, m."""
        return np.asarray((directions @ self.points.T).max(axis=1) + np.linalg.norm(directions @ self.axes, axis=1))


def link_solids(model: Any, tree: UrdfTree, folder: Path, meshes: Mapping[str, str]) -> tuple[LinkSolid, ...]:
    """Return the solids of all links, in the order of the links in the file.

    Parameters
    ----------
    model : pinocchio.Model
    tree : UrdfTree
    folder : path
        Of the URDF, from which mesh files are searched.
    meshes : mapping
        What :func:`~floatplan.robot.shapes.links.mesh_digests` said of the files.

    Raises
    ------
    InputError
        As of :func:`~floatplan.robot.shapes.links.link_shapes`.
    """
    count = sum(len(link.collisions) for link in tree.links.values())
    if count > MOST_COLLISIONS:
        raise InputError(f"has {count} collision elements, more than {MOST_COLLISIONS}", advice="simplify its geometry")
    solids: list[LinkSolid] = []
    for name, link in tree.links.items():
        read = [read_collision(name, collision, folder, meshes) for collision in link.collisions]
        found = [geometry.solid() for geometry in read if geometry is not None]
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        rotation, shift = frame.placement.rotation, frame.placement.translation
        for points, axes in found or [(points, np.zeros((3, 3))) for points in _segments(tree, name)]:
            solids.append(LinkSolid(name, int(frame.parentJoint), points @ rotation.T + shift, rotation @ axes))
    return tuple(solids)


def frame_place(model: Any, tree: UrdfTree, name: str) -> tuple[int, Array]:
    """Return which joint of a model carries a link's or joint's origin, and its place (3,) in that joint's frame, m."""
    link = name if name in tree.links else tree.joint[name].child  # which has the joint's origin
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), frame.placement.translation.copy()


def _segments(tree: UrdfTree, link: str) -> list[Array]:
    """From a link's origin to those of its children's joints, (2, 3) m each; a point where there is none but mass."""
    if tree.links[link].frame:
        return []
    ends = [joint.origin.placement.translation for joint in tree.joints if joint.parent == link]
    segments = [np.stack((np.zeros(3), end)) for end in ends if np.any(end)]
    return segments or [np.zeros((1, 3))] * (tree.links[link].inertial is not None)
