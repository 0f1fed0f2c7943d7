"""Distances (19)-(23) between the links' capsules and obstacles or one another, exact along the links.

Points are complex, horizontal + i vertical. A distance is between surfaces and negative where they overlap.
Their derivatives are the kernel's, ``distances.hpp``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray, IntArray
from floatplan.problem.parts import Bar, Circle, Ground, HalfPlane, Obstacle
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import LinkCapsule


@dataclass(frozen=True, eq=False)
class Segments:
    """The capsules of some links over K instants.

    ``start, end`` (K, S) complex, m; ``radius`` (S,) m. The last ``hulls`` of them are the links' hulls, for the ground
    alone; without any the capsules are.
    """

    start: ComplexArray
    end: ComplexArray
    radius: Array
    hulls: int = 0

    def facing(self, obstacle: Obstacle) -> Segments:
        """Return those whose distances to an obstacle count: the hulls' where it is the ground."""
        if not self.hulls:
            return self
        capsules = len(self.radius) - self.hulls
        return self.of(slice(capsules, None) if isinstance(obstacle, Ground) else slice(capsules))

    def distances(self, obstacle: Obstacle, times: Array) -> Array:
        """Return :func:`obstacle_distances` (K, r), m."""
        return obstacle_distances(self, obstacle, times)

    def of(self, capsules: IntArray | slice) -> Segments:
        """Return some of the capsules, by index."""
        return Segments(self.start[:, capsules], self.end[:, capsules], self.radius[capsules])


class LinkShapes:
    """Capsules of a robot, and the hulls of its links where its height over the ground counts, ready to be placed.

    ``weights`` are those (S, m) of their starts and of their ends, see :meth:`PlanarTree.point_weights`, and ``ends``
    (S, 2, m) the same together; ``radius`` (S,) is in m.
    """

    def __init__(
        self, tree: PlanarTree, capsules: tuple[LinkCapsule, ...], hulls: tuple[LinkCapsule, ...] = ()
    ) -> None:
        self._tree = tree
        self.links = tuple(shape.link for shape in capsules)
        self.hulls = len(hulls)
        self.hull_links = tuple(shape.link for shape in hulls)
        shapes = (*capsules, *hulls)
        bodies = np.array([shape.body for shape in shapes], dtype=np.int64)
        starts = np.array([shape.start for shape in shapes], np.complex128)
        ends = np.array([shape.end for shape in shapes], np.complex128)
        self.weights = tree.point_weights(bodies, starts), tree.point_weights(bodies, ends)
        self.ends = np.stack(self.weights, axis=1)
        self._ends = np.concatenate(self.weights).T.copy()
        self.radius = np.array([shape.radius for shape in shapes], dtype=np.float64)

    def facing(self, obstacle: Obstacle) -> range:
        """Indices of the shapes whose distances to an obstacle count: the hulls' where it is the ground."""
        capsules = len(self.links)
        if self.hulls and isinstance(obstacle, Ground):
            return range(capsules, capsules + self.hulls)
        return range(capsules)

    def place(self, com: ComplexArray, angles: Array) -> Segments:
        """Place the capsules for centres of mass (K,) and absolute angles (K, m)."""
        ends = self._tree.rotations(angles) @ self._ends
        ends += com[:, None]
        count = len(self.radius)
        return Segments(ends[:, :count], ends[:, count:], self.radius, self.hulls)


def obstacle_distances(segments: Segments, obstacle: Obstacle, times: Array) -> Array:
    """Distances (K, r) of links to an obstacle, piece after piece: as many rows per capsule as its kind says."""
    shift: ComplexArray = np.asarray(complex(*obstacle.velocity) * times, dtype=np.complex128)
    facing = segments.facing(obstacle)
    of_pieces = [OBSTACLE_DISTANCES[piece.kind][0](facing, piece, shift) for piece in obstacle.pieces]
    return of_pieces[0] if len(of_pieces) == 1 else np.concatenate(of_pieces, axis=1)


