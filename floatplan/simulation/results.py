"""How runs of disturbed robots landed: of plans, in the air, and of jumps and recorded motions, on the ground."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import chain
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from floatplan.arguments import Outlined
from floatplan.arrays import Array, BoolArray
from floatplan.files import json_value
from floatplan.simulation.mujoco_model import balanced_in_words
from floatplan.simulation.perturbation import Perturbation
from floatplan.simulation.simulated_jump import SimulatedJump
from floatplan.tables import Engine

Motion = TypeVar("Motion")


@dataclass(frozen=True, eq=False)
class Trace:
    """Points of a run of a plan: times (N,) s, orientation (N,) rad, positions (N, n) rad; and its corrections.

    In space the orientation is the angle from the goal's attitude, and a predicted miss the size of one.

    ``corrections`` (C, 3): time, predicted miss at once (rad), and whether the motion was changed (1 or 0).
    """

    times: Array
    orientation: Array
    positions: Array
    corrections: Array


@dataclass(frozen=True, eq=False)
class SimulatedRun(Generic[Motion]):
    """One run: its ``landing``, by the fields of :class:`Landings`, its motion, and its corrections.

    ``statuses`` says how many corrections had which status, ``seconds`` the processor time of each correction.
    """

    landing: Mapping[str, Any]
    motion: Motion
    statuses: Counter[str]
    seconds: Sequence[float] = ()
    balanced: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Landings(Outlined):
    """How F runs landed, a row each."""

    @classmethod
    def of(cls, landings: Sequence[Mapping[str, Any]]) -> Self:
        """Collect runs' landings, by the fields of the class: arrays of numbers, tuples of names."""
        columns: dict[str, Any] = {}
        for row in fields(cls):
            column = [landing[row.name] for landing in landings]
            columns[row.name] = tuple(column) if isinstance(column[0], tuple) else np.array(column)
        return cls(**columns)


@dataclass(frozen=True, eq=False, repr=False)
class PlanLandings(Landings):
    """How F runs of a plan landed.

    Attributes
    ----------
    orientation : (F,) rad
        Orientation at landing less the goal; in space the angle between the two attitudes.
    joints : (F,) rad
        The largest error of a joint at landing.
    torque_peak : (F, m) N m
        Largest magnitude of each moving joint's torque, feedback and noise included.
    clearance : (F,) m
        Least distance to an obstacle or the problem's ground; infinite without any.
    """

    orientation: Array
    joints: Array
    torque_peak: Array
    clearance: Array

    @property
    def touched(self) -> int:
        """Number of runs that touched an obstacle."""
        return int((self.clearance < 0).sum())

    def to_dict(self) -> dict[str, Any]:
        """Return the errors of all runs, their medians and the worst."""
        off = np.abs(self.orientation)
        clearance = self.clearance[np.isfinite(self.clearance)]
        return {
            "orientation_error": self.orientation,
            "orientation_error_median": float(np.median(off)),
            "orientation_error_worst": float(off.max()),
            "joint_error_worst": float(self.joints.max()),
            "joint_error": self.joints,
            "torque_peak_median": np.median(self.torque_peak, axis=0),
            "torque_peak_worst": self.torque_peak.max(axis=0),
            "clearance_min": float(clearance.min()) if clearance.size else None,
            "touched": self.touched,
        }


