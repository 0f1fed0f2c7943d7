"""A clip whose flights fly: each that is not physical planned anew, and the stances beside it brought to meet it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arguments import many, one_of, optional, whole
from floatplan.arrays import Array, BoolArray, read_only
from floatplan.clips.check import ClipCheck, check_clip, or_none, share_table
from floatplan.clips.clip import Clip
from floatplan.clips.curve import body_poses, centre_of_mass
from floatplan.clips.flights import ClipFlight
from floatplan.clips.formats import continuous_signs
from floatplan.clips.judge import GRAVITY, UNPHYSICAL
from floatplan.clips.repaired_flight import CHOICES, Choice, RepairedFlight, repair_flight
from floatplan.clips.stances import Seam, foot_misses, stance_configurations, turn_between, velocity_difference
from floatplan.clips.timing import RAMP, Clock
from floatplan.errors import InputError
from floatplan.motion.spatial.dynamics import BASE
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.parts import HIGHEST_DEGREE, LOWEST_DEGREE
from floatplan.tables import Range

BESIDE = 0.3  # [s] before and after a flight, in which forces of the stances are looked at
MOST_FLIGHTS = 10**6  # [-] numbers of flights
STEP = 1e-4  # [s] of differences, by which velocities in stances are computed
FORCE_STEP = 0.02  # [s] of differences, by which forces are: shorter ones tell of the frames' noise


@dataclass(frozen=True, eq=False)
class StanceFigures:
    """What the stances beside a repaired flight would take: they are bent, not planned.

    Attributes
    ----------
    vertical_least : least vertical force of the ground, in shares of the weight; negative where it would have to pull
    friction : the largest share of horizontal in vertical force; infinite where it would have to pull
    """

    vertical_least: float
    friction: float


@dataclass(frozen=True, eq=False)
class FlightRepair:
    """What was done about one flight: None of ``repaired`` where it was left as it is.

    Attributes
    ----------
    flight : ClipFlight
    repaired : RepairedFlight, optional
    seam_base, seam_turn, seam_foot : m, rad, m
        Largest jump of base and attitude at its ends, and by how much feet beside it are off the clip's.
    stance : StanceFigures, optional
    """

    flight: ClipFlight
    repaired: RepairedFlight | None
    seam_base: float = 0.0
    seam_turn: float = 0.0
    seam_foot: float = 0.0
    stance: StanceFigures | None = None

    def to_dict(self) -> dict[str, Any]:
        """As the command line's ``--json`` has it."""
        found = self.repaired
        if found is None:
            return {"begin": self.flight.begin, "end": self.flight.end, "changed": False}
        return {
            "begin": self.flight.begin,
            "end": self.flight.end,
            "changed": found.repairable,
            "choice": found.choice,
            "duration_before": self.flight.duration,
            "duration_after": found.duration,
            "joints_rms": or_none(found.joints_rms),
            "joints_largest": or_none(found.joints_largest),
            "base_largest": or_none(found.base_largest),
            "rate_share": share_table(found.rate_share),
            "torque_share": share_table(found.torque_share),
            "seam": {"base": self.seam_base, "turn": self.seam_turn, "foot": self.seam_foot},
            "stance": None
            if self.stance is None
            else {"vertical_least": self.stance.vertical_least, "friction": or_none(self.stance.friction)},
            "repairable": found.repairable,
            "reason": found.reason or None,
        }


@dataclass(frozen=True, eq=False)
class ClipRepair:
    """What was done about a clip.

    Attributes
    ----------
    before : ClipCheck
    flights : tuple of FlightRepair
        Of every flight of the clip, in the order of time.
    """

    before: ClipCheck
    flights: tuple[FlightRepair, ...]

    @property
    def ok(self) -> bool:
        """Whether every flight that was unphysical is repaired."""
        return all(each.repaired is None or each.repaired.repairable for each in self.flights)

    @property
    def changed(self) -> bool:
        """Whether anything was changed."""
        return any(each.repaired is not None and each.repaired.repairable for each in self.flights)

    def to_dict(self) -> dict[str, Any]:
        """Everything, as the command line's ``--json`` has it."""
        return {**self.before.to_dict(), "repairs": [each.to_dict() for each in self.flights]}

    def __repr__(self) -> str:
        done = sum(each.repaired is not None and each.repaired.repairable for each in self.flights)
        return f"ClipRepair({self.before.clip.path.name!r}, {done} of {len(self.flights)} flights repaired)"


