"""Phases of a jump in space, and which feet stand when.

Those over which the robot tips leave last; those that are lower where 30 degrees are missing land first.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.phases import Side, TimedPhase, Usual
from floatplan.jumps.spatial.standing import Foot, Kinematics
from floatplan.problem.attitude import Attitude
from floatplan.robot.robot import Robot


class SpatialPhase(TimedPhase):
    """A phase in space; its contacts are feet."""

    first_step = 0.3

    @property
    def feet(self) -> tuple[Foot, ...]:
        """The feet that stand."""
        return self.contacts

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the feet's points that stand."""
        return tuple(foot.name for foot in self.feet)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the robot's frames that stand: one of all points of a sole."""
        return tuple(dict.fromkeys(foot.frame for foot in self.feet))

    @property
    def is_on_one_sole(self) -> bool:
        """Whether one sole stands, and nothing else."""
        return is_one_sole(self.feet)

    def of_speed(self, fastest: float, gravity: float) -> "SpatialPhase":
        """The flight, shorter where legs cannot lift the robot as fast as its shortest duration takes.

        Parameters
        ----------
        fastest : m/s, the greatest speed upwards with which the robot leaves the ground
        gravity : m/s^2
        """
        thrown = 2 * fastest / gravity  # s, from a height to the same one
        if thrown >= self.bounds[0]:
            return self
        # As long as that only the fastest flight is, from a crouch; legs that bend in flight gain a little time.
        return replace(self, duration=0.75 * thrown, bounds=(0.4 * thrown, 1.2 * thrown))

    @property
    def name(self) -> str:
        """Side and frames, for a person."""
        return f"{self.side} on {' and '.join(self.frames)}" if self.frames else self.side


def is_one_sole(feet: Sequence[Foot]) -> bool:
    """Whether feet are the points of one sole, and nothing else."""
    return len({foot.frame for foot in feet}) == 1 and len(feet) == len(Foot.of_soles)


def with_more_feet(before: SpatialPhase, after: SpatialPhase) -> SpatialPhase:
    """Return that of two phases in a row in which more feet stand; all of them do on the border too."""
    arrives = after.side == "landing" or set(before.feet) < set(after.feet)
    return after if arrives else before


def side_phases(
    side: Side,
    groups: Sequence[tuple[Foot, ...]],
    unit: float,
    bounds: Sequence[tuple[float, float] | None],
    rotation: float = 0.0,
    meets_one_sole: bool = False,
) -> list[SpatialPhase]:
    """Return the phases of a side of the flight, or the flight, with generic durations.

    Parameters
    ----------
    side : "takeoff", "flight" or "landing"
    groups : feet of its one or two phases, in order of time
    unit : sqrt(height / g) of the centre of mass where the robot stands, s
    bounds : of their durations, s; None for generic ones
    rotation : of the base in the flight, all angles added, rad
    meets_one_sole : whether a flight begins or ends on one sole
    """
    # Durations over sqrt(height / g), and intervals, of jumps of quadrupeds.
    durations = {
        ("flight", 1): [(2.57, 12)],
        ("takeoff", 1): [(2.73, 20)],
        ("takeoff", 2): [(1.9, 12), (1.03, 8)],
        ("landing", 1): [(3.16, 20)],
        ("landing", 2): [(0.9, 8), (2.3, 12)],
    }[side, len(groups)]
    phases = []
    for feet, (guess, count), fixed in zip(groups, durations, bounds, strict=True):
        # Fast rotations need nodes: one more for each 18 degrees beyond 360.
        count += max(0, round((rotation - 2 * math.pi) / math.radians(18.0)))
        if meets_one_sole or is_one_sole(feet):  # there errors between nodes grow like those of an inverted pendulum
            count = round(1.5 * count)
        usual = Usual(guess, 0.6, 1.8, count)
        phases.append(SpatialPhase(side, feet, *usual.duration(unit, fixed), usual.intervals))
    return phases


def usual_groups(
    robot: Robot, feet: Sequence[Foot], start: Attitude, goal: Attitude, joints: Array
) -> tuple[list[tuple[Foot, ...]], list[tuple[Foot, ...]]]:
    """Return the feet of the phases before takeoff and after landing.

    The base turns in proportion from start to goal. Of its feet those leave last that are lower where it is 30 degrees
    from level for the first time, and those land first that are lower where it is so for the last time.
    """
    progress = np.linspace(0.0, 1.0, 721)  # half a degree apart
    path = np.array([attitude_between(start, goal, instant).matrix for instant in progress])
    tilts = np.arccos(np.clip(path[:, 2, 2], -1.0, 1.0))
    tilted = np.flatnonzero(tilts > math.radians(30.0))
    everything = tuple(feet)
    if not len(tilted):
        return [everything], [everything]
    last = _lower(robot, feet, path[tilted[0]], joints)
    first = _lower(robot, feet, path[tilted[-1]], joints)
    return (
        [everything, last] if last != everything else [everything],
        [first, everything] if first != everything else [everything],
    )


def _lower(robot: Robot, feet: Sequence[Foot], rotation: Array, joints: Array) -> tuple[Foot, ...]:
    """The feet in the lower half of the heights of all where the base is rotated; all where none is lower by much."""
    kinematics = Kinematics(robot)
    kinematics.pose(np.zeros(3), rotation, joints)
    points = np.array([kinematics.point(foot.body, foot.local) for foot in feet])
    apart = np.linalg.norm(points[:, None] - points, axis=2).max()
    heights = points[:, 2]
    least = 0.125  # [-] of the largest distance of two feet: with less difference in height none is lower
    if np.ptp(heights) < least * apart:
        return tuple(feet)
    low = heights < (heights.max() + heights.min()) / 2
    return tuple(foot for foot, is_low in zip(feet, low, strict=True) if is_low)


def attitude_between(start: Attitude, goal: Attitude, progress: float) -> Attitude:
    """Return the attitude at a progress from start, 0, to goal, 1, in the goal's angles."""
    assert goal.axes is not None
    first = start.angles_about(goal.axes)
    angles = first + progress * (np.array(goal.angles) - first)
    return Attitude(angles=tuple(angles.tolist()), axes=goal.axes)
