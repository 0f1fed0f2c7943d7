"""Distances in space between the links' capsules and obstacles or one another, exact along the links.

A distance is between surfaces and negative where they overlap, from a box by that of its faces which is farthest. The
kernel has the same with derivatives, ``distances.hpp``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.problem.parts import Obstacle
from floatplan.problem.spatial_obstacles import Box, Capsule, HalfSpace, LevelGround, Sphere
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid, SolidCapsule


@dataclass(frozen=True, eq=False)
class SpatialSegments:
    """Capsules over K instants: ``start, end`` (K, S, 3) m, ``radius`` (S,) m."""

    start: Array
    end: Array
    radius: Array

    def distances(self, obstacle: Obstacle, times: Array) -> Array:
        """Distances (K, r), m, to an obstacle: as many rows per capsule as its kind says."""
        shift = np.asarray(obstacle.velocity) * times[:, None]
        return SPATIAL_DISTANCES[obstacle.kind][0](self, obstacle, shift)

    def of(self, capsules: IntArray) -> SpatialSegments:
        """Return some of them, by index."""
        return SpatialSegments(self.start[:, capsules], self.end[:, capsules], self.radius[capsules])


@dataclass(frozen=True, eq=False)
class SpatialShapes:
    """Capsules of a robot, ready to be placed.

    Attributes
    ----------
    links : link of each, but for the hulls
    body : (S,) joint of the robot's model that carries it
    ends : (S, 2, 3) m, in that joint's frame
    radius : (S,) m
    hulls : the links' solids, where their height over the ground counts
        The last of the S are theirs, of no size: they are at the lowest point.
    """

    links: tuple[str, ...]
    body: IntArray
    ends: Array
    radius: Array
    hulls: tuple[LinkSolid, ...]

    @classmethod
    def of(cls, capsules: tuple[SolidCapsule, ...], hulls: tuple[LinkSolid, ...]) -> SpatialShapes:
        """Gather capsules, and solids where these are wanted."""
        ends = [(shape.start, shape.end) for shape in capsules] + [(np.zeros(3), np.zeros(3))] * len(hulls)
        return cls(
            links=tuple(shape.link for shape in capsules),
            body=np.array([shape.body for shape in capsules] + [shape.body for shape in hulls], np.int64),
            ends=np.array(ends).reshape(-1, 2, 3),
            radius=np.array([shape.radius for shape in capsules] + [0.0] * len(hulls)),
            hulls=hulls,
        )

    def facing(self, obstacle: Obstacle) -> range:
        """Indices of the shapes whose distances to an obstacle count: the hulls' where it is the ground."""
        first = len(self.links)
        return range(first, len(self.radius)) if self.hulls and isinstance(obstacle, LevelGround) else range(first)

    def place(self, poses: BodyPoses) -> SpatialSegments:
        """Place the capsules where the bodies are."""
        turned = np.einsum("ksab,sea->kseb", np.swapaxes(poses.rotations[:, self.body], 2, 3), self.ends)
        ends = poses.places[:, self.body, None] + turned
        return SpatialSegments(ends[:, :, 0], ends[:, :, 1], self.radius)


@lru_cache(maxsize=64)
def shapes_in_space(robot: Robot, over_ground: bool = False) -> SpatialShapes:
    """Return a robot's capsules, ready to be placed, and its solids where their height over the ground counts."""
    return SpatialShapes.of(robot.solid_capsules, robot.solids if over_ground else ())


def _sphere(segments: SpatialSegments, obstacle: Sphere, shift: Array) -> Array:
    center = (np.array(obstacle.center) + shift)[:, None]
    return _to_point(center, segments.start, segments.end) - segments.radius - obstacle.radius


def _bar(segments: SpatialSegments, obstacle: Capsule, shift: Array) -> Array:
    start = (np.array(obstacle.start) + shift)[:, None]
    end = (np.array(obstacle.end) + shift)[:, None]
    return _between(segments.start, segments.end, start, end) - segments.radius - obstacle.radius


def _half_space(segments: SpatialSegments, obstacle: HalfSpace, shift: Array) -> Array:
    normal = np.array(obstacle.unit_normal)
    level = (np.array(obstacle.point) + shift) @ normal
    ends = np.concatenate((segments.start, segments.end), axis=1)
    return np.asarray(ends @ normal - level[:, None] - np.tile(segments.radius, 2))


def _box(segments: SpatialSegments, obstacle: Box, shift: Array) -> Array:
    """By that of six faces from which the capsule's nearer end is farthest."""
    center = (np.array(obstacle.center) + shift)[:, None]
    start = segments.start - center
    end = segments.end - center
    beyond = np.maximum(np.minimum(start, end), -np.maximum(start, end)) - np.array(obstacle.size) / 2
    return np.asarray(beyond.max(axis=2) - segments.radius)


# Distances to a kind of obstacle, from its displacements (K, 3) since takeoff, m; and how many rows per capsule they
# are: one of the nearest point along it, or two, of its ends.
SPATIAL_DISTANCES: dict[str, tuple[Callable[[SpatialSegments, Any, Array], Array], int]] = {
    "sphere": (_sphere, 1),
    "capsule": (_bar, 1),
    "half-space": (_half_space, 2),
    "box": (_box, 1),
}


def pair_distances_in_space(first: SpatialSegments, second: SpatialSegments) -> Array:
    """Distances between the capsules of two links, every pair a row."""
    pairs = np.indices((first.start.shape[1], second.start.shape[1]))
    own = first.of(pairs[0].ravel())
    other = second.of(pairs[1].ravel())
    return _between(own.start, own.end, other.start, other.end) - own.radius - other.radius


def _to_point(point: Array, start: Array, end: Array) -> Array:
    along = end - start
    squared = np.maximum((along * along).sum(axis=-1), 1e-300)
    share = np.clip((along * (point - start)).sum(axis=-1) / squared, 0, 1)
    return np.asarray(np.linalg.norm(start + share[..., None] * along - point, axis=-1))


def _between(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """Distance between segments: that at one of four ends, or between the lines where these are nearest inside both."""
    at_ends = [
        _to_point(start, other_start, other_end),
        _to_point(end, other_start, other_end),
        _to_point(other_start, start, end),
        _to_point(other_end, start, end),
    ]
    along = end - start
    other_along = other_end - other_start
    apart = start - other_start
    # Where the lines are nearest, Ericson, Real-Time Collision Detection, section 5.1.9, with its letters.
    a = (along * along).sum(axis=-1)
    b = (along * other_along).sum(axis=-1)
    c = (along * apart).sum(axis=-1)
    e = (other_along * other_along).sum(axis=-1)
    f = (other_along * apart).sum(axis=-1)
    squared = a * e - b * b
    # Segments are nearest at an end where the squared sine of the angle between them is below 1e-12: rounding.
    meets = squared > 1e-12 * a * e
    squared = np.where(meets, squared, 1.0)
    share = (b * f - c * e) / squared
    other_share = (a * f - b * c) / squared
    inside = meets & (share > 0) & (share < 1) & (other_share > 0) & (other_share < 1)
    way = np.linalg.norm(apart + share[..., None] * along - other_share[..., None] * other_along, axis=-1)
    return np.asarray(np.minimum(np.minimum.reduce(at_ends), np.where(inside, way, np.inf)))
