"""The figures of a plan, by name, and their files: the moving robot, and charts over time.

A chart of few curves is one picture; of many, small ones, each with its own limits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
from floatplan.view.jumps import flies_in_space
from floatplan.view.sampled import SampledPlan
from floatplan.view.style import COLUMN, METADATA, PALETTE, faded, legend_above, new_figure, rendered, styled

SAMPLES = 241  # [-] of a curve


@dataclass(frozen=True)
class ChartLayout:
    """Sizes of charts in one column of a paper."""

    height: float = 2.1  # [in] of the first axis with its labels
    second_height: float = 1.25  # [in] of an axis added below
    across: int = 2  # small pictures side by side
    row_height: float = 0.72  # [in] of small pictures
    frame_height: float = 0.62  # [in] of their time axis and legend
    letters: float = 5.6  # [pt] of their text
    longest_name: int = 18  # [letters] of their titles
    thinner: float = 0.8  # [-] widths of their lines, relative to those of large ones
    band: float = 6.0  # [pt] width of a line that is there or not
    compared: float = 0.75  # [-] strength of a second plan's colours


LAYOUT = ChartLayout()
LINES: dict[str, dict[str, Any]] = {  # dashes and widths, pt, that distinguish kinds of lines
    "in flight": {"color": "#f0f0f0", "linewidth": 0},
    "compared": {"linestyle": (0, (2.2, 1.1)), "linewidth": 1.0},
    "proved": {"linestyle": (0, (1, 1.6)), "linewidth": 0.9, "zorder": 1.4},
    "limit": {"linestyle": (0, (9, 3)), "linewidth": 0.7, "zorder": 1.5},
    "start": {
        "marker": "o",
        "linestyle": "none",
        "clip_on": False,
        "zorder": 5,
        "markersize": 3.2,
        "markeredgewidth": 1.0,
    },
}
LINES["goal"] = {**LINES["start"], "markersize": 4.4, "markerfacecolor": "white"}

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
        return dict(_named_figures(plan, compare))


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
    folder = Path(directory)
    paths = []
    with styled():
        for name, figure in _named_figures(plan, compare):
            paths += [write_atomically(folder / f"{name}.{form}", rendered(figure, form)) for form in formats]
    return paths


def _named_figures(plan: Trajectory, compare: Plan | None) -> Iterator[tuple[str, Figure]]:
    if compare is not None and isinstance(plan, JumpMotion):
        raise InputError("a jump is not compared", element="compare", advice="compare plans, such as its flight's")
    if compare is not None and compare.robot.joints != plan.robot.joints:
        joints = ", ".join(compare.robot.joints)
        reason = f"plans {joints}, not {', '.join(plan.robot.joints)}"
        raise InputError(reason, element="compare", advice="give a plan for the same joints")
    if compare is not None and flies_in_space(compare) != flies_in_space(plan):
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


def sample(plan: Trajectory, reference: Trajectory | None = None) -> SampledPlan:
    """Sample a plan at the instants of the curves, as :meth:`SampledPlan.of`."""
    return SampledPlan.of(plan, np.linspace(0, plan.duration, SAMPLES), reference)


def chart_figure(chart: Chart, sampled: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw a chart, with a second plan's curves dashed; what would flatten the curves is left out."""
    if chart.of_each and is_crowded(sampled.plan):
        return _small_multiples(chart, sampled, other)
    rows = len(chart.panels)
    figure = new_figure(COLUMN, LAYOUT.height + LAYOUT.second_height * (rows - 1))
    ratios = [LAYOUT.height - 0.5] + [LAYOUT.second_height] * (rows - 1)
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})[:, 0]
    grid[-1].set(xlim=(0, sampled.plan.duration), xlabel="time (s)")
    marks: Marks = {}
    entries: list[tuple[Any, str]] = []
    for axes, panel in reversed(list(zip(grid, chart.panels, strict=True))):
        marks |= draw_panel(axes, chart, panel, sampled, other)
        for curve in panel.curves:
            values = [plan.columns[curve.key] for plan in _layers(sampled, other) if curve.key in plan.columns]
            if chart.factor * min(map(np.fmin.reduce, values)) <= axes.get_ylim()[1]:
                entries.append((Line2D([], [], color=curve.colour, linestyle=curve.linestyle), curve.name))
    figure.align_ylabels()
    legend_above(figure, [*entries, *_plan_marks(marks, sampled, other)])
    return figure


