"""What corrections of a flight in space are made of, see :class:`InSpace`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.inflight.estimate import Identification
from floatplan.inflight.orientation import SpatialOrientations, quaternion_of, rotation_vector
from floatplan.inflight.remaining_motion import RemainingMotion
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.spatial.attitude import LEVELS, Cells, Turning, cells, turn
from floatplan.motion.spatial.dynamics import SpatialDynamics
from floatplan.motion.spatial.flight import SpatialFlight, spatial_flight
from floatplan.planning.kernel_input.rows import Block
from floatplan.planning.kernel_input.space import SpatialRows, spatial_body, struct_of_cells
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Stages of the cells in which the base's turning is integrated, then other instants, as shares of the time."""

    cells: Cells
    s: Array

    @property
    def nodes(self) -> int:
        """Number of stages."""
        return len(self.cells.s)

    @property
    def weights(self) -> None:
        """None: each cell has its own."""
        return

    def also(self, instants: Array) -> CellGrid:
        """Return the grid with more instants."""
        return CellGrid(self.cells, np.concatenate((self.s, instants)))


class InSpace:
    """A plan's flight in space; members as of :class:`~floatplan.inflight.planar.InPlane`.

    ``direction`` (3,) is that of the plan's angular momentum, zero where it has none.
    """

    orientations = SpatialOrientations()

    def __init__(self, plan: Plan, obstacles: Sequence[Obstacle]) -> None:
        problem = plan.problem
        self.plan = plan
        self.flight: SpatialFlight = spatial_flight(problem)
        needs_shapes = bool(obstacles or problem.self_clearances)
        self.links: tuple[str, ...] = self.flight.links if needs_shapes else ()
        of_plan = _cells_of(plan, self.flight)
        # Cells that are as long as those of the whole flight resolve what remains of it.
        grids = []
        for share in (1.0, 0.75, 0.5, 0.25):
            fewer = cells(round(share * of_plan.count), of_plan.stages)
            grids.append((share, CellGrid(fewer, fewer.s)))
        self.grids = tuple(grids)
        # In addition to the stages, which are many: takeoff and landing among them, and more where there are obstacles.
        self.instants = 40 if obstacles else 8
        size = float(np.linalg.norm(plan.angular_momentum))
        self.direction = np.asarray(plan.angular_momentum) / size if size else np.zeros(3)

    def identification(self, angular_momentum: Array) -> Identification:
        """Return the filter's state at takeoff, with an angular momentum (3,), kg m^2/s."""
        inertia, _ = self.flight.dynamics.momentum_maps(self.plan.problem.initial.positions[None, :])
        largest = float(np.linalg.eigvalsh(inertia[0])[-1])
        bodies = len(self.flight.dynamics.selection) + 1
        return Identification(bodies, np.array(self.flight.initial_attitude), np.asarray(angular_momentum), largest)

    def base_rate(self, positions: Array, velocities: Array) -> Array:
        """Return the base's rates (3,) at takeoff, rad/s, in its axes."""
        momentum = np.asarray(self.plan.angular_momentum)
        return _rate(self.flight.dynamics, self.flight.initial_attitude, positions, velocities, momentum)

    def rows(self, blocks: Sequence[Block]) -> SpatialRows:
        """Return the rows of the problem's limits."""
        return SpatialRows(self.flight, blocks)

    def kernel_input(self, rows: SpatialRows, gap_nodes: int) -> SpatialKernelInput:
        """Return what the kernel computes with: the robot of the masses that are estimated."""
        return SpatialKernelInput(self.flight, rows, self.grids[0][1].cells, gap_nodes)

    def integrals(self, grid: CellGrid) -> Array | None:
        """None: the cells have them."""
        return None

    def ideal_robot(self, angular_momentum: Array, errors: Array) -> IdealRobot:
        """Return a robot that has an angular momentum (3,) and relative errors (2m,) of masses and inertias."""
        return IdealRobot(self.flight, angular_momentum, errors)


class SpatialKernelInput:
    """The kernel's functions and what they read; members as of ``floatplan.inflight.planar.PlanarKernelInput``."""

    room = "flight_room_in_space"
    step = "flight_in_space"

    def __init__(self, flight: SpatialFlight, rows: SpatialRows, of_flight: Cells, gap_nodes: int) -> None:
        self.path = rows.path
        selection = flight.dynamics.selection
        links = len(selection) + 1
        no_axes = MomentumSet(np.zeros(3), np.empty((3, 0)))
        self.robot = spatial_body(flight, no_axes, rows.needs_rates)
        # After a step of Newton's method of 1e-7 |h|, the next would be rounding: each squares what is left.
        self.robot.pointer.settled = 1e-7
        only_in_plane = (
            *("mass", "inertia", "link_real", "link_imaginary", "real", "imaginary", "map"),
            *("by_mass_real", "by_mass_imaginary", "weights_real", "weights_imaginary"),
            *("nominal_real", "nominal_imaginary"),
        )
        self.members: dict[str, Any] = {
            "cells": struct_of_cells(of_flight),
            "gap_cells": struct_of_cells(cells(1, gap_nodes)),
            "turns": np.concatenate((selection, flight.transmission), axis=1),
            "body_mass": np.zeros(links),
            "body_first": np.zeros((links, 3)),
            "body_second": np.zeros((links, 3, 3)),
            "measured_orientation": np.zeros((3, 3)),
            "turn_before": np.eye(3),
            "turn_after": np.eye(3),
            **dict.fromkeys(only_in_plane),
        }

    def path_begin(self, now: float) -> float:
        """Return the time, s, at which the path of the centre of mass begins for the kernel: takeoff."""
        return 0.0

    def integrate_at(self, flight: Any, grid: CellGrid) -> None:
        """Let the base's turning be integrated in the cells of a grid, which are all alike."""
        flight.cells.cells = grid.cells.count

    def begin(self) -> None:
        """Begin another flight."""
        self.members["turn_after"][:] = np.eye(3)

    @property
    def turned(self) -> Array:
        """Rotation (3, 3) of the base from the last measurement that was learnt from until now."""
        return np.array(self.members["turn_after"])

    def expected_orientation(self, estimated: Array) -> Array:
        """Return the attitude (3, 3) where something is measured, from that at the last measurement."""
        return np.asarray(self.members["turn_before"] @ estimated)

    def measure(self, orientation: Array) -> None:
        """Write a measured attitude (3, 3)."""
        self.members["measured_orientation"][:] = orientation

    def miss(self, corrected: Any) -> Array:
        """Return what the kernel says of a landing: the vector (3,) of the rotation that it misses by, rad."""
        return np.array([*corrected.miss])


