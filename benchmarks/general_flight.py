"""Flights in a plane with derivatives in NumPy, by any dynamics that have them.

The reference that tests hold the kernel to, and how other people's dynamics stand behind floatplan's program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from sampled_flight import Partials, PlanarBaseMotion

import floatplan as fp
from floatplan.arrays import Array, ComplexArray
from floatplan.motion.planar.clearance import _cross
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.flight import PlanarFlight, planar_flight
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle


@dataclass(frozen=True, eq=False)
class BaseRate:
    """theta0' of (4) at N instants, and its derivatives by joint positions and velocities and by h.

    ``rate`` (N,) rad/s; ``by_position`` (N, n) 1/s; ``by_velocity`` (N, n); ``by_momentum`` (N,) 1/(kg m^2): the
    paper's g_0, and ``by_velocity`` its g_i, in the corrected form of (15).
    """

    rate: Array
    by_velocity: Array
    by_momentum: Array
    differentiate: Callable[[], Array]

    @cached_property
    def by_position(self) -> Array:
        """Derivatives (N, n) by joint positions, 1/s."""
        return self.differentiate()


class GeneralDynamics(Dynamics):
    """A tree's dynamics with derivatives."""

    def base_rate_derivatives(self, positions: Array, velocities: Array, angular_momentum: float | Array) -> BaseRate:
        """theta0' and its derivatives.

        With h held, ``d theta0' = -(dh/dq) / D_0``: dh/dq at the full velocity, which contains theta0'.
        """
        distinct, turn = self._distinct, self._turn
        rotations = self._tree.rotations(positions @ distinct.turns.T)
        gathered = (rotations.conj() @ distinct.coupling) * rotations
        rows = gathered.real @ distinct.rates
        rate = (angular_momentum - (rows[:, 1:] * velocities).sum(axis=1)) / rows[:, 0]

        def by_position() -> Array:
            rates = velocities @ distinct.turns.T + rate[:, None]
            moving = rotations.conj() * ((rotations * rates) @ distinct.coupling.T)
            momentum_by_position = (moving.imag - rates * gathered.imag) @ (turn * distinct.turns)
            return np.asarray(-momentum_by_position / rows[:, :1])

        return BaseRate(rate, -rows[:, 1:] / rows[:, :1], 1 / rows[:, 0], by_position)

    def moment_derivatives(
        self, positions: Array, velocities: Array, accelerations: Array, base_rate: BaseRate
    ) -> Array:
        """Derivatives (N, m, 3n+1) of the moments F by the n positions, velocities and accelerations, and by h."""
        tree, turn, inertia, n = self._tree, self._turn, self._inertia, positions.shape[1]
        rotations = tree.rotations(positions @ tree.turns.T + tree.offsets)
        coupled = rotations.conj()[:, :, None] * tree.coupling * rotations[:, None, :]
        by_acceleration = coupled.real + np.diag(inertia)
        locked_inertia = by_acceleration.sum(axis=(1, 2))
        rates = velocities @ tree.turns.T + base_rate.rate[:, None]
        relative = accelerations @ tree.turns.T
        centrifugal = (coupled.imag * (turn * rates**2)[:, None, :]).sum(axis=2)
        pull = (by_acceleration @ relative[:, :, None])[:, :, 0] - centrifugal
        turned = relative - (pull.sum(axis=1) / locked_inertia)[:, None]
        by_rate = (-2 * turn) * coupled.imag * rates[:, None, :]
        by_angle = -turn * coupled.imag * turned[:, None, :] - coupled.real * rates[:, None, :] ** 2
        gathered = coupled @ (turned + 1j * turn * rates**2)[:, :, None]
        diagonal = np.arange(len(inertia))
        by_angle[:, diagonal, diagonal] += turn * gathered[:, :, 0].imag
        by_base_rate = by_rate.sum(axis=2)
        parts = (
            by_angle @ tree.turns + by_base_rate[:, :, None] * base_rate.by_position[:, None, :],
            by_rate @ tree.turns + by_base_rate[:, :, None] * base_rate.by_velocity[:, None, :],
            by_acceleration @ tree.turns,
            (by_base_rate * base_rate.by_momentum[:, None])[:, :, None],
        )
        direct = np.concatenate(parts, axis=2)
        assert direct.shape[2] == 3 * n + 1
        base_response = direct.sum(axis=1) / locked_inertia[:, None]
        direct -= by_acceleration.sum(axis=2)[:, :, None] * base_response[:, None, :]
        if tree.rotors is not None:
            direct[:, :, 2 * n : 3 * n] += tree.rotors
        return direct


