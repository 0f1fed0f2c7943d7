"""A picture of a robot's shapes: the capsules that clearances are measured from, over the geometry that they hold."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.files import write_atomically
from floatplan.robot.robot import Robot
from floatplan.view.postures import stadium
from floatplan.view.style import COLUMN, DPI, INK, OKABE_ITO, legend_above, new_figure, styled

FILL = 0.25  # [-] opacity of a capsule: the geometry shows through
FORMS = (".png", ".svg", ".pdf")
THINNEST = 1e-3  # [m] radius as drawn
FLATTEST, TALLEST = 0.4, 2.5  # [-] height of the picture over its width
LABELS = 0.8  # [inch] beside and below the axes, and above them
PAD = 0.04  # [-] of the picture's size


def check_picture(path: Path, option: str = "--shapes") -> Path:
    """Return the path of a picture; InputError where its name does not end in .png, .svg or .pdf, or is a folder."""
    if path.suffix.lower() not in FORMS or path.is_dir():
        raise InputError(f"must be a file name that ends in {', '.join(FORMS)}, not {path}", element=option)
    return path


def save_shapes(robot: Robot, path: str | Path) -> Path:
    """Draw a robot's shapes in its resting posture into a file, PNG, SVG or PDF by its name."""
    with styled():
        stream = io.BytesIO()
        shapes_picture(robot).savefig(stream, format=Path(path).suffix.lower().lstrip("."), dpi=DPI)
    return write_atomically(path, stream.getvalue())


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
