"""The links' shapes in flight in space, and lower bounds of their distances from obstacles and from each other.

Positions are in the base's axes from the centre of mass, but for boxes, whose edges are along the world's. What is
looked for is the least distance of all pairs, solids or segments, over all cells: ``items`` has the Bernstein forms of
those on which it may be, ``below`` a bound that holds all over an item, and ``at_point`` one that is attained. Every
bound is on Bernstein forms, of which a polynomial's values are averages. Three facts serve:

- two segments w apart at their starts, with u and v along them, are as far apart as the parallelogram of the points
  ``w + a u - b v`` with a and b in [0, 1] is from zero; for any n no longer than 1, that is at least the least
  ``n . (w + a u - b v)``, which is that of a corner. Over a piece of time n is linear between the directions of the
  shortest connections at both of its ends, so that the bound is off by a multiple of the piece's length squared;
- the height of a convex solid over a plane is a concave function of the place of its origin and of the plane's normal
  as it sees it, so that the least one is at least the least one of the Bernstein coefficients;
- of a box, the distance is that over its highest face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import flint
import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.branch_and_bound import ROUGH, Items, bernstein, may_be_least
from floatplan.certificate.enclosure import ROUND, Balls, Taylor, up
from floatplan.certificate.spatial.models import Matrices
from floatplan.certificate.spatial.robot import Point, SpatialRobot

CapsuleShape: TypeAlias = tuple[str, Sequence[float], Sequence[float], float]
SolidShape: TypeAlias = tuple[str, Sequence[Sequence[float]], Sequence[Sequence[float]]]

ROUNDING = 32.0 * ROUND  # [-] of the sum of all magnitudes, more than the rounding of a bound on a distance


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules of links as constants: all points within ``radius`` of the segment ``along`` from ``start``.

    Attributes
    ----------
    links : link of each
    body : (S,)
    start, along : (S, 3, 1) m, in the body's axes, from its origin
    radius : (S,) m
    """

    links: tuple[str, ...]
    body: IntArray
    start: Balls
    along: Balls
    radius: Array

    @classmethod
    def of(cls, robot: SpatialRobot, shapes: Sequence[CapsuleShape] | None) -> Capsules:
        """Capsules from (link, start, end, radius) in the links' axes; None stands for the segments of all links."""
        links: list[str] = []
        bodies: list[int] = []
        ends: list[Balls] = []  # (2, 3) of each
        radii: list[float] = []
        if shapes is None:
            for link, segments in robot.segments.items():
                for origin, child in segments:
                    links.append(link)
                    bodies.append(origin.body)
                    ends.append(Balls.from_arb([*origin.local.entries(), *child.local.entries()], (2, 3)))
                    radii.append(0.0)
        else:
            for link, first, last, radius in shapes:
                if not 0.0 <= float(radius) < float("inf"):
                    raise ValueError("the radius of a shape is negative")
                frame = robot.link_frame(link)
                links.append(link)
                bodies.append(frame.body)
                ends.append(_on_body(np.array([first, last], dtype=np.float64), frame))
                radii.append(float(radius))
        places = Balls.joined([Balls(np.empty((0, 2, 3)), np.empty((0, 2, 3))), *(end[None] for end in ends)])
        start = places[:, 0, :, None]
        return cls(tuple(links), np.array(bodies, np.int64), start, places[:, 1, :, None] + -start, np.array(radii))

    def placed(self, rotations: Matrices, origins: Matrices) -> Segments:
        """Where they are, with the bodies' rotations and the places of their origins."""
        turned = rotations[self.body]
        return Segments(origins[self.body] + turned.times(self.start), turned.times(self.along), self.radius)


