"""Verdicts from enclosures, and the tolerances of what the file says of itself.

A limit or a tolerance that is not finite proves nothing, and a bound that is not known is infinite.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.certificate.enclosure import Balls
from floatplan.plans.verdicts import Finding, Kind, Subject

SAME = 1e-12  # [-] two numbers in the file that say the same
RECORDED_PEAK = 2e-3  # [-] recorded torque and velocity peaks, which were found on a grid
RECORDED_CLEARANCE = 2e-4  # [m]


def at_most(
    kind: Kind, subject: Subject, upper: float, attained: float, limit: float, tolerance: float, instant: float | None
) -> Finding:
    """Finding on a quantity that is at most ``upper`` and somewhere at least ``attained``."""
    upper, allowed = math.inf if math.isnan(upper) else upper, limit + tolerance
    if upper <= allowed and math.isfinite(allowed):
        return Finding(kind, subject, "proved", upper, instant, limit)
    if attained > allowed:
        return Finding(kind, subject, "refuted", attained, instant, limit)
    return Finding(kind, subject, "undecided", upper, instant, limit, upper - allowed)


def at_least(
    kind: Kind, subject: Subject, lower: float, attained: float, limit: float, tolerance: float, instant: float | None
) -> Finding:
    """Finding on a quantity that is at least ``lower`` and somewhere at most ``attained``."""
    mirrored = at_most(kind, subject, -lower, -attained, -limit, tolerance, instant)
    bound = attained if mirrored.verdict == "refuted" else -math.inf if math.isnan(lower) else lower
    return replace(mirrored, bound=bound, limit=limit)


def near(
    kind: Kind, subject: Subject, values: Balls, wanted: Any, tolerance: float, instant: float | None = None
) -> Finding:
    """Finding on numbers that should equal the wanted ones; the bound is on the largest deviation."""
    upper, attained = deviations(values, wanted)
    return at_most(kind, subject, float(upper), float(attained), 0.0, tolerance, instant)


def deviations(values: Balls, wanted: Any) -> tuple[Array, Array]:
    """What the largest deviation in each row is at most, and at least."""
    deviation = np.abs(values.mid - wanted)
    radius = values.rad + 2.0**-51 * (np.abs(values.mid) + deviation)
    return (deviation + radius).max(axis=-1, initial=0.0), (deviation - radius).max(axis=-1, initial=0.0)
