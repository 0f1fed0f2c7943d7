"""Which feet stand before and after a flight of a clip, and where: what a planned stance keeps of the clip's contacts.

A foot stands where it is low and slow. Feet that leave within a tenth of a second leave at one time, when the first of
them does; those that arrive so, with the last one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from floatplan.arrays import Array, BoolArray
from floatplan.clips.clip import Clip
from floatplan.clips.flights import FOOT_CLEARANCE, STILL, ClipFlight
from floatplan.errors import FloatplanError
from floatplan.jumps.spatial.standing import Foot, Kinematics, feet_at
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.kinematics import on_body
from floatplan.problem.attitude import Attitude


@dataclass(frozen=True)
class ContactRules:
    """What counts as feet that stand, and how far planned stances go."""

    at_once: float = 0.1  # [s] within which feet leave, or arrive, at the same time
    near: float = 0.2  # [s] before or after a flight, within which its feet must stand
    brief: float = 0.05  # [s] shorter stands, and shorter gaps in one, are noise of the frames
    reach: float = 0.4  # [s] of a stance that is planned, at most, where it does not meet another flight


RULES = ContactRules()


class NoContactsError(FloatplanError):
    """A flight of a clip next to which no feet stand as a planned stance needs them."""


@dataclass(frozen=True, eq=False)
class ContactPhase:
    """A time of a clip in which the same feet stand.

    Attributes
    ----------
    begin, end : s, of the clip
    feet : numbers of the clip's feet
    """

    begin: float
    end: float
    feet: tuple[int, ...]


def standing_feet(clip: Clip) -> BoolArray:
    """Return which feet stand at the instants of the clip's scene (K, F): low, slow, and not for a moment only."""
    scene = clip.scene
    speeds = np.linalg.norm(scene.foot_velocities, axis=2)
    stands = (scene.clearances < FOOT_CLEARANCE) & (speeds < STILL)
    brief = max(round(RULES.brief / float(scene.times[1] - scene.times[0])), 1)
    for column in stands.T:
        for value in (True, False):  # first short gaps are closed, then short stands dropped
            _fill_brief(column, value, brief)
    return np.asarray(stands)


def _fill_brief(stands: BoolArray, value: bool, brief: int) -> None:
    """Set stretches of fewer than ``brief`` instants to a value that the instants around them have."""
    edges = np.flatnonzero(np.diff(stands)) + 1
    for first, last in pairwise(edges.tolist()):
        if stands[first] != value and last - first < brief:
            stands[first:last] = value


def still_flight(clip: Clip, stands: BoolArray, flight: ClipFlight) -> ClipFlight:
    """Return the flight from when its feet leave to when they stand again.

    Raises
    ------
    NoContactsError
        No foot stands before it, or after it.
    """
    times = clip.scene.times
    middle = int(np.searchsorted(times, (flight.begin + flight.end) / 2))
    # The last instant before, and the first one after, at which each foot stands.
    leaves = np.where(stands[:middle], times[:middle, None], -math.inf).max(axis=0)
    arrives = np.where(stands[middle:], times[middle:, None], math.inf).min(axis=0)
    if leaves.max() < flight.begin - RULES.near:
        raise NoContactsError(f"no foot stands within {RULES.near:g} s before it")
    if arrives.min() > flight.end + RULES.near:
        raise NoContactsError(f"no foot stands within {RULES.near:g} s after it")
    begin = float(leaves[leaves > leaves.max() - RULES.at_once].min())
    end = float(arrives[arrives < arrives.min() + RULES.at_once].max())
    first = math.ceil(begin * clip.fps - 1e-9)
    last = min(math.floor(end * clip.fps + 1e-9), clip.frames - 1)
    return ClipFlight(begin=begin, end=end, first=first, last=last)


