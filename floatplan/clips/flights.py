"""Where a clip is in the air: feet, the ground under them, and the stretches of time in which nothing touches it.

The clip is looked at on its splines at 200 Hz, not on its frames: at 30 Hz a hop of a tenth of a second has three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.clips.curve import ClipCurve, body_poses
from floatplan.errors import InputError
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid

LOOK = 200.0  # [Hz] at which a clip is looked at
FOOT_CLEARANCE = 0.02  # [m] over the ground, above which a foot is in the air
BODY_CLEARANCE = 0.10  # [m] the same of other bodies, whose shapes are coarser, at most: ankles are always lower
SHORTEST = 0.1  # [s] of a flight
STILL = 0.25  # [m/s] of a foot's lowest point: slower, it stands
SPEED_STEPS = 4  # [-] instants to either side, 0.04 s in all, between which speeds are taken: over less, noise of a
# millimetre looks like motion
GROUND_WINDOW = 1.5  # [s] to either side, in which the ground is taken to be level
LONG_STAND = 0.25  # [s] in which a foot on one level is not at the top of a flight: it would fall by 8 cm
LEVEL = 0.01  # [m] of a foot's heights on one level
LOW_SHARE = 0.7  # [-] of the heights of feet that stand: a foot that is held still in the air is higher
FOOT_REACH = 0.2  # [-] of the robot's height: a limb that often ends so near to its lowest point is a foot
OFTEN = 20.0  # [%] of the time
FRAMES_FOR_FEET = 100  # [-] instants at which limbs are compared
CHUNK = 4096  # [-] instants that are evaluated at once
BASE_BODY = 1  # the model's joint that carries the base
DOWN = np.array([0.0, 0.0, -1.0])


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
    foot_solids : (F,)
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
    foot_solids: tuple[Sequence[LinkSolid], ...]
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
        """Look at a clip.

        Parameters
        ----------
        curve : ClipCurve
        contacts : as of the class
        feet : links whose bodies are the feet, optional
        ground_height : m, optional

        Raises
        ------
        InputError
            A foot that is asked for is no link with a shape; or no foot can be told.
        """
        count = max(int(np.floor(curve.duration * LOOK)) + 1, 2)
        times = np.linspace(0.0, curve.duration, count)
        by_body = _solids_by_body(curve.robot)
        bodies = list(by_body)
        usual, extent = _usual_heights(curve, by_body)
        found = _named_feet(feet, by_body) if feet else _found_feet(curve.robot, by_body, usual, extent)
        columns = [bodies.index(body) for body in found]
        others = [column for column in range(len(bodies)) if column not in columns]
        heights, foot_velocities = _watched(curve, times, by_body, found)
        foot_heights = heights[:, columns]
        return cls(
            curve=curve,
            contacts=contacts,
            times=times,
            foot_bodies=tuple(found),
            foot_names=tuple(by_body[body][0].link for body in found),
            foot_solids=tuple(by_body[body] for body in found),
            foot_heights=foot_heights,
            foot_velocities=foot_velocities,
            other_heights=heights[:, others],
            other_clearances=np.clip(usual[others], FOOT_CLEARANCE, BODY_CLEARANCE),
            ground=_ground(times, foot_heights, np.linalg.norm(foot_velocities, axis=2), ground_height),
        )

    def foot_clearances(self, times: Array) -> Array:
        """Heights (K, F) of the feet's lowest points over the ground at times (K,), s, of the clip, m."""
        over_ground = self.foot_heights - self.ground.heights[:, None]
        return np.stack([np.interp(times, self.times, column) for column in over_ground.T], axis=1)

    def in_the_air(self) -> BoolArray:
        """Whether nothing touches the ground, (K,); the file's own labels decide where it has any."""
        if self.contacts is not None:
            frame = np.rint(self.times * self.curve.fps).astype(np.int64)
            stands = np.asarray(self.contacts.any(axis=1))
            return ~stands[np.minimum(frame, self.curve.frames - 1)]
        feet = self.foot_heights - FOOT_CLEARANCE
        others = self.other_heights - self.other_clearances
        return np.asarray(np.concatenate((feet, others), axis=1).min(axis=1) > self.ground.heights)

    def flights(self) -> tuple[ClipFlight, ...]:
        """The flights, in their order."""
        found: list[ClipFlight] = []
        fps = self.curve.fps
        for first, last in _stretches(self.in_the_air()):
            begin = float(self.times[first])
            end = float(self.times[last])
            if end - begin < SHORTEST:
                continue
            first_frame = int(np.ceil(begin * fps - 1e-9))
            last_frame = min(int(np.floor(end * fps + 1e-9)), self.curve.frames - 1)
            found.append(ClipFlight(begin=begin, end=end, first=first_frame, last=last_frame))
        return tuple(found)


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
    found: dict[int, list[LinkSolid]] = {}
    for solid in robot.solids:
        found.setdefault(solid.body, []).append(solid)
    if not found:
        raise InputError("has no shapes: what touches the ground is not known", source=robot.source)
    return found


