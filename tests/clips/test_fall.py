"""The parabola of a fall, and the frames before and after a flight that continue it."""

from __future__ import annotations

import clip_samples as samples
import numpy as np
from scipy import stats

from floatplan.clips.fall import Fall, fit_fall, fit_longer_fall

NOISE = 5e-4  # [m]
TIMES = np.arange(31) / 30.0
TAKEOFF = 0.36  # [s]
LANDING = 0.70  # [s]
FIRST, LAST = 13, 19  # frames in which feet are high
IN_AIR = slice(11, 22)  # frames between takeoff and landing


def hop(gravity: float) -> samples.Array:
    """Places (31, 3) of a point that rests, falls and rests, m."""
    since = np.clip(TIMES - TAKEOFF, 0.0, LANDING - TAKEOFF)
    heights = 0.3 + 0.5 * gravity * since * (LANDING - TAKEOFF - since)
    return np.stack([0.2 * since, np.zeros(31), heights], axis=1)


def test_a_fall_is_continued_until_takeoff_and_landing() -> None:
    longer = fit_longer_fall(TIMES, hop(9.0), FIRST, LAST)
    np.testing.assert_array_equal(longer.times, TIMES[IN_AIR])
    np.testing.assert_allclose(longer.fall, 9.0, rtol=1e-12)


def test_a_fall_that_is_continued_is_known_better() -> None:
    few = []
    many = []
    rng = np.random.default_rng(0)
    for _ in range(100):
        places = hop(6.0) + NOISE * rng.normal(size=(31, 3))
        few.append(fit_fall(TIMES[FIRST : LAST + 1], places[FIRST : LAST + 1]).fall)
        many.append(fit_longer_fall(TIMES, places, FIRST, LAST).fall)
    error_of_few, error_of_many = (np.sqrt(np.mean((np.array(falls) - 6.0) ** 2)) for falls in (few, many))
    # least squares over n frames: the error is as sqrt(720 / (n (n^2 - 1) (n^2 - 4))), 3.2 times less of 11 than of 7
    assert error_of_many < 0.5 * error_of_few


def test_a_fall_at_the_ends_of_a_clip_is_as_long_as_its_frames() -> None:
    places = hop(9.0)[IN_AIR]
    assert len(fit_longer_fall(TIMES[IN_AIR], places, 0, 10).times) == 11
    assert len(fit_longer_fall(TIMES[IN_AIR], places, 3, 7).times) == 11


def test_the_interval_is_that_of_students_t() -> None:
    fall = fit_fall(TIMES[IN_AIR], hop(9.0)[IN_AIR])
    since = TIMES[IN_AIR] - TIMES[IN_AIR].mean()
    terms = np.vander(since, 3, increasing=True)
    deviation = 2.0 * np.sqrt(np.linalg.inv(terms.T @ terms)[2, 2]) * Fall.least_noise
    np.testing.assert_allclose(fall.interval, stats.t.ppf(0.9995, 24) * deviation, rtol=1e-12)
