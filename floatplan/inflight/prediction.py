"""What is looked at in the rest of a flight: instants, and rows of the problem's limits.

A row is kept where its value is at least zero: one minus the share of a limit that is used, or a clearance less its
margin over ``LENGTH_SCALE``, as in the planner's constraints.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import GaussGrid, LinkShapes, PlanarFlight, gauss_grid, planar_flight
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, basis
from floatplan.planning.kernel_input.rows import SUMMED, Block, DistanceRows, can_write
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem, Shares, shares_of_limits
from floatplan.robot.robot import LinkCapsule, PlanarTree
from floatplan.tables import LIMIT_TABLE

RESOLVED = 1e-3  # [-] tail of theta0' relative to its largest: N Gauss nodes integrate it to about the square of that
LEAST_INSTANTS = 40  # [-] besides the nodes, at which limits are looked at; with 8, torques between were 5 % beyond
MOST_INSTANTS = 160  # [-] where an obstacle could be passed unseen between so few
LANES = 8  # [-] of numbers that the kernel takes at once: of instants there are a multiple
OF_WINDOW = np.array([0.0, 0.5, 1.0])  # [-] of an obstacle's window, looked at besides
THINNEST = 1e-3  # [m] of what is passed
SAME = 1e-9  # [m] shapes that are nowhere further apart are one
SENSIBLE = 4.0  # [-] of the plan's largest acceleration: the most that corrections ask of joints without limits
LENGTH_SCALE = 0.1  # [m] of clearance that is worth as much as the whole of a limit
SHARE_AIM, SHARE_SOFTNESS = 0.02, 0.01  # [-] of limits, see :class:`LimitRows`
TORQUE_AIM = 0.5  # [-] of torques: what rotors and friction that nobody knows need besides, motors must have to spare
DISTANCE_AIM, DISTANCE_SOFTNESS = 0.1, 0.02  # [LENGTH_SCALE]
ALWAYS = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class LimitRows:
    """A block of rows that applies within a window, s since takeoff.

    Corrections aim at values of ``aim``, above zero; a row may miss that by ``softness`` where the landing may miss the
    goal by sigma. Where the plan is nearer to a limit they aim at what it has: of torques where it is nearest, of all
    else where it lands.
    """

    block: Block
    aim: float
    softness: float
    window: tuple[float, float] = ALWAYS
    of_torques: bool = False

    def as_planned(self, values: Array, landing: int) -> LimitRows:
        """Return the same with that aim, for values (rows, K) under the plan's motion, which lands at an instant."""
        least = max(values.min(), SHARE_AIM) if self.of_torques else max(values[:, landing].min(), 0.0)
        return replace(self, aim=min(self.aim, least))


def limit_rows(problem: Problem) -> list[LimitRows]:
    """Return the rows of all limits of a problem but distances; joint ranges need none.

    Raises
    ------
    InputError
        Corrections in flight do not know a limit.
    """
    rows = []
    for shares in shares_of_limits(problem):
        for quantity in shares.used.keys() - SUMMED:
            raise InputError(
                f"corrections in flight do not know limits of {quantity}",
                element=f"limits.{shares.key}",
                advice="leave it out, or fly without corrections",
            )
        of_torques = shares.key == "torque"
        aim = TORQUE_AIM if of_torques else SHARE_AIM
        rows.append(LimitRows(shares, aim, SHARE_SOFTNESS, of_torques=of_torques))
    return rows


def sensible_rows(plan: Plan) -> list[LimitRows]:
    """Return a bound of the accelerations of joints that the problem does not limit: a multiple of the plan's largest.

    Without it a goal that cannot be reached any more would be chased harder and harder until the landing.
    """
    problem, ratios = plan.problem, plan.robot.motor_ratios != 0
    held = np.isfinite(np.minimum(problem.motor_torque_limits, problem.motor_stall))
    limited = (~ratios | held[:, None]).all(axis=0) | np.isfinite(problem.joint_limits["acceleration"])
    free = ~limited & ~np.isfinite(problem.torque_limits)
    largest = float(plan.peaks.joints["acceleration"].max())
    if not free.any() or not largest:
        return []
    names, row = tuple(np.array(plan.robot.joints)[free].tolist()), LIMIT_TABLE["acceleration"]
    limit = np.full(len(names), SENSIBLE * largest)
    shares = Shares(row.key, names, limit, row.unit, {row.quantity: np.eye(len(free))[free] / limit[:, None]})
    return [LimitRows(shares, SHARE_AIM, SHARE_SOFTNESS)]


