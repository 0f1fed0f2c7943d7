"""Stances of a repaired clip by the program of a jump's stances: near to the clip, from flight to flight or from it on.

Durations are the clip's. Where a stance meets no other flight it reaches 0.4 s into the clip, less where a foot would
stand twice in it; there the robot stands still where it does so in the clip, in the clip's posture or, where no stance
leads to it, in one near to it, and else has the clip's posture and rates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.clips.clip import Clip
from floatplan.clips.flights import CHECKED, RANGE_MARGIN, ClipFlight, free_time
from floatplan.clips.planned.contacts import (
    RULES,
    ContactPhase,
    NoContactsError,
    contact_phases,
    foot_places,
    foot_points,
    standing_feet,
    still_flight,
)
from floatplan.clips.planned.ends import StillEnds, clip_motion, end_motion
from floatplan.errors import FloatplanError
from floatplan.jumps.check import SHARES
from floatplan.jumps.phases import Side
from floatplan.jumps.spatial.coordinates import Mechanics, best_axes
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.phases import SpatialPhase
from floatplan.jumps.spatial.stance_search import StanceEnd, StanceResult, planned_stance, stance_setup
from floatplan.jumps.spatial.standing import Foot, not_standing
from floatplan.plans.plan import Plan
from floatplan.problem.attitude import Attitude
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Limits
from floatplan.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class StanceWindow:
    """A stance of a clip that is to be planned.

    Attributes
    ----------
    side : "takeoff", "landing", or "step" between two flights
    before, after : number of the flight before the stance, and of the flight after it; None where the stance ends in
        the clip's own motion
    phases : of contact, in order of time
    """

    side: Side
    before: int | None
    after: int | None
    phases: tuple[ContactPhase, ...]

    @property
    def begin(self) -> float:
        """In the clip, s."""
        return self.phases[0].begin

    @property
    def end(self) -> float:
        """In the clip, s."""
        return self.phases[-1].end


@dataclass(frozen=True, eq=False)
class ClipStance:
    """What came of a stance next to a repaired flight.

    Attributes
    ----------
    side : "takeoff", "landing" or "step"
    window : StanceWindow, optional
        None where the clip's contacts allow no planned stance.
    result : StanceResult, optional
        None where no search was made.
    reason : why the stance is not planned; "" where it is
    frames : names of the frames that stand in each phase
    """

    side: Side
    window: StanceWindow | None
    result: StanceResult | None
    reason: str
    frames: tuple[tuple[str, ...], ...] = ()

    @property
    def planned(self) -> bool:
        """Whether the stance is planned, and its check holds."""
        return not self.reason

    @property
    def flight_ends(self) -> tuple[tuple[int, int], ...]:
        """Ends of flights that the stance meets: number of the flight, and 0 for its takeoff or 1 for its landing."""
        if self.window is None:
            return ()
        ends = ((self.window.before, 1), (self.window.after, 0))
        return tuple((number, end) for number, end in ends if number is not None)

    def motion(self, times: Array) -> tuple[Array, Array]:
        """Configurations (K, 7 + J) and velocities (K, 6 + J) at times (K,) from the stance's begin, s."""
        assert self.result is not None, "it is planned"
        stances = self.result.stances
        borders = [stance.span[1] for stance in stances[:-1]]
        inside = np.clip(times, stances[0].span[0], stances[-1].span[1])
        phase_of = np.searchsorted(borders, inside)
        model = stances[0].robot.model
        q = np.empty((len(times), model.nq))
        v = np.empty((len(times), model.nv))
        for index, stance in enumerate(stances):
            own = phase_of == index
            if own.any():
                q[own], v[own], _ = stance.mechanics.coordinates(stance.grid.at(inside[own]))
        return q, v

    def write_contacts(self, clip: Clip, clip_times: Array, contacts: BoolArray, rows: IntArray) -> None:
        """Set rows (K,) of contact labels (N, C) to the feet that stand at the clip's times (K,), s, of these rows."""
        assert self.window is not None, "it is planned"
        bodies = clip.scene.foot_bodies
        for column, name in enumerate(clip.contact_names):
            body = next((solid.body for solid in clip.robot.solids if solid.link == name), None)
            if body not in bodies:
                continue
            for phase in self.window.phases:
                inside = (clip_times >= phase.begin) & (clip_times <= phase.end)
                contacts[rows[inside], column] = bodies.index(body) in phase.feet

    @property
    def sentence(self) -> str:
        """What came of the stance, for a person."""
        if self.result is None or not self.planned:
            return f"{self.side}: bent, not planned: {self.reason}"
        figures = self.result.figures
        shares = f"{figures['torque']:.0%} of the torques, {figures['velocity']:.0%} of the rates"
        return f"{self.side}: planned, within {shares}, friction {figures['friction']:.2f}"

    def to_dict(self) -> dict[str, Any]:
        """As the command line's ``--json`` has it."""
        shown = {}
        if self.result is not None:
            for name in (*SHARES, "friction", "pull", "ground", "residual"):
                if np.isfinite(self.result.figures.get(name, np.nan)):
                    shown[name] = self.result.figures[name]
        return {
            "side": self.side,
            "planned": self.planned,
            "reason": self.reason or None,
            "contacts": list(map(list, self.frames)),
            "figures": shown,
        }


