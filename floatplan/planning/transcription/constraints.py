"""What must hold during the flight, as blocks of inequalities: values, exact Jacobians, labels and units.

A block has r rows at each of K instants; a row holds where its value is at least zero. Values are divided by the
block's ``scale``, so that 1 is much in every row. Joint ranges need no block: they hold by construction of (12).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from floatplan.arrays import Array, BoolArray
from floatplan.motion.planar.clearance import Distances, obstacle_distances, pair_distances
from floatplan.planning.transcription.trajectory import FlightModel, Trajectory
from floatplan.problem.parts import HalfPlane, Obstacle
from floatplan.problem.problem import Problem
from floatplan.tolerances import CLEARANCE, RELATIVE

LENGTH_SCALE = 0.1  # m: a clearance that is worth as much as the whole of a torque or rate limit


Window: TypeAlias = tuple[float, float]  # fractions of the flight, within [0, 1], both included
ALWAYS: Window = (0.0, 1.0)


class Constraint(Protocol):
    """A block of inequalities.

    Attributes
    ----------
    labels : (r,) names for a person
    unit : of ``value * scale``
    scale : (r,)
    tolerance : of a value
    window : instants between which the block applies
    """

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each row."""

    @property
    def unit(self) -> str:
        """Unit of value times scale."""

    @property
    def scale(self) -> Array:
        """Natural units per unit of the value (r,)."""

    @property
    def tolerance(self) -> float:
        """What a value may be below zero where the row counts as kept: the certificate's tolerance."""

    @property
    def window(self) -> Window:
        """Between which instants the block applies."""

    def values(self, trajectory: Trajectory) -> Array:
        """Values (K, r)."""

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size) of the values by x."""


def is_settled_at_ends(block: Constraint) -> bool:
    """Whether the states at takeoff and landing settle its values there; torques and theta0' depend on h besides."""
    return isinstance(block, ObstacleClearance | SelfClearance | VelocityLimit)


@dataclass(frozen=True, eq=False)
class ObstacleClearance:
    """Distance of every link to an obstacle, less its margin, (19)-(23).

    Holds: for all t in the obstacle's window, by exchange of instants.
    """

    obstacle: Obstacle
    name: str
    links: tuple[str, ...]
    window: Window = ALWAYS
    unit: str = "m"
    tolerance: float = CLEARANCE / LENGTH_SCALE

    @property
    def labels(self) -> tuple[str, ...]:
        """One row per link's capsule; for a half-plane one per end of it."""
        ends = 2 if isinstance(self.obstacle, HalfPlane) else 1
        return tuple(f"clearance of {link} to {self.name}" for link in self.links * ends)

    @property
    def scale(self) -> Array:
        """Metres per unit."""
        return np.full(len(self.labels), LENGTH_SCALE)

    def values(self, trajectory: Trajectory) -> Array:
        """Distances less the margin (K, r)."""
        return (self._distances(trajectory).values - self.obstacle.margin) / LENGTH_SCALE

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        return trajectory.angle_jacobian(self._distances(trajectory).by_angle / LENGTH_SCALE)

    def _distances(self, trajectory: Trajectory) -> Distances:
        if self not in trajectory.distances:
            trajectory.distances[self] = obstacle_distances(trajectory.segments, self.obstacle, trajectory.times)
        return trajectory.distances[self]


