"""Points of a robot on which it can stand: feet that are points, ends of soles, tips of limbs; and circles that roll.

Positions are complex numbers, horizontal + i vertical, m.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.robot.robot import LinkCapsule, Robot
from floatplan.tables import POINT_FEET

SOLE = 0.05  # [m] a foot that is shorter is a point
HIGHEST = 0.1  # [m] over the ground, of the frame of such a foot that stands on it; others stand on their tips
FLAT = 5e-3  # [m] within which corners of a sole, or points of a foot's shape, are on the ground
ROLLED = np.pi / 3  # [rad] by which a foot that rolls may rotate either way
HEEL = ".heel"  # suffixes of points that have no frames of their own
TOE = ".toe"
TIP = ".tip"
SOLE_ENDS = (HEEL, TOE)


class Spot(NamedTuple):
    """A position on a body.

    Attributes
    ----------
    body : int
    place : in the body's frame, m
    radius : of the circle about it that rolls on the ground, m; 0 for a point
    """

    body: int
    place: complex
    radius: float = 0.0


class StandingPoint(NamedTuple):
    """A point of a link on which a robot can stand.

    Attributes
    ----------
    suffix : ".heel" or ".toe" for an end of a sole, ".tip" for that of a limb; "" for the frame's origin
    spot : the point
    depth : its height over the ground where it stands, m
    """

    suffix: str
    spot: Spot
    depth: float


def spot_weights(robot: Robot, spots: Sequence[Spot]) -> ComplexArray:
    """Weights (points, 2 m) of positions relative to the centre of mass: W of rotations e, then rho of angles, m."""
    bodies = np.array([spot.body for spot in spots])
    local = np.array([spot.place for spot in spots], np.complex128)
    of_angles = np.zeros((len(bodies), len(robot.tree.mass)))
    of_angles[np.arange(len(bodies)), bodies] = robot.tree.turn * np.array([spot.radius for spot in spots])
    return np.concatenate((robot.tree.point_weights(bodies, local), of_angles), axis=1)


def positions_from_com(robot: Robot, spots: Sequence[Spot], y: Array) -> ComplexArray:
    """Positions (.., points) relative to the centre of mass in postures y (n+1, ..), m: horizontal + i vertical."""
    weights, _ = np.split(spot_weights(robot, spots), 2, axis=1)
    return np.asarray((weights @ robot.tree.rotations(robot.tree.absolute_angles(y[0], y[1:].T)).T).T)


def corners(shapes: Iterable[LinkCapsule]) -> list[Spot]:
    """Ends of shapes, with their radii."""
    spots = []
    for shape in shapes:
        spots += [Spot(shape.body, shape.start, shape.radius), Spot(shape.body, shape.end, shape.radius)]
    return spots


def undersides(robot: Robot, spots: Sequence[Spot], y: Array) -> Array:
    """Heights (.., spots) of the lowest points of circles, over the centre of mass in postures y (n+1, ..), m."""
    return np.asarray(positions_from_com(robot, spots, y).imag - [spot.radius for spot in spots])


def link_corners(robot: Robot, frame: str) -> list[Spot]:
    """Corners with which a frame's link stands on the ground; none where it has no shape."""
    link = robot.contact_link(robot.frames[frame].link)
    return [] if link is None else corners(robot.link_hulls[link])


def standing_points(robot: Robot, frame: str, y: Array) -> tuple[StandingPoint, ...]:
    """Return the points on which a frame's link stands: the frame's origin; or toe and heel where it has a sole.

    Where that origin is high above the ground or below it, it is the middle of the shape's lowest end, its tip, as of a
    ball; and where the link has no geometry, so that it is a line from there to its end. A wheel about its frame
    stands on that whatever its radius.

    Parameters
    ----------
    frame : name of a link or joint
    y : (n+1,) rad, orientation and joints, of the posture in which soles are flat

    Raises
    ------
    InputError
        The frame does not exist, or is high above the lowest point of its link where its body has a lower one.
    """
    if frame not in robot.frames:
        raise InputError(f'no frame "{frame}" is known', advice="name a link or a joint")
    home = robot.frames[frame]
    origin = Spot(home.body, home.local)
    ends = link_corners(robot, frame)
    if not ends:
        return (StandingPoint("", origin, 0.0),)
    positions = positions_from_com(robot, ends, y)
    under = undersides(robot, ends, y)
    ground = float(under.min())
    depth = float(positions_from_com(robot, [origin], y)[0].imag - ground)
    if may_roll(out_of_round(robot, frame, origin, depth, y), depth):  # large wheels are flat as soles, nearly
        return (StandingPoint("", origin, depth),)
    low = np.flatnonzero(under < ground + FLAT)
    rear = low[positions.real[low].argmin()]
    front = low[positions.real[low].argmax()]
    if positions.real[front] - positions.real[rear] > SOLE:
        toe = StandingPoint(TOE, ends[front]._replace(radius=0.0), float(positions.imag[front] - ground))
        heel = StandingPoint(HEEL, ends[rear]._replace(radius=0.0), float(positions.imag[rear] - ground))
        return toe, heel
    link = robot.contact_link(home.link)
    is_line = link is not None and not robot.joint_tree.links[link].collisions
    if -POINT_FEET <= depth <= (POINT_FEET if is_line else HIGHEST):
        return (StandingPoint("", origin, depth),)
    if depth > HIGHEST:
        _refuse_above(robot, frame, depth, y)
    middle = Spot(home.body, (ends[rear].place + ends[front].place) / 2)
    height = (positions.imag[rear] + positions.imag[front]) / 2
    return (StandingPoint(TIP, middle, float(height - ground)),)


def _refuse_above(robot: Robot, frame: str, depth: float, y: Array) -> None:
    """Refuse a frame that is high above the ground, where a link's on the same body is lower: it is the foot's."""
    home = robot.frames[frame]
    links = [name for name, frame in robot.frames.items() if frame.body == home.body and name == frame.link]
    spots = [Spot(home.body, robot.frames[name].local) for name in links]
    heights = positions_from_com(robot, spots, y).imag
    lowest = links[int(heights.argmin())]
    if robot.frames[lowest].local != home.local:
        reason = f"{frame!r} is a point {1e3 * depth:.0f} mm above the lowest of its link"
        raise InputError(reason, advice=f"name a foot's frame, such as {lowest!r}")


def out_of_round(robot: Robot, frame: str, spot: Spot, depth: float, y: Array) -> float:
    """By how much, m, a link's outline is no circle of radius ``depth`` about a spot, where the link may roll.

    That is so far about its lowest point in a posture y (n+1,) that stands.
    """
    angles = robot.tree.absolute_angles(y[0], y[1:])
    # 25 directions around the one downwards: 5 degrees apart
    directions = np.exp(1j * np.linspace(-ROLLED, ROLLED, 25)) * robot.tree.rotations(-angles)[spot.body] * -1j
    reach = np.zeros(len(directions))
    for corner in link_corners(robot, frame):
        reach = np.maximum(reach, ((corner.place - spot.place) * directions.conj()).real + corner.radius)
    return float(np.abs(reach - depth).max())


def may_roll(off: float, depth: float) -> bool:
    """Whether an outline that is out of round by ``off``, m, on a circle of radius ``depth``, m, rolls like it."""
    return off < min(POINT_FEET, 0.25 * depth)  # a quarter of the radius: then it is no wheel but a sole
