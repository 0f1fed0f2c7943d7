"""What will come of a motion: the rest of a flight from the present orientation, momentum and place, and its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.inflight.limits import distance_rows, limit_rows, sensible_rows
from floatplan.inflight.motion import RemainingMotion
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.planar.ballistics import Ballistics
from floatplan.motion.planar.clearance import LinkShapes, Segments
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.flight import GaussGrid, PlanarBaseMotion, PlanarFlight, gauss_grid, planar_flight
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, basis, joint_motion
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.robot.robot import LinkCapsule, PlanarTree

RESOLVED = 1e-3  # [-] tail of theta0' relative to its largest: N Gauss nodes integrate it to about the square of that
WATCHED = 40  # [-] instants besides the nodes at which limits are looked at; with 8, torques between were 5 % beyond
MOST_WATCHED = 160  # [-] where an obstacle could be passed unseen between so few
LANES = 8  # [-] of numbers that the kernel takes at once: of instants there are a multiple
OF_WINDOW = np.array([0.0, 0.5, 1.0])  # [-] of an obstacle's window, looked at besides
THINNEST = 1e-3  # [m] of what is passed
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
    """What all predictions of a plan's flight have in common: the instants and the rows.

    Changes y (m, n) of the free polynomials, ``whitening @ y / amplitude`` of their coefficients, are in rad and make a
    second derivative of the positions by u whose root mean square is at most ``|y|``.
    """

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


class Prediction:
    """The rest of a flight under a motion, evaluated when asked."""

    def __init__(self, views: Views, motion: RemainingMotion, present: Present) -> None:
        self._views, self.motion, self._present = views, motion, present

    def __reduce__(self) -> tuple[type[Prediction], tuple[Views, RemainingMotion, Present]]:
        """To what it is made of: a copy evaluates anew."""
        return Prediction, (self._views, self.motion, self._present)

    @cached_property
    def _instants(self) -> Instants:
        return self._views.between(self.motion.begin, self.motion.end)

    @cached_property
    def _flight(self) -> PlanarFlight:
        flight, present = self._views.flight, self._present
        return PlanarFlight(
            flight.tree,
            present.dynamics,
            flight.link_shapes,
            present.com,
            present.orientation,
            flight.final_orientation,
            self.motion.remaining,
            flight.final_orientation - present.orientation,
        )

    @property
    def watched(self) -> Array:
        """Times (W,), s since takeoff, at which distances are watched."""
        return self.motion.begin + self.motion.remaining * self._instants.watched

    @property
    def times(self) -> Array:
        """Times (K,), s since takeoff, at which all else is looked at."""
        return self.motion.begin + self.motion.remaining * self._instants.grid.s

    @cached_property
    def shapes(self) -> Segments:
        """The links' shapes at the watched instants."""
        grid, flight = self._instants.grid, self._flight
        turned = self.motion.remaining * (grid.integrals[grid.nodes :] @ self.flown.node_rates[0])
        positions = self.flown.joints.positions[grid.nodes :]
        angles = flight.tree.absolute_angles(flight.initial_orientation + turned, positions)
        com = flight.ballistics.positions(self.watched - self.motion.begin)
        return flight.link_shapes.place(com[:, 0] + 1j * com[:, 1], angles)

    @cached_property
    def flown(self) -> PlanarBaseMotion:
        """How the base turns."""
        motion, instants = self.motion, self._instants
        joints = joint_motion(motion.centre, motion.amplitude, motion.remaining, motion.coefficients, instants.values)
        return PlanarBaseMotion(self._flight, instants.grid, joints, np.array([[self._present.angular_momentum]]))

    @property
    def present(self) -> Present:
        """The robot now."""
        return self._present

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
    def torque_peak(self) -> Array:
        """Largest torque (m,) of each motor for the rest of the flight, N m."""
        return np.asarray(np.abs(self.flown.moments @ self._views.motor_turns).max(axis=0))
