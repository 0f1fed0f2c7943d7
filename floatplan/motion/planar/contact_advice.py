"""What would help a frame to leave or meet the ground at rest: other h, duration or posture, tried and told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.planar.ballistics import ballistics, frame_weights
from floatplan.motion.planar.bounds import momentum_interval
from floatplan.motion.planar.contact_rates import ContactRates, End, at_end, equations_at, rate_limits, rates_at
from floatplan.problem.problem import Problem

GOLDEN = (math.sqrt(5) - 1) / 2
FAST = 40.0  # [rad/s] that no joint of a legged robot turns at
DURATIONS = np.geomspace(0.5, 2.0, 33)  # [-] of the asked one
REFINEMENTS = 20  # [-] golden sections of the best of these
TRIALS = 300  # [-] postures
STEPS = (0.5, 0.02)  # [rad] of the first and the last trials
INSIDE = 0.02  # [-] of a joint's range, kept free at its ends: a joint on the edge can only be at rest
SINKING = 1e-3  # [m] by which a posture may bring a frame below the lowest of the asked one's
WORTH_TELLING = 0.95  # [-] of what it is now
ENOUGH = 0.8  # [-] of a limit, or of FAST: slower need not be
CHANGE = 0.1  # [-] of a limit, that is as bad as a change by one rad, or of the duration by a factor of e

Momentum: TypeAlias = float | Literal["midpoint"]


def _share(found: ContactRates) -> float:
    """Of a velocity limit; without limits, of what is fast."""
    return found.size / (FAST if found.ratio is None else 1.0)


def in_words(found: ContactRates) -> str:
    """Return that share, or without limits the rate, in words."""
    number = found.size
    if not math.isfinite(number):
        return "no rates at all"
    if found.ratio is None:
        return f"{number:.3g} rad/s"
    return f"{100 * number:.0f} % of a velocity limit" if number <= 1 else f"{number:.3g} times a velocity limit"


@dataclass(frozen=True, eq=False)
class _Trial:
    """One end of a flight with another duration, s, posture (n,), rad, or the best momentum instead of the asked."""

    duration: float
    positions: Array
    free: bool


class _Trials:
    """Rates of trials at one end of a problem's flight; the frame stays where it is, at the base's orientation."""

    def __init__(self, problem: Problem, end: End, momentum: Momentum) -> None:
        self._problem, self._end, self._momentum = problem, end, momentum
        self._frame, self._orientation, positions, _ = at_end(problem, end)
        self._limits = rate_limits(problem)
        self._weights = np.array([frame_weights(problem.robot, frame) for frame in problem.robot.frames.values()])
        self.asked = _Trial(problem.flight.duration, positions, False)
        self._own_height, lowest = self._heights(positions)
        self._floor = lowest - self._own_height - SINKING

    def rates(self, trial: _Trial) -> ContactRates:
        """Return the least rates of a trial."""
        velocity = self._com_velocity(trial)
        equations = equations_at(self._problem.robot, self._frame, self._orientation, trial.positions, velocity)
        return rates_at(self._problem.robot, equations, self._limits, self._angular_momentum(trial))

    def _angular_momentum(self, trial: _Trial) -> float | None:
        problem = self._problem
        if trial.free:
            return None
        if self._momentum != "midpoint":
            return self._momentum
        start, goal = problem.initial, problem.final
        ends = (trial.positions, goal.positions) if self._end == "takeoff" else (start.positions, trial.positions)
        changes = np.array([goal.orientation - start.orientation, *(ends[1] - ends[0])])
        return sum(momentum_interval(problem, changes, trial.duration)) / 2

    def _com_velocity(self, trial: _Trial) -> Array:
        """As of the problem, for another duration, or another height of the centre of mass over the frame."""
        path, duration = ballistics(self._problem), self._problem.flight.duration
        rise = path.velocity0[1] * duration - path.gravity * duration**2 / 2
        sign = 1 if self._end == "takeoff" else -1
        rise += sign * (self._heights(trial.positions)[0] - self._own_height)
        return np.array([path.velocity0[0], rise / trial.duration + sign * path.gravity * trial.duration / 2])

    def _heights(self, positions: Array) -> tuple[float, float]:
        """Heights of the contact frame and of the lowest frame over the centre of mass, m."""
        tree = self._problem.robot.tree
        rotations = tree.rotations(tree.absolute_angles(np.array(self._orientation), positions))
        own = float((frame_weights(self._problem.robot, self._frame) @ rotations).imag)
        return own, float((self._weights @ rotations).imag.min())

    def cost(self, trial: _Trial) -> float:
        """Least for the trial nearest to the asked one among those that are slow enough."""
        change = float(np.linalg.norm(trial.positions - self.asked.positions))
        change += abs(math.log(trial.duration / self.asked.duration))
        return max(_share(self.rates(trial)), ENOUGH) + CHANGE * change

    def longer_or_shorter(self) -> _Trial:
        """Return the asked flight with the best duration: a scan, then golden sections about its best."""

        def cost(duration: float) -> float:
            return self.cost(replace(self.asked, duration=duration))

        durations = (self.asked.duration * DURATIONS).tolist()
        index = int(np.argmin([cost(duration) for duration in durations]))
        low, high = durations[max(index - 1, 0)], durations[min(index + 1, len(durations) - 1)]
        for _ in range(REFINEMENTS):
            inner, outer = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
            low, high = (low, outer) if cost(inner) <= cost(outer) else (inner, high)
        return replace(self.asked, duration=min((durations[index], (low + high) / 2), key=cost))

    def changes(self, trial: _Trial, rates: ContactRates) -> Iterator[str]:
        """What is other than asked, in words."""
        problem = self._problem
        if trial.duration != self.asked.duration:
            yield f"a duration of {trial.duration:.3g} s"
        if trial.positions is not self.asked.positions:
            degrees = np.rad2deg(trial.positions).tolist()
            joints = (f"{joint} at {angle:.4g}" for joint, angle in zip(problem.robot.joints, degrees, strict=True))
            yield f"{', '.join(joints)} degrees"
        if trial.free or problem.flight.angular_momentum == "free":
            yield f"an angular momentum of {rates.angular_momentum:.5g} kg m^2/s"

    def postures(self, begin: _Trial, *, durations: bool) -> _Trial:
        """Return the best of seeded steps from a trial: of the joints, and of the duration where asked for."""
        low, high = self._problem.position_limits.T
        edge = INSIDE * (high - low)
        rng = np.random.default_rng(0)
        best, least = begin, self.cost(begin)
        for step in np.geomspace(*STEPS, TRIALS):
            turned = best.positions + step * rng.standard_normal(len(low))
            duration = best.duration * math.exp(step * rng.standard_normal()) if durations else best.duration
            trial = replace(
                best,
                positions=np.clip(turned, low + edge, high - edge),
                duration=float(np.clip(duration, *(self.asked.duration * DURATIONS[[0, -1]]))),
            )
            own, lowest = self._heights(trial.positions)
            if lowest - own >= self._floor and (cost := self.cost(trial)) < least:
                best, least = trial, cost
        return best


def advice(problem: Problem, end: End, momentum: Momentum) -> Iterator[str]:
    """Tell what the best angular momentum, duration and posture would make of the rates; bounded work.

    Parameters
    ----------
    momentum : kg m^2/s, or "midpoint"
    """
    trials = _Trials(problem, end, momentum)
    asked = trials.asked
    least = _share(trials.rates(asked))
    longer = trials.longer_or_shorter()
    tried = [replace(asked, free=True), longer, trials.postures(asked, durations=False)]
    shares = [_share(trials.rates(trial)) for trial in tried]
    if min(shares) > 1:
        tried.append(trials.postures(replace(longer, free=True), durations=True))
    for trial in tried:
        rates = trials.rates(trial)
        if _share(rates) < WORTH_TELLING * least:
            yield f"With {', '.join(trials.changes(trial, rates))} it takes {in_words(rates)}."
