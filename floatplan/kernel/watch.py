"""Rows watched during a flight, compiled: distances, and sums of moments and rates, with their derivatives.

The same as :mod:`floatplan.motion.planar.closed_form` and :mod:`floatplan.motion.planar.clearance` compute, in a few
calls for each motion: where there is no kernel, those do it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import byref
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.filled import Filled
from floatplan.kernel.layout import ENUMERATIONS
from floatplan.kernel.library import Kernel, kernel
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle

SUM, CIRCLE, BAR, HALF_PLANE_START, HALF_PLANE_END, PAIR = ENUMERATIONS["RowKind"]
QUANTITIES = ("velocities", "accelerations", "torques", "motor_torques", "orientation_rate")  # of sums


@dataclass(frozen=True, eq=False)
class ObstacleRows:
    """Distances to an obstacle, less the ``least`` one, over the ``scale``, m."""

    obstacle: Obstacle
    least: float
    scale: float


@dataclass(frozen=True, eq=False)
class PairRows:
    """Distances of ``first`` capsules to ``second`` ones, by index, less the ``least`` one, over the ``scale``, m."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    least: float
    scale: float


@dataclass(frozen=True, eq=False)
class SumRows:
    """``constant`` (r,) and ``weights`` (r, m) times quantities, named as those of the table of limits."""

    constant: Array
    weights: Mapping[str, Array]


Block = ObstacleRows | PairRows | SumRows


class Watch:
    """Blocks of rows of a planar flight, and the quantity ``also``, which is wanted even where no row has any."""

    def __init__(self, found: Kernel, flight: PlanarFlight, blocks: Sequence[Block], also: str = "") -> None:
        self.kernel, self.flight = found, flight
        tree = flight.tree
        self.bodies, self.joints = tree.turns.shape
        self.terms = 2 + 2 * self.joints + self.bodies
        kinds, obstacles, sums = self._listed(blocks)
        self.rows = len(kinds)
        of_sums = np.array(sums).reshape(-1, self.terms)
        accelerations, moments = np.split(of_sums, [2 + self.joints, 2 + 2 * self.joints], axis=1)[1:]
        self.needs_moments = "torque" in also or bool(moments.any())
        self.needs_accelerations = self.needs_moments or also == "accelerations" or bool(accelerations.any())
        self.needs_places = any(kind[0] != SUM for kind in kinds)
        shapes, coupling, ballistics = flight.link_shapes, flight.equations.masses[0], flight.ballistics
        ends = np.stack((shapes.weights[0], shapes.weights[1]), axis=1)
        self.capsules = len(ends)
        columns = list(zip(*kinds, strict=True)) or [()] * 5
        kind, first, second = (np.array(column, dtype=np.int64) for column in columns[:3])
        least, per_scale = (np.array(column, dtype=np.float64) for column in columns[3:])
        opposite = _opposite(kind, first, of_sums)
        self.differentiated: BoolArray = opposite < 0
        self._filled = Filled(
            "Watch",
            joints=self.joints,
            bodies=self.bodies,
            capsules=self.capsules,
            rows=self.rows,
            needs_moments=self.needs_moments,
            needs_accelerations=self.needs_accelerations,
            needs_places=self.needs_places,
            turn=tree.turn,
            turns=tree.turns,
            offsets=tree.offsets,
            inertia=flight.equations.masses[1],
            real=coupling.real,
            imaginary=coupling.imag,
            ends_real=ends.real,
            ends_imaginary=ends.imag,
            radius=shapes.radius,
            path=np.array([*ballistics.position0, *ballistics.velocity0, ballistics.gravity]),
            obstacles=np.array(obstacles),
            kind=kind,
            first=first,
            second=second,
            opposite=opposite,
            least=least,
            per_scale=per_scale,
            sums=of_sums,
        )
        self.reference = byref(self._filled.structure)

    def _listed(
        self, blocks: Sequence[Block]
    ) -> tuple[list[tuple[int, int, int, float, float]], list[list[float]], list[Array]]:
        """Kind, two indices, least value and inverse scale of each row; obstacles; sums."""
        kinds: list[tuple[int, int, int, float, float]] = []
        obstacles: list[list[float]] = []
        sums: list[Array] = []
        for block in blocks:
            if isinstance(block, SumRows):
                rows = self.sums(block)
                kinds += [(SUM, len(sums) + index, 0, 0.0, 1.0) for index in range(len(rows))]
                sums.extend(rows)
            elif isinstance(block, PairRows):
                kinds += [(PAIR, i, j, block.least, 1 / block.scale) for i in block.first for j in block.second]
            else:
                capsules = self.flight.link_shapes.facing(block.obstacle)
                for piece in block.obstacle.pieces:
                    sides, numbers = written_obstacle(piece)
                    kinds += [
                        (side, i, len(obstacles), block.least, 1 / block.scale) for side in sides for i in capsules
                    ]
                    obstacles.append(numbers)
        return kinds, obstacles, sums

    def sums(self, block: SumRows) -> Array:
        """Rows (r, terms) of the kernel's sums: constant, of theta0', of velocities, accelerations and moments."""
        n, tree = self.joints, self.flight.tree
        rows = np.zeros((len(block.constant), self.terms))
        rows[:, 0] = block.constant
        of_torques = {"torques": tree.turns, "motor_torques": tree.motor_turns}
        begins = {"orientation_rate": 1, "velocities": 2, "accelerations": 2 + n}
        for quantity, weights in block.weights.items():
            if quantity in of_torques:
                rows[:, 2 + 2 * n :] += weights @ of_torques[quantity].T[: weights.shape[1]]
            else:
                begin = begins[quantity]
                rows[:, begin : begin + weights.shape[1]] += weights
        return rows

    @property
    def widths(self) -> dict[str, int]:
        """How many numbers each quantity has."""
        n, motors = self.joints, self.flight.tree.motor_turns.shape[1]
        return {"velocities": n, "accelerations": n, "torques": n, "motor_torques": motors, "orientation_rate": 1}


