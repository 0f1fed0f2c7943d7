"""Pictures of a robot: its shapes, and what joint rates within their limits make of a takeoff."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from floatplan.errors import InputError
from floatplan.files import write_atomically
from floatplan.motion.flight import Reachable
from floatplan.robot.robot import Robot
from floatplan.view.figures.snapshots import spatial_figure
from floatplan.view.outlines import body_poses, box_around, pairs, stadium
from floatplan.view.style import COLUMN, INK, METADATA, OKABE_ITO, legend_above, new_figure, picture

FILL = 0.25  # [-] opacity of a capsule or polygon: lines behind it show through


def save_picture(path: Path, option: str, draw: Callable[[Any], Figure], about: Any) -> Path:
    """Write a figure into a file, PNG, SVG or PDF by its name; a function renders it.

    Raises
    ------
    InputError
        The name, the value of an ``option``, has none of these endings, or is a folder's; errors of the function.
    """
    form = path.suffix.lower().lstrip(".")
    if form not in METADATA or path.is_dir():
        endings = ", ".join(f".{ending}" for ending in METADATA)
        raise InputError(f"must be a file name that ends in {endings}, not {path}", element=option)
    return write_atomically(path, picture(form, draw, about))


def shapes_picture(robot: Robot) -> Figure:
    """Draw capsules (coloured) over collision geometry (thin lines), the base level, joints at zero, m."""
    poses = body_poses(robot, np.zeros(1), robot.resting[None], np.zeros(1, dtype=np.complex128))
    capsules = []
    colours = []
    for shape in robot.shapes:
        start, end = poses.points([shape.body] * 2, [shape.start, shape.end])[0].tolist()
        capsules.append(stadium(start, end, max(shape.radius, 1e-3)))  # [m] what has no thickness is visible, too
        colours.append(OKABE_ITO[shape.body % len(OKABE_ITO)])
    figure, axes = spatial_figure(*box_around(np.concatenate(capsules), 0.04))
    look: dict[str, Any] = {"edgecolors": INK, "linewidths": 0.5}
    axes.add_collection(PolyCollection([*map(pairs, capsules)], facecolors=colours, alpha=FILL, **look))
    for body, outline in robot.outlines:
        edges = poses.points([body] * len(outline.points), outline.points)[0][outline.edges]
        if outline.radius:
            rims = [pairs(stadium(start, end, outline.radius)) for start, end in edges.tolist()]
            axes.add_collection(PolyCollection(rims, facecolors="none", edgecolors=INK, linewidths=0.4))
        else:
            axes.add_collection(LineCollection(list(pairs(edges)), colors=INK, linewidths=0.15))
    patch = Patch(facecolor=OKABE_ITO[0], alpha=FILL, edgecolor=INK)
    legend_above(figure, [(patch, "capsules"), (Line2D([], [], color=INK, linewidth=0.4), "collision geometry")])
    return figure


def reachable_picture(sets: dict[str, Reachable]) -> Figure:
    """Draw the polygon of (h, vertical velocity) at each end, at the desired horizontal velocity; a dot is desired.

    Raises
    ------
    InputError
        No set is a polygon.
    """
    if all(reachable.polygon is None for reachable in sets.values()):
        raise InputError(
            "no frame stands on the ground, or a joint has no velocity limit, so nothing bounds what joint rates reach",
            element="--picture",
            advice="set limits.velocity",
        )
    figure = new_figure(COLUMN, 2.6)  # [in] high enough for two polygons and their legend
    axes = figure.add_subplot()
    entries: list[tuple[object, str]] = []
    for end, reachable in sets.items():
        polygon = reachable.polygon
        if polygon is None:
            continue
        momentum, speed, height = reachable.asked
        colour = OKABE_ITO[("takeoff", "landing").index(end)]
        axes.add_patch(Polygon(polygon, facecolor=colour, edgecolor=colour, alpha=FILL))
        axes.add_patch(Polygon(polygon, fill=False, edgecolor=colour, linewidth=0.8))
        axes.plot(momentum, height, "o", color=colour, markeredgecolor=INK, markersize=5)
        patch = Patch(facecolor=colour, alpha=FILL, edgecolor=colour)
        entries.append((patch, f"{end}, at {speed:.3g} m/s horizontally"))
    entries.append((Line2D([], [], marker="o", linestyle="", color="white", markeredgecolor=INK), "desired"))
    axes.margins(0.08)
    axes.set(xlabel="angular momentum (kg m²/s)", ylabel="vertical velocity (m/s)")
    legend_above(figure, entries)
    return figure
