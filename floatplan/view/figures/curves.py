"""Charts as figures: one picture for few curves, small ones for many, each with its own limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, MultipleLocator

from floatplan.plans.plan import Plan
from floatplan.view.charts import NEAR, Chart, Curve, Panel, SampledPlan, clearance_ceiling, is_crowded
from floatplan.view.style import ALARM, COLUMN, GREY, INK, faded, legend_above, new_figure

SAMPLES = 241  # [-] of a curve
HEIGHT = 2.1  # [in]
SECOND_HEIGHT = 1.25  # [in] of an axis added below
ACROSS = 2  # [-] small pictures side by side
ROW_HEIGHT = 0.72  # [in] of them
FRAME_HEIGHT = 0.62  # [in] of their time axis and legend
SMALL = 5.6  # [pt]
LONGEST_NAME = 18  # [letters] of a title
OTHER = 0.75  # [-] strength of a second plan's colours
DASHED: dict[str, Any] = {"linestyle": (0, (2.2, 1.1)), "linewidth": 1.0}
PROVED: dict[str, Any] = {"linestyle": (0, (1, 1.6)), "linewidth": 0.9}
LIMIT: dict[str, Any] = {"linestyle": (0, (9, 3)), "linewidth": 0.7}
RING: dict[str, Any] = {"marker": "o", "linestyle": "none", "clip_on": False, "zorder": 5}
WIDE = {"thinner": 1.0, "start": 3.2, "goal": 4.4, "rim": 1.0}
NARROW = {"thinner": 6 / 7, "start": 2.4, "goal": 3.4, "rim": 0.8}  # of small pictures

Marks = dict[str, Any]  # a legend's entries: name -> handle


def sample(plan: Plan, beside: Plan | None = None) -> SampledPlan:
    """Sample a plan at the instants of the curves, as :meth:`SampledPlan.of`."""
    return SampledPlan.of(plan, np.linspace(0, plan.duration, SAMPLES), beside)


def plan_names(plan: Plan, compare: Plan) -> tuple[str, str]:
    """Return names that distinguish two plans: with and without obstacles, or their problems' names."""
    many, few = len(plan.problem.obstacles), len(compare.problem.obstacles)
    if (many > 0) != (few > 0):
        names = "with obstacle", "without obstacle"
        return names if many else (names[1], names[0])
    if plan.problem.name != compare.problem.name:
        return plan.problem.name, compare.problem.name
    return "this plan", "other plan"


def chart_figure(chart: Chart, sampled: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw a chart, with a second plan's curves dashed; what would flatten the curves is left out."""
    if chart.of_each and is_crowded(sampled.plan):
        return _small_multiples(chart, sampled, other)
    rows = len(chart.panels)
    figure = new_figure(COLUMN, HEIGHT + SECOND_HEIGHT * (rows - 1))
    ratios = [HEIGHT - 0.5] + [SECOND_HEIGHT] * (rows - 1)
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})[:, 0]
    grid[-1].set(xlim=(0, sampled.plan.duration), xlabel="time (s)")
    marks: Marks = {}
    for axes, panel in zip(grid, chart.panels, strict=True):
        marks |= draw_panel(axes, chart, panel, sampled, other)
    shown = chart.curves
    if chart.name == "clearance":
        top = grid[0].get_ylim()[1]
        shown = [
            curve for curve in shown if any(each.columns[curve.key].min() <= top for each in _both(sampled, other))
        ]
    entries = [(Line2D([], [], color=curve.colour, **_stroke(curve)), curve.name) for curve in shown]
    figure.align_ylabels()
    legend_above(figure, [*entries, *((mark, name) for name, mark in marks.items()), *_plan_marks(sampled, other)])
    return figure


