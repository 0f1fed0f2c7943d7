"""The posture in which a robot stands before its first jump: the file's own, or one that is searched for.

A posture to jump from has its feet on level ground and nothing lower, the centre of mass over them, and legs that are
neither straight nor folded, so that they can push. Where the file's reference posture is no such one, the sum of
squares is minimised of

- how far the feet are from one height, and soles from being flat,
- how far the centre of mass is from over the middle of the feet, and the feet from below their hips,
- how far knees are from a usual bend, to one side or the other,
- how near joints are to the ends of their ranges, and links to the ground,
- how far joints are from where the reference posture has them, lightly,

each over its tolerance. The base is level. It is a problem of few numbers with several minima: it is solved from
seeded starts for either side of the knees, and the least one that stands is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
from scipy.optimize import least_squares

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.initial.legs import Leg
from floatplan.jumps.contacts import BENT, GroundContact, contact_at, in_the_air
from floatplan.jumps.phases import not_static, standing_posture
from floatplan.robot import LinkCapsule, Robot
from floatplan.robot.standing import Spot, corners, spot_weights

RANGE_MARGIN = 0.1  # [rad] of a posture from the ends of joint ranges, as of stances


@dataclass(frozen=True)
class StandingTolerances:
    """What each term may be off; lengths are over that of the longest leg.

    Attributes
    ----------
    level : of the feet's heights, and of both ends of a sole
    over : of the centre of mass from the middle of the feet
    under_hip : of a foot from below its hip
    usual_bend, bend : of a knee, rad: quadrupeds stand at 1.5, humanoids that crouch at 0.6
    range_share : of a joint's range, the margin from its ends at most
    clearance : of links above the ground
    reference : of joints from the reference posture, rad
    """

    level: float = 1e-3
    over: float = 0.01
    under_hip: float = 0.3
    usual_bend: float = 1.0
    bend: float = 0.5
    range_share: float = 0.2
    clearance: float = 0.05
    reference: float = 3.0


TOLERANCES = StandingTolerances()


@dataclass(frozen=True, eq=False)
class Standing:
    """The posture from which a robot jumps.

    Attributes
    ----------
    positions : (n,) rad, of the planned joints
    own : whether it is another than the reference posture
    fault : why the reference posture is none to jump from; empty where none was searched for
    """

    positions: Array
    own: bool = False
    fault: str = ""


def standing(robot: Robot, feet: Sequence[str], limits: Array, fixed: Mapping[int, float] | None = None) -> Standing:
    """Return the posture in which a robot stands on its feet before a jump.

    That is the reference posture, or the static one next to it, where its legs can push off from there; else one that
    is searched for; else the reference posture all the same, for a search that explains what is wrong.

    Parameters
    ----------
    robot : Robot
    feet : frames, one for each leg that moves on its own
    limits : (n, 2) rad, ranges of the planned joints
    fixed : positions, rad, of planned joints by index, which stay
    """
    fixed = fixed or {}
    reference = robot.resting.copy()
    reference[list(fixed)] = _round_positions(np.array(list(fixed.values())))
    written = _round_positions(reference) if fixed else reference
    if not has_legs(robot, feet):
        return Standing(written, own=bool(fixed))
    fault = posture_fault(robot, feet, reference, limits)
    posture = None
    if fault and len(fixed) < len(reference):
        posture = best_posture(robot, feet, reference, limits, tuple(fixed))
    if posture is None:
        return Standing(written, own=bool(fixed), fault=fault)
    return Standing(posture, own=True, fault=fault)


def has_legs(robot: Robot, feet: Sequence[str]) -> bool:
    """Return whether there are legs between a robot's base and its feet, and shapes that tell where these stand."""
    return bool(feet) and all(robot.frames[foot].body != 0 for foot in feet) and bool(robot.link_hulls)


def _round_positions(positions: Array) -> Array:
    """Positions (n,), rad, as they are written: thousandths of degrees."""
    return np.deg2rad(np.round(np.rad2deg(positions), 3))


def posture_fault(robot: Robot, feet: Sequence[str], positions: Array, limits: Array) -> str:
    """Return why a robot cannot jump from a posture (n,) rad, or the static one next to it; empty where it can."""
    y = np.append(0.0, positions)
    try:
        contacts = _contacts(robot, feet, y)
    except InputError as error:  # a frame on which nothing stands in this posture
        return error.reason
    floating = in_the_air(robot, contacts, y, most=0.1)  # m: what is farther up is no foot
    if floating:
        return floating
    static = standing_posture(robot, contacts, y, _bounds(limits))
    if static is None or np.abs(static - y).max() > 0.35:  # rad: one that is nearer counts as the same
        return not_static(robot, contacts, y)
    return in_the_air(robot, contacts, static) or _stretched(robot, feet, positions, static)


