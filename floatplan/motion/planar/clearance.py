"""Distances (19)-(23) between the links' capsules and obstacles or one another, exact along the links, with gradients.

Points are complex, horizontal + i vertical. A distance is between surfaces and negative where they overlap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from floatplan.arrays import Array, BoolArray, ComplexArray, IntArray
from floatplan.motion.dynamics import Distances
from floatplan.problem.parts import Bar, Circle, Ground, HalfPlane, Obstacle
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import LinkCapsule

Number = TypeVar("Number", np.float64, np.complex128)

IN_LINE = 1e-12  # m^2: cross products below this are rounding, of segments that touch or lie in one line


def _facing(obstacle: Obstacle, capsules: int, hulls: int) -> range:
    return range(capsules, capsules + hulls) if hulls and isinstance(obstacle, Ground) else range(capsules)


@dataclass(frozen=True, eq=False)
class Segments:
    """The capsules of some links over K instants.

    ``start, end`` (K, S) complex, m; ``start_weights, end_weights`` (S, m) of :meth:`PlanarTree.point_weights`;
    ``radius`` (S,) m; ``rotations`` (K, m). The last ``hulls`` of them are the links' hulls, for the ground alone;
    without any the capsules are.
    """

    start: ComplexArray
    end: ComplexArray
    start_weights: ComplexArray
    end_weights: ComplexArray
    radius: Array
    rotations: ComplexArray
    turn: float
    hulls: int = 0

    def facing(self, obstacle: Obstacle) -> Segments:
        """Return those whose distances to an obstacle count: the hulls' where it is the ground."""
        facing = _facing(obstacle, len(self.radius) - self.hulls, self.hulls)
        return self.of(slice(facing.start, facing.stop)) if self.hulls else self

    def of(self, capsules: IntArray | slice) -> Segments:
        """Return some of the capsules, by index."""
        return replace(
            self,
            start=self.start[:, capsules],
            end=self.end[:, capsules],
            start_weights=self.start_weights[capsules],
            end_weights=self.end_weights[capsules],
            radius=self.radius[capsules],
            hulls=0,
        )

    def ends(self) -> Segments:
        """Return the capsules' starts, and after them their ends, each as a segment that is a point."""
        places = np.concatenate((self.start, self.end), axis=1)
        weights = np.concatenate((self.start_weights, self.end_weights))
        return Segments(places, places, weights, weights, np.tile(self.radius, 2), self.rotations, self.turn)

    def gradient(self, direction: ComplexArray, fraction: Array) -> Array:
        """Derivative (K, S, m) by the bodies' angles of the points at ``fraction`` (K, S) along the segments.

        Component along the unit vectors ``direction`` (K, S).
        """
        weights = (1 - fraction)[..., None] * self.start_weights + fraction[..., None] * self.end_weights
        swing = (1j * self.turn) * self.rotations[:, None, :] * weights
        return np.asarray((direction.conj()[..., None] * swing).real)


class LinkShapes:
    """Capsules of a robot, and the hulls of its links where its height over the ground counts, ready to be placed."""

    def __init__(
        self, tree: PlanarTree, capsules: tuple[LinkCapsule, ...], hulls: tuple[LinkCapsule, ...] = ()
    ) -> None:
        self._tree = tree
        self.links = tuple(shape.link for shape in capsules)
        self.hulls, self.hull_links = len(hulls), tuple(shape.link for shape in hulls)
        shapes = (*capsules, *hulls)
        bodies = np.array([shape.body for shape in shapes], dtype=np.int64)
        self._start = tree.point_weights(bodies, np.array([shape.start for shape in shapes], dtype=np.complex128))
        self._end = tree.point_weights(bodies, np.array([shape.end for shape in shapes], dtype=np.complex128))
        self._ends = np.concatenate((self._start, self._end)).T.copy()
        self._radius = np.array([shape.radius for shape in shapes], dtype=np.float64)

    @property
    def weights(self) -> tuple[ComplexArray, ComplexArray]:
        """Weights (S, m) of the capsules' starts and ends, see :meth:`PlanarTree.point_weights`."""
        return self._start, self._end

    def facing(self, obstacle: Obstacle) -> range:
        """Indices of the shapes whose distances to an obstacle count: the hulls' where it is the ground."""
        return _facing(obstacle, len(self.links), self.hulls)

    @property
    def radius(self) -> Array:
        """Of the capsules (S,), m."""
        return self._radius

    def place(self, com: ComplexArray, angles: Array) -> Segments:
        """Place the capsules for centres of mass (K,) and absolute angles (K, m)."""
        rotations = self._tree.rotations(angles)
        ends = rotations @ self._ends
        ends += com[:, None]
        return Segments(
            ends[:, : len(self._start)],
            ends[:, len(self._start) :],
            self._start,
            self._end,
            self._radius,
            rotations,
            self._tree.turn,
            self.hulls,
        )


def obstacle_distances(segments: Segments, obstacle: Obstacle, times: Array) -> Distances:
    """Distances of links to an obstacle, piece after piece: as many rows per capsule as its kind says."""
    shift: ComplexArray = np.asarray(complex(*obstacle.velocity) * times, dtype=np.complex128)
    facing = segments.facing(obstacle)
    of_pieces = [OBSTACLE_DISTANCES[piece.kind][0](facing, piece, shift) for piece in obstacle.pieces]
    if len(of_pieces) == 1:
        return of_pieces[0]
    return Distances(
        np.concatenate([piece.values for piece in of_pieces], axis=1),
        lambda: np.concatenate([piece.by_body for piece in of_pieces], axis=1),
    )


def distance_rows(obstacle: Obstacle) -> int:
    """How many rows per capsule :func:`obstacle_distances` has."""
    return sum(OBSTACLE_DISTANCES[piece.kind][1] for piece in obstacle.pieces)


