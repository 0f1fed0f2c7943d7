"""Largest torques and rates of many plans of one robot, over all times, compiled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.bodies import unscaled_robot
from floatplan.kernel.layout import Filled, structure_array
from floatplan.kernel.library import kernel
from floatplan.motion.quadrature import chebyshev_nodes, coefficient_map
from floatplan.problem.problem import Problem

NODES = (64, 128, 256)  # Chebyshev nodes, as many as the motion needs
RESOLVED = 1e-8  # [-] tail of the Chebyshev coefficients, relative to the largest value


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
    low, high = like.position_limits.T
    interpolations = _interpolations(size, NODES)
    counts = {"count": count, "levels": len(NODES), "columns": size, "motors": motors, "velocities": velocities}
    ranges = {"centre": (low + high) / 2, "amplitude": (high - low) / 2, "turns": like.robot.tree.motor_turns}
    plans = {"duration": duration, "momentum": angular_momentum, "coefficients": np.nan_to_num(coefficients, nan=0.0)}
    batch = Filled("Peaks", resolved=RESOLVED, peaks=peaks, **counts, **ranges, **plans)
    robot = unscaled_robot(like.robot.tree)[1].structure
    if found.peaks(robot, interpolations, batch.structure, found.instructions):
        raise MemoryError("no memory to measure plans")
    return ManyPeaks(peaks[:, :motors], peaks[:, motors:] if velocities else None)


@lru_cache(maxsize=16)
def _interpolations(size: int, counts: tuple[int, ...]) -> Any:
    """Powers of s and their derivatives at the nodes, and the last Chebyshev coefficients from values there."""
    found = []
    k = np.arange(size)
    for nodes in counts:
        s = chebyshev_nodes(nodes)
        powers = np.vander(s, size, increasing=True)
        slope, curvature = np.zeros((2, *powers.shape))
        slope[:, 1:] = powers[:, :-1] * k[1:]
        curvature[:, 2:] = powers[:, :-2] * (k[2:] * (k[2:] - 1))
        of_powers = {"value": powers.T, "slope": slope.T, "curvature": curvature.T}
        found.append(Filled("Interpolation", nodes=nodes, s=s, tail=coefficient_map(nodes)[-3:], **of_powers))
    return structure_array("Interpolation", found)