def contact_phases(clip: Clip, stands: BoolArray, begin: float, end: float, inwards: int) -> list[ContactPhase]:
    """Return the phases of a stance between two times of a clip, in order of time.

    No foot stands twice in a stance: where one would, the stance begins later, or ends earlier, away from the flight.

    Parameters
    ----------
    inwards : 1 where the flight follows, -1 where it is before; 0 between two flights

    Raises
    ------
    NoContactsError
        No foot stands at some time; or one stands twice between two flights.
    """
    times = clip.scene.times
    inside = np.flatnonzero((times >= begin - 1e-9) & (times <= end + 1e-9))
    if len(inside) < 2:
        raise NoContactsError("there is no time for a stance")
    own = stands[inside]
    if inwards < 0:
        own = own[::-1]
    # From the flight back: the longest time in which something stands, and nothing comes again.
    usable = 0
    over = np.zeros(own.shape[1], np.bool_)
    for row in own[::-1]:
        if not row.any() or (row & over).any():
            break
        if usable:
            over |= own[len(own) - usable] & ~row
        usable += 1
    if inwards == 0 and usable < len(own):
        raise NoContactsError("between two flights a foot stands twice, or none does")
    if usable < 2:
        raise NoContactsError("no foot stands next to it")
    chosen = inside[len(own) - usable :] if inwards >= 0 else inside[:usable]
    return _phases(times[chosen], stands[chosen])


def _phases(times: Array, stands: BoolArray) -> list[ContactPhase]:
    """Phases of one set of feet each; a short one belongs to the one before it."""
    borders = np.flatnonzero((stands[1:] != stands[:-1]).any(axis=1)) + 1
    edges = [0]
    for border in borders.tolist():
        if times[border] - times[edges[-1]] >= RULES.brief and times[-1] - times[border] >= RULES.brief:
            edges.append(border)
    phases = []
    for first, last in zip(edges, [*edges[1:], len(times) - 1], strict=True):
        feet = np.flatnonzero(stands[(first + last) // 2])
        phases.append(ContactPhase(float(times[first]), float(times[last]), tuple(feet.tolist())))
    return phases


def foot_points(clip: Clip, number: int) -> tuple[Foot, ...]:
    """Return the points of a foot of a clip: the lowest link of its body, a ball or a sole.

    Raises
    ------
    NoContactsError
        The link's frame is not in the foot.
    """
    robot = clip.robot
    kinematics = Kinematics(robot)
    level = Attitude(angles=(0.0, 0.0, 0.0), axes="zyx")
    kinematics.pose(np.zeros(3), level.matrix, robot.resting)
    body = clip.scene.foot_bodies[number]
    links = {solid.link for solid in robot.solids if solid.body == body}
    lowest = min(sorted(links), key=lambda link: kinematics.lowest([link]))
    points = feet_at(robot, lowest, level, robot.resting, "feet")
    farthest = 0.1  # [m] from a foot's frame to the ground: as of frames that name contacts of a jump
    if points[0].depth > farthest:
        away = f"{1e3 * points[0].depth:.0f} mm above its lowest point"
        raise NoContactsError(f"the frame of {lowest} is {away}, so no point is one on which it could stand")
    return points


def foot_places(clip: Clip, number: int, points: Sequence[Foot], phases: Sequence[ContactPhase]) -> dict[str, Array]:
    """Return where the points of a foot stand, (3,) m: on the ground, as it is turned in the middle of its stand."""
    own = [phase for phase in phases if number in phase.feet]
    middle = np.array([(own[0].begin + own[-1].end) / 2])
    poses = clip.curve.poses(middle)
    ground = float(clip.ground.at(middle)[0])
    places = {}
    for foot in points:
        position = _on_body(poses, foot)
        position[2] = ground + foot.depth
        places[foot.name] = position
    return _flattened(points, places)


def _on_body(poses: BodyPoses, foot: Foot) -> Array:
    return np.array(on_body(poses, foot.body, np.array([foot.local]))[0])


def _flattened(points: Sequence[Foot], places: dict[str, Array]) -> dict[str, Array]:
    """Places of a sole's points as far from one another as they are: one that tilts covers less ground."""
    if len(points) < 3:
        return places
    local = np.array([foot.local for foot in points])
    target = np.array([places[foot.name] for foot in points])
    centred = target - target.mean(axis=0)
    u, _, v = np.linalg.svd((local - local.mean(axis=0)).T @ centred)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    fitted = target.mean(axis=0) + (local - local.mean(axis=0)) @ rotation
    fitted[:, 2] = target[:, 2]
    return dict(zip([foot.name for foot in points], fitted, strict=True))
