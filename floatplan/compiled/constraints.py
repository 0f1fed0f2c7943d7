"""Rows of constraints of planar flights, compiled: distances, and sums of moments and rates, with their derivatives.

Searches and corrections in flight share them; between nodes their least values are looked for. Their values are those
of :mod:`floatplan.motion.planar.closed_form` and :mod:`floatplan.motion.planar.clearance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product
from typing import Any, Protocol

import numpy as np

from floatplan.arrays import Array, ComplexArray, identity
from floatplan.compiled.attempts import nodes_of_levels
from floatplan.compiled.bodies import unscaled_robot
from floatplan.kernel.library import Kernel, kernel
from floatplan.kernel.structs import Pointer, Struct, StructArray, doubles, enumeration, integers
from floatplan.motion.dynamics import FlightDynamics, MomentumSet
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.sine_polynomial import Form
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Shares
from floatplan.robot.planar.tree import PlanarTree

SUM, SHARE, CIRCLE, BAR, HALF_PLANE_START, HALF_PLANE_END, PAIR = map(int, enumeration("RowKind"))
QUANTITIES = ("velocities", "accelerations", "torques", "motor_torques", "orientation_rate")  # of sums


@dataclass(frozen=True, eq=False)
class DistanceRows:
    """Distances to an obstacle, or of some capsules to others, by index, less the ``least``, over the ``scale``, m."""

    between: Obstacle | tuple[Sequence[int], Sequence[int]]
    least: float
    scale: float


@dataclass(frozen=True, eq=False)
class SumRows:
    """``constant`` (r,) and ``weights`` (r, m) times quantities, named as those of the table of limits."""

    constant: Array
    weights: Mapping[str, Array]


Written = list[tuple[int, int, int, float, float]]  # of rows: kind, two indices, least value, inverse scale
Block = DistanceRows | SumRows | Shares  # of shares what is left of limits: 1 less both magnitudes


@dataclass(frozen=True, eq=False)
class Sums:
    """The kernel's sums: of a constant, the base's rate, n velocities, n accelerations, and m moments that turn links.

    ``turns`` (m, n) and ``motor_turns`` (m, M) make the torques of n joints and of M motors of the moments; in space
    these are the torques of the tree's own joints, and the base's rate is its magnitude.
    """

    turns: Array
    motor_turns: Array

    @property
    def terms(self) -> int:
        """How many."""
        links, joints = self.turns.shape
        return int(2 + 2 * joints + links)

    @property
    def of_moments(self) -> slice:
        """Which are of moments."""
        return slice(2 + 2 * self.turns.shape[1], None)

    @property
    def of_accelerations(self) -> slice:
        """Which are of accelerations."""
        joints = self.turns.shape[1]
        return slice(2 + joints, 2 + 2 * joints)

    def rows(self, block: SumRows) -> Array:
        """Rows (r, terms) of a block; of many (N, r, terms)."""
        rows = self.weighted(block.weights)
        rows[..., 0] = block.constant
        return rows

    def weighted(self, weights: Mapping[str, Array]) -> Array:
        """The same of quantities alone."""
        n = self.turns.shape[1]
        rows = np.zeros((*next(iter(weights.values())).shape[:-1], self.terms))
        of_torques = {"torques": self.turns, "motor_torques": self.motor_turns}
        begins = {"orientation_rate": 1, "velocities": 2, "accelerations": 2 + n}
        for quantity, own in weights.items():
            assert quantity in QUANTITIES, f"the kernel knows no limits of {quantity}"
            if quantity in of_torques:
                rows[..., self.of_moments] += own @ of_torques[quantity].T[: own.shape[-1]]
            else:
                begin = begins[quantity]
                rows[..., begin : begin + own.shape[-1]] += own
        return rows

    def each_of(self, quantity: str) -> Array:
        """The numbers of a quantity, each on its own."""
        joints, motors = (int(turns.shape[1]) for turns in (self.turns, self.motor_turns))
        width = {"motor_torques": motors, "orientation_rate": 1}.get(quantity, joints)
        return self.weighted({quantity: identity(width)})


class Watch(Protocol):
    """Rows of a flight as the kernel watches them, in a plane or in space; see :class:`CompiledConstraints`.

    Attributes
    ----------
    struct : Struct
        Of the rows.
    attempt, evaluate : functions of the kernel
        They follow starts, and evaluate a program.
    """

    kernel: Kernel
    struct: Struct
    rows: int
    also: Array | None
    first_also: int
    differentiated: list[int]
    attempt: Any
    evaluate: Any

    @property
    def flight(self) -> FlightDynamics:
        """What a problem fixes of every motion."""

    def flying(self, momentum: MomentumSet) -> tuple[Pointer, ...]:
        """What these functions are given first: structs of what flies, with an angular momentum of a set."""

    def nodes(self, form: Form) -> StructArray:
        """Nodes of all levels, for motions of a form."""


class CompiledConstraints:
    """Blocks of rows of a planar flight, and the quantity ``also``, which is wanted even where no row has any.

    Attributes
    ----------
    block_first : list of blocks + 1 int
        Where each block's rows begin.
    differentiated : list of int
        Of each block, how many rows have derivatives that are not just the opposite of another's.
    also : (r, terms), optional
        The numbers of that quantity as the kernel's sums, from number ``first_also`` on; None where there is none.
    """

    def __init__(self, flight: FlightDynamics, blocks: Sequence[Block], also: str = "") -> None:
        assert isinstance(flight, PlanarFlight), "the kernel's rows are of flights in a plane"
        self.kernel, self.flight = kernel(), flight
        tree = flight.tree
        self._sums = Sums(tree.turns, tree.motor_turns)
        self.terms = self._sums.terms
        self.bodies, self.robot = unscaled_robot(tree)
        written: Written = []
        obstacles: list[list[float]] = []
        sums: list[Array] = []
        self.block_first = [0]
        for block in blocks:
            self._write(block, written, obstacles, sums)
            self.block_first.append(len(written))
        self.rows, self.first_also = len(written), sum(map(len, sums))
        kind, first, second, least, per_scale = zip(*written, strict=True) if written else ((),) * 5
        self.also = self._sums.each_of(also) if also else None
        all_sums = np.concatenate((np.empty((0, self.terms)), *sums, *(() if self.also is None else (self.also,))))
        own = all_sums[: self.first_also]
        needs_moments = "torque" in also or bool(own[:, self._sums.of_moments].any())
        accelerate = needs_moments or also == "accelerations" or own[:, self._sums.of_accelerations].any()
        needs_places = max(kind, default=SUM) > SHARE
        ends: ComplexArray = np.empty((0, 2, 0), np.complex128)
        radius = np.empty(0)
        if needs_places:
            ends = _ends(tree, flight.link_shapes)
            radius = flight.link_shapes.radius
        opposite = opposite_rows(kind, first, own)
        self.differentiated = [opposite[begin:end].count(-1) for begin, end in pairwise(self.block_first)]
        path = flight.ballistics
        self.path = np.array([*path.position0, *path.velocity0, path.gravity])
        self.least = doubles(least)
        self.struct = Struct(
            "Constraints",
            capsules=len(ends),
            rows=self.rows,
            needs_moments=needs_moments,
            needs_accelerations=bool(accelerate),
            needs_places=needs_places,
            turn=tree.turn,
            ends_real=doubles(ends.real),
            ends_imaginary=doubles(ends.imag),
            radius=doubles(radius),
            path=self.path,
            obstacles=doubles(obstacles),
            kind=integers(kind),
            first=integers(first),
            second=integers(second),
            opposite=integers(opposite),
            least=self.least,
            per_scale=doubles(per_scale),
            sums=doubles(all_sums),
        )
        self.attempt = self.kernel.attempt
        self.evaluate = self.kernel.evaluate

    def _write(self, block: Block, rows: Written, obstacles: list[list[float]], sums: list[Array]) -> None:
        """Write the rows of a block."""
        if isinstance(block, SumRows | Shares):
            kind = SUM if isinstance(block, SumRows) else SHARE
            shares = [] if isinstance(block, SumRows) else filter(None, (block.used, block.also))
            parts = [self.sums(block)] if isinstance(block, SumRows) else list(map(self._sums.weighted, shares))
            begin, count = sum(map(len, sums)), len(parts[0])
            rows += [(kind, begin + i, begin + count + i if len(parts) > 1 else -1, 0.0, 1.0) for i in range(count)]
            sums += parts
        elif isinstance(block.between, tuple):
            rows += [(PAIR, i, j, block.least, 1 / block.scale) for i, j in product(*block.between)]
        else:
            capsules = self.flight.link_shapes.facing(block.between)
            for piece in block.between.pieces:
                sides, numbers = _written_obstacle(piece)
                index = len(obstacles)
                rows += [(side, i, index, block.least, 1 / block.scale) for side in sides for i in capsules]
                obstacles.append(numbers)

    def flying(self, momentum: MomentumSet) -> tuple[Pointer, ...]:
        """Return the robot: h comes with the class of motions."""
        return (self.robot.pointer,)

    def nodes(self, form: Form) -> StructArray:
        """Return the nodes of all levels, for motions of a form."""
        return nodes_of_levels(form)

    def sums(self, block: SumRows) -> Array:
        """Rows (r, terms) of the kernel's sums: constant, of theta0', of velocities, accelerations and moments.

        Of many (N, r, terms).
        """
        return self._sums.rows(block)


@lru_cache(maxsize=16)
def _ends(tree: PlanarTree, shapes: LinkShapes) -> ComplexArray:
    """Weights (S, 2, m) of the capsules' starts and ends, by the rotations of the kernel's bodies."""
    return unscaled_robot(tree)[0].of_points(np.stack(shapes.weights, axis=1))


def obstacle_numbers(obstacle: Obstacle) -> list[float]:
    """Return what the kernel is given of an obstacle, piece by piece."""
    return [number for piece in obstacle.pieces for number in _written_obstacle(piece)[1]]


def can_write(obstacle: Obstacle) -> bool:
    """Whether the kernel knows all pieces of an obstacle."""
    return all(isinstance(piece, Circle | Bar | HalfPlane) for piece in obstacle.pieces)


def _written_obstacle(obstacle: Obstacle) -> tuple[tuple[int, ...], list[float]]:
    """Return kinds of the rows of an obstacle's piece, and its numbers: place, end or normal, velocity, radius."""
    if isinstance(obstacle, Circle):
        return (CIRCLE,), [*obstacle.center, 0.0, 0.0, *obstacle.velocity, obstacle.radius]
    if isinstance(obstacle, Bar):
        return (BAR,), [*obstacle.start, *obstacle.end, *obstacle.velocity, obstacle.radius]
    assert isinstance(obstacle, HalfPlane), f"the kernel knows no obstacles of kind {obstacle.kind!r}"
    normal = np.array(obstacle.normal) / np.hypot(*obstacle.normal)
    return (HALF_PLANE_START, HALF_PLANE_END), [*obstacle.point, *normal.tolist(), *obstacle.velocity, 0.0]


def opposite_rows(kind: Sequence[int], first: Sequence[int], sums: Array) -> list[int]:
    """Of each row an earlier one whose derivatives are the opposite; -1 where there is none."""
    known: dict[bytes, int] = {}
    found, weights = [-1] * len(kind), sums[:, 1:]
    own, opposite, size = (weights + 0.0).tobytes(), (0.0 - weights).tobytes(), weights.itemsize * weights.shape[1]
    for row, begin in enumerate(first):
        if kind[row] == SUM:
            bits = slice(begin * size, (begin + 1) * size)
            found[row] = known.get(opposite[bits], -1)
            known.setdefault(own[bits], row)
    return found


@dataclass(frozen=True, eq=False)
class Look:
    """Where to look first: a ``grid`` (K,) of [0, 1], and between which instants each row (rows,) applies.

    What may be below ``near`` is narrowed down by ``span`` to both sides.
    """

    grid: Array
    low: Array
    high: Array
    near: float
    span: float