def _contacts(robot: Robot, feet: Sequence[str], y: Array) -> list[GroundContact]:
    contacts: list[GroundContact] = []
    for foot in feet:
        contacts += contact_at(robot, foot, y)
    return contacts


def _bounds(limits: Array) -> Array:
    """Bounds (n+1, 2) rad of a posture: the base level, joints with some margin in their ranges."""
    margins = np.minimum(RANGE_MARGIN, np.ptp(limits, axis=1) / 4)
    return np.vstack(([0.0, 0.0], limits + np.stack((margins, -margins), axis=1)))


def _stretched(robot: Robot, feet: Sequence[str], reference: Array, y: Array) -> str:
    """Say which leg is straight, folded or lies in a posture y (n+1,), if any does."""
    lying = 0.25  # of a leg's length: a hip that is less over the foot is that of a leg that lies
    for foot in feet:
        leg = Leg(robot, foot, reference)
        if not leg.has_knee:
            continue
        bend = leg.bend(y)
        if abs(np.sin(bend)) <= BENT:
            return f"the leg of {foot!r} is {'straight' if abs(bend) < np.pi / 2 else 'folded'}"
        if leg.height(y) < lying * leg.length:
            return f"the leg of {foot!r} lies"
    return ""


def best_posture(
    robot: Robot, feet: Sequence[str], reference: Array, limits: Array, fixed: Sequence[int] = ()
) -> Array | None:
    """Return positions (n,) rad of the best posture to jump from, see the head of this module; None if none stands.

    Parameters
    ----------
    robot : Robot
    feet : frames
    reference : (n,) rad
    limits : (n, 2) rad
    fixed : indices of joints that stay where the reference has them
    """
    legs = [Leg(robot, foot, reference) for foot in feet]
    low, high = _bounds(limits)[1:].T
    free = np.setdiff1d(np.arange(len(reference)), fixed)
    if not free.size:
        return None
    fixed_positions = reference[list(fixed)]
    best = None
    least = np.inf
    for sides in _knee_sides(legs, reference):
        objective = _Objective(robot, legs, sides, reference, limits)
        for start in _starts(reference, low, high):
            bounds = (low[free] - 1e-9, high[free] + 1e-9)
            result = least_squares(objective.of_free, start[free], args=(free,), bounds=bounds, max_nfev=100)
            if result.cost > 0.5 * least:  # knees bend to the usual side unless another is that much better
                continue
            positions = reference.copy()
            positions[free] = result.x
            posture = _rounded(robot, feet, positions, limits)
            if posture is not None and np.allclose(posture[list(fixed)], fixed_positions, atol=1e-4):
                best = posture
                least = result.cost
    return best


def _rounded(robot: Robot, feet: Sequence[str], positions: Array, limits: Array) -> Array | None:
    """The static posture next to one, in round numbers of degrees; None where it is none to jump from."""
    y = np.append(0.0, positions)
    try:
        contacts = _contacts(robot, feet, y)
    except InputError:
        return None
    static = standing_posture(robot, contacts, y, _bounds(limits))
    if static is None:
        return None
    posture = _round_positions(static[1:])
    return None if posture_fault(robot, feet, posture, limits) else posture


def _knee_sides(legs: Sequence[Leg], reference: Array) -> list[tuple[float, ...]]:
    """To which side knees bend, +1 counterclockwise in the plane, 0 of legs without one: the usual side first.

    Knees that are bent in the reference posture stay bent to that side. Else quadrupeds' legs open forwards and
    bipeds' backwards, unless ranges or the search say otherwise.
    """
    usual = -1.0 if len(legs) == 1 else 1.0
    of_legs: list[tuple[float, ...]] = []
    opposite: list[tuple[float, ...]] = []
    for leg in legs:
        sides: tuple[float, ...] = (0.0,)
        if leg.has_knee:
            bend = leg.bend(np.append(0.0, reference))
            is_bent = abs(np.sin(bend)) > BENT
            sides = (float(np.sign(bend)),) if is_bent else (usual, -usual)
        of_legs.append(sides)
        opposite.append(tuple(-side for side in sides))
    first = list(product(*of_legs))
    first_alike = sorted(first, key=lambda sides: len(set(sides)))  # all legs alike before others
    return first_alike + [sides for sides in product(*opposite) if sides not in first]


def _starts(reference: Array, low: Array, high: Array) -> list[Array]:
    """Postures (n,) rad from which the search starts: the reference, and three seeded ones in the ranges."""
    lower = np.minimum(np.maximum(low, reference - np.pi / 2), high)
    upper = np.maximum(np.minimum(high, reference + np.pi / 2), low)
    random = np.random.default_rng(0).uniform(lower, upper, (3, len(low)))
    return [np.clip(start, low, high) for start in (reference, *random)]


