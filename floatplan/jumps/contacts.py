"""What a robot stands on: feet that are points, soles with heel and toe, and what has to stay above the ground."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray
from floatplan.errors import InputError
from floatplan.problem.parts import HalfPlane, Obstacle
from floatplan.robot import Robot
from floatplan.robot.standing import (
    HEEL,
    HIGHEST,
    SOLE_ENDS,
    Spot,
    corners,
    heights_over_com,
    may_roll,
    out_of_round,
    spot_weights,
    standing_points,
    undersides,
)
from floatplan.tables import POINT_FEET

SAME = 2e-3  # [m] by which places of left and right may differ
LEVEL = 0.02  # [m] by which feet that stand together may differ in the reference posture
STANDING = 5e-3  # [m] what is no higher than that over the ground, in the standing posture, belongs to the feet
WAYS = 64  # [-] directions in which the hull is looked at
COARSE = 5e-3  # [m] by which a corner may be outside those that are watched
FITS = 1e-3  # [m] by which a foot may be no circle about its frame
LEVEL_LINE = 1e-9  # [-] slope of a line that is as good as level
KNEE = 0.8  # [rad] by which a knee bends that would stand straight: legs are 8 % shorter, and can push
BENT = 0.2  # [-] sine of the angle between thigh and shank, below which a leg that stands counts as straight


@dataclass(frozen=True)
class Contact:
    """A point that the robot can stand on, with those that are coupled to it, left and right.

    Attributes
    ----------
    frames : the frame, then its followers'
    suffix : ".heel" or ".toe" for an end of a sole, ".tip" for that of a leg, which have no frames of their own
    spots : the points, in the order of the frames
    depth : its height over the ground where it stands, m; where it rolls, the radius
    vertical : whether it only presses: a heel, whose toe holds the foot, and shares its horizontal force
    """

    frames: tuple[str, ...]
    suffix: str
    spots: tuple[Spot, ...]
    depth: float
    vertical: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the points, by which forces are listed."""
        return tuple(frame + self.suffix for frame in self.frames)

    @property
    def of_sole(self) -> bool:
        """Whether it is an end of a sole."""
        return self.suffix in SOLE_ENDS

    @property
    def radius(self) -> float:
        """Of the circles on which it rolls, m; 0 where it stands on points."""
        return self.spots[0].radius

    @property
    def frame(self) -> str:
        """The first frame."""
        return self.frames[0]

    @property
    def name(self) -> str:
        """The first point's name."""
        return self.frame + self.suffix


def way_between(robot: Robot, first: Spot, second: Spot, y: Array) -> tuple[float, float]:
    """From one spot to another in a posture y (n+1,), where what rolls would be at its body's angle 0, m."""
    angles = robot.tree.absolute_angles(y[0], y[1:])
    one, two = spot_weights(robot, [first, second])
    way = (two - one) @ np.append(robot.tree.rotations(angles), angles)
    return float(way.real), float(way.imag)


def is_ground(obstacle: Obstacle, ground: float) -> bool:
    """Whether an obstacle is the ground at a height, m, on which a robot stands, or below that.

    It is a half-plane with a level line that is at rest. Nothing but feet touches the ground of a jump, and these stand
    on it, which the capsules around them, thicker than the feet, would not allow of an obstacle.
    """
    if not isinstance(obstacle, HalfPlane) or any(obstacle.velocity):
        return False
    across, up = obstacle.normal
    return abs(across) <= LEVEL_LINE * up and obstacle.point[1] <= ground + POINT_FEET


def links_of(robot: Robot, contacts: Iterable[Contact]) -> set[str | None]:
    """Links on which contacts stand."""
    return {robot.contact_link(robot.frames[frame].link) for each in contacts for frame in each.frames}


def ground_below(robot: Robot, contact: Contact, y: Array) -> float:
    """Height of the ground on which a contact stands in a posture y (n+1,), over the centre of mass, m."""
    return float(heights_over_com(robot, contact.spots[:1], y)[0].imag - contact.depth)


