"""What the kernel is given of flights in space, to follow starts of them: ``spatial_flight.hpp``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Pointer, Struct, StructArray, doubles, integers
from floatplan.kernel.tolerances import CONSTRAINED_SETTINGS, EXCHANGE_IN_SPACE, WORK_IN_SPACE
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import Form, basis
from floatplan.motion.spatial.attitude import LEVELS, TOLERANCES, Cells, cells
from floatplan.motion.spatial.clearance import SpatialShapes
from floatplan.motion.spatial.flight import SLOWEST, SpatialFlight
from floatplan.planning.kernel_input.rows import Block, DistanceRows, KernelRows, Sums
from floatplan.tables import A_TURN_OFF, LARGEST_MIDDLE_ANGLE


class SpatialRows(KernelRows):
    """Rows of a flight in space.

    Attributes
    ----------
    path : (7,)
        Of the centre of mass: place, velocity, gravity.
    """

    def __init__(self, flight: SpatialFlight, blocks: Sequence[Block], also: str = "") -> None:
        compiled = kernel()
        self.follow_starts = compiled.attempt_in_space
        self.evaluate = compiled.evaluate_in_space
        self.bodies = flight.bodies
        self.work_of_body = WORK_IN_SPACE
        self.node_counts = flight.node_counts
        self.settings = CONSTRAINED_SETTINGS
        self.rules = replace(EXCHANGE_IN_SPACE, watched_at_most=len(flight.node_counts) - 1)
        self.nodes = nodes_in_space
        self._flight = flight
        self._bodies: dict[MomentumSet, Struct] = {}
        needs_places = any(isinstance(block, DistanceRows) for block in blocks)
        shapes = flight.link_shapes if needs_places else None
        path = flight.ballistics
        self.path = doubles([*path.position0, *path.velocity0, path.gravity])
        places = {
            "needs_places": needs_places,
            "turn": 1.0,
            "path": self.path,
            "ends_real": None,
            "ends_imaginary": None,
            **_shapes(shapes),
        }
        super().__init__(Sums(flight.dynamics.selection, flight.transmission), blocks, also, places, shapes)
        self.needs_rates |= needs_places

    def flying(self, momentum: MomentumSet) -> tuple[Pointer, ...]:
        """Return what flies, with an angular momentum of a set, and the cells of all levels."""
        if momentum not in self._bodies:
            self._bodies[momentum] = spatial_body(self._flight, momentum, self.needs_rates)
        return self._bodies[momentum].pointer, cells_of_levels().pointer


def _shapes(shapes: SpatialShapes | None) -> dict[str, Any]:
    """Return the capsules of the links, and the hulls among them; none where nothing is about places."""
    if shapes is None:
        arrays = ("body", "ends", "radius", "hull_first", "hull_points", "hull_axes")
        return {"capsules": 0, "hulls": 0, **dict.fromkeys(arrays)}
    points = [hull.points for hull in shapes.hulls]
    return {
        "capsules": len(shapes.radius),
        "body": integers(shapes.body - 1),  # the base is the model's first joint
        "ends": doubles(shapes.ends),
        "radius": doubles(shapes.radius),
        "hulls": len(shapes.hulls),
        "hull_first": integers(np.cumsum([0, *map(len, points)])),
        "hull_points": doubles(np.concatenate([np.empty((0, 3)), *points])),
        "hull_axes": doubles([hull.axes.T for hull in shapes.hulls]),
    }


def spatial_body(flight: SpatialFlight, momentum: MomentumSet, needs_rates: bool) -> Struct:
    """Return the tree with its planned joints, attitudes at both ends, and the angular momentum."""
    selection = flight.dynamics.selection
    axes = flight.reorientation.goal.axes
    tree_joint, planned = selection.nonzero()
    return Struct(
        "SpatialBody",
        tree=flight.dynamics.tree,
        joints=selection.shape[1],
        first=integers(np.searchsorted(tree_joint, np.arange(len(selection) + 1))),
        planned=integers(planned),
        ratio=doubles(selection[tree_joint, planned]),
        reference=doubles(flight.dynamics.reference),
        start=doubles(flight.initial_attitude),
        goal=doubles(flight.final_attitude),
        angles=None if axes is None else integers(list(map("xyz".index, axes))),
        change=doubles(flight.reorientation.change),
        wrong_turn=A_TURN_OFF,
        most_tilt=LARGEST_MIDDLE_ANGLE,
        slowest=SLOWEST,
        momentum=doubles(momentum.centre),
        axes=doubles(momentum.axes),
        needs_rates=needs_rates,
        sweeps=int(TOLERANCES["sweeps"]),
        settled=TOLERANCES["settled"],
        largest=TOLERANCES["largest"],
    )


@cache
def cells_of_levels() -> StructArray:
    """Return the cells of all levels."""
    return StructArray([struct_of_cells(cells(*level)) for level in LEVELS])


def struct_of_cells(of: Cells) -> Struct:
    """Return cells as the kernel sees them."""
    gauss = of.gauss
    return Struct(
        "Cells",
        cells=of.count,
        stages=of.stages,
        integrals=doubles(of.integrals),
        weights=doubles(gauss.weights),
        tail=doubles(gauss.transform[-2:]),
        antiderivative=doubles(gauss.antiderivative),
    )


@lru_cache(maxsize=32)
def nodes_in_space(form: Form) -> StructArray:
    """Return the stages of all levels, for motions of a form."""
    levels = []
    for level in LEVELS:
        of_level = cells(*level)
        weights = np.tile(of_level.gauss.weights, of_level.count) / of_level.count
        levels.append(_nodes(of_level.s, weights, form))
    return StructArray(levels)


@lru_cache(maxsize=64)
def cells_and_stages(of: Cells, form: Form) -> tuple[Struct, Struct]:
    """Return cells, and their stages for motions of a form: stage by stage, those of all cells side by side."""
    s = of.s.reshape(of.count, of.stages).T.ravel()
    weights = np.repeat(of.gauss.weights, of.count) / of.count
    return struct_of_cells(of), _nodes(s, weights, form)


def _nodes(s: Array, weights: Array, form: Form) -> Struct:
    value, first, second = basis(form).values(s)
    return Struct(
        "Nodes",
        nodes=len(s),
        s=doubles(s),
        weights=doubles(weights),
        tail=None,  # those of the cells count
        value=doubles(value.T),
        first=doubles(first.T),
        second=doubles(second.T),
        integrals=None,
        antiderivative=None,
    )
