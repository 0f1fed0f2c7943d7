"""What must hold during the flight, as blocks of inequalities: values, exact Jacobians, labels and units.

A block has r rows at each of K instants; a row holds where its value is at least zero. Values are divided by the
block's ``scale``, so that 1 is much in every row. Joint ranges need no block: they hold by construction of (12).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, BoolArray
from floatplan.kernel.constraints import Block, ObstacleRows, PairRows, SumRows
from floatplan.planning.transcription.trajectory import QUANTITIES, FlightModel, Trajectory
from floatplan.planning.transcription.variables import AtEnds
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import CLEARANCE, JOINT_LIMITS, LIMIT_TABLE, RELATIVE, LimitKey

LENGTH_SCALE = 0.1  # [m] of clearance, worth as much as the whole of a torque or rate limit

Window: TypeAlias = tuple[float, float]  # fractions of the flight, within [0, 1], both included
ALWAYS: Window = (0.0, 1.0)
Pairs: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]  # indices of capsules: every first one with every second


@dataclass(frozen=True, eq=False, kw_only=True)
class Constraint(ABC):
    """A block of inequalities, with all that the search and its explanations need to know of it.

    Attributes
    ----------
    labels : name (r,) of each row, for a person
    unit : of value times scale
    scale : natural units per unit of the value (r,)
    tolerance : what a value may be below zero where the row counts as kept: the certificate's tolerance
    relaxed : what would have to be for a violated row to be kept, of its ``{label}`` and an ``{amount}``
    cause : why a row can be violated at an ``{end}`` already, the "start" or the "goal"
    window : between which instants the block applies
    """

    labels: tuple[str, ...]
    unit: str
    scale: Array
    tolerance: float
    relaxed: str
    cause: str
    window: Window = ALWAYS

    @property
    @abstractmethod
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """On what, beside the posture, the values at takeoff and landing depend."""

    @abstractmethod
    def values(self, trajectory: Trajectory) -> Array:
        """Values (K, r)."""

    @abstractmethod
    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size) of the values by x."""

    def compiled(self) -> Block | None:
        """Return the rows as the kernel computes them; None for a block that it does not know."""
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class Clearance(Constraint):
    """Distances of links to an obstacle, (19)-(23), or between capsules, by their indices, less a ``margin``, m.

    Holds: for all t in the obstacle's window, by exchange of instants.
    """

    between: Obstacle | Pairs
    margin: float

    @property
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """On nothing else."""
        return frozenset()

    def values(self, trajectory: Trajectory) -> Array:
        """Distances less the margin (K, r)."""
        flown, between = trajectory.flown, self.between
        if isinstance(between, Obstacle):
            return (flown.obstacle_distances(between) - self.margin) / LENGTH_SCALE
        return (flown.pair_distances(*between) - self.margin) / LENGTH_SCALE

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        flown, between = trajectory.differentiable, self.between
        if isinstance(between, Obstacle):
            return trajectory.jacobian(flown.obstacle_partials(between)) / LENGTH_SCALE
        return trajectory.jacobian(flown.pair_partials(*between)) / LENGTH_SCALE

    def compiled(self) -> Block:
        """Return the same distances."""
        if isinstance(self.between, Obstacle):
            return ObstacleRows(self.between, self.margin, LENGTH_SCALE)
        return PairRows(*self.between, self.margin, LENGTH_SCALE)


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit(Constraint):
    """``1 - sum of weights @ quantity >= 0``: no more than the whole of a limit is used.

    Holds: for all t, by exchange of instants. ``weights`` (r, m) are of quantities by their names: a motor's torque or
    a joint's rate on its own, the torque of a leader and its followers together, or a motor's torque and rate.
    """

    weights: Mapping[str, Array]

    @property
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """As of the quantities."""
        return frozenset[AtEnds]().union(*(QUANTITIES[name].depends_at_ends_on for name in self.weights))

    def values(self, trajectory: Trajectory) -> Array:
        """What is left of the limits (K, r), as shares of them."""
        used = [QUANTITIES[name].values(trajectory) @ weights.T for name, weights in self.weights.items()]
        return np.asarray(1 - sum(used[1:], used[0]))

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        used = [weights @ QUANTITIES[name].jacobian(trajectory) for name, weights in self.weights.items()]
        return -sum(used[1:], used[0])

    def compiled(self) -> Block:
        """Return the same sums."""
        return SumRows(np.ones(len(self.labels)), {name: -weights for name, weights in self.weights.items()})


def obstacle_clearance(obstacle: Obstacle, name: str, links: Sequence[str], window: Window = ALWAYS) -> Clearance:
    """Return the distances of the links measured to an obstacle, less its margin."""
    return Clearance(
        labels=tuple(f"clearance of {link} to {name}" for link in links),
        **_of_clearances(len(links), "the obstacle covers the {end} posture"),
        between=obstacle,
        margin=obstacle.margin,
        window=window,
    )


def link_clearance(first: tuple[int, ...], second: tuple[int, ...], names: tuple[str, str], margin: float) -> Clearance:
    """Return the distances between the capsules of two links, one row for each pair, less a margin, m."""
    count = len(first) * len(second)
    return Clearance(
        labels=(f"clearance of {names[0]} to {names[1]}",) * count,
        **_of_clearances(count, "it follows from the {end}'s positions"),
        between=(first, second),
        margin=margin,
    )


