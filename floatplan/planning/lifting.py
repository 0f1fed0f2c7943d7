"""Flights in space by lifting: the attitudes at the borders of cells are unknowns too (multiple shooting).

From a path of attitudes that the physics of twisting suggests, a damped Gauss-Newton method closes the gaps between the
cells: each step is the shortest change of the motion that closes them to first order. A second stage descends the size
of the motion's free part along the motions without gaps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import SinePolynomials, basis
from floatplan.motion.spatial.attitude import Cells, NotIntegrable, Turning, moved, turn
from floatplan.motion.spatial.dynamics import SpatialDynamics
from floatplan.motion.spatial.rotations import logarithm

CLOSED = 1e-7  # [rad] gaps below which a motion is closed
STEPS = 30  # [-] most of them
LONGEST_STEP = 0.7  # [rad] of p, root mean square over all joints together
LARGEST_TURN = 0.6  # [rad] of a border
SHORTEST = 1e-3  # [-] of a step, below which it is given up
SHORTER = 0.4  # [-] a step that does not serve
GAIN = 0.25  # [-] of what a whole step would gain that is asked for
TURNS_WEIGH = 0.09  # [-] mean square turn of the borders beside the square change of the motion


@dataclass(frozen=True, eq=False)
class LiftedFlight:
    """What is asked: joints' motions of a class, attitudes (3, 3) at takeoff and landing, and the choice of h."""

    dynamics: SpatialDynamics
    polynomials: SinePolynomials
    momentum: MomentumSet
    start: Array
    goal: Array

    @cached_property
    def coefficients(self) -> int:
        """Number of free coefficients of all joints."""
        return len(self.polynomials.free_indices)

    @cached_property
    def size(self) -> int:
        """Number of unknowns x beside the borders: free coefficients, then those of h."""
        return self.coefficients + self.momentum.free

    def angular_momentum(self, x: Array) -> Array:
        """Return h (3,)."""
        return np.asarray(self.momentum.centre + self.momentum.axes @ x[self.coefficients :])

    def free_coefficients(self, x: Array) -> Array:
        """Return z (n, width)."""
        z = np.zeros(len(self.polynomials.free) * self.polynomials.width)
        z[self.polynomials.free_indices] = x[: self.coefficients]
        return z.reshape(-1, self.polynomials.width)

    def fly(self, cells: Cells, x: Array, borders: Array) -> LiftedMotion:
        """Fly the motion x in all cells, each from its border (C, 3, 3); errors as of :func:`turn`."""
        polynomials = self.polynomials
        motion = polynomials.motion(self.free_coefficients(x), basis(polynomials.form).values(cells.s))
        inertia, joint_map = self.dynamics.momentum_maps(motion.positions)
        relative = np.einsum("kan,kn->ka", joint_map, motion.velocities)
        turning = turn(cells, polynomials.duration, inertia, relative, self.angular_momentum(x), borders)
        targets = np.concatenate((borders[1:], self.goal[None]))
        gaps = logarithm(targets @ np.swapaxes(turning.ends, 1, 2))
        return LiftedMotion(self, x, borders, motion, joint_map, turning, gaps)


