"""What a robot stands on: feet that are points, soles with heel and toe, and what has to stay above the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.robot import Frame, Robot
from floatplan.stance.model import Spot
from floatplan.tables import POINT_FEET

SAME = 2e-3  # [m] by which places of left and right may differ
LEVEL = 0.02  # [m] by which feet that stand together may differ in the reference posture
SOLE = 0.05  # [m] a foot that is shorter is a point
HIGHEST = 0.1  # [m] over the ground, of the frame of such a foot
FLAT = 5e-3  # [m] within which corners of a sole are on the ground
STANDING = 5e-3  # [m] what is no higher than that over the ground, in the standing posture, belongs to the feet
WAYS = 64  # [-] directions in which the hull is looked at
COARSE = 5e-3  # [m] by which a corner may be outside those that are watched
FITS = 1e-3  # [m] by which a foot may be no circle about its frame
NAMED = (".heel", ".toe")


@dataclass(frozen=True)
class Contact:
    """A point that the robot can stand on, with those that are coupled to it, left and right.

    Attributes
    ----------
    frames : the frame, then its followers'
    suffix : ".heel" or ".toe" for an end of a sole, which has no frame of its own; else nothing
    spots : the points, in the order of the frames
    depth : its height over the ground where it stands, m
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
    def frame(self) -> str:
        """The first frame."""
        return self.frames[0]

    @property
    def name(self) -> str:
        """The first point's name."""
        return self.frame + self.suffix


def heights_over_com(robot: Robot, spots: Sequence[Spot], y: Array) -> ComplexArray:
    """Places (points,) relative to the centre of mass in a posture y (n+1,), m: horizontal + i vertical."""
    tree = robot.tree
    angles = tree.absolute_angles(y[0], y[1:])
    bodies, local = np.array([body for body, _ in spots]), np.array([place for _, place in spots], np.complex128)
    return np.asarray(tree.point_weights(bodies, local) @ tree.rotations(angles))


def contact_at(robot: Robot, frame: str, y: Array) -> tuple[Contact, ...]:
    """Return the contact of a frame, a point; or toe and heel where its link has a sole.

    Parameters
    ----------
    frame : name of a link or joint
    y : (n+1,) rad, orientation and joints, of the posture in which soles are flat

    Raises
    ------
    InputError
        The frame is unknown, or high above the lowest point of its link.
    """
    if frame not in robot.frames:
        raise InputError(f'no frame "{frame}" is known', advice="name a link or a joint")
    home = robot.frames[frame]
    link = robot.contact_link(home.link)
    shapes = [] if link is None else robot.link_hulls[link]
    corners = [(each.body, end, each.radius) for each in shapes for end in (each.start, each.end)]
    place = heights_over_com(robot, [(home.body, home.local)], y)[0]
    if not corners:
        return (_contact(robot, frame, "", (home.body, home.local), 0.0),)
    found = heights_over_com(robot, [corner[:2] for corner in corners], y)
    under = found.imag - [corner[2] for corner in corners]
    low = np.flatnonzero(under < under.min() + FLAT)
    rear, front = low[found.real[low].argmin()], low[found.real[low].argmax()]
    if found.real[front] - found.real[rear] <= SOLE:
        depth = float(place.imag - under.min())
        if depth > HIGHEST:
            reason = f"{frame!r} is a point {1e3 * depth:.0f} mm above the lowest of its link"
            raise InputError(reason, advice=_lower(robot, home, y))
        return (_contact(robot, frame, "", (home.body, home.local), depth),)
    ends = zip(NAMED, (rear, front), (True, False), strict=True)
    heel, toe = (
        _contact(robot, frame, name, corners[at][:2], float(found[at].imag - under.min()), vertical)
        for name, at, vertical in ends
    )
    return toe, heel


def _lower(robot: Robot, home: Frame, y: Array) -> str:
    """Which frame to name in the place of one that is high above the ground: a link's, lower on the same body."""
    links = [name for name, each in robot.frames.items() if each.body == home.body and name == each.link]
    heights = heights_over_com(robot, [(home.body, robot.frames[name].local) for name in links], y).imag
    lowest = links[int(heights.argmin())]
    return "name a foot's frame" + (f", such as {lowest!r}" if robot.frames[lowest].local != home.local else "")


def _contact(robot: Robot, frame: str, suffix: str, spot: Spot, depth: float, vertical: bool = False) -> Contact:
    twins = _twins(robot, frame, spot)
    return Contact((frame, *(name for name, _ in twins)), suffix, (spot, *(twin for _, twin in twins)), depth, vertical)


