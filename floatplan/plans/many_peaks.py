"""Largest torques and rates of many plans of one robot, over all times: in closed form, a block of plans at a time.

Every block has one shape, whatever the number of plans: the numbers of a plan do not depend on its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from floatplan.arrays import Array, BoolArray, read_only
from floatplan.motion.extrema import chebyshev_nodes
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.threads import one_thread

BLOCK = 32  # plans
NODES = (64, 128, 256)  # Chebyshev nodes, as many as the motion needs; multiples of 32 for the kernel
RESOLVED = 1e-8  # [-] tail of the Chebyshev coefficients, relative to the largest value
FINENESS = 4  # points of the search grid per node


@dataclass(frozen=True, eq=False)
class ManyPeaks:
    """Largest magnitudes of N plans: ``motor_torque`` (N, m) N m; ``velocity`` (N, n) rad/s, None if not asked for."""

    motor_torque: Array
    velocity: Array | None


def many_peaks(
    like: Problem, duration: Array, angular_momentum: Array, coefficients: Array, velocities: bool = True
) -> ManyPeaks:
    """Measure N plans with the robot and the joint ranges of a problem.

    Parameters
    ----------
    like : Problem
    duration : (N,) s
    angular_momentum : (N,) kg m^2/s
    coefficients : (N, n, k+1) b of (12), powers of t in seconds; NaN where a joint's degree is lower
    velocities : whether to measure them too
    """
    coefficients = np.nan_to_num(coefficients, nan=0.0)
    count, n = len(duration), coefficients.shape[1]
    motors = len(like.robot.motors)
    ends = (motors, motors + n) if velocities else (motors,)
    peaks = np.empty((count, ends[-1]))
    left = np.arange(count)
    for nodes in NODES:
        unresolved = []
        for first in range(0, len(left), BLOCK):
            rows = left[first : first + BLOCK]
            padded = np.concatenate((rows, np.repeat(rows[-1:], BLOCK - len(rows))))
            values = _values(like, nodes, duration[padded], angular_momentum[padded], coefficients[padded])
            found, resolved = _largest(np.ascontiguousarray(values[..., : ends[-1]]), ends)
            peaks[rows] = found[: len(rows)]
            unresolved.append(rows[~resolved[: len(rows)]])
        left = np.concatenate(unresolved) if unresolved else left
        if not left.size:
            break
    return ManyPeaks(peaks[:, :motors], peaks[:, motors:] if velocities else None)


@lru_cache(maxsize=8)
def _dynamics(robot: Robot) -> Dynamics:
    return Dynamics(robot.tree)


def _values(like: Problem, nodes: int, duration: Array, angular_momentum: Array, coefficients: Array) -> Array:
    """Torques of the motors, then rates of the joints, (nodes, B, m + n)."""
    dynamics, tree = _dynamics(like.robot), like.robot.tree
    low, high = like.position_limits.T
    size = coefficients.shape[2]
    in_fractions = (coefficients * (duration[:, None] ** np.arange(size))[:, None, :]).transpose(0, 2, 1)
    p, rate, curvature = (
        (part @ in_fractions[:, order:]).reshape(-1, len(low)) for order, part in enumerate(powers(nodes, size))
    )
    per_second = np.repeat(1 / duration, nodes)[:, None]
    sine, cosine = (high - low) / 2 * np.sin(p), (high - low) / 2 * np.cos(p)
    positions, velocities = (low + high) / 2 + sine, per_second * cosine * rate
    accelerations = per_second**2 * (cosine * curvature - sine * rate**2)
    base_rate = dynamics.base_rate(positions, velocities, np.repeat(angular_momentum, nodes))
    torques = dynamics.moments(positions, velocities, accelerations, base_rate) @ tree.motor_turns
    return np.concatenate((torques, velocities), axis=1).reshape(len(duration), nodes, -1).transpose(1, 0, 2)


@lru_cache(maxsize=16)
def powers(nodes: int, size: int) -> tuple[Array, Array, Array]:
    """Powers of s, and their first and second derivatives, at the nodes: (nodes, size), one column less for each."""
    powers = np.vander(chebyshev_nodes(nodes), size, increasing=True)
    k = np.arange(size)
    return powers, powers[:, : size - 1] * k[1:], powers[:, : size - 2] * (k[2:] * (k[2:] - 1))


@lru_cache(maxsize=8)
@one_thread
def cosine_maps(nodes: int) -> tuple[Array, Array]:
    """From values at the nodes to the factors of cos(j phi), ``s = (1 - cos phi) / 2``; and on to a finer grid."""
    j = np.arange(nodes)
    coefficients = np.linalg.inv(np.cos(np.outer(np.pi * j / (nodes - 1), j)))
    fine = np.linspace(0, np.pi, FINENESS * (nodes - 1) + 1)
    return read_only(coefficients), read_only(np.cos(np.outer(fine, j)) @ coefficients)


def _largest(values: Array, ends: Sequence[int]) -> tuple[Array, BoolArray]:
    """Largest magnitudes (B, r) of interpolants of values (nodes, B, r), and whether (B,) all are resolved.

    ``ends`` divide the r columns into quantities, whose largest value counts for the resolution of all.
    """
    nodes, plans, r = values.shape
    to_cosines, to_fine = cosine_maps(nodes)
    flat = values.reshape(nodes, -1)
    cosines = to_cosines @ flat
    fine = np.abs(to_fine @ flat)
    where = fine.argmax(axis=0)
    columns = np.arange(plans * r)
    least = fine[where, columns]
    before, after = (fine[np.clip(where + side, 0, len(fine) - 1), columns] for side in (-1, 1))
    bend = before - 2 * least + after
    inside = (where > 0) & (where < len(fine) - 1) & (bend < 0)
    step = np.pi / (len(fine) - 1)
    phi = step * (where + np.where(inside, (before - after) / (2 * np.where(inside, bend, 1.0)), 0.0))
    j = np.arange(nodes)
    angle = j[:, None] * phi
    even, odd = cosines * np.cos(angle), cosines * np.sin(angle)
    value, slope, curvature = j**0 @ even, -(j @ odd), -(j**2 @ even)
    curved = inside & (value * curvature < 0)
    move = np.clip(np.where(curved, -slope / np.where(curved, curvature, 1.0), 0.0), -step, step)
    refined = np.abs(value + slope * move / 2)
    found = np.maximum(np.where(curved, refined, 0.0), least).reshape(plans, r)
    tail = np.abs(cosines[-3:]).max(axis=0).reshape(plans, r)
    resolved = np.ones(plans, dtype=np.bool_)
    for start, stop in pairwise((0, *ends)):
        resolved &= tail[:, start:stop].max(axis=1) <= RESOLVED * found[:, start:stop].max(axis=1)
    return found, resolved
