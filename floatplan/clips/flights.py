"""Where a clip is in the air: feet, the ground under them, and the stretches of time in which nothing touches it.

The clip is searched on its splines at 200 Hz, not on its frames: at 30 Hz a hop of a tenth of a second has three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.clips.curve import ClipCurve
from floatplan.errors import InputError
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.kinematics import BodySolids, body_poses, in_body, on_body
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid

FOOT_CLEARANCE = 0.02  # [m] over the ground, above which a foot is in the air
LEAST_DURATION = 0.1  # [s] of a flight: a shorter one is noise of the frames
STILL = 0.25  # [m/s] of a foot's lowest point: slower, it stands
STANCE_SPAN = 0.3  # [s] before and after a flight, in which its stances are judged and shown, and their forces computed
RANGE_MARGIN = 0.15  # [rad] that ranges of plans reach beyond the clip's positions: at its edge a joint cannot move
CHECKED = 101  # [-] instants at which a planned flight or stance is compared with the clip
BASE_BODY = 1  # the model's joint that carries the base


@dataclass(frozen=True)
class Sampling:
    """At which instants a clip is searched for feet, ground and flights."""

    rate: float = 200.0  # [Hz]
    speed_steps: int = 4  # [-] to either side, 0.04 s in all, of speeds: over less, noise of 1 mm looks like motion
    chunk: int = 4096  # [-] instants that are evaluated at once
    ground_window: float = 1.5  # [s] to either side, in which the ground is assumed to be level


SAMPLING = Sampling()


@dataclass(frozen=True)
class ClipFlight:
    """A stretch of a clip in which nothing touches the ground.

    Attributes
    ----------
    begin, end : s, from the clip's beginning
    first, last : the first and the last frame within it
    """

    begin: float
    end: float
    first: int
    last: int

    @property
    def duration(self) -> float:
        """In the clip, s."""
        return self.end - self.begin

    @property
    def frames(self) -> int:
        """How many frames of the clip are in it."""
        return max(self.last - self.first + 1, 0)


@dataclass(frozen=True, eq=False)
class Ground:
    """Height of the ground under the robot at times (K,), s: heights (K,), m."""

    times: Array
    heights: Array

    def at(self, times: Array) -> Array:
        """Heights at times, m."""
        return np.interp(times, self.times, self.heights)


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip's bodies over the ground, at K instants.

    Attributes
    ----------
    curve : ClipCurve
    contacts : (N, C) bool, optional
        Of the frames, where the clip's file says which feet stand.
    times : (K,) s
    foot_bodies : (F,)
        Joints of the model that carry the feet.
    foot_names : (F,)
        A link of each.
    foot_solids : BodySolids
        The shapes of each.
    foot_heights : (K, F) m
        Of each foot's lowest point, in the world.
    foot_velocities : (K, F, 3) m/s
        Of the point that is lowest, in the world.
    other_heights : (K, O) m
        Of the lowest point of each other body.
    other_clearances : (O,) m
        Over the ground, above which each of them is in the air.
    ground : Ground
    """

    curve: ClipCurve
    contacts: BoolArray | None
    times: Array
    foot_bodies: tuple[int, ...]
    foot_names: tuple[str, ...]
    foot_solids: BodySolids
    foot_heights: Array
    foot_velocities: Array
    other_heights: Array
    other_clearances: Array
    ground: Ground

    @classmethod
    def of(
        cls,
        curve: ClipCurve,
        contacts: BoolArray | None,
        feet: Sequence[str] | None,
        ground_height: float | None,
    ) -> Scene:
        """Search a clip for its feet and the ground under them.

        Parameters
        ----------
        curve : ClipCurve
        contacts : as of the class
        feet : links whose bodies are the feet, optional
        ground_height : m, optional

        Raises
        ------
        InputError
            A foot's name is that of no link with a shape; or no shape tells the feet.
        """
        count = max(int(np.floor(curve.duration * SAMPLING.rate)) + 1, 2)
        times = np.linspace(0.0, curve.duration, count)
        by_body = _solids_by_body(curve.robot)
        bodies = list(by_body)
        usual, extent = _usual_heights(curve, by_body)
        feet_bodies = _named_feet(feet, by_body) if feet else _lowest_limbs(curve.robot, by_body, usual, extent)
        columns = [bodies.index(body) for body in feet_bodies]
        others = [column for column in range(len(bodies)) if column not in columns]
        heights, foot_velocities = _lowest_points(curve, times, by_body, feet_bodies)
        foot_heights = heights[:, columns]
        return cls(
            curve=curve,
            contacts=contacts,
            times=times,
            foot_bodies=tuple(feet_bodies),
            foot_names=tuple(by_body[body][0].link for body in feet_bodies),
            foot_solids=BodySolids(tuple(by_body[body] for body in feet_bodies)),
            foot_heights=foot_heights,
            foot_velocities=foot_velocities,
            other_heights=heights[:, others],
            # Shapes of other bodies are coarser: each must be as high as it usually is over the robot's lowest point,
            # but at least 2 cm, and at most 10 cm.
            other_clearances=np.clip(usual[others], FOOT_CLEARANCE, 0.1),
            ground=_ground(times, foot_heights, np.linalg.norm(foot_velocities, axis=2), ground_height),
        )

    @cached_property
    def clearances(self) -> Array:
        """Heights (K, F) of the feet's lowest points over the ground at the scene's instants, m."""
        return np.asarray(self.foot_heights - self.ground.heights[:, None])

    def foot_clearances(self, times: Array) -> Array:
        """Heights (N, F) of the feet's lowest points over the ground at times (N,), s, of the clip, m."""
        return np.stack([np.interp(times, self.times, column) for column in self.clearances.T], axis=1)

    def in_the_air(self, clearance: float = FOOT_CLEARANCE) -> BoolArray:
        """Whether nothing touches the ground, (K,): feet are higher over it than a clearance, m.

        The file's own labels decide where it has any.
        """
        if self.contacts is not None:
            frame = np.rint(self.times * self.curve.fps).astype(np.int64)
            stands = np.asarray(self.contacts.any(axis=1))
            return ~stands[np.minimum(frame, self.curve.frames - 1)]
        feet = self.foot_heights - clearance
        others = self.other_heights - self.other_clearances
        return np.asarray(np.concatenate((feet, others), axis=1).min(axis=1) > self.ground.heights)

    def flights(self) -> tuple[ClipFlight, ...]:
        """The flights, in their order."""
        stretches = self._stretches_in_the_air(FOOT_CLEARANCE)
        flights = [self._flight(first, last) for first, last in stretches]
        return tuple(flight for flight in flights if flight.duration >= LEAST_DURATION)

    def longest(self, flight: ClipFlight) -> ClipFlight:
        """The longer stretch around a flight in which all feet are more than 5 mm up.

        The flight may have begun before feet pass 2 cm, and may end after they do.
        """
        for longer in self._longest_flights:
            if longer.begin <= flight.begin and flight.end <= longer.end:
                return longer
        return flight

    @cached_property
    def _longest_flights(self) -> tuple[ClipFlight, ...]:
        low = 0.005  # [m] of feet that may be in the air: more than noise of frames that stand
        stretches = self._stretches_in_the_air(low)
        return tuple(self._flight(first, last) for first, last in stretches)

    def _stretches_in_the_air(self, clearance: float) -> list[tuple[int, int]]:
        """First and last instant of each stretch in the air; a robot that hangs still, and lets go, flies from then on.

        The file's own labels decide where it has any.
        """
        in_air = self.in_the_air(clearance)
        hangs = np.zeros(len(self.times), np.bool_)
        if self.contacts is None:
            height, still = _lowest_foot(self.foot_heights, np.linalg.norm(self.foot_velocities, axis=2))
            for first, last in _long_stands(self.times, height, still):
                hangs[first : last + 1] = in_air[(first + last) // 2]
        return sorted(_stretches(in_air & hangs) + _stretches(in_air & ~hangs))

    def _flight(self, first: int, last: int) -> ClipFlight:
        """The flight from one instant to another, by their numbers."""
        fps = self.curve.fps
        begin = float(self.times[first])
        end = float(self.times[last])
        first_frame = int(np.ceil(begin * fps - 1e-9))
        last_frame = min(int(np.floor(end * fps + 1e-9)), self.curve.frames - 1)
        return ClipFlight(begin=begin, end=end, first=first_frame, last=last_frame)


def free_time(flights: Sequence[ClipFlight], number: int, duration: float) -> tuple[float, float]:
    """When the flight before a flight ends, and the one after it begins, s; ends of the clip where there is none."""
    return (
        flights[number - 1].end if number else 0.0,
        flights[number + 1].begin if number + 1 < len(flights) else duration,
    )


def _stretches(true: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each stretch of instants at which something is true."""
    padded = np.concatenate(([False], true, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def _solids_by_body(robot: Robot) -> dict[int, list[LinkSolid]]:
    """The shapes of all bodies that have any, by the joint that carries them.

    Raises
    ------
    InputError
        No link has a shape.
    """
    solids_by_body: dict[int, list[LinkSolid]] = {}
    for solid in robot.solids:
        solids_by_body.setdefault(solid.body, []).append(solid)
    if not solids_by_body:
        raise InputError("has no shapes: what touches the ground is unknown", source=robot.source)
    return solids_by_body


def _lowest_points(
    curve: ClipCurve, times: Array, by_body: dict[int, list[LinkSolid]], feet: Sequence[int]
) -> tuple[Array, Array]:
    """Heights (K, B) of the lowest points of B bodies, m, and velocities (K, F, 3), m/s, of the feet there.

    A velocity is that of the material point which is lowest, over the span of some instants to either side.
    """
    count = len(times)
    bodies = list(by_body)
    solids = BodySolids(tuple(by_body.values()))
    heights = np.empty((count, len(by_body)))
    velocities = np.empty((count, len(feet), 3))
    for begin in range(0, count, SAMPLING.chunk):
        end = min(begin + SAMPLING.chunk, count)
        first = max(begin - SAMPLING.speed_steps, 0)  # velocities need the instants next to the chunk
        poses = curve.poses(times[first : min(end + SAMPLING.speed_steps, count)])
        own = np.arange(begin, end)
        before = np.maximum(own - SAMPLING.speed_steps, 0)
        after = np.minimum(own + SAMPLING.speed_steps, count - 1)
        inside = _some(poses, own - first)
        lowest = solids.lowest(inside)
        heights[own] = lowest[..., 2]
        for number, body in enumerate(feet):
            local = in_body(inside, body, lowest[:, bodies.index(body)])
            moved = on_body(_some(poses, after - first), body, local)
            moved -= on_body(_some(poses, before - first), body, local)
            velocities[own, number] = moved / (times[after] - times[before])[:, None]
    return heights, velocities


def _some(poses: BodyPoses, instants: IntArray) -> BodyPoses:
    return BodyPoses(poses.places[instants], poses.rotations[instants])


def _named_feet(names: Sequence[str], by_body: dict[int, list[LinkSolid]]) -> list[int]:
    """Bodies of the links of these names."""
    links: dict[str, int] = {}
    for body, solids in by_body.items():
        links |= {solid.link: body for solid in solids}
    unknown = [name for name in names if name not in links]
    if unknown:
        listed = ", ".join(links)
        raise InputError(f'no link "{unknown[0]}" with a shape is known', element="feet", advice=f"links: {listed}")
    return list(dict.fromkeys(links[name] for name in names))


def _usual_heights(curve: ClipCurve, by_body: dict[int, list[LinkSolid]]) -> tuple[Array, float]:
    """How far over the lowest of all bodies each of them (B,) often is, m, and how far the highest.

    Where its base tilts much it is taken as of an upright robot: in the air it may be upside down for most of a clip. A
    base that ends a limb is a foot or a hand; it has its first attitude of the clip.
    """
    times = np.linspace(0.0, curve.duration, 50)  # enough to compare limbs
    attitudes = curve.attitudes(times)
    if _base_ends_a_limb(curve.robot):
        attitudes[:] = attitudes[0]
    else:
        upright = _upright(attitudes)
        tilts = attitudes[:, 2] @ upright[2] < np.cos(np.deg2rad(30.0))  # [rad] more than that of a stance
        attitudes[tilts] = upright
    poses = body_poses(curve.robot, np.zeros((len(times), 3)), attitudes, curve.positions(times))
    heights = BodySolids(tuple(by_body.values())).lowest(poses)[..., 2]
    over_lowest = heights - heights.min(axis=1, keepdims=True)
    often = np.percentile(over_lowest, 20.0, axis=0)  # [%] of the time
    return often, float(np.median(over_lowest.max(axis=1)))


def _upright(attitudes: Array) -> Array:
    """The attitude (3, 3) of the base of an upright robot, among those of a clip (K, 3, 3).

    It is the identity, unless the clip begins and ends with another axis of the base up, as of models with y upwards.
    """
    first = attitudes[0, 2]
    last = attitudes[-1, 2]
    far = np.cos(np.deg2rad(60.0))  # [rad] no robot bends so far where it stands
    near = np.cos(np.deg2rad(30.0))  # [rad] it stands the same way at both ends
    if first[2] < far and last[2] < far and first @ last > near:
        return np.asarray(attitudes[0])
    return np.eye(3)


def _base_ends_a_limb(robot: Robot) -> bool:
    """Whether a single joint carries all of the robot but its base."""
    return list(robot.model.parents).count(BASE_BODY) == 1


def _lowest_limbs(robot: Robot, by_body: dict[int, list[LinkSolid]], usual: Array, extent: float) -> list[int]:
    """Bodies that end a limb, the base too where it ends a limb, and are often near the robot's lowest point.

    Raises
    ------
    InputError
        There is none.
    """
    carries = {int(robot.model.parents[body]) for body in by_body}
    if _base_ends_a_limb(robot):
        carries.discard(BASE_BODY)
    low = usual <= 0.2 * extent  # [-] of the robot's height: a limb that often ends so near its lowest point is a foot
    feet = [body for body, is_low in zip(by_body, low, strict=True) if is_low and body not in carries]
    if not feet:
        raise InputError(
            "no foot can be told by its shape", source=robot.source, advice="name the feet's links: --feet"
        )
    return feet


def _ground(times: Array, heights: Array, speeds: Array, level: float | None) -> Ground:
    """Height of the ground along a clip: the level of the parameter, or that at which the lowest foot stands.

    A foot that stands for long has its own level, as on a box; up to the top between two such levels the ground is the
    first, and from there the second. Else the ground is the median of the lower feet that stand near in time; where
    none stands within the window, as at the nearest instant where one does; where none ever does, the lowest point.
    """
    if level is not None:
        return Ground(times, np.full(len(times), level))
    height, still = _lowest_foot(heights, speeds)
    if not still.any():
        return Ground(times, np.full(len(times), height.min()))
    result = _level(times, times[still], height[still])
    stands = _long_stands(times, height, still)
    for first, last in stands:
        result[first : last + 1] = np.median(height[first : last + 1])
    for (_, last), (following, _) in pairwise(stands):
        if times[following] - times[last] <= SAMPLING.ground_window:
            top = last + int(height[last : following + 1].argmax())
            result[last:top] = result[last]
            result[top:following] = result[following]
    return Ground(times, result)


def _lowest_foot(heights: Array, speeds: Array) -> tuple[Array, BoolArray]:
    """Height (K,) of the lowest of all feet (K, F), and whether that one is still."""
    lowest = heights.argmin(axis=1)
    index = np.arange(len(heights))
    return heights[index, lowest], np.asarray(speeds[index, lowest] < STILL)


def _long_stands(times: Array, height: Array, still: BoolArray) -> list[tuple[int, int]]:
    """First and last instant of each stretch in which the lowest foot is on one level for long."""
    return [(first, last) for first, last in _stretches(still) if _is_long_stand(times, height, first, last)]


def _is_long_stand(times: Array, height: Array, first: int, last: int) -> bool:
    """Whether a foot is still on one level from one index to another, longer than at the top of any true flight."""
    if times[last] - times[first] < 0.25:  # [s] at the top of a flight a foot would fall by 8 cm in it
        return False
    low, high = np.percentile(height[first : last + 1], [5, 95])
    return bool(high - low <= 0.01)  # [m] of heights on one level


def _level(times: Array, still_times: Array, still_heights: Array) -> Array:
    """The middle (K,) of the lower heights within the window about each instant."""
    percent = 35.0  # [%] of the heights of still feet: below the median, since a foot still in the air is higher
    levels = np.full(len(times), np.nan)
    first = np.searchsorted(still_times, times - SAMPLING.ground_window)
    end = np.searchsorted(still_times, times + SAMPLING.ground_window)
    step = round(0.05 * SAMPLING.rate)  # instants, of 0.05 s: the ground hardly changes within
    level_of: dict[tuple[int, int], float] = {}  # by the first and the end of those in the window
    for k in {*range(0, len(times), step), len(times) - 1}:
        window = int(first[k]), int(end[k])
        if window[1] > window[0]:
            if window not in level_of:
                level_of[window] = float(np.percentile(still_heights[slice(*window)], percent))
            levels[k] = level_of[window]
    finite = np.flatnonzero(np.isfinite(levels))
    nearest = finite[np.clip(np.searchsorted(finite, np.arange(len(times))), 0, len(finite) - 1)]
    return np.asarray(levels[nearest])