def _twins(robot: Robot, frame: str, spot: Spot) -> list[tuple[str, Spot]]:
    """Links on other bodies that move as the frame does, and the point of each that is where ``spot`` is."""
    tree, home = robot.tree, robot.frames[frame]
    alike = [
        (name, each)
        for name, each in robot.frames.items()
        if name == each.link and each.body != home.body and (tree.turns[each.body] == tree.turns[home.body]).all()
    ]
    found: dict[int, tuple[str, Spot]] = {}
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 1 + len(robot.joints)))
    for name, each in alike:
        pair = [heights_over_com(robot, [(home.body, home.local), (each.body, each.local)], q) for q in postures]
        turned = np.exp(1j * tree.turn * (tree.offsets[home.body] - tree.offsets[each.body]))
        if max(abs(first - second) for first, second in pair) < SAME:
            found.setdefault(each.body, (name, (each.body, each.local + (spot[1] - home.local) * turned)))
    return list(found.values())


def standing_feet(robot: Robot, frame: str, y: Array) -> list[str]:
    """Return the frames on which the robot stands beside ``frame``, and itself, the rearmost first.

    They are the limbs' ends that reach as low as it does in the posture ``y`` (n+1,).
    """
    home = robot.frames[frame]
    heights = {link: _lowest(robot, link, y) for link in robot.limb_ends}
    own = min([height for link, height in heights.items() if robot.layout.body_of[link] == home.body], default=None)
    chosen = {tuple(robot.tree.turns[home.body].tolist()): frame}
    for link in sorted(heights, key=lambda link: heights[link]):
        if own is not None and heights[link] < own + LEVEL:
            chosen.setdefault(tuple(robot.tree.turns[robot.frames[link].body].tolist()), link)
    places = {
        each: heights_over_com(robot, [(robot.frames[each].body, robot.frames[each].local)], y)[0].real
        for each in chosen.values()
    }
    return sorted(places, key=lambda each: places[each])


def in_the_air(robot: Robot, contacts: Sequence[Contact], y: Array, most: float = LEVEL) -> str:
    """Which contact is above the ground, by more than ``most``, m, in a posture y (n+1,); for a person."""
    heights = {link: _lowest(robot, link, y) for link, hull in robot.link_hulls.items() if hull}
    if not heights:
        return ""
    lowest = min(heights, key=lambda link: heights[link])
    for contact in contacts:
        above = heights_over_com(robot, contact.spots[:1], y)[0].imag - contact.depth - heights[lowest]
        if above > most:
            return f"{contact.name!r} is in the air: {lowest!r} is {1e3 * above:.0f} mm lower"
    return ""


def _lowest(robot: Robot, link: str, y: Array) -> float:
    shapes = robot.link_hulls[link]
    spots = [(each.body, end) for each in shapes for end in (each.start, each.end)]
    radii = np.repeat([each.radius for each in shapes], 2)
    return float((heights_over_com(robot, spots, y).imag - radii).min())


@dataclass(frozen=True)
class Watched:
    """Points that stay above the ground: places on bodies, and the heights (P,) m of their centres at least."""

    spots: tuple[Spot, ...]
    least: Array


def watched_points(robot: Robot, contacts: Sequence[Contact], ground: float, y: Array, room: float) -> Watched:
    """Return corners of the robot's hull, body by body but for its feet, as few as leave no other far outside.

    Parameters
    ----------
    contacts : on which it stands before the flight or after it; what is inside circles about them is not watched
    ground : height over the centre of mass, m, in the posture ``y`` (n+1,)
    room : kept from the ground, m, or half the height where the robot stands; of feet nothing is
    """
    feet = [spot for each in contacts for spot in each.spots]
    feet_links = {robot.contact_link(robot.frames[frame].link) for each in contacts for frame in each.frames}
    kept: dict[tuple[float, ...], list[tuple[Spot, float, bool]]] = {}
    for shape in robot.hulls({frame for each in contacts for frame in each.frames}):
        group = kept.setdefault(tuple(robot.tree.turns[shape.body].tolist()), [])
        own = [(spot[1], each.depth) for each in contacts for spot in each.spots if spot[0] == shape.body]
        group += [
            ((shape.body, end), shape.radius, shape.link in feet_links)
            for end in (shape.start, shape.end)
            if all(abs(end - place) + shape.radius > depth + FITS for place, depth in own)
        ]
    spots, least = [], []
    ways = np.exp(2j * np.pi * np.arange(WAYS) / WAYS)
    for members in filter(None, kept.values()):
        places = np.array([member[0][1] for member in members])
        radii = np.array([member[1] for member in members])
        reach = np.outer(ways.real, places.real) + np.outer(ways.imag, places.imag) + radii
        farthest, missing = set[int](), reach.max(axis=1)
        while missing.max() > COARSE:
            farthest.add(int(reach[missing.argmax()].argmax()))
            missing = reach.max(axis=1) - reach[:, sorted(farthest)].max(axis=1)
        heights = heights_over_com(robot, [member[0] for member in members], y).imag - ground
        for index in sorted(farthest):
            above = heights[index] - radii[index]
            stands = any(body == members[index][0][0] and abs(place - places[index]) < SAME for body, place in feet)
            if above > STANDING and not stands:
                spots.append(members[index][0])
                least.append(radii[index] + (-POINT_FEET / 2 if members[index][2] else min(room, above / 2)))
    return Watched(tuple(spots), np.array(least))
