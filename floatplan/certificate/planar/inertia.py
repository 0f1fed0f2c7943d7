"""The robot in its plane: the generalised Appendix of the paper, (A.4) to (A.7), for any tree of links.

Links that do not move relative to each other form a body. Each body's frame coincides with the root link's axes when
the planned positions are zero, so that body b is turned by the absolute angle
``phi_b = orientation + sum_k turns_bk q_k`` and ``z_b = exp(i phi_b)`` turns its points. Points of the plane are
complex numbers, horizontal + i sigma vertical, where sigma = +1 if a positive angle turns the horizontal axis towards
the vertical one, else -1: a mirror image in which positive angles always turn counterclockwise.

The place of any point relative to the centre of mass is ``sum_b w_b z_b`` with constants w, and so the kinetic energy
about the centre of mass is ``1/2 sum_ij c_ij cos(phi_i - phi_j - a_ij) phi_i' phi_j'`` with
``c_ij exp(i a_ij) = C_ij = sum_b m_b conj(w_bi) w_bj + delta_ij I_i``, where w_b belongs to body b's centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import flint

from floatplan.arrays import Array
from floatplan.certificate.enclosure import PRECISION, Balls
from floatplan.certificate.planar.roles import check_roles, motor_ratios, motors_of, position_at_zero
from floatplan.certificate.planar.urdf import IDENTITY, Joint, Placement, Urdf, motion, rotate, unit_axis
from floatplan.certificate.vectors import ComplexBalls
from floatplan.errors import InputError
from floatplan.plans.record import RobotRecord

LETTERS = "xyz"
SHORTEST = 1e-12  # [m] a shorter segment is its start
LARGEST_TILT = 1e-3  # [rad] an axis this close to the normal is taken for the normal


@dataclass(frozen=True)
class Point:
    """A point fixed to a body, its place (acb, m) in that body's frame."""

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
    turns : (m, n)
    turned_by : (m) pairs (joint, arb)
        The entries of ``turns`` that are not zero.
    inertia : (m, m)
        C, kg m^2.
    weights : (m) lists of (m) acb
        Place of each body's own origin relative to the centre of mass: ``sum_b weights[body][b] z_b``.
    frames : link or joint name -> Point
    carriers : frame or link name -> links on which it stands: its own link, then those that this one is fixed to
    segments : link name -> pairs of Points
        From its origin to the origins of its children's joints, and of its own where a locked prismatic joint holds it
        away from there; only its origin where that is all there is of a link that has an inertia.
    links : link name -> (body, Placement in the root link at planned positions zero)
    horizontal, vertical : indices of the plane's axes among x, y, z
    """

    joints: tuple[str, ...]
    motors: tuple[str, ...]
    motor_ratios: Array
    motor_turns: Balls
    sigma: float
    turns: Balls
    turned_by: tuple[tuple[tuple[int, Any], ...], ...]
    inertia: ComplexBalls
    weights: tuple[tuple[Any, ...], ...]
    frames: Mapping[str, Point]
    carriers: Mapping[str, tuple[str, ...]]
    segments: Mapping[str, tuple[tuple[Point, Point], ...]]
    links: Mapping[str, tuple[int, Placement]]
    origins: tuple[Any, ...]
    horizontal: int
    vertical: int
    with_collision: frozenset[str]

    def point_weights(self, points: Sequence[Point]) -> ComplexBalls:
        """Weights (points, m): a point's place relative to the centre of mass is ``sum_b w_b z_b``."""
        values = []
        with flint.ctx.workprec(PRECISION):
            for point in points:
                values += self._weights_of(point)
        return ComplexBalls.from_acb(values, (len(points), len(self.weights)))

    def frame_weights(self, frame: str) -> list[Any]:
        """Weights (m), acb, of a frame's origin; to be called with Arb's precision set."""
        if frame not in self.frames:
            raise ValueError(f'the robot has no frame "{frame}"')
        return self._weights_of(self.frames[frame])

    def _weights_of(self, point: Point) -> list[Any]:
        row = list(self.weights[point.body])
        row[point.body] += point.local
        return row

    def link_point(self, link: str, place: Sequence[float]) -> Point:
        """Point of a link, m: (x, y, z) in the link's frame, or (horizontal, vertical) from its origin.

        The plane's two axes are the root link's, in the posture with all planned positions zero.
        """
        if link not in self.links:
            raise InputError(f'the robot has no link "{link}"', element="shapes")
        body, placement = self.links[link]
        with flint.ctx.workprec(PRECISION):
            values = [flint.arb(float(value)) for value in place]
            if len(values) == 2:
                return Point(body, self.frames[link].local + flint.acb(values[0], self.sigma * values[1]))
            x, y, z = values
            return Point(body, self._in_plane(placement.point((x, y, z))) - self.origins[body])

    def _in_plane(self, point: Any) -> Any:
        return flint.acb(flint.arb(point[self.horizontal]), self.sigma * flint.arb(point[self.vertical]))


