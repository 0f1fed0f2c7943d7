"""What must hold during the flight, as blocks of inequalities: values, exact Jacobians, labels and units.

A block has r rows at each of K instants; a row holds where its value is at least zero. Values are divided by the
block's ``scale``, so that 1 is much in every row. Joint ranges need no block: they hold by construction of (12).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from floatplan.arrays import Array, BoolArray
from floatplan.motion.dynamics import Distances
from floatplan.planning.transcription.quantities import EVERYTHING, Quantity
from floatplan.planning.transcription.trajectory import Trajectory
from floatplan.planning.transcription.variables import AtEnds
from floatplan.problem.parts import Obstacle
from floatplan.tables import CLEARANCE, RELATIVE

LENGTH_SCALE = 0.1  # m: a clearance that is worth as much as the whole of a torque or rate limit


Window: TypeAlias = tuple[float, float]  # fractions of the flight, within [0, 1], both included
ALWAYS: Window = (0.0, 1.0)


class Constraint(Protocol):
    """A block of inequalities, with all that the search and its explanations need to know of it."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Name (r,) of each row, for a person."""

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

    @property
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """On what, beside the posture, the values at takeoff and landing depend."""

    def values(self, trajectory: Trajectory) -> Array:
        """Values (K, r)."""

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size) of the values by x."""

    def relaxed(self, row: int, amount: str) -> str:
        """What would have to be, for a person, for a row to be kept that is violated by an amount."""

    def cause_at(self, end: str) -> str:
        """Why a row can be violated at the "start" or the "goal" already, for a person."""


class Clearance(ABC):
    """Distances between surfaces, less a margin; they are measured once per trajectory."""

    unit = "m"
    tolerance = CLEARANCE / LENGTH_SCALE
    depends_at_ends_on: frozenset[AtEnds] = frozenset()

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """Name (r,) of each row, for a person."""

    @property
    @abstractmethod
    def least(self) -> float:
        """Least distance wanted, m."""

    @abstractmethod
    def measure(self, trajectory: Trajectory) -> Distances:
        """Distances (K, r), m, with their derivatives."""

    @property
    def scale(self) -> Array:
        """Metres per unit."""
        return np.full(len(self.labels), LENGTH_SCALE)

    def values(self, trajectory: Trajectory) -> Array:
        """Distances less the margin (K, r)."""
        return (self._distances(trajectory).values - self.least) / LENGTH_SCALE

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, r, size)."""
        return trajectory.shape_jacobian(self._distances(trajectory).by_body / LENGTH_SCALE)

    def relaxed(self, row: int, amount: str) -> str:
        """A smaller clearance."""
        return f"the {self.labels[row]} {amount} smaller"

    def _distances(self, trajectory: Trajectory) -> Distances:
        if self not in trajectory.distances:
            trajectory.distances[self] = self.measure(trajectory)
        return trajectory.distances[self]


@dataclass(frozen=True, eq=False)
class ObstacleClearance(Clearance):
    """Distance of every link to an obstacle, less its margin, (19)-(23).

    Holds: for all t in the obstacle's window, by exchange of instants. ``links`` (r,) are the links measured.
    """

    obstacle: Obstacle
    name: str
    links: tuple[str, ...]
    window: Window = ALWAYS

    @property
    def labels(self) -> tuple[str, ...]:
        """One row per distance."""
        return tuple(f"clearance of {link} to {self.name}" for link in self.links)

    @property
    def least(self) -> float:
        """The obstacle's margin."""
        return self.obstacle.margin

    def measure(self, trajectory: Trajectory) -> Distances:
        """Distances to the obstacle."""
        return trajectory.flown.obstacle_distances(self.obstacle)

    def cause_at(self, end: str) -> str:
        """The posture touches the obstacle."""
        return f"the obstacle covers the {end} posture"


@dataclass(frozen=True, eq=False)
class LinkClearance(Clearance):
    """Distance between the shapes of two links, less a margin. Holds: for all t, by exchange of instants."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    names: tuple[str, str]
    margin: float
    window: Window = ALWAYS

    @property
    def labels(self) -> tuple[str, ...]:
        """One row per pair of capsules."""
        return (f"clearance of {self.names[0]} to {self.names[1]}",) * (len(self.first) * len(self.second))

    @property
    def least(self) -> float:
        """The margin."""
        return self.margin

    def measure(self, trajectory: Trajectory) -> Distances:
        """Distances between the capsules of the one and of the other."""
        return trajectory.flown.pair_distances(self.first, self.second)

    def cause_at(self, end: str) -> str:
        """The posture brings the links together."""
        return f"it follows from the {end}'s positions"


@dataclass(frozen=True, eq=False)
class MagnitudeLimit:
    """``|combinations @ quantity| <= limit``, two rows for each of r combinations.

    Holds: for all t, by exchange of instants. ``combinations`` are (r, m): a motor's torque or a joint's rate on its
    own, or the torque of a leader and its followers together.
    """

    quantity: Quantity
    names: tuple[str, ...]
    combinations: Array
    limit: Array
    unit: str
    window: Window = ALWAYS
    tolerance: float = RELATIVE

    @property
    def labels(self) -> tuple[str, ...]:
        """Upper limits, then lower ones."""
        return self.names * 2

    @property
    def scale(self) -> Array:
        """The limits."""
        return np.tile(self.limit, 2)

    @property
    def depends_at_ends_on(self) -> frozenset[AtEnds]:
        """As of the quantity."""
        return self.quantity.depends_at_ends_on

    def values(self, trajectory: Trajectory) -> Array:
        """``1 -+ quantity / limit`` (K, 2r)."""
        relative = (self.quantity.values(trajectory) @ self.combinations.T) / self.limit
        return np.concatenate((1 - relative, 1 + relative), axis=1)

    def jacobian(self, trajectory: Trajectory) -> Array:
        """Derivatives (K, 2r, size)."""
        relative = (self.combinations / self.limit[:, None]) @ self.quantity.jacobian(trajectory)
        return np.concatenate((-relative, relative), axis=1)

    def relaxed(self, row: int, amount: str) -> str:
        """A higher limit."""
        return f"the limit on the {self.labels[row]} {amount} higher"

    def cause_at(self, end: str) -> str:
        """The state at that end exceeds the limit."""
        return f"it follows from the {end}'s rates and accelerations"


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
    depends_at_ends_on: frozenset[AtEnds] = EVERYTHING

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

    def relaxed(self, row: int, amount: str) -> str:
        """A higher limit."""
        return f"the limit on the {self.labels[row]} {amount} higher"

    def cause_at(self, end: str) -> str:
        """The state at that end exceeds the limit."""
        return f"it follows from the {end}'s rates and accelerations"


def applies(block: Constraint, s: Array) -> BoolArray:
    """Whether (K,) a block applies at instants (K,) of [0, 1]."""
    low, high = block.window
    return np.asarray((s >= low) & (s <= high))


def window_ends(blocks: Iterable[Constraint]) -> tuple[float, ...]:
    """Ends of the blocks' windows, rising, the ends of the flight left out."""
    return tuple(sorted({end for block in blocks for end in block.window if end not in ALWAYS}))
