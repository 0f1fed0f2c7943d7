"""Angular momenta and velocities of the centre of mass that joint rates within limits make, with a frame at rest.

Rates within ``|q_i'| <= limit_i`` and any rate of the base reach a polygon of (h, velocity): a zonogon, the sum of one
segment for each joint. Its edges are those of the limits of :mod:`floatplan.motion.planar.contact_rates`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.motion.planar.contact_rates import NOTHING, End, at_end, equations_at, rate_limits, row_sizes
from floatplan.problem.problem import Problem

Interval: TypeAlias = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Reachable:
    """What rates within the limits reach at one end of a flight, about what is asked there.

    Intervals are infinite where limits are missing, and None where nothing is reached. The other two quantities are
    as asked.

    Attributes
    ----------
    angular_momentum, horizontal_velocity, vertical_velocity : (low, high), kg m^2/s and m/s
    polygon : (K, 2), optional
        Corners (h, vertical velocity) at the asked horizontal velocity, counter-clockwise; None where it is not
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
    asked = np.array([angular_momentum, *velocity])
    normals, reach = _half_planes(matrix, row_sizes(matrix), limits)
    momentum, horizontal, vertical = (_interval(normals, reach, asked, direction) for direction in np.eye(3))
    return Reachable(momentum, horizontal, vertical, polygon=_polygon(matrix, limits, asked[1]), asked=read_only(asked))


def _half_planes(matrix: Array, scale: Array, limits: Array) -> tuple[Array, Array]:
    """Normals y (K, 3) and reach (K,): x is reached where ``|y . x| <= reach`` for all, infinite reach left out."""
    scaled = matrix / scale[:, None]
    base, joints = scaled[:, 0] / np.linalg.norm(scaled[:, 0]), scaled[:, 1:]
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


def _interval(normals: Array, reach: Array, asked: Array, direction: Array) -> Interval | None:
    """Of ``asked + t direction`` the part within all half-planes, as values along the direction."""
    slopes, offsets = normals @ direction, normals @ asked
    sizes = np.linalg.norm(normals, axis=1)
    across = np.abs(slopes) <= NOTHING * sizes
    if (np.abs(offsets[across]) > reach[across] + NOTHING * sizes[across] * np.linalg.norm(asked)).any():
        return None
    ends = np.sort((np.array([[-1.0], [1.0]]) * reach[~across] - offsets[~across]) / slopes[~across], axis=0)
    low, high = ends[0].max(initial=-math.inf), ends[1].min(initial=math.inf)
    here = float(asked @ direction)
    return (here + float(low), here + float(high)) if low <= high else None


def _polygon(matrix: Array, limits: Array, horizontal_velocity: float) -> Array | None:
    """Corners (K, 2) of (h, vertical velocity): each joint moves it along a segment, the base keeping the horizontal.

    The base's rate is what makes the horizontal velocity the asked one.
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
