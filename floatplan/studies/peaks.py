"""Shares of limits that many plans of one robot use over all times, measured by the kernel: ``peaks.hpp``."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import NULL, Struct, StructArray, doubles
from floatplan.motion.flight import planar_flight
from floatplan.motion.quadrature import chebyshev_nodes, coefficient_map
from floatplan.planning.kernel_input.bodies import unscaled_bodies
from floatplan.planning.kernel_input.numbers import Numbers
from floatplan.planning.kernel_input.rows import DistanceRows, PlanarRows, can_write
from floatplan.problem.problem import Problem

NODES = (64, 128, 256)  # [-] Chebyshev nodes, as many as the motion needs
ORDERS = ("velocity", "acceleration")  # of joints, as limits are named


@dataclass(frozen=True, eq=False)
class ManyPeaks:
    """Of N plans, over all times.

    ``motor_torque`` (N, m) N m, and ``joints``, (N, n) rad/s or rad/s^2 by limit, are largest magnitudes; ``clearance``
    (N,) m is the least distance to an obstacle, infinite where none exists or none was measured.
    """

    motor_torque: Array
    joints: dict[str, Array]
    clearance: Array


def can_measure(problem: Problem) -> bool:
    """Whether the kernel can measure all obstacles of a problem."""
    return all(map(can_write, problem.obstacles))


def many_peaks(
    of: Problem | Sequence[Problem] | Numbers,
    duration: Array,
    angular_momentum: Array,
    coefficients: Array,
    orders: int = 1,
) -> ManyPeaks:
    """Measure N plans; the result of one does not depend on the others.

    Parameters
    ----------
    of : Problem, or N problems of one robot with obstacles of the same kinds, or their numbers
        Of a single problem, with the joint ranges of all, no distances are measured; of numbers the ranges are its.
    duration : (N,) s
    angular_momentum : (N,) kg m^2/s
    coefficients : (N, n, k+1) b of (12), powers of t in seconds; NaN where a joint's degree is lower
    orders : how many of the joints' derivatives to measure too
    """
    problems = [of] if isinstance(of, Problem) else [of.like] if isinstance(of, Numbers) else of
    count, n, size = coefficients.shape
    like = problems[0]
    motors = len(like.robot.motors)
    peaks = np.empty((count, motors + orders * n))
    ranges = np.array([np.broadcast_to(problem.position_limits, (n, 2)) for problem in problems])
    low = np.broadcast_to(ranges[:, :, 0], (count, n))
    high = np.broadcast_to(ranges[:, :, 1], (count, n))
    clearance = np.full(count, np.inf)
    constraints, distances = _distances(None if isinstance(of, Problem) or not like.obstacles else of)
    batch = Struct(
        "Peaks",
        count=count,
        levels=len(NODES),
        columns=size,
        motors=motors,
        orders=orders,
        resolved=1e-8,  # [-] tail of the Chebyshev coefficients, relative to the largest value
        turns=doubles(like.robot.tree.motor_turns),
        centre=doubles((low + high) / 2),
        amplitude=doubles((high - low) / 2),
        duration=doubles(duration),
        momentum=doubles(angular_momentum),
        coefficients=doubles(np.nan_to_num(coefficients, nan=0.0)),
        peaks=peaks,
        clearance=clearance,
        **distances,
    )
    interpolations = _interpolations(size, NODES)
    compiled = kernel()
    if compiled.peaks(
        unscaled_bodies(like.robot.tree).struct.pointer,
        interpolations.pointer,
        constraints.struct.pointer if constraints else NULL,
        batch.pointer,
        compiled.instructions,
    ):
        raise MemoryError("no memory to measure plans")
    of_motors, *of_joints = np.split(peaks, range(motors, peaks.shape[1], n), axis=1)
    return ManyPeaks(of_motors, dict(zip(ORDERS, of_joints, strict=False)), clearance)


def _distances(of: Sequence[Problem] | Numbers | None) -> tuple[PlanarRows | None, dict[str, Any]]:
    """Rows of the distances to obstacles, and the numbers in which problems differ."""
    if of is None:
        return None, dict.fromkeys(("orientation", "path", "obstacles", "low", "high", "minima"))
    numbers = of if isinstance(of, Numbers) else Numbers.of_problems(of)
    like = numbers.like
    blocks = [DistanceRows(obstacle, 0.0, 1.0) for obstacle in like.obstacles]
    constraints = PlanarRows(like.robot.tree, blocks, flight=planar_flight(like))
    rows = np.diff(constraints.block_first)
    windows = np.empty((len(numbers.obstacles), len(like.obstacles), 2))
    for problem, own in enumerate(numbers.obstacles):
        for number, obstacle in enumerate(own):
            windows[problem, number] = obstacle.window or (0.0, np.inf)
    windows = np.minimum(windows / numbers.values["duration"][:, None, None], (np.inf, 1.0))
    low, high = np.repeat(windows, rows, axis=1).transpose(2, 0, 1)
    instants = 129  # among which the least distance is first searched for
    most = instants * constraints.rows
    minima = Struct(
        "Minima",
        instants=instants,
        near=np.inf,
        span=1 / (instants - 1),
        grid=np.linspace(0, 1, instants),
        low=None,
        high=None,
        row=np.empty(most, np.int64),
        s=np.empty(most),
        value=np.empty(most),
    )
    obstacles = numbers.obstacle_numbers()
    return constraints, {
        "orientation": doubles(numbers.values["orientation"][:, 0]),
        "path": doubles(numbers.paths()),
        "obstacles": doubles(obstacles),
        "numbers": obstacles.shape[1],
        "low": doubles(low),
        "high": doubles(high),
        "minima": minima,
    }


@lru_cache(maxsize=16)
def _interpolations(size: int, counts: tuple[int, ...]) -> StructArray:
    """Powers of s and their derivatives at the nodes, and the Chebyshev coefficients from values there."""
    interpolations = []
    k = np.arange(size)
    for nodes in counts:
        s = chebyshev_nodes(nodes)
        powers = np.vander(s, size, increasing=True)
        slope, curvature = np.zeros((2, *powers.shape))
        slope[:, 1:] = powers[:, :-1] * k[1:]
        curvature[:, 2:] = powers[:, :-2] * (k[2:] * (k[2:] - 1))
        interpolation = Struct(
            "Interpolation",
            nodes=nodes,
            s=doubles(s),
            map=doubles(coefficient_map(nodes)),
            value=doubles(powers.T),
            slope=doubles(slope.T),
            curvature=doubles(curvature.T),
        )
        interpolations.append(interpolation)
    return StructArray(interpolations)