@dataclass(frozen=True, eq=False)
class SelfClearance:
    """Distance between the shapes of two links, less a margin. Holds: for all t, by exchange of instants."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    names: tuple[str, str]
    margin: float
    window: Window = ALWAYS
    unit: str = "m"
    tolerance: float = CLEARANCE / LENGTH_SCALE

    @property
    def labels(self) -> tuple[str, ...]:
        """One row per pair of capsules."""
        return (f"clearance of {self.names[0]} to {self.names[1]}",) * (len(self.first) * len(self.second))

    @property
    def scale(self) -> Array:
        """Metres per unit."""
        return np.full(len(self.labels), LENGTH_SCALE)

    def values(self, trajectory: Trajectory) -> Array:
        """Distances less the margin (K, r)."""
        return (self._distances(trajectory).values - self.margin) / LENGTH_SCALE

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        return trajectory.angle_jacobian(self._distances(trajectory).by_angle / LENGTH_SCALE)

    def _distances(self, trajectory: Trajectory) -> Distances:
        if self not in trajectory.distances:
            segments = trajectory.segments
            first, second = segments.of(np.array(self.first)), segments.of(np.array(self.second))
            trajectory.distances[self] = pair_distances(first, second)
        return trajectory.distances[self]


@dataclass(frozen=True, eq=False)
class TorqueLimit:
    """``|torque| <= limit``, two rows for each of r torques. Holds: for all t, by exchange of instants.

    A torque is ``ratios @ motor torques``, with ``ratios`` (r, motors): a motor's own, or that of a leader and its
    followers together.
    """

    names: tuple[str, ...]
    ratios: Array
    limit: Array
    window: Window = ALWAYS
    unit: str = "N m"
    tolerance: float = RELATIVE

    @property
    def labels(self) -> tuple[str, ...]:
        """Upper limits, then lower ones."""
        return self.names * 2

    @property
    def scale(self) -> Array:
        """The limits."""
        return np.tile(self.limit, 2)

    def values(self, trajectory: Trajectory) -> Array:
        """``1 -+ torque / limit`` (K, r)."""
        relative = (trajectory.motor_torques @ self.ratios.T) / self.limit
        return np.concatenate((1 - relative, 1 + relative), axis=1)

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        relative = (self.ratios / self.limit[:, None]) @ trajectory.motor_torque_jacobian
        return np.concatenate((-relative, relative), axis=1)


@dataclass(frozen=True, eq=False)
class MotorLimit:
    """``|torque| + slope |velocity| <= stall`` of each motor, as four rows. Holds: for all t, by exchange of instants.

    ``motors`` are indices, ``ratios`` (r, n) the derivatives of their positions by the planned ones.
    """

    motors: tuple[int, ...]
    names: tuple[str, ...]
    ratios: Array
    stall: Array
    slope: Array
    window: Window = ALWAYS
    unit: str = "N m"
    tolerance: float = RELATIVE

    @property
    def labels(self) -> tuple[str, ...]:
        """The four combinations of signs, one after the other."""
        return tuple(f"speed-dependent torque of {name}" for name in self.names * 4)

    @property
    def scale(self) -> Array:
        """Stall torques."""
        return np.tile(self.stall, 4)

    def values(self, trajectory: Trajectory) -> Array:
        """``1 - (+-torque +- slope velocity) / stall`` (K, r)."""
        torque = trajectory.motor_torques[:, list(self.motors)] / self.stall
        drag = self.slope * (trajectory.motion.velocities @ self.ratios.T) / self.stall
        return 1 - np.concatenate((torque + drag, torque - drag, -torque + drag, -torque - drag), axis=1)

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        torque = trajectory.motor_torque_jacobian[:, list(self.motors)] / self.stall[:, None]
        drag = ((self.slope / self.stall)[:, None] * self.ratios) @ trajectory.velocity_jacobian
        return -np.concatenate((torque + drag, torque - drag, -torque + drag, -torque - drag), axis=1)


@dataclass(frozen=True, eq=False)
class VelocityLimit:
    """``|velocity| <= limit`` of the joints that have one, two rows each. Holds: for all t, by exchange of instants."""

    joints: tuple[int, ...]
    names: tuple[str, ...]
    limit: Array
    window: Window = ALWAYS
    unit: str = "rad/s"
    tolerance: float = RELATIVE

    @property
    def labels(self) -> tuple[str, ...]:
        """Upper limits, then lower ones."""
        return tuple(f"velocity of {name}" for name in self.names * 2)

    @property
    def scale(self) -> Array:
        """The limits."""
        return np.tile(self.limit, 2)

    def values(self, trajectory: Trajectory) -> Array:
        """``1 -+ velocity / limit`` (K, r)."""
        relative = trajectory.motion.velocities[:, list(self.joints)] / self.limit
        return np.concatenate((1 - relative, 1 + relative), axis=1)

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        relative = trajectory.velocity_jacobian[:, list(self.joints)] / self.limit[:, None]
        return np.concatenate((-relative, relative), axis=1)


@dataclass(frozen=True, eq=False)
class OrientationRateLimit:
    """``|theta0'| <= limit``, as two rows. Holds: for all t, by exchange of instants."""

    limit: float
    window: Window = ALWAYS
    unit: str = "rad/s"
    tolerance: float = RELATIVE

    @property
    def labels(self) -> tuple[str, ...]:
        """Upper limit, then lower one."""
        return ("orientation rate",) * 2

    @property
    def scale(self) -> Array:
        """The limit."""
        return np.full(2, self.limit)

    def values(self, trajectory: Trajectory) -> Array:
        """``1 -+ theta0' / limit`` (K, 2)."""
        relative = trajectory.rate / self.limit
        return np.stack((1 - relative, 1 + relative), axis=1)

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        relative = trajectory.base_rate_jacobian / self.limit
        return np.stack((-relative, relative), axis=1)