def distance_rows(problem: Problem, shapes: Sequence[LinkCapsule]) -> list[LimitRows]:
    """Return the rows of all obstacles and pairs of links, measured to ``shapes``.

    Raises
    ------
    InputError
        Corrections in flight do not know a kind of obstacle.
    """
    measured: list[tuple[Any, float, tuple[float, float]]] = []
    for obstacle in [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]:
        if not can_write(obstacle):
            raise InputError(
                f"corrections in flight do not know obstacles of kind {obstacle.kind!r}",
                element="obstacles",
                advice="leave it out, or fly without corrections",
            )
        measured.append((obstacle, obstacle.margin, obstacle.window or ALWAYS))
    for pair in problem.self_clearances:
        first, second = ([i for i, shape in enumerate(shapes) if shape.link == name] for name in pair.links)
        measured.append(((first, second), pair.margin, ALWAYS))
    return [
        LimitRows(DistanceRows(between, margin, LENGTH_SCALE), DISTANCE_AIM, DISTANCE_SOFTNESS, window)
        for between, margin, window in measured
    ]


class Views:
    """Instants and rows of a plan's flight.

    Changes y (m, n) of the free polynomials, ``whitening @ y / amplitude`` of their coefficients, are in rad and make a
    second derivative of the positions by u whose root mean square is at most ``|y|``. Of all coefficients (6+m, n) of
    a difference of motions, ``amplitude * unwhitening @`` these is the y that comes nearest to its second derivative.
    """

    def __init__(self, plan: Plan, form: Form) -> None:
        problem = plan.problem
        flight = planar_flight(problem)
        shapes = problem.robot.shapes if problem.self_clearances else _distinct(flight.tree, problem.robot.shapes)
        hulls = _distinct(flight.tree, problem.ground_shapes) if problem.ground else ()
        self.flight = replace(flight, other_shapes=LinkShapes(flight.tree, shapes, hulls))
        distances = distance_rows(problem, shapes)
        self.has_distances = bool(distances)
        self.rows = [*distances, *limit_rows(problem), *sensible_rows(plan)]
        obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        self._windows = np.array([obstacle.window for obstacle in obstacles if obstacle.window is not None])
        self.functions = basis(form)
        products = _second_derivatives(form)
        self.whitening = np.linalg.inv(np.linalg.cholesky(products[:, CONDITIONS:])).T
        self.unwhitening = self.whitening.T @ products
        nodes, count = gauss_grid(NODE_COUNTS[_level(plan)]), _instants_needed(plan, self.flight, obstacles)
        count += -(nodes.nodes + count + len(OF_WINDOW) * len(self._windows)) % LANES
        self._always = nodes.also(np.linspace(0.0, 1.0, count))
        self.instants = self.between(0.0, plan.duration)

    def between(self, begin: float, end: float) -> GaussGrid:
        """Where a motion between two times, s, is looked at, as shares of what remains: nodes, and W instants beside.

        Among these are the ends and middles of obstacles' windows.
        """
        if not len(self._windows):
            return self._always
        low, high = np.clip(self._windows, begin, end).T
        times = low[:, None] + (high - low)[:, None] * OF_WINDOW
        return self._always.also((times.ravel() - begin) / (end - begin))


def _instants_needed(plan: Plan, flight: PlanarFlight, obstacles: Sequence[Obstacle]) -> int:
    """Number of instants between which, on the plan, no link passes an obstacle from one side to the other."""
    if not obstacles:
        return LEAST_INSTANTS
    times = np.linspace(0.0, plan.duration, MOST_INSTANTS)
    state, com = plan.at(times), flight.ballistics.positions(times)
    angles = flight.tree.absolute_angles(state.orientation, state.positions)
    shapes = flight.link_shapes.place(com[:, 0] + 1j * com[:, 1], angles)
    passes = []
    for obstacle in obstacles:
        moved = times[:, None] * complex(*obstacle.velocity)
        step = np.maximum(*(np.abs(np.diff(ends - moved, axis=0)).max(axis=0) for ends in (shapes.start, shapes.end)))
        passes.append(float((step / np.maximum(obstacle.thickness + 2 * shapes.radius, THINNEST)).max()))
    return min(max(LEAST_INSTANTS, math.ceil(MOST_INSTANTS * max(passes))), MOST_INSTANTS)


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
    """Products (m, 6+m) of the second derivatives by u of the free polynomials with those of all."""
    quadrature = gauss_grid(NODE_COUNTS[-1] if form.width > 20 else 48).quadrature
    second = basis(form).values(quadrature.nodes)[2]
    return np.asarray(second[:, CONDITIONS:].T @ (quadrature.weights[:, None] * second))
