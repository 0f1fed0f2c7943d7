"""Robots and obstacles in space in pictures: convex polyhedra, seen from one side without perspective."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.problem.parts import Obstacle
from floatplan.problem.spatial_obstacles import Box, Capsule, Sphere
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.collisions import CUBE
from floatplan.robot.shapes.links import LINE_RADIUS
from floatplan.robot.shapes.solids import evenly

AZIMUTH = math.radians(-62.0)  # [rad] of the viewer about the vertical, from +x, which is then to the right
ELEVATION = math.radians(18.0)  # [rad] of the viewer: the ground is seen from above


@dataclass(frozen=True, eq=False)
class Camera:
    """Directions (3,) in the world: to the right, upwards, and towards the viewer."""

    right: Array
    up: Array
    toward: Array

    @classmethod
    def at(cls, azimuth: float, elevation: float) -> Camera:
        """Look from an azimuth about the vertical, from +x, and an elevation, rad."""
        c = math.cos(azimuth)
        s = math.sin(azimuth)
        low = math.cos(elevation)
        high = math.sin(elevation)
        return cls(np.array([-s, c, 0.0]), np.array([-c * high, -s * high, low]), np.array([c * low, s * low, high]))

    def __call__(self, points: Array) -> ComplexArray:
        """Positions (...) in the picture of points (..., 3)."""
        return np.asarray(points @ self.right + 1j * (points @ self.up))


CAMERA = Camera.at(AZIMUTH, ELEVATION)


@dataclass(frozen=True, eq=False)
class RenderedSolid:
    """A polyhedron of a link.

    Attributes
    ----------
    link : its name
    body : joint of the model that carries it
    segment : 0 of the base, i + 1 of what joint i moves
    points : (k, 3) m, corners
    faces : (f, 3) triangles, their corners anticlockwise
    """

    link: str
    body: int
    segment: int
    points: Array
    faces: IntArray


@lru_cache(maxsize=8)
def rendered_solids(robot: Robot) -> tuple[RenderedSolid, ...]:
    """Return a robot's links as polyhedra; errors as of :attr:`Robot.solids`."""
    model = robot.model
    segments = np.zeros(model.njoints, dtype=np.int64)
    for joint in range(1, len(segments)):
        ratios = np.abs(robot.selection[model.idx_vs[joint]])
        segments[joint] = 1 + int(ratios.argmax()) if ratios.any() else segments[model.parents[joint]]
    sizes = [float(np.ptp(solid.points, axis=0).max() + np.abs(solid.axes).max()) for solid in robot.solids]
    thickness = LINE_RADIUS * float(np.median([size for size in sizes if size > 0] or [1.0]))
    directions = evenly(40)  # so many corners make a round solid look round
    rendered = []
    for solid, size in zip(robot.solids, sizes, strict=True):
        if size == 0 and any(sizes):
            continue  # a link of no extent, such as a rotor
        is_flat = not solid.axes.any() and np.linalg.matrix_rank(solid.points - solid.points[0]) < 3
        axes = thickness * np.eye(3) if is_flat else solid.axes
        around = directions @ axes.T if axes.any() else np.zeros((1, 3))
        points = (solid.points[:, None] + around).reshape(-1, 3)
        if len(points) > len(directions):  # the farthest in each direction are enough
            points = points[np.unique((directions @ points.T).argmax(axis=1))]
        hull = trimesh.convex.convex_hull(points)
        segment = int(segments[solid.body])
        rendered.append(RenderedSolid(solid.link, solid.body, segment, np.array(hull.vertices), np.array(hull.faces)))
    return tuple(rendered)


def obstacle_corners(obstacle: Obstacle, margin: float = 0.0) -> Array:
    """Corners (k, 3), m, of a polyhedron that represents an obstacle at takeoff, grown by a margin.

    None of a half-space, which has no end.
    """
    if isinstance(obstacle, Sphere):
        return np.asarray(obstacle.center + (obstacle.radius + margin) * evenly(200))
    if isinstance(obstacle, Capsule):
        around = (obstacle.radius + margin) * evenly(200)
        return np.concatenate((obstacle.start + around, obstacle.end + around))
    if isinstance(obstacle, Box):
        return np.asarray(obstacle.center + CUBE * (np.array(obstacle.size) + 2 * margin))
    return np.empty((0, 3))


def obstacle_solid(obstacle: Obstacle) -> tuple[Array, IntArray]:
    """Corners (k, 3), m, and triangles (f, 3) of a bounded obstacle at takeoff."""
    hull = trimesh.convex.convex_hull(obstacle_corners(obstacle))
    return np.array(hull.vertices), np.array(hull.faces)


def face_normals(points: Array, faces: IntArray) -> Array:
    """Outward unit normals (f, 3) of triangles (f, 3) between points (k, 3)."""
    first, second, third = points[faces].transpose(1, 0, 2)
    normals = np.cross(second - first, third - first)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))