class IdealRobot:
    """A robot in flight whose joints follow their reference exactly: its base rotates by (S1).

    It has an angular momentum (3,), kg m^2/s, and relative errors (2m,) of the masses and inertias of its bodies.
    """

    def __init__(self, flight: SpatialFlight, angular_momentum: Array, errors: Array) -> None:
        self.orientation = np.array(flight.initial_attitude)
        self.time = 0.0
        self._momentum = angular_momentum
        self._goal = flight.final_attitude
        self._dynamics = _with_errors(flight.dynamics, errors)

    @property
    def measured_orientation(self) -> list[float]:
        """As :meth:`floatplan.inflight.replanner.Replanner.update` is given it."""
        return quaternion_of(self.orientation)

    @property
    def miss(self) -> float:
        """Angle of the attitude from the goal, rad."""
        return float(np.linalg.norm(rotation_vector(self._goal.T @ self.orientation)))

    def rate(self, positions: Array, velocities: Array) -> Array:
        """Return the base's rates (3,), rad/s, in its axes, at joints' positions and velocities (1, n)."""
        return _rate(self._dynamics, self.orientation, positions, velocities, self._momentum)

    def fly(self, motion: RemainingMotion, until: float) -> None:
        """Turn the base until a time, s."""
        step = cells(1, 6)
        positions, velocities, _ = motion.at(self.time + (until - self.time) * step.s)
        turning = _turning(
            self._dynamics, step, until - self.time, positions, velocities, self._momentum, self.orientation
        )
        self.orientation = turning.ends[-1]
        self.time = until

    def write(self, inertial: Identification) -> None:
        """Write the attitude into an estimate's."""
        assert inertial.attitude is not None, "in space there is one"
        inertial.attitude[:] = self.orientation


def _cells_of(plan: Plan, flight: SpatialFlight) -> Cells:
    """Return the fewest cells that resolve the plan's attitude at landing."""
    before = None
    of_level = cells(*LEVELS[0])
    for level in LEVELS:
        coarser = of_level
        of_level = cells(*level)
        positions, velocities, _ = plan.joint_motion(of_level.s * plan.duration)
        momentum = np.asarray(plan.angular_momentum)
        start = np.array(flight.initial_attitude)
        landing = _turning(flight.dynamics, of_level, plan.duration, positions, velocities, momentum, start).ends[-1]
        # By these cells the plan's attitude at landing is right to 1e-8 rad; motions of corrections are as wild.
        if before is not None and np.linalg.norm(rotation_vector(landing @ before.T)) < 1e-8:
            return coarser
        before = landing
    return of_level


def _turning(
    dynamics: SpatialDynamics,
    of: Cells,
    duration: float,
    positions: Array,
    velocities: Array,
    angular_momentum: Array,
    start: Array,
) -> Turning:
    """Return how the base turns for a duration, s, with joints (K, n) at the stages of the cells."""
    inertia, joint_map = dynamics.momentum_maps(positions)
    relative = np.einsum("kan,kn->ka", joint_map, velocities)
    return turn(of, duration, inertia, relative, angular_momentum, start)


def _rate(
    dynamics: SpatialDynamics, attitude: Array, positions: Array, velocities: Array, angular_momentum: Array
) -> Array:
    """Return the base's rates (3,) by (S1), rad/s, from joints (1, n)."""
    inertia, joint_map = dynamics.momentum_maps(positions)
    return np.linalg.solve(inertia[0], attitude.T @ angular_momentum - joint_map[0] @ velocities[0])


def _with_errors(dynamics: SpatialDynamics, errors: Array) -> SpatialDynamics:
    """Return dynamics with relative errors (2m,) of the masses and inertias of the bodies."""
    masses, inertias = np.split(1.0 + errors, 2)
    model = dynamics.model.copy()
    for body, (mass, inertia) in enumerate(zip(masses.tolist(), inertias.tolist(), strict=True), start=1):
        own = model.inertias[body]
        model.inertias[body] = pin.Inertia(mass * own.mass, own.lever, inertia * own.inertia)
    return SpatialDynamics(model, dynamics.reference, dynamics.selection)
