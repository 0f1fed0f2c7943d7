"""A motion as the kernel watches it: the values of its rows, and their derivatives by x."""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import Structure, byref, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.library import address
from floatplan.kernel.watch import Watch
from floatplan.motion.dynamics import Flown
from floatplan.motion.planar.closed_form import BaseRate
from floatplan.motion.planar.flight import PlanarFlown

RATES, VALUES, DRIFT, JACOBIAN, GRADIENT = range(5)
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
        watch.kernel.watch(watch.reference, self._reference, asked, given, count, result, watch.kernel.instructions)

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
        """Derivatives (size,) by x of quantities times ``weights`` (instants, terms), summed; after :meth:`drift`."""
        gradient = np.empty(self._structure.size)
        self._call(GRADIENT, address(weights), len(weights), address(gradient))
        return gradient
