"""A picture of what joint rates within their limits make of a takeoff: angular momentum and vertical velocity."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from floatplan.errors import InputError
from floatplan.files import write_atomically
from floatplan.motion.planar.reachable import Reachable
from floatplan.view.style import COLUMN, DPI, INK, OKABE_ITO, legend_above, new_figure, styled

HEIGHT = 2.6  # [in]
FILL = 0.25  # [-] opacity
PAD = 0.08  # [-] of the picture's size
ENDS = ("takeoff", "landing")


def save_reachable(sets: dict[str, Reachable], path: str | Path) -> Path:
    """Draw the sets, by end of the flight, into a file, PNG, SVG or PDF by its name.

    Raises
    ------
    InputError
        No set is a polygon.
    """
    with styled():
        stream = io.BytesIO()
        reachable_picture(sets).savefig(stream, format=Path(path).suffix.lower().lstrip("."), dpi=DPI)
    return write_atomically(path, stream.getvalue())


def reachable_picture(sets: dict[str, Reachable]) -> Figure:
    """Draw the polygon of (h, vertical velocity) at each end, at the asked horizontal velocity; a dot is the asked.

    Raises
    ------
    InputError
        No set is a polygon.
    """
    drawn = [(end, found.polygon, found.asked) for end, found in sets.items() if found.polygon is not None]
    if not drawn:
        raise InputError(
            "no frame stands on the ground, or a joint has no velocity limit, so nothing bounds what joint rates reach",
            element="--picture",
            advice="set limits.velocity",
        )
    figure = new_figure(COLUMN, HEIGHT)
    axes = figure.add_subplot()
    entries: list[tuple[object, str]] = []
    for end, polygon, (momentum, speed, height) in drawn:
        colour = OKABE_ITO[ENDS.index(end)]
        axes.add_patch(Polygon(polygon, facecolor=colour, edgecolor=colour, alpha=FILL))
        axes.add_patch(Polygon(polygon, fill=False, edgecolor=colour, linewidth=0.8))
        axes.plot(momentum, height, "o", color=colour, markeredgecolor=INK, markersize=5)
        entries.append(
            (Patch(facecolor=colour, alpha=FILL, edgecolor=colour), f"{end}, at {speed:.3g} m/s horizontally")
        )
    entries.append((Line2D([], [], marker="o", linestyle="", color="white", markeredgecolor=INK), "asked"))
    corners = np.concatenate([points for _, polygon, asked in drawn for points in (polygon, asked[None, [0, 2]])])
    low, high = corners.min(axis=0), corners.max(axis=0)
    pad = PAD * np.maximum(high - low, 1e-9)
    axes.set(xlim=(low[0] - pad[0], high[0] + pad[0]), ylim=(low[1] - pad[1], high[1] + pad[1]))
    axes.set(xlabel="angular momentum (kg m²/s)", ylabel="vertical velocity (m/s)")
    legend_above(figure, entries)
    return figure