@dataclass(frozen=True, eq=False)
class LiftedMotion:
    """A motion in cells, and the gaps (C, 3), rad, from the cells' ends to the next borders, and at last to the goal."""

    flight: LiftedFlight
    x: Array
    borders: Array
    motion: object
    joint_map: Array
    turning: Turning
    gaps: Array

    @cached_property
    def slopes(self) -> Array:
        """Derivatives (C, 3, size) of the cells' ends by x, as small turns."""
        motion, flight, turning = self.motion, self.flight, self.turning
        cells, polynomials = turning.cells, flight.polynomials
        count, stages = cells.count, len(cells.stages)
        _, weights = turning.carried
        by_momentum = -(weights.reshape(-1, 3, 3) @ turning.attitudes @ turning.inverse_inertia)
        slopes = flight.dynamics.momentum_slopes(motion.positions, motion.velocities, turning.rates)
        by_rate = by_momentum @ self.joint_map
        by_p = by_momentum @ slopes * motion.position_by_p[:, None] + by_rate * motion.velocity_by_p[:, None]
        by_p_rate = by_rate * motion.velocity_by_rate[:, None]
        value, first, _ = basis(polynomials.form).values(cells.s)
        free = slice(value.shape[1] - polynomials.width, None)
        n, width = by_p.shape[2], polynomials.width
        both = np.concatenate((by_p, by_p_rate)).reshape(2, count, stages, 3 * n)
        columns = np.stack((value[:, free], first[:, free])).reshape(2, count, stages, width)
        by_z = sum(np.swapaxes(both[d], 1, 2) @ columns[d] for d in (0, 1))  # (C, 3 n, width)
        by_z = by_z.reshape(count, 3, n * width)[..., polynomials.free_indices]
        if not flight.momentum.free:
            return np.asarray(by_z)
        mobile = (weights.reshape(-1, 3, 3) @ turning.mobility).reshape(count, stages, 3, 3).sum(axis=1)
        return np.concatenate((by_z, mobile @ flight.momentum.axes), axis=2)

    @cached_property
    def condensed(self) -> Array:
        """Turns (C + 1, 3, size) of the borders by x, where no gap changes."""
        transitions, _ = self.turning.carried
        turns = np.zeros((len(self.slopes) + 1, *self.slopes.shape[1:]))
        for cell, (transition, slope) in enumerate(zip(transitions, self.slopes, strict=True)):
            turns[cell + 1] = transition @ turns[cell] + slope
        return turns

    def closing(self, gaps: Array) -> Array:
        """Turns (C + 1, 3) of the borders that close gaps with the motion as it is; the last one misses the goal."""
        transitions, _ = self.turning.carried
        turns = np.zeros((len(gaps) + 1, 3))
        for cell, (transition, gap) in enumerate(zip(transitions, gaps, strict=True)):
            turns[cell + 1] = transition @ turns[cell] - gap
        return turns

    @cached_property
    def _pseudo_inverse(self) -> Array:
        jacobian = self.condensed[-1]
        return np.asarray(jacobian.T @ np.linalg.pinv(jacobian @ jacobian.T, rcond=1e-12))

    def step(self, gaps: Array, along: Array | float = 0.0) -> tuple[Array, Array]:
        """Shortest change of x (size,), from ``along``, with which the borders' turns (C, 3) close gaps (C, 3)."""
        closing = self.closing(gaps)
        along = np.broadcast_to(along, self.x.shape)
        change = along - self._pseudo_inverse @ (closing[-1] + self.condensed[-1] @ along)
        return change, (closing + self.condensed @ change)[:-1]

    def moved(self, change: Array, turns: Array) -> LiftedMotion:
        """Fly the motion that is changed by so much."""
        return self.flight.fly(self.turning.cells, self.x + change, moved(self.borders, turns))


def _size(change: Array, turns: Array) -> float:
    return float(change @ change + TURNS_WEIGH * (turns * turns).sum() / len(turns))


def close(motion: LiftedMotion, most_steps: int = STEPS) -> tuple[LiftedMotion, int, bool]:
    """Close the gaps; return the last motion, the motions flown, and whether they are closed."""
    length, flown = 1.0, 0
    for _ in range(most_steps):
        if abs(motion.gaps).max() < CLOSED:
            return motion, flown, True
        change, turns = motion.step(motion.gaps)
        before = _size(change, turns)
        length = min(
            1.0,
            2 * length,
            LONGEST_STEP / max(float(np.linalg.norm(change)), 1e-300),
            LARGEST_TURN / max(float(np.linalg.norm(turns, axis=1).max()), 1e-300),
        )
        while True:
            if length < SHORTEST:
                return motion, flown, False
            flown += 1
            try:
                other = motion.moved(length * change, length * turns)
            except NotIntegrable:
                other = None
            if other is not None and _size(*motion.step(other.gaps)) <= (1 - GAIN * length) ** 2 * before:
                break
            length *= SHORTER
        motion = other
    return motion, flown, bool(abs(motion.gaps).max() < CLOSED)
