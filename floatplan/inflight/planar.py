"""What corrections of a flight in its plane are made of, see :class:`InPlane`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight.estimate import Identification, adapted
from floatplan.inflight.orientation import PlanarOrientations
from floatplan.inflight.remaining_motion import RemainingMotion
from floatplan.kernel.structs import doubles
from floatplan.motion.flight import GaussGrid, LinkShapes, PlanarFlight, gauss_grid, planar_flight
from floatplan.motion.quadrature import NODE_COUNTS, gauss_legendre
from floatplan.planning.kernel_input.bodies import Bodies
from floatplan.planning.kernel_input.rows import Block, PlanarRows
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import LinkCapsule

LEAST_INSTANTS = 40  # [-] in addition to the nodes; with 8, torques between exceeded limits by 5 %
MOST_INSTANTS = 160  # [-] where an obstacle could be passed unseen between so few


class InPlane:
    """A plan's flight in a plane.

    Attributes
    ----------
    orientations : arithmetic of orientations
    flight : what the problem fixes
    links : of each shape that distances are measured to, the link it belongs to
    grids : tuple of (share, GaussGrid)
        Nodes at which the base's rate is integrated, where at most that share of the flight remains; the first always.
    instants : how many in addition, at which rows are looked at
    direction : (1,)
        Unit vector along which warm starts vary h.
    """

    orientations = PlanarOrientations()
    direction = np.ones(1)

    def __init__(self, plan: Plan, obstacles: Sequence[Obstacle]) -> None:
        problem = plan.problem
        flight = planar_flight(problem)
        shapes = problem.robot.shapes if problem.self_clearances else _distinct(flight.tree, problem.robot.shapes)
        hulls = _distinct(flight.tree, problem.ground_shapes) if problem.ground else ()
        self.plan = plan
        self.links: tuple[str, ...] = tuple(shape.link for shape in shapes)
        self.flight = replace(flight, other_shapes=LinkShapes(flight.tree, shapes, hulls))
        self.grids = ((np.inf, gauss_grid(_node_count(plan))),)
        self.instants = _instants_needed(plan, self.flight, obstacles)

    def identification(self, angular_momentum: float) -> Identification:
        """Return the filter's state at takeoff, with an angular momentum, kg m^2/s."""
        initial = self.plan.problem.initial
        inertia = float(self.flight.equations.momentum_map(initial.positions[None, :])[0, 0])
        return Identification(len(self.flight.tree.mass), initial.orientation, angular_momentum, inertia)

    def base_rate(self, positions: Array, velocities: Array) -> float:
        """Return the base's rate at takeoff, rad/s."""
        return float(self.flight.equations.base_rate(positions, velocities, self.plan.angular_momentum)[0])

    def rows(self, blocks: Sequence[Block]) -> PlanarRows:
        """Return the rows of the problem's limits."""
        return PlanarRows(self.flight.tree, blocks, flight=self.flight)

    def kernel_input(self, rows: PlanarRows, gap_nodes: int) -> PlanarKernelInput:
        """Return what the kernel computes with: the robot of the masses that are estimated."""
        return PlanarKernelInput(self.flight, rows, gap_nodes)

    def integrals(self, grid: GaussGrid) -> Array | None:
        """Return integrals (K - N, N) from values at the N nodes to the K - N other instants."""
        return doubles(grid.integrals[grid.nodes :])

    def ideal_robot(self, angular_momentum: float, errors: Array) -> IdealRobot:
        """Return a robot that has an angular momentum, kg m^2/s, and relative errors (2m,) of masses and inertias."""
        return IdealRobot(self.plan, angular_momentum, errors)


class PlanarKernelInput:
    """The kernel's functions and what these are given of a flight in a plane.

    Attributes
    ----------
    room, step : names
        Of the function that says how many numbers an update works in, and of that which computes a step of one.
    robot : Struct
    members : of the struct ``CorrectedFlight``
    path : (5,)
        Of the centre of mass, from ``path_begin(now)`` on: place, velocity, gravity.
    """

    room = "flight_room"
    step = "flight"

    def __init__(self, flight: PlanarFlight, rows: PlanarRows, gap_nodes: int) -> None:
        self.path = rows.path
        tree = flight.tree
        bodies = rows.own_bodies
        # The kernel writes C with the estimated masses: it is complex even where the plan's is real.
        real = np.zeros_like(bodies.real)
        imaginary = np.zeros_like(bodies.real)
        link_real = np.zeros(bodies.links.shape)
        link_imaginary = np.zeros(bodies.links.shape)
        self.robot = copy(bodies.struct)
        self.robot.point_to(real=real, imaginary=imaginary, link_real=link_real, link_imaginary=link_imaginary)
        self.robot.pointer.is_real = False
        self.members: dict[str, Any] = {
            "goal": flight.final_orientation,
            "mass": doubles(tree.mass),
            "inertia": doubles(tree.inertia),
            "turns": np.concatenate((tree.turns, tree.motor_turns), axis=1),
            "link_real": link_real,
            "link_imaginary": link_imaginary,
            "real": real,
            "imaginary": imaginary,
            "map": np.zeros(tree.turns.shape[1] + 1),
            "measured_orientation": np.zeros(1),
            "turn_before": np.zeros(1),
            "turn_after": np.zeros(1),
            **_of_masses(tree, bodies),
            **dict.fromkeys(("body_mass", "body_first", "body_second")),
            **dict.fromkeys(("cells", "gap_cells")),
        }

    def path_begin(self, now: float) -> float:
        """Return the time, s, at which the path of the centre of mass begins for the kernel."""
        return now

    def integrate_at(self, flight: Any, grid: GaussGrid) -> None:
        """Let the base's rate be integrated at the nodes of a grid: they stay the same."""

    def begin(self) -> None:
        """Begin another flight."""
        self.members["turn_after"][0] = 0.0

    @property
    def turned(self) -> float:
        """Rotation of the base from the last measurement that was learnt from until now, rad."""
        return float(self.members["turn_after"][0])

    def expected_orientation(self, estimated: float) -> float:
        """Return the orientation where something is measured, rad, from that at the last measurement."""
        return estimated + float(self.members["turn_before"][0])

    def measure(self, orientation: float) -> None:
        """Write a measured orientation."""
        self.members["measured_orientation"][0] = orientation

    def miss(self, corrected: Any) -> float:
        """Return what the kernel says of a landing: its miss, rad."""
        return float(corrected.miss[0])


