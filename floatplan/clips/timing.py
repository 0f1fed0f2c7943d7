"""How long a repaired flight takes, and how the time of a clip runs around it.

A flight that takes rho times as long as in the clip is the clip played slower in the air by the factor rho; in the
stances around it the pace goes from 1 to rho and back over a ramp, so that no speed jumps.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from floatplan.arrays import Array
from floatplan.clips.flights import ClipFlight, free_time

RAMP = 0.3  # [s] of the clip, over which the clock changes its pace; half a stance at most
GRID = 1e-3  # [s] at which the clock is integrated


def fall_duration(first: float, top: float, last: float, gravity: float) -> float:
    """How long a flight takes from a height of the centre of mass over its top to another, s.

    ``T = sqrt(2 (top - z_0)/g) + sqrt(2 (top - z_T)/g)``
    """
    rise = max(top - first, 0.0)
    drop = max(top - last, 0.0)
    return math.sqrt(2.0 * rise / gravity) + math.sqrt(2.0 * drop / gravity)


@dataclass(frozen=True, eq=False)
class Clock:
    """The time of a repaired clip as a function of the clip's time.

    Attributes
    ----------
    clip_times, new_times : (K,) s, increasing
    """

    clip_times: Array
    new_times: Array

    @classmethod
    def of(
        cls,
        duration: float,
        flights: Sequence[ClipFlight],
        factors: Sequence[float],
        steps: Collection[tuple[int, int]] = (),
    ) -> Clock:
        """Return the clock of a clip of a duration, s, whose flights take ``factors`` times as long.

        ``steps`` are ends of flights at which the pace changes at once, since the stance there keeps its own time: the
        number of each flight, and 0 for its begin or 1 for its end.
        """
        times = _grid(duration, [(flights[number].begin, flights[number].end)[end] for number, end in steps])
        middles = 0.5 * (times[1:] + times[:-1])
        pace = np.ones(len(middles))  # seconds of the repaired clip in one of the clip
        for number, (flight, factor) in enumerate(zip(flights, factors, strict=True)):
            before, after = free_time(flights, number, duration)
            lead = 0.0 if (number, 0) in steps else min(RAMP, 0.5 * (flight.begin - before))
            follow = 0.0 if (number, 1) in steps else min(RAMP, 0.5 * (after - flight.end))
            pace += (factor - 1.0) * _window(middles, flight, lead, follow)
        passed = np.concatenate(([0.0], np.cumsum(pace * np.diff(times))))
        return cls(clip_times=times, new_times=passed)

    @cached_property
    def _new_of_clip(self) -> CubicSpline:
        return CubicSpline(self.clip_times, self.new_times)

    @cached_property
    def _clip_of_new(self) -> CubicSpline:
        return CubicSpline(self.new_times, self.clip_times)

    @property
    def duration(self) -> float:
        """Of the repaired clip, s."""
        return float(self.new_times[-1])

    def to_new(self, times: Array) -> Array:
        """Times of the repaired clip at times of the clip, s."""
        return np.asarray(self._new_of_clip(times))

    def to_clip(self, times: Array) -> Array:
        """Times of the clip at times of the repaired clip, s."""
        return np.asarray(np.clip(self._clip_of_new(times), 0.0, self.clip_times[-1]))


def _grid(duration: float, steps: Sequence[float]) -> Array:
    """Times from 0 to a duration, about GRID apart; the steps of the pace are among them."""
    times = np.linspace(0.0, duration, max(math.ceil(duration / GRID), 2) + 1)
    for step in steps:
        times[np.abs(times - step).argmin()] = step
    return times


def _window(times: Array, flight: ClipFlight, lead: float, follow: float) -> Array:
    """1 in a flight, 0 before the ramp to it and after the ramp from it."""
    least = 1e-9  # [s] of a ramp that is a step
    rising = (times - (flight.begin - lead)) / max(lead, least)
    falling = ((flight.end + follow) - times) / max(follow, least)
    return smoothstep(rising) * smoothstep(falling)


def smoothstep(x: Array) -> Array:
    """From 0 at 0 to 1 at 1, with no rate and no acceleration at either end."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))
