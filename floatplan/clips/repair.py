"""A clip whose flights fly: those that are not physical planned anew, and the stances around them adapted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arguments import FINITE, many, one_of, optional, whole
from floatplan.clips.bent_stances import angle_between, foot_misses
from floatplan.clips.check import ClipCheck, check_clip, or_none, share_table
from floatplan.clips.clip import Clip
from floatplan.clips.flights import STANCE_SPAN, ClipFlight
from floatplan.clips.formats import check_rate
from floatplan.clips.judge import FlightJudgement
from floatplan.clips.planned.planner import ClipStance, StancePlanner
from floatplan.clips.repaired_flight import CHOICE, Choice, PlannedFlight, plan_flight_anew
from floatplan.clips.repaired_motion import RepairedMotion
from floatplan.clips.stance_forces import STEPS, StanceFigures, stance_figures
from floatplan.errors import InputError
from floatplan.jumps.exact import NoExactStanceError
from floatplan.jumps.model import casadi
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.pool import one_thread
from floatplan.tables import CHOICES, GRAVITY, HIGHEST_DEGREE, LOWEST_DEGREE, Range, StanceMethod

FORCE_STEP = 0.01  # [s] between the instants of a stance at which forces of the ground are computed


@dataclass(frozen=True, eq=False)
class FlightRepair:
    """The report on one flight of a clip: what planning it anew gave, and how the result fits into the clip.

    Attributes
    ----------
    flight : ClipFlight
    repaired : PlannedFlight, optional
        None where the flight was not to be repaired.
    seam_base, seam_turn, seam_foot : m, rad, m
        Largest jump of the base's position and attitude at the flight's ends; largest distance of a foot that stands
        before or after the flight from where the clip has it.
    stance : StanceFigures, optional
        Of bent stances before and after the flight; None where the flight was not replaced.
    stances : tuple of ClipStance
        Those of takeoff and landing, where stances were to be planned. A stance between two flights is listed by both.
    """

    flight: ClipFlight
    repaired: PlannedFlight | None
    seam_base: float = 0.0
    seam_turn: float = 0.0
    seam_foot: float = 0.0
    stance: StanceFigures | None = None
    stances: tuple[ClipStance, ...] = ()

    @property
    def is_adhesive(self) -> bool:
        """Whether the ground would have to be adhesive in a stance that is bent."""
        planned = bool(self.stances) and all(stance.planned for stance in self.stances)
        return not planned and self.stance is not None and self.stance.vertical_least < 0

    def to_dict(self) -> dict[str, Any]:
        """As the command line's ``--json`` has it."""
        repaired = self.repaired
        if repaired is None:
            return {"begin": self.flight.begin, "end": self.flight.end, "changed": False}
        return {
            "begin": self.flight.begin,
            "end": self.flight.end,
            "changed": repaired.repairable,
            "choice": repaired.choice,
            "duration_before": self.flight.duration,
            "duration_after": repaired.duration,
            "joints_rms": or_none(repaired.joints_rms),
            "joints_largest": or_none(repaired.joints_largest),
            "base_largest": or_none(repaired.base_largest),
            "rate_share": share_table(repaired.rate_share),
            "torque_share": share_table(repaired.torque_share),
            "seam": {"base": self.seam_base, "turn": self.seam_turn, "foot": self.seam_foot},
            "stance": None
            if self.stance is None
            else {
                "vertical_least": self.stance.vertical_least,
                "friction": or_none(self.stance.friction),
                "pressure_outside": self.stance.pressure_outside,
            },
            "repairable": repaired.repairable,
            "reason": repaired.reason or None,
            **({"stances": [stance.to_dict() for stance in self.stances]} if self.stances else {}),
        }


