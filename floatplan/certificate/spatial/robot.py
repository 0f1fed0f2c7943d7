"""The robot in space as constants: a tree of bodies, and the generalised Appendix of the paper in three dimensions.

Links that do not move relative to each other form a body; body 0 is the root link's, and the base. Each other body
turns about the axis of the joint that carries it: with ``R_b`` from the body's axes to the base's,
``R_b = R_parent (still + sine sin q + cosine cos q)``. The place of any point relative to the centre of mass is
``sum_b R_b w_b`` with constant vectors w, and so, with m x of all parts of all bodies,

    C_ij = sum m w_i w_j^T + delta_ij S_i,    S = R C R^T = sum_ij R_i C_ij R_j^T,    R = (R_0, R_1, ..),

is all that momentum and torques need to know of the masses: S is the second moment about the centre of mass, and
``S_i`` that of a body's links about their own centres. In a plane these are the ``C_ij`` of
:mod:`~floatplan.certificate.planar.inertia`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.certificate.enclosure import PRECISION, Balls
from floatplan.certificate.robots import cached
from floatplan.certificate.robots.columns import cross, diagonal
from floatplan.certificate.robots.taken import as_recorded
from floatplan.certificate.robots.urdf import Joint, Placement, Urdf, carriers, check_roles, is_geared, joint_ratios
from floatplan.certificate.spatial.models import BlockMatrix
from floatplan.errors import InputError
from floatplan.plans.record import RobotRecord


@dataclass(frozen=True)
class Point:
    """A point fixed to a body, ``local`` (3, 1), m, in that body's axes from its origin; and axes (3, 3) that it has.

    The origin of a link has the link's axes, other points the body's.
    """

    body: int
    local: Any
    axes: Any = field(default_factory=lambda: Placement().rotation)


@dataclass(frozen=True, eq=False)
class SpatialRobot:
    """A tree of B bodies on a free base as constants; J = B - 1 joints are moved, joint j carries body j + 1.

    Attributes
    ----------
    joints : (n) planned joints
    motors : (motors) the planned joints, then the coupled ones that the file does not gear to their leader
    motor_ratios : (motors, n) derivatives of the motors' positions by the planned ones
    transmission : (J, motors) derivatives of the moved joints' positions by those of the motors, each on its own
    leader : (J,) index of the planned joint that a joint is or follows
    ratio, offset : (J,) its position is ``ratio`` times the leader's ``+ offset``
    parent : (J,) body before it
    still, sine, cosine : (J, 3, 3)
        What its rotation consists of, see above.
    axes : (J, 3)
        Its axis, in the axes of the body that it carries.
    carried : (J, B) whether a joint carries a body, directly or not: ones and zeros
    armature : (J,) kg m^2
    inertia : C
    weights : (B) lists of 3 B arb
        Place of each body's origin relative to the centre of mass: ``sum_b R_b w_b``.
    origins : (B, B) blocks (3, 1)
        The same weights: the origins are ``rotations.of_blocks(origins)``.
    frames : link or joint name -> Point
    carriers : frame or link name -> links on which it stands: its own link, then those that this one is fixed to
    segments : link name -> pairs of Points
        From its origin to the origins of its children's joints; only its origin where that is all there is of a link
        that has an inertia.
    with_collision : links that have a ``<collision>`` element
    """

    joints: tuple[str, ...]
    motors: tuple[str, ...]
    motor_ratios: Array
    transmission: Array
    leader: IntArray
    ratio: Array
    offset: Array
    parent: IntArray
    still: Balls
    sine: Balls
    cosine: Balls
    turns: Sequence[tuple[Any, Any, Any]]
    axes: Balls
    carried: Array
    armature: Array
    inertia: BlockMatrix
    weights: list[list[Any]]
    origins: BlockMatrix
    frames: Mapping[str, Point]
    carriers: Mapping[str, tuple[str, ...]]
    segments: Mapping[str, tuple[tuple[Point, Point], ...]]
    with_collision: frozenset[str]

    def link_frame(self, link: str) -> Point:
        """The origin and the axes of a link."""
        if link not in self.segments:
            raise InputError(f'the robot has no link "{link}"', element="shapes")
        return self.frames[link]

    def weights_of(self, point: Point) -> list[Any]:
        """Weights, 3 B arb: a point's place relative to the centre of mass is ``sum_b R_b w_b``.

        To be called with Arb's precision set.
        """
        row = list(self.weights[point.body])
        for k in range(3):
            row[3 * point.body + k] += point.local[k, 0]
        return row


def cached_robot(content: bytes, path: Path, record: RobotRecord) -> SpatialRobot:
    """Return the robot of a record in space, see :func:`~floatplan.certificate.robots.cached.cached_robot`."""
    return cached.cached_robot(content, path, record, spatial_robot)


@dataclass
class _Body:
    """A body while it is gathered.

    ``placed`` is its joint's placement in the body before it; ``parts`` are triples of mass, centre (3, 1) and second
    moment (3, 3) about that, in its own axes.
    """

    parent: int
    joint: Joint | None
    placed: Placement
    parts: list[tuple[Any, Any, Any]]


def spatial_robot(urdf: Urdf, record: RobotRecord) -> SpatialRobot:
    """Gather the bodies and their constants.

    Raises
    ------
    InputError
        The record names joints that the file lacks, leaves a joint that moves without a role, or moves one that slides.
    """
    with flint.ctx.workprec(PRECISION):
        urdf = as_recorded(urdf, record)
        check_roles(urdf, record)
        by_name = {joint.name: joint for joint in urdf.joints}
        motors = (*record.joints, *(name for name in record.coupled if not is_geared(by_name, record, name)))
        ratios = joint_ratios(record, motors)
        bodies, points = _bodies(urdf, record)
        moved = [body.joint for body in bodies if body.joint is not None]
        leaders = [record.coupled.get(joint.name, {"leader": joint.name})["leader"] for joint in moved]
        turns = [_turn(body) for body in bodies[1:]]
        carried = np.zeros((len(moved), len(bodies)))
        for b, body in enumerate(bodies[1:], 1):
            carried[:, b] = carried[:, body.parent]
            carried[b - 1, b] = 1.0
        weights, inertia = _weights_and_inertia(bodies)
        still, sine, cosine = (_stacked([turn[k] for turn in turns]) for k in range(3))
        return SpatialRobot(
            joints=record.joints,
            motors=motors,
            motor_ratios=np.array([ratios[name][0] for name in motors]),
            transmission=np.array([ratios[joint.name][1] for joint in moved]),
            leader=np.array([record.joints.index(name) for name in leaders]),
            ratio=np.array([float(record.coupled.get(joint.name, {}).get("ratio", 1.0)) for joint in moved]),
            offset=np.array([float(record.coupled.get(joint.name, {}).get("offset", 0.0)) for joint in moved]),
            parent=np.array([body.parent for body in bodies[1:]]),
            still=still,
            sine=sine,
            cosine=cosine,
            turns=turns,
            axes=_stacked([joint.unit_axis for joint in moved])[..., 0],
            carried=carried,
            armature=np.array([float(record.armature.get(joint.name, joint.armature)) for joint in moved]),
            inertia=inertia,
            weights=weights,
            origins=_blocks_of_origins(weights),
            frames={joint.name: points[joint.child] for joint in urdf.joints} | points,
            carriers=carriers(urdf),
            segments=_segments(urdf, points),
            with_collision=frozenset(name for name, link in urdf.links.items() if link.has_collision),
        )


def _bodies(urdf: Urdf, record: RobotRecord) -> tuple[list[_Body], dict[str, Point]]:
    """The bodies, parents first, and the origins of all links."""
    bodies = [_Body(-1, None, Placement(), [])]
    placed = {urdf.root: (0, Placement())}
    for joint in urdf.joints:
        body, parent = placed[joint.parent]
        at = parent * joint.origin
        if joint.name in record.locked:
            placed[joint.child] = body, at * joint.motion(float(record.locked[joint.name]))
        elif joint.kind == "fixed":
            placed[joint.child] = body, at
        else:
            placed[joint.child] = len(bodies), Placement()
            bodies.append(_Body(body, joint, at, []))
    for name, link in urdf.links.items():
        body, place = placed[name]
        center = place * link.center
        inertia = center.rotation * link.inertia * center.rotation.transpose()
        trace = sum((inertia[k, k] for k in range(3)), start=flint.arb(0))
        bodies[body].parts.append((link.mass, center.translation, diagonal([trace / 2] * 3) - inertia))
    return bodies, {name: Point(body, place.translation, place.rotation) for name, (body, place) in placed.items()}


def _segments(urdf: Urdf, points: Mapping[str, Point]) -> dict[str, tuple[tuple[Point, Point], ...]]:
    """The shapes of links without ``<collision>``, from the points at the links' origins."""
    segments = {}
    for name, link in urdf.links.items():
        start = points[name]
        places = [joint.origin.translation for joint in urdf.joints if joint.parent == name]
        apart = [place for place in places if not all(part.is_zero() for part in place.entries())]
        ends = [Point(start.body, start.local + start.axes * place) for place in apart]
        if not ends and link.has_inertial:
            ends = [start]
        segments[name] = () if link.frame else tuple((start, end) for end in ends)
    return segments