@dataclass(eq=False)
class StancePlanner:
    """The stances next to some flights of a clip, and the flights that still feet leave and end.

    Attributes
    ----------
    clip : Clip
    gravity : m/s^2
    numbers : of the flights that are to be repaired
    flights : number -> flight with still feet at both ends: longer than the clip's, whose feet are higher there
    windows : stances to plan
    missing : number and side of a flight -> why there is no stance to plan
    """

    clip: Clip
    gravity: float
    numbers: tuple[int, ...]
    flights: dict[int, ClipFlight] = field(init=False, default_factory=dict)
    windows: list[StanceWindow] = field(init=False, default_factory=list)
    missing: dict[tuple[int, Side], str] = field(init=False, default_factory=dict)
    _places: dict[StanceWindow, dict[str, Array]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Lay out flights and stances."""
        self.stands: BoolArray = standing_feet(self.clip)
        self._points: dict[int, tuple[Foot, ...]] = {}
        for number in self.numbers:
            try:
                self.flights[number] = still_flight(self.clip, self.stands, self.clip.flights[number])
            except NoContactsError as error:
                self.missing[number, "takeoff"] = self.missing[number, "landing"] = str(error)
        for number in sorted(self.flights):
            self._lay_out(number)
        for number, _ in self.missing:
            self.flights.pop(number, None)

    def _lay_out(self, number: int) -> None:
        """Add the stances before and after a flight to ``windows``."""
        flight = self.flights[number]
        following = self.flights.get(number + 1)
        earliest, latest = free_time(self.clip.flights, number, self.clip.duration)
        last = next((window for window in self.windows if window.after == number), None)
        try:
            if last is None:
                self._add("takeoff", None, number, max(earliest, flight.begin - RULES.reach), flight.begin)
            if following is not None and following.begin - flight.end <= RULES.reach:
                self._add("step", number, number + 1, flight.end, following.begin)
            else:
                self._add("landing", number, None, flight.end, min(latest, flight.end + RULES.reach))
        except FloatplanError as error:
            self.missing[number, "landing" if last else "takeoff"] = str(error)

    def _add(self, side: Side, before: int | None, after: int | None, begin: float, end: float) -> None:
        """Add a stance between two times of the clip, and between the flights with these numbers."""
        inwards = {"takeoff": 1, "landing": -1, "step": 0}[side]
        phases = contact_phases(self.clip, self.stands, begin, end, inwards)
        window = StanceWindow(side, before, after, tuple(phases))
        places: dict[str, Array] = {}
        for foot in {number for phase in phases for number in phase.feet}:
            if foot not in self._points:
                self._points[foot] = foot_points(self.clip, foot)
            places |= foot_places(self.clip, foot, self._points[foot], phases)
        self._places[window] = places
        self.windows.append(window)

    def _phase_points(self, phase: ContactPhase) -> tuple[Foot, ...]:
        return tuple(point for foot in phase.feet for point in self._points[foot])

    def ends(self, number: int, lowered: float = 0.0) -> StillEnds | None:
        """The postures in which a flight begins and ends, with feet on the ground; None where no foot stands there.

        Postures are the clip's, with the base lowered, m: the joints of a leg that is nearly straight are too fast.
        """
        if number not in self.flights:
            return None
        flight = self.flights[number]
        places: list[dict[str, Array]] = [{}, {}]
        points: list[Foot] = []
        for window in self.windows:
            if number in (window.before, window.after):
                phase = window.phases[-1 if window.after == number else 0]
                own = self._phase_points(phase)
                points += own
                end = 1 if window.before == number else 0
                for foot in own:
                    places[end][foot.name] = self._places[window][foot.name]
        of_ends = (places[0], places[1])
        instants = np.linspace(flight.begin, flight.end, CHECKED)
        axes = best_axes(self.clip.curve.attitudes(instants))
        mechanics = Mechanics(self.clip.robot, axes, self.gravity, points)
        return StillEnds(mechanics, of_ends, end_motion(self.clip, mechanics, flight, of_ends, lowered))

    def give_up(self, number: int, reason: str) -> None:
        """Plan no stances next to a flight."""
        self.flights.pop(number, None)
        self.missing[number, "takeoff"] = self.missing[number, "landing"] = reason

    def planned(self, plans: Mapping[int, Plan]) -> list[ClipStance]:
        """Plan the stances next to flights with still feet whose plans are all there."""
        stances = []
        for window in self.windows:
            met = {window.before, window.after} - {None}
            if met <= self.flights.keys() & plans.keys():
                stances.append(self._plan(window, self._places[window], plans))
        return stances

    def of_flight(self, number: int, stances: Sequence[ClipStance]) -> list[ClipStance]:
        """The stances before and after a flight; where one is not planned, a stance that says why."""
        own = []
        sides: tuple[Side, ...] = ("takeoff", "landing")
        for end, side in enumerate(sides):
            stance = next((stance for stance in stances if (number, end) in stance.flight_ends), None)
            if stance is None:
                other = sides[1 - end]
                reason = self.missing.get((number, side)) or self.missing.get((number, other))
                stance = ClipStance(side, None, None, reason or "the flight on its other side has no still feet")
            own.append(stance)
        return own

    def _plan(self, window: StanceWindow, places: Mapping[str, Array], plans: Mapping[int, Plan]) -> ClipStance:
        clip = self.clip
        instants = np.linspace(window.begin, window.end, CHECKED)
        axes = best_axes(clip.curve.attitudes(instants))
        phases = []
        for phase in window.phases:
            duration = phase.end - phase.begin
            step = 0.025  # [s] between the nodes of the program, about
            intervals = max(round(duration / step), 6)
            fixed = (duration, duration)
            phases.append(SpatialPhase(window.side, self._phase_points(phase), duration, fixed, intervals))
        frames = []
        points: list[Foot] = []
        for planned in phases:
            frames.append(planned.frames)
            points += planned.feet
        mechanics = Mechanics(clip.robot, axes, self.gravity, points)

        def reference(times: Array) -> Array:
            return _with_rates(clip, mechanics, window.begin + np.clip(times, 0.0, window.end - window.begin))

        ends = []
        for end, number in ((0, window.before), (-1, window.after)):
            if number is None:
                ends.append(self._own_end(window, mechanics, places, phases[end], end))
            else:
                plan = plans[number]
                time = plan.duration if end == 0 else 0.0
                near = reference(np.array([0.0, window.end - window.begin]))[0, 3:BASE, end]
                ends.append(StanceEnd(_plan_motion(mechanics, plan, time, near), flies=True))
        plan = plans[window.after if window.before is None else window.before]  # type: ignore[index]
        problem = stance_problem(plan.problem, reference(instants - window.begin)[0, BASE:])
        request = JumpRequest(margin={"torque": 1.0, "velocity": 1.0}, clearance=0.02, pitch_error=0.0, feet="points")

        def search(first: StanceEnd, last: StanceEnd) -> StanceResult:
            setup = stance_setup(problem, request, axes, phases, (first, last), places)
            return planned_stance(setup, reference, is_reference=True)

        result = search(*ends)
        if not result.ok and any(end.is_still for end in ends):
            # To stop in that very posture, flights that are fast sideways may need pressure outside the soles.
            result = search(*(replace(end, settles=end.is_still) for end in ends))
        return ClipStance(window.side, window, result, "; ".join(result.broken), tuple(frames))

    def _own_end(
        self,
        window: StanceWindow,
        mechanics: Mechanics,
        places: Mapping[str, Array],
        phase: SpatialPhase,
        end: int,
    ) -> StanceEnd:
        """The clip's own motion at an end of a stance that meets no flight there: still, if it is so in the clip."""
        instant = np.array([window.begin if end == 0 else window.end])
        motion = _with_rates(self.clip, mechanics, instant)
        rates = np.abs(motion[1, :, 0])
        slow = np.repeat((0.1, 0.3), (BASE, len(rates) - BASE))  # [m/s and rad/s of the base; rad/s] noise of frames
        is_still = bool((rates < slow).all())
        if is_still:
            motion[1:] = 0.0
        own = {}
        for name in phase.names:
            own[name] = places[name]
        closed = mechanics.close(motion, own)[:, :, 0]
        attitude = Attitude(angles=tuple(closed[0, 3:BASE].tolist()), axes=mechanics.axes)
        if not is_still or not_standing(self.clip.robot, phase.feet, attitude, closed[0, BASE:]):
            closed[2] = np.nan
        return StanceEnd(closed)


def _with_rates(clip: Clip, mechanics: Mechanics, times: Array) -> Array:
    """Base, angles and joints (3, 6+n, N) of a clip at times (N,), s, with rates by differences over 40 ms."""
    span = 0.02  # [s] to either side: over less, noise of frames looks like motion
    early = np.maximum(times - span, 0.0)
    late = np.minimum(times + span, clip.duration)
    every = np.unique(np.concatenate((early, times, late)))
    motion = clip_motion(clip, mechanics, every)[0]
    rates = motion[:, np.searchsorted(every, late)] - motion[:, np.searchsorted(every, early)]
    at_times = motion[:, np.searchsorted(every, times)]
    return np.stack((at_times, rates / (late - early), np.zeros_like(at_times)))


def _plan_motion(mechanics: Mechanics, plan: Plan, time: float, near: Array) -> Array:
    """Return base, angles and joints (3, 6+n) of a plan at a time, s, with its angles next to ``near`` (3,)."""
    coordinates = plan.full_motion(np.array([time])).coordinates
    q, v, a = coordinates.positions, coordinates.velocities, coordinates.accelerations
    return mechanics.from_coordinates(q, v, a, near[:, None])[:, :, 0]


def stance_problem(problem: Problem, positions: Array) -> Problem:
    """Return a flight's problem with its robot's limits of torques and rates, and ranges that hold positions (n, N)."""
    low, high = np.asarray(problem.position_limits).T
    low = np.minimum(low, positions.min(axis=1) - RANGE_MARGIN)
    high = np.maximum(high, positions.max(axis=1) + RANGE_MARGIN)
    ranges = np.stack((low, high), axis=1)
    limits = Limits(position=tuple(map(tuple, ranges.tolist())), velocity="urdf", torque="urdf")
    return replace(problem, limits=limits)
