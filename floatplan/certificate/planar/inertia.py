"""The robot in its plane: the generalised Appendix of the paper, (A.4) to (A.7), for any tree of links.

Links that do not move relative to each other form a body. Each body's frame coincides with the root link's axes when
the planned positions are zero, so that body b is turned by the absolute angle
``phi_b = orientation + sum_k turns_bk q_k`` and ``z_b = exp(i phi_b)`` turns its points. Points of the plane are
complex numbers, horizontal + i sigma vertical, where sigma = +1 if a positive angle turns the horizontal axis towards
the vertical one, else -1: a mirror image in which positive angles always are counterclockwise.

The position of any point relative to the centre of mass is ``sum_b w_b z_b`` with constants w; so the kinetic energy
about the centre of mass is ``1/2 sum_ij c_ij cos(phi_i - phi_j - a_ij) phi_i' phi_j'`` with
``c_ij exp(i a_ij) = C_ij = sum_b m_b conj(w_bi) w_bj + delta_ij I_i``, where w_b belongs to body b's centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.cells import ComplexBalls
from floatplan.certificate.enclosure import PRECISION, Balls
from floatplan.certificate.robots import cached
from floatplan.certificate.robots.taken import as_recorded
from floatplan.certificate.robots.urdf import Joint, Placement, Urdf, carriers, check_roles, is_geared, joint_ratios
from floatplan.errors import InputError
from floatplan.plans.record import RobotRecord
from floatplan.tables import LARGEST_TILT


def cached_robot(content: bytes, path: Path, record: RobotRecord) -> PlanarRobot:
    """Return the robot of a record in its plane, see :func:`~floatplan.certificate.robots.cached.cached_robot`."""
    return cached.cached_robot(content, path, record, planar_robot)


@dataclass(frozen=True)
class Point:
    """A point fixed to a body, its position (acb, m) in that body's frame."""

    body: int
    local: Any


@dataclass(frozen=True, eq=False)
class PlanarRobot:
    """A planar tree of bodies as constants.

    Attributes
    ----------
    joints : (n) planned joints
    motors : (motors) the planned joints, then the coupled ones that the file does not gear to their leader
    motor_ratios : (motors, n) derivatives of the motors' positions by the planned ones
    motor_turns : (m, motors) as ``turns``, by the positions of the motors, each on its own
    sigma : +1 or -1
    normal : (3,)
        Along plus or minus one of the root link's axes: positive angles turn about it.
    turns : (m, n)
    turned_by : (m) pairs (joint, arb)
        The entries of ``turns`` that are not zero.
    inertia : (m, m)
        C, kg m^2.
    rotors : (m, n), optional
        Moments on the bodies of the motors' rotors, by the planned accelerations, kg m^2: those of a joint on
        its body, and against the body before it.
    weights : (m) lists of (m) acb
        Position of each body's own origin relative to the centre of mass: ``sum_b weights[body][b] z_b``.
    frames : link or joint name -> Point
    carriers : frame or link name -> links on which it stands: its own link, then those that this one is fixed to
    segments : link name -> pairs of Points
        From its origin to the origins of its children's joints, and of its own where a locked prismatic joint holds it
        away from there; only its origin where that is all there is of a link that has an inertia.
    with_collision : links that have a ``<collision>`` element
    """

    joints: tuple[str, ...]
    motors: tuple[str, ...]
    motor_ratios: Array
    motor_turns: Balls
    sigma: float
    normal: Array
    turns: Balls
    turned_by: list[list[tuple[int, Any]]]
    inertia: ComplexBalls
    rotors: Balls | None
    weights: list[list[Any]]
    frames: Mapping[str, Point]
    carriers: Mapping[str, tuple[str, ...]]
    segments: Mapping[str, tuple[tuple[Point, Point], ...]]
    with_collision: frozenset[str]

    def weights_of(self, point: Point) -> list[Any]:
        """Weights (m), acb: a point's position relative to the centre of mass is ``sum_b w_b z_b``.

        To be called with Arb's precision set.
        """
        row = list(self.weights[point.body])
        row[point.body] += point.local
        return row

    def link_point(self, link: str, position: Sequence[float]) -> Point:
        """Point of a link, m: (horizontal, vertical) from its origin, with all planned positions zero."""
        if link not in self.segments:
            raise InputError(f'the robot has no link "{link}"', element="shapes")
        origin = self.frames[link]
        (x, y) = position
        with flint.ctx.workprec(PRECISION):
            return Point(origin.body, origin.local + flint.acb(flint.arb(float(x)), self.sigma * flint.arb(float(y))))


