"""The plainest motions with given positions and rates at both ends: cubic in time, many at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.initial.stance import Stance

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # [-] of a motion, from -1 to 1


@dataclass(frozen=True, eq=False)
class PlainMotion:
    """K motions at N nodes of Gauss and Legendre.

    Attributes
    ----------
    durations : (K,) s
    positions, rates : (K, N, n) rad, rad/s
    accelerations : (K, 2, n) rad/s^2, at both ends, where they are largest
    """

    durations: Array
    positions: Array
    rates: Array
    accelerations: Array

    def turns(self, stance: Stance, momenta: Array) -> Array:
        """How far (K,) rad the base turns, by (4), with angular momenta (K,) kg m^2/s."""
        count, _, joints = self.positions.shape
        rows = stance.dynamics.momentum_map(self.positions.reshape(-1, joints)).reshape(count, len(NODES), joints + 1)
        of_base = (momenta[:, None] - (rows[:, :, 1:] * self.rates).sum(axis=2)) / rows[:, :, 0]
        return np.asarray(of_base @ WEIGHTS * self.durations / 2)


def plain_motion(ends: Array, rates: Array, durations: Array) -> PlainMotion:
    """Return the cubic motions of ends (K, 2, n) rad and rates (K, 2, n) rad/s there."""
    s = (NODES[:, None] + 1) / 2
    times = durations[:, None]
    start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    first, last = rates[:, 0] * times, rates[:, 1] * times
    square, cube = 3 * way - 2 * first - last, first + last - 2 * way
    first, square, cube = first[:, None], square[:, None], cube[:, None]
    bends = 2 * square + np.array([[0.0], [6.0]]) * cube
    return PlainMotion(
        durations,
        start[:, None] + s * (first + s * (square + s * cube)),
        (first + s * (2 * square + 3 * s * cube)) / times[:, None],
        bends / times[:, None] ** 2,
    )
