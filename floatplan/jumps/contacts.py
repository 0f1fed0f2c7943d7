"""What a robot stands on: feet that are points, soles with heel and toe; and the points that stay above the ground."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray
from floatplan.errors import InputError
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import HalfPlane, Obstacle
from floatplan.robot import Robot
from floatplan.robot.standing import (
    HEEL,
    HIGHEST,
    SOLE_ENDS,
    Spot,
    corners,
    may_roll,
    out_of_round,
    positions_from_com,
    spot_weights,
    standing_points,
    undersides,
)
from floatplan.tables import POINT_FEET

SAME_POINT = 2e-3  # [m] within which two points are one, as those of left and right
LEVEL = 0.02  # [m] by which the heights of feet that stand in one phase may differ in the reference posture
BENT = 0.2  # [-] sine of the angle between thigh and shank below which a leg counts as straight, or folded


@dataclass(frozen=True)
class GroundContact:
    """A point that the robot can stand on, with those that are coupled to it, left and right.

    Attributes
    ----------
    frames : the frame, then its followers'
    suffix : ".heel" or ".toe" for an end of a sole, ".tip" for that of a leg, which have no frames of their own
    spots : the points, in the order of the frames
    depth : its height over the ground where it stands, m; where it rolls, the radius
    vertical : whether it is a heel, which in the program only presses, so that its toe takes the horizontal force of
        the sole; in exact stances both share that by their loads
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

    def values(self, of_points: Mapping[str, Array]) -> list[Array]:
        """The values of its points, from those of points by their names."""
        return [of_points[name] for name in self.names]

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


def least_distance(robot: Robot, request: JumpRequest, contacts: Sequence[GroundContact], y: Array) -> float | None:
    """Least horizontal position, m, of the foot that lands first, with which all stands beyond the edge of the ground.

    Its sign is the direction. None where the grounds are equally high.

    Parameters
    ----------
    contacts : on which the robot stands in the end, the foot that lands first before the others
    y : (n+1,) rad, its posture then
    """
    if request.edge is None:
        return None
    direction = float(np.copysign(1.0, request.edge))
    feet = direction * contact_positions(robot, contacts, y).real
    nearest = feet.min()
    if request.rise < 0:  # its knees may be nearer to the side of the ground that it left
        for link in robot.touching_links:
            hull = corners(robot.link_hulls[link])
            radii = np.array([corner.radius for corner in hull])
            nearest = min(nearest, (direction * positions_from_com(robot, hull, y).real - radii).min())
    apart = 0.03  # [m] of what lands from the edge, since feet roll on a little
    return float(request.edge + direction * (apart + feet[0] - nearest))


def displacement(robot: Robot, start: Spot, end: Spot, y: Array) -> tuple[float, float]:
    """Vector from one spot to another in a posture y (n+1,), m; circles that roll are where angles are 0."""
    angles = robot.tree.absolute_angles(y[0], y[1:])
    start_weights, end_weights = spot_weights(robot, [start, end])
    vector = (end_weights - start_weights) @ np.append(robot.tree.rotations(angles), angles)
    return float(vector.real), float(vector.imag)


def is_ground(obstacle: Obstacle, ground: float) -> bool:
    """Whether an obstacle is the ground at a height, m, on which a robot stands, or below that.

    It is a half-plane with a level line that does not move. Nothing but feet touches the ground of a jump, and these
    stand on it, which the capsules around them, thicker than the feet, would not allow of an obstacle.
    """
    if not isinstance(obstacle, HalfPlane) or any(obstacle.velocity):
        return False
    return obstacle.is_level and obstacle.point[1] <= ground + POINT_FEET


def links_of(robot: Robot, contacts: Iterable[GroundContact]) -> set[str | None]:
    """Links on which contacts stand."""
    links = set()
    for contact in contacts:
        for frame in contact.frames:
            links.add(robot.contact_link(robot.frames[frame].link))
    return links


def contact_positions(robot: Robot, contacts: Sequence[GroundContact], y: Array) -> ComplexArray:
    """Positions (.., contacts) relative to the centre of mass in postures y (n+1, ..), m; of pairs, of one of both."""
    return positions_from_com(robot, [contact.spots[0] for contact in contacts], y)


def contact_depths(contacts: Sequence[GroundContact]) -> Array:
    """Heights (contacts,) of contacts over the ground on which they stand, m."""
    return np.array([contact.depth for contact in contacts])


def ground_below(robot: Robot, contact: GroundContact, y: Array) -> float:
    """Height of the ground on which a contact stands in a posture y (n+1,), over the centre of mass, m."""
    return float(contact_positions(robot, [contact], y)[0].imag - contact.depth)


