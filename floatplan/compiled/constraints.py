"""Rows of constraints of planar flights, compiled: distances, and sums of moments and rates, with their derivatives.

Searches and corrections in flight share them; between nodes their least values are looked for. Their values are those
of :mod:`floatplan.motion.planar.closed_form` and :mod:`floatplan.motion.planar.clearance`, in a few calls for each
motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.compiled.bodies import unscaled_robot
from floatplan.kernel.layout import ENUMERATIONS, STRUCTURES, Filled, address, kernel
from floatplan.motion.dynamics import BaseMotion, FlightDynamics
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.motion.planar.closed_form import Ballistics
from floatplan.motion.planar.flight import PlanarBaseMotion, PlanarFlight
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle
from floatplan.problem.problem import Shares
from floatplan.robot.planar.tree import PlanarTree

SUM, SHARE, CIRCLE, BAR, HALF_PLANE_START, HALF_PLANE_END, PAIR = ENUMERATIONS["RowKind"]
RATES, VALUES, DRIFT, JACOBIAN, GRADIENT = ENUMERATIONS["Wanted"]
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


class CompiledConstraints:
    """Blocks of rows of a planar flight, and the quantity ``also``, which is wanted even where no row has any.

    Attributes
    ----------
    known : tuple of bool
        Of each block, whether the kernel knows it; others have no rows.
    block_first : (blocks + 1,) int
        Where each block's rows begin.
    differentiated : list of int
        Of each block, how many rows have derivatives that are not just the opposite of another's.
    also : (r, terms), optional
        The numbers of that quantity as the kernel's sums, from number ``first_also`` on; None where there is none, or
        the kernel does not know it.
    """

    def __init__(self, flight: PlanarFlight, blocks: Sequence[Block | None], also: str = "") -> None:
        self.kernel, self.flight = kernel(), flight
        self.known = tuple(map(_is_known, blocks))
        tree = flight.tree
        self.links, self.joints = tree.turns.shape
        self.terms = 2 + 2 * self.joints + self.links
        self.bodies, self.robot = unscaled_robot(tree)
        written: Written = []
        obstacles: list[list[float]] = []
        sums: list[Array] = []
        counts = [
            self._write(block, written, obstacles, sums) if block and known else 0
            for block, known in zip(blocks, self.known, strict=True)
        ]
        self.rows = len(written)
        self.block_first = np.cumsum([0, *counts])
        columns = np.array(written).reshape(-1, 5).T
        kind, first, second = columns[:3].astype(np.int64)
        of_sums = np.array(sums).reshape(-1, self.terms)
        accelerations, moments = np.split(of_sums, [2 + self.joints, 2 + 2 * self.joints], axis=1)[1:]
        self.also = self.sums(each_of(flight, also)) if also in QUANTITIES else None
        self.needs_moments = "torque" in also or bool(moments.any())
        self.needs_accelerations = self.needs_moments or also == "accelerations" or bool(accelerations.any())
        self.needs_places = bool((kind > SHARE).any())
        shapes, path = flight.link_shapes, flight.ballistics
        ends = _ends(tree, shapes)
        opposite = _opposite(kind, first, of_sums)
        is_differentiated = opposite < 0
        self.differentiated = [int(is_differentiated[i:j].sum()) for i, j in pairwise(self.block_first.tolist())]
        self.path = path_numbers(path)
        needed = {name: getattr(self, name) for name in ("needs_moments", "needs_accelerations", "needs_places")}
        rows = {"kind": kind, "first": first, "second": second, "least": columns[3], "per_scale": columns[4]}
        capsules = {"capsules": len(ends), "ends_real": ends.real, "ends_imaginary": ends.imag, "turn": tree.turn}
        self.first_also, all_sums = len(of_sums), [of_sums] if self.also is None else [of_sums, self.also]
        about = {"obstacles": np.array(obstacles), "sums": np.concatenate(all_sums), "opposite": opposite}
        self.filled = Filled("Constraints", self, shapes, rows=self.rows, **needed, **rows, **capsules, **about)
        self.references = self.robot.structure, self.filled.structure

    def _write(self, block: Block, rows: Written, obstacles: list[list[float]], sums: list[Array]) -> int:
        """Write the rows of a block; how many there are."""
        before = len(rows)
        if isinstance(block, SumRows | Shares):
            kind = SUM if isinstance(block, SumRows) else SHARE
            shares = [] if isinstance(block, SumRows) else filter(None, (block.used, block.also))
            parts = [self.sums(block)] if isinstance(block, SumRows) else list(map(self._sum, shares))
            begin, count = len(sums), len(parts[0])
            rows += [(kind, begin + i, begin + count + i if len(parts) > 1 else -1, 0.0, 1.0) for i in range(count)]
            sums.extend(np.concatenate(parts))
        elif isinstance(block.between, tuple):
            rows += [(PAIR, i, j, block.least, 1 / block.scale) for i, j in product(*block.between)]
        else:
            capsules = self.flight.link_shapes.facing(block.between)
            for piece in block.between.pieces:
                sides, numbers = _written_obstacle(piece)
                index = len(obstacles)
                rows += [(side, i, index, block.least, 1 / block.scale) for side in sides for i in capsules]
                obstacles.append(numbers)
        return len(rows) - before

    def sums(self, block: SumRows) -> Array:
        """Rows (r, terms) of the kernel's sums: constant, of theta0', of velocities, accelerations and moments."""
        rows = self._sum(block.weights)
        rows[:, 0] = block.constant
        return rows

    def _sum(self, weighted: Mapping[str, Array]) -> Array:
        n, tree = self.joints, self.flight.tree
        rows = np.zeros((len(next(iter(weighted.values()))), self.terms))
        of_torques = {"torques": tree.turns, "motor_torques": tree.motor_turns}
        begins = {"orientation_rate": 1, "velocities": 2, "accelerations": 2 + n}
        for quantity, weights in weighted.items():
            if quantity in of_torques:
                rows[:, 2 + 2 * n :] += weights @ of_torques[quantity].T[: weights.shape[1]]
            else:
                begin = begins[quantity]
                rows[:, begin : begin + weights.shape[1]] += weights
        return rows


@lru_cache(maxsize=16)
def _ends(tree: PlanarTree, shapes: LinkShapes) -> ComplexArray:
    """Weights (S, 2, m) of the capsules' starts and ends, by the rotations of the kernel's bodies."""
    return unscaled_robot(tree)[0].of_points(np.stack(shapes.weights, axis=1))


def path_numbers(path: Ballistics) -> Array:
    """Return what the kernel is given of the path of the centre of mass."""
    return np.array([*path.position0, *path.velocity0, path.gravity])


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


def _opposite(kind: IntArray, first: IntArray, sums: Array) -> IntArray:
    """Of each row (r,) an earlier one whose derivatives are the opposite; -1 where there is none."""
    known: dict[bytes, int] = {}
    found = np.full(len(kind), -1)
    for row in np.flatnonzero(kind == SUM).tolist():
        weights = sums[first[row], 1:]
        found[row] = known.get((0.0 - weights).tobytes(), -1)
        known.setdefault((weights + 0.0).tobytes(), row)
    return found


def compiled_constraints(
    flight: FlightDynamics, blocks: Sequence[Block | None], also: str = ""
) -> CompiledConstraints | None:
    """Return rows of a flight's constraints; None in space."""
    return CompiledConstraints(flight, blocks, also) if isinstance(flight, PlanarFlight) else None


