"""Replay of whole jumps: perturbed robots fly one in MuJoCo with contact, with corrections in flight and without."""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import SEED, Outlined, made, number, optional, positive, whole
from floatplan.arrays import Array, BoolArray, read_only
from floatplan.errors import InputError
from floatplan.files import plain
from floatplan.pool.threads import one_thread
from floatplan.simulation.closed_loop import BUDGET, MOST_FLIGHTS, MOST_PERIODS
from floatplan.simulation.forward import Gain, given_gains
from floatplan.simulation.jump_flight import AFTER, PERIOD, Flown, FlownJump, JumpControl
from floatplan.simulation.mujoco_model import import_mujoco
from floatplan.simulation.perturbation import OF_TAKEOFF, Perturbation, given_perturbation
from floatplan.stance.jump import Jump
from floatplan.stance.jump_file import load_jump
from floatplan.stance.motion import BASE
from floatplan.tables import Range


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
        Orientation where the flight should end, less the planned one.
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
        """Root mean square of the errors at touchdown, rad."""
        return float(np.sqrt(np.mean(self.pitch**2)))

    def to_dict(self) -> dict[str, Any]:
        """Return what is known of all flights, and in sum."""
        return {
            **{row.name: getattr(self, row.name) for row in fields(self)},
            "landed": int(self.stands.sum()),
            "on_feet_alone": int(self.clean.sum()),
            "links": dict(self.links),
            "pitch_rms": self.pitch_rms,
            "pitch_worst": float(np.abs(self.pitch).max()),
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
    rate : Hz of the corrections in flight, if there were any
    uncorrected, corrected : JumpLandings
        The same robots, the same noise; the latter where there is a rate.
    statuses : how often a correction had which
    motion : FlownJump
        The first flight, corrected where there is a rate.
    seconds : time that it took
    """

    flights: int
    asked: int
    seed: int
    perturbation: Perturbation
    friction: float
    joints: tuple[str, ...]
    kp: Array
    kd: Array
    rate: float | None
    uncorrected: JumpLandings
    corrected: JumpLandings | None
    statuses: dict[str, int]
    motion: FlownJump
    seconds: float

    @property
    def engine(self) -> str:
        """What flew them."""
        words = [f"friction {self.friction:g}", *self.perturbation.in_words()]
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
        return f"joints controlled at {1 / PERIOD:g} Hz, {gains}"

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
                "control": {"rate": 1 / PERIOD, "joints": self.joints, "kp": self.kp, "kd": self.kd},
                "replan": self.rate,
                "uncorrected": self.uncorrected.to_dict(),
                "corrected": None if self.corrected is None else self.corrected.to_dict(),
                "statuses": self.statuses,
                "seconds": self.seconds,
            }
        )
        return facts


@one_thread
def replay_jump(
    jump: Jump | str | Path,
    replan: float | None = None,
    *,
    perturb: str | Perturbation = "",
    flights: int = 1,
    seed: int = 0,
    friction: float | None = None,
    gains: tuple[Gain | None, Gain | None] = (None, None),
    budget: float | None = BUDGET,
) -> JumpReplay:
    """Fly a jump in MuJoCo with contact, from standing to a second after its end.

    Parameters
    ----------
    jump : Jump, or path of a jump file
    replan : float, optional
        Corrections in flight per second, Hz: each robot then flies with them and without.
    perturb : str or Perturbation
        Such as ``"mass=5%,friction=20%,armature=0.01,torque=5%,noise=0.1deg,delay=4ms"``. Delays are rounded to 2 ms.
    flights : int
    seed : int
        The same seed, the same flights.
    friction : float, optional
        Of the ground; left out, that of which the jump is planned.
    gains : two floats or mappings, optional
        Stiffness, N m/rad, and damping, N m s/rad, of all joints or of some by name.
    budget : float, optional
        Time, s, after which no new flight begins. None: no end.

    Raises
    ------
    InputError
        No jump was found, a number is wrong, a perturbation makes no sense, or MuJoCo is not installed.
    FloatplanError
        Not one flight ended within the budget.
    """
    began = clock.perf_counter()
    flights = whole(Range(1, MOST_FLIGHTS, ""))(flights, "flights")
    replan = optional(positive(1 / PERIOD, "Hz"))(replan, "replan")
    seed, budget = SEED(seed, "seed"), optional(positive(unit="s"))(budget, "budget")
    perturbation = given_perturbation(perturb)
    perturbation.refuse(OF_TAKEOFF, "is for plans: a jump's takeoff is what its stance makes of it", "leave it out")
    jump = made(Jump)(jump, "jump") if not isinstance(jump, str | Path) else load_jump(jump)
    if jump.flight is None:
        raise InputError("no jump was found, so there is nothing to fly", source=jump.problem.name, element="status")
    if jump.duration + AFTER > MOST_PERIODS * PERIOD:
        raise InputError(f"a jump of {jump.duration:g} s is too long to be flown: at most {MOST_PERIODS * PERIOD:g} s")
    friction = jump.request.friction if friction is None else number(Range(0.0, 10.0, ""))(friction, "friction")
    import_mujoco()
    joints = tuple(jump.problem.robot.model.names)[BASE + 1 :]
    kp, kd = (
        given_gains(joints, each, name, np.full(len(joints), usual))
        for each, name, usual in zip(gains, ("kp", "kd"), (40.0, 1.0), strict=True)
    )
    control = JumpControl(jump, np.stack((kp, kd)), replan)
    corrected: list[Flown] = []
    uncorrected: list[Flown] = []
    for flight in range(flights):
        if budget is not None and flight and clock.perf_counter() - began > budget:
            break
        for correct, ends in ((False, uncorrected), *([(True, corrected)] if replan is not None else [])):
            ends.append(control.fly(perturbation, friction, (seed, flight), correct, record=not flight))
    return JumpReplay(
        flights=len(uncorrected),
        asked=flights,
        seed=seed,
        perturbation=perturbation,
        friction=friction,
        joints=joints,
        kp=read_only(kp),
        kd=read_only(kd),
        rate=replan,
        uncorrected=_landings(uncorrected),
        corrected=_landings(corrected) if corrected else None,
        statuses=dict(sum((each.statuses for each in corrected), Counter[str]())),
        motion=(corrected or uncorrected)[0].motion,
        seconds=clock.perf_counter() - began,
    )


def _landings(flown: Sequence[Flown]) -> JumpLandings:
    touched = tuple(each.touched for each in flown)
    columns = [
        [each.stands for each in flown],
        *([getattr(each, name) for each in flown] for name in ("pitch", "torque", "slid")),
    ]
    stands, *others = map(read_only, columns)
    return JumpLandings(stands.astype(bool), touched, *others)
