"""Robots in space as pictures draw them: convex solids with faces, seen from one side without perspective."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid

LINK_RADIUS = 0.055  # [-] radius, as drawn, of links without a thickness of their own over their median length
AROUND, BALL = 20, 48  # [-] corners of a disc and of an ellipsoid
MOST_CORNERS = 26  # [-] of a mesh
COPLANAR = 1e-6  # [-] of normals and distances of triangles that are one face
AZIMUTH, ELEVATION = math.radians(-62.0), math.radians(18.0)  # from where pictures look: +x is to the right


@dataclass(frozen=True, eq=False)
class Camera:
    """Directions (3,) in the world: to the right, upwards, and towards who looks."""

    right: Array
    up: Array
    toward: Array

    @classmethod
    def at(cls, azimuth: float, elevation: float) -> Camera:
        """Look from an azimuth about the vertical, from +x, and an elevation, rad."""
        (c, s), (low, high) = (math.cos(azimuth), math.sin(azimuth)), (math.cos(elevation), math.sin(elevation))
        return cls(np.array([-s, c, 0.0]), np.array([-c * high, -s * high, low]), np.array([c * low, s * low, high]))

    def __call__(self, points: Array) -> ComplexArray:
        """Places (...) in the picture of points (..., 3)."""
        return np.asarray(points @ self.right + 1j * (points @ self.up))


CAMERA = Camera.at(AZIMUTH, ELEVATION)


@dataclass(frozen=True, eq=False)
class DrawnSolid:
    """A convex polyhedron of a body, grown by a ball.

    Attributes
    ----------
    body, part : which joint of the model carries it; 0 for the base, i + 1 for what joint i moves
    points : (k, 3) m
    radius : m
    faces : corners of each face by their numbers, seen from outside against the clock; none of what is round
    """

    body: int
    part: int
    points: Array
    radius: float
    faces: list[list[int]]


@lru_cache(maxsize=8)
def drawn_solids(robot: Robot) -> tuple[DrawnSolid, ...]:
    """Return a robot's links as they are drawn; errors as of :attr:`Robot.solids`."""
    lengths = [np.ptp(solid.points, axis=0).max() for solid in robot.solids if not solid.axes.any()]
    thickness = LINK_RADIUS * float(np.median([length for length in lengths if length > 0] or [1.0]))
    part = np.zeros(robot.model.njoints, dtype=np.int64)
    for joint in range(2, len(part)):
        row = np.abs(robot.selection[robot.model.idx_vs[joint]])
        part[joint] = 1 + int(row.argmax()) if row.any() else part[robot.model.parents[joint]]
    bare = [not solid.axes.any() and not np.ptp(solid.points, axis=0).any() for solid in robot.solids]
    shown = [solid for solid, alone in zip(robot.solids, bare, strict=True) if not alone] or robot.solids
    return tuple(_drawn(solid, int(part[solid.body]), thickness) for solid in shown)


def _drawn(solid: LinkSolid, part: int, thickness: float) -> DrawnSolid:
    sizes = np.linalg.norm(solid.axes, axis=0)
    points, radius = solid.points, 0.0
    if np.ptp(sizes) <= COPLANAR * sizes.max():
        radius = float(sizes.max())
    else:
        rim = _circle() if (sizes == 0).any() else _sphere(BALL)
        kept = solid.axes[:, np.argsort(-sizes)[: rim.shape[1]]]
        points = (points[:, None] + rim @ kept.T).reshape(-1, 3)
    if len(points) > MOST_CORNERS and not sizes.any():
        points = points[np.unique((_sphere(MOST_CORNERS) @ points.T).argmax(axis=1))]
    faces = [] if radius else _faces(points)
    return DrawnSolid(solid.body, part, points, radius if radius or faces else thickness, faces)


def _circle() -> Array:
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    return np.stack((np.cos(angles), np.sin(angles)), axis=1)


def _sphere(count: int) -> Array:
    """Directions (count, 3), about evenly apart: a spiral from pole to pole."""
    heights = 1 - (2 * np.arange(count) + 1) / count
    angles = np.pi * (1 + math.sqrt(5)) * np.arange(count)
    rim = np.sqrt(1 - heights**2)
    return np.stack((rim * np.cos(angles), rim * np.sin(angles), heights), axis=1)


def _faces(points: Array) -> list[list[int]]:
    """Faces of the convex hull of points (k, 3); none where it is flat."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return []
    scale = np.append(np.ones(3), 1 / np.ptp(points, axis=0).max())
    of_plane: dict[tuple[float, ...], set[int]] = {}
    planes: list[Array] = []
    for corners, plane in zip(hull.simplices, hull.equations * scale, strict=True):
        near = next((known for known in planes if np.abs(known - plane).max() < COPLANAR), None)
        if near is None:
            planes.append(near := plane)
        of_plane.setdefault(tuple(near.tolist()), set()).update(corners.tolist())
    return [_ordered(points, np.array(sorted(corners)), np.array(plane[:3])) for plane, corners in of_plane.items()]


def _ordered(points: Array, corners: IntArray, normal: Array) -> list[int]:
    """Corners of a face around its outward normal (3,)."""
    arms = points[corners] - points[corners].mean(axis=0)
    across = arms[0] / np.linalg.norm(arms[0])
    angles = np.arctan2(arms @ np.cross(normal, across), arms @ across)
    return list(map(int, corners[np.argsort(angles)]))


def face_normals(points: Array, faces: Sequence[Sequence[int]]) -> Array:
    """Outward unit normals (f, 3) of the faces of a polyhedron of corners (k, 3)."""
    first, second, third = points[[face[:3] for face in faces]].reshape(-1, 3, 3).transpose(1, 0, 2)
    normals = np.cross(second - first, third - first)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
