"""A clip with some of its flights planned anew: where everything is, at any time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array, BoolArray, read_only
from floatplan.clips.bent_stances import Seam, stance_configurations, velocity_difference
from floatplan.clips.clip import Clip
from floatplan.clips.flights import ClipFlight, free_time
from floatplan.clips.formats import continuous_signs
from floatplan.clips.planned.planner import ClipStance
from floatplan.clips.timing import RAMP, Clock
from floatplan.motion.spatial.rotations import logarithm, of_quaternions
from floatplan.plans.plan import Plan

STEP = 1e-4  # [s] of differences, by which velocities in stances are computed


def plan_motion(plan: Plan, times: Array) -> tuple[Array, Array]:
    """Configurations (K, 7 + J) of a plan at times (K,), s, as clips have them, and velocities (K, 6 + J).

    The base's velocities are in its own axes.
    """
    motion = plan.full_motion(times)
    configurations = np.concatenate((motion.base_position, motion.base_quaternion, motion.positions), axis=1)
    return configurations, np.concatenate((motion.base_twist, motion.velocities), axis=1)


class RepairedMotion:
    """A clip with plans instead of some of its flights, and its stances changed to meet them.

    Parameters
    ----------
    clip : Clip
    plans : number of a flight -> Plan that replaces it
    flights : of the clip, as the plans replace them; the clip's own if left out
    stances : planned stances, optional

    Attributes
    ----------
    begins : number of a flight -> when its plan begins, s
    ends : number of a flight -> (2, 7 + J), configurations of each plan at takeoff and landing
    """

    def __init__(
        self,
        clip: Clip,
        plans: Mapping[int, Plan],
        flights: Sequence[ClipFlight] | None = None,
        stances: Sequence[ClipStance] = (),
    ) -> None:
        self._clip = clip
        self._plans = plans
        self._flights = clip.flights if flights is None else flights
        flights = self._flights
        factors = [1.0] * len(flights)
        for number, plan in plans.items():
            factors[number] = plan.duration / flights[number].duration
        self._stances = [stance for stance in stances if stance.planned]
        planned_ends = {end for stance in self._stances for end in stance.flight_ends}
        self.clock = Clock.of(clip.duration, flights, factors, planned_ends)
        begins = self.clock.to_new(np.array([flight.begin for flight in flights]))
        self.begins = {number: float(begins[number]) for number in plans}
        self.ends: dict[int, Array] = {}
        self._seams: list[Seam] = []
        for number, plan in plans.items():
            configurations, velocities = plan_motion(plan, np.array([0.0, plan.duration]))
            self.ends[number] = configurations
            seams = self._seams_of(number, factors[number], configurations, velocities)
            self._seams += [seam for end, seam in enumerate(seams) if (number, end) not in planned_ends]
        for stance in self._stances:
            self._seams += self._seams_beyond(stance)

    def _seams_of(self, number: int, pace: float, configurations: Array, velocities: Array) -> list[Seam]:
        """Where the stances before and after a flight meet the ends (2, 7 + J), (2, 6 + J) of its plan."""
        clip = self._clip
        flights = self._flights
        flight = flights[number]
        before, after = free_time(flights, number, clip.duration)
        ends = np.array([flight.begin, flight.end])
        attitudes = of_quaternions(configurations[:, 3:7])
        clearances = clip.scene.foot_clearances(ends)
        linear, angular, joints = clip.curve.velocities(ends)
        seams = []
        for end, (sign, free) in enumerate(((-1.0, flight.begin - before), (1.0, after - flight.end))):
            of_clip = (linear[end], angular[end], joints[end])
            seam = Seam(
                instant=self.begins[number] + end * self._plans[number].duration,
                sign=sign,
                span=min(RAMP, 0.5 * free),
                clearances=clearances[end],
                change=velocity_difference(velocities[end], of_clip, pace, attitudes[end]),
            )
            seams.append(seam)
        return seams

    def _seams_beyond(self, stance: ClipStance) -> Iterator[Seam]:
        """Where the clip meets a planned stance away from the flight."""
        clip = self._clip
        window = stance.window
        assert window is not None, "it is planned"
        ends = {end for number, end in stance.flight_ends}
        # Where no other flight follows, what the clip's end leaves no time for stays as it is.
        before = -math.inf
        after = math.inf
        for flight in self._flights:
            if flight.end <= window.begin:
                before = flight.end
            elif flight.begin >= window.end:
                after = min(after, flight.begin)
        free = {1: window.begin - before, 0: after - window.end}
        for end in {0, 1} - ends:  # a stance that no flight ends with 1 follows, and one without 0 is before
            instant = np.array([window.end if end == 0 else window.begin])
            new = self.clock.to_new(instant)
            own = self._stance_motion(stance, new)
            of_clip = clip.curve.velocities(instant)
            attitude = of_quaternions(own[0][:, 3:7])[0]
            turned = logarithm((attitude @ clip.curve.attitudes(instant)[0].T)[None])[0]
            offset = np.concatenate(
                (
                    own[0][0, :3] - clip.curve.base_positions(instant)[0],
                    turned,
                    own[0][0, 7:] - clip.curve.positions(instant)[0],
                )
            )
            yield Seam(
                instant=float(new[0]),
                sign=1.0 if end == 0 else -1.0,
                span=min(RAMP, 0.5 * free[end]),
                clearances=clip.scene.foot_clearances(instant)[0],
                change=velocity_difference(own[1][0], tuple(order[0] for order in of_clip), 1.0, attitude),
                offset=offset,
            )

    def _stance_motion(self, stance: ClipStance, times: Array) -> tuple[Array, Array]:
        """Configurations (K, 7 + J) and velocities (K, 6 + J) of a planned stance at times (K,) in it, s."""
        assert stance.window is not None, "it is planned"
        return stance.motion(times - float(self.clock.to_new(np.array([stance.window.begin]))[0]))

    def _in_stances(self, times: Array) -> Iterator[tuple[ClipStance, BoolArray]]:
        """Planned stances, and which of times (K,) are within each."""
        for stance in self._stances:
            assert stance.window is not None, "it is planned"
            begin, end = self.clock.to_new(np.array([stance.window.begin, stance.window.end]))
            inside = (times >= begin) & (times <= end)
            if inside.any():
                yield stance, inside

    def _planned(self, times: Array) -> Iterator[tuple[BoolArray, Array, Array]]:
        """Planned flights and stances: which of times (K,) are within each, configurations and velocities there."""
        for number, plan in self._plans.items():
            local = times - self.begins[number]
            inside = (local >= 0) & (local <= plan.duration)
            if inside.any():
                yield inside, *plan_motion(plan, local[inside])
        for stance, inside in self._in_stances(times):
            yield inside, *self._stance_motion(stance, times[inside])

    def configurations(self, times: Array) -> Array:
        """Configurations (K, 7 + J) at times (K,), s."""
        configurations = np.empty((len(times), self._clip.robot.model.nq))
        is_bent = np.ones(len(times), np.bool_)
        for inside, q, _ in self._planned(times):
            configurations[inside] = q
            is_bent &= ~inside
        at = times[is_bent]
        configurations[is_bent] = stance_configurations(self._clip, self.clock.to_clip(at), at, self._seams)
        return configurations

    def motion(self, times: Array) -> tuple[Array, Array]:
        """Configurations (K, 7 + J) at times (K,), s, and velocities (K, 6 + J) of Pinocchio's model.

        Velocities of planned flights and stances are their own, those of bent stances are from differences.
        """
        configurations = np.empty((len(times), self._clip.robot.model.nq))
        velocities = np.empty((len(times), self._clip.robot.model.nv))
        is_bent = np.ones(len(times), np.bool_)
        for inside, q, v in self._planned(times):
            configurations[inside] = q
            velocities[inside] = v
            is_bent &= ~inside
        at = times[is_bent]
        early = np.clip(at - STEP, 0.0, self.clock.duration)
        late = np.clip(at + STEP, 0.0, self.clock.duration)
        before, middle, after = np.split(self.configurations(np.concatenate((early, at, late))), 3)
        passed = (late - early)[:, None]
        turned = Rotation.from_quat(before[:, 3:7]).inv() * Rotation.from_quat(after[:, 3:7])
        linear = Rotation.from_quat(middle[:, 3:7]).apply((after[:, :3] - before[:, :3]) / passed, inverse=True)
        joints = (after[:, 7:] - before[:, 7:]) / passed
        configurations[is_bent] = middle
        velocities[is_bent] = np.concatenate((linear, turned.as_rotvec() / passed, joints), axis=1)
        return configurations, velocities

    def clip(self, rate: float) -> Clip:
        """The motion as a clip of ``rate`` frames a second."""
        clip = self._clip
        times = np.arange(int(np.floor(self.clock.duration * rate + 1e-6)) + 1) / rate
        q, v = self.motion(times)
        contacts = None
        if clip.contacts is not None:
            frame = np.rint(self.clock.to_clip(times) * clip.fps).astype(np.int64)
            contacts = clip.contacts[np.minimum(frame, clip.frames - 1)].copy()
            for stance, inside in self._in_stances(times):
                stance.write_contacts(clip, self.clock.to_clip(times[inside]), contacts, np.flatnonzero(inside))
        return replace(
            clip,
            fps=rate,
            base_position=read_only(q[:, :3]),
            base_quaternion=read_only(continuous_signs(q[:, 3:7])),
            positions=read_only(q[:, 7:]),
            contacts=contacts,
            velocities=read_only(v),
        )
