"""Flights in space by lifting: the attitudes at the borders of cells are unknowns too (multiple shooting).

From a path of attitudes that the physics of twisting suggests, a damped Gauss-Newton method closes the gaps between the
cells: each step is the shortest change of the motion that closes them to first order. A second stage descends the size
of the motion's free part along the motions without gaps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import JointMotion, SinePolynomials, basis
from floatplan.motion.spatial.attitude import (
    Cells,
    IntegrationError,
    Turning,
    cells,
    moved,
    small_turns,
    turn,
    turn_from,
)
from floatplan.motion.spatial.dynamics import SpatialDynamics
from floatplan.motion.spatial.rotations import logarithm

CLOSED = 1e-7  # [rad] gaps below which a motion is closed
ROUNDING = 1e-12  # [-]
STAGES, FINER = 8, (16, 32, 64)  # [-] of the cells that a plan is closed in
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

    def momentum_along(self, cells: Cells, x: Array) -> tuple[JointMotion, Array, Array, Array]:
        """The joints' motion at the stages, A (K, 3, n) and I (K, 3, 3) there, and A q' (K, 3)."""
        polynomials = self.polynomials
        motion = polynomials.motion(self.free_coefficients(x), basis(polynomials.form).values(cells.s))
        inertia, joint_map = self.dynamics.momentum_maps(motion.positions)
        return motion, joint_map, inertia, np.einsum("kan,kn->ka", joint_map, motion.velocities)

    def fly(self, cells: Cells, x: Array, borders: Array) -> LiftedMotion:
        """Fly the motion x in all cells, each from its border (C, 3, 3); errors as of :func:`turn`."""
        motion, joint_map, inertia, relative = self.momentum_along(cells, x)
        turning = turn(cells, self.polynomials.duration, inertia, relative, self.angular_momentum(x), borders)
        targets = np.concatenate((borders[1:], self.goal[None]))
        gaps = logarithm(targets @ np.swapaxes(turning.ends, 1, 2))
        return LiftedMotion(self, x, borders, motion, joint_map, turning, gaps)


@dataclass(frozen=True, eq=False)
class LiftedMotion:
    """A motion in cells; ``gaps`` (C, 3), rad, go from the cells' ends to the next borders, at last to the goal."""

    flight: LiftedFlight
    x: Array
    borders: Array
    motion: JointMotion
    joint_map: Array
    turning: Turning
    gaps: Array

    @cached_property
    def slopes(self) -> Array:
        """Derivatives (C, 3, size) of the cells' ends by x, as small turns."""
        motion, flight, turning = self.motion, self.flight, self.turning
        cells, polynomials = turning.cells, flight.polynomials
        count, stages = cells.count, cells.stages
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
        return small_turns(self.turning.carried[0], self.slopes)

    def closing(self, gaps: Array) -> Array:
        """Turns (C + 1, 3) of the borders that close gaps with the motion as it is; the last one misses the goal."""
        return small_turns(self.turning.carried[0], -gaps[..., None])[..., 0]

    def step(self, gaps: Array, along: Array | float = 0.0) -> tuple[Array, Array]:
        """Shortest change of x (size,), from ``along``, with which the borders' turns (C, 3) close gaps (C, 3).

        Numbers of h that would leave [-1, 1] go to its edge.
        """
        closing, jacobian = self.closing(gaps), self.condensed[-1]
        along = np.array(np.broadcast_to(along, self.x.shape))
        movable, free = np.ones(len(self.x), bool), self.flight.coefficients
        for _ in range(self.flight.momentum.free + 1):
            columns = jacobian[:, movable]
            missing = closing[-1] + jacobian @ along
            change = along.copy()
            change[movable] -= columns.T @ np.linalg.lstsq(columns @ columns.T, missing, rcond=1e-12)[0]
            beyond = movable & (abs(self.x + change) > 1 + ROUNDING)
            beyond[:free] = False
            if not beyond.any():
                break
            along[beyond] = np.sign(self.x + change)[beyond] - self.x[beyond]
            movable &= ~beyond
        return change, (closing + self.condensed @ change)[:-1]

    def moved(self, change: Array, turns: Array) -> LiftedMotion:
        """Fly the motion that is changed by so much."""
        return self.flight.fly(self.turning.cells, self.x + change, moved(self.borders, turns))


DESCENDED = 1e-3  # [-] of the motion: a projected gradient below it is none
DESCENTS = 40  # [-] most steps of the descent
TRUST = 0.5  # [rad] of p, root mean square over all joints together: the first step of the descent
CORRECTIONS = 5  # [-] most steps that close the gaps again after one of the descent
LEAST_GAIN = 1e-3  # [-] of the size of the motion


def descend(motion: LiftedMotion, allowed: Callable[[LiftedMotion], bool]) -> tuple[LiftedMotion, int]:
    """Make a closed motion's free part smaller, along allowed motions without gaps; return it and the motions flown."""
    radius, flown, free = TRUST, 0, motion.flight.coefficients
    for _ in range(DESCENTS):
        size = float(np.linalg.norm(motion.x[:free]))
        downhill = np.concatenate((-motion.x[:free], np.zeros(motion.flight.momentum.free)))
        change, turns = motion.step(np.zeros_like(motion.gaps), downhill)
        length = float(np.linalg.norm(change))
        if length < DESCENDED * size:
            break
        share = min(1.0, radius / length, LARGEST_TURN / max(float(np.linalg.norm(turns, axis=1).max()), 1e-300))
        change, turns = motion.step(motion.gaps, share * downhill)
        try:
            other, more, closed = close(motion.moved(change, turns), CORRECTIONS)
            flown += more + 1
        except IntegrationError:
            closed = False
        smaller = closed and float(np.linalg.norm(other.x[:free])) < size * (1 - LEAST_GAIN) and allowed(other)
        if smaller:
            motion, radius = other, 2 * min(radius, share * length)
        else:
            radius = SHORTER * min(radius, share * length)
            if radius < SHORTEST:
                break
    return motion, flown


def refined(motion: LiftedMotion, error: float) -> LiftedMotion | None:
    """Close a motion in cells of more stages, as many as its attitude at landing needs; None where none are enough.

    The attitude is right to an error, rad: twice as many cells change it by less.
    """
    for count in FINER:
        fine = cells(count, STAGES)
        motion, _, closed = close(motion.flight.fly(fine, motion.x, motion.turning.at(np.arange(count) / count)))
        if not closed:
            return None
        flight, finer = motion.flight, cells(2 * count, STAGES)
        _, _, inertia, relative = flight.momentum_along(finer, motion.x)
        h = flight.angular_momentum(motion.x)
        whole = turn_from(finer, flight.polynomials.duration, inertia, relative, h, flight.start)
        if np.linalg.norm(logarithm(whole.ends[-1:] @ motion.turning.ends[-1].T)) < error:
            return motion
    return None


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
            except IntegrationError:
                other = None
            if other is not None and _size(*motion.step(other.gaps)) <= (1 - GAIN * length) ** 2 * before:
                break
            length *= SHORTER
        motion = other
    return motion, flown, bool(abs(motion.gaps).max() < CLOSED)
