"""How deep a robot's own links are in one another: distances between their shapes in space, by Coal.

Shapes are the collision geometry of the file where it is, in a plane as in space: legs side by side do not meet. Of a
mesh it is the convex hull, and then the mesh itself: links overlap only where its surface meets the other shape. Where
no link of a robot has collision geometry, its links are bars about the lines between their joints, as pictures draw
them.

Links that no moving joint separates are one body. Two bodies that a joint connects overlap at that joint in most files,
however the joint turns. So of each such body the half away from the joint counts, against the whole other body: a shank
is in its thigh when its lower half is, or the thigh's upper half is in the shank.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from statistics import median
from typing import Any

import coal  # which Pinocchio brings
import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray
from floatplan.errors import naming
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.collisions import Geometry
from floatplan.robot.shapes.links import LINE_RADIUS
from floatplan.robot.shapes.solids import evenly, link_geometries, link_lines

PAIRS_AT_ONCE = 4096  # [-] whose bounding balls are compared in one array


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex shape of a link.

    Attributes
    ----------
    link : its name
    body : the joint of the robot's model that carries it
    placement : pinocchio.SE3, of the shape in that joint's frame
    shape : coal.ShapeBase
    corners : (k, 3) m, of the polyhedron that it is, or of one inside it, in the joint's frame
    triangles : (f, 3, 3) m, in the joint's frame
        The surface of the mesh whose convex hull it is; None where it is another shape.
    """

    link: str
    body: int
    placement: Any
    shape: Any
    corners: Array
    triangles: Array | None = None

    @cached_property
    def ball(self) -> tuple[Array, float]:
        """Middle (3,), in the joint's frame, and radius of a ball around it, m."""
        self.shape.computeLocalAABB()
        middle = self.placement.act(np.array(self.shape.aabb_center))
        return middle, float(self.shape.aabb_radius)

    @cached_property
    def surface(self) -> tuple[Any, Any]:
        """The geometry whose meeting is an overlap: the mesh's triangles, or the shape; and its placement."""
        if self.triangles is None:
            return self.shape, self.placement
        model = coal.BVHModelOBBRSS()
        count = len(self.triangles)
        model.beginModel(count, 3 * count)
        model.addVertices(self.triangles.reshape(-1, 3))
        model.addTriangles(np.arange(3 * count, dtype=np.int64).reshape(-1, 3))
        model.endModel()
        return model, pin.SE3.Identity()

    def beyond(self, direction: Array, level: float) -> Piece | None:
        """Return the piece with ``direction @ point >= level``, in the joint's frame; None where it has no volume."""
        corners = _cut(self.corners, direction, level)
        shape = None if corners is None else _hull(corners)
        if corners is None or shape is None:
            return None
        triangles = self.triangles
        if triangles is not None:
            triangles = triangles[(triangles @ direction >= level).all(axis=1)]
        return Piece(self.link, self.body, pin.SE3.Identity(), shape, corners, triangles)


@dataclass(frozen=True)
class Pair:
    """Two pieces, by index, whose links move against one another.

    Attributes
    ----------
    first, second : indices of pieces
    bodies : names of the first links of both bodies
    joint : the joint between them, where these bodies are neighbours
    """

    first: int
    second: int
    bodies: tuple[str, str]
    joint: str | None