@dataclass
class _Body:
    """A body while it is gathered: its turns, origin in the plane, mass, first moment and parts."""

    turns: list[Any]
    motor_turns: list[Any]
    parent: int
    origin: Any
    mass: Any
    moment: Any
    parts: list[tuple[Any, Any, Any]]  # mass, place in the root link's plane, inertia about the normal


def planar_robot(urdf: Urdf, record: RobotRecord) -> PlanarRobot:
    """Gather the bodies and their constants.

    Raises
    ------
    InputError
        The record names joints that the file lacks, leaves a joint that moves without a role, or moves one whose axis
        is not the plane's normal.
    """
    with flint.ctx.workprec(PRECISION):
        check_roles(urdf, record)
        horizontal, vertical = _axes(record.plane)
        normal_axis = 3 - horizontal - vertical
        placed, signs = _placed(urdf, record, normal_axis)
        normal = -1.0 if sum(signs[joint] for joint in record.joints) < 0 else 1.0
        sigma = normal * (1.0 if (vertical - horizontal) % 3 == 1 else -1.0)

        def in_plane(point: Any) -> Any:
            return flint.acb(flint.arb(point[horizontal]), sigma * flint.arb(point[vertical]))

        motors = motors_of(urdf, record)
        turning = {name: sign * normal for name, sign in signs.items()}
        bodies, body_of = _gather(urdf, record, placed, turning, motors, in_plane)
        for link in urdf.links.values():
            _add_link(bodies[body_of[link.name]], link, placed[link.name], normal_axis, in_plane)
        weights = _weights(bodies)
        count = len(bodies)

        def origin_of(link: str, carrier: str) -> Point:
            body = body_of[carrier]
            return Point(body, in_plane(placed[link].translation) - bodies[body].origin)

        frames = {joint.name: origin_of(joint.child, joint.child) for joint in urdf.joints}
        frames |= {link: origin_of(link, link) for link in urdf.links}

        def joint_origin(joint: Joint, carrier: str) -> Point:
            body = body_of[carrier]
            return Point(body, in_plane((placed[joint.parent] * joint.origin).translation) - bodies[body].origin)

        segments = {link: _segments(urdf, origin_of(link, link), link, joint_origin) for link in urdf.links}
        return PlanarRobot(
            joints=record.joints,
            motors=motors,
            motor_ratios=motor_ratios(record, motors),
            motor_turns=Balls.from_arb(
                [flint.arb(turn) for body in bodies for turn in body.motor_turns], (count, len(motors))
            ),
            sigma=sigma,
            turns=Balls.from_arb(
                [flint.arb(turn) for body in bodies for turn in body.turns], (count, len(record.joints))
            ),
            turned_by=tuple(
                tuple((joint, turn) for joint, turn in enumerate(map(flint.arb, body.turns)) if not turn.is_zero())
                for body in bodies
            ),
            inertia=_inertia(bodies, weights),
            weights=tuple(tuple(row) for row in weights),
            frames=frames,
            carriers=_carriers(urdf),
            segments=segments,
            links={link: (body_of[link], placed[link]) for link in urdf.links},
            origins=tuple(body.origin for body in bodies),
            horizontal=horizontal,
            vertical=vertical,
            with_collision=frozenset(name for name, link in urdf.links.items() if link.has_collision),
        )


def _axes(plane: str) -> tuple[int, int]:
    if len(plane) != 2 or plane[0] == plane[1] or not set(plane) <= set(LETTERS):
        raise InputError(f'"{plane}" is not two different letters of x, y and z', element="robot.plane")
    return LETTERS.index(plane[0]), LETTERS.index(plane[1])


def _placed(urdf: Urdf, record: RobotRecord, normal_axis: int) -> tuple[dict[str, Placement], dict[str, float]]:
    """Placements of links in the root link at planned positions zero, and each moving joint's direction, +1 or -1.

    Directions are along the plane's third letter; an axis slightly off it is turned onto it.
    """
    placed = {urdf.root: Placement(IDENTITY, (0, 0, 0))}
    signs = {}
    for joint in urdf.joints:
        at = placed[joint.parent] * joint.origin
        turned = joint
        if joint.name in record.joints or joint.name in record.coupled:
            axis = rotate(at.rotation, unit_axis(joint))
            if any(not abs(flint.arb(axis[k])) < LARGEST_TILT for k in range(3) if k != normal_axis):
                raise InputError("its axis is not the plane's normal", element=f'joint "{joint.name}"')
            sign = 1.0 if axis[normal_axis] > 0 else -1.0
            x, y, z = (sign * flint.arb(value) for value in at.rotation[normal_axis])
            turned = replace(joint, axis=(x, y, z))
            signs[joint.name] = sign
        placed[joint.child] = at if joint.kind == "fixed" else at * motion(turned, position_at_zero(joint, record))
    return placed, signs


