"""The seam between how a robot turns in flight and who plans it: what search and constraints see of the base's motion.

A flight turns in e tangent directions: one in a plane, three in space. The angular momentum h (e,) about the centre of
mass is constant, and the attitude follows from h and the joints' motion: by a quadrature in a plane, by a differential
equation in space. A small turn zeta (e,) of the base, in the world's axes, obeys

    zeta' = M [h]x zeta + g,    zeta(0) = 0,

with the drift g linear in the changes of joint positions, joint velocities and h. In a plane M [h]x zeta vanishes.

A motion is looked at in K instants, the first N of which are the grid's nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from floatplan.arguments import Outlined
from floatplan.arrays import Array, read_only
from floatplan.motion.sine_polynomial import JointMotion
from floatplan.problem.parts import Obstacle

RatesAtEnds: TypeAlias = Callable[[Array], Array]  # the joints' rates (2, n), rad/s, at takeoff and landing for h (e,)


class Partials(NamedTuple):
    """Derivatives of r quantities at K instants by the robot's state there.

    ``by_position, by_velocity, by_acceleration`` (K, r, n); ``by_attitude, by_momentum`` (K, r, e), by zeta and by h.
    None is zero.
    """

    by_position: Array | None = None
    by_velocity: Array | None = None
    by_acceleration: Array | None = None
    by_attitude: Array | None = None
    by_momentum: Array | None = None


@dataclass(frozen=True, eq=False)
class MomentumSet:
    """The angular momenta that a search may choose: ``h = centre + axes @ y``, with the H numbers y about -1 to 1.

    ``centre`` (e,), ``axes`` (e, H), kg m^2/s; H = 0 where h is given.
    """

    centre: Array
    axes: Array

    @cached_property
    def free(self) -> int:
        """Number H."""
        return int(self.axes.shape[1])


class FlightGrid(Hashable, Protocol):
    """Instants of a flight: N nodes, which the attitude is integrated on, then any others; hashed as an object."""

    @property
    def s(self) -> Array:
        """All instants (K,), fractions of the flight."""

    @property
    def nodes(self) -> int:
        """Number N of nodes."""

    @property
    def weights(self) -> Array:
        """Quadrature weights (N,) of the nodes, for integrals over [0, 1]."""

    def also(self, instants: Array) -> FlightGrid:
        """Return the same grid with more instants of [0, 1]."""


class BaseMotion(Protocol):
    """The base's motion; everything is computed when asked for."""

    @property
    def rate(self) -> Array:
        """Angular velocity (K, e) of the base, rad/s."""

    @property
    def attitude(self) -> Array:
        """Attitudes (K, ...), in a form of the module's own: angles, rad, in a plane."""

    @property
    def residual(self) -> Array:
        """By how much the attitude at landing misses the goal (e,), rad."""

    @property
    def missed(self) -> float:
        """The largest of them, rad; infinite where whole turns are not those asked for."""

    @property
    def wrong_way(self) -> str:
        """What is wrong with the way from takeoff to landing for a person; empty for nothing."""

    @property
    def unresolved(self) -> float:
        """What the nodes may miss of the motion, relative to its size."""

    def level_needed(self, error: float) -> int:
        """Level of grids that integrates the attitude at landing to an error, rad; the finest where none does."""

    @property
    def torques(self) -> Array:
        """Generalised joint torques (K, n) N m: of a leader and its followers together."""

    @property
    def motor_torques(self) -> Array:
        """Each motor's own torque (K, m) N m."""

    def obstacle_distances(self, obstacle: Obstacle) -> Array:
        """Distances (K, r) of the links to an obstacle, r as of :meth:`FlightDynamics.links_measured`.

        In m, between surfaces; negative where the surfaces overlap.
        """

    def pair_distances(self, first: tuple[int, ...], second: tuple[int, ...]) -> Array:
        """Distances (K, r) between shapes, given by their indices: each of the first to each of the second."""

    def at_goal(self) -> BaseMotion:
        """Return the same motion, with the attitudes asked for at s = 0 and s = 1 in the place of its own."""


class DifferentiableMotion(BaseMotion, Protocol):
    """One with its derivatives: what the general path asks, which the kernel has not.

    Derivatives by shapes are by the turns of the bodies, or by 3 numbers for each of them in space.
    """

    @property
    def rate_partials(self) -> Partials:
        """Of the angular velocity, r = e."""

    @property
    def drift(self) -> Partials:
        """Of g at the nodes, K = N, r = e: by positions, velocities and h."""

    def transport(self, drift: Array) -> Array:
        """Small turns zeta (K, e, c) that c drifts (N, e, c) at the nodes make."""

    @property
    def residual_partials(self) -> Partials:
        """Of the residual, by the same: its change is ``duration * sum_j weights[j]`` of theirs, as g is carried on."""

    @property
    def torque_partials(self) -> Partials:
        """Of the generalised torques, r = n."""

    @property
    def motor_torque_partials(self) -> Partials:
        """Of the motors' own torques, r = m."""

    def obstacle_partials(self, obstacle: Obstacle) -> Partials:
        """Of the distances to an obstacle."""

    def pair_partials(self, first: tuple[int, ...], second: tuple[int, ...]) -> Partials:
        """Of the distances between shapes."""


