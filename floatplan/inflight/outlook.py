"""What will come of a motion: the rest of a flight from the present orientation, momentum and place, and its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray, read_only
from floatplan.inflight.limits import RowPartials, Rows, distance_rows, limit_rows, sensible_rows
from floatplan.inflight.motion import RemainingMotion
from floatplan.motion.planar.ballistics import Ballistics
from floatplan.motion.planar.clearance import Distances, LinkShapes, Segments
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.flight import GaussGrid, PlanarFlight, PlanarFlown, gauss_grid, planar_flight
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import CONDITIONS, Form, basis, joint_motion
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.robot.robot import LinkCapsule, PlanarTree

RESOLVED = 1e-3  # [-] tail of theta0' relative to its largest: N Gauss nodes integrate it to about the square of that
WATCHED = 40  # [-] instants besides the nodes at which limits are looked at; with 8, torques between were 5 % beyond
MOST_WATCHED = 160  # [-] where an obstacle could be passed unseen between so few
LANES = 8  # [-] of numbers that the kernel takes at once: of instants there are a multiple
OF_WINDOW = np.array([0.0, 0.5, 1.0])  # [-] of an obstacle's window, looked at besides
THINNEST = 1e-3  # [m] of what is passed
SHARED = ("_course", "flown", "miss", "_rate_by_p")  # of an outlook: what no distance is in
SAME = 1e-9  # [m] shapes that are nowhere further apart are one


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Present:
    """The robot now: ``time`` s since takeoff, orientation rad, h kg m^2/s.

    ``path`` gives the path of the CM from now on, ``adapted`` the dynamics of its masses, when they are asked for.
    """

    time: float
    orientation: float
    angular_momentum: float
    path: Callable[[], Ballistics]
    adapted: Callable[[], Dynamics]

    @cached_property
    def com(self) -> Ballistics:
        """Path of the centre of mass from now on."""
        return self.path()

    @cached_property
    def dynamics(self) -> Dynamics:
        """With the masses that the robot is believed to have."""
        return self.adapted()


@dataclass(frozen=True, eq=False)
class Instants:
    """Where a motion is looked at, as shares of what remains: the nodes, then the W watched ones.

    ``values`` are those of the basis and its two derivatives there, (K, 6+m) each; ``free`` (K, m) of changes y.
    """

    grid: GaussGrid
    values: tuple[Array, Array, Array]
    free: tuple[Array, ...]

    @property
    def watched(self) -> Array:
        """Shares (W,)."""
        return self.grid.s[self.grid.nodes :]


class Views:
    """What all looks ahead of a plan have in common: the instants and the rows."""

    def __init__(self, plan: Plan, form: Form) -> None:
        problem = plan.problem
        flight = planar_flight(problem)
        shapes = problem.robot.shapes if problem.self_clearances else _distinct(flight.tree, problem.robot.shapes)
        hulls = _distinct(flight.tree, problem.ground_shapes) if problem.ground else ()
        self.flight = replace(flight, link_shapes=LinkShapes(flight.tree, shapes, hulls))
        distances = distance_rows(problem, shapes)
        self.has_distances = bool(distances)
        self.rows = (*distances, *limit_rows(problem), *sensible_rows(plan))
        obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        self._windows = np.array([obstacle.window for obstacle in obstacles if obstacle.window is not None])
        self._functions = basis(form)
        self.whitening = np.linalg.inv(np.linalg.cholesky(_second_derivatives(form))).T
        nodes, count = gauss_grid(NODE_COUNTS[_level(plan)]), _watched(plan, self.flight, obstacles)
        count += -(nodes.nodes + count + len(OF_WINDOW) * len(self._windows)) % LANES
        self._always = nodes.also(np.linspace(0.0, 1.0, count))
        self.instants = self._at(self._always)
        self.instants = self.between(0.0, plan.duration)
        self.motor_turns = plan.robot.tree.motor_turns

    def _at(self, grid: GaussGrid) -> Instants:
        values = self._functions.values(grid.s)
        return Instants(grid, values, tuple(read_only(part[:, CONDITIONS:] @ self.whitening) for part in values))

    def between(self, begin: float, end: float) -> Instants:
        """Where a motion between two times, s, is looked at: also at the ends and middles of obstacles' windows."""
        if not len(self._windows):
            return self.instants
        low, high = np.clip(self._windows, begin, end).T
        times = low[:, None] + (high - low)[:, None] * OF_WINDOW
        return self._at(self._always.also((times.ravel() - begin) / (end - begin)))


