"""The fall of a flight's centre of mass: the parabola nearest to it, and how well its frames tell the acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import fdtri, stdtrit

from floatplan.arrays import Array

NOISE_FACTOR = 2.5  # [-] of the frames' own noise, by which motions may be off


@dataclass(frozen=True, eq=False)
class Fall:
    """The parabola nearest to the centre of mass.

    Attributes
    ----------
    fall : m/s^2, downwards
    interval : m/s^2, half of the confidence interval; infinite where there are too few frames
    sideways : m/s^2, the acceleration across
    rms : m, root mean square of the residuals, of one coordinate; NaN of three frames or fewer
    noise : m, root mean square of the changes of residuals from frame to frame, of one coordinate
    least_noise : m, of the centre of mass in a frame: digits of files, and splines between frames
    coefficients : (3, 3)
        Position, velocity and half the acceleration (by row), at the middle of the flight.
    times : (K,) s, of the frames
    places : (K, 3) m, of the centre of mass in the frames, in the world
    """

    least_noise: ClassVar[float] = 5e-5

    fall: float
    interval: float
    sideways: float
    rms: float
    noise: float
    coefficients: Array
    times: Array
    places: Array

    def at(self, times: Array) -> Array:
        """Places (K, 3) of the parabola at times (K,), s."""
        middle = 0.5 * (self.times[0] + self.times[-1])
        return np.vander(times - middle, 3, increasing=True) @ self.coefficients

    @property
    def squares(self) -> float:
        """Sum of the squares of the residuals, m^2."""
        return 3.0 * max(len(self.times) - 3, 0) * self.rms**2

    @property
    def tolerance(self) -> float:
        """By how much the fall may differ from gravity, and an acceleration sideways from zero, m/s^2."""
        return max(0.5, self.interval)  # [m/s^2] whatever the noise

    @property
    def on_parabola(self) -> bool:
        """Whether the centre of mass is as near to the parabola as its noise allows, or nothing tells otherwise."""
        allowed = max(3e-3, NOISE_FACTOR * self.noise)  # [m] of any robot
        return bool(np.isnan(self.rms)) or self.rms <= allowed


def fit_fall(times: Array, places: Array) -> Fall:
    """Fit a parabola to places (K, 3), m, of the centre of mass at times (K,), s.

    With three frames there is no interval, as nothing tells acceleration from noise; with fewer there is no parabola.
    """
    count = len(times)
    if count < 3:
        nothing = np.full((3, 3), np.nan)
        return Fall(np.nan, np.inf, np.nan, rms=np.nan, noise=0.0, coefficients=nothing, times=times, places=places)
    middle = 0.5 * (times[0] + times[-1])
    terms = np.vander(times - middle, 3, increasing=True)
    solution, *_ = np.linalg.lstsq(terms, places, rcond=None)
    coefficients = np.asarray(solution, np.float64)
    left = places - terms @ coefficients
    acceleration = 2.0 * coefficients[2]
    freedom = count - 3
    rms = float(np.sqrt((left**2).sum() / (3 * freedom))) if freedom > 0 else np.nan
    interval = np.inf
    if freedom > 0:
        covariance = np.linalg.inv(terms.T @ terms)
        deviation = 2.0 * np.sqrt(covariance[2, 2]) * max(rms, Fall.least_noise)
        confidence = 0.9995  # [-] one-sided: one false alarm in a thousand flights whose noise is as assumed
        interval = float(stdtrit(3 * freedom, confidence) * deviation)
    return Fall(
        fall=float(-acceleration[2]),
        interval=interval,
        sideways=float(np.hypot(acceleration[0], acceleration[1])),
        rms=rms,
        noise=frame_noise(left) / np.sqrt(3.0),
        coefficients=coefficients,
        times=times,
        places=places,
    )


def fit_longer_fall(times: Array, places: Array, first: int, last: int) -> Fall:
    """Fit a parabola to frames from first to last, and to those before and after that continue it.

    The error of the acceleration is as the number of frames to the power of -2.5. A frame that is next to those of the
    parabola continues it if the squares of what is left grow no more than by noise: an F test of its three coordinates
    (Chow 1960, Econometrica 28, 591). Else the robot stands in it.

    Parameters
    ----------
    times : (K,) s
    places : (K, 3) m
    first, last : of the frames of the parabola, four at least
    """
    confidence = 0.99  # [-] that a frame in the air is taken
    fall = fit_fall(times[first : last + 1], places[first : last + 1])
    steps = [(-1, 0), (0, 1)]
    while steps:
        for step in tuple(steps):
            low = first + step[0]
            high = last + step[1]
            longer = fall
            if low >= 0 and high < len(times):
                longer = fit_fall(times[low : high + 1], places[low : high + 1])
            freedom = 3 * (len(fall.times) - 3)
            grown = longer.squares - fall.squares
            noise = max(fall.rms, Fall.least_noise)
            if longer is fall or grown > 3.0 * noise**2 * fdtri(3, freedom, confidence):
                steps.remove(step)
                continue
            first = low
            last = high
            fall = longer
    return fall


def frame_noise(residuals: Array) -> float:
    """Root mean square of what, of residuals (K, 3), changes from frame to frame, in their unit.

    Second differences of what is smooth are small; of independent noise they have six times its variance.
    """
    if len(residuals) < 4:
        return 0.0
    seconds = np.diff(residuals, 2, axis=0)
    return float(np.sqrt((seconds**2).sum(axis=1).mean() / 6.0))
