"""Flights that can begin and end, found by ballistics and the rates of the frame at rest alone: no motion yet.

What a flight costs is counted in radians of posture: 1 is a robot whose joints and base are 1 rad, root mean square,
from where they rest. Each weight says how many of them something is worth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy.stats import qmc

from floatplan.arrays import Array
from floatplan.initial.stance import Stance

GRAVITY = 9.81  # [m/s^2]
EDGE = 0.03  # [-] of a joint's range, kept free at its ends: there rates would have to be zero
BROADEST = math.pi  # [rad] to either side of the resting posture: farther, joints come back to the same posture
TUCKED = 0.2  # [-] quantile of the inertias of random postures: to which the robot can fold itself in flight
ROUND = math.radians(1)  # [rad] to which angles are rounded: the problem file says them in whole degrees
DIGITS = 3  # [-] of the angular momentum in the problem file

ENOUGH = 0.6  # [-] of the limits that a flight may use: less is not sought, for planned motions need the rest
MOST = 0.95  # [-] of the rates' limits: more leaves the search no room
UNUSED = 0.45  # [-] of the torque limits that joints may take each moving alone: moving together they take more
BEYOND = 0.3  # [rad] by which plain motions may leave the ranges: so far, planned ones are easily bent back
BENT_BACK = 0.3  # [rad] of the base's turn by which plain motions may miss the goal: planned ones make up for so much
CROUCH = 0.4  # [-] of the centre of mass's height at rest: nobody pushes off lying or sitting lower
UNBOUNDED = 1e3  # [-] the share of the limits that stands for no rates at all: more than any other

EXCESS = 10.0  # [rad] for the whole of a limit beyond what is enough: a flight beyond its limits has no plan
SUNK = 3.0  # [rad] for anything in the ground, more than a natural posture ever gains, and
DEEP = 30.0  # [rad/m] for its depth, so that the search finds the way out
FALLING = 1.0  # [rad] for not standing at all, and
UNSTEADY = 15.0  # [rad] for each rad of a tipped sole, and each height of the robot by which it is low or off its feet
CROUCHED = 15.0  # [rad] for the whole height of the centre of mass
MISSED = 2.0  # [-] for each rad of the base's turn that planned motions do not make up for: some of them may
FAR = 4.0  # [-] gained by each rad of a leap's turn, so that it leans as far as limits and ground allow
TILTED = 0.25  # [-] of a foot's tilt, squared, beside the base's: feet tip half as gladly as trunks do

SAMPLES = 1024  # [-] flights that a search begins with, a power of 2
CHAINS = 4  # [-] of them that are followed
TRIALS = 8  # [-] beside each, at every
STEPS = 100  # [-] on the way from it
STEP = (0.3, 0.004)  # [-] of the ranges, the first and the last
MOVED = 0.3  # [-] of the numbers that a trial changes, but two at least
CANDIDATE = 60.0  # [instants of one body] that a flight costs, and
BODY = 4.0  # [instants of one body] for each body of the robot
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # of a plain motion, from -1 to 1


@dataclass(frozen=True, eq=False)
class Candidates:
    """K flights from one posture on the ground to another; a single one, by its index, has no first axis.

    Attributes
    ----------
    orientations : (K, 2) rad, at takeoff and landing
    positions : (K, 2, n) rad
    duration : (K,) s
    horizontal_velocity : (K,) m/s
    angular_momentum : (K,) kg m^2/s
    ratios : (K, 2) shares of the velocity limits at takeoff and landing
    depth : (K,) m below the ground, of anything, at both ends or soon after or before
    unsteady : (K,) how far from standing it is at an end, as of :class:`~floatplan.initial.stance.Standing`
    cost : (K,) rad, least for a flight well within the limits, above the ground, in natural postures
    """

    orientations: Array
    positions: Array
    duration: Array
    horizontal_velocity: Array
    angular_momentum: Array
    ratios: Array
    depth: Array
    unsteady: Array
    cost: Array

    def __getitem__(self, index: int) -> Candidates:
        """One of them."""
        return Candidates(*(getattr(self, field.name)[index] for field in fields(self)))

    @property
    def begins_and_ends(self) -> bool:
        """Whether one can leave and meet the ground at rest, standing, with nothing in the ground."""
        return bool(self.ratios.max() <= MOST and self.depth == 0 and self.unsteady == 0)

    @property
    def turn(self) -> float:
        """Of the base, rad, in one of them."""
        return float(self.orientations[1] - self.orientations[0])


@dataclass(frozen=True, eq=False)
class PlainMotions:
    """K motions with given positions and rates at both ends, cubic in time, at N Gauss-Legendre nodes.

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

    @classmethod
    def between(cls, ends: Array, rates: Array, durations: Array) -> PlainMotions:
        """Return the motions of ends (K, 2, n) rad and rates (K, 2, n) rad/s there."""
        s = (NODES[:, None] + 1) / 2
        times = durations[:, None]
        start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
        first, last = rates[:, 0] * times, rates[:, 1] * times
        square, cube = 3 * way - 2 * first - last, first + last - 2 * way
        first, square, cube = first[:, None], square[:, None], cube[:, None]
        return cls(
            durations,
            start[:, None] + s * (first + s * (square + s * cube)),
            (first + s * (2 * square + 3 * s * cube)) / times[:, None],
            (2 * square + np.array([[0.0], [6.0]]) * cube) / times[:, None] ** 2,
        )

    def turns(self, stance: Stance, momenta: Array) -> Array:
        """How far (K,) rad the base turns, by (4), with angular momenta (K,) kg m^2/s."""
        count, _, joints = self.positions.shape
        rows = stance.dynamics.momentum_map(self.positions.reshape(-1, joints)).reshape(count, len(NODES), joints + 1)
        of_base = (momenta[:, None] - (rows[:, :, 1:] * self.rates).sum(axis=2)) / rows[:, :, 0]
        return np.asarray(of_base @ WEIGHTS * self.durations / 2)

    def efforts(self, stance: Stance) -> Array:
        """Shares (K,) of the joints' limits that they take; how far they leave the ranges counts as well."""
        low, high = stance.robot.position_limits.T
        beyond = np.maximum(self.positions - high, low - self.positions).max(axis=(1, 2))
        rates = np.abs(self.rates).max(axis=1) / stance.limits
        torques = np.abs(self.accelerations).max(axis=1) * stance.sluggishness / UNUSED
        return np.asarray(np.maximum(np.maximum(rates, torques).max(axis=1), beyond / BEYOND))


