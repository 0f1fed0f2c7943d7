"""Where the remaining flight is evaluated: instants, and rows of the problem's limits.

A row is satisfied where its value is at least zero: one minus the share of a limit that is used, or a clearance less
its margin over ``LENGTH_SCALE``, as in the planner's constraints.
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
from floatplan.problem.problem import Problem, Shares
from floatplan.robot.robot import LinkCapsule, PlanarTree
from floatplan.tables import LIMIT_TABLE

LEAST_INSTANTS = 40  # [-] in addition to the nodes; with 8, torques between exceeded limits by 5 %
MOST_INSTANTS = 160  # [-] where an obstacle could be passed unseen between so few
LENGTH_SCALE = 0.1  # [m] of clearance that is worth as much as the whole of a limit
SHARE_AIM = 0.02  # [-] of limits, see :class:`LimitRows`
SHARE_SOFTNESS = 0.01  # [-] likewise
DISTANCE_AIM = 0.1  # [LENGTH_SCALE] likewise
WINDOW_SHARES = np.array([0.0, 0.5, 1.0])  # [-] of an obstacle's window, instants in addition
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
    for shares in problem.limit_shares:
        for quantity in shares.used.keys() - SUMMED:
            raise InputError(
                f"corrections in flight do not know limits of {quantity}",
                element=f"limits.{shares.key}",
                advice="leave it out, or fly without corrections",
            )
        of_torques = shares.key == "torque"
        # Rotors and friction that nobody measures need torques too: motors must have half to spare.
        aim = 0.5 if of_torques else SHARE_AIM
        rows.append(LimitRows(shares, aim, SHARE_SOFTNESS, of_torques=of_torques))
    return rows


def sensible_rows(plan: Plan) -> list[LimitRows]:
    """Return a bound of the accelerations of joints that the problem does not limit: a multiple of the plan's largest.

    Without it a goal that cannot be reached any more would be chased harder and harder until the landing.
    """
    problem = plan.problem
    drives = plan.robot.motor_ratios != 0
    limited_motors = np.isfinite(np.minimum(problem.motor_torque_limits, problem.motor_stall))
    limited = (~drives | limited_motors[:, None]).all(axis=0) | np.isfinite(problem.joint_limits["acceleration"])
    free = ~limited & ~np.isfinite(problem.torque_limits)
    largest = float(plan.peaks.joints["acceleration"].max())
    if not free.any() or not largest:
        return []
    row = LIMIT_TABLE["acceleration"]
    names = tuple(np.array(plan.robot.joints)[free].tolist())
    limit = np.full(len(names), 4.0 * largest)  # far beyond what corrections of small errors need
    shares = Shares(row.key, names, limit, row.unit, {row.quantity: np.eye(len(free))[free] / limit[:, None]})
    return [LimitRows(shares, SHARE_AIM, SHARE_SOFTNESS)]


def distance_rows(problem: Problem, shapes: Sequence[LinkCapsule]) -> list[LimitRows]:
    """Return the rows of all obstacles and pairs of links, measured to ``shapes``.

    Raises
    ------
    InputError
        Corrections in flight do not know a kind of obstacle.
    """
    softness = 0.02  # [LENGTH_SCALE]
    between: list[tuple[Any, float, tuple[float, float]]] = []
    for obstacle in [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]:
        if not can_write(obstacle):
            raise InputError(
                f"corrections in flight do not know obstacles of kind {obstacle.kind!r}",
                element="obstacles",
                advice="leave it out, or fly without corrections",
            )
        between.append((obstacle, obstacle.margin, obstacle.window or ALWAYS))
    for pair in problem.self_clearances:
        first = [index for index, shape in enumerate(shapes) if shape.link == pair.links[0]]
        second = [index for index, shape in enumerate(shapes) if shape.link == pair.links[1]]
        between.append(((first, second), pair.margin, ALWAYS))
    rows = []
    for shapes_between, margin, window in between:
        block = DistanceRows(shapes_between, margin, LENGTH_SCALE)
        rows.append(LimitRows(block, DISTANCE_AIM, softness, window))
    return rows


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
        nodes = gauss_grid(NODE_COUNTS[_level(plan)])
        count = _instants_needed(plan, self.flight, obstacles)
        lanes = 8  # numbers that the kernel takes at once: of instants there are a multiple
        count += -(nodes.nodes + count + len(WINDOW_SHARES) * len(self._windows)) % lanes
        self._always = nodes.also(np.linspace(0.0, 1.0, count))
        self.instants = self.between(0.0, plan.duration)

    def between(self, begin: float, end: float) -> GaussGrid:
        """Where a motion between two times, s, is evaluated, as shares of the remaining time: nodes, W more instants.

        Among these are the ends and middles of obstacles' windows.
        """
        if not len(self._windows):
            return self._always
        low, high = np.clip(self._windows, begin, end).T
        times = low[:, None] + (high - low)[:, None] * WINDOW_SHARES
        return self._always.also((times.ravel() - begin) / (end - begin))


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


def _level(plan: Plan) -> int:
    """Level of nodes that resolves theta0' of the plan well enough."""
    flight = planar_flight(plan.problem)
    # Gauss nodes integrate theta0' to about the square of the tail of its series, relative to its largest.
    largest_tail = 1e-3
    level = 0
    for level, count in enumerate(NODE_COUNTS):  # noqa: B007
        quadrature = gauss_grid(count).quadrature
        positions, velocities, _ = plan.joint_motion(quadrature.nodes * plan.duration)
        rates = flight.equations.base_rate(positions, velocities, plan.angular_momentum)
        if quadrature.tail(rates) <= largest_tail * max(float(np.abs(rates).max()), 1e-300):
            break
    return level


def _second_derivatives(form: Form) -> Array:
    """Products (m, 6+m) of the second derivatives by u of the free polynomials with those of all."""
    quadrature = gauss_grid(NODE_COUNTS[-1] if form.width > 20 else 48).quadrature
    second = basis(form).values(quadrature.nodes)[2]
    return np.asarray(second[:, CONDITIONS:].T @ (quadrature.weights[:, None] * second))