def can_write(obstacle: Obstacle) -> bool:
    """Whether the kernel knows all pieces of an obstacle."""
    return all(isinstance(piece, Circle | Bar | HalfPlane) for piece in obstacle.pieces)


def written_obstacle(obstacle: Obstacle) -> tuple[tuple[int, ...], list[float]]:
    """Return kinds of the rows of an obstacle's piece, and its numbers: place, end or normal, velocity, radius."""
    if isinstance(obstacle, Circle):
        return (CIRCLE,), [*obstacle.center, 0.0, 0.0, *obstacle.velocity, obstacle.radius]
    if isinstance(obstacle, Bar):
        return (BAR,), [*obstacle.start, *obstacle.end, *obstacle.velocity, obstacle.radius]
    assert isinstance(obstacle, HalfPlane), "see can_write()"
    normal = np.array(obstacle.normal) / np.hypot(*obstacle.normal)
    return (HALF_PLANE_START, HALF_PLANE_END), [*obstacle.point, *normal.tolist(), *obstacle.velocity, 0.0]


def _opposite(kind: IntArray, first: IntArray, sums: Array) -> IntArray:
    """Of each row (r,) an earlier one whose derivatives are the opposite; -1 where there is none."""
    known: dict[bytes, int] = {}
    found = np.full(len(kind), -1)
    for row in np.flatnonzero(kind == SUM).tolist():
        weights = sums[first[row], 1:]
        found[row] = known.get((0.0 - weights).tobytes(), -1)
        known.setdefault((weights + 0.0).tobytes(), row)
    return found


def watch(flight: FlightDynamics, blocks: Sequence[Block], also: str = "") -> Watch | None:
    """Return what watches rows of a flight; None in space, or where the kernel does not know what they measure."""
    known = all(map(_is_known, blocks)) and also in ("", *QUANTITIES)
    return Watch(kernel(), flight, blocks, also) if known and isinstance(flight, PlanarFlight) else None


def _is_known(block: Block) -> bool:
    if isinstance(block, ObstacleRows):
        return can_write(block.obstacle)
    return isinstance(block, PairRows) or block.weights.keys() <= set(QUANTITIES)
