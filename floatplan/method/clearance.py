"""Distances (19), (23) of links to obstacles and to one another: exact along the links, without a grid of u in (22)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle

TOUCHING = 1e-12  # [m] of two segments: nearer than that they have no direction from one to the other
POINT = 1e-300  # [m^2] keeps the share along a segment of no length from being none


class Segments(NamedTuple):
    """Segments, complex (S,), m; with the derivatives (S, 3n+2) of both ends by the state u."""

    start: ComplexArray
    end: ComplexArray
    start_jacobian: ComplexArray
    end_jacobian: ComplexArray

    def of(self, indices: Array | slice) -> Segments:
        """Return some of them."""
        return Segments(*(part[indices] for part in self))

    def point_jacobian(self, share: Array) -> ComplexArray:
        """Derivatives (S, 3n+2) of the points that are a share u (S,) along them, (22)."""
        return (1 - share)[:, None] * self.start_jacobian + share[:, None] * self.end_jacobian


def fixed(start: complex, end: complex, like: Segments) -> Segments:
    """Return one segment that does not depend on u, as often as there are others."""
    nothing = np.zeros_like(like.start_jacobian)
    return Segments(np.full_like(like.start, start), np.full_like(like.end, end), nothing, nothing)


def segment_distances(own: Segments, other: Segments) -> tuple[Array, Array]:
    """Distances (S,) between segments, m, and derivatives (S, 3n+2); of two that cross, minus the shortest way out.

    The nearest points are an end of one and a point of the other. A small change of its share u changes no distance.
    """
    ends = [nearest_share(point, other.start, other.end) for point in (own.start, own.end)]
    other_ends = [nearest_share(point, own.start, own.end) for point in (other.start, other.end)]
    none, whole = np.zeros(len(own.start)), np.ones(len(own.start))
    own_share = np.array([none, whole, *other_ends])
    other_share = np.array([*ends, none, whole])
    apart = (1 - own_share) * own.start + own_share * own.end - (1 - other_share) * other.start
    apart -= other_share * other.end
    nearest = np.abs(apart).argmin(axis=0), np.arange(len(own.start))
    apart = apart[nearest]
    sign = np.where(crossing(own, other), -1.0, 1.0)
    distance = np.abs(apart)
    direction = np.where(distance < TOUCHING, 1.0, apart) / np.where(distance < TOUCHING, 1.0, distance)
    moved = own.point_jacobian(own_share[nearest]) - other.point_jacobian(other_share[nearest])
    return sign * distance, sign[:, None] * (direction.conj()[:, None] * moved).real


def nearest_share(point: ComplexArray, start: ComplexArray, end: ComplexArray) -> Array:
    """The share u (S,) of (22) at which segments are nearest to points."""
    along = end - start
    return np.clip((along.conj() * (point - start)).real / np.maximum(np.abs(along) ** 2, POINT), 0, 1)


def crossing(own: Segments, other: Segments) -> Array:
    """Whether (S,) segments cross: the ends of one are on both sides of the other, and the other way round."""
    along, other_along = own.end - own.start, other.end - other.start
    sides = [(along.conj() * (point - own.start)).imag for point in (other.start, other.end)]
    other_sides = [(other_along.conj() * (point - other.start)).imag for point in (own.start, own.end)]
    return (sides[0] * sides[1] < 0) & (other_sides[0] * other_sides[1] < 0)


def obstacle_distances(own: Segments, radius: Array, obstacle: Obstacle, time: float) -> tuple[Array, Array]:
    """Distances (r,) between the surfaces of capsules and an obstacle at a time, m, and derivatives (r, 3n+2)."""
    values, jacobians = [], []
    shift = complex(*obstacle.velocity) * time
    for piece in obstacle.pieces:
        if isinstance(piece, HalfPlane):
            normal = complex(*piece.normal) / abs(complex(*piece.normal))
            for end, jacobian in ((own.start, own.start_jacobian), (own.end, own.end_jacobian)):
                height = (normal.conjugate() * (end - complex(*piece.point) - shift)).real
                values.append(height - radius)
                jacobians.append((normal.conjugate() * jacobian).real)
            continue
        assert isinstance(piece, Circle | Bar), "the pieces that there are"
        ends = (piece.center, piece.center) if isinstance(piece, Circle) else (piece.start, piece.end)
        first, last = (complex(*end) + shift for end in ends)
        distance, jacobian = segment_distances(own, fixed(first, last, own))
        values.append(distance - radius - piece.radius)
        jacobians.append(jacobian)
    return np.concatenate(values), np.concatenate(jacobians)
