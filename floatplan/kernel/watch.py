"""Rows watched during a flight, compiled: distances, and sums of moments and rates, with their derivatives.

The same as :mod:`floatplan.motion.planar.closed_form` and :mod:`floatplan.motion.planar.clearance` compute, in a few
calls for each motion: where there is no kernel, those do it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from ctypes import Structure, byref, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.library import Kernel, address, kernel
from floatplan.motion.dynamics import FlightDynamics, Flown
from floatplan.motion.planar.closed_form import BaseRate
from floatplan.motion.planar.flight import PlanarFlight, PlanarFlown
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle

SUM, CIRCLE, BAR, HALF_PLANE_START, HALF_PLANE_END, PAIR = range(6)
RATES, VALUES, DRIFT, JACOBIAN, GRADIENT = range(5)


class WatchStructure(Structure):
    """Of ``watch_kernel.hpp``."""

    _fields_ = (
        *(
            (name, c_int64)
            for name in (
                *("joints", "bodies", "capsules", "rows"),
                *("needs_moments", "needs_accelerations", "needs_places"),
            )
        ),
        ("turn", c_double),
        *(
            (name, c_void_p)
            for name in (
                *("turns", "offsets", "inertia", "real", "imaginary", "ends_real", "ends_imaginary", "radius", "path"),
                *("obstacles", "kind", "first", "second", "opposite", "least", "per_scale", "sums"),
            )
        ),
    )


PER_INSTANT = ("rate", "by_momentum", "base_acceleration", "turned_sine", "turned_cosine")
PER_JOINT = ("by_velocity", "by_position")
PER_BODY = ("real", "imaginary", "turned_real", "turned_imaginary", "moments")


class WatchedStructure(Structure):
    """Of ``watch_kernel.hpp``."""

    _fields_ = (
        ("instants", c_int64),
        ("size", c_int64),
        *((name, c_double) for name in ("momentum", "per_second", "back_off")),
        *(
            (name, c_void_p)
            for name in (
                *("positions", "velocities", "accelerations", "times", "attitude", "wanted"),
                *("sine", "cosine", "p_rate", "curvature", "basis", "columns", "axes", "attitude_slopes"),
                *(*PER_INSTANT, *PER_JOINT, *PER_BODY, "ends", "nearest", "scratch"),
            )
        ),
    )


@dataclass(frozen=True, eq=False)
class ObstacleRows:
    """Distances to an obstacle, less the ``least`` one, over the ``scale``, m."""

    obstacle: Obstacle
    least: float
    scale: float


@dataclass(frozen=True, eq=False)
class PairRows:
    """Distances of the ``first`` capsules to the ``second``, by index, less the ``least`` one, over the ``scale``, m."""

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
                sides, numbers = _written(block.obstacle)
                capsules = range(len(flight.links))
                kinds += [(side, i, len(obstacles), block.least, 1 / block.scale) for side in sides for i in capsules]
                obstacles.append(numbers)
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
        kept: dict[str, Array | IntArray] = {
            "turns": tree.turns,
            "offsets": tree.offsets,
            "inertia": flight.equations.masses[1],
            "real": coupling.real,
            "imaginary": coupling.imag,
            "ends_real": ends.real,
            "ends_imaginary": ends.imag,
            "radius": shapes.radius,
            "path": np.array([*ballistics.position0, *ballistics.velocity0, ballistics.gravity]),
            "obstacles": np.array(obstacles),
            "kind": kind,
            "first": first,
            "second": second,
            "opposite": _opposite(kind, first, of_sums),
            "least": least,
            "per_scale": per_scale,
            "sums": of_sums,
        }
        self._kept = {name: np.ascontiguousarray(values) for name, values in kept.items()}
        self.structure = WatchStructure(
            joints=self.joints,
            bodies=self.bodies,
            capsules=self.capsules,
            rows=self.rows,
            needs_moments=self.needs_moments,
            needs_accelerations=self.needs_accelerations,
            needs_places=self.needs_places,
            turn=tree.turn,
            **{name: address(values) for name, values in self._kept.items()},
        )
        self.reference = byref(self.structure)

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

    @property
    def has_followers(self) -> bool:
        """Whether there are more motors than planned joints."""
        return self.flight.tree.motor_turns.shape[1] > self.joints


def _written(obstacle: Obstacle) -> tuple[tuple[int, ...], list[float]]:
    """Kinds of the rows of an obstacle, and its numbers: a place, the end or the normal, velocity, radius."""
    if isinstance(obstacle, Circle):
        return (CIRCLE,), [*obstacle.center, 0.0, 0.0, *obstacle.velocity, obstacle.radius]
    if isinstance(obstacle, Bar):
        return (BAR,), [*obstacle.start, *obstacle.end, *obstacle.velocity, obstacle.radius]
    assert isinstance(obstacle, HalfPlane), "the kinds that there are"
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
    """Return what watches rows of a flight; None where it is in space, or there is no kernel."""
    found = kernel()
    if found is None or not isinstance(flight, PlanarFlight):
        return None
    return Watch(found, flight, blocks, also)


class Instants:
    """Where rows are watched: instants ``s`` (K,), and where each row goes: ``wanted`` (K, rows), negative: nowhere.

    ``count`` rows go somewhere; each value is lower by ``back_off``.
    """

    def __init__(self, watch: Watch, s: Array, wanted: IntArray, count: int, back_off: float = 0.0) -> None:
        self.watch, self.count = watch, count
        self.times = watch.flight.duration * s
        self._wanted = wanted
        self._template = WatchedStructure(
            instants=len(s),
            back_off=back_off,
            times=address(self.times),
            wanted=address(wanted),
            per_second=1 / watch.flight.duration,
        )
        self.instants = len(s)
        self._offsets, self._room = _layout(len(s), watch.joints, watch.bodies, watch.capsules, count)

    @classmethod
    def everywhere(cls, watch: Watch, s: Array) -> Instants:
        """All rows at all instants, one after the other."""
        count = len(s) * watch.rows
        return cls(watch, s, np.arange(count), count)

    def fresh(self) -> tuple[WatchedStructure, Array]:
        """Return a structure for a motion, and the memory that it points to."""
        room = np.empty(self._room)
        structure = WatchedStructure.from_buffer_copy(self._template)
        begin = address(room)
        for name, offset in self._offsets:
            setattr(structure, name, begin + offset)
        return structure, room


@lru_cache(maxsize=256)
def _layout(
    instants: int, joints: int, bodies: int, capsules: int, count: int
) -> tuple[tuple[tuple[str, int], ...], int]:
    """Where in the memory of a motion each array begins, bytes, and its size in numbers."""

    def lengths() -> Iterator[tuple[str, int]]:
        yield from ((name, instants) for name in PER_INSTANT)
        yield from ((name, instants * joints) for name in PER_JOINT)
        yield from ((name, instants * bodies) for name in PER_BODY)
        yield "ends", instants * capsules * 4
        yield "nearest", count * 4
        yield "scratch", (bodies + 2) * (3 * joints + 1) + 4 * bodies

    offsets, total = [], 0
    for name, length in lengths():
        offsets.append((name, 8 * total))
        total += length
    return tuple(offsets), total


@dataclass(frozen=True, eq=False)
class ByX:
    """How the joints and h depend on x: ``basis`` (3, K, size) of p and its derivatives by s.

    ``columns`` (n+1,) says where each joint's x begin, and then those of h, which is moved by ``axes`` (H,).
    """

    basis: Array
    columns: IntArray
    axes: Array


class Motion:
    """A flight at these instants; what it computes of the base's motion, ``flown`` need not compute again."""

    def __init__(self, instants: Instants, flown: Flown) -> None:
        assert isinstance(flown, PlanarFlown), "what is watched is in a plane"
        self._instants, self._flown = instants, flown
        self._watch = watch = instants.watch
        joints = flown.joints
        structure, self._memory = instants.fresh()
        structure.momentum = flown.angular_momentum[0, 0]
        structure.positions, structure.velocities = address(joints.positions), address(joints.velocities)
        self._structure, self._reference = structure, byref(structure)
        self._call(RATES)
        count, n = instants.instants, watch.joints
        memory = self._memory
        begin = len(PER_INSTANT) * count
        flown.__dict__["base_rate"] = BaseRate(
            memory[:count],
            memory[begin : begin + count * n].reshape(count, n),
            memory[count : 2 * count],
            self._by_position,
        )

    def _call(self, asked: int, given: int = 0, count: int = 0, result: int = 0) -> None:
        watch = self._watch
        watch.kernel.watch(
            watch.reference, self._reference, asked, given, count, result, watch.kernel.instructions
        )

    def _by_position(self) -> Array:
        """Derivatives (K, n) of theta0' by joint positions, 1/s."""
        self._call(DRIFT)
        count, n = self._instants.instants, self._watch.joints
        begin = (len(PER_INSTANT) + n) * count
        return self._memory[begin : begin + count * n].reshape(count, n)

    def values(self) -> Array:
        """Values (count,) of the rows."""
        watch, structure, flown = self._watch, self._structure, self._flown
        if watch.needs_accelerations:
            structure.accelerations = address(flown.joints.accelerations)
        if watch.needs_places:
            structure.attitude = address(flown.attitude)
        values = np.empty(self._instants.count)
        self._call(VALUES, result=address(values))
        if watch.needs_moments:
            count, m = self._instants.instants, watch.bodies
            begin = (len(PER_INSTANT) + 2 * watch.joints + 4 * m) * count
            flown.__dict__["moments"] = self._memory[begin : begin + count * m].reshape(count, m)
        return values

    def drift(self, by_x: ByX, instants: int) -> Array:
        """Derivatives (instants, size) of theta0' by x at the first instants; the others' need it first."""
        structure, joints = self._structure, self._flown.joints
        structure.size = by_x.basis.shape[2]
        structure.sine, structure.cosine = address(joints.sine), address(joints.position_by_p)
        structure.p_rate = address(joints.p_rate)
        if self._watch.needs_accelerations:
            structure.curvature = address(joints.p_curvature)
        structure.basis, structure.columns = address(by_x.basis), address(by_x.columns)
        structure.axes = address(by_x.axes)
        drift = np.empty((instants, by_x.basis.shape[2]))
        self._call(DRIFT, count=instants, result=address(drift))
        return drift

    def jacobian(self, attitude_slopes: Array) -> Array:
        """Derivatives (count, size) of the rows by x, from those (K, size) of the attitude; after :meth:`drift`."""
        self._structure.attitude_slopes = address(attitude_slopes)
        jacobian = np.empty((self._instants.count, self._structure.size))
        self._call(JACOBIAN, result=address(jacobian))
        return jacobian

    def gradient(self, weights: Array) -> Array:
        """Derivatives (size,) by x of the sum of quantities times ``weights`` (instants, terms); after :meth:`drift`."""
        gradient = np.empty(self._structure.size)
        self._call(GRADIENT, address(weights), len(weights), address(gradient))
        return gradient