@dataclass(frozen=True, eq=False)
class LinkPairs:
    """The pieces of a robot's links, and the pairs of them that may come into one another."""

    robot: Robot
    pieces: tuple[Piece, ...]
    pairs: tuple[Pair, ...]

    @property
    def thickness(self) -> float:
        """Of links that are lines in the plane and bars here, m; 0 where links have shapes."""
        return 0.0 if self.robot.has_shapes or not self.pieces else 2 * float(self.pieces[0].shape.radius)

    @cached_property
    def size(self) -> float:
        """Of the robot, m: the diagonal of a box around its pieces in the reference posture."""
        middles = self._middles(self.robot.resting[None])[0]
        low = middles - self._radii[:, None]
        high = middles + self._radii[:, None]
        return float(np.linalg.norm(high.max(axis=0, initial=-np.inf) - low.min(axis=0, initial=np.inf)))

    def links(self, pair: int) -> tuple[str, str]:
        """Both links of a pair."""
        chosen = self.pairs[pair]
        return self.pieces[chosen.first].link, self.pieces[chosen.second].link

    def distances(self, positions: Array, chosen: IntArray | None = None) -> Array:
        """Distances (K, P), m, of pairs, all or those of some indices (P,), for planned positions (K, n), rad.

        Negative is how far one of both must move until they are apart.
        """
        indices = np.arange(len(self.pairs)) if chosen is None else chosen
        model = self.robot.model
        data = self.robot.model.createData()
        geometry = pin.GeometryModel()
        added: dict[int, int] = {}
        for index in indices.tolist():
            ends = self.pairs[index].first, self.pairs[index].second
            for end in ends:
                if end not in added:
                    piece = self.pieces[end]
                    placed = pin.GeometryObject(str(end), piece.body, piece.placement, piece.shape)
                    added[end] = geometry.addGeometryObject(placed)
            geometry.addCollisionPair(pin.CollisionPair(added[ends[0]], added[ends[1]]))
        state = geometry.createData()
        distances = np.empty((len(positions), len(indices)))
        for row, q in zip(distances, self._configurations(positions), strict=True):
            pin.computeDistances(model, data, geometry, state, q)
            row[:] = [result.min_distance for result in state.distanceResults]
        return distances

    def least_distances(self, positions: Array) -> Array:
        """Lower bounds (K, P), m, of :meth:`distances` of all pairs: by balls around the pieces."""
        middles = self._middles(positions)
        radii = self._radii
        ends = np.array([(pair.first, pair.second) for pair in self.pairs], dtype=np.int64).reshape(-1, 2)
        bounds = np.empty((len(positions), len(ends)))
        for begin in range(0, len(ends), PAIRS_AT_ONCE):
            first, second = ends[begin : begin + PAIRS_AT_ONCE].T
            distances = np.linalg.norm(middles[:, first] - middles[:, second], axis=2)
            bounds[:, begin : begin + PAIRS_AT_ONCE] = distances - radii[first] - radii[second]
        return bounds

    @cached_property
    def _radii(self) -> Array:
        """Radii (S,) m of balls around the pieces."""
        return np.array([piece.ball[1] for piece in self.pieces])

    def _middles(self, positions: Array) -> Array:
        """Middles (K, S, 3) m of these balls."""
        model = self.robot.model
        data = self.robot.model.createData()
        middles = np.array([piece.ball[0] for piece in self.pieces]).reshape(-1, 3)
        bodies = np.array([piece.body for piece in self.pieces], dtype=np.int64)
        world = np.empty((len(positions), len(self.pieces), 3))
        for row, q in zip(world, self._configurations(positions), strict=True):
            pin.forwardKinematics(model, data, q)
            for body in set(bodies.tolist()):
                own = bodies == body
                row[own] = _placed(data.oMi[body], middles[own])
        return world

    def meet(self, pair: int, positions: Array) -> bool:
        """Whether the surfaces of a pair, of meshes their triangles', meet at planned positions (n,), rad."""
        model = self.robot.model
        data = self.robot.model.createData()
        pin.forwardKinematics(model, data, self._configurations(positions[None])[0])
        request = coal.CollisionRequest()
        result = coal.CollisionResult()
        ends = list[Any]()
        for index in (self.pairs[pair].first, self.pairs[pair].second):
            piece = self.pieces[index]
            surface, placement = piece.surface
            world = data.oMi[piece.body] * placement
            ends += [surface, coal.Transform3s(world.rotation, world.translation)]
        return bool(coal.collide(*ends, request, result))

    def is_mesh(self, pair: int) -> bool:
        """Whether one of both is the hull of a mesh."""
        pair_of_pieces = self.pairs[pair]
        first = self.pieces[pair_of_pieces.first]
        second = self.pieces[pair_of_pieces.second]
        return first.triangles is not None or second.triangles is not None

    def _configurations(self, positions: Array) -> Array:
        """Configurations (K, nq) of the robot's model, its base where it is in ``reference``."""
        robot = self.robot
        configurations = np.tile(robot.reference, (len(positions), 1))
        configurations[:, robot.model.nq - robot.model.nv :] += positions @ robot.selection.T
        return configurations