@one_thread
def repair_clip(
    clip: Clip,
    choice: Choice = "auto",
    *,
    flights: Sequence[int] | None = None,
    degree: int | None = None,
    gravity: float = GRAVITY,
) -> tuple[Clip, ClipRepair]:
    """Make the flights of a clip fly.

    Each flight that is unphysical is planned anew, as near to the clip as a flight can be, with the clip's postures at
    both ends; the clip's time runs on around it, feet that stand stay where they are. Flights that are physical, or
    undecided, are left as they are.

    Parameters
    ----------
    clip : Clip
    choice : "retime" (postures and heights are kept), "raise" (the duration is kept), or "auto": retime where the
        robot's limits hold, else raise
    flights : numbers of flights, optional
        To repair, whatever their verdict; the unphysical ones where left out.
    degree : of the polynomials, optional
    gravity : m/s^2

    Returns
    -------
    Clip
        The same object where nothing is changed. It has ``velocities`` too.
    ClipRepair

    Raises
    ------
    InputError
        A choice or a number of a flight is none; or as of :func:`floatplan.check_clip`.
    """
    one_of(*CHOICES)(choice, "choice")
    optional(many(whole(Range(0, MOST_FLIGHTS, "")), "numbers of flights"))(flights, "flights")
    optional(whole(Range(LOWEST_DEGREE + 1, HIGHEST_DEGREE, "")))(degree, "degree")
    before = check_clip(clip, gravity)
    chosen = _chosen(before, flights)
    repaired = {number: repair_flight(clip, clip.flights[number], choice, degree, gravity) for number in chosen}
    good = {number: each for number, each in repaired.items() if each.repairable}
    if not good:
        left = tuple(FlightRepair(flight, repaired.get(number)) for number, flight in enumerate(clip.flights))
        return clip, ClipRepair(before, left)
    new = _Whole(clip, good)
    found = new.clip()
    done = [
        new.told(number, gravity) if number in good else FlightRepair(flight, repaired.get(number))
        for number, flight in enumerate(clip.flights)
    ]
    return found, ClipRepair(before, tuple(done))


def _chosen(check: ClipCheck, flights: Sequence[int] | None) -> list[int]:
    """Numbers of the flights to repair."""
    if flights is None:
        return [number for number, each in enumerate(check.flights) if each.verdict == UNPHYSICAL]
    wrong = [number for number in flights if not 0 <= number < len(check.flights)]
    if wrong:
        raise InputError(f"there is no flight {wrong[0]}: they are 0 to {len(check.flights) - 1}", element="flights")
    return sorted(set(flights))


