"""Largest torques and rates of many plans of one robot, over all times, compiled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.kernel.bodies import filled_robot, merged_bodies
from floatplan.kernel.layout import STRUCTURES, Filled, FilledArray
from floatplan.kernel.library import kernel
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.quadrature import chebyshev_nodes
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot

NODES = (64, 128, 256)  # Chebyshev nodes, as many as the motion needs
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
    """Measure N plans with the robot and the joint ranges of a problem; each as if it were alone.

    Parameters
    ----------
    like : Problem
    duration : (N,) s
    angular_momentum : (N,) kg m^2/s
    coefficients : (N, n, k+1) b of (12), powers of t in seconds; NaN where a joint's degree is lower
    velocities : whether to measure them too
    """
    found = kernel()
    count, n, size = coefficients.shape
    motors = len(like.robot.motors)
    peaks = np.empty((count, motors + n if velocities else motors))
    robot, turns, amplitude = _measured(like.robot, tuple(map(tuple, like.position_limits.tolist())), size)
    grids, interpolations = _grids(size, NODES)
    batch = Filled(
        "Peaks",
        count=count,
        levels=len(grids.structures),
        motors=motors,
        velocities=velocities,
        resolved=RESOLVED,
        turns=turns,
        amplitude=amplitude,
        duration=duration,
        momentum=angular_momentum,
        coefficients=np.nan_to_num(coefficients, nan=0.0),
        peaks=peaks,
    )
    failed = found.peaks(
        robot.structure,
        grids.structures,
        interpolations.structures,
        STRUCTURES["Settings"](),
        batch.structure,
        found.instructions,
    )
    if failed:
        raise MemoryError("no memory to measure plans")
    return ManyPeaks(peaks[:, :motors], peaks[:, motors:] if velocities else None)


@lru_cache(maxsize=8)
def _measured(robot: Robot, ranges: tuple[tuple[float, float], ...], size: int) -> tuple[Filled, Array, Array]:
    """Return the robot, how motors turn its links, and the joints' amplitudes."""
    low, high = np.array(ranges).T
    amplitude = (high - low) / 2
    bodies = merged_bodies(robot.tree, (low + high) / 2, amplitude)
    return filled_robot(bodies, [size - CONDITIONS] * len(ranges)), robot.tree.motor_turns, amplitude


@lru_cache(maxsize=16)
def _grids(size: int, counts: tuple[int, ...]) -> tuple[FilledArray, FilledArray]:
    """Powers of s and their derivatives at the nodes, without weights, since (14) is not integrated; interpolations."""
    grids, interpolations = [], []
    k = np.arange(size)
    for nodes in counts:
        powers = np.vander(chebyshev_nodes(nodes), size, increasing=True)
        slope, curvature = np.zeros((2, *powers.shape))
        slope[:, 1:] = powers[:, :-1] * k[1:]
        curvature[:, 2:] = powers[:, :-2] * (k[2:] * (k[2:] - 1))
        without = {"weights": np.zeros(nodes), "tail": np.zeros((3, nodes))}
        grids.append(Filled("Grid", nodes=nodes, value=powers.T, slope=slope.T, **without))
        to_cosines, to_fine = _cosine_maps(nodes)
        maps = {"curvature": curvature.T, "to_cosines": to_cosines.T, "to_fine": to_fine}
        interpolations.append(Filled("Interpolation", nodes=nodes, points=len(to_fine), **maps))
    return FilledArray("Grid", grids), FilledArray("Interpolation", interpolations)


@lru_cache(maxsize=8)
def _cosine_maps(nodes: int) -> tuple[Array, Array]:
    """From values at the nodes to the factors of cos(j phi), ``s = (1 - cos phi) / 2``; and on to a finer grid."""
    j = np.arange(nodes)
    weights = np.where((j == 0) | (j == nodes - 1), 0.5, 1.0)
    coefficients = np.outer(weights, weights) * np.cos(np.outer(np.pi * j / (nodes - 1), j)) * (2 / (nodes - 1))
    fine = np.linspace(0, np.pi, FINENESS * (nodes - 1) + 1)
    return read_only(coefficients), read_only(np.cos(np.outer(fine, j)) @ coefficients)