def _of_clearances(rows: int, cause: str) -> dict[str, Any]:
    shared = {"unit": "m", "tolerance": CLEARANCE / LENGTH_SCALE, "relaxed": "the {label} {amount} smaller"}
    return {"scale": np.full(rows, LENGTH_SCALE), "cause": cause, **shared}


def magnitude_limit(quantity: str, names: tuple[str, ...], combinations: Array, limit: Array, unit: str) -> Limit:
    """Return ``|combinations @ quantity| <= limit``, upper limits before lower ones; combinations are (r, m)."""
    weights = combinations / limit[:, None]
    return _limit(names * 2, {quantity: np.concatenate((weights, -weights))}, np.tile(limit, 2), unit)


def motor_limit(names: tuple[str, ...], selection: Array, ratios: Array, stall: Array, slope: Array) -> Limit:
    """Return ``|torque| + slope |velocity| <= stall`` of r motors, as the four combinations of signs.

    The ``selection`` (r, m) takes them from all motors; ``ratios`` (r, n) are the derivatives of their positions by the
    planned ones.
    """
    torque, drag = selection / stall[:, None], (slope / stall)[:, None] * ratios
    weights = {
        "motor_torques": np.concatenate((torque, torque, -torque, -torque)),
        "velocities": np.concatenate((drag, -drag, drag, -drag)),
    }
    return _limit(tuple(f"speed-dependent torque of {name}" for name in names * 4), weights, np.tile(stall, 4), "N m")


def _limit(labels: tuple[str, ...], weights: Mapping[str, Array], scale: Array, unit: str) -> Limit:
    wish, cause = "the limit on the {label} {amount} higher", "it follows from the {end}'s rates and accelerations"
    return Limit(labels=labels, unit=unit, scale=scale, tolerance=RELATIVE, relaxed=wish, cause=cause, weights=weights)


def constraints(problem: Problem, model: FlightModel) -> tuple[Constraint, ...]:
    """All constraints that a problem asks for and that need watching."""
    flight = model.flight
    named = [(f"obstacle {index} ({each.kind})", each) for index, each in enumerate(problem.obstacles)]
    if problem.ground:
        named.append(("the ground", problem.ground_plane))
    blocks: list[Constraint] = []
    for name, obstacle in named:
        window = _window(obstacle, problem.flight.duration)
        blocks.append(obstacle_clearance(obstacle, name, flight.links_measured(obstacle), window))
    for pair in problem.self_clearances:
        first, second = (tuple(i for i, link in enumerate(flight.links) if link == name) for name in pair.links)
        blocks.append(link_clearance(first, second, pair.links, pair.margin))
    return (*blocks, *_limits(problem, flight.tangent))


def _window(obstacle: Obstacle, duration: float) -> Window:
    """The window of an obstacle, as far as the flight lasts."""
    if obstacle.window is None:
        return ALWAYS
    low, high = obstacle.window
    return max(low / duration, 0.0), min(high / duration, 1.0)


def _limits(problem: Problem, tangent: int) -> Iterator[Limit]:
    """Limits of the motors' own torques, of generalised ones where these do not imply them, of rates, and of motors."""
    robot, own, generalized = problem.robot, problem.motor_torque_limits, problem.torque_limits
    yield from _magnitudes("torque", "torque", robot.motors, own)
    if np.isfinite(generalized).any():
        implied = ((robot.motor_ratios == 0) | np.isfinite(own)[:, None]).all(axis=0)
        limits = np.where(implied, np.inf, generalized)
        yield from _magnitudes("torque", "generalized torque", robot.joints, limits, robot.motor_ratios.T)
    for row in JOINT_LIMITS:
        yield from _magnitudes(row.key, row.key, robot.joints, problem.joint_limits[row.key])
    limited = np.flatnonzero(np.isfinite(problem.motor_stall))
    if limited.size:
        names, selection = tuple(robot.motors[i] for i in limited), np.eye(len(robot.motors))[limited]
        stall, slope = problem.motor_stall[limited], problem.motor_slope[limited]
        yield motor_limit(names, selection, robot.motor_ratios[limited], stall, slope)
    if problem.limits.orientation_rate is not None:
        row, rates = LIMIT_TABLE["orientation_rate"], np.full(tangent, problem.limits.orientation_rate)
        yield magnitude_limit(row.quantity, ("orientation rate",) * tangent, np.eye(tangent), rates, row.unit)


def _magnitudes(
    key: LimitKey, what: str, subjects: Sequence[str], limits: Array, combinations: Array | None = None
) -> Iterator[Limit]:
    """The subjects' own quantities, or combinations (r, m) of them, that have a finite limit (r,), as one block."""
    limited = np.flatnonzero(np.isfinite(limits))
    if limited.size:
        row, names = LIMIT_TABLE[key], tuple(f"{what} of {subjects[i]}" for i in limited.tolist())
        rows = np.eye(len(limits)) if combinations is None else combinations
        yield magnitude_limit(row.quantity, names, rows[limited], limits[limited], row.unit)


def applies(block: Constraint, s: Array) -> BoolArray:
    """Whether (K,) a block applies at instants (K,) of [0, 1]."""
    low, high = block.window
    return np.asarray((s >= low) & (s <= high))


def window_ends(blocks: Iterable[Constraint]) -> tuple[float, ...]:
    """Ends of the blocks' windows, rising, the ends of the flight left out."""
    return tuple(sorted({end for block in blocks for end in block.window if end not in ALWAYS}))