def _watched(
    curve: ClipCurve, times: Array, by_body: dict[int, list[LinkSolid]], feet: Sequence[int]
) -> tuple[Array, Array]:
    """Heights (K, B) of the lowest points of B bodies, m, and velocities (K, F, 3), m/s, of the feet there.

    A velocity is that of the material point which is lowest, over the span of some instants to either side.
    """
    count = len(times)
    heights = np.empty((count, len(by_body)))
    velocities = np.empty((count, len(feet), 3))
    for begin in range(0, count, CHUNK):
        end = min(begin + CHUNK, count)
        first = max(begin - SPEED_STEPS, 0)  # the instants beside the chunk are needed for velocities
        poses = curve.poses(times[first : min(end + SPEED_STEPS, count)])
        own = np.arange(begin, end)
        before = np.maximum(own - SPEED_STEPS, 0)
        after = np.minimum(own + SPEED_STEPS, count - 1)
        inside = _some(poses, own - first)
        for column, (body, solids) in enumerate(by_body.items()):
            lowest = lowest_point(inside, solids)
            heights[own, column] = lowest[:, 2]
            if body in feet:
                local = in_body(inside, body, lowest)
                moved = on_body(_some(poses, after - first), body, local)
                moved -= on_body(_some(poses, before - first), body, local)
                velocities[own, feet.index(body)] = moved / (times[after] - times[before])[:, None]
    return heights, velocities


def lowest_point(poses: BodyPoses, solids: Sequence[LinkSolid]) -> Array:
    """Lowest point (K, 3) of the solids of one body, m, in the world."""
    points = np.stack([_lowest_of_solid(poses, solid) for solid in solids], axis=1)
    least = points[..., 2].argmin(axis=1)
    return np.asarray(points[np.arange(len(points)), least])


def _lowest_of_solid(poses: BodyPoses, solid: LinkSolid) -> Array:
    """Lowest point (K, 3) of one solid: a corner of its hull, and from there that of the ellipsoid."""
    rotations = poses.rotations[:, solid.body]
    directions = DOWN @ rotations
    corner = solid.points[(directions @ solid.points.T).argmax(axis=1)]
    along_axes = directions @ solid.axes
    length = np.linalg.norm(along_axes, axis=1, keepdims=True)
    round_part = (along_axes / np.where(length > 0, length, 1.0)) @ solid.axes.T
    local = corner + round_part
    return np.asarray(poses.places[:, solid.body] + np.einsum("kab,kb->ka", rotations, local))


def _some(poses: BodyPoses, instants: IntArray) -> BodyPoses:
    return BodyPoses(poses.places[instants], poses.rotations[instants])


def in_body(poses: BodyPoses, body: int, points: Array) -> Array:
    """Points (K, 3) of the world, one at each instant, in a body's frame, m."""
    return np.asarray(np.einsum("kba,kb->ka", poses.rotations[:, body], points - poses.places[:, body]))


def on_body(poses: BodyPoses, body: int, local: Array) -> Array:
    """Places (K, 3) in the world, m, of points (K, 3) in a body's frame, one at each instant."""
    return np.asarray(poses.places[:, body] + np.einsum("kab,kb->ka", poses.rotations[:, body], local))


def _named_feet(names: Sequence[str], by_body: dict[int, list[LinkSolid]]) -> list[int]:
    """Bodies of the links of these names."""
    links = {solid.link: body for body, solids in by_body.items() for solid in solids}
    unknown = [name for name in names if name not in links]
    if unknown:
        known = ", ".join(links)
        raise InputError(f'no link "{unknown[0]}" with a shape is known', element="feet", advice=f"links: {known}")
    return list(dict.fromkeys(links[name] for name in names))