class Nearest(NamedTuple):
    """Distances (K, r), unit vectors out of the other thing (K, r), and shares along both where they are nearest."""

    distance: Array
    direction: ComplexArray
    share: Array
    other_share: Array


class GeneralMotion(PlanarBaseMotion):
    """The base's motion in the plane, with derivatives."""

    @cached_property
    def base_rates(self) -> BaseRate:
        """theta0' with its derivatives."""
        equations: Any = self.flight.equations
        joints, momentum = self.joints, float(self.angular_momentum[0])
        found: BaseRate = equations.base_rate_derivatives(joints.positions, joints.velocities, momentum)
        return found

    @cached_property
    def base_rate(self) -> Array:
        """theta0' (K,) rad/s, the one that is differentiated."""
        return self.base_rates.rate

    def transport(self, drift: Array) -> Array:
        """Integrals (K, 1, c) of drifts (N, 1, c)."""
        return np.asarray(self.flight.duration * (self.grid.integrals @ drift[:, 0, :]))[:, None, :]

    @property
    def rate_partials(self) -> Partials:
        """Of theta0'."""
        return self._rate_partials(len(self.grid.s))

    def _rate_partials(self, instants: int) -> Partials:
        rate = self.base_rates
        return Partials(
            by_position=rate.by_position[:instants, None, :],
            by_velocity=rate.by_velocity[:instants, None, :],
            by_momentum=rate.by_momentum[:instants, None, None],
        )

    @property
    def drift(self) -> Partials:
        """Of theta0' at the nodes."""
        return self._rate_partials(self.grid.nodes)

    @property
    def residual_partials(self) -> Partials:
        """The drift's own: a turn in the plane stays what it is."""
        return self.drift

    @property
    def torque_partials(self) -> Partials:
        """Of the generalised torques."""
        return self._gathered(self.flight.tree.turns)

    @property
    def motor_torque_partials(self) -> Partials:
        """Of the motors' own torques."""
        return self._gathered(self.flight.tree.motor_turns)

    def _gathered(self, turns: Array) -> Partials:
        """Of the torques on coordinates that turn the bodies by ``turns`` (m, r)."""
        equations: Any = self.flight.equations
        joints, n = self.joints, self.joints.positions.shape[1]
        by_state = equations.moment_derivatives(
            joints.positions, joints.velocities, joints.accelerations, self.base_rates
        )
        by_position, by_velocity, by_acceleration, by_momentum = np.split(turns.T @ by_state, [n, 2 * n, 3 * n], axis=2)
        return Partials(by_position, by_velocity, by_acceleration, by_momentum=by_momentum)

    def obstacle_partials(self, obstacle: Obstacle) -> Partials:
        """Of the distances to an obstacle."""
        facing = np.array(self.flight.link_shapes.facing(obstacle))
        parts = [self._of_piece(facing, piece, complex(*obstacle.velocity) * self._times) for piece in obstacle.pieces]
        return self._by_joints(np.concatenate(parts, axis=1))

    def _of_piece(self, facing: np.ndarray, piece: Obstacle, shift: Any) -> Array:
        """Derivatives (K, r, m) by the bodies' angles."""
        shapes = self.shapes
        start, end = shapes.start[:, facing], shapes.end[:, facing]
        if isinstance(piece, HalfPlane):
            normal = np.full(start.shape, complex(*piece.normal) / abs(complex(*piece.normal)))
            ends = (self._gradient(facing, normal, np.full(start.shape, share)) for share in (0.0, 1.0))
            return np.concatenate(list(ends), axis=1)
        assert isinstance(piece, Circle | Bar), "the pieces that there are"
        places = (piece.center, piece.center) if isinstance(piece, Circle) else (piece.start, piece.end)
        first, last = (np.broadcast_to((complex(*place) + shift)[:, None], start.shape) for place in places)
        nearest = between(start, end, first, last)
        return self._gradient(facing, nearest.direction, nearest.share)

    def pair_partials(self, first: tuple[int, ...], second: tuple[int, ...]) -> Partials:
        """Of the distances between capsules."""
        own, other = (each.ravel() for each in np.meshgrid(first, second, indexing="ij"))
        start, end = self.shapes.start, self.shapes.end
        nearest = between(start[:, own], end[:, own], start[:, other], end[:, other])
        return self._by_joints(
            self._gradient(own, nearest.direction, nearest.share)
            - self._gradient(other, nearest.direction, nearest.other_share)
        )

    def _gradient(self, capsules: np.ndarray, direction: ComplexArray, share: Array) -> Array:
        """Derivatives (K, S, m) by the bodies' angles of points a share along capsules, along unit vectors (K, S)."""
        tree, (starts, ends) = self.flight.tree, self.flight.link_shapes.weights
        weights = (1 - share)[..., None] * starts[capsules] + share[..., None] * ends[capsules]
        swing = (1j * tree.turn) * tree.rotations(self.angles)[:, None, :] * weights
        return np.asarray((direction.conj()[..., None] * swing).real)

    def _by_joints(self, by_body: Array) -> Partials:
        """Of quantities with derivatives ``by_body`` (K, r, m) by the bodies' absolute angles."""
        return Partials(by_position=by_body @ self.flight.tree.turns, by_attitude=by_body.sum(axis=2)[..., None])


