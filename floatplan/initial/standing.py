"""The posture in which a robot stands before its first jump: the file's own, or one that is looked for.

A posture to jump from has its feet on level ground and nothing lower, the centre of mass over them, and legs that are
neither straight nor folded, so that they can push. Where the file's reference posture is no such one, that is sought
which is least in the sum of squares of

- how far the feet are from one height, and soles from being flat,
- how far the centre of mass is from over the middle of the feet, and the feet from below their hips,
- how far knees are from a usual bend, to one side or the other,
- how near joints are to the ends of their ranges, and links to the ground,
- how far joints are from where the reference posture has them, lightly,

each over what it may be off. The base is level. It is a problem of few numbers with several minima: it is solved from
seeded starts for either side of the knees, and the least one that stands is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.initial.legs import Leg
from floatplan.jumps.contacts import BENT, GroundContact, contact_at, in_the_air
from floatplan.jumps.phases import not_static, standing_posture
from floatplan.robot import LinkCapsule, Robot
from floatplan.robot.standing import Spot, corners, spot_weights

# What each term may be off, where lengths are over that of the longest leg.
LEVEL = 1e-3  # [-] of the feet's heights, and of both ends of a sole
OVER = 0.01  # [-] of the centre of mass from the middle of the feet
UNDER_HIP = 0.3  # [-] of a foot from below its hip
USUAL_BEND, BEND_OFF = 1.0, 0.5  # [rad] of a knee: quadrupeds stand at 1.5, humanoids that crouch at 0.6
FROM_END = (0.2, 0.1)  # [-, rad] of its range, and what is at most kept from the ends of it
CLEAR = 0.05  # [-] of links above the ground
FROM_REFERENCE = 3.0  # [rad] of joints
NEAR = 0.35  # [rad] of joints from the reference posture, where the static one next to it counts as the same
LYING = 0.25  # [-] of a leg's length: what its hip is not over the foot by, in a leg that lies rather than stands
STARTS = 4  # [-] for each side of the knees, of which the first is the reference posture
PREFERRED = 0.5  # [-] of the least sum so far is less: knees bend to the usual side unless another is that much better
ANGLE_DIGITS = 3  # [-] of degrees in the posture, as it is written
FAR = 0.1  # [m] above what is lowest: no foot stands there
ROOM = 0.1  # [rad] that a posture keeps from the ends of ranges, as stances do


@dataclass(frozen=True, eq=False)
class Standing:
    """The posture from which a robot jumps.

    Attributes
    ----------
    positions : (n,) rad, of the planned joints
    own : whether it is another than the reference posture
    sought : why the reference posture is none to jump from; empty where none was looked for
    """

    positions: Array
    own: bool = False
    sought: str = ""


def standing(robot: Robot, feet: Sequence[str], limits: Array, given: Mapping[int, float] | None = None) -> Standing:
    """Return the posture in which a robot stands on its feet before a jump.

    That is the reference posture, or the static one next to it, where its legs can push off from there; else one that
    is looked for; else the reference posture all the same, for a search that says what stands in the way.

    Parameters
    ----------
    robot : Robot
    feet : frames, one for each leg that moves on its own
    limits : (n, 2) rad, ranges of the planned joints
    given : positions, rad, of planned joints by index, which are kept
    """
    given = given or {}
    reference = robot.resting.copy()
    reference[list(given)] = _round_positions(np.array(list(given.values())))
    if not feet or any(robot.frames[foot].body == 0 for foot in feet) or not robot.link_hulls:
        return Standing(_written(reference, given), own=bool(given))
    fault = posture_fault(robot, feet, reference, limits)
    if not fault or len(given) == len(reference):
        return Standing(_written(reference, given), own=bool(given), sought=fault)
    found = sought_posture(robot, feet, reference, limits, tuple(given))
    if found is None:
        return Standing(_written(reference, given), own=bool(given), sought=fault)
    return Standing(found, own=True, sought=fault)


def _round_positions(positions: Array) -> Array:
    """Positions (n,), rad, as they are written: round numbers of degrees."""
    return np.deg2rad(np.round(np.rad2deg(positions), ANGLE_DIGITS))


def _written(reference: Array, given: Mapping[int, float]) -> Array:
    """The reference posture (n,) rad as it is; where some of it is given, all is written, in round numbers."""
    return _round_positions(reference) if given else reference


def posture_fault(robot: Robot, feet: Sequence[str], positions: Array, limits: Array) -> str:
    """Return why a robot cannot jump from a posture (n,) rad, or the static one next to it; empty where it can."""
    y = np.append(0.0, positions)
    try:
        contacts = [contact for foot in feet for contact in contact_at(robot, foot, y)]
    except InputError as error:  # a frame on which nothing stands in this posture
        return error.reason
    floating = in_the_air(robot, contacts, y, FAR)
    if floating:
        return floating
    static = standing_posture(robot, contacts, y, _bounds(limits))
    if static is None or np.abs(static - y).max() > NEAR:
        return not_static(robot, contacts, y)
    return in_the_air(robot, contacts, static) or _stretched(robot, feet, positions, static)


def _bounds(limits: Array) -> Array:
    """Bounds (n+1, 2) rad of a posture: the base level, joints with some room in their ranges."""
    room = np.minimum(ROOM, np.ptp(limits, axis=1) / 4)
    return np.vstack(([0.0, 0.0], limits + np.stack((room, -room), axis=1)))


def _stretched(robot: Robot, feet: Sequence[str], reference: Array, y: Array) -> str:
    """Say which leg is straight, folded or lies in a posture y (n+1,), if any does."""
    for foot in feet:
        leg = Leg(robot, foot, reference)
        if not leg.has_knee:
            continue
        bend = leg.bend(y)
        if abs(np.sin(bend)) <= BENT:
            return f"the leg of {foot!r} is {'straight' if abs(bend) < np.pi / 2 else 'folded'}"
        if leg.height(y) < LYING * leg.length:
            return f"the leg of {foot!r} lies"
    return ""


def sought_posture(
    robot: Robot, feet: Sequence[str], reference: Array, limits: Array, kept: Sequence[int] = ()
) -> Array | None:
    """Return positions (n,) rad of the best posture to jump from, see the head of this module; None if none stands.

    Parameters
    ----------
    robot : Robot
    feet : frames
    reference : (n,) rad
    limits : (n, 2) rad
    kept : indices of joints that stay where the reference has them
    """
    legs = [Leg(robot, foot, reference) for foot in feet]
    low, high = _bounds(limits)[1:].T
    free = np.setdiff1d(np.arange(len(reference)), kept)
    best, least = None, np.inf
    for sides in _sides(legs, reference):
        objective = _Objective(robot, legs, sides, reference, limits)
        for start in _starts(reference, low, high):

            def residuals(part: Array, start: Array = start, objective: _Objective = objective) -> Array:
                positions = reference.copy()
                positions[free] = part
                return objective.residuals(positions)

            if not free.size:
                break
            found = least_squares(residuals, start[free], bounds=(low[free] - 1e-9, high[free] + 1e-9), max_nfev=100)
            if found.cost > PREFERRED * least:
                continue
            positions = reference.copy()
            positions[free] = found.x
            posture = _rounded(robot, feet, positions, limits)
            if posture is not None and np.allclose(posture[list(kept)], reference[list(kept)], atol=1e-4):
                best, least = posture, found.cost
    return best


def _rounded(robot: Robot, feet: Sequence[str], positions: Array, limits: Array) -> Array | None:
    """The static posture next to one, in round numbers of degrees; None where it is none to jump from."""
    y = np.append(0.0, positions)
    try:
        contacts: list[GroundContact] = [contact for foot in feet for contact in contact_at(robot, foot, y)]
    except InputError:
        return None
    static = standing_posture(robot, contacts, y, _bounds(limits))
    if static is None:
        return None
    posture = _round_positions(static[1:])
    return None if posture_fault(robot, feet, posture, limits) else posture


def _sides(legs: Sequence[Leg], reference: Array) -> list[tuple[float, ...]]:
    """To which side knees bend, +1 counterclockwise in the plane, 0 of legs without one: the usual side first.

    Knees that are bent in the reference posture stay bent to that side. Else quadrupeds' legs open forwards and
    bipeds' backwards, unless ranges or the search say otherwise.
    """
    usual = -1.0 if len(legs) == 1 else 1.0
    ways: list[tuple[float, ...]] = []
    for leg in legs:
        bend = leg.bend(np.append(0.0, reference)) if leg.has_knee else 0.0
        known = abs(np.sin(bend)) > BENT
        ways.append((0.0,) if not leg.has_knee else (float(np.sign(bend)),) if known else (usual, -usual))
    other = [tuple(-each for each in side) for side in ways]
    asked = list(product(*ways))
    even = sorted(asked, key=lambda sides: len(set(sides)))  # all legs alike before others
    return even + [sides for sides in product(*other) if sides not in asked]


def _starts(reference: Array, low: Array, high: Array) -> list[Array]:
    """Postures (n,) rad from which one is looked for: the reference, and seeded ones in the ranges."""
    near, far = np.maximum(low, reference - np.pi / 2), np.minimum(high, reference + np.pi / 2)
    drawn = np.random.default_rng(0).uniform(np.minimum(near, high), np.maximum(far, low), (STARTS - 1, len(low)))
    return [np.clip(each, low, high) for each in (reference, *drawn)]


class _Objective:
    """The terms of which a posture to jump from is the least sum of squares, with legs bent to given sides."""

    def __init__(
        self, robot: Robot, legs: Sequence[Leg], sides: Sequence[float], reference: Array, limits: Array
    ) -> None:
        self.robot, self.legs, self.reference = robot, legs, reference
        self.sides = np.array([side for side in sides if side])
        self.low, self.high = limits.T
        width = self.high - self.low
        self.from_end = np.where(np.isfinite(width), np.minimum(FROM_END[0] * width, FROM_END[1] + ROOM), ROOM)
        self.supports = [leg.support for leg in legs]
        self.bends = [leg.bend_spots for leg in legs if leg.has_knee]
        self.hips = [Spot(leg.bodies[0], 0j) for leg in legs]
        self.others = self._others()
        groups = [*self.supports, *self.bends, self.hips, *self.others]
        self.ends = np.cumsum([len(group) for group in groups])[:-1]
        spots = [spot for group in groups for spot in group]
        self.radii = np.array([spot.radius for spot in spots])
        self.weights = np.split(spot_weights(robot, spots), 2, axis=1)[0]
        self.unit = max(leg.length for leg in legs)

    def _others(self) -> list[list[Spot]]:
        """Corners of what does not stand, of each group of links that turn as one."""
        turns = [tuple(row) for row in self.robot.tree.turns.tolist()]
        feet = {turns[self.robot.frames[leg.foot].body] for leg in self.legs}
        groups: dict[tuple[float, ...], list[LinkCapsule]] = {}
        for shape in self.robot.hulls([leg.foot for leg in self.legs]):
            if turns[shape.body] not in feet:
                groups.setdefault(turns[shape.body], []).append(shape)
        return [corners(shapes) for shapes in groups.values()]

    def residuals(self, positions: Array) -> Array:
        """Terms (K,) in a posture (n,) rad: each over what it may be off."""
        tree = self.robot.tree
        rotations = tree.rotations(tree.absolute_angles(np.array(0.0), positions))
        places = self.weights @ rotations / self.unit
        under = places.imag - self.radii / self.unit
        legs, bends = len(self.legs), len(self.bends)
        split = np.split(places, self.ends)
        below = np.split(under, self.ends)
        stands, knees, hips = split[:legs], split[legs : legs + bends], split[legs + bends]
        lowest = np.array([each.min() for each in below[:legs]])
        soles = [each[1] - each[0] for each, leg in zip(below[:legs], self.legs, strict=True) if leg.sole]
        ground = lowest.mean()
        ways = [self._on_ground(*pair) for pair in zip(stands, below[:legs], self.legs, strict=True)]
        feet = np.array([(rear + front) / 2 for rear, front in ways])
        middle = (min(rear for rear, _ in ways) + max(front for _, front in ways)) / 2
        bent = np.array([np.angle((end - knee) / (knee - hip)) for hip, knee, end in knees])
        apart = np.minimum(positions - self.low, self.high - positions)
        heights = np.array([each.min() for each in below[legs + bends + 1 :]]) - ground
        return np.concatenate(
            (
                (lowest - ground) / LEVEL,
                np.array(soles) / LEVEL,
                [middle / OVER],
                (feet - hips.real) / UNDER_HIP,
                (np.mod(self.sides * bent + np.pi / 2, 2 * np.pi) - np.pi / 2 - USUAL_BEND) / BEND_OFF,
                np.maximum(0.0, self.from_end - apart) / ROOM,
                np.maximum(0.0, CLEAR - heights) / CLEAR,
                (positions - self.reference) / FROM_REFERENCE,
            )
        )

    @staticmethod
    def _on_ground(places: ComplexArray, below: Array, leg: Leg) -> tuple[float, float]:
        """Both ends of what a foot stands on, from under the centre of mass: of a sole those, else what is lowest."""
        if leg.sole:
            return float(places.real.min()), float(places.real.max())
        at = float(places.real[int(below.argmin())])
        return at, at
