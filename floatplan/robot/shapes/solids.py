"""The links' shapes in space: convex solids, as far as collision geometry goes; of a mesh its convex hull.

A link without ``<collision>`` is the segments from its own origin to the origins of its children's joints, as in the
plane.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.robot.shapes.collisions import Geometry, read_collision
from floatplan.robot.shapes.links import MOST_COLLISIONS
from floatplan.robot.urdf.tree import UrdfTree


@dataclass(frozen=True, eq=False)
class LinkSolid:
    """The convex hull of points, grown by an ellipsoid: a ball where something is round, a disc of a cylinder.

    Attributes
    ----------
    link : its name
    body : joint of the robot's model that carries it
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


@dataclass(frozen=True, eq=False)
class SolidCapsule:
    """A link's shape in space: all points within ``radius`` of the segment from ``start`` to ``end``.

    ``body`` is the joint of the robot's model that carries it; ``start`` and ``end`` (3,) are in that joint's frame, m.
    """

    link: str
    body: int
    start: Array
    end: Array
    radius: float

    @property
    def volume(self) -> float:
        """Volume, m^3."""
        length = float(np.linalg.norm(self.end - self.start))
        return float(np.pi * self.radius**2 * (length + 4 / 3 * self.radius))

    def depth(self, points: Array) -> Array:
        """How far inside the capsule each point is (points,), m; negative outside."""
        along = self.end - self.start
        squared = float(along @ along)
        share = np.clip((points - self.start) @ along / squared, 0.0, 1.0) if squared else np.zeros(len(points))
        return np.asarray(self.radius - np.linalg.norm(points - self.start - share[:, None] * along, axis=1))


def link_solids(model: Any, tree: UrdfTree, folder: Path, meshes: Mapping[str, str]) -> tuple[LinkSolid, ...]:
    """Return the solids of all links, in the order of the links in the file.

    Parameters
    ----------
    model : pinocchio.Model
    tree : UrdfTree
    folder : path
        Of the URDF, from which mesh files are searched.
    meshes : mapping
        Of the files, from :func:`~floatplan.robot.shapes.links.mesh_digests`.

    Raises
    ------
    InputError
        As of :func:`~floatplan.robot.shapes.links.link_shapes`.
    """
    solids: list[LinkSolid] = []
    for link, body, placement, geometries in link_geometries(model, tree, folder, meshes):
        solids_of_link = [geometry.solid() for geometry in geometries]
        if not solids_of_link:
            solids_of_link = [(points, np.zeros((3, 3))) for points in link_lines(tree, link)]
        for points, axes in solids_of_link:
            placed = points @ placement.rotation.T + placement.translation
            solids.append(LinkSolid(link, body, placed, placement.rotation @ axes))
    return tuple(solids)


def link_geometries(
    model: Any, tree: UrdfTree, folder: Path, meshes: Mapping[str, str]
) -> Iterator[tuple[str, int, Any, list[Geometry]]]:
    """Yield each link, the joint of the model that carries it, its placement in there, and its collision geometry.

    Parameters and errors are those of :func:`link_solids`; placements are ``pinocchio.SE3``.
    """
    count = sum(len(link.collisions) for link in tree.links.values())
    if count > MOST_COLLISIONS:
        raise InputError(f"has {count} collision elements, more than {MOST_COLLISIONS}", advice="simplify its geometry")
    for name, link in tree.links.items():
        geometries = []
        for collision in link.collisions:
            geometry = read_collision(name, collision, folder, meshes)
            if geometry is not None:
                geometries.append(geometry)
        body, placement = link_placement(model, name)
        yield name, body, placement, geometries


def link_placement(model: Any, link: str) -> tuple[int, Any]:
    """Return the joint of a model that carries a link, and the link's placement, ``pinocchio.SE3``, in its frame."""
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), frame.placement


def frame_position(model: Any, tree: UrdfTree, name: str) -> tuple[int, Array]:
    """Return the joint of a model that carries a link's or joint's origin, and its position (3,) in that frame, m."""
    link = name if name in tree.links else tree.joint[name].child  # which has the joint's origin
    body, placement = link_placement(model, link)
    return body, placement.translation.copy()


def link_lines(tree: UrdfTree, link: str) -> list[Array]:
    """From a link's origin to those of its children's joints, (2, 3) m each; a point where there is none but mass."""
    if tree.links[link].frame:
        return []
    ends = [joint.origin.placement.translation for joint in tree.joints if joint.parent == link]
    segments = [np.stack((np.zeros(3), end)) for end in ends if np.any(end)]
    return segments or [np.zeros((1, 3))] * (tree.links[link].inertial is not None)


def evenly(count: int) -> Array:
    """Directions (count, 3), about evenly apart: a spiral from pole to pole."""
    heights = 1 - (2 * np.arange(count) + 1) / count
    angles = np.pi * (1 + math.sqrt(5)) * np.arange(count)
    rim = np.sqrt(1 - heights**2)
    return np.stack((rim * np.cos(angles), rim * np.sin(angles), heights), axis=1)
