"""The figures of a plan, by name, and their files: the moving robot, and charts over time.

A chart of few curves is one picture; of many, small ones, each with its own limits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from floatplan.errors import InputError
from floatplan.files import write_atomically
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.view.charts import INTERVAL, Chart, Panel, charts, is_crowded, largest
from floatplan.view.figures.snapshots import comparison, kinogram, moments, plan_names, snapshots
from floatplan.view.sampled import SampledPlan
from floatplan.view.style import ALARM, COLUMN, GREY, INK, METADATA, faded, legend_above, new_figure, rendered, styled

SAMPLES = 241  # [-] of a curve
HEIGHT = 2.1  # [in]
SECOND_HEIGHT = 1.25  # [in] of an axis added below
ACROSS = 2  # [-] small pictures side by side
ROW_HEIGHT = 0.72  # [in] of them
FRAME_HEIGHT = 0.62  # [in] of their time axis and legend
SMALL = 5.6  # [pt]
THINNER = 0.8  # [-] their lines and marks
FLYING: dict[str, Any] = {"color": "#f0f0f0", "linewidth": 0}
BAND = 6.0  # [pt] of what is there or not
LONGEST_NAME = 18  # [letters] of a title
OTHER = 0.75  # [-] strength of a second plan's colours
DASHED: dict[str, Any] = {"linestyle": (0, (2.2, 1.1)), "linewidth": 1.0}
PROVED: dict[str, Any] = {"linestyle": (0, (1, 1.6)), "linewidth": 0.9, "zorder": 1.4}
LIMIT: dict[str, Any] = {"linestyle": (0, (9, 3)), "linewidth": 0.7, "zorder": 1.5}
START: dict[str, Any] = {
    "marker": "o",
    "linestyle": "none",
    "clip_on": False,
    "zorder": 5,
    "markersize": 3.2,
    "markeredgewidth": 1.0,
}
GOAL: dict[str, Any] = {**START, "markersize": 4.4, "markerfacecolor": "white"}

Marks = dict[str, Any]  # a legend's entries: name -> handle


def figures(plan: Trajectory, *, compare: Plan | None = None) -> dict[str, Figure]:
    """Draw the figures of a plan, or of a jump.

    Parameters
    ----------
    plan : Plan or Jump
    compare : Plan, optional
        A second plan for the same joints, such as one made without the obstacle; its curves are dashed.

    Returns
    -------
    dict of str to Figure
        "snapshots" (the robot along the path of its centre of mass, m) and "kinogram" (side by side); over time
        "configuration" (degrees), "rates" (rad/s), what else of the joints' motion the problem limits, such as
        "accelerations", "torques" (N m), "momentum" (what base and joints have of h, and the interval (9), kg m^2/s),
        "inertia" (D of (4), kg m^2), with obstacles "clearance" (m); with ``compare`` "comparison" (both plans'
        robots, m). Of a jump: "moments" (a strip of six, with forces); over time "forces" (N), "friction",
        "torque_use", "curve_use", "held_use", "rate_use" (shares of limits, %), "com_height" (m), "configuration".

    Raises
    ------
    InputError
        ``compare`` plans other joints.
    """
    with styled():
        return dict(_drawn(plan, compare))


def save_figures(
    plan: Trajectory, directory: str | Path, *, compare: Plan | None = None, formats: Sequence[str] = ("png", "svg")
) -> list[Path]:
    """Write each figure of :func:`figures` into a directory as ``<name>.<format>``, each whole or not at all.

    Files of the same plan are the same to the last byte.

    Parameters
    ----------
    formats : sequence of "png", "svg", "pdf"

    Raises
    ------
    InputError
        A format is unknown, or ``compare`` plans other joints.
    """
    for name in formats:
        if name not in METADATA:
            raise InputError(f"must be among {', '.join(METADATA)}, not {name!r}", element="formats")
    with styled():
        return [
            write_atomically(Path(directory) / f"{name}.{form}", rendered(figure, form))
            for name, figure in _drawn(plan, compare)
            for form in formats
        ]


def _drawn(plan: Trajectory, compare: Plan | None) -> Iterator[tuple[str, Figure]]:
    if compare is not None and isinstance(plan, JumpMotion):
        raise InputError("a jump is not compared", element="compare", advice="compare plans, such as its flight's")
    if compare is not None and compare.robot.joints != plan.robot.joints:
        joints = ", ".join(compare.robot.joints)
        reason = f"plans {joints}, not {', '.join(plan.robot.joints)}"
        raise InputError(reason, element="compare", advice="give a plan for the same joints")
    if compare is not None and (compare.robot.in_plane is None) != (plan.robot.in_plane is None):
        raise InputError("one plan flies in space, the other in a plane", element="compare", advice="compare two alike")
    sampled = sample(plan)
    other = None if compare is None else sample(compare, plan)
    if isinstance(plan, JumpMotion):
        yield "moments", moments(plan)
    elif isinstance(plan, Plan):
        yield "snapshots", snapshots(plan)
        yield "kinogram", kinogram(plan)
    for chart in charts(sampled, other):
        yield chart.name, chart_figure(chart, sampled, other)
    if isinstance(plan, Plan) and compare is not None:
        yield "comparison", comparison(plan, compare)


def sample(plan: Trajectory, beside: Trajectory | None = None) -> SampledPlan:
    """Sample a plan at the instants of the curves, as :meth:`SampledPlan.of`."""
    return SampledPlan.of(plan, np.linspace(0, plan.duration, SAMPLES), beside)


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
    entries: list[tuple[Any, str]] = []
    for axes, panel in reversed(list(zip(grid, chart.panels, strict=True))):
        marks |= draw_panel(axes, chart, panel, sampled, other)
        for curve in panel.curves:
            known = [each.columns[curve.key] for each in _both(sampled, other) if curve.key in each.columns]
            if chart.factor * min(map(np.fmin.reduce, known)) <= axes.get_ylim()[1]:
                entries.append((Line2D([], [], color=curve.colour, linestyle=curve.linestyle), curve.name))
    figure.align_ylabels()
    legend_above(figure, [*entries, *((mark, name) for name, mark in marks.items()), *_plan_marks(sampled, other)])
    return figure


def _small_multiples(chart: Chart, sampled: SampledPlan, other: SampledPlan | None) -> Figure:
    """A small picture for each curve; a limit that is too far to be drawn is a number beside the name."""
    rows = -(-len(chart.curves) // ACROSS)
    figure = new_figure(COLUMN, ROW_HEIGHT * rows + FRAME_HEIGHT)
    grid = figure.subplots(rows, ACROSS, sharex=True, squeeze=False)
    marks: Marks = {}
    for axes, curve in zip(grid.T.ravel(), chart.curves, strict=False):
        name = curve.name if len(curve.name) <= LONGEST_NAME else f"{curve.name[: LONGEST_NAME - 1]}…"
        axes.set_title(name, fontsize=SMALL + 0.6, loc="left", pad=2, color=INK)
        marks |= draw_panel(axes, chart, replace(chart.panels[0], label="", curves=[curve]), sampled, other, THINNER)
        axes.yaxis.set_major_locator(MaxNLocator(3))
        axes.tick_params(labelsize=SMALL)
    for axes in grid.T.ravel()[len(chart.curves) :]:
        axes.set_axis_off()
    lasts = [axes for column in grid.T for axes in [each for each in column if each.axison][-1:]]
    for last in lasts:
        last.tick_params(labelbottom=True)
        last.set(xlim=(0, sampled.plan.duration))
        last.xaxis.set_major_locator(MaxNLocator(4))
    figure.supylabel(chart.unit, fontsize=7)
    figure.supxlabel("time (s)", fontsize=7)
    entries = [*((mark, name) for name, mark in marks.items()), *_plan_marks(sampled, other)]
    if entries:
        legend_above(figure, entries)
    return figure


def draw_panel(
    axes: Axes, chart: Chart, panel: Panel, sampled: SampledPlan, other: SampledPlan | None = None, thinner: float = 1.0
) -> Marks:
    """Draw the curves of a panel onto axes with all that belongs to them; return the legend's entries for that."""

    def scaled(style: dict[str, Any]) -> dict[str, Any]:
        return {name: thinner * size if name.endswith(("width", "size")) else size for name, size in style.items()}

    peak = 0.0
    width = 1.3 if chart.unit else BAND
    marks: Marks = {}
    if isinstance(sampled.plan, JumpMotion):
        axes.axvspan(*sampled.plan.flight_span, zorder=0.3, **FLYING)
        marks["in flight"] = Patch(**FLYING)
    for each in _both(sampled, other):
        for curve in panel.curves:
            if curve.key in each.columns:
                values = chart.factor * each.columns[curve.key]
                style = DASHED if each is other else {"linestyle": curve.linestyle, "linewidth": width}
                colour = faded(curve.colour, OTHER if each is other else 1.0)
                axes.plot(each.times, values, color=colour, **scaled(style))
                peak = max(peak, largest(values))
    if panel.label:
        axes.set_ylabel(f"{panel.label} ({chart.unit})")
    if panel.range is not None:
        axes.set(ylim=panel.range)
        axes.axhspan(panel.range[0], 0, color=faded(ALARM, 0.12), linewidth=0, zorder=0.4)
    elif chart.unit == "deg":
        axes.yaxis.set_major_locator(_angle_ticks(axes))
    elif not chart.unit:
        axes.set_yticks([])
    else:
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    drawn, left = panel.lines(peak / chart.factor)
    for line in drawn:
        style = scaled(LIMIT) | {"color": line.colour if line.part is None or len(panel.curves) > 1 else INK}
        if np.ndim(line.value):
            axes.plot(sampled.times, chart.factor * np.broadcast_to(line.value, sampled.times.shape), **style)
        else:
            axes.axhline(chart.factor * float(line.value), **style)
        marks[line.name] = Line2D([], [], **style | {"color": line.colour if line.part is None else INK})
    if panel.interval is not None:
        low, high = panel.interval
        if left:
            marks[f"{INTERVAL}: {low:.3g} to {high:.3g}"] = Line2D([], [], linestyle="none")
        else:
            axes.axhspan(low, high, color=faded(INK, 0.08), linewidth=0, zorder=0.4)
    elif thinner < 1.0 and left:
        axes.set_title(f"limit {np.min(left[0].value):.3g}", fontsize=SMALL, loc="right", pad=2, color=GREY)
    for curve in panel.curves:
        if curve.proved < np.inf if panel.range is None else curve.proved <= panel.range[1]:
            for side in (1, -1) if panel.range is None else (1,):
                axes.axhline(side * curve.proved, color=faded(curve.colour, 0.6), **scaled(PROVED))
            name = "proved peak" if panel.range is None else "proved minimum"
            marks[name] = Line2D([], [], color=INK, **scaled(PROVED))
        if curve.ends is not None:  # a dot where it starts and a ring where it should end
            start, goal = chart.factor * np.array(curve.ends)
            axes.plot(0, start, color=curve.colour, **scaled(START))
            axes.plot(sampled.plan.duration, goal, color=curve.colour, **scaled(GOAL))
            marks["goal"] = Line2D([], [], color=INK, **scaled(GOAL))
    return marks


def _both(sampled: SampledPlan, other: SampledPlan | None) -> list[SampledPlan]:
    """What to draw, the lowest layer first."""
    return [sampled] if other is None else [other, sampled]


def _plan_marks(sampled: SampledPlan, other: SampledPlan | None) -> list[tuple[Any, str]]:
    """Entries of a legend that tell two plans apart."""
    if other is None:
        return []
    names = plan_names(sampled.plan, other.plan)
    return [(Line2D([], [], color=INK), names[0]), (Line2D([], [], color=faded(INK, OTHER), **DASHED), names[1])]


def _angle_ticks(axes: Axes) -> MultipleLocator | MaxNLocator:
    """Degrees are read in steps of 15, 30, 45, 90, 180 or 360."""
    low, high = axes.get_ylim()
    steps = [step for step in (15, 30, 45, 90, 180, 360) if (high - low) / step <= 8]
    return MultipleLocator(steps[0]) if steps else MaxNLocator(6)