class _Objective:
    """The terms whose sum of squares is minimised, with legs bent to prescribed sides."""

    def __init__(
        self, robot: Robot, legs: Sequence[Leg], sides: Sequence[float], reference: Array, limits: Array
    ) -> None:
        self.robot = robot
        self.legs = legs
        self.reference = reference
        self.sides = np.array([side for side in sides if side])
        self.low, self.high = limits.T
        width = self.high - self.low
        margin = np.minimum(TOLERANCES.range_share * width, 2 * RANGE_MARGIN)
        self.range_margin = np.where(np.isfinite(width), margin, RANGE_MARGIN)
        supports = [leg.support for leg in legs]
        bends = [leg.bend_spots for leg in legs if leg.has_knee]
        self.knees = len(bends)
        hips = [Spot(leg.bodies[0], 0j) for leg in legs]
        groups = [*supports, *bends, hips, *self._others()]
        self.ends = np.cumsum(list(map(len, groups)))[:-1]
        spots = list(chain.from_iterable(groups))
        self.radii = np.array([spot.radius for spot in spots])
        self.weights = np.split(spot_weights(robot, spots), 2, axis=1)[0]
        self.unit = max(leg.length for leg in legs)

    def _others(self) -> list[list[Spot]]:
        """Corners of what does not stand, of each group of links that rotate as one."""
        turns = list(map(tuple, self.robot.tree.turns.tolist()))
        feet = {turns[self.robot.frames[leg.foot].body] for leg in self.legs}
        groups: dict[tuple[float, ...], list[LinkCapsule]] = {}
        for shape in self.robot.hulls([leg.foot for leg in self.legs]):
            if turns[shape.body] not in feet:
                groups.setdefault(turns[shape.body], []).append(shape)
        return list(map(corners, groups.values()))

    def of_free(self, free_positions: Array, free: Array) -> Array:
        """Terms (K,) for positions of free joints, with these indices, rad; the others are in the reference."""
        positions = self.reference.copy()
        positions[free] = free_positions
        return self.residuals(positions)

    def residuals(self, positions: Array) -> Array:
        """Terms (K,) in a posture (n,) rad: each over its tolerance."""
        tree = self.robot.tree
        rotations = tree.rotations(tree.absolute_angles(np.array(0.0), positions))
        spots = self.weights @ rotations / self.unit
        groups = np.split(spots, self.ends)
        undersides = np.split(spots.imag - self.radii / self.unit, self.ends)
        count = len(self.legs)
        hips = groups[count + self.knees]
        others = undersides[count + self.knees + 1 :]
        lowest = np.array([underside.min() for underside in undersides[:count]])
        ground = lowest.mean()
        slopes = []
        rears = []
        fronts = []
        for leg, support, underside in zip(self.legs, groups[:count], undersides[:count], strict=True):
            if leg.sole:
                slopes.append(underside[1] - underside[0])
            rear, front = self._on_ground(support, underside, leg)
            rears.append(rear)
            fronts.append(front)
        feet = (np.array(rears) + np.array(fronts)) / 2
        middle = (min(rears) + max(fronts)) / 2
        bends = np.array([np.angle((end - knee) / (knee - hip)) for hip, knee, end in groups[count:][: self.knees]])
        bend_errors = np.mod(self.sides * bends + np.pi / 2, 2 * np.pi) - np.pi / 2 - TOLERANCES.usual_bend
        from_ends = np.minimum(positions - self.low, self.high - positions)
        heights = np.array([underside.min() for underside in others]) - ground
        return np.concatenate(
            (
                (lowest - ground) / TOLERANCES.level,
                np.array(slopes) / TOLERANCES.level,
                [middle / TOLERANCES.over],
                (feet - hips.real) / TOLERANCES.under_hip,
                bend_errors / TOLERANCES.bend,
                np.maximum(0.0, self.range_margin - from_ends) / RANGE_MARGIN,
                np.maximum(0.0, TOLERANCES.clearance - heights) / TOLERANCES.clearance,
                (positions - self.reference) / TOLERANCES.reference,
            )
        )

    @staticmethod
    def _on_ground(positions: ComplexArray, underside: Array, leg: Leg) -> tuple[float, float]:
        """Both ends of what a foot stands on, from under the centre of mass: of a sole those, else what is lowest."""
        if leg.sole:
            return float(positions.real.min()), float(positions.real.max())
        at = float(positions.real[int(underside.argmin())])
        return at, at