def _is_known(block: Block | None) -> bool:
    return block is not None and (not isinstance(block, SumRows) or block.weights.keys() <= set(QUANTITIES))


def each_of(flight: PlanarFlight, quantity: str) -> SumRows:
    """Return the numbers of a quantity, each on its own."""
    joints, motors = (int(turns.shape[1]) for turns in (flight.tree.turns, flight.tree.motor_turns))
    width = {"motor_torques": motors, "orientation_rate": 1}.get(quantity, joints)
    return SumRows(np.zeros(width), {quantity: np.eye(width)})


def quantity_rows(flight: FlightDynamics, quantity: str, s: Array) -> RowTargets | None:
    """Return where the numbers of a quantity go, instant by instant; None in space."""
    if not isinstance(flight, PlanarFlight):
        return None
    constraints = CompiledConstraints(flight, [each_of(flight, quantity)])
    count = len(s) * constraints.rows
    return RowTargets(constraints, s, np.arange(count).reshape(len(s), -1), count)


class RowTargets:
    """Where rows are evaluated: instants ``s`` (K,), and where each goes: ``target`` (K, rows), negative: nowhere.

    ``count`` rows go somewhere; each value is lower by ``back_off``. Motions have copies of the ``template``, with
    ``room`` numbers of memory.
    """

    def __init__(
        self, constraints: CompiledConstraints, s: Array, target: IntArray, count: int, back_off: float = 0.0
    ) -> None:
        self.constraints, self.count, self.instants = constraints, count, len(s)
        self._kept = constraints.flight.duration * s, target
        self.template = STRUCTURES["Evaluation"](back_off=back_off)
        self.template.motion.instants = len(s)
        self.template.motion.per_second = 1 / constraints.flight.duration
        self.template.point_to(times=self._kept[0], target=target)
        self.room = constraints.kernel.motion_room(*constraints.references, self.template, 0)