def _small_multiples(chart: Chart, sampled: SampledPlan, other: SampledPlan | None) -> Figure:
    """A small picture for each curve; a limit that is too far away for a line is a number next to the name."""
    rows = -(-len(chart.curves) // LAYOUT.across)
    figure = new_figure(COLUMN, LAYOUT.row_height * rows + LAYOUT.frame_height)
    grid = figure.subplots(rows, LAYOUT.across, sharex=True, squeeze=False)
    marks: Marks = {}
    longest = LAYOUT.longest_name
    for axes, curve in zip(grid.T.ravel(), chart.curves, strict=False):
        name = curve.name if len(curve.name) <= longest else f"{curve.name[: longest - 1]}…"
        axes.set_title(name, fontsize=LAYOUT.letters + 0.6, loc="left", pad=2, color=PALETTE.ink)
        panel = replace(chart.panels[0], label="", curves=[curve])
        marks |= draw_panel(axes, chart, panel, sampled, other, LAYOUT.thinner)
        axes.yaxis.set_major_locator(MaxNLocator(3))
        axes.tick_params(labelsize=LAYOUT.letters)
    for axes in grid.T.ravel()[len(chart.curves) :]:
        axes.set_axis_off()
    for column in grid.T:
        visible = [axes for axes in column if axes.axison]
        if visible:  # the time axis is under the last of a column
            visible[-1].tick_params(labelbottom=True)
            visible[-1].set(xlim=(0, sampled.plan.duration))
            visible[-1].xaxis.set_major_locator(MaxNLocator(4))
    figure.supylabel(chart.unit, fontsize=7)
    figure.supxlabel("time (s)", fontsize=7)
    entries = _plan_marks(marks, sampled, other)
    if entries:
        legend_above(figure, entries)
    return figure


def draw_panel(
    axes: Axes, chart: Chart, panel: Panel, sampled: SampledPlan, other: SampledPlan | None = None, thinner: float = 1.0
) -> Marks:
    """Draw the curves of a panel onto axes with all that belongs to them; return the legend's entries for that."""

    def scaled(style: dict[str, Any]) -> dict[str, Any]:
        thin = dict(style)
        for name, size in style.items():
            if name.endswith(("width", "size")):
                thin[name] = thinner * size
        return thin

    peak = 0.0
    width = 1.3 if chart.unit else LAYOUT.band
    marks: Marks = {}
    if isinstance(sampled.plan, JumpMotion):
        for flight in sampled.plan.timed_flights:
            axes.axvspan(flight.begin, flight.end, zorder=0.3, **LINES["in flight"])
        marks["in flight"] = Patch(**LINES["in flight"])
    for layer in _layers(sampled, other):
        for curve in panel.curves:
            if curve.key in layer.columns:
                values = chart.factor * layer.columns[curve.key]
                style: dict[str, Any] = {"linestyle": curve.linestyle, "linewidth": width}
                colour = faded(curve.colour, 1.0)
                if layer is other:
                    style = LINES["compared"]
                    colour = faded(curve.colour, LAYOUT.compared)
                axes.plot(layer.times, values, color=colour, **scaled(style))
                peak = max(peak, largest(values))
    if panel.label:
        axes.set_ylabel(f"{panel.label} ({chart.unit})")
    if panel.range is not None:
        axes.set(ylim=panel.range)
        axes.axhspan(panel.range[0], 0, color=faded(PALETTE.alarm, 0.12), linewidth=0, zorder=0.4)
    elif chart.unit == "deg":
        axes.yaxis.set_major_locator(_angle_ticks(axes))
    elif not chart.unit:
        axes.set_yticks([])
    else:
        axes.axhline(0, color=PALETTE.grey, linewidth=0.5, zorder=0.5)
    shown, omitted = panel.lines(peak / chart.factor)
    for line in shown:
        style = scaled(LINES["limit"]) | {
            "color": line.colour if line.segment is None or len(panel.curves) > 1 else PALETTE.ink
        }
        if np.ndim(line.value):
            axes.plot(sampled.times, chart.factor * np.broadcast_to(line.value, sampled.times.shape), **style)
        else:
            axes.axhline(chart.factor * float(line.value), **style)
        marks[line.name] = Line2D([], [], **style | {"color": line.colour if line.segment is None else PALETTE.ink})
    if panel.interval is not None:
        low, high = panel.interval
        if omitted:
            marks[f"{INTERVAL}: {low:.3g} to {high:.3g}"] = Line2D([], [], linestyle="none")
        else:
            axes.axhspan(low, high, color=faded(PALETTE.ink, 0.08), linewidth=0, zorder=0.4)
    elif thinner < 1.0 and omitted:
        limit = np.min(omitted[0].value)
        axes.set_title(f"limit {limit:.3g}", fontsize=LAYOUT.letters, loc="right", pad=2, color=PALETTE.grey)
    for curve in panel.curves:
        if curve.proved < np.inf if panel.range is None else curve.proved <= panel.range[1]:
            for side in (1, -1) if panel.range is None else (1,):
                axes.axhline(side * curve.proved, color=faded(curve.colour, 0.6), **scaled(LINES["proved"]))
            name = "proved peak" if panel.range is None else "proved minimum"
            marks[name] = Line2D([], [], color=PALETTE.ink, **scaled(LINES["proved"]))
        if curve.ends is not None:  # a dot where it starts and a ring where it should end
            start, goal = chart.factor * np.array(curve.ends)
            axes.plot(0, start, color=curve.colour, **scaled(LINES["start"]))
            axes.plot(sampled.plan.duration, goal, color=curve.colour, **scaled(LINES["goal"]))
            marks["goal"] = Line2D([], [], color=PALETTE.ink, **scaled(LINES["goal"]))
    return marks


def _layers(sampled: SampledPlan, other: SampledPlan | None) -> list[SampledPlan]:
    """The plans to draw, the lowest layer first."""
    return [sampled] if other is None else [other, sampled]


def _plan_marks(marks: Marks, sampled: SampledPlan, other: SampledPlan | None) -> list[tuple[Any, str]]:
    """A legend's last entries: the marks, and what tells two plans apart."""
    entries = [(mark, name) for name, mark in marks.items()]
    if other is not None:
        name, name_of_other = plan_names(sampled.plan, other.plan)
        entries.append((Line2D([], [], color=PALETTE.ink), name))
        entries.append((Line2D([], [], color=faded(PALETTE.ink, LAYOUT.compared), **LINES["compared"]), name_of_other))
    return entries


def _angle_ticks(axes: Axes) -> MultipleLocator | MaxNLocator:
    """Degrees are read in steps of 15, 30, 45, 90, 180 or 360."""
    low, high = axes.get_ylim()
    steps = [step for step in (15, 30, 45, 90, 180, 360) if (high - low) / step <= 8]
    return MultipleLocator(steps[0]) if steps else MaxNLocator(6)