def point_distances(obstacle: Obstacle, points: ComplexArray) -> Array:
    """Distances (K,) of points (K,) to the surface of an obstacle as it is at takeoff, m; negative inside."""
    still = Segments(points[:, None], points[:, None], np.zeros(1))
    return np.asarray(obstacle_distances(still, obstacle, np.zeros(len(points))).min(axis=1))


def _circle_distances(segments: Segments, obstacle: Circle, shift: ComplexArray) -> Array:
    center: ComplexArray = np.asarray(complex(*obstacle.center) + shift)[:, None]
    return _point_to_segment(center, segments.start, segments.end) - segments.radius - obstacle.radius


def _half_plane_distances(segments: Segments, obstacle: HalfPlane, shift: ComplexArray) -> Array:
    normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
    level = (np.conj(normal) * (complex(*obstacle.point) + shift)).real
    ends = np.concatenate((segments.start, segments.end), axis=1)
    return np.asarray((np.conj(normal) * ends).real - level[:, None] - np.tile(segments.radius, 2))


def _bar_distances(segments: Segments, obstacle: Bar, shift: ComplexArray) -> Array:
    shape = segments.start.shape
    bar_start = np.broadcast_to((complex(*obstacle.start) + shift)[:, None], shape)
    bar_end = np.broadcast_to((complex(*obstacle.end) + shift)[:, None], shape)
    return _between(segments.start, segments.end, bar_start, bar_end) - segments.radius - obstacle.radius


# Distances to a kind of obstacle, from its displacements (K,) since takeoff, m; and how many rows per capsule they are:
# one of the nearest point along it, or two, of its ends.
OBSTACLE_DISTANCES: dict[str, tuple[Callable[[Segments, Any, ComplexArray], Array], int]] = {
    "circle": (_circle_distances, 1),
    "half-plane": (_half_plane_distances, 2),
    "capsule": (_bar_distances, 1),
}


def pair_distances(first: Segments, second: Segments) -> Array:
    """Distances between the capsules of two links, every pair a row."""
    pairs = np.indices((first.start.shape[1], second.start.shape[1]))
    own = first.of(pairs[0].ravel())
    other = second.of(pairs[1].ravel())
    return _between(own.start, own.end, other.start, other.end) - own.radius - other.radius


def _point_to_segment(point: ComplexArray, start: ComplexArray, end: ComplexArray) -> Array:
    along = end - start
    back = along.conj()
    length2 = np.maximum((along * back).real, 1e-300)
    fraction = np.minimum(np.maximum((back * (point - start)).real / length2, 0), 1)
    return np.abs(start + fraction * along - point)


def _between(start: ComplexArray, end: ComplexArray, other_start: ComplexArray, other_end: ComplexArray) -> Array:
    """Distance between segments: apart that at one of four ends, else minus the shortest way out by one."""
    own = _point_to_segment(np.stack((start, end)), other_start, other_end)
    other = _point_to_segment(np.stack((other_start, other_end)), start, end)
    sign = np.where(_cross(start, end, other_start, other_end), -1.0, 1.0)
    return np.asarray(sign * np.concatenate((own, other)).min(axis=0))


def _cross(start: ComplexArray, end: ComplexArray, other_start: ComplexArray, other_end: ComplexArray) -> BoolArray:
    def side(a: ComplexArray, b: ComplexArray, c: ComplexArray) -> Array:
        return np.asarray(((b - a).conj() * (c - a)).imag)

    of_other = side(start, end, other_start), side(start, end, other_end)
    own = side(other_start, other_end, start), side(other_start, other_end, end)
    crossing = np.asarray((of_other[0] * of_other[1] < 0) & (own[0] * own[1] < 0))
    if not crossing.any():
        return crossing
    in_line = 1e-12  # [m^2] cross products below this are rounding, of segments that touch or lie in one line
    return np.asarray(crossing & (np.min(np.abs((*of_other, *own)), axis=0) > in_line))
