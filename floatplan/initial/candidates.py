"""Flights that can begin and end, found by ballistics and the rates of the frame at rest alone: no motion yet."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import qmc

from floatplan.arrays import Array
from floatplan.initial.stance import Stance
from floatplan.motion.planar.momentum import MomentumMapping, momentum_mapping
from floatplan.robot.robot import Robot

GRAVITY = 9.81  # [m/s^2]
EDGE = 0.03  # [-] of a joint's range, kept free at its ends
TUCKED = 0.2  # [-] quantile of the inertias of random postures: to which the robot can fold itself
ENOUGH = 0.35  # [-] of the rates' limits: less is not sought
ENOUGH_OF_A_LEAP = 0.7  # [-] the same where the flight is to turn as far as it can
MOST = 0.95  # [-] of the rates' limits: more is not taken
EXCESS = 10.0  # [-] of a leap's rates over what is enough
SMOOTH_PEAK = 1.875  # [-] of a smooth motion's mean rate, see (13)
UNBOUNDED = 1e3  # [-] the ratio where there are no rates
SAMPLES = 128  # [-] postures that a search begins with
BEGINNINGS = 2  # [-] of them that are followed
STEPS = 250  # [-] on the way from each
STEP = (0.3, 0.004)  # [-] of the ranges, the first and the last
PENALTY = 30.0  # [1/m] of what is below the ground
SUNK = 0.1  # [m] that it counts at least
UNNATURAL = 0.5  # [-] of a posture a whole range away from the resting one
ROUND = math.radians(1)  # [rad] to which angles are rounded
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
    """

    orientations: Array
    positions: Array
    duration: float
    horizontal_velocity: float
    angular_momentum: float
    ratios: Array
    depth: float

    @property
    def begins_and_ends(self) -> bool:
        """Whether the foot can leave and meet the ground at rest, with nothing in the ground."""
        return bool(self.ratios.max() <= MOST) and self.depth == 0

    @property
    def turn(self) -> float:
        """Of the base, rad."""
        return float(self.orientations[1] - self.orientations[0])


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
        return float(np.quantile(self._mapping(postures).rows[:, 0], TUCKED))

    @cached_property
    def _mapping(self) -> MomentumMapping:
        return momentum_mapping(self.robot.tree)

    @cached_property
    def box(self) -> Array:
        """Ranges (2n+5, 2) of what is sought: both orientations and postures, duration, inertia, velocity."""
        pose = np.concatenate(([[self.upright - self.lean, self.upright + self.lean]], self.ranges))
        speed = 0.5 * math.sqrt(GRAVITY * self._size)
        return np.concatenate((pose, pose, [self.durations, (0.0, 1.0), (-speed, speed)]))

    @cached_property
    def _size(self) -> float:
        return max(self.stance.height(self.upright, self.robot.resting), 1e-3)

    def candidate(self, values: Array) -> Candidate:
        """Return the flight that values (2n+5,) mean, with angles rounded."""
        return self._evaluated(self._rounded(values))

    def _rounded(self, values: Array) -> Candidate:
        """The flight, its ratios and depth not known yet."""
        poses = np.round(values[:-3].reshape(2, -1) / ROUND) * ROUND
        poses[1, 0] += 2 * math.pi * self.turns
        duration = round(float(values[-3]), 2)
        inertia = float(self._mapping(poses[:, 1:]).rows[:, 0].mean())
        inertia = self.tucked + values[-2] * (max(inertia, self.tucked) - self.tucked)
        return Candidate(
            orientations=poses[:, 0],
            positions=poses[:, 1:],
            duration=duration,
            horizontal_velocity=round(float(values[-1]), 1),
            angular_momentum=float(f"{inertia * (poses[1, 0] - poses[0, 0]) / duration:.3g}"),
            ratios=np.zeros(2),
            depth=max(self.stance.sunk(pose[0], pose[1:]) for pose in poses),
        )

    def _evaluated(self, candidate: Candidate, most: float = math.inf) -> Candidate:
        """With ratios and depth; not all of them where the cost exceeds ``most`` before."""
        if self.cost(candidate) > most:
            return candidate
        poses = list(zip(candidate.orientations.tolist(), candidate.positions, strict=True))
        heights = [self.stance.height(*pose) for pose in poses]
        duration = candidate.duration
        first = (heights[1] - heights[0]) / duration + GRAVITY * duration / 2
        for end, rise in enumerate((first, first - GRAVITY * duration)):
            velocity = np.array([candidate.horizontal_velocity, rise])
            found = self.stance.rates(*poses[end], velocity, candidate.angular_momentum)
            ratios, depth = candidate.ratios.copy(), candidate.depth
            if found.exist and found.ratio is not None:
                ratios[end] = found.ratio
                depth = max(depth, self.stance.depth(*poses[end], rise, found))
            else:
                ratios[end] = math.inf
            candidate = replace(candidate, ratios=ratios, depth=depth)
            if self.cost(candidate) > most:
                break
        return candidate

    def cost(self, candidate: Candidate) -> float:
        """Least for a flight well within the limits, above the ground, in natural postures, that turns far."""
        low, high = self.ranges.T
        unnatural = float(np.sqrt(np.mean(((candidate.positions - self.robot.resting) / (high - low)) ** 2)))
        swing = np.abs(candidate.positions[1] - candidate.positions[0]) / self.stance.limits
        hurry = SMOOTH_PEAK * float(swing.max()) / candidate.duration
        worst = min(max(float(candidate.ratios.max()), hurry), UNBOUNDED)
        used = max(worst, ENOUGH) if self.turns else EXCESS * max(worst - ENOUGH_OF_A_LEAP, 0.0)
        sunk = PENALTY * (SUNK + candidate.depth) if candidate.depth else 0.0
        return used + sunk + UNNATURAL * unnatural - (0.0 if self.turns else abs(candidate.turn))

    def search(self, seed: int) -> Candidate:
        """Return the best flight of seeded steps from the best of sampled ones."""
        low, high = self.box.T
        rng = np.random.default_rng(seed)
        sampled = [self._drawn(row) for row in qmc.Sobol(len(low), seed=rng).random(SAMPLES)]
        found = sorted((self.cost(self.candidate(row)), tuple(row.tolist())) for row in sampled)
        ends = []
        for begin, row in found[:BEGINNINGS]:
            cost, values = begin, np.array(row)
            for step in np.geomspace(*STEP, STEPS):
                chosen = rng.random(len(low)) < max(0.3, 2 / len(low))
                trial = np.clip(values + chosen * step * (high - low) * rng.standard_normal(len(low)), low, high)
                other = self.cost(self._evaluated(self._rounded(trial), cost))
                if other < cost:
                    cost, values = other, trial
            ends.append((cost, tuple(values.tolist())))
        return self.candidate(np.array(min(ends)[1]))

    def _drawn(self, row: Array) -> Array:
        """A sample (2n+5,) of the box, postures nearer to the resting one than to the edges."""
        low, high = self.box.T
        rest = np.concatenate(([self.upright], self.robot.resting))
        values = low + row * (high - low)
        middle = np.concatenate((rest, rest))
        values[: len(middle)] = np.clip((values[: len(middle)] + middle) / 2, low[: len(middle)], high[: len(middle)])
        return np.asarray(values)
