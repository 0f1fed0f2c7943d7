"""What a robot stands on: feet that are points, soles with heel and toe, and what has to stay above the ground."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray
from floatplan.errors import InputError
from floatplan.robot import LinkCapsule, Robot
from floatplan.stance.model import Spot, spot_weights
from floatplan.tables import POINT_FEET

SAME = 2e-3  # [m] by which places of left and right may differ
LEVEL = 0.02  # [m] by which feet that stand together may differ in the reference posture
SOLE = 0.05  # [m] a foot that is shorter is a point
HIGHEST = 0.1  # [m] over the ground, of the frame of such a foot that stands on it; others stand on their tips
FLAT = 5e-3  # [m] within which corners of a sole are on the ground
STANDING = 5e-3  # [m] what is no higher than that over the ground, in the standing posture, belongs to the feet
WAYS = 64  # [-] directions in which the hull is looked at
COARSE = 5e-3  # [m] by which a corner may be outside those that are watched
FITS = 1e-3  # [m] by which a foot may be no circle about its frame
ROLLED, ROLLS = np.pi / 3, 25  # [rad, -] by which a foot that rolls may turn either way, and where it is looked at
UNROUND = 0.25  # [-] of its radius, by which such a foot may be no circle
KNEE = 0.8  # [rad] by which a knee bends that would stand straight: legs are 8 % shorter, and can push
BENT = 0.2  # [-] sine of the angle between thigh and shank, below which a leg that stands counts as straight
NAMED, TIP = (".heel", ".toe"), ".tip"


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
        return self.suffix in NAMED

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


def heights_over_com(robot: Robot, spots: Sequence[Spot], y: Array) -> ComplexArray:
    """Places (.., points) relative to the centre of mass in postures y (n+1, ..), m: horizontal + i vertical."""
    turned, _ = np.split(spot_weights(robot, spots), 2, axis=1)
    return np.asarray((turned @ robot.tree.rotations(robot.tree.absolute_angles(y[0], y[1:].T)).T).T)


def way_between(robot: Robot, first: Spot, second: Spot, y: Array) -> tuple[float, float]:
    """From one spot to another in a posture y (n+1,), where what rolls would be at its body's angle 0, m."""
    angles, (one, two) = robot.tree.absolute_angles(y[0], y[1:]), spot_weights(robot, [first, second])
    way = (two - one) @ np.append(robot.tree.rotations(angles), angles)
    return float(way.real), float(way.imag)


def links_of(robot: Robot, contacts: Iterable[Contact]) -> set[str | None]:
    """Links on which contacts stand."""
    return {robot.contact_link(robot.frames[frame].link) for each in contacts for frame in each.frames}


def ground_below(robot: Robot, contact: Contact, y: Array) -> float:
    """Height of the ground on which a contact stands in a posture y (n+1,), over the centre of mass, m."""
    return float(heights_over_com(robot, contact.spots[:1], y)[0].imag - contact.depth)


def corners(shapes: Iterable[LinkCapsule]) -> list[Spot]:
    """Ends of shapes, with their radii."""
    return [Spot(each.body, end, each.radius) for each in shapes for end in (each.start, each.end)]


def undersides(robot: Robot, spots: Sequence[Spot], y: Array) -> Array:
    """Heights (.., spots) of the lowest points of circles, over the centre of mass in postures y (n+1, ..), m."""
    return np.asarray(heights_over_com(robot, spots, y).imag - [each.radius for each in spots])


def contact_at(robot: Robot, frame: str, y: Array) -> tuple[Contact, ...]:
    """Return the contact of a frame, a point; or toe and heel where its link has a sole.

    The point is the frame's origin; where that is high above the ground, the middle of the shape's lowest end, its tip.

    Parameters
    ----------
    frame : name of a link or joint
    y : (n+1,) rad, orientation and joints, of the posture in which soles are flat

    Raises
    ------
    InputError
        The frame is unknown, or high above the lowest point of its link where its body has a lower one.
    """
    if frame not in robot.frames:
        raise InputError(f'no frame "{frame}" is known', advice="name a link or a joint")
    home = robot.frames[frame]
    spot, ends = Spot(home.body, home.local), _ends(robot, frame)
    place = heights_over_com(robot, [spot], y)[0]
    if not ends:
        return (_contact(robot, frame, "", spot, 0.0),)
    found, under = heights_over_com(robot, ends, y), undersides(robot, ends, y)
    low = np.flatnonzero(under < under.min() + FLAT)
    rear, front = low[found.real[low].argmin()], low[found.real[low].argmax()]
    if found.real[front] - found.real[rear] <= SOLE:
        depth = float(place.imag - under.min())
        if depth <= HIGHEST:
            return (_contact(robot, frame, "", spot, depth),)
        _refuse_above(robot, frame, depth, y)
        middle = Spot(home.body, (ends[rear].place + ends[front].place) / 2)
        height = (found.imag[rear] + found.imag[front]) / 2
        return (_contact(robot, frame, TIP, middle, float(height - under.min())),)
    heel, toe = (
        _contact(robot, frame, name, ends[at]._replace(radius=0.0), float(found[at].imag - under.min()), vertical)
        for name, at, vertical in zip(NAMED, (rear, front), (True, False), strict=True)
    )
    return toe, heel


