"""Shapes of the plane in three dimensions."""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.plans.plan import Plan
from floatplan.problem.parts import HalfPlane, Obstacle
from floatplan.robot.parts import Plane
from floatplan.view.postures import robot_size
from floatplan.view.surroundings import obstacle_outline

SLAB = 0.016  # [-] thickness of a half-plane as drawn, in sizes of the robot; it is one size wide
WIDTH = 0.4  # [-] width of other obstacles, in sizes of the robot


def point_in_space(plane: Plane, place: complex) -> Array:
    """Return a place of the plane, horizontal + i vertical, as a point (3,)."""
    return np.asarray(place.real * plane.horizontal + place.imag * plane.vertical)


def quaternion(axis: Array, angle: float) -> tuple[float, float, float, float]:
    """Return the rotation by an angle about a unit vector (3,) as (w, x, y, z)."""
    x, y, z = np.sin(angle / 2) * axis
    return float(np.cos(angle / 2)), float(x), float(y), float(z)


def obstacle_slab(plan: Plan, obstacle: Obstacle, low: complex, high: complex) -> tuple[Array, IntArray]:
    """Return corners (k, 3) and triangles (f, 3) of an obstacle at t = 0, drawn out across the plane, m.

    A half-plane reaches beside all of the box from ``low`` to ``high``.
    """
    size = robot_size(plan)
    if not isinstance(obstacle, HalfPlane):
        outline = obstacle_outline(obstacle, 0.0, 0.0)
        return prism(plan.robot.plane, outline[:, 0] + 1j * outline[:, 1], WIDTH * size)
    normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
    point, reach, below = complex(*obstacle.point), abs(high - low) / 2, -SLAB * size * normal
    beside = ((low + high) / 2 - point) / (1j * normal)
    ends = point + 1j * normal * (beside.real + reach * np.array([1.0, -1.0]))
    return prism(plan.robot.plane, np.concatenate((ends, ends[::-1] + below)), size)


def prism(plane: Plane, corners: ComplexArray, width: float) -> tuple[Array, IntArray]:
    """Return corners (2 k, 3) and triangles of a convex polygon (k,) drawn out across the plane, m."""
    count = len(corners)
    aside = 0.5 * width * plane.normal
    points = np.array([point_in_space(plane, complex(corner)) for corner in corners])
    here = np.arange(count)
    on = (here + 1) % count
    sides = [np.stack((here, on, here + count), axis=1), np.stack((on, on + count, here + count), axis=1)]
    fan = np.stack((np.zeros(count - 2, dtype=np.int64), here[1:-1], here[2:]), axis=1)
    faces = np.concatenate((*sides, fan[:, ::-1], fan + count))
    both = np.concatenate((faces, faces[:, ::-1]))  # whichever way round the polygon goes, it is seen from outside
    return np.concatenate((points - aside, points + aside)), both