def _segments(
    urdf: Urdf, start: Point, link: str, joint_origin: Callable[[Joint, str], Point]
) -> tuple[tuple[Point, Point], ...]:
    ends = [joint_origin(joint, link) for joint in urdf.joints if link in (joint.parent, joint.child)]
    apart = tuple((start, end) for end in ends if not abs(end.local - start.local) < SHORTEST)
    return apart or (((start, start),) if urdf.links[link].has_inertial else ())


def _carriers(urdf: Urdf) -> dict[str, tuple[str, ...]]:
    fixed_to = {joint.child: joint.parent for joint in urdf.joints if joint.kind == "fixed"}
    carriers = {}
    for link in urdf.links:
        chain = [link]
        while chain[-1] in fixed_to:
            chain.append(fixed_to[chain[-1]])
        carriers[link] = tuple(chain)
    return {joint.name: carriers[joint.child] for joint in urdf.joints} | carriers


def _gather(
    urdf: Urdf,
    record: RobotRecord,
    placed: Mapping[str, Placement],
    signs: Mapping[str, float],
    motors: Sequence[str],
    in_plane: Any,
) -> tuple[list[_Body], dict[str, int]]:
    """Bodies, parents first, and the body of each link."""
    zero = flint.arb(0)
    bodies = [_Body([zero] * len(record.joints), [zero] * len(motors), -1, flint.acb(0), zero, flint.acb(0), [])]
    body_of = {urdf.root: 0}
    for joint in urdf.joints:
        parent = body_of[joint.parent]
        body_of[joint.child] = parent
        if joint.name not in signs:
            continue
        coupling = record.coupled.get(joint.name, {"leader": joint.name})
        turns = list(bodies[parent].turns)
        column = record.joints.index(coupling["leader"])
        ratio = flint.arb(float(coupling.get("ratio", 1.0)))
        turns[column] = turns[column] + signs[joint.name] * ratio
        motor_turns = list(bodies[parent].motor_turns)
        motor = motors.index(joint.name if joint.name in motors else coupling["leader"])
        by_motor = flint.arb(1) if joint.name in motors else ratio
        motor_turns[motor] = motor_turns[motor] + signs[joint.name] * by_motor
        body_of[joint.child] = len(bodies)
        origin = in_plane(placed[joint.child].translation)
        bodies.append(_Body(turns, motor_turns, parent, origin, zero, flint.acb(0), []))
    return bodies, body_of


def _add_link(body: _Body, link: Any, placement: Placement, normal_axis: int, in_plane: Any) -> None:
    """Add a link's mass, first moment and ``n' R I R' n`` to its body."""
    center = placement * link.center
    row = center.rotation[normal_axis]
    about = sum((row[a] * link.inertia[a][b] * row[b] for a in range(3) for b in range(3)), start=flint.arb(0))
    place = in_plane(center.translation)
    body.mass += link.mass
    body.moment += link.mass * (place - body.origin)
    body.parts.append((link.mass, place - body.origin, about))


def _weights(bodies: list[_Body]) -> list[list[Any]]:
    """Weights (m, m) of the bodies' origins relative to the centre of mass."""
    count = len(bodies)
    origins: list[list[Any]] = []
    for body in bodies:
        row = [flint.acb(0)] * count if body.parent < 0 else list(origins[body.parent])
        if body.parent >= 0:
            row[body.parent] = row[body.parent] + body.origin - bodies[body.parent].origin
        origins.append(row)
    total = sum((body.mass for body in bodies), start=flint.arb(0))
    if not total > 0:
        raise InputError("has no mass")
    center = [body.moment / total for body in bodies]
    for body, row in zip(bodies, origins, strict=True):
        fraction = body.mass / total
        center = [entry + fraction * weight for entry, weight in zip(center, row, strict=True)]
    return [[weight - entry for weight, entry in zip(row, center, strict=True)] for row in origins]


def _inertia(bodies: list[_Body], weights: list[list[Any]]) -> ComplexBalls:
    """``C_ij = sum_parts m conj(w_i) w_j + delta_ij I_i``, over the parts (links) of all bodies.

    A part's weights are those of its body's origin, w, plus its place p in that body's own entry; so with a body's mass
    m, first moment s and second moment k about its origin, its fraction is
    ``m conj(w_i) w_j + conj(s) w_j [i = b] + s conj(w_i) [j = b] + k [i = j = b]``.
    """
    count = len(bodies)
    columns = flint.acb_mat([[row[j].conjugate() for row in weights] for j in range(count)])
    scaled = flint.acb_mat([[body.mass * entry for entry in row] for body, row in zip(bodies, weights, strict=True)])
    matrix = (columns * scaled).tolist()
    for b, body in enumerate(bodies):
        for j in range(count):
            matrix[b][j] += body.moment.conjugate() * weights[b][j]
            matrix[j][b] += body.moment * weights[b][j].conjugate()
        matrix[b][b] += sum((m * abs(p) * abs(p) + about for m, p, about in body.parts), start=flint.arb(0))
    return ComplexBalls.from_acb([entry for row in matrix for entry in row], (count, count))
