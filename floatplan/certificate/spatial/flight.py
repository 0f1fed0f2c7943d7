"""The whole flight in space, on cells that are as fine as its proof needs.

What the joints alone do is enclosed cell by cell; the attitude, which is bounded for the flight as a whole, follows
each time that cells have been halved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np

from floatplan.arrays import Array, BoolArray
from floatplan.certificate.cells import FIRST_CELLS, TimeCells
from floatplan.certificate.enclosure import Taylor
from floatplan.certificate.limits import LimitedQuantity
from floatplan.certificate.spatial.attitude import Approximation, approximate
from floatplan.certificate.spatial.bodies import BodyMotion, body_motion
from floatplan.certificate.spatial.bound import AttitudeBound, attitude_bound
from floatplan.certificate.spatial.models import Matrices
from floatplan.certificate.spatial.robot import SpatialRobot
from floatplan.certificate.spatial.torques import forces, squared
from floatplan.plans.record import PlanRecord

BOUND = 5e-11  # [rad] sought for the attitude
RESIDUAL = 3e-13  # [rad] of the residual's integral over the flight, below which it is not sought
ROUNDING = 2.5e-14  # [-] of the fastest rate that the momentum can make: residuals of any number of cells, by rounding
MOST_CELLS_UNKNOWN = 1000  # [-] up to which all are halved where the amplification is not bounded
GAIN = 0.25  # [-] of its residual, to which halving a cell has to bring it: else it is rounding
TORQUE_RADIUS = 1e-6  # [-] sought, relative to the largest torque


@dataclass(frozen=True, eq=False)
class SpatialEnclosure:
    """The flight on all cells in the order of time.

    Attributes
    ----------
    cells : TimeCells
    motion : BodyMotion
        Relative to the base.
    attitude : AttitudeBound
    quaternions : (cells, K, 4)
        The approximation that this bound is about.
    rate : Matrices
        Of the base, in its own axes: one vector, rad/s.
    motor_torques : (K, cells, motors) N m
        The motors' own.
    """

    cells: TimeCells
    motion: BodyMotion
    attitude: AttitudeBound
    quaternions: Array
    rate: Matrices
    motor_torques: Taylor

    @property
    def positions(self) -> Taylor:
        """Positions (K, cells, n) of the planned joints, rad."""
        return self.motion.positions

    @property
    def velocities(self) -> Taylor:
        """Their rates (K, cells, n), rad/s."""
        return self.motion.velocities

    @property
    def accelerations(self) -> Taylor:
        """Their accelerations (K, cells, n), rad/s^2."""
        return self.motion.accelerations

    @property
    def last_quaternion(self) -> list[Any]:
        """The approximation at the end of the flight, (4) in Arb, whose precision is to be set."""

        def at_end(coefficients: Sequence[float]) -> Any:
            """The value of a polynomial of u where that is 1."""
            return sum((flint.arb(part) for part in coefficients), start=flint.arb(0))

        return [at_end(coefficients) for coefficients in self.quaternions[-1].T.tolist()]

    def limited_rate(self, limit: float) -> LimitedQuantity:
        """The base's rate, whose square is what is compared, and its limit, rad/s."""
        return LimitedQuantity("orientation_rate", (), squared(self.rate), limit, power=2)


