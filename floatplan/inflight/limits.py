"""What must hold for the rest of a flight: rows of the problem's limits.

A row is kept where its value is at least zero: one minus the share of a limit that is used, or a clearance less its
margin over ``LENGTH_SCALE``, as in the planner's constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError
from floatplan.kernel.watch import can_write
from floatplan.motion.dynamics import Distances
from floatplan.motion.planar.clearance import Segments, obstacle_distances, pair_distances
from floatplan.motion.planar.flight import PlanarBaseMotion
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import LinkCapsule
from floatplan.tables import JOINT_LIMITS

SENSIBLE = 4.0  # [-] of the plan's largest acceleration: the most that corrections ask of joints without limits
LENGTH_SCALE = 0.1  # [m] of clearance that is worth as much as the whole of a limit
RATES = ("velocities", "accelerations", "orientation_rate")  # what :class:`JointRows` knows
ROUNDING = 1e-9  # [s] of instants at the ends of a window


class Ahead(Protocol):
    """The rest of a flight: at K instants, the last W of which are watched for distances."""

    @property
    def flown(self) -> PlanarBaseMotion:
        """How the base turns."""

    @property
    def watched(self) -> Array:
        """Times (W,), s since takeoff."""

    @property
    def shapes(self) -> Segments:
        """The links' shapes at these."""


class Rows(Protocol):
    """A block of rows at the last instants of a flight ahead: all K, or the W watched ones."""

    @property
    def aim(self) -> float:
        """Value that corrections aim at, above zero."""

    @property
    def softness(self) -> float:
        """By how much a row may miss its aim where the landing may miss the goal by sigma."""

    def values(self, ahead: Ahead) -> Array:
        """Values (K, r) or (W, r)."""


class Shares:
    """One minus the share of a limit that is used: what corrections aim at, and how softly."""

    aim: float = 0.02
    softness: float = 0.01


@dataclass(frozen=True, eq=False)
class JointRows(Shares):
    """``1 - |rate| / limit`` of velocities, accelerations or the base's rate; ``limited`` (r,) are indices."""

    quantity: str
    limited: IntArray
    limit: Array

    def values(self, ahead: Ahead) -> Array:
        """Values (K, r)."""
        return np.asarray(1 - np.abs(self._quantity(ahead.flown)[:, self.limited]) / self.limit)

    def _quantity(self, flown: PlanarBaseMotion) -> Array:
        if self.quantity == "orientation_rate":
            return flown.rate
        return flown.joints.velocities if self.quantity == "velocities" else flown.joints.accelerations


@dataclass(frozen=True, eq=False)
class TorqueRows(Shares):
    """``1 - (|torque| + slope |rate|) / limit`` of torques that turn the bodies by ``turns`` (m, r).

    ``ratios`` (r, n) are the derivatives of the motors' positions by the planned ones.
    """

    turns: Array
    ratios: Array
    limit: Array
    slope: Array

    def values(self, ahead: Ahead) -> Array:
        """Values (K, r)."""
        flown = ahead.flown
        used = np.abs(flown.moments @ self.turns)
        if self._fades:
            used += self.slope * np.abs(flown.joints.velocities @ self.ratios.T)
        return np.asarray(1 - used / self.limit)

    @cached_property
    def _fades(self) -> bool:
        """Whether the rate counts."""
        return bool(self.slope.any())


@dataclass(frozen=True, eq=False)
class DistanceRows:
    """Distances of all capsules to an obstacle, or between the capsules of two links, given by their indices.

    Less a margin, over ``LENGTH_SCALE``; at the instants of the window, s.
    """

    of: Obstacle | tuple[IntArray, IntArray]
    margin: float
    window: tuple[float, float]
    aim: float = 0.1
    softness: float = 0.02

    def _measured(self, shapes: Segments, times: Array) -> Distances:
        if isinstance(self.of, Obstacle):
            return obstacle_distances(shapes, self.of, times)
        first, second = self.of
        return pair_distances(shapes.of(first), shapes.of(second))

    def values(self, ahead: Ahead) -> Array:
        """Values (W, r); infinite outside of the window."""
        times = ahead.watched
        values = (self._measured(ahead.shapes, times).values - self.margin) / LENGTH_SCALE
        low, high = self.window
        if low > -np.inf or high < np.inf:
            values[(times < low - ROUNDING) | (times > high + ROUNDING)] = np.inf
        return values