@dataclass
class _Body:
    """A body while it is gathered: its turns, its origin in the plane, and what has mass in it.

    ``masses`` are triples of mass, position from the origin and inertia about the normal.
    """

    parent: int
    turns: list[Any]
    motor_turns: list[Any]
    origin: Any
    masses: list[tuple[Any, Any, Any]] = field(default_factory=list)


def planar_robot(urdf: Urdf, record: RobotRecord) -> PlanarRobot:
    """Gather the bodies and their constants.

    Raises
    ------
    InputError
        The record names joints that the file lacks, leaves a joint that moves without a role, or moves one whose axis
        is not the plane's normal.
    """
    with flint.ctx.workprec(PRECISION):
        urdf = as_recorded(urdf, record)
        check_roles(urdf, record)
        plane = record.plane or ""
        if len(plane) != 2 or plane[0] == plane[1] or not set(plane) <= set("xyz"):
            raise InputError(f'"{plane}" is not two different letters of x, y and z', element="robot.plane")
        horizontal, vertical = map("xyz".index, plane)
        normal_axis = 3 - horizontal - vertical
        placed, signs = _placed(urdf, record, normal_axis)
        normal = -1.0 if sum(signs[joint] for joint in record.joints) < 0 else 1.0
        sigma = normal * (1.0 if (vertical - horizontal) % 3 == 1 else -1.0)

        def in_plane(point: Any) -> Any:
            return flint.acb(point[horizontal, 0], sigma * point[vertical, 0])

        by_name = {joint.name: joint for joint in urdf.joints}
        motors = list(record.joints)
        motors += [name for name in record.coupled if not is_geared(by_name, record, name)]
        ratios = joint_ratios(record, motors)
        bodies = [_Body(-1, [flint.arb(0)] * len(record.joints), [flint.arb(0)] * len(motors), flint.acb(0))]
        body_of = {urdf.root: 0}
        for joint in urdf.joints:
            parent = body_of[joint.child] = body_of[joint.parent]
            if joint.name in signs:
                body_of[joint.child] = len(bodies)
                above = bodies[parent]
                sign = signs[joint.name] * normal
                of_joints, of_motors = ratios[joint.name]
                turns = _added(above.turns, sign, of_joints)
                motor_turns = _added(above.motor_turns, sign, of_motors)
                bodies.append(_Body(parent, turns, motor_turns, in_plane(placed[joint.child].translation)))
        for name, link in urdf.links.items():
            body = bodies[body_of[name]]
            center = placed[name] * link.center
            normals = flint.arb_mat([[center.rotation[normal_axis, k] for k in range(3)]])
            about = (normals * link.inertia * normals.transpose())[0, 0]
            body.masses.append((link.mass, in_plane(center.translation) - body.origin, about))
        weights, inertia = _weights_and_inertia(bodies)
        turning = {}
        for joint in urdf.joints:
            if joint.name in signs:
                turning[body_of[joint.child]] = joint
        rotors = _rotors(bodies, turning, record)
        points = {}
        for link_name, index in body_of.items():
            position = in_plane(placed[link_name].translation)
            points[link_name] = Point(index, position - bodies[index].origin)
        return PlanarRobot(
            joints=record.joints,
            motors=tuple(motors),
            motor_ratios=np.array([ratios[name][0] for name in motors]),
            motor_turns=_matrix([body.motor_turns for body in bodies]),
            sigma=sigma,
            normal=normal * np.eye(3)[normal_axis],
            turns=_matrix([body.turns for body in bodies]),
            turned_by=[_nonzero(body.turns) for body in bodies],
            inertia=inertia,
            rotors=_matrix(rotors) if any(rotor != 0 for rotor in chain.from_iterable(rotors)) else None,
            weights=weights,
            frames={joint.name: points[joint.child] for joint in urdf.joints} | points,
            carriers=carriers(urdf),
            segments=_segments(urdf, points, placed, lambda body, point: in_plane(point) - bodies[body].origin),
            with_collision=frozenset(name for name, link in urdf.links.items() if link.has_collision),
        )


def _added(coefficients: Sequence[Any], sign: Any, ratios: Sequence[Any]) -> list[Any]:
    """Coefficients (n,) of a body's angle: those of the body above, and the ratios of the joint between them."""
    return [coefficient + sign * ratio for coefficient, ratio in zip(coefficients, ratios, strict=True)]


def _nonzero(coefficients: Sequence[Any]) -> list[tuple[int, Any]]:
    """Coefficients with their indices, those that are exactly zero left out."""
    terms = []
    for index, coefficient in enumerate(coefficients):
        if not coefficient.is_zero():
            terms.append((index, coefficient))
    return terms