def fly(
    robot: SpatialRobot, record: PlanRecord, windows: Sequence[tuple[float, float]], budget: int
) -> SpatialEnclosure:
    """Enclose the whole flight on cells that end where the windows do, which lie within it.

    Cells are halved until their shares of the residual and their torques' radii are as small as sought, or halving no
    longer makes them smaller, or the ``budget`` of cells is spent.
    """
    duration = record.duration
    momentum = np.array(record.angular_momentum)
    start = np.array(record.orientation["start"]["quaternion_xyzw"])
    grid = np.asarray(np.arange(FIRST_CELLS + 1) * (duration / FIRST_CELLS), dtype=np.float64)
    grid[-1] = duration
    grid = np.unique([*grid, *(end for window in windows for end in window)])
    cells = TimeCells.between(grid[:-1], grid[1:])
    motion = body_motion(robot, record, cells)
    middles = None
    before = np.full((2, len(cells)), math.inf)  # residual and torques' radius of the cell that was halved
    while True:
        approximation = approximate(motion, cells, momentum, start, middles)
        attitude = attitude_bound(motion, approximation, cells, momentum, start)
        sizes = np.array([attitude.residuals, np.zeros(len(cells))])
        sought = _sought(attitude, motion, duration)
        enclosed = None
        if math.isinf(attitude.amplification) and len(cells) < MOST_CELLS_UNKNOWN:
            sizes[1] = math.inf
            coarse = cells.are_divisible
        else:
            if (attitude.residuals <= sought).all() or not _worth_halving(sizes, before, sought, cells).any():
                enclosed = forces(robot, motion, attitude.momentum_in_base)
                if math.isfinite(attitude.bound):  # else torques have no bound in any number of cells
                    sizes[1] = _relative_radii(enclosed.motor_torques)
            coarse = _worth_halving(sizes, before, sought, cells)
        is_spent = len(cells) + coarse.sum() > budget
        if is_spent and enclosed is None:
            enclosed = forces(robot, motion, attitude.momentum_in_base)
        if enclosed is not None and (is_spent or not coarse.any()):
            return SpatialEnclosure(
                cells, motion, attitude, approximation.quaternions, enclosed.rate, enclosed.motor_torques
            )
        fine = np.flatnonzero(~coarse)
        middle = 0.5 * (cells.low + cells.high)
        low = np.concatenate([cells.low[fine], cells.low[coarse], middle[coarse]])
        high = np.concatenate([cells.high[fine], middle[coarse], cells.high[coarse]])
        order = np.argsort(low)
        halves = TimeCells.between(low[len(fine) :], high[len(fine) :])
        motion = BodyMotion.joined([motion.on_cells(fine), body_motion(robot, record, halves)]).on_cells(order)
        middles = np.concatenate([approximation.quaternions[fine, 0], _middles(approximation, coarse)])[order]
        before = np.concatenate([before[:, fine], np.tile(sizes[:, coarse], 2)], axis=1)[:, order]
        cells = TimeCells.between(low[order], high[order])


def _sought(attitude: AttitudeBound, motion: BodyMotion, duration: float) -> float:
    """The residual, rad/s, that is small enough: for the bound on the attitude, or because it is rounding."""
    enough = BOUND / attitude.amplification
    scale = np.fmax(attitude.momentum_in_base.size.max(), motion.joint_momentum.norm.max()) * motion.inverse.norm.max()
    return float(np.fmax(max(enough, RESIDUAL) / duration, ROUNDING * scale))


def _worth_halving(sizes: Array, before: Array, sought: float, cells: TimeCells) -> BoolArray:
    """Which cells are too coarse, in residual or torques (2, cells), and not only for rounding."""
    coarse = ~(sizes <= [[sought], [TORQUE_RADIUS]]) & ~(sizes > GAIN * before)
    return np.asarray(coarse.any(axis=0) & cells.are_divisible)


def _middles(approximation: Approximation, coarse: BoolArray) -> Array:
    """Attitudes (2 cells, 4) in the middles of the first halves of some cells, and then of the second ones."""
    q = approximation.quaternions[coarse]
    powers = np.array([[-0.5], [0.5]]) ** np.arange(q.shape[1])
    middles = np.concatenate([np.einsum("k,ckx->cx", of_half, q) for of_half in powers])
    return np.asarray(middles / np.linalg.norm(middles, axis=1, keepdims=True))


def _relative_radii(torques: Taylor) -> Array:
    """Largest radius (cells,) of the torques relative to the largest torque."""
    largest = np.fmax.reduce(torques.size, axis=None, initial=1e-12)
    return np.asarray(torques.e.max(axis=1, initial=0.0) / largest)