def contact_at(robot: Robot, frame: str, y: Array) -> tuple[GroundContact, ...]:
    """Return the contact of a frame, a point; or toe and heel where its link has a sole.

    See :func:`floatplan.robot.standing.standing_points`, whose parameters and errors these are.
    """
    contacts = []
    for suffix, spot, depth in standing_points(robot, frame, y):
        frames = [frame]
        spots = [spot]
        for name, twin in _twins(robot, frame, spot):
            frames.append(name)
            spots.append(twin)
        contacts.append(GroundContact(tuple(frames), suffix, tuple(spots), depth, vertical=suffix == HEEL))
    return tuple(contacts)


def not_round(robot: Robot, contact: GroundContact, y: Array) -> str:
    """Why a contact cannot roll on circles about its frames down to the ground, for a person; "" where it can.

    The outline of each link has to be such a circle near its lowest point in a posture y (n+1,) that stands, as far as
    a foot may roll.
    """
    for frame, spot in zip(contact.frames, contact.spots, strict=True):
        if contact.of_sole:
            return f"{frame!r} cannot roll: its link is a sole"
        off = out_of_round(robot, frame, spot, contact.depth, y)
        if not may_roll(off, contact.depth):
            outline = f"no circle about it, by {1e3 * off:.0f} mm" if contact.depth > 0 else "a point"
            return f"{frame!r} cannot roll: its link is {outline}"
    return ""


def rolling(robot: Robot, contact: GroundContact, y: Array) -> GroundContact:
    """Return a contact on circles that roll, about its frames down to the ground, in a posture y (n+1,) that stands.

    Raises
    ------
    InputError
        The outline of a link is no such circle: see :func:`not_round`.
    """
    reason = not_round(robot, contact, y)
    if reason:
        raise InputError(reason, advice='name a frame at the centre of a round foot, or let feet = "auto"')
    return replace(contact, spots=tuple(spot._replace(radius=contact.depth) for spot in contact.spots))


def _twins(robot: Robot, frame: str, spot: Spot) -> list[tuple[str, Spot]]:
    """Links on other bodies that move as the frame does, and the point of each that is where ``spot`` is.

    Of several on a body that is one with geometry where the frame's link has it, and whose own shape has a corner
    nearest to the point.
    """
    tree = robot.tree
    home = robot.frames[frame]
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 1 + len(robot.joints)))
    candidates: dict[int, list[tuple[str, Spot]]] = {}  # by body
    for name, other in robot.frames.items():
        turns_alike = (tree.turns[other.body] == tree.turns[home.body]).all()
        if name != other.link or other.body == home.body or not turns_alike:
            continue
        both = [Spot(home.body, home.local), Spot(other.body, other.local)]
        distances = []
        for y in postures:
            first, second = positions_from_com(robot, both, y)
            distances.append(abs(first - second))
        if max(distances) < SAME_POINT:
            rotation = np.exp(1j * tree.turn * (tree.offsets[home.body] - tree.offsets[other.body]))
            twin = Spot(other.body, other.local + (spot.place - home.local) * rotation)
            candidates.setdefault(other.body, []).append((name, twin))

    has_geometry = robot.stands_on_geometry(home.link)

    def unlikeness(candidate: tuple[str, Spot]) -> tuple[bool, float]:
        name, twin = candidate
        hull = robot.link_hulls.get(robot.contact_link(name) or "", ())
        distance = min([abs(corner.place - twin.place) for corner in corners(hull)], default=np.inf)
        return robot.stands_on_geometry(name) != has_geometry, distance

    return [min(of_body, key=unlikeness) for of_body in candidates.values()]


def standing_feet(robot: Robot, frame: str, y: Array) -> list[str]:
    """Return the frames on which the robot stands, ``frame`` among them, the rearmost first.

    They are the limbs' ends that reach as low as it does in the posture ``y`` (n+1,).
    """
    tree = robot.tree
    home = robot.frames[frame]
    heights = _lowest_heights(robot, robot.limb_ends, y)
    own_height = None
    for link, height in heights.items():
        if robot.layout.body_of[link] == home.body:
            own_height = height if own_height is None else min(own_height, height)
    feet = {tuple(tree.turns[home.body].tolist()): frame}  # by how they turn: one of left and right
    for link in sorted(heights, key=heights.__getitem__):
        if own_height is not None and heights[link] < own_height + LEVEL:
            feet.setdefault(tuple(tree.turns[robot.frames[link].body].tolist()), link)
    horizontal = {}
    for name in feet.values():
        foot = robot.frames[name]
        horizontal[name] = positions_from_com(robot, [Spot(foot.body, foot.local)], y)[0].real
    return sorted(horizontal, key=horizontal.__getitem__)