def _ends(robot: Robot, frame: str) -> list[Spot]:
    """Corners with which a frame's link stands on the ground."""
    link = robot.contact_link(robot.frames[frame].link)
    return [] if link is None else corners(robot.link_hulls[link])


def rolling(robot: Robot, contact: Contact, y: Array) -> Contact:
    """Return a contact on circles that roll, about its frames down to the ground, in a posture y (n+1,) that stands.

    Raises
    ------
    InputError
        The outline of a link, so far about what is lowest that it may roll, is no circle about its frame.
    """
    angles = robot.tree.absolute_angles(y[0], y[1:])
    for frame, spot in zip(contact.frames, contact.spots, strict=True):
        ways = np.exp(1j * np.linspace(-ROLLED, ROLLED, ROLLS)) * robot.tree.rotations(-angles)[spot.body] * -1j
        reach = np.zeros(ROLLS)
        for each in _ends(robot, frame):
            reach = np.maximum(reach, ((each.place - spot.place) * ways.conj()).real + each.radius)
        off = float(np.abs(reach - contact.depth).max())
        if contact.of_sole or not off < min(POINT_FEET, UNROUND * contact.depth):
            round_ = f"no circle about it, by {1e3 * off:.0f} mm" if contact.depth > 0 else "a point"
            reason = f"{frame!r} cannot roll: its link is {'a sole' if contact.of_sole else round_}"
            advice = 'name a frame at the centre of a round foot, or let feet = "point"'
            raise InputError(reason, advice=advice)
    return replace(contact, spots=tuple(each._replace(radius=contact.depth) for each in contact.spots))


def _refuse_above(robot: Robot, frame: str, depth: float, y: Array) -> None:
    """Refuse a frame that is high above the ground, where a link's on the same body is lower: it is the foot's."""
    home = robot.frames[frame]
    links = [name for name, each in robot.frames.items() if each.body == home.body and name == each.link]
    heights = heights_over_com(robot, [Spot(home.body, robot.frames[name].local) for name in links], y).imag
    lowest = links[int(heights.argmin())]
    if robot.frames[lowest].local != home.local:
        reason = f"{frame!r} is a point {1e3 * depth:.0f} mm above the lowest of its link"
        raise InputError(reason, advice=f"name a foot's frame, such as {lowest!r}")


def _contact(robot: Robot, frame: str, suffix: str, spot: Spot, depth: float, vertical: bool = False) -> Contact:
    twins = _twins(robot, frame, spot)
    return Contact((frame, *(name for name, _ in twins)), suffix, (spot, *(twin for _, twin in twins)), depth, vertical)


def _twins(robot: Robot, frame: str, spot: Spot) -> list[tuple[str, Spot]]:
    """Links on other bodies that move as the frame does, and the point of each that is where ``spot`` is.

    Of several on a body that is whose own shape has a corner nearest to the point.
    """
    tree, home = robot.tree, robot.frames[frame]
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

    def away(twin: tuple[str, Spot]) -> float:
        own = robot.link_hulls.get(robot.contact_link(twin[0]) or "", ())
        return min([abs(corner.place - twin[1].place) for corner in corners(own)], default=np.inf)

    return [min(twins, key=away) for twins in found.values()]


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
    heights = {link: undersides(robot, corners(hull), y).min() for link, hull in robot.link_hulls.items() if hull}
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
    tree, legs = robot.tree, list[_Leg]()
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
    tree, bent = robot.tree, y.copy()
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

    Those that are ``low`` (P,) do for bodies that have not turned to one side since they stood.
    """

    spots: tuple[Spot, ...]
    least: Array
    low: BoolArray


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
    spots, least, low = [], [], []
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
            above, (spot, is_foot) = heights[index], members[index]
            stands = any(foot.body == spot.body and abs(foot.place - spot.place) < SAME for foot in feet)
            if above > STANDING and not stands:
                spots.append(spot._replace(radius=0.0))
                least.append(spot.radius + (-POINT_FEET / 2 if is_foot else min(room, above / 2)))
                low.append(farthest[index])
    return Watched(tuple(spots), np.array(least), np.array(low, bool))
