"""A motion as the kernel watches it: the values of its rows, and their derivatives by x."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.layout import ENUMERATIONS, STRUCTURES, Structure, address
from floatplan.kernel.watch import Watch
from floatplan.motion.dynamics import BaseMotion
from floatplan.motion.planar.closed_form import BaseRate
from floatplan.motion.planar.flight import PlanarBaseMotion

RATES, VALUES, DRIFT, JACOBIAN, GRADIENT = ENUMERATIONS["Asked"]


class Instants:
    """Where rows are watched: instants ``s`` (K,), and where each row goes: ``wanted`` (K, rows), negative: nowhere.

    ``count`` rows go somewhere; each value is lower by ``back_off``.
    """

    def __init__(self, watch: Watch, s: Array, wanted: IntArray, count: int, back_off: float = 0.0) -> None:
        self.watch, self.count = watch, count
        self.times = watch.flight.duration * s
        self._wanted = wanted
        self._template = STRUCTURES["Watched"](instants=len(s), back_off=back_off, per_second=1 / watch.flight.duration)
        self._template.point_to(times=self.times, wanted=wanted)
        self.instants = len(s)
        self._room = self._placed(self._template, 0)

    def _placed(self, structure: Structure, memory: int) -> int:
        return self.watch.kernel.watch_room(self.watch.reference, structure, self.count, memory)

    def fresh(self) -> tuple[Structure, Array]:
        """Return a structure for a motion, and the memory that it points to."""
        room = np.empty(self._room)
        structure = type(self._template).from_buffer_copy(self._template)
        self._placed(structure, address(room))
        return structure, room


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

    def __init__(self, instants: Instants, flown: BaseMotion) -> None:
        assert isinstance(flown, PlanarBaseMotion), "what is watched is in a plane"
        self._instants, self._flown = instants, flown
        self._watch = watch = instants.watch
        joints = flown.joints
        self._structure, self._memory = instants.fresh()
        self._begin = address(self._memory)
        self._structure.momentum = flown.angular_momentum[0, 0]
        self._structure.point_to(positions=joints.positions, velocities=joints.velocities)
        self._call(RATES)
        count, n = instants.instants, watch.joints
        flown.__dict__["base_rate"] = BaseRate(
            self._kept("rate", count),
            self._kept("by_velocity", count, n),
            self._kept("by_momentum", count),
            self._by_position,
        )

    def _kept(self, name: str, *shape: int) -> Array:
        """What the kernel has written there."""
        begin = (getattr(self._structure, name) - self._begin) // self._memory.itemsize
        return self._memory[begin : begin + math.prod(shape)].reshape(shape)

    def _call(self, asked: int, given: int = 0, count: int = 0, result: int = 0) -> None:
        watch = self._watch
        watch.kernel.watch(watch.reference, self._structure, asked, given, count, result, watch.kernel.instructions)

    def _by_position(self) -> Array:
        """Derivatives (K, n) of theta0' by joint positions, 1/s."""
        self._call(DRIFT)
        return self._kept("by_position", self._instants.instants, self._watch.joints)

    def values(self) -> Array:
        """Values (count,) of the rows."""
        watch, structure, flown = self._watch, self._structure, self._flown
        if watch.needs_accelerations:
            structure.point_to(accelerations=flown.joints.accelerations)
        if watch.needs_places:
            structure.point_to(attitude=flown.attitude)
        values = np.empty(self._instants.count)
        self._call(VALUES, result=address(values))
        if watch.needs_moments:
            flown.__dict__["moments"] = self._kept("moments", self._instants.instants, watch.bodies)
        return values

    def drift(self, by_x: ByX, instants: int) -> Array:
        """Derivatives (instants, size) of theta0' by x at the first instants; the others' need it first."""
        structure, joints = self._structure, self._flown.joints
        structure.size = by_x.basis.shape[2]
        structure.point_to(sine=joints.sine, cosine=joints.position_by_p, p_rate=joints.p_rate)
        if self._watch.needs_accelerations:
            structure.point_to(curvature=joints.p_curvature)
        structure.point_to(basis=by_x.basis, columns=by_x.columns, axes=by_x.axes)
        drift = np.empty((instants, by_x.basis.shape[2]))
        self._call(DRIFT, count=instants, result=address(drift))
        return drift

    def jacobian(self, attitude_slopes: Array) -> Array:
        """Derivatives (count, size) of the rows by x, from those (K, size) of the attitude; after :meth:`drift`."""
        self._structure.point_to(attitude_slopes=attitude_slopes)
        jacobian = np.empty((self._instants.count, self._structure.size))
        self._call(JACOBIAN, result=address(jacobian))
        return jacobian

    def gradient(self, weights: Array) -> Array:
        """Derivatives (size,) by x of quantities times ``weights`` (instants, terms), summed; after :meth:`drift`."""
        gradient = np.empty(self._structure.size)
        self._call(GRADIENT, address(weights), len(weights), address(gradient))
        return gradient