def _lowest_heights(robot: Robot, links: Iterable[str], y: Array) -> dict[str, float]:
    """Height of the lowest point of each link over the centre of mass in a posture y (n+1,), m."""
    return {link: undersides(robot, corners(robot.link_hulls[link]), y).min() for link in links}


def in_the_air(robot: Robot, contacts: Sequence[GroundContact], y: Array, most: float = LEVEL) -> str:
    """Which contact is above the ground, by more than ``most``, m, in a posture y (n+1,); for a person."""
    heights = _lowest_heights(robot, robot.touching_links, y)
    if not heights:
        return ""
    lowest = min(heights, key=heights.__getitem__)
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

    def positions(self, robot: Robot, postures: Array) -> ComplexArray:
        """Hip, knee and foot (3, P) relative to the centre of mass in postures (P, n+1), m."""
        spots = [Spot(self.thigh, 0j), Spot(self.shank, 0j), self.foot]
        return np.asarray(positions_from_com(robot, spots, postures.T).T)

    def bends(self, robot: Robot, postures: Array) -> Array:
        """Angles (P,) from the thigh to the shank in postures (P, n+1), rad; 0 where the leg is straight."""
        hip, knee, foot = self.positions(robot, postures)
        return np.asarray(np.angle((foot - knee) / (knee - hip)))


def _legs(robot: Robot, contacts: Sequence[GroundContact]) -> list[_Leg]:
    """Legs with one joint between thigh and shank, of the contacts that are points."""
    tree = robot.tree
    legs: list[_Leg] = []
    for contact in contacts:
        foot = contact.spots[0]
        thigh = int(tree.parent[foot.body])
        by_joint = tree.turns[foot.body] - tree.turns[thigh]
        if not contact.of_sole and thigh > 0 and np.count_nonzero(by_joint) == 1:
            knee = int(np.flatnonzero(by_joint)[0])
            legs.append(_Leg(thigh, foot.body, foot, knee, float(tree.turn * by_joint[knee])))
    return legs


def with_bent_knees(robot: Robot, contacts: Sequence[GroundContact], y: Array, limits: Array) -> Array:
    """Return the posture y (n+1,) with bent knees where several feet stand on straight or folded legs.

    Between two feet the joints of a straight leg do not follow from where its foot stands. A knee bends to the side on
    which its range ``limits`` (n, 2) rad is wider, and the hip turns so that the foot stays on its line from the hip.
    """
    legs = _legs(robot, contacts)
    if sum(not contact.vertical for contact in contacts) < 2:
        return y
    tree = robot.tree
    bend = 0.8  # [rad] of a knee: legs are 8 % shorter then, and can push
    bent = y.copy()
    for leg in legs:
        if abs(np.sin(leg.bends(robot, y[None])[0])) > BENT:
            continue
        hip, _, foot = leg.positions(robot, y[None])[:, 0]
        low, high = limits[leg.knee] - y[1 + leg.knee]
        side = np.sign(high + low) or 1.0
        bent[1 + leg.knee] += side * min(bend / abs(leg.per_radian), max(high, -low) / 2)
        moved_hip, _, moved_foot = leg.positions(robot, bent[None])[:, 0]
        by_joint = tree.turns[leg.thigh] - tree.turns[int(tree.parent[leg.thigh])]
        if np.count_nonzero(by_joint) == 1:
            joint = int(np.flatnonzero(by_joint)[0])
            change = np.angle((foot - hip) / (moved_foot - moved_hip)) / (tree.turn * by_joint[joint])
            bent[1 + joint] = np.clip(bent[1 + joint] + change, *limits[joint])
    return bent


def bent_ranges(robot: Robot, contacts: Sequence[GroundContact], postures: Array, limits: Array) -> Array:
    """Narrow joint ranges ``limits`` (n, 2) rad to where motions between ``postures`` (P, n+1) are sought.

    No joint is more than half a turn from all of them; and a leg on a point that stands bent stays bent to that side,
    since next to straight, or folded, what it does between two instants says little of what it does in them.
    """
    joints = postures[:, 1:]
    ranges = np.stack((joints.min(axis=0) - np.pi, joints.max(axis=0) + np.pi), axis=1)
    for leg in _legs(robot, contacts):
        bends = leg.bends(robot, postures)
        if (np.abs(np.sin(bends)) > BENT).all():
            ends = np.stack((0 * bends, np.copysign(np.pi, bends))) - bends  # to straight, and to folded
            knee_angles = joints[:, leg.knee] + ends / leg.per_radian
            ranges[leg.knee] = knee_angles.min(), knee_angles.max()
    return np.stack((np.maximum(limits[:, 0], ranges[:, 0]), np.minimum(limits[:, 1], ranges[:, 1])), axis=1)


