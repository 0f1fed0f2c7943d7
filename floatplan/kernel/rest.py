"""The rest of a flight, compiled: from the present state and free coefficients to the landing, corrected softly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.kernel import library
from floatplan.kernel.bodies import is_real, merged_bodies
from floatplan.kernel.filled import Filled, filled_grid, filled_robot
from floatplan.robot.planar.tree import PlanarTree


@dataclass(frozen=True, eq=False)
class Rest:
    """What is left of a flight.

    ``duration`` s and ``angular_momentum`` kg m^2/s; ``change`` of the orientation to the goal, rad; ``coefficients``
    (6+width, n) of p in the basis of :func:`floatplan.motion.sine_polynomial.basis`; the bodies' ``coupling`` (m, m)
    and ``inertia`` (m,), kg m^2, as they are believed to be.
    """

    duration: float
    angular_momentum: float
    change: float
    coefficients: Array
    coupling: ComplexArray
    inertia: Array


@dataclass(frozen=True)
class Weights:
    """Of ``miss^2 / sigma^2 + stiffness |y|^2``, and when its steps end; see :mod:`floatplan.inflight.law`."""

    sigma: float
    stiffness: float
    settled: float
    shorter: float
    evaluations: int


class RestSolver:
    """Corrections of the rest of a robot's flights; ``whitening`` (width, width) takes y to z times the amplitude."""

    def __init__(
        self,
        kernel: library.Kernel,
        tree: PlanarTree,
        centre: Array,
        amplitude: Array,
        whitening: Array,
        nodes: int,
    ) -> None:
        self._kernel = kernel
        self._bodies = merged_bodies(tree, centre, amplitude)
        self._width, self._n = len(whitening), len(amplitude)
        self._robot = filled_robot(self._bodies, [self._width] * self._n)
        size = len(self._bodies.real)
        self._real, self._imaginary = np.zeros((size, size)), np.zeros((size, size))
        self._robot.structure.real = self._real.ctypes.data_as(library.Doubles)
        self._robot.structure.imaginary = self._imaginary.ctypes.data_as(library.Doubles)
        self._z, self._boundary = np.zeros((self._n, self._width)), np.zeros((self._n, 6))
        self._y = np.zeros(self._n * self._width)
        self._rest = Filled(
            library.Rest,
            boundary=self._boundary,
            z=self._z,
            whitening=whitening,
            amplitude=amplitude,
            y=self._y,
        )
        self._grid = filled_grid(self._width, nodes)
        self._settings = library.Settings()

    def corrected(self, rest: Rest, weights: Weights) -> tuple[Array, float]:
        """Return the change y (n width,) of least cost, joint by joint, and the miss under it, rad."""
        merged = self._bodies.coupling(rest.coupling, rest.inertia)
        self._real[...], self._imaginary[...] = merged.real, merged.imag
        self._robot.structure.is_real = is_real(self._real, self._imaginary)
        self._boundary[...], self._z[...] = rest.coefficients[:6].T, rest.coefficients[6:].T
        structure = self._rest.structure
        structure.duration, structure.momentum, structure.change = rest.duration, rest.angular_momentum, rest.change
        structure.sigma, structure.stiffness = weights.sigma, weights.stiffness
        structure.settled, structure.shorter = weights.settled, weights.shorter
        structure.evaluations = weights.evaluations
        kernel = self._kernel
        failed = kernel.rest(
            self._robot.structure, self._grid.structure, self._settings, structure, kernel.instructions
        )
        if failed:
            raise MemoryError("no memory for a correction")
        return self._y.copy(), float(structure.miss)