def _blocks_of_origins(weights: Sequence[Sequence[Any]]) -> BlockMatrix:
    """The weights (B) of the bodies' origins, 3 B arb each, as columns."""
    return BlockMatrix.of(_stacked([flint.arb_mat(weights)])[0].transposed, 3, 1)


def _stacked(matrices: Sequence[Any]) -> Balls:
    """Matrices of one shape in Arb, or none that are (3, 3), as balls (count, rows, columns)."""
    rows, columns = (matrices[0].nrows(), matrices[0].ncols()) if matrices else (3, 3)
    entries = []
    for matrix in matrices:
        entries += matrix.entries()
    return Balls.from_arb(entries, (len(matrices), rows, columns))


def _turn(body: _Body) -> tuple[Any, Any, Any]:
    """The three matrices of a body's rotation by its joint: Rodrigues' formula after the joint's placement."""
    assert body.joint is not None
    axis = body.joint.unit_axis
    columns = []
    for k in range(3):
        unit = [0.0, 0.0, 0.0]
        unit[k] = 1.0
        columns.append(cross(axis, flint.arb_mat(3, 1, unit)))
    across = flint.arb_mat([column.entries() for column in columns]).transpose()
    squared = across * across
    turned = body.placed.rotation
    return turned + turned * squared, turned * across, -(turned * squared)


