"""The motion of a jump's stances, from what is saved: position of the base, forces of the contacts, and torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray, read_only
from floatplan.jumps.contacts import GroundContact, displacement
from floatplan.plans.plan import Plan
from floatplan.robot import Robot
from floatplan.robot.planar.model import BASE_COORDINATES as BASE
from floatplan.robot.standing import Spot, spot_weights


@dataclass(frozen=True, eq=False)
class Grid:
    """A stance on G instants, quintics between them.

    Attributes
    ----------
    times : (G,) s, from the jump's start
    y, v, a : (n+1, G) orientation and joints with their derivatives
    ratios : (others, G) horizontal over vertical force of the contacts but the anchor, linear between instants
    """

    times: Array
    y: Array
    v: Array
    a: Array
    ratios: Array

    @cached_property
    def curve(self) -> Any:
        """Piecewise polynomial of y."""
        return quintic_spline(self.times, self.motion)

    @property
    def motion(self) -> Array:
        """y, v, a (3, n+1, G)."""
        return np.stack((self.y, self.v, self.a))

    def at(self, times: Array) -> Array:
        """y, y', y'' (3, n+1, N) at times (N,)."""
        return values(self.curve, times)


def quintic_spline(times: Array, motion: Array) -> Any:
    """Piecewise quintics through values, first and second derivatives (3, rows, G)."""
    from scipy.interpolate import BPoly  # here, because reading and exporting plans does without

    return BPoly.from_derivatives(times, np.transpose(motion, (2, 0, 1)))


def values(curve: Any, times: Array) -> Array:
    """A curve and two derivatives (3, rows, N) at times (N,)."""
    return np.stack([(curve.derivative(order) if order else curve)(times).T for order in range(3)])


def quintic(times: Array, span: Array, first: Array, last: Array) -> Array:
    """Values and two derivatives (3, rows, N) of quintics between these (3, rows) at two times ``span`` (2,)."""
    return values(quintic_spline(span, np.stack((first, last), axis=2)), times)


def refined(times: Array, count: int) -> Array:
    """Times (N,) with ``count`` even steps for each of theirs."""
    return np.interp(np.arange(count * (len(times) - 1) + 1) / count, np.arange(len(times)), times)


@dataclass(frozen=True, eq=False)
class JumpState:
    """A robot at N instants of a jump.

    Attributes
    ----------
    times : (N,) s, from the jump's start
    positions, velocities, accelerations : (N, nv) of all coordinates of ``robot.model``
        The base's horizontal and vertical position and orientation, then all joints, m and rad.
    forces : point's name -> (N, 2) N, horizontal and vertical, of the points in contact
    torques : (N, nv) N m, inverse dynamics less the forces; the base's first three are what is out of balance
    points : point's name -> (N, 3) m in the jump's world, where its force acts; NaN while it is not in contact
    """

    times: Array
    positions: Array
    velocities: Array
    accelerations: Array
    forces: dict[str, Array]
    torques: Array
    points: dict[str, Array]

    def planned(self, robot: Robot) -> Array:
        """Orientation and planned joints with two derivatives (3, n+1, N), rad."""
        joints = np.linalg.pinv(robot.selection)
        full = (self.positions - robot.reference, self.velocities, self.accelerations)
        return np.stack([np.vstack((values[:, BASE - 1], joints @ values.T)) for values in full])


class AnyStance(Protocol):
    """One stance phase, in a plane or in space, as a check asks it."""

    @property
    def robot(self) -> Robot:
        """The robot that stands."""

    @property
    def gravity(self) -> float:
        """Gravity, m/s^2."""

    @property
    def contacts(self) -> Sequence[Any]:
        """Contacts that stand."""

    @property
    def grid(self) -> Any:
        """Instants between which its motion is smooth, and the motion at them."""

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end, s."""

    @property
    def ground(self) -> float:
        """Height of the ground on which it stands, m."""

    def at(self, times: Array) -> JumpState:
        """State at times (N,) s from the jump's start."""

    def joints(self, times: Array) -> Array:
        """Planned positions (N, n), rad, at times (N,) s."""

    def inverse_dynamics(self, state: JumpState) -> tuple[Array, dict[str, tuple[Array, Array]]]:
        """Forces (N, nv) on all coordinates that a state takes, less what its contacts bear; and how these move.

        Of each point that stands, by name: positions (N, d), m, less what was rolled, and speeds (N,), m/s.
        """