@dataclass(frozen=True)
class ClearancePoints:
    """Points of bodies that stay above the ground.

    Attributes
    ----------
    spots : (P,) centres of the robot's corners
    least : (P,) m, least heights of those centres
    low : (P,) whether the point is enough for bodies that have not turned to one side since they stood
    touchdown : (P,) m, least heights where the robot lands turned; minus infinity for what belongs to a foot itself
    """

    spots: tuple[Spot, ...]
    least: Array
    low: BoolArray
    touchdown: Array


def clearance_points(
    robot: Robot, contacts: Sequence[GroundContact], ground: float, y: Array, clearance: float
) -> ClearancePoints:
    """Return corners of the robot's hull, body by body but for its feet, as few as leave no other far outside.

    Parameters
    ----------
    contacts : on which it stands before the flight or after it; what is inside circles about them is left out
    ground : height over the centre of mass, m, in the posture ``y`` (n+1,)
    clearance : from the ground, m, at most half the height where the robot stands; of feet there is none
    """
    feet = list(chain.from_iterable(contact.spots for contact in contacts))
    directions = np.exp(2j * np.pi * np.arange(64) / 64)
    rotations = robot.tree.rotations(robot.tree.absolute_angles(y[0], y[1:]))
    spots = []
    least = []
    low = []
    touchdown = []
    for corners_of_group in _corners_alike(robot, contacts).values():
        if not corners_of_group:
            continue
        group = [spot for spot, _ in corners_of_group]
        downwards = (directions * rotations[group[0].body]).imag < 0
        chosen = _extreme_corners(group, directions, downwards)
        heights = undersides(robot, group, y) - ground
        for index in sorted(chosen):
            height = heights[index]
            spot, is_foot = corners_of_group[index]
            stands = any(foot.body == spot.body and abs(foot.place - spot.place) < SAME_POINT for foot in feet)
            if height > 5e-3 and not stands:  # m: what is no higher where the robot stands belongs to the feet
                usual = spot.radius + min(clearance, height / 2)
                spots.append(spot._replace(radius=0.0))
                least.append(spot.radius - POINT_FEET / 2 if is_foot else usual)
                low.append(chosen[index])
                touchdown.append(-np.inf if is_foot and near_contact(spot, feet) else usual)
    return ClearancePoints(tuple(spots), np.array(least), np.array(low, bool), np.array(touchdown))


def _corners_alike(robot: Robot, contacts: Sequence[GroundContact]) -> dict[tuple[float, ...], list[tuple[Spot, bool]]]:
    """Corners outside the circles of feet, and whether they are a foot's; grouped by how their bodies turn."""
    feet_links = links_of(robot, contacts)
    frames: dict[str, None] = {}
    circles = []
    for contact in contacts:
        frames.update(dict.fromkeys(contact.frames))
        radius = contact.depth + 1e-3  # m: feet are circles about their frames up to that
        circles += [(spot, radius) for spot in contact.spots]
    groups: dict[tuple[float, ...], list[tuple[Spot, bool]]] = {}
    for shape in robot.hulls(frames):
        for corner in corners([shape]):
            group = groups.setdefault(tuple(robot.tree.turns[corner.body].tolist()), [])
            is_inside = False
            for spot, radius in circles:
                if spot.body == corner.body and abs(corner.place - spot.place) + corner.radius <= radius:
                    is_inside = True
            if not is_inside:
                group.append((corner, shape.link in feet_links))
    return groups


def _extreme_corners(group: Sequence[Spot], directions: ComplexArray, downwards: BoolArray) -> dict[int, bool]:
    """Indices of corners beyond which no other is by 5 mm in any direction; whether one was chosen among those below.

    Directions that face ``downwards`` where the robot stands come first.
    """
    centers = np.array([corner.place for corner in group])
    radii = np.array([corner.radius for corner in group])
    reach = np.outer(directions.real, centers.real) + np.outer(directions.imag, centers.imag) + radii
    chosen = dict[int, bool]()
    for is_below in (True, False):
        facing = reach[downwards] if is_below else reach
        while True:
            beyond = facing.max(axis=1) - facing[:, [*chosen]].max(axis=1, initial=-np.inf)
            if beyond.max() <= 5e-3:
                break
            chosen[int(facing[beyond.argmax()].argmax())] = is_below
    return chosen


def near_contact(corner: Spot, feet: Sequence[Spot]) -> bool:
    """Whether a corner of a link that stands belongs to the foot itself, and not to the shank above it."""
    return any(foot.body == corner.body and abs(foot.place - corner.place) < HIGHEST for foot in feet)


def names_of(contacts: Iterable[GroundContact]) -> tuple[str, ...]:
    """Return the names of all points of contacts, by contact."""
    return tuple(chain.from_iterable(contact.names for contact in contacts))
