"""Rows of constraints as the kernel computes them: distances, and sums of moments and rates, with their derivatives.

Searches and corrections in flight share them; between nodes their least values are looked for. Values of flights in a
plane are those of :mod:`floatplan.motion.planar.closed_form` and :mod:`floatplan.motion.planar.clearance`. What the
rows of a flight in space have of their own is in :mod:`floatplan.planning.kernel_input.space`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise, product
from typing import Any, Protocol, TypeAlias

import numpy as np

from floatplan.arrays import Array, ComplexArray, identity
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Pointer, Struct, StructArray, doubles, enumeration, integers
from floatplan.kernel.tolerances import CONSTRAINED_SETTINGS, EXCHANGE, SETTINGS, Exchange, Settings
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.quadrature import NODE_COUNTS, gauss_legendre
from floatplan.motion.sine_polynomial import Form, basis
from floatplan.planning.kernel_input.bodies import unscaled_bodies
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Shares
from floatplan.problem.spatial_obstacles import Box, Capsule, HalfSpace, LevelGround, Sphere
from floatplan.robot.planar.tree import PlanarTree

RowKind = enumeration("RowKind")
SUMMED = ("velocities", "accelerations", "torques", "motor_torques", "orientation_rate")  # quantities of sums


@dataclass(frozen=True, eq=False)
class DistanceRows:
    """Distances to an obstacle, or of some capsules to others, by index, less the ``least``, over the ``scale``, m."""

    between: Obstacle | tuple[tuple[int, ...], tuple[int, ...]]
    least: float
    scale: float


@dataclass(frozen=True, eq=False)
class SumRows:
    """``constant`` (r,) and ``weights`` (r, m) times quantities, named as those of the table of limits."""

    constant: Array
    weights: Mapping[str, Array]


class Shapes(Protocol):
    """The capsules of the links of a flight."""

    def facing(self, obstacle: Obstacle) -> range:
        """Return the indices of those whose distances to an obstacle count."""


Block: TypeAlias = DistanceRows | SumRows | Shares  # of shares what is left of limits: 1 less both magnitudes
Row: TypeAlias = tuple[int, int, int, float, float]  # kind, two indices, least value, inverse scale


class Sums:
    """The kernel's sums: of a constant, the base's rate, n velocities, n accelerations, and m moments that turn links.

    ``turns`` (m, n) and ``motor_turns`` (m, M) make the torques of n joints and of M motors of the moments; in space
    these are the torques of the tree's own joints, and the base's rate is its magnitude.

    Attributes
    ----------
    terms : how many
    of_accelerations, of_moments : which are of accelerations, and of moments
    """

    def __init__(self, turns: Array, motor_turns: Array) -> None:
        links, joints = turns.shape
        self.terms = 2 + 2 * joints + links
        self.of_accelerations = slice(2 + joints, 2 + 2 * joints)
        self.of_moments = slice(2 + 2 * joints, None)
        self._begins = {"orientation_rate": 1, "velocities": 2, "accelerations": 2 + joints}
        self._turns = {"torques": turns, "motor_torques": motor_turns}

    def rows(self, block: SumRows) -> Array:
        """Rows (r, terms) of a block; of many (N, r, terms)."""
        rows = self.weighted(block.weights)
        rows[..., 0] = block.constant
        return rows

    def weighted(self, weights: Mapping[str, Array]) -> Array:
        """The same of quantities alone."""
        rows = np.zeros((*next(iter(weights.values())).shape[:-1], self.terms))
        for quantity, own in weights.items():
            if quantity in self._turns:
                rows[..., self.of_moments] += own @ self._turns[quantity].T[: own.shape[-1]]
            elif quantity in self._begins:
                begin = self._begins[quantity]
                rows[..., begin : begin + own.shape[-1]] += own
            else:
                raise TypeError(f"the kernel knows no limits of {quantity}, but of {', '.join(SUMMED)}")
        return rows

    def each_of(self, quantity: str) -> Array:
        """The numbers of a quantity, each on its own."""
        turns = self._turns["motor_torques" if quantity == "motor_torques" else "torques"]
        count = 1 if quantity == "orientation_rate" else turns.shape[1]
        return self.weighted({quantity: identity(count)})


class KernelRows:
    """Blocks of rows of a flight, and the quantity ``also``, which is wanted even where no row has any.

    Attributes
    ----------
    struct : Struct
        Of the rows.
    rows : how many
    block_first : list of blocks + 1 int
        Where each block's rows begin.
    differentiated : list of int
        Of each block, how many rows have derivatives that are not just the opposite of another's.
    also : (r, terms), optional
        The numbers of that quantity as the kernel's sums, from number ``first_also`` on; None where there is none.
    needs_rates : whether rows, or what is wanted, depend on the base's rates
    bodies : how many an evaluation moves, by which its work is counted
    work_of_body : of one at an instant, relative to one in a plane
    node_counts : of the grids, by their level, rising
    settings, rules : numbers of their search, see :mod:`floatplan.kernel.tolerances`
    follow_starts, evaluate : functions of the kernel
        They follow starts, and evaluate a program.
    nodes : function
        Of the nodes of all levels, for motions of a form.
    """

    bodies: int
    work_of_body: float = 1.0
    node_counts: tuple[int, ...]
    settings: Settings
    rules: Exchange
    follow_starts: Any
    evaluate: Any
    nodes: Callable[[Form], StructArray]

    def __init__(
        self,
        sums: Sums,
        blocks: Sequence[Block],
        also: str,
        places: Mapping[str, Any],
        shapes: Shapes | None,
    ) -> None:
        self.sums = sums
        written: list[Row] = []
        obstacles: list[list[float]] = []
        parts: list[Array] = []
        self.block_first = [0]
        for block in blocks:
            if isinstance(block, DistanceRows):
                assert shapes, "distances are of a flight"
                written += _distances(block, shapes, obstacles)
            else:
                kind = RowKind["sum_row"]
                own = [sums.rows(block)] if isinstance(block, SumRows) else []
                if isinstance(block, Shares):
                    kind = RowKind["share_row"]
                    own = [sums.weighted(weights) for weights in (block.used, block.also) if weights]
                begin = sum(map(len, parts))
                count = len(own[0])
                for i in range(count):
                    second = begin + count + i if len(own) > 1 else -1
                    written.append((kind, begin + i, second, 0.0, 1.0))
                parts += own
            self.block_first.append(len(written))
        kind_of, first, second_of, least, per_scale = zip(*written, strict=True) if written else ((),) * 5
        self.rows = len(written)
        self.first_also = sum(map(len, parts))
        self.also = sums.each_of(also) if also else None
        others = [] if self.also is None else [self.also]
        all_sums = np.concatenate((np.empty((0, sums.terms)), *parts, *others))
        opposite = opposite_rows(kind_of, first, all_sums[: self.first_also]) if written else []
        self.differentiated = [opposite[begin:end].count(-1) for begin, end in pairwise(self.block_first)]
        needs_moments = bool(all_sums[:, sums.of_moments].any())
        self.needs_rates = needs_moments or bool(all_sums[:, 1].any())
        self.margin = doubles(least)
        self.struct = Struct(
            "Constraints",
            rows=self.rows,
            needs_moments=needs_moments,
            needs_accelerations=needs_moments or bool(all_sums[:, sums.of_accelerations].any()),
            kind=integers(kind_of),
            first=integers(first),
            second=integers(second_of),
            opposite=integers(opposite),
            margin=self.margin,
            per_scale=doubles(per_scale),
            sums=doubles(all_sums),
            obstacles=doubles(obstacles),
            **places,
        )

    def flying(self, momentum: MomentumSet) -> tuple[Pointer, ...]:
        """Return what these functions are given first: structs of what flies, with an angular momentum of a set."""
        raise NotImplementedError


class PlanarRows(KernelRows):
    """Rows of a tree's flights in a plane; of one ``flight`` where there are any, whose shapes and path they need.

    Attributes
    ----------
    path : (5,)
        Of the centre of mass: place, velocity, gravity; NaN where no flight is given.
    """

    def __init__(
        self, tree: PlanarTree, blocks: Sequence[Block], also: str = "", flight: PlanarFlight | None = None
    ) -> None:
        compiled = kernel()
        self.follow_starts = compiled.attempt
        self.evaluate = compiled.evaluate
        self.bodies = len(tree.mass)
        self.node_counts = NODE_COUNTS
        self.settings = CONSTRAINED_SETTINGS if blocks else SETTINGS
        self.rules = EXCHANGE
        self.nodes = partial(nodes_of_levels, has_rows=bool(blocks))
        self.own_bodies = unscaled_bodies(tree)
        self.path: Array = np.full(5, np.nan)
        if flight:
            path = flight.ballistics
            self.path = np.array([*path.position0, *path.velocity0, path.gravity])
        needs_places = any(isinstance(block, DistanceRows) for block in blocks)
        shapes = flight.link_shapes if flight and needs_places else None
        ends: ComplexArray = np.empty((0, 2, 0), np.complex128)  # (S, 2, m) of capsules, by the bodies' rotations
        radius = np.empty(0)
        if shapes:
            ends = self.own_bodies.of_points(shapes.ends)
            radius = shapes.radius
        places = {
            "needs_places": needs_places,
            "capsules": len(ends),
            "ends_real": doubles(ends.real),
            "ends_imaginary": doubles(ends.imag),
            **dict.fromkeys(("body", "ends", "hull_first", "hull_points", "hull_axes")),
            "hulls": 0,
            "radius": doubles(radius),
            "turn": tree.turn,
            "path": self.path,
        }
        super().__init__(Sums(tree.turns, tree.motor_turns), blocks, also, places, shapes)

    def flying(self, momentum: MomentumSet) -> tuple[Pointer, ...]:
        """Return the robot: h comes with the class of motions."""
        return (self.own_bodies.struct.pointer,)


def _distances(block: DistanceRows, shapes: Shapes, obstacles: list[list[float]]) -> list[Row]:
    """Return rows of distances, and add the pieces of obstacles that they are measured to."""
    if isinstance(block.between, tuple):
        return [(RowKind["pair_row"], i, j, block.least, 1 / block.scale) for i, j in product(*block.between)]
    capsules = shapes.facing(block.between)
    rows: list[Row] = []
    for piece in block.between.pieces:
        sides, numbers = _written_obstacle(piece)
        for side in sides:
            rows += [(side, capsule, len(obstacles), block.least, 1 / block.scale) for capsule in capsules]
        obstacles.append(numbers)
    return rows


@lru_cache(maxsize=32)
def nodes_of_levels(form: Form, has_rows: bool) -> StructArray:
    """Return the nodes of all levels in a plane, for motions of a form; integrals to any instant only for rows.

    Without rows only the landing counts, and the integrals of all levels take longer than many a search.
    """
    levels = []
    for count in NODE_COUNTS:
        rule = gauss_legendre(count, integrates=has_rows)
        value, first, second = basis(form).values(rule.nodes)
        nodes = Struct(
            "Nodes",
            nodes=count,
            s=doubles(rule.nodes),
            weights=doubles(rule.weights),
            tail=doubles(rule.transform[-3:]),
            value=doubles(value.T),
            first=doubles(first.T),
            second=doubles(second.T),
            integrals=doubles(rule.integrals(rule.nodes).T) if has_rows else None,
            antiderivative=doubles(rule.antiderivative) if has_rows else None,
        )
        levels.append(nodes)
    return StructArray(levels)


def obstacle_numbers(obstacle: Obstacle) -> list[float]:
    """Return what the kernel is given of an obstacle, piece by piece."""
    numbers = []
    for piece in obstacle.pieces:
        _, own = _written_obstacle(piece)
        numbers += own
    return numbers


def can_write(obstacle: Obstacle) -> bool:
    """Whether the kernel knows all pieces of an obstacle."""
    return all(isinstance(piece, Circle | Bar | HalfPlane) for piece in obstacle.pieces)


def _written_obstacle(obstacle: Obstacle) -> tuple[tuple[int, ...], list[float]]:
    """Return kinds of the rows of an obstacle's piece, and its numbers.

    These are a place, an end or normal or half the edges, velocity, and radius.
    """
    if isinstance(obstacle, Circle | Sphere):
        return (RowKind["ball_row"],), [
            *obstacle.center,
            *np.zeros(len(obstacle.center)).tolist(),
            *obstacle.velocity,
            obstacle.radius,
        ]
    if isinstance(obstacle, Bar | Capsule):
        return (RowKind["bar_row"],), [*obstacle.start, *obstacle.end, *obstacle.velocity, obstacle.radius]
    both_ends = (RowKind["wall_start_row"], RowKind["wall_end_row"])
    if isinstance(obstacle, HalfSpace):
        rows = both_ends[:1] if isinstance(obstacle, LevelGround) else both_ends
        return rows, [*obstacle.point, *obstacle.unit_normal, *obstacle.velocity, 0.0]
    if isinstance(obstacle, Box):
        return (RowKind["box_row"],), [*obstacle.center, *(edge / 2 for edge in obstacle.size), *obstacle.velocity, 0.0]
    assert isinstance(obstacle, HalfPlane), f"the kernel knows no obstacles of kind {obstacle.kind!r}"
    normal = np.array(obstacle.normal) / np.hypot(*obstacle.normal)
    return both_ends, [*obstacle.point, *normal.tolist(), *obstacle.velocity, 0.0]


def opposite_rows(kind: Sequence[int], first: Sequence[int], sums: Array) -> list[int]:
    """Of each row an earlier one whose derivatives are the opposite; -1 where there is none."""
    rows_by_weights: dict[bytes, int] = {}
    opposite_of = [-1] * len(kind)
    weights = sums[:, 1:]
    own = (weights + 0.0).tobytes()
    opposite = (0.0 - weights).tobytes()
    size = weights.itemsize * weights.shape[1]
    for row, begin in enumerate(first):
        if kind[row] == RowKind["sum_row"]:
            bits = slice(begin * size, (begin + 1) * size)
            opposite_of[row] = rows_by_weights.get(opposite[bits], -1)
            rows_by_weights.setdefault(own[bits], row)
    return opposite_of
