"""Curves of robots with many joints: a small picture for each, with its own limits, instead of one full of curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.view.style import COLUMN, GREY, INK, OKABE_ITO, faded, legend_above, new_figure

ACROSS = 2  # [-] pictures side by side
ROW_HEIGHT = 0.72  # [in]
FRAME_HEIGHT = 0.62  # [in] of time axis and legend
SMALL = 5.6  # [pt]
LONGEST_NAME = 18  # [letters] of a title
NEAR = 2.5  # [-] a limit is drawn if it is at most this many times the curve's largest value
LIMIT: dict[str, Any] = {"linestyle": (0, (9, 3)), "linewidth": 0.6, "color": INK, "zorder": 1.5}
PROVED: dict[str, Any] = {"linestyle": (0, (1, 1.6)), "linewidth": 0.8, "zorder": 1.4}
DASHED: dict[str, Any] = {"linestyle": (0, (2.2, 1.1)), "linewidth": 0.9}
RING: dict[str, Any] = {"marker": "o", "linestyle": "none", "clip_on": False, "zorder": 5, "markeredgewidth": 0.8}


@dataclass(frozen=True, eq=False)
class Panel:
    """One small picture.

    Attributes
    ----------
    name : of the joint
    colour : of its curve
    values : (N,)
    other : (M,), optional, of a second plan
    limit : (N,), on both sides; infinite where there is none
    proved : the peak that is proved; infinite where none is
    ends : start and goal, optional
    """

    name: str
    colour: Array
    values: Array
    other: Array | None = None
    limit: Array | float = np.inf
    proved: float = np.inf
    ends: tuple[float, float] | None = None


def is_crowded(plan: Plan) -> bool:
    """Whether a robot has more parts than there are hues that everyone can tell apart."""
    return len(plan.robot.joints) + 1 > len(OKABE_ITO)


def small_multiples(
    times: Array, other_times: Array | None, panels: Sequence[Panel], unit: str, marks: Sequence[tuple[Any, str]] = ()
) -> Figure:
    """Draw the panels; a limit that is too far to be drawn is a number beside the name."""
    rows = -(-len(panels) // ACROSS)
    figure = new_figure(COLUMN, ROW_HEIGHT * rows + FRAME_HEIGHT)
    grid = figure.subplots(rows, ACROSS, sharex=True, squeeze=False)
    entries: dict[str, Any] = {}
    for axes, panel in zip(grid.T.ravel(), panels, strict=False):
        entries |= _draw(axes, panel, times, other_times)
    for axes in grid.T.ravel()[len(panels) :]:
        axes.set_axis_off()
    for column in grid.T:
        last = [axes for axes in column if axes.axison][-1]
        last.tick_params(labelbottom=True)
        last.set(xlim=(0, times[-1]))
        last.xaxis.set_major_locator(MaxNLocator(4))
    figure.supylabel(unit, fontsize=7)
    figure.supxlabel("time (s)", fontsize=7)
    legend = [(handle, name) for name, handle in entries.items()] + list(marks)
    if legend:
        legend_above(figure, legend)
    return figure


def _draw(axes: Axes, panel: Panel, times: Array, other_times: Array | None) -> dict[str, Any]:
    """Draw a panel; return the legend's entries."""
    entries: dict[str, Any] = {}
    name = panel.name if len(panel.name) <= LONGEST_NAME else f"{panel.name[: LONGEST_NAME - 1]}\N{HORIZONTAL ELLIPSIS}"
    axes.set_title(name, fontsize=SMALL + 0.6, loc="left", pad=2, color=INK)
    if panel.other is not None and other_times is not None:
        axes.plot(other_times, panel.other, color=faded(panel.colour, 0.75), **DASHED)
    axes.plot(times, panel.values, color=panel.colour, linewidth=1.1)
    limit = np.broadcast_to(panel.limit, times.shape)
    peak = float(np.abs(panel.values).max())
    if float(limit.min()) <= NEAR * peak:
        for sign in (1, -1):
            axes.plot(times, sign * limit, **LIMIT)
        entries["limit"] = Line2D([], [], **LIMIT)
    elif np.isfinite(limit).any():
        axes.set_title(f"limit {limit.min():.3g}", fontsize=SMALL, loc="right", pad=2, color=GREY)
    if np.isfinite(panel.proved):
        for sign in (1, -1):
            axes.axhline(sign * panel.proved, color=faded(panel.colour, 0.6), **PROVED)
        entries["proved peak"] = Line2D([], [], color=INK, **PROVED)
    if panel.ends is not None:
        start, goal = panel.ends
        axes.plot(0, start, color=panel.colour, markersize=2.4, **RING)
        axes.plot(times[-1], goal, color=panel.colour, markersize=3.4, markerfacecolor="white", **RING)
        entries["goal"] = Line2D([], [], color=INK, markersize=3.4, markerfacecolor="white", **RING)
    else:
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    axes.yaxis.set_major_locator(MaxNLocator(3))
    axes.tick_params(labelsize=SMALL)
    return entries