def draw_panel(axes: Axes, chart: Chart, panel: Panel, sampled: SampledPlan, other: SampledPlan | None = None) -> Marks:
    """Draw the curves of a panel onto axes with all that belongs to them; return the legend's entries for that."""
    peak = 0.0
    for each in _both(sampled, other):
        style = DASHED if each is other else {}
        for curve in panel.curves:
            if curve.key in each.columns:
                values = chart.factor * each.columns[curve.key]
                colour = faded(curve.colour, OTHER if each is other else 1.0)
                axes.plot(each.times, values, color=colour, **(_stroke(curve) | style))
                peak = max(peak, float(np.abs(values).max()))
    axes.set_ylabel(f"{panel.label} ({chart.unit})")
    if chart.name == "clearance":
        return _frame_clearance(axes, panel, sampled, other)
    if chart.name == "configuration":
        axes.yaxis.set_major_locator(_angle_ticks(axes))
    else:
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    near, _ = panel.limits(peak)
    of_one = len(near) == 1 == len(panel.curves) and np.ptp(near[0][1]) == 0
    marks: Marks = {}
    for curve, limit in near:
        marks |= _draw_limit(axes, sampled, limit, INK if of_one else curve.colour, WIDE)
    for curve in panel.curves:
        marks |= _draw_proved(axes, curve, WIDE) | _draw_ends(axes, chart, curve, sampled.plan, WIDE)
    return marks if chart.interval is None else _draw_interval(axes, *chart.interval, peak)


def _both(sampled: SampledPlan, other: SampledPlan | None) -> list[SampledPlan]:
    """What to draw, the lowest layer first."""
    return [sampled] if other is None else [other, sampled]


def _stroke(curve: Curve) -> dict[str, Any]:
    return {"linestyle": ":"} if curve.dotted else {}


def _plan_marks(sampled: SampledPlan, other: SampledPlan | None) -> list[tuple[Any, str]]:
    """Entries of a legend that tell two plans apart."""
    if other is None:
        return []
    names = plan_names(sampled.plan, other.plan)
    return [(Line2D([], [], color=INK), names[0]), (Line2D([], [], color=faded(INK, OTHER), **DASHED), names[1])]


def _draw_limit(axes: Axes, sampled: SampledPlan, limit: Any, colour: Any, size: dict[str, float]) -> Marks:
    style = _thinner(LIMIT, size)
    for sign in (1, -1):
        axes.plot(sampled.times, sign * np.broadcast_to(limit, sampled.times.shape), color=colour, zorder=1.5, **style)
    return {"limit": Line2D([], [], color=INK, **style)}


def _draw_proved(axes: Axes, curve: Curve, size: dict[str, float]) -> Marks:
    if not np.isfinite(curve.proved):
        return {}
    style = _thinner(PROVED, size)
    for sign in (1, -1):
        axes.axhline(sign * curve.proved, color=faded(curve.colour, 0.6), zorder=1.4, **style)
    return {"proved peak": Line2D([], [], color=INK, **style)}


def _draw_ends(axes: Axes, chart: Chart, curve: Curve, plan: Plan, size: dict[str, float]) -> Marks:
    """A dot where a curve starts and a ring where it should end."""
    if curve.ends is None:
        return {}
    start, goal = chart.factor * curve.ends[0], chart.factor * curve.ends[1]
    ring = {**RING, "markeredgewidth": size["rim"]}
    axes.plot(0, start, color=curve.colour, markersize=size["start"], **ring)
    ring |= {"markersize": size["goal"], "markerfacecolor": "white"}
    axes.plot(plan.duration, goal, color=curve.colour, **ring)
    return {"goal": Line2D([], [], color=INK, **ring)}


def _thinner(style: dict[str, Any], size: dict[str, float]) -> dict[str, Any]:
    return {**style, "linewidth": size["thinner"] * style["linewidth"]}


def _draw_interval(axes: Axes, low: float, high: float, peak: float) -> Marks:
    """The interval (9) of h, where it does not flatten the curves."""
    name = "h of monotonic joints"
    if not max(abs(low), abs(high)) <= NEAR * peak:
        return {f"{name}: {low:.3g} to {high:.3g}": Line2D([], [], linestyle="none")}
    axes.axhspan(low, high, color=faded(INK, 0.08), linewidth=0, zorder=0.4)
    for end in (low, high):
        axes.axhline(end, color=INK, zorder=1.5, **LIMIT)
    return {name: Line2D([], [], color=INK, **LIMIT)}


