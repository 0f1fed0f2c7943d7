"""Pictures of a robot: its shapes, and what joint rates within their limits make of a takeoff."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.files import write_atomically
from floatplan.motion.planar.reachable import Reachable
from floatplan.robot.robot import Robot
from floatplan.view.postures import stadium
from floatplan.view.style import COLUMN, INK, METADATA, OKABE_ITO, legend_above, new_figure, rendered, styled

FILL = 0.25  # [-] opacity of a capsule or polygon: what is behind it shows through
THINNEST = 1e-3  # [m] radius as drawn
FLATTEST, TALLEST = 0.4, 2.5  # [-] height of the picture of shapes over its width
LABELS = 0.8  # [inch] beside and below the axes, and above them
PAD = 0.04  # [-] of that picture's size
REACHABLE_HEIGHT = 2.6  # [in]
REACHABLE_PAD = 0.08  # [-] of that picture's size
ENDS = ("takeoff", "landing")


def check_picture(path: Path, option: str = "--shapes") -> Path:
    """Return the path of a picture; InputError where its name has no known ending, or is a folder."""
    if _form(path) not in METADATA or path.is_dir():
        endings = ", ".join(f".{form}" for form in METADATA)
        raise InputError(f"must be a file name that ends in {endings}, not {path}", element=option)
    return path


def _form(path: str | Path) -> str:
    return Path(path).suffix.lower().lstrip(".")


def save_shapes(robot: Robot, path: str | Path) -> Path:
    """Draw a robot's shapes in its resting posture into a file, PNG, SVG or PDF by its name."""
    with styled():
        return write_atomically(path, rendered(shapes_picture(robot), _form(path)))


def shapes_picture(robot: Robot) -> Figure:
    """Draw capsules (coloured) over collision geometry (thin lines), the base level, joints at rest, m."""
    places = _Places(robot)
    capsules = []
    for shape in robot.shapes:
        start, end = places(shape.body, np.array([shape.start, shape.end]))
        capsules.append(stadium(complex(start), complex(end), max(shape.radius, THINNEST)))
    corners = np.concatenate(capsules)
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, size = (low + high) / 2, high - low
    size[1] = max(size[1], FLATTEST * size[0])
    size[0] = max(size[0], size[1] / TALLEST)
    low, high, pad = middle - size / 2, middle + size / 2, PAD * float(size.max())
    figure = new_figure(COLUMN, LABELS + (COLUMN - LABELS) * float(size[1] / size[0]))
    axes = figure.add_subplot()
    axes.set(xlim=(low[0] - pad, high[0] + pad), ylim=(low[1] - pad, high[1] + pad))
    axes.set(xlabel="horizontal (m)", ylabel="vertical (m)", aspect="equal")
    axes.grid(False)
    _draw(axes, robot, places, capsules)
    entries: list[tuple[Any, str]] = [(Patch(facecolor=OKABE_ITO[0], alpha=FILL, edgecolor=INK), "capsules")]
    entries.append((Line2D([], [], color=INK, linewidth=0.4), "collision geometry"))
    legend_above(figure, entries)
    return figure


def _draw(axes: Axes, robot: Robot, places: _Places, capsules: list[Array]) -> None:
    colours = [OKABE_ITO[shape.body % len(OKABE_ITO)] for shape in robot.shapes]
    axes.add_collection(PolyCollection(capsules, facecolors=colours, alpha=FILL, edgecolors=INK, linewidths=0.5))
    for body, outline in robot.outlines:
        points = places(body, outline.points)
        if outline.radius:
            ends = [stadium(points[a], points[b], outline.radius) for a, b in outline.edges]
            axes.add_collection(PolyCollection(ends, facecolors="none", edgecolors=INK, linewidths=0.4))
        else:
            pairs = points[outline.edges]
            lines = np.stack((pairs.real, pairs.imag), axis=-1)
            axes.add_collection(LineCollection(list(lines), colors=INK, linewidths=0.15))


class _Places:
    """Places in the picture of points in bodies' frames."""

    def __init__(self, robot: Robot) -> None:
        self._tree = robot.tree
        self._rotations = robot.tree.rotations(robot.tree.absolute_angles(np.zeros(1), robot.resting[None]))[0]

    def __call__(self, body: int, points: ComplexArray) -> ComplexArray:
        weights = self._tree.point_weights(np.full(len(points), body), points)
        return np.asarray(weights @ self._rotations)


def save_reachable(sets: dict[str, Reachable], path: str | Path) -> Path:
    """Draw the sets, by end of the flight, into a file, PNG, SVG or PDF by its name.

    Raises
    ------
    InputError
        No set is a polygon.
    """
    with styled():
        return write_atomically(path, rendered(reachable_picture(sets), _form(path)))


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
    figure = new_figure(COLUMN, REACHABLE_HEIGHT)
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
    pad = REACHABLE_PAD * np.maximum(high - low, 1e-9)
    axes.set(xlim=(low[0] - pad[0], high[0] + pad[0]), ylim=(low[1] - pad[1], high[1] + pad[1]))
    axes.set(xlabel="angular momentum (kg m²/s)", ylabel="vertical velocity (m/s)")
    legend_above(figure, entries)
    return figure
