"""What every number of a problem may be: one row per key. Beyond it nobody means what is written, and doubles overflow.

Plan files are held to the same rows; URDF files have their own bounds, :mod:`floatplan.robot.urdf.values`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.errors import InputError


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high``, both included, in ``unit``."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        """As a message says it."""
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()


def _within(largest: float, unit: str) -> Range:
    return Range(-largest, largest, unit)


RANGES: dict[str, Range] = {
    "duration": Range(1e-3, 1e4, "s"),
    "orientation": _within(1e4, "rad"),
    "positions": _within(1e4, "rad"),
    "velocities": _within(1e5, "rad/s"),
    "accelerations": _within(1e8, "rad/s^2"),
    "angular_momentum": _within(1e9, "kg m^2/s"),
    "horizontal_velocity": _within(1e4, "m/s"),
    "gravity": Range(0.0, 1e4, "m/s^2"),
    "place": _within(1e6, "m"),
    "radius": Range(0.0, 1e6, "m"),
    "margin": Range(0.0, 1e3, "m"),
    "velocity": _within(1e4, "m/s"),
    "window": _within(1e6, "s"),
    "limit": Range(1e-9, 1e12, ""),
    "slope": Range(0.0, 1e12, "N m s/rad"),
}
PLACES = ("position", "height", "center", "point", "normal", "start", "end")  # keys of problem files that are places, m
RANGES |= dict.fromkeys(PLACES, RANGES["place"])


def check_number(value: object, element: str, key: str, advice: str | None = None) -> None:
    """Refuse what is not a number in the range of a key, or not all such; ``advice`` is for one below it.

    Raises
    ------
    InputError
        Not a number, not finite, or out of the range.
    """
    allowed = RANGES[key]
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.array(np.nan)
    if not np.isfinite(numbers).all():
        raise InputError(f"{value!r} is not a finite number", element=element)
    if allowed.low >= 0 and (numbers < 0).any():
        fault = "is not positive" if allowed.low > 0 else "is negative"
        raise InputError(f"{value} {allowed.unit} {fault}", element=element, advice=advice)
    if (numbers < allowed.low).any() or (numbers > allowed.high).any():
        raise InputError(f"{value!r} is outside {allowed}", element=element)
