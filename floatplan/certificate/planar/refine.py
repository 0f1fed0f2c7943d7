"""Cells of time fine enough for the models on them to be sharp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, IntArray
from floatplan.certificate.cells import Cells
from floatplan.certificate.planar.flight import FlightEnclosure, Joints, assemble, joint_models, merge
from floatplan.certificate.planar.inertia import PlanarRobot
from floatplan.plans.record import PlanRecord

BoolArray: TypeAlias = npt.NDArray[np.bool_]

FIRST_CELLS = 24
SHORTEST = 1e-12  # [-] of the flight: no cell is shorter, so that no half length underflows
ORIENTATION_RADIUS = 1e-10  # [rad] sought for the orientation at the end
TORQUE_RADIUS = 1e-9  # [-] sought, relative to the largest torque


def fly(robot: PlanarRobot, record: PlanRecord, windows: Sequence[tuple[float, float]], budget: int) -> FlightEnclosure:
    """Enclose the whole flight on cells that end where the windows, which lie within it, do.

    Cells are halved until their share of the orientation's radius and their torques' radii are as small as sought, or
    the ``budget`` of cells is spent.
    """
    duration = record.duration
    grid = np.arange(FIRST_CELLS + 1) * (duration / FIRST_CELLS)
    grid[-1] = duration
    edges = sorted({*grid.tolist(), *(end for window in windows for end in window)})
    low, high = _cells_between(edges, {first for first, last in windows if first == last})
    done: list[tuple[Cells, Joints]] = []
    count = 0
    while True:
        cells = Cells.between(low, high)
        joints = joint_models(robot, record, cells)
        coarse = _coarse(joints, duration)
        middle = 0.5 * (low + high)
        coarse &= (low < middle) & (middle < high)
        if count + len(low) + coarse.sum() > budget:
            coarse[:] = False
        if not done and not coarse.any():
            return assemble(record, cells, joints)
        fine = np.flatnonzero(~coarse)
        done.append((Cells.between(low[fine], high[fine]), _take(joints, fine)))
        count += len(fine)
        if not coarse.any():
            break
        low, middle, high = low[coarse], middle[coarse], high[coarse]
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return assemble(record, *merge(done))


def _cells_between(edges: list[float], instants: set[float]) -> tuple[Array, Array]:
    """Ends of the cells between rising edges, and of those that are but one of these instants."""
    ends = np.array(sorted([*edges, *instants]))
    return ends[:-1], ends[1:]


def _coarse(joints: Joints, duration: float) -> BoolArray:
    torque = np.fmax.reduce(joints.motor_torques.size, axis=None, initial=1e-12)
    rate_sharp = joints.rate.e[:, 0] * duration <= ORIENTATION_RADIUS
    torque_sharp = (joints.motor_torques.e <= TORQUE_RADIUS * torque).all(axis=-1)
    return np.asarray(~(rate_sharp & torque_sharp))


def _take(joints: Joints, cells: IntArray) -> Joints:
    return Joints(**{each.name: getattr(joints, each.name)[cells] for each in fields(Joints)})
