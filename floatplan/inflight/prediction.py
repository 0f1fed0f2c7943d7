"""Where the remaining flight is evaluated: instants, and rows of the problem's limits.

A row is satisfied where its value is at least zero: one minus the share of a limit that is used, or a clearance less
its margin over ``LENGTH_SCALE``, as in the planner's constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, indices_of
from floatplan.errors import InputError
from floatplan.inflight.planar import InPlane
from floatplan.inflight.spatial import InSpace
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import PlanarFlight, flight_of, gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.motion.sine_polynomial import Form, basis
from floatplan.planning.constraints import LENGTH_SCALE
from floatplan.planning.kernel_input.rows import SUMMED, Block, DistanceRows, can_write
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Wall
from floatplan.problem.problem import Problem, Shares
from floatplan.problem.spatial_obstacles import SpatialObstacle
from floatplan.tables import LIMIT_TABLE

SHARE_AIM = 0.02  # [-] of limits, see :class:`LimitRows`
SHARE_SOFTNESS = 0.01  # [-] likewise
DISTANCE_AIM = 0.1  # [LENGTH_SCALE] likewise
WINDOW_SHARES = np.array([0.0, 0.5, 1.0])  # [-] of an obstacle's window, instants in addition
ALWAYS = (-np.inf, np.inf)
Flying: TypeAlias = InPlane | InSpace


@dataclass(frozen=True, eq=False)
class LimitRows:
    """A block of rows that applies within a window, s since takeoff.

    Corrections aim at row values of ``aim``. A shortfall of ``softness`` costs as much as a miss of sigma. Where the
    plan's own motion has less, the aim is that: for torques its least over the flight, else its value at landing.
    """

    block: Block
    aim: float
    softness: float
    window: tuple[float, float] = ALWAYS
    of_torques: bool = False

    def as_planned(self, values: Array, landing: int) -> LimitRows:
        """Return the same with that aim, for values (rows, K) of the plan's motion; it lands in column ``landing``."""
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


def acceleration_bounds(plan: Plan) -> list[LimitRows]:
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


def distance_rows(problem: Problem, links: Sequence[str]) -> list[LimitRows]:
    """Return the rows of all obstacles and pairs of links, measured to shapes of these ``links``.

    Raises
    ------
    InputError
        Corrections in flight do not know a kind of obstacle.
    """
    between: list[tuple[Any, float, tuple[float, float]]] = []
    for obstacle in [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]:
        if not (can_write(obstacle) or isinstance(obstacle, SpatialObstacle)):
            raise InputError(
                f"corrections in flight do not know obstacles of kind {obstacle.kind!r}",
                element="obstacles",
                advice="leave it out, or fly without corrections",
            )
        between.append((obstacle, obstacle.margin, obstacle.window or ALWAYS))
    for pair in problem.self_clearances:
        first, second = pair.links
        between.append(((indices_of(first, links), indices_of(second, links)), pair.margin, ALWAYS))
    rows = []
    for shapes_between, margin, window in between:
        block = DistanceRows(shapes_between, margin, LENGTH_SCALE)
        # A foot that catches on the ground trips the robot, and feet follow their reference to 1 or 2 cm: corrections
        # aim at 4 cm there. With aim and softness by the same factor, touching costs as much as with other obstacles.
        is_ground = isinstance(shapes_between, Wall) and shapes_between.is_level
        factor = 4.0 if is_ground else 1.0
        softness = 0.02 * factor  # [LENGTH_SCALE]
        rows.append(LimitRows(block, DISTANCE_AIM * factor, softness, window))
    return rows


class Views:
    """Instants and rows of a plan's flight.

    Changes y (m, n) of the free polynomials, ``whitening @ y / amplitude`` of their coefficients, are in rad and make a
    second derivative of the positions by u whose root mean square is at most ``|y|``. Of all coefficients (6+m, n) of
    a difference of motions, ``amplitude * unwhitening @`` these is the y that comes nearest to its second derivative.
    """

    def __init__(self, plan: Plan, form: Form) -> None:
        problem = plan.problem
        obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
        kind = InPlane if isinstance(flight_of(problem), PlanarFlight) else InSpace
        self.flying: Flying = kind(plan, obstacles)
        distances = distance_rows(problem, self.flying.links)
        self.has_distances = bool(distances)
        self.rows = [*distances, *limit_rows(problem), *acceleration_bounds(plan)]
        self._windows = np.array([obstacle.window for obstacle in obstacles if obstacle.window is not None])
        self.functions = basis(form)
        products = _second_derivatives(form)
        self.whitening = np.linalg.inv(np.linalg.cholesky(products[:, CONDITIONS:])).T
        self.unwhitening = self.whitening.T @ products
        self._duration = plan.duration
        self.grids: list[tuple[float, Any]] = [(share, self._filled(grid)) for share, grid in self.flying.grids]
        self.instants = self.between(0.0, plan.duration)

    def _filled(self, nodes: Any) -> Any:
        """A grid of nodes with the instants in addition, so many that with all windows there are a multiple of 8."""
        count = self.flying.instants
        lanes = 8  # numbers that the kernel takes at once
        count += -(nodes.nodes + count + len(WINDOW_SHARES) * len(self._windows)) % lanes
        return nodes.also(np.linspace(0.0, 1.0, count))

    def between(self, begin: float, end: float) -> Any:
        """Where a motion between two times, s, is evaluated, as shares of the remaining time: nodes, W more instants.

        Among these are the ends and middles of obstacles' windows.
        """
        share = (end - begin) / self._duration
        grid = self.grids[0][1]
        for most, coarser in self.grids:
            if share <= most:
                grid = coarser
        if not len(self._windows):
            return grid
        low, high = np.clip(self._windows, begin, end).T
        times = low[:, None] + (high - low)[:, None] * WINDOW_SHARES
        return grid.also((times.ravel() - begin) / (end - begin))


def _second_derivatives(form: Form) -> Array:
    """Products (m, 6+m) of the second derivatives by u of the free polynomials with those of all."""
    quadrature = gauss_grid(NODE_COUNTS[-1] if form.width > 20 else 48).quadrature
    second = basis(form).values(quadrature.nodes)[2]
    return np.asarray(second[:, CONDITIONS:].T @ (quadrature.weights[:, None] * second))