class IdealRobot:
    """A robot in flight whose joints follow their reference exactly: its base rotates by (4)."""

    def __init__(self, plan: Plan, angular_momentum: float, errors: Array) -> None:
        self.orientation = plan.problem.initial.orientation
        self.time = 0.0
        self._momentum = angular_momentum
        self._goal = plan.problem.final.orientation
        self._dynamics = adapted(plan.robot.tree, errors)

    @property
    def measured_orientation(self) -> float:
        """As :meth:`floatplan.inflight.replanner.Replanner.update` is given it."""
        return self.orientation

    @property
    def miss(self) -> float:
        """Distance of the orientation from the goal, rad."""
        return abs(self.orientation - self._goal)

    def rate(self, positions: Array, velocities: Array) -> float:
        """Return the base's rate, rad/s, at joints' positions and velocities (1, n)."""
        return float(self._dynamics.base_rate(positions, velocities, self._momentum)[0])

    def fly(self, motion: RemainingMotion, until: float) -> None:
        """Turn the base until a time, s."""
        quadrature = gauss_legendre(6)
        times = self.time + (until - self.time) * quadrature.nodes
        positions, velocities, _ = motion.at(times)
        rates = self._dynamics.base_rate(positions, velocities, self._momentum)
        self.orientation += (until - self.time) * float(quadrature.weights @ rates)
        self.time = until

    def write(self, inertial: Identification) -> None:
        """Write the orientation into an estimate's."""
        inertial.state[0] = self.orientation


def _of_masses(tree: PlanarTree, bodies: Bodies) -> dict[str, Array]:
    """C, by what it changes with each mass, and the centres of mass, by the rotations of the bodies."""
    by_links = tree.point_weights(np.arange(len(tree.mass)), tree.center)
    own = by_links * bodies.rotations.sum(axis=0)
    weights = bodies.of_points(by_links)
    conjugate = (own if bodies.is_mirrored else own.conj()) * tree.mass[:, None]
    by_mass = conjugate[:, :, None] * weights[:, None, :]
    return {
        "by_mass_real": doubles(by_mass.real),
        "by_mass_imaginary": doubles(by_mass.imag),
        "weights_real": doubles(weights.real),
        "weights_imaginary": doubles(weights.imag),
        "nominal_real": doubles(bodies.links.real),
        "nominal_imaginary": doubles(bodies.links.imag),
    }


def _instants_needed(plan: Plan, flight: PlanarFlight, obstacles: Sequence[Obstacle]) -> int:
    """Number of instants between which, on the plan, no link passes an obstacle from one side to the other."""
    if not obstacles:
        return LEAST_INSTANTS
    times = np.linspace(0.0, plan.duration, MOST_INSTANTS)
    state = plan.at(times)
    com = flight.ballistics.positions(times)
    angles = flight.tree.absolute_angles(state.orientation, state.positions)
    shapes = flight.link_shapes.place(com[:, 0] + 1j * com[:, 1], angles)
    passes = []
    for obstacle in obstacles:
        moved = times[:, None] * complex(*obstacle.velocity)
        start_steps = np.abs(np.diff(shapes.start - moved, axis=0)).max(axis=0)
        end_steps = np.abs(np.diff(shapes.end - moved, axis=0)).max(axis=0)
        thickness = np.maximum(obstacle.thickness + 2 * shapes.radius, 1e-3)  # m
        passes.append(float((np.maximum(start_steps, end_steps) / thickness).max()))
    return min(max(LEAST_INSTANTS, math.ceil(MOST_INSTANTS * max(passes))), MOST_INSTANTS)


def _distinct(tree: PlanarTree, shapes: tuple[LinkCapsule, ...]) -> tuple[LinkCapsule, ...]:
    """Return the shapes without those that always are where another is: of legs that move as one."""
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (3, tree.turns.shape[1]))
    segments = LinkShapes(tree, shapes).place(np.zeros(3, complex), tree.absolute_angles(np.zeros(3), postures))
    ends = np.concatenate((segments.start, segments.end)).T
    keys = np.concatenate((ends.real, ends.imag, segments.radius[:, None]), axis=1)
    same = 1e-9  # [m] by which shapes that are one may differ
    _, first = np.unique(np.rint(keys / same), axis=0, return_index=True)
    return tuple(shapes[index] for index in sorted(first))


def _node_count(plan: Plan) -> int:
    """How many nodes resolve theta0' of the plan well enough."""
    flight = planar_flight(plan.problem)
    # Gauss nodes integrate theta0' to about the square of the tail of its series, relative to its largest.
    largest_tail = 1e-3
    for count in NODE_COUNTS:
        quadrature = gauss_grid(count).quadrature
        positions, velocities, _ = plan.joint_motion(quadrature.nodes * plan.duration)
        rates = flight.equations.base_rate(positions, velocities, plan.angular_momentum)
        if quadrature.tail(rates) <= largest_tail * max(float(np.abs(rates).max()), 1e-300):
            return count
    return NODE_COUNTS[-1]