@lru_cache(maxsize=8)
def link_pairs(robot: Robot) -> LinkPairs:
    """Return the pieces of a robot's links, and those that may come into one another.

    Raises
    ------
    InputError
        As of :attr:`Robot.shapes`.
    """
    with naming(robot.path):
        pieces = list(_pieces(robot))
    bodies = _bodies(robot)
    members: dict[str, list[int]] = {}
    for index, piece in enumerate(pieces):
        members.setdefault(bodies[piece.link], []).append(index)
    joints = _joints_between(robot, bodies, members)
    pairs = list[Pair]()
    for one, two in itertools.combinations(members, 2):
        joint = joints.get((one, two)) or joints.get((two, one))
        if joint is None:
            ends = list(itertools.product(members[one], members[two]))
        else:
            ends = []
            for body, other in ((one, two), (two, one)):
                halves = _half_away(robot, [pieces[index] for index in members[body]], joint)
                ends += itertools.product(range(len(pieces), len(pieces) + len(halves)), members[other])
                pieces += halves
        pairs += [Pair(first, second, (one, two), joint) for first, second in ends]
    return LinkPairs(robot, tuple(pieces), tuple(pairs))


def _pieces(robot: Robot) -> Iterator[Piece]:
    """The shapes of all links; bars of a robot without any."""
    tree = robot.joint_tree
    geometries_of_links = list(link_geometries(robot.model, tree, robot.path.parent, robot.meshes))
    if robot.has_shapes:
        for link, body, placement, geometries in geometries_of_links:
            for geometry in geometries:
                piece = _of_geometry(link, body, placement, geometry)
                if piece is not None:
                    yield piece
        return
    lines = []
    for link, body, placement, _ in geometries_of_links:
        for line in link_lines(tree, link):
            if len(line) > 1:  # else a point, of a link that ends at its joint
                length = float(np.linalg.norm(line[1] - line[0]))
                lines.append((link, body, placement, line, length))
    radius = LINE_RADIUS * median([length for *_, length in lines] or [0.0])
    for link, body, placement, line, length in lines:
        # along z is the axis of Coal's and URDF's capsules
        rotation = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), line[1] - line[0]).matrix()
        bar = Geometry("capsule", pin.SE3(rotation, line.mean(axis=0)), np.array([radius, radius, length]))
        piece = _of_geometry(link, body, placement, bar)
        if piece is not None:
            yield piece


def _of_geometry(link: str, body: int, placement: Any, geometry: Geometry) -> Piece | None:
    """A piece of a link that is placed in the frame of a joint; None of a shape without volume."""
    own = placement * geometry.placement
    if geometry.mesh is not None:
        points = _placed(own, geometry.mesh.corners)
        # the hull is exact in 400 directions, and between them 0.4 % of its size smaller
        corners = points[np.unique((evenly(400) @ points.T).argmax(axis=1))]
        shape = _hull(corners)
        triangles = points[geometry.mesh.faces]
        return None if shape is None else Piece(link, body, pin.SE3.Identity(), shape, corners, triangles)
    points, axes = geometry.solid()
    if axes.any():
        # a polyhedron of 60 corners inside a ball is 5 % of the radius smaller
        points = (points[:, None] + evenly(60) @ axes.T).reshape(-1, 3)
    corners = _placed(placement, points)
    radius, _, length = geometry.size.tolist()
    if not geometry.size.any() or (geometry.kind == "box" and not geometry.size.all()):
        return None
    if geometry.kind == "box":
        shape = coal.Box(*geometry.size)
    elif geometry.kind == "sphere":
        shape = coal.Sphere(radius)
    elif geometry.kind == "ellipsoid":
        shape = coal.Ellipsoid(*geometry.size)
    else:
        shape = {"capsule": coal.Capsule, "cylinder": coal.Cylinder}[geometry.kind](radius, length)
    return Piece(link, body, own, shape, corners)


