"""Many flights of perturbed robots: how they ended, with corrections and without."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from floatplan.arguments import Outlined
from floatplan.arrays import Array
from floatplan.files import plain
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.replay import Engine


@dataclass(frozen=True, eq=False, repr=False)
class Landings(Outlined):
    """How F flights ended.

    Attributes
    ----------
    orientation : (F,) rad
        Orientation at landing less the goal.
    joints : (F,) rad
        The largest error of a joint at landing.
    torque_peak : (F, m) N m
        Largest magnitude of each moving joint's torque, feedback and noise included.
    clearance : (F,) m
        Least distance to an obstacle or the asked ground; infinite without any.
    """

    orientation: Array
    joints: Array
    torque_peak: Array
    clearance: Array


@dataclass(frozen=True, eq=False)
class Path:
    """A flight's points: times (N,) s, orientation (N,) rad, positions (N, n) rad; of its corrections when and by what.

    ``corrections`` (C, 3): time, predicted miss at once (rad), and whether the motion was changed (1 or 0).
    """

    times: Array
    orientation: Array
    positions: Array
    corrections: Array


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop(Outlined):
    """Result of :func:`closed_loop`.

    Attributes
    ----------
    flights, asked : number of flights flown, and of those asked for: fewer where the budget ended
    corrected, uncorrected : Landings
        With corrections, and with the joints' control on the plan alone: the same robots, the same noise.
    statuses : how often a correction had which
    update_seconds : (U,) s
        Processor time of each call of ``update`` that corrected something.
    plan_torque_peak : (m,) N m of each moving joint
    effort : (m,) N m
        What its motor can; infinite where the URDF does not say.
    paths, uncorrected_paths : of the first flights
    """

    engine: Engine
    rate: float
    flights: int
    asked: int
    seed: int
    perturbation: Perturbation
    joints: tuple[str, ...]
    corrected: Landings
    uncorrected: Landings
    statuses: dict[str, int]
    update_seconds: Array
    plan_torque_peak: Array
    effort: Array
    paths: tuple[Path, ...]
    uncorrected_paths: tuple[Path, ...]
    seconds: float

    @property
    def touched(self) -> int:
        """Number of corrected flights that touched an obstacle."""
        return int((self.corrected.clearance < 0).sum())

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --replan --json`` prints."""
        facts: dict[str, Any] = plain(
            {
                "engine": self.engine,
                "replan": self.rate,
                "flights": self.flights,
                "asked": self.asked,
                "seed": self.seed,
                "perturbation": asdict(self.perturbation) | {"rate_noise": self.perturbation.noise_of_rates},
                "corrected": self._landings(self.corrected),
                "uncorrected": self._landings(self.uncorrected),
                "statuses": self.statuses,
                "update_milliseconds": dict(zip(("median", "p99"), self.update_milliseconds, strict=True)),
                "torque_joints": self.joints,
                "plan_torque_peak": self.plan_torque_peak,
                "seconds": self.seconds,
            }
        )
        return facts

    @property
    def update_milliseconds(self) -> tuple[float, float]:
        """Median and 99th percentile of the processor time of a correction, ms."""
        median, most = 1e3 * np.percentile(self.update_seconds, (50, 99)) if self.update_seconds.size else (0.0, 0.0)
        return float(median), float(most)

    def _landings(self, landings: Landings) -> dict[str, Any]:
        off = np.abs(landings.orientation)
        clearance = landings.clearance[np.isfinite(landings.clearance)]
        return {
            "orientation_error": landings.orientation,
            "orientation_error_median": float(np.median(off)),
            "orientation_error_worst": float(off.max()),
            "joint_error_worst": float(landings.joints.max()),
            "joint_error": landings.joints,
            "torque_peak_median": np.median(landings.torque_peak, axis=0),
            "torque_peak_worst": landings.torque_peak.max(axis=0),
            "clearance_min": float(clearance.min()) if clearance.size else None,
            "touched": int((landings.clearance < 0).sum()),
        }
