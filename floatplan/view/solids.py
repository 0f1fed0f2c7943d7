"""Robots in space as pictures draw them: convex polyhedra, seen from one side without perspective."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.links import LINE_RADIUS
from floatplan.robot.shapes.solids import evenly

DIRECTIONS = 40  # [-] in which a solid that is round is as large as it is
AZIMUTH = math.radians(-62.0)  # from where pictures look: +x is to the right
ELEVATION = math.radians(18.0)


@dataclass(frozen=True, eq=False)
class Camera:
    """Directions (3,) in the world: to the right, upwards, and towards who looks."""

    right: Array
    up: Array
    toward: Array

    @classmethod
    def at(cls, azimuth: float, elevation: float) -> Camera:
        """Look from an azimuth about the vertical, from +x, and an elevation, rad."""
        (c, s) = (math.cos(azimuth), math.sin(azimuth))
        (low, high) = (math.cos(elevation), math.sin(elevation))
        return cls(np.array([-s, c, 0.0]), np.array([-c * high, -s * high, low]), np.array([c * low, s * low, high]))

    def __call__(self, points: Array) -> ComplexArray:
        """Places (...) in the picture of points (..., 3)."""
        return np.asarray(points @ self.right + 1j * (points @ self.up))


CAMERA = Camera.at(AZIMUTH, ELEVATION)


@dataclass(frozen=True, eq=False)
class DrawnSolid:
    """A polyhedron: its link, the joint of the model that carries it, its part, corners (k, 3), m, triangles (f, 3).

    ``part`` is 0 of the base, i + 1 of what joint i moves; corners go around triangles against the clock.
    """

    link: str
    body: int
    part: int
    points: Array
    faces: IntArray


@lru_cache(maxsize=8)
def drawn_solids(robot: Robot) -> tuple[DrawnSolid, ...]:
    """Return a robot's links as they are drawn; errors as of :attr:`Robot.solids`."""
    part = np.zeros(robot.model.njoints, dtype=np.int64)
    for joint in range(1, len(part)):
        row = np.abs(robot.selection[robot.model.idx_vs[joint]])
        part[joint] = 1 + int(row.argmax()) if row.any() else part[robot.model.parents[joint]]
    sizes = [float(np.ptp(solid.points, axis=0).max() + np.abs(solid.axes).max()) for solid in robot.solids]
    thickness = LINE_RADIUS * float(np.median([size for size in sizes if size > 0] or [1.0]))
    directions = evenly(DIRECTIONS)
    drawn = []
    for solid, size in zip(robot.solids, sizes, strict=True):
        if size == 0 and any(sizes):
            continue  # a link of no extent, such as a rotor
        flat = not solid.axes.any() and np.linalg.matrix_rank(solid.points - solid.points[0]) < 3
        axes = thickness * np.eye(3) if flat else solid.axes
        around = evenly(DIRECTIONS) @ axes.T if axes.any() else np.zeros((1, 3))
        points = (solid.points[:, None] + around).reshape(-1, 3)
        if len(points) > DIRECTIONS:
            points = points[np.unique((directions @ points.T).argmax(axis=1))]
        hull = trimesh.convex.convex_hull(points)
        drawn.append(
            DrawnSolid(solid.link, solid.body, int(part[solid.body]), np.array(hull.vertices), np.array(hull.faces))
        )
    return tuple(drawn)


def face_normals(points: Array, faces: IntArray) -> Array:
    """Outward unit normals (f, 3) of triangles (f, 3) between points (k, 3)."""
    first, second, third = points[faces].transpose(1, 0, 2)
    normals = np.cross(second - first, third - first)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))