class FlightDynamics(Hashable, Protocol):
    """What a problem fixes of every motion: dynamics, shapes, attitudes, the CM's path; hashed as an object."""

    @property
    def tangent(self) -> int:
        """Number e of directions in which the base can turn."""

    @property
    def bodies(self) -> int:
        """Number of bodies, by which the work of an evaluation is counted."""

    @property
    def links(self) -> tuple[str, ...]:
        """Link of each shape."""

    def links_measured(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Link (r,) of each distance to an obstacle."""

    @property
    def node_counts(self) -> tuple[int, ...]:
        """Number of nodes of the grids, by their level, rising."""

    def grid(self, level: int) -> FlightGrid:
        """Return a grid of nodes alone, the same object for the same level."""

    def fly(self, grid: FlightGrid, joints: JointMotion, angular_momentum: Array) -> BaseMotion:
        """Turn the base as joints and angular momentum (e,), kg m^2/s, make it.

        ``joints`` are at the instants of ``grid``, which comes from :meth:`grid`.
        """


@dataclass(frozen=True, eq=False, repr=False)
class FlightState(Outlined):
    """The robot at instants of its flight: a number, or an array of any shape, which is the ``...`` of all others.

    In space the orientation is a quaternion (..., 4) x, y, z, w, its rate (..., 3) is in the base's axes, and places,
    velocities and the angular momentum are (..., 3), in the world's.

    Attributes
    ----------
    times : (...) s
    orientation, orientation_rate : (...) rad, rad/s
    positions, velocities, accelerations, torques : (..., n) rad, rad/s, rad/s^2, N m
        Torques are generalised: a leader's is the sum over its group, by ratio.
    motor_torques : (..., m) N m
        Each motor's own, in the order of ``robot.motors``.
    com_position, com_velocity : (..., 2) m, m/s; horizontal, vertical
    base_position : (..., 2) m
        Origin of the base link.
    angular_momentum : (...) kg m^2/s
        Computed from the state, not assumed.
    """

    times: Array
    orientation: Array
    orientation_rate: Array
    positions: Array
    velocities: Array
    accelerations: Array
    torques: Array
    motor_torques: Array
    com_position: Array
    com_velocity: Array
    base_position: Array
    angular_momentum: Array

    def shaped(self, shape: tuple[int, ...]) -> FlightState:
        """Return the same with as many instants in another shape."""
        if shape == self.times.shape:
            return self
        arrays = {name: values.reshape(shape + values.shape[1:])[()] for name, values in vars(self).items()}
        return FlightState(**arrays)

    def interleaved(self, between: FlightState) -> FlightState:
        """Return the same N instants, one dimension, with N - 1 others between them."""
        arrays = {name: np.empty((2 * len(values) - 1, *values.shape[1:])) for name, values in vars(self).items()}
        for name, values in arrays.items():
            values[::2], values[1::2] = getattr(self, name), getattr(between, name)
        return FlightState(**{name: read_only(values) for name, values in arrays.items()})


class WholeMotion(Protocol):
    """The whole robot in a flight, at any instant, of joints that move as a plan has written."""

    @property
    def dynamics(self) -> Any:
        """The robot's rigid-body dynamics, by Pinocchio."""

    @property
    def missed(self) -> float:
        """By how much the attitude at landing misses the goal, rad."""

    @property
    def orientation_at_ends(self) -> Mapping[str, Any]:
        """What plan files say of the orientation: at the start, at the end and of the goal."""

    def state(self, instants: Array) -> FlightState:
        """State at times (N,) s within the flight."""

    def full_motion(self, state: FlightState) -> Any:
        """Motion of every joint of the robot's file, and of the base in space, at the N instants of a state."""

    def forces(self, state: FlightState) -> Array:
        """Forces (N, nv), N m, on all coordinates of the model at the N instants of a state."""

    def heights(self, instants: Array) -> tuple[Array, tuple[str, ...]]:
        """Heights (N, S), m, of shapes over the ground's line at times (N,) s, and whose they are: links (S)."""


@dataclass(frozen=True, eq=False, repr=False)
class Peaks(Outlined):
    """Extremes over the flight, and the instants, s, of those that belong to one.

    Attributes
    ----------
    joints, joint_instants : key of a limit of the joints' motion -> (n,), in the unit of its row
        Largest magnitudes of what :data:`floatplan.tables.JOINT_LIMITS` limit.
    torque : (n,) N m; largest magnitudes of the generalised torques
    clearance : m; None without obstacles
    motor_torque : (m,) N m, of the motors' own torques
    position : (n, 2) rad, lowest and highest
    motor_torque_instant : (m,)
    """

    joints: Mapping[str, Array]
    joint_instants: Mapping[str, Array]
    torque: Array
    clearance: float | None
    motor_torque: Array
    position: Array
    motor_torque_instant: Array

    @property
    def velocity(self) -> Array:
        """Largest magnitudes (n,) of the joints' rates, rad/s."""
        return self.joints["velocity"]

    @property
    def velocity_instant(self) -> Array:
        """When they are reached (n,), s."""
        return self.joint_instants["velocity"]