@dataclass(frozen=True, eq=False)
class Flights:
    """All flights of a robot on one foot.

    Attributes
    ----------
    turns : whole turns of the base, with the sign of its orientation; 0 for a leap that turns by leaning
    durations : (low, high) s
    lean : rad, of the base before or behind upright, at most, at both ends
    """

    stance: Stance
    turns: int
    durations: tuple[float, float]
    lean: float

    @cached_property
    def ranges(self) -> Array:
        """Ranges (n, 2) rad in which postures are sought."""
        limits, rest = self.stance.robot.position_limits, self.stance.robot.resting
        low, high = np.maximum(limits[:, 0], rest - BROADEST), np.minimum(limits[:, 1], rest + BROADEST)
        return np.stack((low + EDGE * (high - low), high - EDGE * (high - low)), axis=1)

    @cached_property
    def tucked(self) -> float:
        """Inertia D_0, kg m^2, that the robot can fold itself to."""
        low, high = self.ranges.T
        postures = low + (high - low) * qmc.Sobol(len(low), seed=0).random(SAMPLES)
        return float(np.quantile(self.stance.dynamics.momentum_map(postures)[:, 0], TUCKED))

    @cached_property
    def box(self) -> Array:
        """Ranges (2n+5, 2) of what is sought: both orientations and postures, duration, inertia, velocity."""
        upright = self.stance.upright
        pose = np.concatenate(([[upright - self.lean, upright + self.lean]], self.ranges))
        speed = 0.5 * math.sqrt(GRAVITY * self.stance.size)
        return np.concatenate((pose, pose, [self.durations, (0.0, 1.0), (-speed, speed)]))

    @property
    def work(self) -> float:
        """What a search costs, instants of one body."""
        return (SAMPLES + CHAINS * TRIALS * STEPS) * (CANDIDATE + BODY * self.stance.robot.tree.mass.size)

    def candidates(self, values: Array) -> Candidates:
        """Return the flights that values (K, 2n+5) mean, with angles rounded."""
        count, stance = len(values), self.stance
        poses = np.round(values[:, :-3].reshape(2 * count, -1) / ROUND) * ROUND
        standing = stance.standing(poses[:, 0], poses[:, 1:])
        orientations = poses[:, 0].reshape(count, 2) + np.array([0.0, 2 * math.pi * self.turns])
        turn = orientations[:, 1] - orientations[:, 0]
        durations, speeds = np.round(values[:, -3], 2), np.round(values[:, -1], 1)
        inertia = np.maximum(standing.inertia[:, 0].reshape(count, 2).mean(axis=1), self.tucked)
        momenta = _rounded((self.tucked + values[:, -2] * (inertia - self.tucked)) * turn / durations)
        heights = standing.height.reshape(count, 2)
        first = (heights[:, 1] - heights[:, 0]) / durations + GRAVITY * durations / 2
        rises = np.stack((first, first - GRAVITY * durations), axis=1).ravel()
        ratios, rates = standing.rates(np.column_stack((np.repeat(speeds, 2), rises)), np.repeat(momenta, 2))
        depths = np.maximum(standing.sunk, standing.depth(rises, rates)).reshape(count, 2).max(axis=1)
        unsteady = standing.unsteady.reshape(count, 2).max(axis=1)
        positions, ratios = poses[:, 1:].reshape(count, 2, -1), ratios.reshape(count, 2)
        plain = PlainMotions.between(positions, rates[:, 1:].reshape(count, 2, -1), durations)
        missed = np.abs(plain.turns(stance, momenta) - turn)
        used = np.minimum(np.nan_to_num(np.maximum(ratios.max(axis=1), plain.efforts(stance)), nan=np.inf), UNBOUNDED)
        lean, bent = poses[:, 0] - stance.upright, poses[:, 1:] - stance.robot.resting
        tilt = lean + bent @ stance.foot_turns if stance.foot_turns.any() else 0.0
        away = np.sqrt(np.mean(bent**2, axis=1) + lean**2 + TILTED * tilt**2)
        costs = (
            EXCESS * np.maximum(used - ENOUGH, 0.0)
            + np.where(depths > 0, SUNK + DEEP * depths, 0.0)
            + np.where(unsteady > 0, FALLING + UNSTEADY * unsteady, 0.0)
            + away.reshape(count, 2).mean(axis=1)
            + CROUCHED * np.maximum(CROUCH - heights.min(axis=1) / stance.size, 0.0)
            + MISSED * np.maximum(missed - BENT_BACK, 0.0)
            + standing.apart.reshape(count, 2).max(axis=1) / stance.size
        )
        if not self.turns:
            costs -= FAR * np.abs(turn)
        return Candidates(orientations, positions, durations, speeds, momenta, ratios, depths, unsteady, costs)

    def search(self, seed: int) -> Candidates:
        """Return the best flight of seeded steps from the best of sampled ones."""
        low, high = self.box.T
        rng = np.random.default_rng(seed)
        values = self._drawn(qmc.Sobol(len(low), seed=rng).random(SAMPLES))
        costs = self.candidates(values).cost
        best = np.argsort(costs, kind="stable")[:CHAINS]
        values, costs = values[best], costs[best]
        for step in np.geomspace(*STEP, STEPS):
            chosen = rng.random((CHAINS, TRIALS, len(low))) < max(MOVED, 2 / len(low))
            moves = chosen * step * (high - low) * rng.standard_normal(chosen.shape)
            trials = np.clip(values[:, None] + moves, low, high)
            others = self.candidates(trials.reshape(-1, len(low))).cost.reshape(CHAINS, TRIALS)
            better = others.min(axis=1) < costs
            values = np.where(better[:, None], trials[np.arange(CHAINS), others.argmin(axis=1)], values)
            costs = np.where(better, others.min(axis=1), costs)
        return self.candidates(values[costs.argmin()][None])[0]

    def _drawn(self, rows: Array) -> Array:
        """Samples (K, 2n+5) of the box, postures nearer to the resting one than to the edges."""
        low, high = self.box.T
        middle = np.tile(np.concatenate(([self.stance.upright], self.stance.robot.resting)), 2)
        values, held = low + rows * (high - low), slice(0, len(middle))
        values[:, held] = np.clip((values[:, held] + middle) / 2, low[held], high[held])
        return np.asarray(values)


def _rounded(values: Array) -> Array:
    """To so many digits."""
    powers = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-300))) - (DIGITS - 1))
    return np.asarray(np.round(values / powers) * powers)