@dataclass(frozen=True, eq=False)
class Stance:
    """One stance phase: a grid of orientation and joints, and the point from which the base hangs.

    Attributes
    ----------
    robot : Robot
    gravity : m/s^2
    contacts : the anchor first
    anchor_position : in the jump's world, m, horizontal + i vertical; of one that rolls, at its body's angle 0
    grid : Grid
    """

    robot: Robot
    gravity: float
    contacts: tuple[GroundContact, ...]
    anchor_position: complex
    grid: Grid

    def at(self, times: Array) -> JumpState:
        """State at times (N,) s from the jump's start."""
        q, v, a = self._coordinates(times)
        touching = self.touching(q)
        wrench = self._wrench(q, v, a)
        levers = {name: jacobians[:, :, BASE - 1] for name, (_, jacobians) in touching.items()}
        forces = self._forces(times, wrench, levers)
        torques = wrench.copy()
        points = {}
        for name, (positions, jacobians) in touching.items():
            torques -= np.einsum("ni,nij->nj", forces[name], jacobians)
            points[name] = positions
        return JumpState(
            times=read_only(times),
            positions=read_only(q),
            velocities=read_only(v),
            accelerations=read_only(a),
            forces=forces,
            torques=read_only(torques),
            points=points,
        )

    def position_of(self, contact: GroundContact) -> complex:
        """Where a contact stands at its end, m, in the same way as :attr:`anchor_position`."""
        across, up = displacement(self.robot, self.contacts[0].spots[0], contact.spots[0], self.grid.y[:, -1])
        return self.anchor_position + complex(across, up)

    def joints(self, times: Array) -> Array:
        """Planned positions (N, n), rad, at times (N,) s."""
        positions: Array = self.grid.curve(times)[:, 1:]
        return positions

    def _coordinates(self, times: Array) -> tuple[Array, Array, Array]:
        """All coordinates of ``robot.model`` with two derivatives, (N, nv) each: the base hangs on the anchor."""
        robot = self.robot
        tree = robot.tree
        motion = self.grid.at(times)
        y, v, a = motion
        angles = tree.absolute_angles(y[0], y[1:].T)
        rates = v[0][:, None] + v[1:].T @ tree.turns.T
        accelerations = a[0][:, None] + a[1:].T @ tree.turns.T
        rotations = tree.rotations(angles)
        first = 1j * tree.turn * rates * rotations
        second = (1j * tree.turn * accelerations - rates**2) * rotations
        base_weights, anchor_weights = spot_weights(robot, [Spot(0, 0j), self.contacts[0].spots[0]])
        rotated, rolled = np.split(base_weights - anchor_weights, 2)
        orders = zip(motion, (rotations, first, second), (angles, rates, accelerations), strict=True)
        full = []
        for joints, of_rotations, of_angles in orders:
            base = of_rotations @ rotated + of_angles @ rolled
            coordinates = joints[1:].T @ robot.selection.T
            coordinates[:, 0] = base.real
            coordinates[:, 1] = base.imag
            coordinates[:, 2] = joints[0]
            full.append(coordinates)
        origin = self.anchor_position
        full[0] += [origin.real, origin.imag, 0.0, *robot.reference[BASE:]]
        return full[0], full[1], full[2]

    def _wrench(self, q: Array, v: Array, a: Array) -> Array:
        """Forces (N, nv) on all coordinates that the motion takes, by RNEA, gravity's included."""
        model = self.robot.model
        data = model.createData()
        lifted = a.copy()
        lifted[:, 1] += self.gravity
        return np.array([pin.rnea(model, data, *row) for row in zip(q, v, lifted, strict=True)])

    def _forces(self, times: Array, wrench: Array, levers: dict[str, Array]) -> dict[str, Array]:
        """Forces (N, 2) of all points: the others' by the balance of moments, the anchor's what remains.

        Levers (N, 2) m are the points' velocities where only the base rotates.
        """
        means = [np.mean(contact.values(levers), axis=0) for contact in self.contacts]
        remaining = wrench[:, :2]
        moment = wrench[:, 2] - (means[0] * remaining).sum(axis=1)
        forces: dict[str, Array] = {}
        for contact, lever, ratios in zip(self.contacts[1:], means[1:], self.grid.ratios, strict=True):
            ratio = np.interp(times, self.grid.times, ratios)
            direction = np.stack((ratio, np.ones_like(ratio)), axis=1)
            force = direction * (moment / ((lever - means[0]) * direction).sum(axis=1))[:, None]
            remaining = remaining - force
            forces |= _shared(contact, force)
        return _shared(self.contacts[0], remaining) | forces

    @cached_property
    def points(self) -> dict[str, tuple[int, Array, float]]:
        """Pinocchio's joint, the position (3,) m in it, and the radius, m, of each point that stands."""
        points = {}
        for contact in self.contacts:
            for name, frame, spot in zip(contact.names, contact.frames, contact.spots, strict=True):
                joint, local = point_in_joint(self.robot, frame, spot.place)
                points[name] = (joint, local, spot.radius)
        return points

    def touching(self, positions: Array) -> dict[str, tuple[Array, Array]]:
        """What of each contact is on the ground at positions (N, nv), of a circle its lowest point: by point's name.

        Positions (N, 3) m, and Jacobians (N, 2, nv), horizontal and vertical, by Pinocchio.
        """
        robot = self.robot
        model = robot.model
        data = model.createData()
        up = robot.plane.vertical
        axes = np.stack((robot.plane.horizontal, up))
        points = {name: np.empty((len(positions), 3)) for name in self.points}
        jacobians = {name: np.empty((len(positions), 3, model.nv)) for name in self.points}
        at = pin.SE3.Identity()
        for row, q in enumerate(positions):
            pin.computeJointJacobians(model, data, q)
            for name, (joint, local, radius) in self.points.items():
                placement = data.oMi[joint]
                at.translation = local - radius * (placement.rotation.T @ up)
                jacobian = pin.getFrameJacobian(model, data, joint, at, pin.LOCAL_WORLD_ALIGNED)
                jacobians[name][row] = jacobian[:3]
                points[name][row] = placement.act(at.translation)
        return {name: (points[name], axes @ jacobians[name]) for name in self.points}

    def inverse_dynamics(self, state: JumpState) -> tuple[Array, dict[str, tuple[Array, Array]]]:
        """What the motors and the base take of a state's forces; see :class:`AnyStance`."""
        robot = self.robot
        tree = robot.tree
        y = state.planned(robot)[0]
        angles = tree.absolute_angles(y[0], y[1:].T)
        touching = self.touching(state.positions)
        feet = {}
        for contact in self.contacts:
            for name, spot in zip(contact.names, contact.spots, strict=True):
                points, jacobians = touching[name]
                rolled = tree.turn * spot.radius * angles[:, spot.body]
                positions = np.stack((points @ robot.plane.horizontal + rolled, points @ robot.plane.vertical), axis=1)
                feet[name] = positions, np.abs(np.einsum("nij,nj->ni", jacobians, state.velocities)).max(axis=1)
        return state.torques, feet

    @property
    def ground(self) -> float:
        """Height of the ground on which the anchor stands, m."""
        return self.anchor_position.imag - self.contacts[0].depth

    @cached_property
    def span(self) -> tuple[float, float]:
        """Begin and end, s."""
        return float(self.grid.times[0]), float(self.grid.times[-1])