def _weights_and_inertia(bodies: Sequence[_Body]) -> tuple[list[list[Any]], BlockMatrix]:
    """Weights of the bodies' origins relative to the centre of mass, and C: as in the plane, with vectors for w."""
    width = 3 * len(bodies)

    def moved(row: Sequence[Any], body: int, place: Any) -> list[Any]:
        """A row, with a place in a body's axes added."""
        result = list(row)
        for k in range(3):
            result[3 * body + k] += place[k, 0]
        return result

    origins = [[flint.arb(0)] * width]
    for body in bodies[1:]:
        origins.append(moved(origins[body.parent], body.parent, body.placed.translation))
    parts = []
    for b, body in enumerate(bodies):
        parts += [(b, *part) for part in body.parts]
    rows = [moved(origins[b], b, place) for b, _, place, _ in parts]
    masses = [mass for _, mass, _, _ in parts]
    total = sum(masses, start=flint.arb(0))
    if not total > 0:
        raise InputError("has no mass")
    center = flint.arb_mat([masses]) * flint.arb_mat(rows) * (1 / total)
    relative = flint.arb_mat(rows) - flint.arb_mat(len(rows), 1, [1] * len(rows)) * center
    weighted = flint.arb_mat(relative)
    for row, mass in enumerate(masses):
        for entry in range(width):
            weighted[row, entry] *= mass
    matrix = (relative.transpose() * weighted).tolist()
    for b, _, _, second in parts:
        for i in range(3):
            for j in range(3):
                matrix[3 * b + i][3 * b + j] += second[i, j]
    weights = (flint.arb_mat(origins) - flint.arb_mat(len(bodies), 1, [1] * len(bodies)) * center).tolist()
    return weights, BlockMatrix.of(_stacked([flint.arb_mat(matrix)])[0], 3, 3)
