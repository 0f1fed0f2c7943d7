"""Curves of the angular momentum: what base and joints have of h, and D of (4), which says what their rates make."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from floatplan.arrays import Array
from floatplan.view.figures.curves.drawing import (
    LIMIT,
    NEAR,
    column_multiples,
    curve_legend,
    draw_columns,
    layers,
    plan_marks,
    time_figure,
)
from floatplan.view.figures.curves.multiples import is_crowded
from floatplan.view.figures.curves.sampled import SampledPlan
from floatplan.view.style import GREY, INK, OKABE_ITO, faded, legend_above

BASE, JOINTS = OKABE_ITO[0], OKABE_ITO[1]
INTERVAL = 0.08  # [-] strength of its colour


def momentum(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw what base and joints have of h over time, kg m^2/s, and the interval (9).

    It holds h of joints that never turn back; where it would flatten the curves, the legend tells it.
    """
    figure, (axes,) = time_figure(flown.plan, 1)
    peak = 0.0
    for each, style, strength in layers(flown, other):
        of_base, h = each.inertia[:, 0] * each.state.orientation_rate, each.state.angular_momentum
        for values, colour in ((of_base, BASE), (h - of_base, JOINTS), (h, INK)):
            axes.plot(each.times, values, color=faded(colour, strength), **style)
            peak = max(peak, float(np.abs(values).max()))
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    axes.set_ylabel("momentum (kg m\N{SUPERSCRIPT TWO}/s)")
    names = ((BASE, "base"), (JOINTS, "joints"), (INK, "h"))
    entries: list[tuple[Any, str]] = [(Line2D([], [], color=colour), name) for colour, name in names]
    legend_above(figure, [*entries, _draw_interval(axes, flown, peak), *plan_marks(flown, other)])
    return figure


def _draw_interval(axes: Axes, flown: SampledPlan, peak: float) -> tuple[Any, str]:
    """Draw the interval (9), if it is near; return the legend's entry."""
    low, high = flown.plan.angular_momentum_bounds
    told = "h of monotonic joints"
    if not max(abs(low), abs(high)) <= NEAR * peak:
        return Line2D([], [], linestyle="none"), f"{told}: {low:.3g} to {high:.3g}"
    axes.axhspan(low, high, color=faded(INK, INTERVAL), linewidth=0, zorder=0.4)
    for end in (low, high):
        axes.axhline(end, color=INK, zorder=1.5, **LIMIT)
    return Line2D([], [], color=INK, **LIMIT), told


def inertia(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw D_0 to D_n of (4) over time, kg m^2: the momentum that each rate of base and joints makes."""
    if is_crowded(flown.plan):
        return column_multiples(flown, other, _inertia, "kg m\N{SUPERSCRIPT TWO}")
    figure, (axes,) = time_figure(flown.plan, 1)
    draw_columns(axes, flown, other, _inertia)
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    axes.set_ylabel("D (kg m\N{SUPERSCRIPT TWO})")
    curve_legend(figure, flown, other)
    return figure


def _inertia(flown: SampledPlan) -> Array:
    return flown.inertia
