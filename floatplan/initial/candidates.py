"""Flights that can begin and end, found by ballistics and the rates of the frame at rest alone: no motion yet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import qmc

from floatplan.arrays import Array
from floatplan.initial.plain import PlainMotion, plain_motion
from floatplan.initial.stance import Stance
from floatplan.robot.robot import Robot

GRAVITY = 9.81  # [m/s^2]
EDGE = 0.03  # [-] of a joint's range, kept free at its ends
TUCKED = 0.2  # [-] quantile of the inertias of random postures: to which the robot can fold itself
ENOUGH = 0.6  # [-] of the rates' limits: less is not sought
MOST = 0.95  # [-] of the rates' limits: more is not taken
EXCESS = 10.0  # [-] of rates over what is enough
TORQUE = 0.45  # [-] of the torque limits, that plain motions may take at most
BEYOND = 0.3  # [rad] that they may leave the ranges
UNBOUNDED = 1e3  # [-] the ratio where there are no rates
SAMPLES = 1024  # [-] flights that a search begins with, a power of 2
CHAINS = 4  # [-] of them that are followed
TRIALS = 8  # [-] beside each, at every
STEPS = 100  # [-] on the way from it
STEP = (0.3, 0.004)  # [-] of the ranges, the first and the last
CANDIDATE = 60.0  # [instants of one body] that a flight costs, and
BODY = 4.0  # [instants of one body] for each body of the robot
PENALTY = 30.0  # [1/m] of what is below the ground
SUNK = 0.1  # [m] that it counts at least
UNNATURAL = 1.0  # [1/rad] of postures away from the resting one, of leaning, and of standing on a tilted foot
CROUCH = 0.4  # [-] of the centre of mass's height in the resting posture, and
CROUCHED = 15.0  # [-] for lower ones: nobody pushes off lying or sitting
NEARLY = 0.3  # [rad] of the base's turn, that other than plain motions make up for
MISSED = 2.0  # [1/rad] of the base's turn beyond
TILTED = 0.25  # [-] of a foot's tilt, squared, beside the base's
UNSTEADY = 15.0  # [-] for tipped soles, trunks near the ground and a centre of mass far beyond the feet, and
FALLING = 1.0  # [-] for any of that
STRADDLING = 1.0  # [-] of feet at different heights, by the robot's own
FAR = 4.0  # [1/rad] of a leap's turn
ROUND = math.radians(1)  # [rad] to which angles are rounded
DIGITS = 3  # [-] of the angular momentum
BROADEST = math.pi  # [rad] to either side of the resting posture, for joints that turn farther


@dataclass(frozen=True, eq=False)
class Candidate:
    """A flight from one posture on the ground to another.

    Attributes
    ----------
    orientations : (2,) rad, at takeoff and landing
    positions : (2, n) rad
    duration : s
    horizontal_velocity : m/s
    angular_momentum : kg m^2/s
    ratios : (2,) shares of the velocity limits at takeoff and landing
    depth : m below the ground, of anything, at both ends or soon after or before
    unsteady : how far from standing it is at an end, as of :class:`~floatplan.initial.stance.Standing`
    cost : least for a flight well within the limits, above the ground, in natural postures
    """

    orientations: Array
    positions: Array
    duration: float
    horizontal_velocity: float
    angular_momentum: float
    ratios: Array
    depth: float
    unsteady: float
    cost: float

    @property
    def begins_and_ends(self) -> bool:
        """Whether the foot can leave and meet the ground at rest, the robot standing, with nothing in the ground."""
        return bool(self.ratios.max() <= MOST) and self.depth == 0 and self.unsteady == 0

    @property
    def turn(self) -> float:
        """Of the base, rad."""
        return float(self.orientations[1] - self.orientations[0])


@dataclass(frozen=True, eq=False)
class Candidates:
    """K flights: the arrays of :class:`Candidate` with K as a first axis, and the cost (K,) of each."""

    orientations: Array
    positions: Array
    durations: Array
    horizontal_velocities: Array
    angular_momenta: Array
    ratios: Array
    depths: Array
    unsteady: Array
    costs: Array

    def __getitem__(self, index: int) -> Candidate:
        """One of them."""
        return Candidate(
            self.orientations[index],
            self.positions[index],
            float(self.durations[index]),
            float(self.horizontal_velocities[index]),
            float(f"{self.angular_momenta[index]:.{DIGITS}g}"),
            self.ratios[index],
            float(self.depths[index]),
            float(self.unsteady[index]),
            float(self.costs[index]),
        )


@dataclass(frozen=True, eq=False)
class Flights:
    """All flights of a robot on one foot.

    Attributes
    ----------
    turns : whole turns of the base, with the sign of its orientation; 0 for a leap that turns by leaning
    durations : (low, high) s
    lean : rad, of the base before or behind upright, at most, at both ends
    """

    robot: Robot
    stance: Stance
    upright: float
    turns: int
    durations: tuple[float, float]
    lean: float

    @cached_property
    def ranges(self) -> Array:
        """Ranges (n, 2) rad in which postures are sought."""
        limits, rest = self.robot.position_limits, self.robot.resting
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
        pose = np.concatenate(([[self.upright - self.lean, self.upright + self.lean]], self.ranges))
        speed = 0.5 * math.sqrt(GRAVITY * self._size)
        return np.concatenate((pose, pose, [self.durations, (0.0, 1.0), (-speed, speed)]))

    @cached_property
    def _size(self) -> float:
        return max(self.stance.height(self.upright, self.robot.resting), 1e-3)

    @property
    def work(self) -> float:
        """What a search costs, instants of one body."""
        return (SAMPLES + CHAINS * TRIALS * STEPS) * (CANDIDATE + BODY * len(self.robot.tree.mass))

    def candidates(self, values: Array) -> Candidates:
        """Return the flights that values (K, 2n+5) mean, with angles rounded."""
        count = len(values)
        poses = np.round(values[:, :-3].reshape(2 * count, -1) / ROUND) * ROUND
        standing = self.stance.standing(poses[:, 0], poses[:, 1:])
        heights = standing.height.reshape(count, 2)
        orientations = poses[:, 0].reshape(count, 2) + np.array([0.0, 2 * math.pi * self.turns])
        durations, speeds = np.round(values[:, -3], 2), np.round(values[:, -1], 1)
        inertia = np.maximum(standing.inertia[:, 0].reshape(count, 2).mean(axis=1), self.tucked)
        inertia = self.tucked + values[:, -2] * (inertia - self.tucked)
        momenta = _rounded(inertia * (orientations[:, 1] - orientations[:, 0]) / durations)
        first = (heights[:, 1] - heights[:, 0]) / durations + GRAVITY * durations / 2
        rises = np.stack((first, first - GRAVITY * durations), axis=1).ravel()
        found = standing.rates(np.column_stack((np.repeat(speeds, 2), rises)), np.repeat(momenta, 2))
        depths = np.maximum(standing.sunk, standing.depth(rises, found)).reshape(count, 2).max(axis=1)
        unsteady = standing.unsteady.reshape(count, 2).max(axis=1)
        positions, ratios = poses[:, 1:].reshape(count, 2, -1), found.ratios.reshape(count, 2)
        plain = plain_motion(positions, found.rates.reshape(count, 2, -1), durations)
        missed = np.abs(plain.turns(self.stance, momenta) - (orientations[:, 1] - orientations[:, 0]))
        asked = np.maximum(ratios.max(axis=1), self._efforts(plain))
        worst = np.minimum(np.where(np.isfinite(asked), asked, np.inf), UNBOUNDED)
        lean, bent = poses[:, 0] - self.upright, poses[:, 1:] - self.robot.resting
        tilt = lean + bent @ self.stance.foot_turns if self.stance.foot_turns.any() else 0.0
        away = np.mean(bent**2, axis=1) + lean**2 + TILTED * tilt**2
        costs = (
            EXCESS * np.maximum(worst - ENOUGH, 0.0)
            + np.where(depths > 0, PENALTY * (SUNK + depths), 0.0)
            + np.where(unsteady > 0, FALLING + UNSTEADY * unsteady, 0.0)
            + UNNATURAL * np.sqrt(away).reshape(count, 2).mean(axis=1)
            + CROUCHED * np.maximum(CROUCH - heights.min(axis=1) / self._size, 0.0)
            + MISSED * np.maximum(missed - NEARLY, 0.0)
            + STRADDLING * standing.apart.reshape(count, 2).max(axis=1) / self._size
        )
        if not self.turns:
            costs -= FAR * np.abs(orientations[:, 1] - orientations[:, 0])
        return Candidates(orientations, positions, durations, speeds, momenta, ratios, depths, unsteady, costs)

    def _efforts(self, plain: PlainMotion) -> Array:
        """Shares (K,) of the joints' limits that plain motions take; how far they leave the ranges counts as well."""
        low, high = self.robot.position_limits.T
        beyond = np.maximum(plain.positions - high, low - plain.positions).max(axis=(1, 2))
        rates = np.abs(plain.rates).max(axis=1) / self.stance.limits
        torques = np.abs(plain.accelerations).max(axis=1) * self.stance.sluggishness / TORQUE
        return np.asarray(np.maximum(np.maximum(rates, torques).max(axis=1), beyond / BEYOND))

    def search(self, seed: int) -> Candidate:
        """Return the best flight of seeded steps from the best of sampled ones."""
        low, high = self.box.T
        rng = np.random.default_rng(seed)
        values = self._drawn(qmc.Sobol(len(low), seed=rng).random(SAMPLES))
        costs = self.candidates(values).costs
        best = np.argsort(costs, kind="stable")[:CHAINS]
        values, costs = values[best], costs[best]
        share = max(0.3, 2 / len(low))
        for step in np.geomspace(*STEP, STEPS):
            chosen = rng.random((CHAINS, TRIALS, len(low))) < share
            moves = chosen * step * (high - low) * rng.standard_normal(chosen.shape)
            trials = np.clip(values[:, None] + moves, low, high)
            others = self.candidates(trials.reshape(-1, len(low))).costs.reshape(CHAINS, TRIALS)
            nearest = others.argmin(axis=1)
            better = others.min(axis=1) < costs
            values = np.where(better[:, None], trials[np.arange(CHAINS), nearest], values)
            costs = np.where(better, others.min(axis=1), costs)
        return self.candidates(values[costs.argmin()][None])[0]

    def _drawn(self, rows: Array) -> Array:
        """Samples (K, 2n+5) of the box, postures nearer to the resting one than to the edges."""
        low, high = self.box.T
        rest = np.concatenate(([self.upright], self.robot.resting))
        values = low + rows * (high - low)
        middle = np.concatenate((rest, rest))
        held = slice(0, len(middle))
        values[:, held] = np.clip((values[:, held] + middle) / 2, low[held], high[held])
        return np.asarray(values)


def _rounded(values: Array) -> Array:
    """To so many digits."""
    powers = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-300))) - (DIGITS - 1))
    return np.asarray(np.round(values / powers) * powers)