class _Whole:
    """A clip with some of its flights in place of its own: where everything is, at any time."""

    def __init__(self, clip: Clip, repaired: dict[int, RepairedFlight]) -> None:
        self._clip = clip
        self._repaired = repaired
        flights = clip.flights
        factors = [
            repaired[number].duration / flight.duration if number in repaired else 1.0
            for number, flight in enumerate(flights)
        ]
        self._clock = Clock.of(clip.duration, flights, factors)
        begins = self._clock.to_new(np.array([flight.begin for flight in flights]))
        self._begins = {number: float(begins[number]) for number in repaired}
        self._seams = [seam for number in repaired for seam in self._seams_of(number, factors[number])]

    def _seams_of(self, number: int, pace: float) -> list[Seam]:
        """Where the stances before and after a flight meet it."""
        clip, flights = self._clip, self._clip.flights
        flight = flights[number]
        plan = self._repaired[number].plan
        assert plan is not None, "the flight is repaired"
        before = flights[number - 1].end if number else 0.0
        after = flights[number + 1].begin if number + 1 < len(flights) else clip.duration
        seams = []
        for at, local, sign, free in (
            (flight.begin, 0.0, -1.0, flight.begin - before),
            (flight.end, plan.duration, 1.0, after - flight.end),
        ):
            own = plan.v(np.array([local]))[0]
            attitude = Rotation.from_quat(plan.q(np.array([local]))[0, 3:7]).as_matrix()
            of_clip = clip.curve.velocities(np.array([at]))
            change = velocity_difference(own, (of_clip[0][0], of_clip[1][0], of_clip[2][0]), pace, attitude)
            instant = self._begins[number] + local
            seams.append(Seam(instant=instant, sign=sign, room=min(RAMP, 0.5 * free), change=change))
        return seams

    def _in_flight(self, times: Array) -> Iterator[tuple[Plan, BoolArray, Array]]:
        """Plans, which of times (K,) are within each, and these in the plan's own time, s."""
        for number, repaired in self._repaired.items():
            plan = repaired.plan
            assert plan is not None, "the flight is repaired"
            local = times - self._begins[number]
            inside = (local >= 0) & (local <= plan.duration)
            if inside.any():
                yield plan, inside, local[inside]

    def configurations(self, times: Array) -> Array:
        """Configurations (K, 7 + J) at times (K,) of the repaired clip, s."""
        clip_times = self._clock.to_clip(times)
        found = np.empty((len(times), self._clip.robot.model.nq))
        stands = np.ones(len(times), np.bool_)
        for plan, inside, local in self._in_flight(times):
            found[inside] = plan.q(local)
            stands &= ~inside
        found[stands] = stance_configurations(self._clip, clip_times[stands], times[stands], self._seams)
        return found

    def velocities(self, times: Array) -> Array:
        """Velocities (K, 6 + J) of Pinocchio's model at times (K,): of plans their own, in stances by differences."""
        found = np.empty((len(times), self._clip.robot.model.nv))
        stands = np.ones(len(times), np.bool_)
        for plan, inside, local in self._in_flight(times):
            found[inside] = plan.v(local)
            stands &= ~inside
        at = times[stands]
        early = self.configurations(np.clip(at - STEP, 0.0, self._clock.duration))
        late = self.configurations(np.clip(at + STEP, 0.0, self._clock.duration))
        passed = np.clip(at + STEP, 0.0, self._clock.duration) - np.clip(at - STEP, 0.0, self._clock.duration)
        before, after = Rotation.from_quat(early[:, 3:7]), Rotation.from_quat(late[:, 3:7])
        middle = Rotation.from_quat(self.configurations(at)[:, 3:7])
        linear = middle.apply((late[:, :3] - early[:, :3]) / passed[:, None], inverse=True)
        angular = (before.inv() * after).as_rotvec() / passed[:, None]
        found[stands] = np.concatenate((linear, angular, (late[:, 7:] - early[:, 7:]) / passed[:, None]), axis=1)
        return found

    def clip(self) -> Clip:
        """The repaired clip, at the clip's rate."""
        clip = self._clip
        times = np.arange(int(np.floor(self._clock.duration * clip.fps + 1e-6)) + 1) / clip.fps
        q = self.configurations(times)
        contacts = None
        if clip.contacts is not None:
            frame = np.rint(self._clock.to_clip(times) * clip.fps).astype(np.int64)
            contacts = clip.contacts[np.minimum(frame, clip.frames - 1)]
        return replace(
            clip,
            base_position=read_only(q[:, :3]),
            base_quaternion=read_only(continuous_signs(q[:, 3:7])),
            positions=read_only(q[:, 7:]),
            contacts=contacts,
            velocities=read_only(self.velocities(times)),
        )

    def told(self, number: int, gravity: float) -> FlightRepair:
        """What is said of a flight that was repaired: its seams, and what the stances beside it would take."""
        clip = self._clip
        flight, repaired = clip.flights[number], self._repaired[number]
        plan = repaired.plan
        assert plan is not None, "the flight is repaired"
        begin = self._begins[number]
        ends = np.array([flight.begin, flight.end])
        q = plan.q(np.array([0.0, plan.duration]))
        attitudes = clip.curve.attitudes(ends)
        base = float(np.linalg.norm(q[:, :3] - clip.curve.base_positions(ends), axis=1).max())
        turns = [
            turn_between(Rotation.from_quat(each[3:7]).as_matrix(), own) for each, own in zip(q, attitudes, strict=True)
        ]
        beside = np.arange(-BESIDE, BESIDE + plan.duration, 0.5 * FORCE_STEP) + begin
        beside = beside[(beside >= 0) & (beside <= self._clock.duration)]
        stands = beside[(beside < begin) | (beside > begin + plan.duration)]
        feet = (
            foot_misses(clip, self._clock.to_clip(stands), self.configurations(stands)) if len(stands) else np.zeros(1)
        )
        return FlightRepair(
            flight=flight,
            repaired=repaired,
            seam_base=base,
            seam_turn=max(turns),
            seam_foot=float(feet.max(initial=0.0)),
            stance=self._stance(stands, gravity),
        )

    def _stance(self, times: Array, gravity: float) -> StanceFigures | None:
        """Forces of the ground at times (K,) beside a flight, from the acceleration of the centre of mass."""
        inside = times[(times > FORCE_STEP) & (times < self._clock.duration - FORCE_STEP)]
        if not len(inside):
            return None
        places = [self._com(inside + step) for step in (-FORCE_STEP, 0.0, FORCE_STEP)]
        acceleration = (places[0] - 2 * places[1] + places[2]) / FORCE_STEP**2
        vertical = acceleration[:, 2] / gravity + 1.0
        across = np.linalg.norm(acceleration[:, :2], axis=1) / gravity
        friction = np.where(vertical > 0, across / np.maximum(vertical, 1e-9), np.inf)
        return StanceFigures(vertical_least=float(vertical.min()), friction=float(friction.max()))

    def _com(self, times: Array) -> Array:
        """Places (K, 3) of the centre of mass, m."""
        q = self.configurations(times)
        attitudes = Rotation.from_quat(q[:, 3:7]).as_matrix()
        model = self._clip.robot.model
        return centre_of_mass(model, body_poses(model, q[:, :3], attitudes, q[:, BASE + 1 :]))
