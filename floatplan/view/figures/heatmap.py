"""Heat maps: a number over two others, and where there is none, why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from floatplan.arrays import Array, IntArray
from floatplan.view.style import ALARM, SEQUENCE, new_figure, styled

WIDTH, HEIGHT = 4.4, 3.4  # [in]
LOGARITHMIC = 30.0  # times the least colour: where the largest is more, the scale is logarithmic
MANY_DECADES = 3000.0  # times the least colour: where the largest is more, powers of ten alone are told
STATUS_COLOURS = {
    "optimal": "#0072B2",
    "feasible": "#56B4E9",
    "not_found": "#d9d9d9",
    "impossible": "#555555",
    "error": ALARM,
}
STATUS_NAMES = {
    "optimal": "optimal",
    "feasible": "feasible",
    "not_found": "not found: none may exist, or none was hit upon",
    "impossible": "impossible: proved that none exists",
    "error": "error: the problem is wrong there",
}
WITHOUT = ("not_found", "impossible", "error")  # a plan


@dataclass(frozen=True, eq=False)
class MapAxis:
    """An axis: its label, and the edges (cells + 1,) of its cells."""

    label: str
    edges: Array


@dataclass(frozen=True, eq=False)
class HeatMap:
    """What is drawn.

    Attributes
    ----------
    colour : (Y, X), NaN where there is no plan or no value
    status : (Y, X), index into the keys of ``STATUS_COLOURS``; -1 where there is no row
    label : of the colour; "status" where that is what is drawn
    """

    x: MapAxis
    y: MapAxis
    colour: Array
    status: IntArray
    label: str
    title: str = ""


def heatmap(shown: HeatMap) -> Figure:
    """Draw a map."""
    with styled():
        figure = new_figure(WIDTH, HEIGHT)
        axes = figure.add_subplot()
        axes.grid(visible=False)
        names = list(STATUS_COLOURS)
        of_status = shown.label == "status"
        told = [index for index, name in enumerate(names) if of_status or name in WITHOUT]
        present = [index for index in told if (shown.status == index).any()]
        _draw_statuses(axes, shown, present)
        if not of_status:
            _draw_colours(figure, axes, shown)
        axes.set(xlabel=shown.x.label, ylabel=shown.y.label)
        if shown.title:
            axes.set_title(shown.title, fontsize=8)
        if present:
            patches = [Patch(color=STATUS_COLOURS[names[index]]) for index in present]
            labels = [STATUS_NAMES[names[index]] for index in present]
            figure.legend(patches, labels, loc="outside lower left", ncols=1)
        return figure


def _draw_statuses(axes: Axes, shown: HeatMap, present: list[int]) -> None:
    colours = ListedColormap([STATUS_COLOURS[list(STATUS_COLOURS)[index]] for index in present] or ["white"])
    places: npt.NDArray[np.float64] = np.full(shown.status.shape, np.nan)
    for place, index in enumerate(present):
        places[shown.status == index] = place
    axes.pcolormesh(
        shown.x.edges,
        shown.y.edges,
        np.ma.masked_invalid(places),
        cmap=colours,
        vmin=-0.5,
        vmax=len(present) - 0.5,
        rasterized=True,
    )


def _draw_colours(figure: Figure, axes: Axes, shown: HeatMap) -> None:
    finite = shown.colour[np.isfinite(shown.colour)]
    if not finite.size:
        return
    low, high = float(finite.min()), float(finite.max())
    spreads = low > 0 and high > LOGARITHMIC * low
    norm = LogNorm(low, high) if spreads else Normalize(low, high if high > low else low + 1)
    mesh = axes.pcolormesh(
        shown.x.edges, shown.y.edges, np.ma.masked_invalid(shown.colour), cmap=SEQUENCE, norm=norm, rasterized=True
    )
    bar = figure.colorbar(mesh, ax=axes, label=shown.label)
    if spreads:
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < MANY_DECADES * low else (1.0,)))
        bar.ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        bar.ax.yaxis.set_minor_locator(NullLocator())
