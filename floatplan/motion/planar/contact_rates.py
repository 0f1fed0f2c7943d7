"""Rates with which a frame leaves or meets the ground at rest, and how much of their limits they need.

At takeoff and landing posture, momentum and velocity of the centre of mass are fixed; the frame's velocity has to
vanish. That is three linear equations for the rates of base and joints: the one of (4), and two of the derivative
of (6). Which rates solve them best is a linear program, in closed form, see :func:`least_rates`.

Rates within ``|q_i'| <= limit_i`` and any rate of the base reach a polygon of (h, velocity): a zonogon, the sum of one
segment for every joint, whose edges are those of the limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, get_args

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.motion.planar.closed_form import tree_dynamics
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Frame, Robot

End: TypeAlias = Literal["takeoff", "landing"]

NOTHING = 1e-12  # [-] of the whole: less is rounding
SAME = 1e-9  # [-] relative: what differs by less is equal
Interval: TypeAlias = tuple[float, float]


@dataclass(frozen=True, eq=False)
class ContactEquations:
    """``matrix @ (theta0', q_1', .., q_n') = target(angular_momentum)``.

    The rows are the angular momentum, kg m^2/s, and the velocity of the frame relative to the centre of mass,
    horizontal and vertical, m/s.

    Attributes
    ----------
    matrix : (3, n+1)
    com_velocity : (2,) m/s
    """

    matrix: Array
    com_velocity: Array

    def target(self, angular_momentum: float) -> Array:
        """What the rows have to be (3,)."""
        return np.array([angular_momentum, *-self.com_velocity])


def row_sizes(matrix: Array) -> Array:
    """Sizes (3,) of the rows of ``ContactEquations`` (3, k); those of the velocity share one.

    Either of these two may vanish where a robot is stretched out.
    """
    sizes: Array = np.abs(matrix).max(axis=1)
    sizes[1:] = sizes[1:].max()
    return np.where(sizes == 0, 1.0, sizes)


@dataclass(frozen=True, eq=False)
class ContactRates:
    """The rates at one end of a flight with the least largest share of their limits, the frame being at rest.

    Attributes
    ----------
    ratio : largest ``|rate| / limit`` over the motors
        None where no motor has a limit: then the largest rate itself is least. Infinite where no rates make it so.
    rates : (n,) rad/s, of the planned joints; NaN where there are none
    orientation_rate : rad/s
    angular_momentum : kg m^2/s; as requested, or the best
    joint : str, optional
        The motor whose limit holds back most: a higher one lowers the ratio more than any other's would. Without
        limits, that which weighs most in the largest rate. None where all are at rest, or there are no rates.
    limits : (n,) rad/s, of the planned joints, see :func:`rate_limits`
    """

    ratio: float | None
    rates: Array
    orientation_rate: float
    angular_momentum: float
    joint: str | None
    limits: Array
    robot: Robot

    @property
    def exist(self) -> bool:
        """Whether there are such rates."""
        return bool(np.isfinite(self.rates).all())

    @cached_property
    def motor_rates(self) -> Array:
        """Rates (m,) of ``robot.motors``, rad/s."""
        return read_only(self.robot.motor_ratios @ self.rates)

    @property
    def size(self) -> float:
        """The ratio; without limits the largest rate of a motor, rad/s; infinite where no rates exist."""
        if not self.exist:
            return np.inf
        return float(np.abs(self.motor_rates).max()) if self.ratio is None else self.ratio


def has_contact(problem: Problem, end: End) -> bool:
    """Whether a frame leaves or meets the ground at that end: any but the base link's own, which flies freely."""
    frame = problem.takeoff.frame if end == "takeoff" else problem.landing.frame
    return frame != problem.robot.tree.names[0]


def at_end(problem: Problem, end: End) -> tuple[Frame, float, Array, Array]:
    """Return the frame, and orientation, positions (n,) and velocity (2,) of the centre of mass at that end."""
    frame, state, instant = {
        "takeoff": (problem.takeoff_frame, problem.initial, 0.0),
        "landing": (problem.landing_frame, problem.final, problem.flight.duration),
    }[end]
    return frame, state.orientation, state.positions, problem.path.velocities(np.array([instant]))[0]


def equations_at(
    robot: Robot, frame: Frame, orientation: float, positions: Array, com_velocity: Array
) -> ContactEquations:
    """Return the equations for a frame at rest in any posture; ``com_velocity`` (2,) m/s."""
    tree = robot.tree
    rotations = tree.rotations(tree.absolute_angles(np.array(orientation), positions))
    swings = 1j * tree.turn * rotations * frame.weights
    of_frame = np.append(swings.sum(), swings @ tree.turns)
    inertia = tree_dynamics(tree).momentum_map(positions[None])[0]
    return ContactEquations(read_only([inertia, of_frame.real, of_frame.imag]), read_only(com_velocity))


def rate_limits(problem: Problem) -> Array:
    """Return the stricter of the URDF's and the problem's velocity limits (n,) rad/s; infinite where there is none.

    They are those of the planned joints: as slow as their followers demand, by their ratios.
    """
    return np.minimum(problem.robot.velocity_limits, problem.velocity_limits)


def contact_rates(problem: Problem, end: End, angular_momentum: float | None) -> ContactRates:
    """Return the rates with which the frame is at rest, with the least largest ``|rate| / limit``.

    Of several such rates it is that whose next largest ratio is least, and so on; joints without a limit are as slow
    as those with one let them be.

    Parameters
    ----------
    angular_momentum : float, optional
        kg m^2/s; None for the one that lets the joints be slowest.
    """
    equations = equations_at(problem.robot, *at_end(problem, end))
    return rates_at(problem.robot, equations, rate_limits(problem), angular_momentum)


def shared_momentum(problem: Problem) -> float | None:
    """Return the angular momentum, kg m^2/s, that lets the joints be slowest at both ends.

    It has the least larger ratio of both. The ratios are convex, so between the best of either end the one rises while
    the other falls. None where no frame stands at either end, or none can be at rest.
    """
    ends = [end for end in get_args(End) if has_contact(problem, end)]
    best = {end: rates for end in ends if (rates := contact_rates(problem, end, None)).exist}
    if len(best) < 2:
        return next((rates.angular_momentum for rates in best.values()), None)

    def larger(momentum: float) -> tuple[float, End]:
        return max((contact_rates(problem, end, momentum).size, end) for end in ends)

    first = best["takeoff"].angular_momentum
    last = best["landing"].angular_momentum
    if larger(first)[1] == "takeoff":
        return first
    for _ in range(80):  # halvings of the interval: to rounding
        middle = (first + last) / 2
        first, last = (first, middle) if larger(middle)[1] == "takeoff" else (middle, last)
    return min(first, last, key=larger)


def rates_at(robot: Robot, equations: ContactEquations, limits: Array, angular_momentum: float | None) -> ContactRates:
    """Return the rates that satisfy equations, see :func:`contact_rates`; ``limits`` (n,) rad/s."""
    scale = row_sizes(equations.matrix)
    columns = equations.matrix / scale[:, None]
    target = equations.target(angular_momentum or 0.0) / scale
    free = 1
    if angular_momentum is None:
        columns = np.column_stack((np.array([-1.0, 0.0, 0.0]) / scale, columns))
        free = 2
    unlimited = 1 / np.abs(robot.motor_ratios).max(axis=0)  # of the fastest motor, 1 rad/s
    limited = np.isfinite(limits)
    costless = np.full(free, np.inf)
    least = least_rates(columns, target, np.concatenate((costless, limits)))
    values = least.values
    ratio = least.ratio
    if not limited.all() and np.isfinite(ratio):
        chosen = np.concatenate((costless > 0, ~limited))
        remainder = target - columns[:, ~chosen] @ values[~chosen]
        others = least_rates(columns[:, chosen], remainder, np.concatenate((costless, unlimited[~limited])))
        values[chosen] = others.values
        least = least if limited.any() else others
    return ContactRates(
        ratio=ratio if limited.any() or not np.isfinite(ratio) else None,
        rates=read_only(values[free:]),
        orientation_rate=float(values[free - 1]),
        angular_momentum=float(values[0]) if angular_momentum is None else angular_momentum,
        joint=_motor(robot, least, free),
        limits=read_only(limits),
        robot=robot,
    )


def _motor(robot: Robot, least: LeastRates, free: int) -> str | None:
    """Of the joint with most influence the motor that is the first at its limit."""
    influence = least.influence[free:]
    if not 0 < least.ratio < np.inf:
        return None
    leader = int(np.flatnonzero(influence >= influence.max() * (1 - SAME))[0])
    ratios = np.abs(robot.motor_ratios[:, leader])
    limits = robot.motor_velocity_limits
    slowness = ratios / limits if (np.isfinite(limits) & (ratios > 0)).any() else ratios
    return robot.motors[int(np.flatnonzero(slowness >= slowness.max() * (1 - SAME))[0])]


@dataclass(frozen=True, eq=False)
class LeastRates:
    """Rates, and what holds them back.

    Attributes
    ----------
    ratio : the largest ``|x_i| / limit_i``; infinite where no rates satisfy the equations
    values : (k,) the rates x; NaN where there are none
    influence : (k,)
        By which share ``ratio`` falls as a limit grows by its own share; the sum is 1, or 0 where nothing holds back.
    """

    ratio: float
    values: Array
    influence: Array


def least_rates(columns: Array, target: Array, limits: Array) -> LeastRates:
    """Solve ``columns @ x = target`` with the least largest ``|x_i| / limit_i``, then the next largest, and so on.

    That makes x unique, whatever the order of the columns and their signs. The linear program ``min r: C x = b,
    |x_i| <= limit_i r`` has the dual ``max b.y: sum_i limit_i |C_i.y| <= 1`` with ``C_k.y = 0`` for every column k
    without a limit. A flight's equations are three and its base has no limit, so y lies in a plane, and the best is
    perpendicular to one of the columns there: as many candidates as columns.

    Parameters
    ----------
    columns : (3, k), the equations of comparable size: what is ``NOTHING`` of a column is rounding
    target : (3,)
    limits : (k,)
        Positive; infinite where a rate costs nothing. These must leave at most two of the three equations.
    """
    limited = np.isfinite(limits)
    reach = columns * np.where(limited, limits, 0.0)
    values = np.zeros(len(limits))
    influence = np.zeros(len(limits))
    ratio = 0.0
    costless = columns[:, ~limited]
    lengths = np.linalg.norm(costless, axis=0)
    left, singular, _ = np.linalg.svd(costless / np.where(lengths > 0, lengths, 1.0))
    basis = left[:, int((singular > SAME).sum()) :]
    open_ = limited
    remainder = target
    for stage in range(basis.shape[1]):
        direction = _steepest(basis, reach * open_, remainder)
        normal = basis @ direction
        required = float(normal @ remainder)
        pulls = _pulls(normal, reach * open_)
        strength = float(np.abs(pulls).sum())
        is_met = abs(required) <= NOTHING * np.linalg.norm(target)
        share = 0.0 if is_met else required / strength if strength else np.inf
        if stage == 0:
            ratio = abs(share)
            influence = np.abs(pulls) / (strength or 1.0)
        acting = pulls != 0
        values[acting] += share * np.sign(pulls[acting]) * limits[acting]
        open_ = open_ & ~acting
        remainder = target - columns[:, limited] @ values[limited]
        if stage + 1 < basis.shape[1]:  # from the plane to the line across
            basis = basis @ np.array([[-direction[1]], [direction[0]]])
    values[~limited] = np.linalg.pinv(costless, rcond=SAME) @ remainder
    return LeastRates(ratio, np.full(len(values), np.nan) if np.isinf(ratio) else values, influence)


def _pulls(normals: Array, reach: Array) -> Array:
    """How far (.., k) the columns of ``reach`` (3, k) go along unit normals (.., 3): 0 for rounding."""
    pulls = normals @ reach
    return np.where(np.abs(pulls) <= NOTHING * np.linalg.norm(reach, axis=0), 0.0, pulls)


def _steepest(basis: Array, reach: Array, target: Array) -> Array:
    """The unit vector y (d,), d of 1 or 2, in a basis (3, d), with the largest ``|target.y| / sum_i |reach_i.y|``."""
    if basis.shape[1] == 1:
        return np.ones(1)
    across = basis.T @ reach
    along = basis.T @ target
    candidates = np.column_stack(((-across[1], across[0]), along))
    lengths = np.linalg.norm(candidates, axis=0)
    candidates = candidates[:, lengths > 0] / lengths[lengths > 0]
    if not candidates.size:
        return np.array([1.0, 0.0])
    required = np.abs(along @ candidates)
    required[required <= NOTHING * np.linalg.norm(target)] = 0.0
    strength = np.abs(_pulls((basis @ candidates).T, reach)).sum(axis=1)
    ratios = np.divide(required, strength, out=np.where(required > 0, np.inf, 0.0), where=strength > 0)
    return np.asarray(candidates[:, ratios.argmax()])


@dataclass(frozen=True, eq=False)
class Reachable:
    """What rates within the limits reach at one end of a flight, about what is requested there.

    Intervals are infinite where limits are missing, and None where there are no such rates. The two other quantities
    are as requested.

    Attributes
    ----------
    angular_momentum, horizontal_velocity, vertical_velocity : (low, high), kg m^2/s and m/s
    polygon : (K, 2), optional
        Corners (h, vertical velocity) at the requested horizontal velocity, counter-clockwise; None where it is not
        bounded.
    asked : (3,)
        h, horizontal and vertical velocity.
    """

    angular_momentum: Interval | None
    horizontal_velocity: Interval | None
    vertical_velocity: Interval | None
    polygon: Array | None
    asked: Array


def reachable(problem: Problem, end: End, angular_momentum: float) -> Reachable:
    """Return what rates within the limits reach at that end, about an angular momentum, kg m^2/s."""
    frame, orientation, positions, velocity = at_end(problem, end)
    equations = equations_at(problem.robot, frame, orientation, positions, velocity)
    matrix = equations.matrix * [[1.0], [-1.0], [-1.0]]
    limits = rate_limits(problem)
    required = np.array([angular_momentum, *velocity])
    normals, reach = _half_planes(matrix, row_sizes(matrix), limits)
    momentum, horizontal, vertical = (_interval(normals, reach, required, direction) for direction in np.eye(3))
    return Reachable(
        momentum, horizontal, vertical, polygon=_polygon(matrix, limits, required[1]), asked=read_only(required)
    )


def _half_planes(matrix: Array, scale: Array, limits: Array) -> tuple[Array, Array]:
    """Normals y (K, 3) and reach (K,): x is reached where ``|y . x| <= reach`` for all, infinite reach left out."""
    scaled = matrix / scale[:, None]
    base = scaled[:, 0] / np.linalg.norm(scaled[:, 0])
    joints = scaled[:, 1:]
    lengths = np.linalg.norm(joints, axis=0)
    directions = joints[:, lengths > 0] / lengths[lengths > 0]
    across = np.cross(base, directions.T)
    candidates = np.concatenate((across, np.cross(base, across)))
    sizes = np.linalg.norm(candidates, axis=1)
    normals = candidates[sizes > NOTHING] / sizes[sizes > NOTHING, None]
    pulls = np.abs(normals @ joints)
    pulls[pulls <= NOTHING * lengths] = 0.0
    reach = np.where(pulls > 0, pulls * np.where(pulls > 0, limits, 0.0), 0.0).sum(axis=1)
    bounded = np.isfinite(reach)
    return normals[bounded] / scale, reach[bounded]


def _interval(normals: Array, reach: Array, required: Array, direction: Array) -> Interval | None:
    """Of ``required + t direction`` the interval within all half-planes, as values along the direction."""
    slopes = normals @ direction
    offsets = normals @ required
    sizes = np.linalg.norm(normals, axis=1)
    across = np.abs(slopes) <= NOTHING * sizes
    if (np.abs(offsets[across]) > reach[across] + NOTHING * sizes[across] * np.linalg.norm(required)).any():
        return None
    ends = np.sort((np.array([[-1.0], [1.0]]) * reach[~across] - offsets[~across]) / slopes[~across], axis=0)
    low = ends[0].max(initial=-math.inf)
    high = ends[1].min(initial=math.inf)
    here = float(required @ direction)
    return (here + float(low), here + float(high)) if low <= high else None


def _polygon(matrix: Array, limits: Array, horizontal_velocity: float) -> Array | None:
    """Corners (K, 2) of (h, vertical velocity): every joint moves it along a segment, the base keeping the horizontal.

    The base's rate is what makes the horizontal velocity the requested one.
    """
    lever = matrix[1, 0]
    if not np.isfinite(limits).all() or abs(lever) <= NOTHING * float(np.abs(matrix[1:]).max()):
        return None
    per_horizontal = matrix[[0, 2], 0] / lever
    segments = (matrix[[0, 2], 1:] - per_horizontal[:, None] * matrix[1, 1:]) * limits
    segments = segments.T[np.abs(segments).max(axis=0) > 0]
    upward = segments * np.where((segments[:, 1] < 0) | ((segments[:, 1] == 0) & (segments[:, 0] < 0)), -1, 1)[:, None]
    upward = upward[np.argsort(np.arctan2(upward[:, 1], upward[:, 0]), kind="stable")]
    right = -upward.sum(axis=0) + 2 * np.concatenate((np.zeros((1, 2)), np.cumsum(upward, axis=0)))[:-1]
    corners = np.concatenate((right, -right)) + per_horizontal * horizontal_velocity
    return read_only(corners)