def _usual_heights(curve: ClipCurve, by_body: dict[int, list[LinkSolid]]) -> tuple[Array, float]:
    """How far over the lowest of all bodies each of them (B,) often is, m, and how far the highest.

    The robot is held upright for it, its base at the identity: in the air it may be upside down for most of a clip. A
    base that ends a limb is a foot or a hand; it is held as the clip begins.
    """
    times = np.linspace(0.0, curve.duration, FRAMES_FOR_FEET)
    upright = curve.attitudes(times[:1])[0] if _base_ends_a_limb(curve.robot) else np.eye(3)
    held = np.broadcast_to(upright, (len(times), 3, 3))
    poses = body_poses(curve.robot, np.zeros((len(times), 3)), held, curve.positions(times))
    heights = np.stack([lowest_point(poses, solids)[:, 2] for solids in by_body.values()], axis=1)
    over_lowest = heights - heights.min(axis=1, keepdims=True)
    return np.percentile(over_lowest, OFTEN, axis=0), float(np.median(over_lowest.max(axis=1)))


def _base_ends_a_limb(robot: Robot) -> bool:
    """Whether a single joint carries all of the robot but its base."""
    return list(robot.model.parents).count(BASE_BODY) == 1


def _found_feet(robot: Robot, by_body: dict[int, list[LinkSolid]], usual: Array, extent: float) -> list[int]:
    """Bodies that end a limb, the base too where it ends one, and are often near the robot's lowest point.

    Raises
    ------
    InputError
        There is none.
    """
    carries = {int(robot.model.parents[body]) for body in by_body}
    if _base_ends_a_limb(robot):
        carries.discard(BASE_BODY)
    low = usual <= FOOT_REACH * extent
    feet = [body for body, is_low in zip(by_body, low, strict=True) if is_low and body not in carries]
    if not feet:
        raise InputError(
            "no foot can be told by its shape", source=robot.source, advice="name the feet's links: --feet"
        )
    return feet


def _ground(times: Array, heights: Array, speeds: Array, level: float | None) -> Ground:
    """Height of the ground along a clip: as asked, or that at which the lowest foot stands.

    A foot that stands for long has its own level, as on a box; up to the top between two such levels the ground is the
    first, and from there the second. Else the ground is the median of the lower feet that stand near in time; where
    none stands within the window, as at the nearest instant where one does; where none ever does, the lowest point.
    """
    if level is not None:
        return Ground(times, np.full(len(times), level))
    lowest = heights.argmin(axis=1)
    index = np.arange(len(times))
    height = heights[index, lowest]
    still = speeds[index, lowest] < STILL
    if not still.any():
        return Ground(times, np.full(len(times), height.min()))
    result = _level(times, times[still], height[still])
    stands = [(first, last) for first, last in _stretches(still) if _is_long_stand(times, height, first, last)]
    for first, last in stands:
        result[first : last + 1] = np.median(height[first : last + 1])
    for (_, last), (following, _) in pairwise(stands):
        if times[following] - times[last] <= GROUND_WINDOW:
            top = last + int(height[last : following + 1].argmax())
            result[last:top] = result[last]
            result[top:following] = result[following]
    return Ground(times, result)


def _is_long_stand(times: Array, height: Array, first: int, last: int) -> bool:
    """Whether a foot is still on one level from one index to another, longer than at the top of any true flight."""
    if times[last] - times[first] < LONG_STAND:
        return False
    low, high = np.percentile(height[first : last + 1], [5, 95])
    return bool(high - low <= LEVEL)


def _level(times: Array, still_times: Array, still_heights: Array) -> Array:
    """The middle (K,) of the lower heights within the window about each instant."""
    percent = 50.0 * LOW_SHARE
    found = np.full(len(times), np.nan)
    first = np.searchsorted(still_times, times - GROUND_WINDOW)
    end = np.searchsorted(still_times, times + GROUND_WINDOW)
    step = max(int(GROUND_WINDOW * LOOK / 30), 1)  # it hardly changes within a twentieth of a second
    for k in {*range(0, len(times), step), len(times) - 1}:
        if end[k] > first[k]:
            found[k] = np.percentile(still_heights[first[k] : end[k]], percent)
    known = np.flatnonzero(np.isfinite(found))
    nearest = known[np.clip(np.searchsorted(known, np.arange(len(times))), 0, len(known) - 1)]
    return np.asarray(found[nearest])
