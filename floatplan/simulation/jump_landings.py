"""What became of a jump that was flown: how each flight landed, and the motion of one."""

from collections import Counter
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arguments import Outlined
from floatplan.arrays import Array, BoolArray, read_only
from floatplan.files import plain
from floatplan.simulation.mujoco_model import balanced_in_words
from floatplan.simulation.perturbation import Perturbation
from floatplan.stance.jump_motion import JumpMotion
from floatplan.stance.motion import JumpState

PERIOD = 2e-3  # [s] of the joints' control
AFTER = 1.0  # [s] that it is to stand at the end


@dataclass(frozen=True, eq=False, repr=False)
class FlownJump(JumpMotion):
    """What a robot made of a jump: a motion as this is, between recorded instants; it goes on for ``AFTER``."""

    recorded: JumpState | None = None

    @property
    def duration(self) -> float:
        """From standing until it should stand again for ``AFTER``, s."""
        return super().duration + AFTER

    def at(self, times: npt.ArrayLike) -> JumpState:
        """State at times (N,) s from the jump's start; errors as of a jump's."""
        assert self.recorded is not None
        known, instants = self.recorded, np.atleast_1d(np.asarray(times, dtype=np.float64)).ravel()

        def between(values: Any) -> Any:
            if isinstance(values, dict):
                return {name: between(each) for name, each in values.items()}
            return read_only(np.stack([np.interp(instants, known.times, each) for each in values.T], axis=1))

        taken = [between(getattr(known, row.name)) for row in fields(known)[1:]]
        return JumpState(read_only(instants), *taken)


@dataclass(frozen=True, eq=False, repr=False)
class JumpLandings(Outlined):
    """How F flights of a jump went.

    Attributes
    ----------
    stands : (F,)
        Whether the base is level, turned by all of the jump's turns and not far lower than planned, a second after its
        end.
    touched : (F) names of links other than feet that touched the ground
    pitch : (F,) rad
        Orientation where the flight should end, less the planned one; NaN of a motion that became none before.
    torque : (F,)
        The largest that was wanted of a motor over what it can at its speed; what is over 1 was cut off.
    slid : (F,) m
        The longest way that a foot slid on the ground until the jump's end.
    """

    stands: BoolArray
    touched: tuple[tuple[str, ...], ...]
    pitch: Array
    torque: Array
    slid: Array

    @property
    def clean(self) -> BoolArray:
        """Whether each (F,) stands, and touched the ground by its feet alone."""
        return self.stands & [not links for links in self.touched]

    @property
    def links(self) -> Counter[str]:
        """How many flights touched the ground with which link."""
        return Counter(link for links in self.touched for link in links)

    @property
    def pitch_rms(self) -> float:
        """Root mean square of the errors at touchdown, rad, of those that came so far."""
        return float(np.sqrt(np.mean(self.pitch[np.isfinite(self.pitch)] ** 2))) if self.came else np.nan

    @property
    def pitch_worst(self) -> float:
        """The largest of them, rad."""
        return float(np.nanmax(np.abs(self.pitch))) if self.came else np.nan

    @property
    def came(self) -> bool:
        """Whether any motion came so far."""
        return bool(np.isfinite(self.pitch).any())

    def to_dict(self) -> dict[str, Any]:
        """Return what is known of all flights, and in sum."""
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


@dataclass(frozen=True, eq=False, repr=False)
class JumpReplay(Outlined):
    """Result of :func:`replay_jump`.

    Attributes
    ----------
    flights, asked : number of flights flown, and of those asked for: fewer where the budget ended
    seed : int
    perturbation : Perturbation
    friction : of the ground, as far as it is not perturbed
    joints : (J) names of all joints
    kp, kd : (J,) N m/rad, N m s/rad
    tried : how many pairs of them were, where none were given; else 0
    rate : Hz of the corrections in flight, if there were any
    uncorrected, corrected : JumpLandings
        The same robots, the same noise; the latter where there is a rate.
    statuses : how often a correction had which
    balanced : bodies whose inertia MuJoCo refuses -> change of a principal moment, kg m^2
    motion : FlownJump
        The first flight, corrected where there is a rate.
    seconds : time that it took
    """

    shown = ("landed", "flights", "engine", "control", "rate", "statuses", "seconds")

    flights: int
    asked: int
    seed: int
    perturbation: Perturbation
    friction: float
    joints: tuple[str, ...]
    kp: Array
    kd: Array
    tried: int
    rate: float | None
    uncorrected: JumpLandings
    corrected: JumpLandings | None
    statuses: dict[str, int]
    balanced: dict[str, float]
    motion: FlownJump
    seconds: float

    @property
    def engine(self) -> str:
        """What flew them."""
        words = [f"friction {self.friction:g}", *self.perturbation.in_words()]
        words += [f"inertias {balanced_in_words(self.balanced)}"] if self.balanced else []
        return f"MuJoCo with contact, {', '.join(words)}"

    @property
    def control(self) -> str:
        """How the joints were controlled."""
        gains = ", ".join(
            f"{name} {values[0]:.3g} {unit}"
            if np.ptp(values) == 0
            else f"{name} {values.min():.3g} to {values.max():.3g} {unit}"
            for name, values, unit in (("kp", self.kp, "N m/rad"), ("kd", self.kd, "N m s/rad"))
        )
        searched = f", the best of {self.tried} tried" if self.tried else ""
        return f"joints controlled at {1 / PERIOD:g} Hz, {gains}{searched}"

    @property
    def landings(self) -> JumpLandings:
        """Those with corrections, where there are any."""
        return self.corrected or self.uncorrected

    @property
    def landed(self) -> bool:
        """Whether all flights stand in the end."""
        return bool(self.landings.stands.all())

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --json`` prints of a jump."""
        facts: dict[str, Any] = plain(
            {
                "engine": "mujoco",
                "landed": self.landed,
                **{name: getattr(self, name) for name in ("flights", "asked", "seed", "friction")},
                "perturbation": asdict(self.perturbation) | {"rate_noise": self.perturbation.noise_of_rates},
                "control": {
                    "rate": 1 / PERIOD,
                    "joints": self.joints,
                    "kp": self.kp,
                    "kd": self.kd,
                    "tried": self.tried,
                },
                "replan": self.rate,
                "uncorrected": self.uncorrected.to_dict(),
                "corrected": None if self.corrected is None else self.corrected.to_dict(),
                "statuses": self.statuses,
                "balanced": self.balanced,
                "seconds": self.seconds,
            }
        )
        return facts