def contact_at(robot: Robot, frame: str, y: Array) -> tuple[Contact, ...]:
    """Return the contact of a frame, a point; or toe and heel where its link has a sole.

    See :func:`floatplan.robot.standing.standing_points`, whose parameters and errors these are.
    """
    contacts = []
    for suffix, spot, depth in standing_points(robot, frame, y):
        twins = _twins(robot, frame, spot)
        frames = (frame, *(name for name, _ in twins))
        spots = (spot, *(twin for _, twin in twins))
        contacts.append(Contact(frames, suffix, spots, depth, vertical=suffix == HEEL))
    return tuple(contacts)


def not_round(robot: Robot, contact: Contact, y: Array) -> str:
    """Why a contact cannot roll on circles about its frames down to the ground, for a person; "" where it can.

    The outline of each link has to be such a circle, so far about what is lowest in a posture y (n+1,) that stands as
    it may roll.
    """
    for frame, spot in zip(contact.frames, contact.spots, strict=True):
        if contact.of_sole:
            return f"{frame!r} cannot roll: its link is a sole"
        off = out_of_round(robot, frame, spot, contact.depth, y)
        if not may_roll(off, contact.depth):
            outline = f"no circle about it, by {1e3 * off:.0f} mm" if contact.depth > 0 else "a point"
            return f"{frame!r} cannot roll: its link is {outline}"
    return ""


def rolling(robot: Robot, contact: Contact, y: Array) -> Contact:
    """Return a contact on circles that roll, about its frames down to the ground, in a posture y (n+1,) that stands.

    Raises
    ------
    InputError
        The outline of a link is no such circle: see :func:`not_round`.
    """
    reason = not_round(robot, contact, y)
    if reason:
        raise InputError(reason, advice='name a frame at the centre of a round foot, or let feet = "auto"')
    return replace(contact, spots=tuple(each._replace(radius=contact.depth) for each in contact.spots))


def _twins(robot: Robot, frame: str, spot: Spot) -> list[tuple[str, Spot]]:
    """Links on other bodies that move as the frame does, and the point of each that is where ``spot`` is.

    Of several on a body that is one with geometry where the frame's link has it, and whose own shape has a corner
    nearest to the point.
    """
    tree = robot.tree
    home = robot.frames[frame]
    alike = [
        (name, each)
        for name, each in robot.frames.items()
        if name == each.link and each.body != home.body and (tree.turns[each.body] == tree.turns[home.body]).all()
    ]
    found: dict[int, list[tuple[str, Spot]]] = {}
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 1 + len(robot.joints)))
    for name, each in alike:
        both = [Spot(frame.body, frame.local) for frame in (home, each)]
        pair = [heights_over_com(robot, both, q) for q in postures]
        turned = np.exp(1j * tree.turn * (tree.offsets[home.body] - tree.offsets[each.body]))
        if max(abs(first - second) for first, second in pair) < SAME:
            twin = name, Spot(each.body, each.local + (spot.place - home.local) * turned)
            found.setdefault(each.body, []).append(twin)

    has_geometry = robot.stands_on_geometry(home.link)

    def unlike(twin: tuple[str, Spot]) -> tuple[bool, float]:
        own = robot.link_hulls.get(robot.contact_link(twin[0]) or "", ())
        away = min([abs(corner.place - twin[1].place) for corner in corners(own)], default=np.inf)
        return robot.stands_on_geometry(twin[0]) != has_geometry, away

    return [min(twins, key=unlike) for twins in found.values()]


def standing_feet(robot: Robot, frame: str, y: Array) -> list[str]:
    """Return the frames on which the robot stands beside ``frame``, and itself, the rearmost first.

    They are the limbs' ends that reach as low as it does in the posture ``y`` (n+1,).
    """
    home = robot.frames[frame]
    heights = {link: undersides(robot, corners(robot.link_hulls[link]), y).min() for link in robot.limb_ends}
    own = min([height for link, height in heights.items() if robot.layout.body_of[link] == home.body], default=None)
    chosen = {tuple(robot.tree.turns[home.body].tolist()): frame}
    for link in sorted(heights, key=lambda link: heights[link]):
        if own is not None and heights[link] < own + LEVEL:
            chosen.setdefault(tuple(robot.tree.turns[robot.frames[link].body].tolist()), link)
    places = {
        each: heights_over_com(robot, [Spot(robot.frames[each].body, robot.frames[each].local)], y)[0].real
        for each in chosen.values()
    }
    return sorted(places, key=lambda each: places[each])