def moved(stances: Sequence[Stance], shift: complex) -> tuple[Stance, ...]:
    """The same stances elsewhere, by horizontal + i vertical, m."""
    return tuple(replace(stance, anchor_position=stance.anchor_position + shift) for stance in stances)


def point_in_joint(robot: Robot, frame: str, local: complex) -> tuple[int, Array]:
    """Return the joint of ``robot.model`` that carries a frame, and a point's position (3,) m in the joint's axes.

    The point is at ``local`` in the plane of the frame's body, as far out of the plane as the frame's origin.
    """
    model = robot.model
    home = robot.frames[frame]
    link = model.frames[model.getFrameId(home.link, pin.FrameType.BODY)]
    joint = link.parentJoint
    data = model.createData()
    pin.forwardKinematics(model, data, robot.reference.copy())
    in_plane = (local - home.local) * np.exp(1j * robot.tree.turn * robot.tree.offsets[home.body])
    shift = in_plane.real * robot.plane.horizontal + in_plane.imag * robot.plane.vertical
    position = link.placement.translation + data.oMi[joint].rotation.T @ shift
    return joint, np.asarray(position)


def _shared(contact: GroundContact, force: Array) -> dict[str, Array]:
    return dict.fromkeys(contact.names, force / len(contact.names))


def flight_state(plan: Plan, takeoff: float, times: Array) -> JumpState:
    """State of a flight, in a plane or in space, at times (N,) s from the start of its jump; from ``takeoff`` on."""
    flight = plan.full_motion(np.clip(times - takeoff, 0.0, plan.duration)).coordinates
    motion = (flight.positions, flight.velocities, flight.accelerations)
    return JumpState(read_only(times), *motion, {}, flight.torques, {})


def joined(times: Array, robot: Robot, pieces: Sequence[tuple[IntArray, JumpState]], names: Sequence[str]) -> JumpState:
    """Join states of a robot, in a plane or in space: rows of each among times (N,).

    Points that are not in contact have no forces, and no positions: zero, and NaN.
    """
    model = robot.model
    arrays = {name: np.empty((len(times), model.nv)) for name in ("velocities", "accelerations", "torques")}
    arrays["positions"] = np.empty((len(times), model.nq))
    dimension = 3 if robot.base == "free-flyer" else 2
    forces = {name: np.zeros((len(times), dimension)) for name in names}
    points = {name: np.full((len(times), 3), np.nan) for name in names}
    for rows, state in pieces:
        for name, array in arrays.items():
            array[rows] = getattr(state, name)
        for name, force in state.forces.items():
            forces[name][rows] = force
            points[name][rows] = state.points[name]
    coordinates = {name: read_only(array) for name, array in arrays.items()}
    return JumpState(read_only(times), forces=forces, points=points, **coordinates)