def _on_body(points: Array, frame: Point) -> Balls:
    """Points (k, 3), m, that a link has, in its body's axes from its origin."""
    axes = Balls.from_arb(frame.axes.entries(), (3, 3)).transposed
    origin = Balls.from_arb(frame.local.entries(), (3,))
    sizes = np.abs(points)
    radius = sizes @ (axes.rad + 4.0 * ROUND * np.abs(axes.mid)) + origin.rad + 4.0 * ROUND * np.abs(origin.mid)
    return Balls(points @ axes.mid + origin.mid, up(radius))


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments with a radius (S,), m: models ``start`` and ``along`` (cells, S) of vectors; one may stand for all."""

    start: Matrices
    along: Matrices
    radius: Array

    def __getitem__(self, index: Sequence[int] | slice) -> Segments:
        """Some of them, maybe repeatedly."""
        return Segments(self.start[index], self.along[index], self.radius[index])


@dataclass(frozen=True, eq=False)
class SegmentPairs:
    """Pairs of segments with a radius: their distances.

    ``between``, ``first`` and ``second`` (cells, pairs) are vectors from the second one's start to the first one's, and
    along both, m; of ``second`` one may stand for all. ``radius`` (pairs,) is the sum of both.
    """

    between: Matrices
    first: Matrices
    second: Matrices
    radius: Balls

    @classmethod
    def of(cls, one: Segments, other: Segments) -> SegmentPairs:
        """Each segment with that of the same number; one may stand for all."""
        radius = Balls.exact(one.radius) + Balls.exact(np.broadcast_to(other.radius, one.radius.shape))
        return cls(one.start - other.start, one.along, other.along, radius)

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.radius.mid)

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms where the smallest distance of all may be."""
        vectors = (self.between, self.first, self.second)
        middle = [vector.c[cells, :, 0, :, 0] for vector in vectors]
        shortest = _shortest(*middle)
        distance = np.linalg.norm(shortest, axis=-1) - self.radius.mid
        heights = [(_unit(shortest) * vector).sum(axis=-1) for vector in middle]
        proved = _lowest_corner(*heights) - self.radius.mid
        uncertainty, change = _variation_of_all(vectors, cells)
        uncertainty = (
            uncertainty + self.radius.rad + ROUGH * (1.0 + sum(np.linalg.norm(vector, axis=-1) for vector in middle))
        )
        return self.forms(*may_be_least(proved - uncertainty - change, distance + uncertainty, cells))

    def forms(self, cell: IntArray, pair: IntArray) -> Items:
        """Bernstein forms of all nine coordinates, of single pairs on single cells."""
        forms = []
        for vector in (self.between, self.first, self.second):
            forms += _coordinates(vector, cell, pair)
        return Items.on_cells(forms, cell, pair)

    def below(self, forms: Taylor, pair: IntArray) -> Array:
        """Lower bound on the distance between the surfaces over the items.

        Coefficient j of the product of a linear n and a form c of degree K - 1 is
        ``((K - j) n_first . c_j + j n_last . c_(j-1)) / K``.
        """
        order = forms.order
        c = forms.c.reshape(order, 3, 3, -1)  # of the three vectors, x, y and z
        between, first, second = (np.moveaxis(c[[0, -1], k], 1, -1) for k in range(3))  # (ends, items, 3)
        heights = np.einsum("eix,kvxi->ekvi", _unit(_shortest(between, first, second)), c)
        share = np.arange(order + 1)[:, None, None] / order
        nothing = np.zeros((1, *heights.shape[2:]))
        early = np.concatenate([heights[0], nothing])
        late = np.concatenate([nothing, heights[1]])
        product = (1.0 - share) * early + share * late  # (K + 1, vectors, items)
        corner = _lowest_corner(product[:, 0], product[:, 1], product[:, 2])
        sizes = np.abs(forms.c).max(axis=0).sum(axis=0)
        radii = forms.e.sum(axis=0) * (1.0 + ROUNDING)
        apart = np.maximum(0.0, corner.min(axis=0) - radii - ROUNDING * sizes) * (1.0 - 8.0 * ROUND)
        radius = self.radius[pair]
        bound = apart - radius.mid - radius.rad
        return np.asarray(bound - 4.0 * ROUND * (apart + radius.mid))

    def at_point(self, values: Balls, pair: IntArray) -> Array:
        """Upper bound on the distance between the surfaces where the coordinates have these values."""
        mid = np.moveaxis(values.mid.reshape(3, 3, *values.mid.shape[1:]), 1, -1)  # (vectors, ..., items, 3)
        distance = np.linalg.norm(_shortest(*mid), axis=-1)
        radius = self.radius[pair]
        sizes = np.abs(values.mid).sum(axis=0) + radius.mid
        return np.asarray(distance - radius.mid + up(values.rad.sum(axis=0) + radius.rad + ROUNDING * sizes))