def in_the_air(robot: Robot, contacts: Sequence[Contact], y: Array, most: float = LEVEL) -> str:
    """Which contact is above the ground, by more than ``most``, m, in a posture y (n+1,); for a person."""
    heights = {link: undersides(robot, corners(robot.link_hulls[link]), y).min() for link in robot.touching_links}
    if not heights:
        return ""
    lowest = min(heights, key=lambda link: heights[link])
    for contact in contacts:
        above = ground_below(robot, contact, y) - heights[lowest]
        if above > most:
            return f"{contact.name!r} is in the air: {lowest!r} is {1e3 * above:.0f} mm lower"
    return ""


@dataclass(frozen=True)
class _Leg:
    """A leg of thigh and shank that stands on a point.

    Attributes
    ----------
    thigh, shank : bodies
    foot : the point
    knee : index of the joint between them
    per_radian : by which the leg bends, rad, in the plane where the knee turns by one
    """

    thigh: int
    shank: int
    foot: Spot
    knee: int
    per_radian: float

    def places(self, robot: Robot, postures: Array) -> ComplexArray:
        """Hip, knee and foot (3, P) over the centre of mass in postures (P, n+1), m."""
        spots = [Spot(self.thigh, 0j), Spot(self.shank, 0j), self.foot]
        return np.asarray(heights_over_com(robot, spots, postures.T).T)

    def bends(self, robot: Robot, postures: Array) -> Array:
        """Angles (P,) from the thigh to the shank in postures (P, n+1), rad; 0 where the leg is straight."""
        hip, knee, foot = self.places(robot, postures)
        return np.asarray(np.angle((foot - knee) / (knee - hip)))


def _legs(robot: Robot, contacts: Sequence[Contact]) -> list[_Leg]:
    """Legs with one joint between thigh and shank, of the contacts that are points."""
    tree = robot.tree
    legs: list[_Leg] = []
    for contact in contacts:
        foot = contact.spots[0]
        thigh = int(tree.parent[foot.body])
        ways = tree.turns[foot.body] - tree.turns[thigh]
        if not contact.of_sole and thigh > 0 and np.count_nonzero(ways) == 1:
            knee = int(np.flatnonzero(ways)[0])
            legs.append(_Leg(thigh, foot.body, foot, knee, float(tree.turn * ways[knee])))
    return legs


def with_bent_knees(robot: Robot, contacts: Sequence[Contact], y: Array, limits: Array) -> Array:
    """Return the posture y (n+1,) with bent knees, where legs are straight or folded that stand together.

    Between two feet the joints of a straight leg cannot follow from where its foot stands. A knee bends to the side on
    which its range ``limits`` (n, 2) rad is wider, and the hip turns so that the foot stays on its line from the hip.
    """
    legs = _legs(robot, contacts)
    if sum(not contact.vertical for contact in contacts) < 2:
        return y
    tree = robot.tree
    bent = y.copy()
    for leg in legs:
        if abs(np.sin(leg.bends(robot, y[None])[0])) > BENT:
            continue
        hip, _, foot = leg.places(robot, y[None])[:, 0]
        low, high = limits[leg.knee] - y[1 + leg.knee]
        turned = np.sign(high + low) or 1.0
        bent[1 + leg.knee] += turned * min(KNEE / abs(leg.per_radian), max(high, -low) / 2)
        moved_hip, _, moved_foot = leg.places(robot, bent[None])[:, 0]
        ways = tree.turns[leg.thigh] - tree.turns[int(tree.parent[leg.thigh])]
        if np.count_nonzero(ways) == 1:
            joint = int(np.flatnonzero(ways)[0])
            change = np.angle((foot - hip) / (moved_foot - moved_hip)) / (tree.turn * ways[joint])
            bent[1 + joint] = np.clip(bent[1 + joint] + change, *limits[joint])
    return bent