@dataclass(frozen=True, eq=False)
class ClipRepair:
    """What was done about a clip.

    Attributes
    ----------
    before : ClipCheck
    flights : tuple of FlightRepair
        Of every flight of the clip, in the order of time.
    result : Clip
        The repaired clip; that of ``before`` where nothing was changed.
    """

    before: ClipCheck
    flights: tuple[FlightRepair, ...]
    result: Clip

    @cached_property
    def after(self) -> ClipCheck:
        """The check of the result, computed on first use."""
        return self.before if self.result is self.before.clip else check_clip(self.result, self.before.gravity)

    @property
    def ok(self) -> bool:
        """Whether every flight that was to be repaired is, and no flight of the result is unphysical."""
        repaired = all(flight.repaired is None or flight.repaired.repairable for flight in self.flights)
        return repaired and self.after.ok

    @property
    def changed(self) -> bool:
        """Whether anything was changed."""
        return any(flight.repaired is not None and flight.repaired.repairable for flight in self.flights)

    def table(self) -> list[dict[str, Any]]:
        """One row a flight, with the keys of ``repairs`` of the command line's ``--json``."""
        return [flight.to_dict() for flight in self.flights]

    def to_dict(self) -> dict[str, Any]:
        """Everything, as the command line's ``--json`` has it."""
        return {**self.before.to_dict(), "repairs": self.table()}

    def __repr__(self) -> str:
        done = sum(flight.repaired is not None and flight.repaired.repairable for flight in self.flights)
        return f"ClipRepair({self.before.clip.path.name!r}, {done} of {len(self.flights)} flights repaired)"


@one_thread
def repair_clip(
    clip: Clip,
    choice: Choice = "auto",
    *,
    flights: Sequence[int] | None = None,
    degree: int | None = None,
    rate: float | None = None,
    gravity: float = GRAVITY,
    stances: StanceMethod = "bent",
) -> tuple[Clip, ClipRepair]:
    """Make the flights of a clip fly.

    Each flight that is unphysical is planned anew, as near to the clip as a flight can be, with the clip's postures at
    both ends; the clip's time runs on around it, feet that stand stay where they are. Flights that are physical, or
    undecided, are left as they are.

    Parameters
    ----------
    clip : Clip
    choice : "retime" (postures and heights stay), "raise" (the duration stays), a number from 0, which is
        "retime", to 1, which is "raise", for a duration between both, or "auto": retime where the robot's limits hold,
        else raise
    flights : numbers of flights, optional
        To repair, whatever their verdict; the unphysical ones where left out. Unphysical flights that are not among
        these are left as they are, and the repair is not ``ok``.
    degree : of the polynomials, optional
    rate : Hz, optional
        Frames a second of the repaired clip; the clip's own where left out.
    gravity : m/s^2
    stances : "bent", so that they meet the flights; or "planned": within friction, torques and rates of the robot, near
        to the clip, and checked 2000 times a second. Planning needs CasADi, and some seconds for each stance, and
        flights begin and end with still feet. Where no stance can be planned it is bent, and :class:`FlightRepair`
        says why.

    Returns
    -------
    Clip
        The same object where nothing is changed. A changed clip has ``velocities`` too.
    ClipRepair

    Raises
    ------
    InputError
        A choice, a rate or a number of a flight is none; CasADi is not installed, for stances that are planned; or as
        of :func:`floatplan.check_clip`.
    """
    CHOICE(choice, "choice")
    optional(many(whole(Range(0, 10**6, "")), "numbers of flights"))(flights, "flights")
    optional(whole(Range(LOWEST_DEGREE + 1, HIGHEST_DEGREE, "")))(degree, "degree")
    optional(FINITE)(rate, "rate")
    if rate is not None:
        check_rate(rate, "rate")
    before = check_clip(clip, gravity)
    chosen = _chosen(before, flights)
    planner = None
    if one_of(*CHOICES["stances"])(stances, "stances") == "planned":
        casadi()
        planner = StancePlanner(clip, gravity, tuple(chosen))
    planned = {}
    for number in chosen:
        planned[number] = _plan_flight(clip, before.flights[number], number, choice, degree, gravity, planner)
    good = {number: flight for number, flight in planned.items() if flight.repairable}
    plans = {number: flight.plan for number, flight in good.items() if flight.plan is not None}
    reports = {number: FlightRepair(flight, planned.get(number)) for number, flight in enumerate(clip.flights)}
    if not plans and rate in (None, clip.fps):
        return clip, ClipRepair(before, tuple(reports.values()), clip)
    replaced = [good[number].flight if number in good else flight for number, flight in enumerate(clip.flights)]
    planned_stances = [] if planner is None else planner.planned(plans)
    motion = RepairedMotion(clip, plans, replaced, planned_stances)
    for number, flight in good.items():
        own = [] if planner is None else planner.of_flight(number, planned_stances)
        reports[number] = replace(_report(motion, clip, number, flight, gravity), stances=tuple(own))
    result = motion.clip(rate or clip.fps)
    return result, ClipRepair(before, tuple(reports.values()), result)