@dataclass(frozen=True, eq=False, repr=False)
class JumpLandings(Landings):
    """How F runs of a jump or a recorded motion landed.

    Attributes
    ----------
    stands : (F,)
        Whether, a second after the motion's end, the base is level, rotated by all of the motion's turns, however many,
        and not far lower than planned.
    touched : (F) names of links other than feet that touched the ground
    pitch : (F,) rad
        Orientation less the planned one at the instant at which the flight should end, as planned or as corrections
        expect it, whether or not the robot has landed by then; in space the angle between the two attitudes, at most
        180 degrees. Of several flights that of the largest size. NaN of a motion that diverged before.
    torque : (F,)
        The largest request of a motor over its limit at its speed; what is over 1 was cut off.
    slid : (F,) m
        The longest distance that a foot slid on the ground until the jump's end.
    """

    stands: BoolArray
    touched: tuple[tuple[str, ...], ...]
    pitch: Array
    torque: Array
    slid: Array

    @property
    def clean(self) -> BoolArray:
        """Whether each (F,) stands, and touched the ground only by its feet."""
        return self.stands & [not links for links in self.touched]

    @property
    def links(self) -> Counter[str]:
        """How many runs touched the ground with which link."""
        return Counter(chain.from_iterable(self.touched))

    @property
    def pitch_rms(self) -> float:
        """Root mean square of errors at the expected landing, rad, of runs that did not diverge; NaN without any."""
        came = self.pitch[np.isfinite(self.pitch)]
        return float(np.sqrt(np.mean(came**2))) if came.size else np.nan

    @property
    def pitch_worst(self) -> float:
        """The largest size of an error at the expected landing, rad; NaN without any."""
        came = self.pitch[np.isfinite(self.pitch)]
        return float(np.abs(came).max()) if came.size else np.nan

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of all runs, and summaries."""
        return {
            **{row.name: getattr(self, row.name) for row in fields(self)},
            "landed": int(self.stands.sum()),
            "on_feet_alone": int(self.clean.sum()),
            "links": dict(self.links),
            "pitch_rms": self.pitch_rms,
            "pitch_worst": self.pitch_worst,
            "torque_worst": float(self.torque.max()),
            "slid_median": float(np.median(self.slid)),
            "slid_worst": float(self.slid.max()),
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Runs(Outlined):
    """Many runs of perturbed robots, one run a robot.

    Attributes
    ----------
    flights, asked : number of runs, and of runs that were requested: the former is less where the budget was spent
    seed : int
    perturbation : Perturbation
    joints : names of the joints that move
    statuses : status -> number of corrections that had it
    seconds : s, of all runs
    """

    flights: int
    asked: int
    seed: int
    perturbation: Perturbation
    joints: tuple[str, ...]
    statuses: dict[str, int]
    seconds: float

    @property
    def perturbation_facts(self) -> dict[str, Any]:
        """What ``--json`` prints of the perturbation."""
        return asdict(self.perturbation) | {"rate_noise": self.perturbation.noise_of_rates}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClosedLoop(Runs):
    """Result of :func:`floatplan.closed_loop`: as :class:`Runs`.

    Attributes
    ----------
    engine, rate : as requested; rate in Hz
    corrected, uncorrected : PlanLandings
        With corrections, and with the joints' control only on the plan: the same robots, the same noise.
    update_seconds : (U,) s
        Processor time of each call of ``update``, also of those that were refused or invalid.
    plan_torque_peak : (m,) N m of each moving joint
    effort : (m,) N m
        Of its motor; infinite where the URDF has none.
    paths, uncorrected_paths : of the first runs
    """

    engine: Engine
    rate: float
    corrected: PlanLandings
    uncorrected: PlanLandings
    update_seconds: Array
    plan_torque_peak: Array
    effort: Array
    paths: tuple[Trace, ...]
    uncorrected_paths: tuple[Trace, ...]
    shown: ClassVar[Sequence[str]] = (
        *("engine", "rate", "flights", "asked", "seed", "perturbation", "joints", "corrected", "uncorrected"),
        *("statuses", "update_seconds", "plan_torque_peak", "effort", "paths", "uncorrected_paths", "seconds"),
    )

    @property
    def touched(self) -> int:
        """Number of corrected runs that touched an obstacle."""
        return self.corrected.touched

    @property
    def update_milliseconds(self) -> tuple[float, float]:
        """Median and 99th percentile of the processor time of a correction, ms."""
        median, most = 1e3 * np.percentile(self.update_seconds, (50, 99)) if self.update_seconds.size else (0.0, 0.0)
        return float(median), float(most)

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --replan --json`` prints."""
        facts: dict[str, Any] = json_value(
            {
                "engine": self.engine,
                "replan": self.rate,
                "flights": self.flights,
                "asked": self.asked,
                "seed": self.seed,
                "perturbation": self.perturbation_facts,
                "corrected": self.corrected.to_dict(),
                "uncorrected": self.uncorrected.to_dict(),
                "statuses": self.statuses,
                "update_milliseconds": dict(zip(("median", "p99"), self.update_milliseconds, strict=True)),
                "torque_joints": self.joints,
                "plan_torque_peak": self.plan_torque_peak,
                "seconds": self.seconds,
            }
        )
        return facts


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class JumpReplay(Runs):
    """Result of :func:`floatplan.replay_jump`: as :class:`Runs`.

    Attributes
    ----------
    friction : of the ground, before it is perturbed
    period : s, of the joints' control
    feedback : rad/s, a bandwidth from which all gains follow; else None
    kp, kd : (J,) N m/rad, N m s/rad; where gains differ by phase those of the flight
    phase_gains : (P, 2, J), stiffness and damping of each phase, with ``feedback``; else None
    tried : how many pairs of gains were tried, where none were requested; else 0
    ringing : joints that ring in flight, late as measurements are, with the inertia and damping that the plan knows
    rate : Hz of the corrections in flight, if there were any
    uncorrected, corrected : JumpLandings
        Of the same robots with the same noise; ``corrected`` where there is a rate.
    balanced : bodies whose inertia MuJoCo refuses -> change of a principal moment, kg m^2
    motion : SimulatedJump
        That of the first run, corrected where there is a rate.
    """

    friction: float
    period: float
    feedback: float | None
    kp: Array
    kd: Array
    phase_gains: Array | None
    tried: int
    ringing: Sequence[str]
    rate: float | None
    uncorrected: JumpLandings
    corrected: JumpLandings | None
    balanced: Mapping[str, float]
    motion: SimulatedJump
    shown: ClassVar[Sequence[str]] = ("landed", "flights", "engine", "control", "rate", "statuses", "seconds")

    @property
    def engine(self) -> str:
        """What simulated the runs."""
        words = [f"friction {self.friction:g}", *self.perturbation.in_words()]
        if self.balanced:
            words.append(f"inertias {balanced_in_words(self.balanced)}")
        return f"MuJoCo with contact, {', '.join(words)}"

    @property
    def control(self) -> str:
        """How the joints were controlled."""
        words = f"joints controlled at {1 / self.period:g} Hz, {_gains_in_words(self.kp, self.kd)}"
        if self.phase_gains is not None:
            stiffest = self.phase_gains.max(axis=0)
            most = f"kp {stiffest[0].max():.3g}, kd {stiffest[1].max():.3g} at most in stances"
            return f"{words} in flight, {most}: feedback of {self.feedback:g} rad/s"
        if self.tried:
            words = f"{words}, the best of {self.tried} tried"
        if self.ringing and not self.landed:
            shown = 4  # names, and how many more
            names = ", ".join(self.ringing[:shown])
            more = f" and {len(self.ringing) - shown} more" if len(self.ringing) > shown else ""
            delay = round(self.perturbation.delay / self.period) * self.period
            late = f" where measurements are {1e3 * delay:g} ms late" if delay else ""
            advice = "give other --kp and --kd, or --feedback; rotors that are not known belong in [robot] armature"
            return f"{words}; these ring in flight{late}: {names}{more}; {advice}"
        return words

    @property
    def landings(self) -> JumpLandings:
        """The landings with corrections, where there are any."""
        return self.corrected or self.uncorrected

    @property
    def landed(self) -> bool:
        """Whether all robots stand in the end (``Bench.landed`` is a number)."""
        return bool(self.landings.stands.all())

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --json`` prints of a jump."""
        facts: dict[str, Any] = json_value(
            {
                "engine": "mujoco",
                "landed": self.landed,
                "flights": self.flights,
                "asked": self.asked,
                "seed": self.seed,
                "friction": self.friction,
                "perturbation": self.perturbation_facts,
                "control": {
                    "rate": 1 / self.period,
                    "joints": self.joints,
                    "feedback": self.feedback,
                    "kp": self.kp,
                    "kd": self.kd,
                    "phase_gains": self.phase_gains,
                    "tried": self.tried,
                    "ringing": list(self.ringing),
                },
                "replan": self.rate,
                "uncorrected": self.uncorrected.to_dict(),
                "corrected": None if self.corrected is None else self.corrected.to_dict(),
                "statuses": self.statuses,
                "balanced": dict(self.balanced),
                "seconds": self.seconds,
            }
        )
        return facts


def _gains_in_words(kp: Array, kd: Array) -> str:
    """Say the least and the largest gains."""
    words = []
    for name, values, unit in (("kp", kp, "N m/rad"), ("kd", kd, "N m s/rad")):
        least = f"{values.min():.3g}"
        most = f"{values.max():.3g}"
        size = most if least == most else f"{least} to {most}"
        words.append(f"{name} {size} {unit}")
    return ", ".join(words)