def bent_ranges(robot: Robot, contacts: Sequence[Contact], postures: Array, limits: Array) -> Array:
    """Return the part of joint ranges ``limits`` (n, 2) rad in which motions between ``postures`` (P, n+1) are sought.

    No joint is more than half a turn from all of them; and a leg on a point that stands bent stays bent to that side,
    since next to straight, or folded, what it does between two instants says little of what it does in them.
    """
    joints = postures[:, 1:]
    ranges = np.stack((joints.min(axis=0) - np.pi, joints.max(axis=0) + np.pi), axis=1)
    for leg in _legs(robot, contacts):
        bends = leg.bends(robot, postures)
        if (np.abs(np.sin(bends)) > BENT).all():
            ends = np.stack((0 * bends, np.copysign(np.pi, bends))) - bends
            reached = joints[:, leg.knee] + ends / leg.per_radian
            ranges[leg.knee] = reached.min(), reached.max()
    return np.stack((np.maximum(limits[:, 0], ranges[:, 0]), np.minimum(limits[:, 1], ranges[:, 1])), axis=1)


@dataclass(frozen=True)
class Watched:
    """Points that stay above the ground: places on bodies, and the heights (P,) m of their centres at least.

    Those that are ``low`` (P,) do for bodies that have not turned to one side since they stood. ``touchdown`` (P,) m
    are the heights of those centres where the robot lands turned; minus infinity of what belongs to a foot itself.
    """

    spots: tuple[Spot, ...]
    least: Array
    low: BoolArray
    touchdown: Array


def watched_points(robot: Robot, contacts: Sequence[Contact], ground: float, y: Array, room: float) -> Watched:
    """Return corners of the robot's hull, body by body but for its feet, as few as leave no other far outside.

    Parameters
    ----------
    contacts : on which it stands before the flight or after it; what is inside circles about them is not watched
    ground : height over the centre of mass, m, in the posture ``y`` (n+1,)
    room : kept from the ground, m, or half the height where the robot stands; of feet nothing is
    """
    feet = [spot for each in contacts for spot in each.spots]
    feet_links = links_of(robot, contacts)
    circles = [(spot, each.depth + FITS) for each in contacts for spot in each.spots]
    hulls = robot.hulls(dict.fromkeys(frame for each in contacts for frame in each.frames))
    kept: dict[tuple[float, ...], list[tuple[Spot, bool]]] = {}
    for shape in hulls:
        for corner in corners([shape]):
            group = kept.setdefault(tuple(robot.tree.turns[corner.body].tolist()), [])
            own = [(abs(corner.place - spot.place), most) for spot, most in circles if spot.body == corner.body]
            if all(apart + corner.radius > most for apart, most in own):
                group.append((corner, shape.link in feet_links))
    spots = []
    least = []
    low = []
    touchdown = []
    ways = np.exp(2j * np.pi * np.arange(WAYS) / WAYS)
    turned = robot.tree.rotations(robot.tree.absolute_angles(y[0], y[1:]))
    for members in filter(None, kept.values()):
        places = np.array([corner.place for corner, _ in members])
        radii = np.array([corner.radius for corner, _ in members])
        reach = np.outer(ways.real, places.real) + np.outer(ways.imag, places.imag) + radii
        farthest = dict[int, bool]()
        for under in (True, False):
            facing = reach[(ways * turned[members[0][0].body]).imag < 0] if under else reach
            while (missing := facing.max(axis=1) - facing[:, [*farthest]].max(axis=1, initial=-np.inf)).max() > COARSE:
                farthest[int(facing[missing.argmax()].argmax())] = under
        heights = undersides(robot, [corner for corner, _ in members], y) - ground
        for index in sorted(farthest):
            above = heights[index]
            spot, is_foot = members[index]
            stands = any(foot.body == spot.body and abs(foot.place - spot.place) < SAME for foot in feet)
            if above > STANDING and not stands:
                spots.append(spot._replace(radius=0.0))
                least.append(spot.radius + (-POINT_FEET / 2 if is_foot else min(room, above / 2)))
                low.append(farthest[index])
                own_height = -np.inf if is_foot and near_contact(spot, feet) else spot.radius + min(room, above / 2)
                touchdown.append(own_height)
    return Watched(tuple(spots), np.array(least), np.array(low, bool), np.array(touchdown))


def near_contact(corner: Spot, feet: Sequence[Spot]) -> bool:
    """Whether a corner of a link that stands belongs to the foot itself, and not to the shank above it."""
    return any(foot.body == corner.body and abs(foot.place - corner.place) < HIGHEST for foot in feet)