def _plan_flight(
    clip: Clip,
    judged: FlightJudgement,
    number: int,
    choice: Choice,
    degree: int | None,
    gravity: float,
    planner: StancePlanner | None,
) -> PlannedFlight:
    """Plan a flight anew; with still feet at its ends where stances are to be planned and such a flight exists."""
    if planner is not None and number in planner.flights:
        reason = ""
        # [m] by which the base is lowered where feet are still: the rates of nearly straight legs exceed their limits
        for lowered in (0.0, 0.01, 0.02, 0.03, 0.04, 0.05):
            still = replace(judged, flight=planner.flights[number])
            try:
                planned = plan_flight_anew(clip, still, choice, degree, gravity, planner.ends(number, lowered))
            except NoExactStanceError as error:
                reason = reason or str(error)
                break
            if planned.repairable:
                return planned
            reason = reason or planned.reason
        planner.give_up(number, f"no flight with still feet at its ends: {reason}")
    return plan_flight_anew(clip, judged, choice, degree, gravity)


def _chosen(check: ClipCheck, flights: Sequence[int] | None) -> list[int]:
    """Numbers of the flights to repair."""
    if flights is None:
        return [number for number, flight in enumerate(check.flights) if flight.verdict == "unphysical"]
    wrong = [number for number in flights if not 0 <= number < len(check.flights)]
    if wrong:
        raise InputError(f"there is no flight {wrong[0]}: they are 0 to {len(check.flights) - 1}", element="flights")
    return sorted(set(flights))


def _report(motion: RepairedMotion, clip: Clip, number: int, planned: PlannedFlight, gravity: float) -> FlightRepair:
    """The report on a flight that was replaced: its seams, and the forces of the stances before and after."""
    plan = planned.plan
    assert plan is not None, "the flight is replaced"
    flight = planned.flight
    begin = motion.begins[number]
    ends = np.array([flight.begin, flight.end])
    q = motion.ends[number]
    attitudes = clip.curve.attitudes(ends)
    base = float(np.linalg.norm(q[:, :3] - clip.curve.base_positions(ends), axis=1).max())
    turns = [angle_between(now, own) for now, own in zip(of_quaternions(q[:, 3:7]), attitudes, strict=True)]
    end = begin + plan.duration
    before = np.arange(max(begin - STANCE_SPAN, 0.0), begin, FORCE_STEP)
    after = np.arange(end, min(end + STANCE_SPAN, motion.clock.duration), FORCE_STEP)
    times = np.concatenate((before, after))
    clip_times = motion.clock.to_clip(times)
    configurations = motion.configurations(times)
    figures = [
        stance_figures(clip, configurations[stance], clip_times[stance], FORCE_STEP, gravity)
        for stance in (slice(len(before)), slice(len(before), None))
        if len(times[stance]) > 2 * STEPS
    ]
    return FlightRepair(
        flight=flight,
        repaired=planned,
        seam_base=base,
        seam_turn=max(turns),
        seam_foot=float(foot_misses(clip, clip_times, configurations).max(initial=0.0)),
        stance=_worst(figures) if figures else None,
    )


def _worst(figures: Sequence[StanceFigures]) -> StanceFigures:
    return StanceFigures(
        vertical_least=min(stance.vertical_least for stance in figures),
        friction=max(stance.friction for stance in figures),
        pressure_outside=max(stance.pressure_outside for stance in figures),
    )