def _unit(vectors: Array) -> Array:
    """Vectors (..., 3) made of length 1; zero where they are."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))


def _lowest_corner(between: Array, first: Array, second: Array) -> Array:
    """The least height of the corners of a parallelogram, from heights of the three vectors along one direction."""
    return np.asarray(between + np.minimum(0.0, first) + np.minimum(0.0, -second))


def _shortest(between: Array, first: Array, second: Array) -> Array:
    """Shortest vectors (..., 3) from a point of the second segment to one of the first, rounded; see Ericson, 5.1.9.

    C. Ericson, Real-Time Collision Detection, 2005. Any two points of both would do for a valid bound.
    """
    a = (first * first).sum(axis=-1)
    b = (first * second).sum(axis=-1)
    e = (second * second).sum(axis=-1)
    c = (first * between).sum(axis=-1)
    f = (second * between).sum(axis=-1)
    square = a * e - b * b
    of_first = a > 0.0
    of_second = e > 0.0
    inside = square > 0.0
    along_first = np.where(of_first, a, 1.0)
    along_second = np.where(of_second, e, 1.0)
    across = np.where(inside, square, 1.0)
    zero = np.zeros(np.broadcast_shapes(a.shape, e.shape))
    one = zero + 1.0

    def on_first(share: Array) -> Array:
        """Where the first segment is nearest to a point of the second."""
        return np.clip(np.where(of_first, share * b - c, 0.0) / along_first, 0.0, 1.0)

    def on_second(share: Array) -> Array:
        """Where the second segment is nearest to a point of the first."""
        return np.clip(np.where(of_second, share * b + f, 0.0) / along_second, 0.0, 1.0)

    lines = np.clip(np.where(inside, b * f - c * e, 0.0) / across, 0.0, 1.0)
    shares = [(zero, on_second(zero)), (one, on_second(one)), (on_first(zero), zero), (on_first(one), one)]
    shares.append((lines, on_second(lines)))
    shortest = between + shares[0][0][..., None] * first - shares[0][1][..., None] * second
    least = (shortest * shortest).sum(axis=-1)
    for on_one, on_other in shares[1:]:
        vector = between + on_one[..., None] * first - on_other[..., None] * second
        squared = (vector * vector).sum(axis=-1)
        shorter = squared < least
        least = np.where(shorter, squared, least)
        shortest = np.where(shorter[..., None], vector, shortest)
    return np.asarray(shortest)


@dataclass(frozen=True, eq=False)
class Solid:
    """The convex hull of points, grown by an ellipsoid, as constants in the axes of a body, from its origin.

    ``points`` (k, 3) and the ellipsoid's semi-axes, the columns of ``axes`` (3, 3), m.
    """

    link: str
    body: int
    points: Balls
    axes: Balls

    @classmethod
    def all_of(cls, robot: SpatialRobot, shapes: Sequence[SolidShape]) -> list[Solid]:
        """Solids from (link, points, axes) in the links' axes."""
        solids = []
        for link, points, axes in shapes:
            frame = robot.link_frame(link)
            columns = np.array(axes, dtype=np.float64).T
            turned = _on_body(columns, Point(frame.body, flint.arb_mat(3, 1), frame.axes))
            placed = _on_body(np.array(points, dtype=np.float64), frame)
            solids.append(cls(link, frame.body, placed, turned.transposed))
        return solids

    @classmethod
    def of_capsules(cls, capsules: Capsules) -> list[Solid]:
        """Capsules as solids; their ellipsoid is a ball."""
        ends = Balls.joined([capsules.start[None], (capsules.start + capsules.along)[None]])[..., 0]
        solids = []
        for index, link in enumerate(capsules.links):
            ball = Balls.exact(capsules.radius[index] * np.eye(3))
            solids.append(cls(link, int(capsules.body[index]), ends[:, index], ball))
        return solids

    @property
    def extent(self) -> float:
        """How far it reaches from the body's origin at most, m."""
        points = np.linalg.norm(self.points.mid, axis=1) + np.linalg.norm(self.points.rad, axis=1)
        return float(up(points.max() + np.linalg.norm(self.axes.mid) + np.linalg.norm(self.axes.rad)))

    def lowest(self, up_vectors: Array) -> Array:
        """How high the lowest point is along vectors (..., 3), from the body's origin, rounded, m."""
        points = (up_vectors @ self.points.mid.T).min(axis=-1)
        return np.asarray(points - np.linalg.norm(up_vectors @ self.axes.mid, axis=-1))


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights of solids over a plane.

    ``normal`` (cells, solids) is the plane's unit normal in the axes of the solid's body, ``offset`` (K, cells, solids)
    the height of that body's origin, m.
    """

    solids: Sequence[Solid]
    normal: Matrices
    offset: Taylor

    @property
    def count(self) -> int:
        """Number of solids."""
        return len(self.solids)

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms where the smallest height of all may be."""
        normal = self.normal.c[cells, :, 0, :, 0]
        offset = self.offset[cells]
        height = offset.c[0] + np.stack([s.lowest(normal[:, i]) for i, s in enumerate(self.solids)], axis=1)
        extent = np.array([solid.extent for solid in self.solids])
        uncertainty, change = _variation(self.normal, cells)
        uncertainty = offset.e + uncertainty * extent + ROUGH * (1.0 + extent + np.abs(offset.c[0]))
        change = np.abs(offset.c[1:]).sum(axis=0) + change * extent
        return self.forms(*may_be_least(height - uncertainty - change, height + uncertainty, cells))

    def forms(self, cell: IntArray, solid: IntArray) -> Items:
        """Bernstein forms of the offset and of the normal's coordinates, of single solids on single cells."""
        forms = [bernstein(self.offset[cell, solid]), *_coordinates(self.normal, cell, solid)]
        return Items.on_cells(forms, cell, solid)

    def below(self, forms: Taylor, solid: IntArray) -> Array:
        """Lower bound over the items."""
        heights, radius = self._heights(np.moveaxis(forms.c, 1, 0), forms.e, solid)
        bound = (heights - radius).min(axis=0)
        return np.asarray(bound - 2.0 * ROUND * np.abs(bound))

    def at_point(self, values: Balls, solid: IntArray) -> Array:
        """Upper bound at a point."""
        heights, radius = self._heights(values.mid, values.rad[:, 0], solid)
        return np.asarray(heights + radius)

    def _heights(self, values: Array, radii: Array, solid: IntArray) -> tuple[Array, Array]:
        """Heights (m, items) where offset and normal are values (4, m, items) within radii (4, items); their radii."""
        heights = np.empty(values.shape[1:])
        radius = np.empty_like(heights)
        for number in np.unique(solid).tolist():
            here = solid == number
            body = self.solids[number]
            normal = np.moveaxis(values[1:, :, here], 0, -1)
            heights[:, here] = values[0, :, here].T + body.lowest(normal)
            sizes = np.abs(values[:, :, here])
            off = np.linalg.norm(radii[1:, here], axis=0) + ROUNDING * sizes[1:].sum(axis=0)
            own = body.points.rad.sum(axis=1).max() + body.axes.rad.sum()
            radius[:, here] = up(radii[0, here] + body.extent * off + own * sizes[1:].max(axis=0) + ROUNDING * sizes[0])
        return heights, radius

    def least_at_start(self) -> float:
        """The smallest height at the beginning, to within rounding."""
        normal = self.normal.at(-1.0)[0][0, :, :, 0]
        offset = self.offset[0].at_end(-1.0).mid
        return float(min(offset[i] + solid.lowest(normal[i]) for i, solid in enumerate(self.solids)))


