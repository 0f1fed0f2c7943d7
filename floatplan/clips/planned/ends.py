"""Flights of a clip that begin and end with still feet: as planned stances leave them, and take them up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.flights import ClipFlight
from floatplan.jumps.spatial.coordinates import Mechanics
from floatplan.jumps.spatial.exact import met_by_flight
from floatplan.jumps.spatial.model import BASE
from floatplan.motion.spatial.rotations import unwrapped_angles
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Landing, Takeoff
from floatplan.problem.problem import Problem
from floatplan.tables import HIGHEST_DEGREE, LOWEST_DEGREE


@dataclass(frozen=True, eq=False)
class StillEnds:
    """The postures of a clip where a flight begins and ends, with feet on the ground.

    Attributes
    ----------
    mechanics : of the robot with all points that stand
    places : name of a point -> where it stands, (3,) m, before the flight and after it
    motion : (3, 6+n, 2) base, angles and joints at both ends, without rates
    """

    mechanics: Mechanics
    places: tuple[Mapping[str, Array], Mapping[str, Array]]
    motion: Array

    def plan(self, problem: Problem) -> Plan:
        """Return the plan of a flight between these ends that leaves, and meets, feet which are still.

        The angular momentum is that of a first plan, with the end rates of the problem; from it, and from the fall,
        follow the rates and accelerations with which the feet are still.
        """
        degree = problem.motion.degree
        assert isinstance(degree, int)
        lower = max(degree - 2, LOWEST_DEGREE + 1)  # two less, for each joint, than with the accelerations at the ends
        rough = self._between(replace(problem, motion=replace(problem.motion, degree=lower)))
        first = planned(rough, SearchOptions()).plan
        times = np.array([0.0, first.duration])
        velocity = first.at(times).com_velocity
        momentum = np.asarray(first.angular_momentum)
        postures = []
        for end, posture in enumerate((rough.start, rough.goal)):
            motion = self._moving_as(first, end)
            met = met_by_flight(self.mechanics, motion, dict(self.places[end]), velocity[end], momentum)
            _, rates, accelerations = met[:, BASE:]
            postures.append(replace(posture, velocities=rates.tolist(), accelerations=accelerations.tolist()))
        still = replace(
            rough,
            start=postures[0],
            goal=postures[1],
            flight=replace(rough.flight, angular_momentum=tuple(momentum.tolist())),
        )
        for higher in (degree, min(degree + 2, HIGHEST_DEGREE)):
            variant = replace(still, motion=replace(still.motion, degree=higher))
            plan = planned(variant, SearchOptions(), near=first).plan
            if plan.ok:
                break
        return plan

    def _between(self, problem: Problem) -> Problem:
        """The problem of a flight of the clip with these postures at its ends."""
        postures = []
        for end, posture in enumerate((problem.start, problem.goal)):
            postures.append(replace(posture, positions=self.motion[0, BASE:, end].tolist()))
        bases = self.motion[0, :3].T
        centres, _ = self.mechanics.centre(self.motion)
        across = (centres[0, :2, 1] - centres[0, :2, 0]) / float(problem.flight.duration)
        root = self.mechanics.robot.joint_tree.root
        flight = replace(
            problem.flight,
            takeoff=Takeoff(frame=root, position=tuple(bases[0].tolist())),
            landing=Landing(frame=root, height=float(bases[1, 2])),
            horizontal_velocity=tuple(across.tolist()),
        )
        return replace(problem, start=postures[0], goal=postures[1], flight=flight)

    def _moving_as(self, plan: Plan, end: int) -> Array:
        """The motion (3, 6+n) of an end, with the plan's rates and accelerations there."""
        state = plan.at(np.array([0.0, plan.duration])[[end]])
        motion = self.motion[:, :, end].copy()
        motion[1:] = 0.0
        motion[1, BASE:] = state.velocities[0]
        motion[2, BASE:] = state.accelerations[0]
        return motion


def end_motion(
    clip: Clip,
    mechanics: Mechanics,
    flight: ClipFlight,
    places: tuple[Mapping[str, Array], ...],
    lowered: float = 0.0,
) -> Array:
    """Return base, angles and joints (3, 6+n, 2) of a clip at a flight's ends, with feet at their places; still.

    The base is lowered, m.
    """
    ends = np.array([flight.begin, flight.end])
    motion = clip_motion(clip, mechanics, ends)
    motion[0, 2] -= lowered
    closed = [mechanics.close(motion[:, :, [end]], dict(places[end])) for end in range(2)]
    return np.concatenate(closed, axis=2)


def clip_motion(clip: Clip, mechanics: Mechanics, times: Array) -> Array:
    """Return base, angles and planned joints (3, 6+n, N) of a clip at times (N,), s, without rates."""
    robot = clip.robot
    columns = [robot.model_joints.index(joint) for joint in robot.joints]
    motion = np.zeros((3, BASE + len(columns), len(times)))
    motion[0, :3] = clip.curve.base_positions(times).T
    motion[0, 3:BASE] = unwrapped_angles(mechanics.axes, clip.curve.attitudes(times)).T
    motion[0, BASE:] = clip.curve.positions(times)[:, columns].T
    return motion