@dataclass(frozen=True, eq=False)
class ByX:
    """How the joints and h depend on x: ``basis`` (3, size, 8 ..) of p and its derivatives by s at instants.

    ``columns`` (n+1,) says where each joint's x begin, and then those of h, which is moved by ``axes`` (H,); they move
    p too by ``of_axes`` (3, n, H, 8 ..), where the conditions (13) change with h.
    """

    basis: Array
    columns: IntArray
    axes: Array
    of_axes: Array | None = None


class MotionRows:
    """A flight at these instants; what it computes of the base's motion, ``flown`` need not compute again."""

    def __init__(self, instants: RowTargets, flown: BaseMotion) -> None:
        assert isinstance(flown, PlanarBaseMotion), "compiled constraints are in a plane"
        joints, constraints = flown.joints, instants.constraints
        self._instants, self._flown, self._constraints = instants, flown, constraints
        self._memory = np.empty(instants.room)
        self._structure = type(instants.template).from_buffer_copy(instants.template)
        constraints.kernel.motion_room(*constraints.references, self._structure, address(self._memory))
        motion = self._structure.motion
        self._rate, self._moment = np.empty(motion.stride), np.empty((constraints.links, motion.stride))
        motion.point_to(rate=self._rate, moment=self._moment)
        self._structure.momentum = flown.angular_momentum[0, 0]
        self._structure.point_to(positions=joints.positions, velocities=joints.velocities)
        self._call(RATES)
        flown.__dict__["base_rate"] = self._rate[: instants.instants]

    def _call(self, wanted: int, result: int = 0, count: int = 0, given: int = 0) -> None:
        constraints = self._constraints
        pack = np.empty((self._structure.variables.size, 8))
        rows, instructions = constraints.kernel.rows, constraints.kernel.instructions
        rows(*constraints.references, self._structure, wanted, given, count, address(pack), result, instructions)

    def values(self) -> Array:
        """Values (count,) of the rows."""
        constraints, structure, flown = self._constraints, self._structure, self._flown
        if constraints.needs_accelerations:
            structure.point_to(accelerations=flown.joints.accelerations)
        if constraints.needs_places:
            structure.point_to(attitude=flown.attitude)
        values = np.empty(self._instants.count)
        self._call(VALUES, address(values))
        if constraints.needs_moments:
            flown.__dict__["moments"] = self._moment[:, : self._instants.instants].T
        return values

    def drift(self, by_x: ByX, instants: int) -> Array:
        """Derivatives (instants, size) of theta0' by x at the first instants; the others' need it first."""
        structure, joints, variables = self._structure, self._flown.joints, self._structure.variables
        variables.size, variables.stride = by_x.basis.shape[1:]
        structure.point_to(sine=joints.sine, cosine=joints.position_by_p, p_rate=joints.p_rate)
        if self._constraints.needs_accelerations:
            structure.point_to(p_curvature=joints.p_curvature)
        variables.point_to(basis=by_x.basis, columns=by_x.columns, axes=by_x.axes)
        if by_x.of_axes is not None:
            variables.point_to(of_axes=by_x.of_axes)
        drift = np.empty((variables.size, variables.stride))
        self._call(DRIFT, address(drift), instants)
        return drift[:, :instants].T

    def jacobian(self, attitude_slopes: Array) -> Array:
        """Derivatives (count, size) of the rows by x, from those (K, size) of the attitude; after :meth:`drift`."""
        variables = self._structure.variables
        padded = np.zeros((variables.size, variables.stride))
        padded[:, : len(attitude_slopes)] = attitude_slopes.reshape(-1, variables.size).T
        self._structure.point_to(attitude_slopes=padded)
        jacobian = np.empty((self._instants.count, variables.size))
        self._call(JACOBIAN, address(jacobian))
        return jacobian

    def gradient(self, weights: Array) -> Array:
        """Derivatives (size,) by x of quantities times ``weights`` (instants, terms), summed; after :meth:`drift`."""
        gradient = np.empty(self._structure.variables.size)
        self._call(GRADIENT, address(gradient), len(weights), address(weights))
        return gradient


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