@dataclass(frozen=True, eq=False)
class FaceDistances:
    """Distances of segments with a radius from a box, each by that face over which its lower end is highest.

    ``segments`` are in the world's axes, from the box's middle; ``half`` (3,) are half its edges, m.
    """

    segments: Segments
    half: Array

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.segments.radius)

    def items(self, cells: IntArray) -> Items:
        """Bernstein forms where the smallest distance of all may be."""
        segments = self.segments
        start = segments.start.c[cells, :, 0, :, 0]
        along = segments.along.c[cells, :, 0, :, 0]
        distance = self._over_faces(start, start + along).max(axis=-1) - segments.radius
        uncertainty, change = _variation_of_all((segments.start, segments.along), cells)
        uncertainty = uncertainty + ROUGH * (1.0 + np.linalg.norm(start, axis=-1) + np.linalg.norm(along, axis=-1))
        return self.forms(*may_be_least(distance - uncertainty - change, distance + uncertainty, cells))

    def forms(self, cell: IntArray, capsule: IntArray) -> Items:
        """Bernstein forms of the coordinates of both ends, of single segments on single cells."""
        segments = self.segments
        end = segments.start + segments.along
        forms = [*_coordinates(segments.start, cell, capsule), *_coordinates(end, cell, capsule)]
        return Items.on_cells(forms, cell, capsule)

    def _over_faces(self, start: Array, end: Array) -> Array:
        """Heights (..., 6) of the lower one of two points (..., 3) over the six faces."""
        above = np.minimum(start, end) - self.half
        return np.concatenate([above, -np.maximum(start, end) - self.half], axis=-1)

    def _radii(self, radii: Array, sizes: Array) -> Array:
        """Radii (..., 6) of such heights, from radii and magnitudes (6, ...) of both points' coordinates."""
        of_ends = np.moveaxis(radii + ROUNDING * sizes, 0, -1)
        radius = up(np.maximum(of_ends[..., :3], of_ends[..., 3:]) + ROUNDING * self.half)
        return np.concatenate([radius, radius], axis=-1)

    def below(self, forms: Taylor, capsule: IntArray) -> Array:
        """Lower bound on the distance over the items."""
        c = np.moveaxis(forms.c, 1, -1)
        heights = self._over_faces(c[..., :3], c[..., 3:]).min(axis=0)  # (items, 6)
        radius = self.segments.radius[capsule]
        distance = (heights - self._radii(forms.e, np.abs(forms.c).max(axis=0))).max(axis=-1)
        return np.asarray(distance - radius - 4.0 * ROUND * (np.abs(distance) + radius))

    def at_point(self, values: Balls, capsule: IntArray) -> Array:
        """Upper bound on the distance where the coordinates have these values."""
        mid = np.moveaxis(values.mid, 0, -1)
        radius = self.segments.radius[capsule]
        radii = np.broadcast_to(values.rad, values.mid.shape)
        distance = (self._over_faces(mid[..., :3], mid[..., 3:]) + self._radii(radii, np.abs(values.mid))).max(axis=-1)
        return np.asarray(distance - radius + 4.0 * ROUND * (np.abs(distance) + radius))


def _variation(vectors: Matrices, cells: IntArray) -> tuple[Array, Array]:
    """The radii of vectors (cells, items), and how far they get from where they are in the middle of cells."""
    uncertainty = vectors.e[cells]
    return uncertainty, vectors.sizes[cells, :, 1:].sum(axis=-1) + uncertainty


def _variation_of_all(vectors: Sequence[Matrices], cells: IntArray) -> tuple[Array, Array]:
    """The sums over several vectors of both."""
    uncertainty: Any = 0.0
    change: Any = 0.0
    for vector in vectors:
        own_known, own_change = _variation(vector, cells)
        uncertainty = uncertainty + own_known
        change = change + own_change
    return uncertainty, change


def _coordinates(vectors: Matrices, cell: IntArray, item: IntArray) -> list[Taylor]:
    """Bernstein forms (K, items) of x, y and z of single vectors on single cells; one item may stand for all."""
    item = item if vectors.e.shape[1] > 1 else np.zeros_like(item)
    c = vectors.c[cell, item, :, :, 0]  # (items, K, 3)
    radii = vectors.entries[cell, item, :, 0]
    return [bernstein(Taylor(np.ascontiguousarray(c[..., k].T), radii[..., k])) for k in range(3)]
