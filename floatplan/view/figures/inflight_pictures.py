"""Pictures of corrections in flight: flights beside their plan, where they land, and how much can be corrected."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from floatplan.arrays import Array
from floatplan.inflight.authority import Authority
from floatplan.plans.plan import Plan
from floatplan.simulation.flights import ClosedLoop
from floatplan.view.style import ALARM, COLUMN, DPI, INK, OKABE_ITO, PALE, legend_above, new_figure, palette, styled

HEIGHT = 5.6  # [in]
FAINT = 0.45  # [-] opacity of single flights
BINS = 24
NARROWEST = 1e-3  # [deg] below which all errors are drawn as one


def closed_loop_png(plan: Plan, flights: ClosedLoop) -> bytes:
    """Return :func:`closed_loop_picture` as a PNG."""
    with styled():
        return _png(closed_loop_picture(plan, flights))


def authority_png(found: Authority) -> bytes:
    """Return :func:`authority_picture` as a PNG."""
    with styled():
        return _png(authority_picture(found))


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI)
    return stream.getvalue()


def closed_loop_picture(plan: Plan, flights: ClosedLoop) -> Figure:
    """Draw the planned and flown motion over each other, what the corrections foresaw, and a histogram of landings."""
    figure = new_figure(COLUMN, HEIGHT)
    orientation, joints, foreseen, landings = figure.subplots(4, 1)
    with_, without = OKABE_ITO[0], OKABE_ITO[1]
    for paths, colour in ((flights.uncorrected_paths, without), (flights.paths, with_)):
        for path in paths:
            orientation.plot(path.times, np.degrees(path.orientation), color=colour, alpha=FAINT, linewidth=0.6)
    times = np.linspace(0.0, plan.duration, 201)
    state = plan.at(times)
    orientation.plot(times, np.degrees(state.orientation), color=INK, linestyle="--", linewidth=1.0)
    colours = palette(state.positions.shape[1] + 2)[2:]  # not those of the flights
    for path in flights.paths:
        for column, hue in zip(path.positions.T, colours, strict=True):
            joints.plot(path.times, np.degrees(column), color=hue, alpha=FAINT, linewidth=0.6)
    for column in state.positions.T:
        joints.plot(times, np.degrees(column), color=INK, linestyle="--", linewidth=0.8)
    _corrections(foreseen, flights)
    _histogram(landings, flights, (with_, without))
    orientation.set(ylabel="orientation (°)")
    joints.set(ylabel="joints (°)")
    foreseen.set(ylabel="predicted miss (°)", xlabel="time (s)")
    for axes in (orientation, joints, foreseen):
        axes.set_xlim(0.0, plan.duration)
    entries = [
        (Line2D([], [], color=INK, linestyle="--"), "planned"),
        (Line2D([], [], color=with_), "corrected"),
        (Line2D([], [], color=without), "not corrected"),
        (Line2D([], [], color=ALARM, marker=".", linestyle=""), "refused"),
    ]
    legend_above(figure, entries)
    return figure


def _corrections(axes: Axes, flights: ClosedLoop) -> None:
    """What each correction leaves to be missed, and which were refused."""
    for path in flights.paths:
        when, miss, changed = path.corrections.T
        size = np.maximum(np.abs(np.degrees(miss)), NARROWEST)
        axes.plot(when, size, color=OKABE_ITO[0], alpha=FAINT, linewidth=0.5)
        axes.plot(when[changed == 0], size[changed == 0], ".", color=ALARM, markersize=2)
    axes.set_yscale("log")
    _decades(axes.yaxis)


def _histogram(axes: Axes, flights: ClosedLoop, colours: tuple[str, str]) -> None:
    errors = [
        np.maximum(np.abs(np.degrees(ends.orientation)), NARROWEST) for ends in (flights.corrected, flights.uncorrected)
    ]
    both = np.concatenate(errors)
    edges = np.geomspace(both.min() * 0.9, both.max() * 1.1, BINS + 1)
    for values, colour in zip(errors, colours, strict=True):
        axes.hist(values, bins=edges.tolist(), color=colour, alpha=0.7)
    axes.set(xscale="log", xlabel="error of the orientation at landing (°)", ylabel="flights")
    _decades(axes.xaxis)


def _decades(axis: Axis) -> None:
    """Label a logarithmic axis by plain numbers, a few of its decades."""
    axis.set_major_locator(LogLocator(numticks=5))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def authority_picture(found: Authority) -> Figure:
    """Draw the errors of momentum and of inertia that are corrected, over the time when corrections begin."""
    figure = new_figure(COLUMN, 2.6)
    axes = figure.add_subplot()
    entries: list[tuple[object, str]] = []
    for values, name, colour in (
        (found.inertia, "inertia of all bodies but the base", PALE),
        (found.momentum, "angular momentum", OKABE_ITO[0]),
    ):
        low, high = 100 * values.T
        _band(axes, found.times, low, high, colour)
        entries.append((Patch(facecolor=colour, alpha=0.5), name))
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set(xlabel="corrections begin at (s)", ylabel="error that is corrected (%)")
    axes.margins(x=0.0)
    legend_above(figure, entries)
    return figure


def _band(axes: Axes, times: Array, low: Array, high: Array, colour: str) -> None:
    axes.fill_between(times, low, high, color=colour, alpha=0.5, linewidth=0)
    for ends in (low, high):
        axes.plot(times, ends, color=INK, linewidth=0.6, marker=".", markersize=3)