def limit_rows(problem: Problem) -> tuple[Rows, ...]:
    """Return the rows of all limits of a problem but distances; joint ranges need none."""
    return (*_torque_rows(problem), *_joint_rows(problem))


def sensible_rows(plan: Plan) -> tuple[Rows, ...]:
    """Return a bound of the accelerations of joints that the problem does not limit: a multiple of the plan's largest.

    Without it a goal that cannot be reached any more would be chased harder and harder until the landing.
    """
    problem, ratios = plan.problem, plan.robot.motor_ratios != 0
    held = np.isfinite(np.minimum(problem.motor_torque_limits, problem.motor_stall))
    limited = (~ratios | held[:, None]).all(axis=0) | np.isfinite(problem.joint_limits["acceleration"])
    free = np.flatnonzero(~limited & ~np.isfinite(problem.torque_limits))
    largest = float(plan.peaks.joints["acceleration"].max())
    if not free.size or not largest:
        return ()
    return (JointRows("accelerations", free, np.full(free.size, SENSIBLE * largest)),)


def distance_rows(problem: Problem, shapes: Sequence[LinkCapsule]) -> list[Rows]:
    """Return the rows of all obstacles and pairs of links, measured to ``shapes``."""
    obstacles = [*problem.obstacles, *([problem.ground_plane] if problem.ground else [])]
    for obstacle in obstacles:
        if not can_write(obstacle):
            raise InputError(
                f"corrections in flight do not know obstacles of kind {obstacle.kind!r}",
                element="obstacles",
                advice="leave it out, or fly without corrections",
            )
    blocks: list[Rows] = [
        DistanceRows(piece, obstacle.margin, obstacle.window or (-np.inf, np.inf))
        for obstacle in obstacles
        for piece in obstacle.pieces
    ]
    links = [shape.link for shape in shapes]
    for pair in problem.self_clearances:
        first, second = (np.flatnonzero([link == name for link in links]) for name in pair.links)
        blocks.append(DistanceRows((first, second), pair.margin, (-np.inf, np.inf)))
    return blocks


def _torque_rows(problem: Problem) -> list[Rows]:
    """Each motor's own torque, alone and with its rate; generalised ones where they have a limit of their own."""
    robot = problem.robot
    still = np.zeros(len(robot.motors))
    blocks = [
        (robot.tree.motor_turns, robot.motor_ratios, problem.motor_torque_limits, still),
        (robot.tree.motor_turns, robot.motor_ratios, problem.motor_stall, problem.motor_slope),
        (robot.tree.turns, np.eye(len(robot.joints)), _generalized_limits(problem), np.zeros(len(robot.joints))),
    ]
    rows: list[Rows] = []
    for turns, ratios, limit, slope in blocks:
        limited = np.flatnonzero(np.isfinite(limit))
        if limited.size:
            rows.append(TorqueRows(turns[:, limited], ratios[limited], limit[limited], slope[limited]))
    return rows


def _generalized_limits(problem: Problem) -> Array:
    """Limits (n,) of the generalised torques; infinite where the motors' own imply them."""
    robot, own = problem.robot, np.isfinite(problem.motor_torque_limits)
    implied = ((robot.motor_ratios == 0) | own[:, None]).all(axis=0)
    return np.where(implied, np.inf, problem.torque_limits)


def _joint_rows(problem: Problem) -> list[Rows]:
    limits = {row.quantity: problem.joint_limits[row.key] for row in JOINT_LIMITS}
    if problem.limits.orientation_rate is not None:
        limits["orientation_rate"] = np.array([problem.limits.orientation_rate])
    finite = {quantity: np.flatnonzero(np.isfinite(limit)) for quantity, limit in limits.items()}
    for row in JOINT_LIMITS:
        if row.quantity not in RATES and finite[row.quantity].size:
            raise InputError(
                f"corrections in flight do not know limits of {row.quantity}",
                element=f"limits.{row.key}",
                advice="leave it out, or fly without corrections",
            )
    return [JointRows(name, rows, limits[name][rows]) for name, rows in finite.items() if rows.size]
