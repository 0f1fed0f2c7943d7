"""The seam between how a robot turns in flight and who plans it: what the search sees of the base's motion.

A flight turns in e tangent directions: one in a plane, three in space. The angular momentum h (e,) about the centre of
mass is constant, and the attitude follows from h and the joints' motion: by a quadrature in a plane, by a differential
equation in space. The kernel evaluates both, ``planar_flight.hpp`` and ``spatial_flight.hpp``, with their derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np

from floatplan.arguments import Outlined
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.motion.sine_polynomial import WrittenMotion
from floatplan.problem.ballistics import Ballistics
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem

RatesAtEnds: TypeAlias = Callable[[Array], Array]  # the joints' rates (2, n), rad/s, at takeoff and landing for h (e,)


@dataclass(frozen=True, eq=False)
class MomentumSet:
    """The angular momenta that a search may choose: ``h = centre + axes @ y``, with the H numbers y about -1 to 1.

    ``centre`` (e,), ``axes`` (e, H), kg m^2/s; H = 0 where h is given: then ``axes.size`` is 0.
    """

    centre: Array
    axes: Array


class FlightDynamics(Hashable, Protocol):
    """What a problem fixes of every motion, and what is known of it without a search; hashed as an object."""

    @property
    def problem(self) -> Problem:
        """Whose flight it is."""

    @property
    def tangent(self) -> int:
        """Number e of directions in which the base can turn."""

    @property
    def bodies(self) -> int:
        """Number of bodies, by which the work of an evaluation is counted."""

    @property
    def node_counts(self) -> tuple[int, ...]:
        """Number of nodes of the grids, by their level, rising."""

    @property
    def ballistics(self) -> Ballistics:
        """Path of the centre of mass."""

    @property
    def central_reach(self) -> float:
        """How far the point of the robot that stays nearest to the centre of mass is from it, m; else infinite."""

    @property
    def momentum_set(self) -> MomentumSet:
        """The angular momenta that the problem leaves to choose."""

    def end_rates(self, momentum: MomentumSet) -> RatesAtEnds:
        """The joints' rates at both ends: as given, or those with which a frame is at rest.

        Raises
        ------
        InputError
            No rates bring the frame to rest.
        """

    def motion_into_ground(self, angular_momentum: Array) -> Sequence[InputError]:
        """What on the ground moves down at takeoff, or up at landing, for h (e,) kg m^2/s, as far as that is known."""

    def difficulties(self) -> list[str]:
        """Return sentences about what makes the problem hard, as far as it is known."""

    def impossibilities(self, path_is_clear: bool = False) -> list[str]:
        """Return sentences about why no motion whatever meets the problem, as far as that is known.

        It may be known already that the centre of mass is never too deep in an obstacle.
        """

    def whole_motion(self, joints: WrittenMotion, angular_momentum: Any, path: Ballistics) -> WholeMotion:
        """The whole robot's motion, of joints that move as written, with a path of its centre of mass."""

    @property
    def links(self) -> tuple[str, ...]:
        """Link of each shape."""

    def links_measured(self, obstacle: Obstacle) -> tuple[str, ...]:
        """Link (r,) of each distance to an obstacle."""


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


class PlacedShapes(Protocol):
    """The links' capsules at K instants."""

    def distances(self, obstacle: Obstacle, times: Array) -> Array:
        """Distances (K, r), m, to an obstacle at times (K,), s."""


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

    def orientation(self, times: Array) -> Array:
        """Orientation (N,) rad at times (N,); refused in space."""

    @property
    def final_orientation(self) -> float:
        """Orientation at the end of the flight, rad; refused in space."""

    def segments(self, instants: Array, hulls: bool = False) -> PlacedShapes:
        """The links' capsules at times (N,) s; with ``hulls`` what distances to the ground are measured by."""

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
