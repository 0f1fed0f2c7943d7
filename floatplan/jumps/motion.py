"""The motion of a jump's stances, from what is saved: place of the base, forces of the contacts, and torques."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, IntArray, read_only
from floatplan.jumps.contacts import Contact
from floatplan.plans.plan import Plan
from floatplan.robot import Robot
from floatplan.robot.standing import Spot, spot_weights

BASE = 3  # coordinates of the base in ``robot.model``: horizontal, vertical, orientation


@dataclass(frozen=True, eq=False)
class Grid:
    """A stance on G instants, quintics between them.

    Attributes
    ----------
    times : (G,) s, from the jump's start
    y, v, a : (n+1, G) orientation and joints with their derivatives
    ratios : (others, G) horizontal over vertical force of the contacts beside the anchor, linear between instants
    """

    times: Array
    y: Array
    v: Array
    a: Array
    ratios: Array

    @cached_property
    def curve(self) -> Any:
        """Piecewise polynomial of y."""
        return hermite(self.times, self.motion)

    @property
    def motion(self) -> Array:
        """y, v, a (3, n+1, G)."""
        return np.stack((self.y, self.v, self.a))

    def at(self, times: Array) -> Array:
        """y, y', y'' (3, n+1, N) at times (N,)."""
        return values(self.curve, times)


def hermite(times: Array, motion: Array) -> Any:
    """Quintics through values, first and second derivatives (3, rows, G)."""
    from scipy.interpolate import BPoly  # here, because reading and exporting plans does without

    return BPoly.from_derivatives(times, np.transpose(motion, (2, 0, 1)))


def values(curve: Any, times: Array) -> Array:
    """A curve and two derivatives (3, rows, N) at times (N,)."""
    return np.stack([(curve.derivative(order) if order else curve)(times).T for order in range(3)])


def quintic(times: Array, span: Array, first: Array, last: Array) -> Array:
    """Values and two derivatives (3, rows, N) of quintics between these (3, rows) at two times ``span`` (2,)."""
    return values(hermite(span, np.stack((first, last), axis=2)), times)


def refined(times: Array, count: int) -> Array:
    """Times (N,) with ``count`` even steps in the place of each of theirs."""
    return np.interp(np.arange(count * (len(times) - 1) + 1) / count, np.arange(len(times)), times)


@dataclass(frozen=True, eq=False)
class JumpState:
    """A robot at N instants of a jump.

    Attributes
    ----------
    times : (N,) s, from the jump's start
    positions, velocities, accelerations : (N, nv) of all coordinates of ``robot.model``
        The base's horizontal, vertical place and orientation, then all joints, m and rad.
    forces : point's name -> (N, 2) N, horizontal and vertical, of the points in contact
    torques : (N, nv) N m, inverse dynamics less the forces; the base's first three are what is out of balance
    points : point's name -> (N, 3) m in the jump's world, where its force acts; NaN where it is not in contact
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
        full = (self.positions - robot.reference, self.velocities, self.accelerations)
        joints = np.linalg.pinv(robot.selection)
        return np.stack([np.vstack((each[:, BASE - 1], joints @ each.T)) for each in full])


@dataclass(frozen=True, eq=False)
class Stance:
    """One stance phase: a grid of orientation and joints, and the point from which the base hangs.

    Attributes
    ----------
    robot : Robot
    gravity : m/s^2
    contacts : the anchor first
    place : of the anchor in the jump's world, m, horizontal + i vertical; one that rolls is there at its body's angle 0
    grid : Grid
    """

    robot: Robot
    gravity: float
    contacts: tuple[Contact, ...]
    place: complex
    grid: Grid

    def at(self, times: Array) -> JumpState:
        """State at times (N,) s from the jump's start."""
        robot = self.robot
        tree = robot.tree
        motion = self.grid.at(times)
        angles = tree.absolute_angles(motion[0][0], motion[0][1:].T)
        rotations = tree.rotations(angles)
        rates, changes = (each[0][:, None] + each[1:].T @ tree.turns.T for each in motion[1:])
        first = 1j * tree.turn * rates * rotations
        second = (1j * tree.turn * changes - rates**2) * rotations
        weights = spot_weights(robot, [Spot(0, 0j), self.contacts[0].spots[0]])
        turned, rolled = np.split(weights[0] - weights[1], 2)
        full = []
        for part, turns, angle in zip(motion, (rotations, first, second), (angles, rates, changes), strict=True):
            base = turns @ turned + angle @ rolled
            values = part[1:].T @ robot.selection.T
            values[:, 0] = base.real
            values[:, 1] = base.imag
            values[:, 2] = part[0]
            full.append(values)
        full[0] += [self.place.real, self.place.imag, 0.0, *robot.reference[BASE:]]
        touching = self.touching(full[0])
        wrench = self._wrench(full)
        forces = self._forces(times, wrench, {name: each[:, :, BASE - 1] for name, (_, each) in touching.items()})
        torques = wrench.copy()
        for name, (_, jacobians) in touching.items():
            torques -= np.einsum("ni,nij->nj", forces[name], jacobians)
        points = {name: places for name, (places, _) in touching.items()}
        q, v, a = map(read_only, full)
        return JumpState(read_only(times), q, v, a, forces, read_only(torques), points)

    def _wrench(self, full: list[Array]) -> Array:
        """Forces (N, nv) on all coordinates that the motion takes, by RNEA, gravity's included."""
        model = self.robot.model
        data = model.createData()
        lifted = full[2].copy()
        lifted[:, 1] += self.gravity
        rows = zip(full[0], full[1], lifted, strict=True)
        return np.array([pin.rnea(model, data, q, v, a) for q, v, a in rows])

    def _forces(self, times: Array, wrench: Array, levers: dict[str, Array]) -> dict[str, Array]:
        """Forces (N, 2) of all points: the others' by the balance of moments, the anchor's what is left.

        Levers (N, 2) m are the points' velocities where the base alone turns.
        """
        means = [np.mean([levers[name] for name in each.names], axis=0) for each in self.contacts]
        left = wrench[:, :2]
        moment = wrench[:, 2] - (means[0] * left).sum(axis=1)
        forces: dict[str, Array] = {}
        for contact, lever, ratios in zip(self.contacts[1:], means[1:], self.grid.ratios, strict=True):
            ratio = np.interp(times, self.grid.times, ratios)
            way = np.stack((ratio, np.ones_like(ratio)), axis=1)
            force = way * (moment / ((lever - means[0]) * way).sum(axis=1))[:, None]
            left = left - force
            forces |= _shared(contact, force)
        return _shared(self.contacts[0], left) | forces

    @cached_property
    def points(self) -> dict[str, tuple[int, Array, float]]:
        """Pinocchio's joint, the place (3,) m in it, and the radius, m, of each point that stands."""
        return {
            name: (*point_in_joint(self.robot, frame, spot.place), spot.radius)
            for contact in self.contacts
            for name, frame, spot in zip(contact.names, contact.frames, contact.spots, strict=True)
        }

    def touching(self, positions: Array) -> dict[str, tuple[Array, Array]]:
        """What of each contact is on the ground at positions (N, nv), of a circle its lowest part: by point's name.

        Places (N, 3) m, and Jacobians (N, 2, nv), horizontal and vertical, by Pinocchio.
        """
        robot = self.robot
        model = robot.model
        data = model.createData()
        axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
        places = {name: np.empty((len(positions), 3)) for name in self.points}
        rows = {name: np.empty((len(positions), 3, model.nv)) for name in self.points}
        at = pin.SE3.Identity()
        _, up = axes
        for row, q in enumerate(positions):
            pin.computeJointJacobians(model, data, q)
            for name, (joint, local, radius) in self.points.items():
                place = data.oMi[joint]
                at.translation = local - radius * (place.rotation.T @ up)
                jacobian = pin.getFrameJacobian(model, data, joint, at, pin.LOCAL_WORLD_ALIGNED)
                rows[name][row] = jacobian[:3]
                places[name][row] = place.act(at.translation)
        return {name: (places[name], axes @ rows[name]) for name in self.points}

    @property
    def ground(self) -> float:
        """Height of the ground on which the anchor stands, m."""
        return self.place.imag - self.contacts[0].depth

    @cached_property
    def span(self) -> tuple[float, float]:
        """Begin and end, s."""
        return float(self.grid.times[0]), float(self.grid.times[-1])