def _hull(corners: Array) -> Any:
    """The convex hull of points (k, 3) as Coal has it; None where they are flat."""
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    with contextlib.suppress(Exception):  # of Qhull
        return coal.ConvexBase.convexHull(points, True, "Qt")
    return None


def _cut(corners: Array, direction: Array, level: float) -> Array | None:
    """Corners of a convex hull cut off at ``direction @ point >= level``; None where nothing is there."""
    height = corners @ direction - level
    if (height >= 0).all():
        return corners
    hull = _hull(corners) if (height > 0).any() else None
    if hull is None:
        return None
    corners = np.array(hull.points())
    triangles = np.empty((hull.num_polygons, 3), np.int64)
    for face in range(len(triangles)):
        polygon = hull.polygons(face)
        triangles[face] = polygon[0], polygon[1], polygon[2]
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    height = corners @ direction - level
    begin, end = edges[height[edges[:, 0]] * height[edges[:, 1]] < 0].T
    share = (height[begin] / (height[begin] - height[end]))[:, None]
    return np.concatenate((corners[height >= 0], corners[begin] * (1 - share) + corners[end] * share))


def _bodies(robot: Robot) -> Mapping[str, str]:
    """The first link of the body of each link: joints that do not move make one body of links."""
    first = {robot.joint_tree.root: robot.joint_tree.root}
    for joint in robot.joint_tree.joints:
        moves = joint.moves and joint.name not in robot.locked
        first[joint.child] = joint.child if moves else first[joint.parent]
    return first


def _joints_between(
    robot: Robot, bodies: Mapping[str, str], members: Mapping[str, Sequence[int]]
) -> dict[tuple[str, str], str]:
    """The joint next to the child of each two bodies that are neighbours; bodies without any shape are between none."""
    joints_between: dict[tuple[str, str], str] = {}
    for child in members:
        joints = robot.joint_tree.path(child)
        own = next(joints, None)
        if own is None:
            continue
        parent = bodies[own.parent]
        while parent not in members and (joint := robot.joint_tree.carrier.get(parent)):
            parent = bodies[joint.parent]
        joints_between[parent, child] = own.name
    return joints_between


def _half_away(robot: Robot, whole: Sequence[Piece], joint: str) -> list[Piece]:
    """The half of a body, of these pieces, that is far from a joint at one of its ends."""
    data = robot.model.createData()
    q = robot.reference.copy()
    q[robot.model.nq - robot.model.nv :] += robot.selection @ robot.resting
    pin.forwardKinematics(robot.model, data, q)
    origin = data.oMi[robot.model.getJointId(joint)].translation
    around = np.concatenate([_placed(data.oMi[piece.body], piece.corners) for piece in whole]) - origin
    direction = (around.max(axis=0) + around.min(axis=0)) / 2
    size = float(np.linalg.norm(direction))
    if size == 0:
        return []  # the joint is in its middle: a wheel has no half away from its axle
    direction /= size
    level = 0.5 * float((around @ direction).max())  # the half farther away than that counts
    halves = list[Piece]()
    for piece in whole:
        frame = data.oMi[piece.body]
        own_level = level + float(direction @ (origin - frame.translation))
        half = piece.beyond(frame.rotation.T @ direction, own_level)
        if half is not None:
            halves.append(half)
    return halves


def _placed(placement: Any, points: Array) -> Array:
    """Points (..., 3) of a frame at a placement (``pinocchio.SE3``)."""
    return np.asarray(points @ placement.rotation.T + placement.translation)
