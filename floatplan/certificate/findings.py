"""What the certificate says about one constraint, and the tolerances of what the file says of itself.

A limit or a tolerance that is not finite proves nothing, and a bound that is not known is infinite.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from floatplan.certificate.enclosure import Balls

Verdict: TypeAlias = Literal["proved", "refuted", "undecided"]

SAME = 1e-12  # [-] two numbers in the file that say the same
RECORDED_PEAK = 2e-3  # [-] recorded torque and velocity peaks, which were found on a grid
RECORDED_CLEARANCE = 2e-4  # [m]


@dataclass(frozen=True)
class Finding:
    """One constraint.

    Attributes
    ----------
    label : which constraint
    verdict : "proved", "refuted" or "undecided"
    bound : the proved bound; where refuted, a value that is attained
    instant : s, where the bound is nearly attained, or the violation is; None where it belongs to no instant
    limit : what the bound is compared with
    gap : where undecided, the distance between what is proved and what is asked
    """

    label: str
    verdict: Verdict
    bound: float | None
    instant: float | None = None
    limit: float | None = None
    gap: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers; ``gap`` only where undecided."""
        values = {"label": self.label, "verdict": self.verdict, "bound": self.bound, "instant": self.instant}
        values |= {"limit": self.limit}
        return values | ({"gap": self.gap} if self.verdict == "undecided" else {})


def at_most(
    label: str, upper: float, attained: float, limit: float, tolerance: float, instant: float | None
) -> Finding:
    """Finding on a quantity that is at most ``upper`` and somewhere at least ``attained``."""
    upper, allowed = math.inf if math.isnan(upper) else upper, limit + tolerance
    if upper <= allowed and math.isfinite(allowed):
        return Finding(label, "proved", upper, instant, limit)
    if attained > allowed:
        return Finding(label, "refuted", attained, instant, limit)
    return Finding(label, "undecided", upper, instant, limit, upper - allowed)


def at_least(
    label: str, lower: float, attained: float, limit: float, tolerance: float, instant: float | None
) -> Finding:
    """Finding on a quantity that is at least ``lower`` and somewhere at most ``attained``."""
    lower, allowed = -math.inf if math.isnan(lower) else lower, limit - tolerance
    if lower >= allowed and math.isfinite(allowed):
        return Finding(label, "proved", lower, instant, limit)
    if attained < allowed:
        return Finding(label, "refuted", attained, instant, limit)
    return Finding(label, "undecided", lower, instant, limit, allowed - lower)


def near(label: str, values: Balls, wanted: Any, tolerance: float, instant: float | None = None) -> Finding:
    """Finding on numbers that should equal the wanted ones; the bound is on the largest deviation."""
    deviation = np.abs(np.atleast_1d(values.mid - np.asarray(wanted, dtype=np.float64)))
    radius = np.atleast_1d(values.rad) + 2.0**-51 * (np.abs(np.atleast_1d(values.mid)) + deviation)
    upper, attained = (deviation + radius).max(initial=0.0), (deviation - radius).max(initial=0.0)
    return at_most(label, float(upper), float(attained), 0.0, tolerance, instant)


def worst(findings: tuple[Finding, ...]) -> Verdict:
    """Refuted if anything is, else undecided if anything is, else proved."""
    verdicts = {finding.verdict for finding in findings}
    if "refuted" in verdicts:
        return "refuted"
    return "undecided" if "undecided" in verdicts else "proved"