def point_to_segment(point: ComplexArray, start: ComplexArray, end: ComplexArray) -> tuple[Array, ComplexArray, Array]:
    """Distance, unit vector out of the point, and the share along the segment."""
    along = end - start
    length2 = np.maximum((along * along.conj()).real, 1e-300)
    share = np.clip((along.conj() * (point - start)).real / length2, 0, 1)
    offset = start + share * along - point
    distance = np.abs(offset)
    touching = distance < 1e-12
    sideways = 1j * along / np.sqrt(length2)
    outwards = np.where(np.abs(sideways) > 0.5, sideways, 1j)
    direction = np.where(touching, outwards, offset / np.where(touching, 1.0, distance))
    return np.asarray(distance), np.asarray(direction, dtype=np.complex128), np.asarray(share)


def between(start: ComplexArray, end: ComplexArray, other_start: ComplexArray, other_end: ComplexArray) -> Nearest:
    """Return how near segments (K, r) are to one another: where they cross, minus the shortest way out by an end."""
    candidates = [
        Nearest(distance, -direction, np.full(start.shape, own), share)
        for own, point in enumerate((start, end))
        for distance, direction, share in [point_to_segment(point, other_start, other_end)]
    ]
    candidates += [
        Nearest(distance, direction, share, np.full(start.shape, other))
        for other, point in enumerate((other_start, other_end))
        for distance, direction, share in [point_to_segment(point, start, end)]
    ]
    nearest = np.argmin([each.distance for each in candidates], axis=0)[None]
    found = [np.take_along_axis(np.stack(parts), nearest, axis=0)[0] for parts in zip(*candidates, strict=True)]
    sign = np.where(_cross(start, end, other_start, other_end), -1.0, 1.0)
    return Nearest(sign * found[0], sign * found[1], found[2], found[3])


class GeneralFlight:
    """A flight in the plane whose motions have derivatives."""

    def __init__(self, flight: PlanarFlight, equations: Dynamics | None = None) -> None:
        self._flight = replace(flight, other_equations=equations or GeneralDynamics(flight.tree))

    def __getattr__(self, name: str) -> Any:
        """Whatever a flight in the plane has."""
        return getattr(self._flight, name)

    def fly(self, grid: Any, joints: Any, angular_momentum: Array) -> GeneralMotion:
        """Turn the base as joints and angular momentum (1,), kg m^2/s, make it."""
        return GeneralMotion(self._flight, grid, joints, angular_momentum)


def general_flight(problem: fp.Problem, equations: Dynamics | None = None) -> Any:
    """Return a problem's flight, with dynamics that have derivatives."""
    return GeneralFlight(planar_flight(problem), equations)