def _rotors(bodies: Sequence[_Body], carriers: Mapping[int, Joint], record: RobotRecord) -> list[list[Any]]:
    """Moments (m, n) of rotors: of each joint on the body that it carries, and against the one before."""
    rotors = [[flint.arb(0)] * len(record.joints) for _ in bodies]
    for index, joint in carriers.items():
        body = bodies[index]
        armature = flint.arb(record.armature.get(joint.name, joint.armature))
        for k, (coefficient, above) in enumerate(zip(body.turns, bodies[body.parent].turns, strict=True)):
            rotors[index][k] += armature * (coefficient - above)
            rotors[body.parent][k] -= armature * (coefficient - above)
    return rotors


def _placed(urdf: Urdf, record: RobotRecord, normal_axis: int) -> tuple[dict[str, Placement], dict[str, float]]:
    """Placements of links in the root link at planned positions zero, and each moving joint's direction, +1 or -1.

    Directions are along the plane's third letter; an axis slightly off it is turned onto it.
    """
    placed = {urdf.root: Placement()}
    signs = {}
    for joint in urdf.joints:
        at = placed[joint.parent] * joint.origin
        turned = joint
        if joint.name in record.joints or joint.name in record.coupled:
            axis = at.rotation * joint.unit_axis
            across = (abs(axis[(normal_axis + 1) % 3, 0]), abs(axis[(normal_axis + 2) % 3, 0]))
            if not (across[0] < LARGEST_TILT and across[1] < LARGEST_TILT):
                raise InputError("its axis is not the plane's normal", element=f'joint "{joint.name}"')
            sign = signs[joint.name] = 1.0 if axis[normal_axis, 0] > 0 else -1.0
            turned = replace(joint, axis=flint.arb_mat(3, 1, [sign * at.rotation[normal_axis, k] for k in range(3)]))
        offset = record.coupled.get(joint.name, {}).get("offset", 0.0)
        position = float(record.locked.get(joint.name, offset))
        placed[joint.child] = at if joint.kind == "fixed" else at * turned.motion(position)
    return placed, signs


def _segments(
    urdf: Urdf, points: Mapping[str, Point], placed: Mapping[str, Placement], local: Callable[[int, Any], Any]
) -> dict[str, tuple[tuple[Point, Point], ...]]:
    joints = [(joint, (placed[joint.parent] * joint.origin).translation) for joint in urdf.joints]
    segments = {}
    for name, link in urdf.links.items():
        start = points[name]
        ends = []
        for joint, origin in joints:
            if name in (joint.parent, joint.child):
                position = local(start.body, origin)
                if not abs(position - start.local) < 1e-12:  # [m] a shorter segment is its start
                    ends.append(Point(start.body, position))
        if link.frame:
            ends = []
        elif not ends and link.has_inertial:
            ends = [start]
        segments[name] = tuple((start, end) for end in ends)
    return segments


def _matrix(rows: Sequence[Sequence[Any]]) -> Balls:
    return Balls.from_arb(list(chain.from_iterable(rows)), (len(rows), len(rows[0])))


def _weights_and_inertia(bodies: list[_Body]) -> tuple[list[list[Any]], ComplexBalls]:
    """Weights (m, m) of the bodies' origins relative to the centre of mass, and the inertia C (m, m).

    With a row W for each link of all bodies, which is that of its body's origin plus its position in the body's own
    entry, and the parts' masses M: the centre of mass is ``M W / sum M``, and, with W relative to that, C is
    ``W^* diag(M) W`` plus the parts' own inertias on the diagonal.
    """
    count = len(bodies)
    origins: list[list[Any]] = []
    for body in bodies:
        origins.append([flint.acb(0)] * count if body.parent < 0 else list(origins[body.parent]))
        if body.parent >= 0:
            origins[-1][body.parent] += body.origin - bodies[body.parent].origin
    masses: list[Any] = []
    rows: list[list[Any]] = []
    moments = [flint.arb(0)] * count  # of the links about their own centres, by body
    for index, body in enumerate(bodies):
        for mass, position, about in body.masses:
            row = list(origins[index])
            row[index] += position
            masses.append(mass)
            rows.append(row)
            moments[index] += about
    total = sum(masses, start=flint.acb(0)).real
    if not total > 0:
        raise InputError("has no mass")
    of_links = flint.acb_mat(rows)
    center = flint.acb_mat([masses]) * of_links * (1 / total)
    relative = of_links - flint.acb_mat([[1]] * len(rows)) * center
    weighted = relative.tolist()
    for row, mass in zip(weighted, masses, strict=True):
        row[:] = [mass * entry for entry in row]
    matrix = (relative.conjugate().transpose() * flint.acb_mat(weighted)).tolist()
    for index, moment in enumerate(moments):
        matrix[index][index] += moment
    weights = (flint.acb_mat(origins) - flint.acb_mat([[1]] * count) * center).tolist()
    return weights, ComplexBalls.from_acb(list(chain.from_iterable(matrix)), (count, count))