def applies(block: Constraint, s: Array) -> BoolArray:
    """Whether (K,) a block applies at instants (K,) of [0, 1]."""
    low, high = block.window
    return np.asarray((s >= low) & (s <= high))


def window_ends(blocks: Iterable[Constraint]) -> tuple[float, ...]:
    """Ends of the blocks' windows, rising, the ends of the flight left out."""
    return tuple(sorted({end for block in blocks for end in block.window if end not in ALWAYS}))


def _window(obstacle: Obstacle, duration: float) -> Window:
    """The window of an obstacle, as far as the flight lasts."""
    if obstacle.window is None:
        return ALWAYS
    low, high = obstacle.window
    return max(low / duration, 0.0), min(high / duration, 1.0)


def constraints(problem: Problem, model: FlightModel) -> tuple[Constraint, ...]:
    """All constraints of a problem that need watching."""
    names = problem.robot.joints
    blocks: list[Constraint] = [
        ObstacleClearance(
            obstacle,
            f"obstacle {index} ({obstacle.kind})",
            model.flight.links,
            _window(obstacle, problem.flight.duration),
        )
        for index, obstacle in enumerate(problem.obstacles)
    ]
    if problem.ground:
        blocks.append(ObstacleClearance(problem.ground_plane, "the ground", model.flight.links))
    for pair in problem.self_clearances:
        first, second = (
            tuple(index for index, link in enumerate(model.flight.links) if link == name) for name in pair.links
        )
        blocks.append(SelfClearance(first, second, pair.links, pair.margin))
    blocks += _torque_limits(problem)
    limited = np.flatnonzero(np.isfinite(problem.velocity_limits))
    if limited.size:
        limits = problem.velocity_limits[limited]
        blocks.append(VelocityLimit(tuple(limited.tolist()), tuple(names[i] for i in limited), limits))
    blocks += _motor_limits(problem)
    if problem.limits.orientation_rate is not None:
        blocks.append(OrientationRateLimit(problem.limits.orientation_rate))
    return tuple(blocks)


def _torque_limits(problem: Problem) -> Iterator[TorqueLimit]:
    """Limits of the motors' own torques; and of generalised ones, where the motors' own do not imply them."""
    robot = problem.robot
    own = np.isfinite(problem.motor_torque_limits)
    if own.any():
        names = tuple(f"torque of {robot.motors[i]}" for i in np.flatnonzero(own))
        yield TorqueLimit(names, np.eye(len(own))[own], problem.motor_torque_limits[own])
    implied = ((robot.motor_ratios == 0) | own[:, None]).all(axis=0)
    together = np.isfinite(problem.torque_limits) & ~implied
    if together.any():
        names = tuple(f"generalized torque of {robot.joints[i]}" for i in np.flatnonzero(together))
        yield TorqueLimit(names, robot.motor_ratios.T[together], problem.torque_limits[together])


def _motor_limits(problem: Problem) -> Iterator[MotorLimit]:
    robot = problem.robot
    limited = np.flatnonzero(np.isfinite(problem.motor_stall))
    if limited.size:
        names = tuple(robot.motors[i] for i in limited)
        stall, slope = problem.motor_stall[limited], problem.motor_slope[limited]
        yield MotorLimit(tuple(limited.tolist()), names, robot.motor_ratios[limited], stall, slope)