def _watched(plan: Plan, flight: PlanarFlight, obstacles: Sequence[Obstacle]) -> int:
    """Number of instants between which, on the plan, no link passes an obstacle from one side to the other."""
    if not obstacles:
        return WATCHED
    times = np.linspace(0.0, plan.duration, MOST_WATCHED)
    state, com = plan.at(times), flight.ballistics.positions(times)
    angles = flight.tree.absolute_angles(state.orientation, state.positions)
    shapes = flight.link_shapes.place(com[:, 0] + 1j * com[:, 1], angles)
    passes = []
    for obstacle in obstacles:
        moved = times[:, None] * complex(*obstacle.velocity)
        step = np.maximum(*(np.abs(np.diff(ends - moved, axis=0)).max(axis=0) for ends in (shapes.start, shapes.end)))
        passes.append(float((step / np.maximum(obstacle.thickness + 2 * shapes.radius, THINNEST)).max()))
    return min(max(WATCHED, math.ceil(MOST_WATCHED * max(passes))), MOST_WATCHED)


def _distinct(tree: PlanarTree, shapes: tuple[LinkCapsule, ...]) -> tuple[LinkCapsule, ...]:
    """Return the shapes without those that always are where another is: of legs that move together."""
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (3, tree.turns.shape[1]))
    placed = LinkShapes(tree, shapes).place(np.zeros(3, complex), tree.absolute_angles(np.zeros(3), postures))
    where = np.concatenate((placed.start, placed.end)).T
    keys = np.concatenate((where.real, where.imag, placed.radius[:, None]), axis=1)
    _, first = np.unique(np.rint(keys / SAME), axis=0, return_index=True)
    return tuple(shapes[index] for index in sorted(first))


def _level(plan: Plan) -> int:
    """Level of nodes that resolves theta0' of the plan well enough."""
    flight = planar_flight(plan.problem)
    level = 0
    for level, count in enumerate(NODE_COUNTS):  # noqa: B007
        quadrature = gauss_grid(count).quadrature
        positions, velocities, _ = plan.joint_motion(quadrature.nodes * plan.duration)
        rates = flight.equations.base_rate(positions, velocities, plan.angular_momentum)
        if quadrature.tail(rates) <= RESOLVED * max(float(np.abs(rates).max()), 1e-300):
            break
    return level


def _second_derivatives(form: Form) -> Array:
    """Gram matrix (m, m) of the second derivatives by u of the free polynomials."""
    quadrature = gauss_grid(NODE_COUNTS[-1] if form.width > 20 else 48).quadrature
    second = basis(form).values(quadrature.nodes)[2][:, CONDITIONS:]
    return np.asarray(second.T @ (quadrature.weights[:, None] * second))


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class Course:
    """What all motions from a present to a landing have in common; ``watched`` (W,) s since takeoff."""

    flight: PlanarFlight
    begin: float
    instants: Instants
    watched: Array

    @cached_property
    def com(self) -> ComplexArray:
        """Places (W,) of the centre of mass at the watched instants, m."""
        places = self.flight.ballistics.positions(self.watched - self.begin)
        return np.asarray(places.view(np.complex128)[:, 0])


class Breach(NamedTuple):
    """Values of a block that are below its aim: at which instants, in which rows, by how much over the softness."""

    block: Rows
    instants: IntArray
    rows: IntArray
    below: Array