def _frame_clearance(axes: Axes, panel: Panel, sampled: SampledPlan, other: SampledPlan | None) -> Marks:
    """Cut off what is far away; draw margins, and the least distances that are proved."""
    values = np.array([each.columns[curve.key] for each in _both(sampled, other) for curve in panel.curves])
    top = clearance_ceiling(sampled.plan, values.max(where=np.isfinite(values), initial=0.0))
    bottom = min(1.1 * values.min(), -0.06 * top)
    axes.set(ylim=(bottom, top))
    axes.axhspan(bottom, 0, color=faded(ALARM, 0.12), linewidth=0, zorder=0.4)
    for margin in {obstacle.margin for obstacle in sampled.plan.problem.obstacles}:
        axes.axhline(margin, color=ALARM, zorder=1.5, **LIMIT)
    marks: Marks = {"margin": Line2D([], [], color=ALARM, **LIMIT)}
    for curve in panel.curves:
        if curve.proved <= top:
            axes.axhline(curve.proved, color=curve.colour, zorder=1.6, **PROVED)
            marks["proved minimum"] = Line2D([], [], color=INK, **PROVED)
    return marks


def _angle_ticks(axes: Axes) -> MultipleLocator | MaxNLocator:
    """Degrees are read in steps of 15, 30, 45, 90, 180 or 360."""
    low, high = axes.get_ylim()
    steps = [step for step in (15, 30, 45, 90, 180, 360) if (high - low) / step <= 8]
    return MultipleLocator(steps[0]) if steps else MaxNLocator(6)


def _small_multiples(chart: Chart, sampled: SampledPlan, other: SampledPlan | None) -> Figure:
    """A small picture for each curve; a limit that is too far to be drawn is a number beside the name."""
    rows = -(-len(chart.curves) // ACROSS)
    figure = new_figure(COLUMN, ROW_HEIGHT * rows + FRAME_HEIGHT)
    grid = figure.subplots(rows, ACROSS, sharex=True, squeeze=False)
    marks: Marks = {}
    for axes, curve in zip(grid.T.ravel(), chart.curves, strict=False):
        marks |= _draw_small(axes, chart, curve, sampled, other)
    for axes in grid.T.ravel()[len(chart.curves) :]:
        axes.set_axis_off()
    for column in grid.T:
        last = [axes for axes in column if axes.axison][-1]
        last.tick_params(labelbottom=True)
        last.set(xlim=(0, sampled.plan.duration))
        last.xaxis.set_major_locator(MaxNLocator(4))
    figure.supylabel(chart.unit, fontsize=7)
    figure.supxlabel("time (s)", fontsize=7)
    entries = [*((mark, name) for name, mark in marks.items()), *_plan_marks(sampled, other)]
    if entries:
        legend_above(figure, entries)
    return figure


def _draw_small(axes: Axes, chart: Chart, curve: Curve, sampled: SampledPlan, other: SampledPlan | None) -> Marks:
    name = curve.name if len(curve.name) <= LONGEST_NAME else f"{curve.name[: LONGEST_NAME - 1]}…"
    axes.set_title(name, fontsize=SMALL + 0.6, loc="left", pad=2, color=INK)
    if other is not None and curve.key in other.columns:
        values = chart.factor * other.columns[curve.key]
        axes.plot(other.times, values, color=faded(curve.colour, OTHER), **{**DASHED, "linewidth": 0.9})
    values = chart.factor * sampled.columns[curve.key]
    axes.plot(sampled.times, values, color=curve.colour, linewidth=1.1)
    near, far = Panel("", [curve]).limits(float(np.abs(values).max()))
    marks: Marks = {}
    for _, limit in near:
        marks |= _draw_limit(axes, sampled, limit, INK, NARROW)
    if np.isfinite(far):
        axes.set_title(f"limit {far:.3g}", fontsize=SMALL, loc="right", pad=2, color=GREY)
    marks |= _draw_proved(axes, curve, NARROW) | _draw_ends(axes, chart, curve, sampled.plan, NARROW)
    if curve.ends is None:
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    axes.yaxis.set_major_locator(MaxNLocator(3))
    axes.tick_params(labelsize=SMALL)
    return marks
