"""What all curves share: axes over the flight, layers of two plans, limits, proved peaks, legend."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.view.figures.curves.multiples import Panel, small_multiples
from floatplan.view.figures.curves.sampled import SampledPlan, plan_names
from floatplan.view.style import COLUMN, INK, faded, legend_above, new_figure, palette

Columns: TypeAlias = Callable[[SampledPlan], Array]  # (N, c)

HEIGHT = 2.1  # [in]
SECOND_HEIGHT = 1.25  # [in] of an axis added below
NEAR = 2.5  # [-] a limit is drawn if it is at most this many times the largest value
DASHED: dict[str, Any] = {"linestyle": (0, (2.2, 1.1)), "linewidth": 1.0}
PROVED: dict[str, Any] = {"linestyle": (0, (1, 1.6)), "linewidth": 0.9}
LIMIT: dict[str, Any] = {"linestyle": (0, (9, 3)), "linewidth": 0.7}
RING: dict[str, Any] = {"marker": "o", "linestyle": "none", "clip_on": False, "zorder": 5, "markeredgewidth": 1.0}


def time_figure(plan: Plan, rows: int) -> tuple[Figure, list[Axes]]:
    """Return a figure of axes over the flight, one below the other, the first the tallest."""
    figure = new_figure(COLUMN, HEIGHT + SECOND_HEIGHT * (rows - 1))
    ratios = [HEIGHT - 0.5] + [SECOND_HEIGHT] * (rows - 1)
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})
    axes = list(grid[:, 0])
    axes[-1].set(xlim=(0, plan.duration), xlabel="time (s)")
    return figure, axes


def layers(flown: SampledPlan, other: SampledPlan | None) -> list[tuple[SampledPlan, dict[str, Any], float]]:
    """What to draw, the lowest layer first: flight, line style, strength of its colours."""
    own: tuple[SampledPlan, dict[str, Any], float] = (flown, {}, 1.0)
    return [own] if other is None else [(other, DASHED, 0.75), own]


def draw_columns(axes: Axes, flown: SampledPlan, other: SampledPlan | None, values: Columns, first: int = 0) -> float:
    """Draw one curve per column of ``values`` in its part's colour; return the largest magnitude."""
    colours = palette(len(flown.plan.robot.joints) + 1)[first:]
    peak = 0.0
    for each, style, strength in layers(flown, other):
        columns = values(each)
        peak = max(peak, float(np.abs(columns).max()))
        for column, colour in zip(columns.T, colours, strict=False):
            axes.plot(each.times, column, color=faded(colour, strength), **style)
    return peak


def draw_limits(
    axes: Axes, flown: SampledPlan, limits: Array, peak: float, colours: Sequence[Any] | None = None
) -> list[tuple[Any, str]]:
    """Draw limits (r,), or (N, r) over time, on both sides, unless so far away that they would flatten the curves.

    Returns the legend's entries.
    """
    mark: list[tuple[Any, str]] = []
    over_time = np.broadcast_to(limits, (len(flown.times), limits.shape[-1]))
    same = bool(np.all(over_time == over_time[:1, :1]))
    colours = palette(over_time.shape[1] + 1)[1:] if colours is None else colours
    for column, colour in zip(over_time.T[:1] if same else over_time.T, [INK] if same else colours, strict=False):
        if float(column.min()) <= NEAR * peak:
            for sign in (1, -1):
                axes.plot(flown.times, sign * column, color=colour, zorder=1.5, **LIMIT)
            mark = [(Line2D([], [], color=INK, **LIMIT), "limit")]
    return mark


def draw_proved_peaks(axes: Axes, peaks: Sequence[float], colours: Sequence[Any]) -> list[tuple[Any, str]]:
    """Draw, on both sides, the peaks that the certificate proves; return the legend's entry."""
    known = [(peak, colour) for peak, colour in zip(peaks, colours, strict=False) if np.isfinite(peak)]
    for peak, colour in known:
        for sign in (1, -1):
            axes.axhline(sign * peak, color=faded(colour, 0.6), zorder=1.4, **PROVED)
    return [(Line2D([], [], color=INK, **PROVED), "proved peak")] if known else []


def column_multiples(
    flown: SampledPlan,
    other: SampledPlan | None,
    values: Columns,
    unit: str,
    limits: Array | None = None,
    proved: Array | None = None,
    ends: Sequence[Array] | None = None,
) -> Figure:
    """Small pictures of the columns of ``values``: the last of base and joints."""
    columns = values(flown).T
    others = None if other is None else values(other).T
    names = ("orientation", *flown.plan.robot.joints)[-len(columns) :]
    colours = palette(len(flown.plan.robot.joints) + 1)[-len(columns) :]
    panels = [
        Panel(
            name,
            colours[index],
            columns[index],
            None if others is None else others[index],
            np.inf if limits is None else float(limits[index]),
            np.inf if proved is None else float(proved[index]),
            None if ends is None else (float(ends[0][index]), float(ends[1][index])),
        )
        for index, name in enumerate(names)
    ]
    return small_multiples(flown.times, None if other is None else other.times, panels, unit, plan_marks(flown, other))


def curve_legend(
    figure: Figure, flown: SampledPlan, other: SampledPlan | None, extra: Sequence[tuple[Any, str]] = (), first: int = 0
) -> None:
    """Put a legend of base and joints above all axes, from part ``first`` on, with more entries."""
    names = ("orientation", *flown.plan.robot.joints)[first:]
    colours = palette(len(flown.plan.robot.joints) + 1)[first:]
    entries = [(Line2D([], [], color=colour), name) for colour, name in zip(colours, names, strict=True)]
    legend_above(figure, [*entries, *extra, *plan_marks(flown, other)])


def plan_marks(flown: SampledPlan, other: SampledPlan | None) -> list[tuple[Any, str]]:
    """Entries of a legend that tell two plans apart."""
    if other is None:
        return []
    names = plan_names(flown.plan, other.plan)
    return [(Line2D([], [], color=INK), names[0]), (Line2D([], [], color=faded(INK, 0.75), **DASHED), names[1])]
