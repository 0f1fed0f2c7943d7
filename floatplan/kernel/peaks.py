"""Largest torques and rates of many plans of one robot, compiled: the numbers of :mod:`floatplan.plans.many_peaks`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel import library
from floatplan.kernel.bodies import Bodies, merged_bodies
from floatplan.kernel.filled import Filled, filled_robot
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.planar.momentum import centroidal_coupling
from floatplan.plans import many_peaks as reference
from floatplan.plans.many_peaks import ManyPeaks
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Robot


def many_peaks(
    like: Problem, duration: Array, angular_momentum: Array, coefficients: Array, velocities: bool = True
) -> ManyPeaks:
    """Measure N plans as :func:`floatplan.plans.many_peaks.many_peaks` does, which is called where there is no kernel.

    The peaks of a plan do not depend on its neighbours.
    """
    found = library.kernel()
    count, n, size = coefficients.shape
    if found is None or size < CONDITIONS:
        return reference.many_peaks(like, duration, angular_momentum, coefficients, velocities)
    motors = len(like.robot.motors)
    peaks = np.empty((count, motors + n if velocities else motors))
    robot, moments = _measured(like.robot, tuple(map(tuple, like.position_limits.tolist())), size)
    grids, interpolations = _grids(size), _interpolations(size)
    batch = Filled(
        library.Peaks,
        count=count,
        levels=len(reference.NODES),
        velocities=velocities,
        resolved=reference.RESOLVED,
        duration=duration,
        momentum=angular_momentum,
        coefficients=np.nan_to_num(coefficients, nan=0.0),
        peaks=peaks,
    )
    failed = found.peaks(
        robot.structure,
        moments.structure,
        grids.structures,
        interpolations.structures,
        library.Settings(),
        batch.structure,
        found.instructions,
    )
    if failed:
        raise MemoryError("no memory to measure plans")
    return ManyPeaks(peaks[:, :motors], peaks[:, motors:] if velocities else None)


@lru_cache(maxsize=8)
def _measured(robot: Robot, ranges: tuple[tuple[float, float], ...], size: int) -> tuple[Filled, Filled]:
    low, high = np.array(ranges).T
    amplitude = (high - low) / 2
    bodies = merged_bodies(robot.tree, (low + high) / 2, amplitude)
    filled = filled_robot(bodies, [size - CONDITIONS] * len(ranges))
    return filled, _filled_moments(robot.tree, bodies, amplitude)


def _filled_moments(tree: PlanarTree, bodies: Bodies, amplitude: Array) -> Filled:
    """Each of the tree's bodies on its own: those that turn alike have motors of their own."""
    group = np.abs(bodies.rotations).argmax(axis=0)
    constant = bodies.rotations.sum(axis=0)
    coupling = (constant.conj()[:, None] * centroidal_coupling(tree)) @ bodies.rotations.T
    coupling[np.arange(len(group)), group] += tree.inertia
    if bodies.is_mirrored:
        coupling = coupling.conj()
    return Filled(
        library.Moments,
        bodies=len(group),
        motors=tree.motor_turns.shape[1],
        group=group,
        real=coupling.real,
        imaginary=coupling.imag,
        turns=tree.motor_turns,
        amplitude=amplitude,
    )


class _Structures:
    """An array of structures with what they point to."""

    def __init__(self, filled: list[Filled]) -> None:
        self._kept = filled
        self.structures = (type(filled[0].structure) * len(filled))(*(each.structure for each in filled))


@lru_cache(maxsize=16)
def _grids(size: int) -> _Structures:
    """Powers of s at the nodes: (14) is not integrated here, so without weights."""
    return _Structures([_filled_grid(nodes, size) for nodes in reference.NODES])


def _filled_grid(nodes: int, size: int) -> Filled:
    value, slope, _ = (part.T for part in reference.powers(nodes, size))
    none = np.zeros((1, nodes))
    return Filled(
        library.Grid,
        nodes=nodes,
        weights=none,
        value=value,
        slope=np.concatenate((none, slope)),
        tail=np.zeros((3, nodes)),
    )


@lru_cache(maxsize=16)
def _interpolations(size: int) -> _Structures:
    return _Structures([_filled_interpolation(nodes, size) for nodes in reference.NODES])


def _filled_interpolation(nodes: int, size: int) -> Filled:
    curvature = reference.powers(nodes, size)[2].T
    to_cosines, to_fine = reference.cosine_maps(nodes)
    return Filled(
        library.Interpolation,
        nodes=nodes,
        points=len(to_fine),
        curvature=np.concatenate((np.zeros((2, nodes)), curvature)),
        to_cosines=to_cosines.T,
        to_fine=to_fine,
    )