def point_in_joint(robot: Robot, frame: str, local: complex) -> tuple[int, Array]:
    """Return the joint of ``robot.model`` that carries a frame, and a point's place (3,) m in the joint's axes.

    The point is at ``local`` in the plane of the frame's body, as far out of the plane as the frame's origin.
    """
    model = robot.model
    home = robot.frames[frame]
    held = model.frames[model.getFrameId(home.link, pin.FrameType.BODY)]
    joint = held.parentJoint
    data = model.createData()
    zero = robot.reference.copy()
    pin.forwardKinematics(model, data, zero)
    turned = (local - home.local) * np.exp(1j * robot.tree.turn * robot.tree.offsets[home.body])
    shift = turned.real * robot.plane.horizontal + turned.imag * robot.plane.vertical
    own = held.placement.translation + data.oMi[joint].rotation.T @ shift
    return joint, np.asarray(own)


def _shared(contact: Contact, force: Array) -> dict[str, Array]:
    return dict.fromkeys(contact.names, force / len(contact.names))


def flight_state(plan: Plan, takeoff: float, times: Array) -> JumpState:
    """State of a flight at times (N,) s from the jump's start, which takes off at ``takeoff``."""
    flown = plan.full_motion(np.clip(times - takeoff, 0.0, plan.duration)).coordinates
    motion = flown.positions, flown.velocities, flown.accelerations
    return JumpState(read_only(times), *motion, {}, flown.torques, {})


def joined(times: Array, size: int, parts: Sequence[tuple[IntArray, JumpState]], names: Sequence[str]) -> JumpState:
    """Put states of ``size`` coordinates together: rows of each among times (N,), none of no times.

    Points that are not in contact have no forces, and no places: zero, and NaN.
    """
    arrays = {name: np.empty((len(times), size)) for name in ("positions", "velocities", "accelerations", "torques")}
    forces = {name: np.zeros((len(times), 2)) for name in names}
    points = {name: np.full((len(times), 3), np.nan) for name in names}
    for rows, state in parts:
        for name, values in arrays.items():
            values[rows] = getattr(state, name)
        for name, force in state.forces.items():
            forces[name][rows] = force
            points[name][rows] = state.points[name]
    told = {name: read_only(values) for name, values in arrays.items()}
    return JumpState(read_only(times), forces=forces, points=points, **told)