def point_distances(obstacle: Obstacle, points: ComplexArray) -> Array:
    """Distances (K,) of points (K,) to the surface of an obstacle as it is at takeoff, m; negative inside."""
    places, nothing = points[:, None], np.zeros((1, 0), np.complex128)
    still = Segments(places, places, nothing, nothing, np.zeros(1), nothing, 1.0)
    return np.asarray(obstacle_distances(still, obstacle, np.zeros(len(points))).values.min(axis=1))


def _circle_distances(segments: Segments, obstacle: Circle, shift: ComplexArray) -> Distances:
    center: ComplexArray = np.asarray(complex(*obstacle.center) + shift)[:, None]
    distance, direction, fraction = _point_to_segment(center, segments.start, segments.end)
    return Distances(distance - segments.radius - obstacle.radius, lambda: segments.gradient(direction, fraction))


def _half_plane_distances(segments: Segments, obstacle: HalfPlane, shift: ComplexArray) -> Distances:
    normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
    origin = complex(*obstacle.point) + shift
    ends = segments.ends()
    shape = ends.start.shape
    level = (np.conj(normal) * origin).real
    distance = (np.conj(normal) * ends.start).real - level[:, None] - ends.radius
    return Distances(distance, lambda: ends.gradient(np.full(shape, normal), np.zeros(shape)))


def _bar_distances(segments: Segments, obstacle: Bar, shift: ComplexArray) -> Distances:
    shape = segments.start.shape
    bar_start = np.broadcast_to((complex(*obstacle.start) + shift)[:, None], shape)
    bar_end = np.broadcast_to((complex(*obstacle.end) + shift)[:, None], shape)
    distance, direction, fraction, _ = _between(segments.start, segments.end, bar_start, bar_end)
    return Distances(distance - segments.radius - obstacle.radius, lambda: segments.gradient(direction, fraction))


# Distances to a kind of obstacle, from its displacements (K,) since takeoff, m; and how many rows per capsule they are:
# one of the nearest point along it, or two, of its ends.
OBSTACLE_DISTANCES: dict[str, tuple[Callable[[Segments, Any, ComplexArray], Distances], int]] = {
    "circle": (_circle_distances, 1),
    "half-plane": (_half_plane_distances, 2),
    "capsule": (_bar_distances, 1),
}


def pair_distances(first: Segments, second: Segments) -> Distances:
    """Distances between the capsules of two links, every pair a row."""
    pairs = np.indices((first.start.shape[1], second.start.shape[1]))
    own, other = first.of(pairs[0].ravel()), second.of(pairs[1].ravel())
    distance, direction, fraction, other_fraction = _between(own.start, own.end, other.start, other.end)
    return Distances(
        distance - own.radius - other.radius,
        lambda: own.gradient(direction, fraction) - other.gradient(direction, other_fraction),
    )


def _point_to_segment(point: ComplexArray, start: ComplexArray, end: ComplexArray) -> tuple[Array, ComplexArray, Array]:
    along = end - start
    back = along.conj()
    length2 = np.maximum((along * back).real, 1e-300)
    fraction = np.minimum(np.maximum((back * (point - start)).real / length2, 0), 1)
    offset = start + fraction * along - point
    distance = np.abs(offset)
    touching = distance < 1e-12
    if not touching.any():
        return np.asarray(distance), np.asarray(offset / distance), np.asarray(fraction)
    sideways = 1j * along / np.sqrt(length2)
    direction = np.where(touching, np.where(np.abs(sideways) > 0.5, sideways, 1j), offset)
    unit: ComplexArray = np.asarray(direction / np.where(touching, 1.0, distance), dtype=np.complex128)
    return np.asarray(distance), unit, np.asarray(fraction)


def _between(
    start: ComplexArray, end: ComplexArray, other_start: ComplexArray, other_end: ComplexArray
) -> tuple[Array, ComplexArray, Array, Array]:
    """Distance between segments, unit vector from the other towards the first, shares of the nearest points.

    Apart, the least distance is at one of the four ends. Where they cross it is minus the shortest way out by an end.
    """
    distance, direction, other_share = _point_to_segment(np.stack((start, end)), other_start, other_end)
    back, back_direction, share = _point_to_segment(np.stack((other_start, other_end)), start, end)
    at_ends = np.broadcast_to(np.reshape([0.0, 1.0], (2, *(1,) * start.ndim)), share.shape)
    distances = np.concatenate((distance, back))
    nearest, everywhere = distances.reshape(4, -1).argmin(axis=0), np.arange(start.size)

    def at_nearest(values: NDArray[Number]) -> NDArray[Number]:
        return np.asarray(values.reshape(4, -1)[nearest, everywhere].reshape(start.shape))

    sign = np.where(_cross(start, end, other_start, other_end), -1.0, 1.0)
    return (
        sign * at_nearest(distances),
        sign * at_nearest(np.concatenate((-direction, back_direction))),
        at_nearest(np.concatenate((at_ends, share))),
        at_nearest(np.concatenate((other_share, at_ends))),
    )


def _cross(start: ComplexArray, end: ComplexArray, other_start: ComplexArray, other_end: ComplexArray) -> BoolArray:
    def side(a: ComplexArray, b: ComplexArray, c: ComplexArray) -> Array:
        return np.asarray(((b - a).conj() * (c - a)).imag)

    of_other = side(start, end, other_start), side(start, end, other_end)
    own = side(other_start, other_end, start), side(other_start, other_end, end)
    crossing = np.asarray((of_other[0] * of_other[1] < 0) & (own[0] * own[1] < 0))
    if not crossing.any():
        return crossing
    return np.asarray(crossing & (np.min(np.abs((*of_other, *own)), axis=0) > IN_LINE))