class Outlook:
    """The rest of a flight under a motion, evaluated when asked.

    Changes y (n m,) of the free polynomials, joint by joint, are in rad and make a second derivative of the positions
    by u whose root mean square is at most ``|y|``.
    """

    def __init__(self, views: Views, motion: RemainingMotion, present: Present, landed: bool = False) -> None:
        self._views, self.motion, self._present, self._landed = views, motion, present, landed

    def __reduce__(self) -> tuple[type[Outlook], tuple[Views, RemainingMotion, Present, bool]]:
        """To what it is made of: a copy evaluates anew."""
        return Outlook, (self._views, self.motion, self._present, self._landed)

    @property
    def has_distances(self) -> bool:
        """Whether there are obstacles, or links that must keep apart."""
        return self._views.has_distances

    def as_landed(self) -> Outlook:
        """Return the same, its distances those of a base that turns to the goal: the miss is taken off, by time.

        So that a base far from its goal, whose feet would be in the ground, is not kept from turning through there.
        """
        return self._seen(landed=True)

    def as_it_is(self) -> Outlook:
        """Return the same, its distances those of the base as it turns."""
        return self._seen(landed=False)

    def _seen(self, landed: bool) -> Outlook:
        other = Outlook(self._views, self.motion, self._present, landed)
        other.__dict__.update((name, self.__dict__[name]) for name in SHARED if name in self.__dict__)
        return other

    @cached_property
    def _course(self) -> Course:
        views, motion, present = self._views, self.motion, self._present
        flight = PlanarFlight(
            views.flight.tree,
            present.dynamics,
            views.flight.link_shapes,
            present.com,
            present.orientation,
            views.flight.final_orientation,
            motion.remaining,
            self.change,
        )
        instants = views.between(motion.begin, motion.end)
        return Course(flight, motion.begin, instants, motion.begin + motion.remaining * instants.watched)

    @property
    def watched(self) -> Array:
        """Times (W,), s since takeoff, at which distances are watched."""
        return self._course.watched

    @property
    def times(self) -> Array:
        """Times (K,), s since takeoff, at which all else is looked at."""
        return self.motion.begin + self.motion.remaining * self._course.instants.grid.s

    @cached_property
    def shapes(self) -> Segments:
        """The links' shapes at the watched instants."""
        grid, flown, flight = self._course.instants.grid, self.flown, self._course.flight
        turned = self.motion.remaining * (grid.integrals[grid.nodes :] @ flown.node_rates[0])
        if self._landed:
            turned -= self.miss * self._course.instants.watched
        angles = flight.tree.absolute_angles(flight.initial_orientation + turned, flown.joints.positions[grid.nodes :])
        return flight.link_shapes.place(self._course.com, angles)

    @cached_property
    def measured(self) -> dict[object, Distances]:
        """What blocks of rows have measured."""
        return {}

    @cached_property
    def flown(self) -> PlanarFlown:
        """How the base turns."""
        motion, instants = self.motion, self._course.instants
        joints = joint_motion(motion.centre, motion.amplitude, motion.remaining, motion.coefficients, instants.values)
        return PlanarFlown(self._course.flight, instants.grid, joints, np.array([[self._present.angular_momentum]]))

    @property
    def present(self) -> Present:
        """The robot now."""
        return self._present

    @property
    def change(self) -> float:
        """By how much the base is to turn to its goal, rad."""
        return self._views.flight.final_orientation - self._present.orientation

    @cached_property
    def miss(self) -> float:
        """Orientation at landing less the goal, rad."""
        return float(self.flown.residual[0, 0])

    @cached_property
    def values(self) -> tuple[Array, ...]:
        """Values (K, r) or (W, r) of each block of rows."""
        return tuple(block.values(self) for block in self._views.rows)

    @cached_property
    def worst(self) -> Array:
        """Least value of each block."""
        return np.array([values.min() for values in self.values])

    @cached_property
    def breaches(self) -> tuple[Breach, ...]:
        """Of the blocks with values below their aim."""
        found = []
        for block, values, worst in zip(self._views.rows, self.values, self.worst.tolist(), strict=True):
            if not worst >= block.aim:
                instants, rows = np.nonzero(~(values >= block.aim))
                found.append(Breach(block, instants, rows, (block.aim - values[instants, rows]) / block.softness))
        return tuple(found)

    @cached_property
    def torque_peak(self) -> Array:
        """Largest torque (m,) of each motor for the rest of the flight, N m."""
        return np.asarray(np.abs(self.flown.moments @ self._views.motor_turns).max(axis=0))

    @cached_property
    def _rate_by_p(self) -> tuple[Array, Array]:
        """Derivatives (n, N) of theta0' at the nodes by p and by its rate, over the amplitude."""
        nodes, joints, rate = self._course.instants.grid.nodes, self.flown.joints, self.flown.base_rate
        by_p = rate.by_position * joints.position_by_p + rate.by_velocity * joints.velocity_by_p
        by_rate = rate.by_velocity * joints.velocity_by_rate
        amplitude = self.motion.amplitude
        return (by_p[:nodes] / amplitude).T, (by_rate[:nodes] / amplitude).T

    def _turned_by_y(self, integrals: Array) -> Array:
        """Derivatives (S, n m) of turns that are so made of the rates at the nodes (S, N)."""
        value, rate, _ = self._course.instants.free
        nodes = self._course.instants.grid.nodes
        by_p, by_rate = ((integrals[:, None, :] * part).reshape(-1, nodes) for part in self._rate_by_p)
        by_y = by_p @ value[:nodes] + by_rate @ rate[:nodes]
        return np.asarray(self.motion.remaining * by_y.reshape(len(integrals), -1))

    @property
    def miss_by_y(self) -> Array:
        """Derivative (n m,) of the miss."""
        return np.asarray(self._turned_by_y(self._course.instants.grid.weights[None, :])[0])

    def rows_by_y(self, block: Rows, instants: IntArray, rows: IntArray) -> Array:
        """Derivatives (S, n m) of some rows of a block at some of its instants, each (S,) indices."""
        grid = self._course.instants.grid
        partials = block.partials(self, instants, rows)
        if partials.by_attitude is None:
            return self._chained(partials, instants)
        instants = grid.nodes + instants
        integrals = grid.integrals[instants]
        if self._landed:
            integrals = integrals - grid.s[instants, None] * grid.weights
        return self._chained(partials, instants) + partials.by_attitude[:, None] * self._turned_by_y(integrals)

    def _chained(self, partials: RowPartials, instants: IntArray) -> Array:
        joints, amplitude = self.flown.joints, self.motion.amplitude
        by_value, by_rate, by_curvature = None, None, None
        if partials.by_position is not None:
            by_value = partials.by_position * joints.position_by_p[instants]
        if partials.by_velocity is not None:
            part = partials.by_velocity * joints.velocity_by_p[instants]
            by_value = part if by_value is None else by_value + part
            by_rate = partials.by_velocity * joints.velocity_by_rate[instants]
        if partials.by_acceleration is not None:
            part = partials.by_acceleration * joints.acceleration_by_p[instants]
            by_value = part if by_value is None else by_value + part
            part = partials.by_acceleration * joints.acceleration_by_rate[instants]
            by_rate = part if by_rate is None else by_rate + part
            by_curvature = partials.by_acceleration * joints.acceleration_by_curvature[instants]
        total: Array | float = 0.0
        for weight, free in zip((by_value, by_rate, by_curvature), self._course.instants.free, strict=True):
            if weight is not None:
                total = total + (weight / amplitude)[:, :, None] * free[instants][:, None, :]
        return np.asarray(total).reshape(len(instants), -1)

    def changed(self, y: Array) -> Outlook:
        """Return the outlook under the motion changed by y."""
        change = y.reshape(len(self.motion.amplitude), -1) / self.motion.amplitude[:, None]
        return self.moving_as(self._views.whitening @ change.T)

    def moving_as(self, change: Array) -> Outlook:
        """Return the outlook under the motion whose free coefficients change by (m, n)."""
        motion = self.motion
        coefficients = motion.coefficients.copy()
        coefficients[CONDITIONS:] += change
        changed = RemainingMotion(motion.centre, motion.amplitude, motion.begin, motion.end, coefficients, motion.table)
        other = Outlook(self._views, changed, self._present, self._landed)
        other._course = self._course
        return other
