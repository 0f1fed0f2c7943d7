"""The page of many flights: with and without corrections side by side, pictures, and how much can be corrected."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from floatplan.arrays import Array
from floatplan.files import write_atomically
from floatplan.inflight.authority import Authority
from floatplan.plans.plan import Plan
from floatplan.simulation.closed_loop import ClosedLoop, Landings
from floatplan.view.style import (
    ALARM,
    COLUMN,
    INK,
    OKABE_ITO,
    PALE,
    legend_above,
    new_figure,
    palette,
    rendered,
    styled,
)

HEIGHT = 5.6  # [in]
FAINT = 0.45  # [-] opacity of single flights
BINS = 24
NARROWEST = 1e-3  # [deg] below which all errors are drawn as one
STYLE = """body { font: 15px/1.45 system-ui, sans-serif; color: #222;
  max-width: 46em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse; margin: 1em 0 } td, th { padding: .25em 1em .25em 0; text-align: left }
th { font-weight: 600; border-bottom: 1px solid #ccc; vertical-align: bottom } td + td { white-space: nowrap }
td[colspan] { white-space: normal } img { max-width: 100%; width: 34em }
@media (max-width: 36em) { body { font-size: 13px; margin: 1em auto } td, th { padding-right: .6em } }"""
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
HEAD = """<!doctype html><html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>
<style>{style}</style></head>"""

Row = Sequence[str]


def write_flights_page(
    plan: Plan, path: str | Path, flights: ClosedLoop | None = None, authority: Authority | None = None
) -> Path:
    """Write a page about flights of a plan, about what corrections can do, or both; it needs no network."""
    parts: list[str] = []
    if flights is not None:
        parts.append(f"<p>{html.escape(summary(flights))}</p>")
        parts.append(_table(("", "with corrections", "without"), landing_rows(flights)))
        parts.append(_picture(closed_loop_png(plan, flights), "planned and flown motion, corrections, landings"))
    if authority is not None:
        parts.append("<h2>How much can be corrected</h2>")
        parts.append(_table(("corrections begin at", "momentum", "inertia"), authority_rows(authority)))
        parts.append(_picture(authority_png(authority), "errors that are corrected"))
    title = f"{html.escape(plan.problem.name)}: in flight"
    head = HEAD.format(policy=POLICY, title=title, style=STYLE)
    return write_atomically(path, f"{head}<body><h1>{title}</h1>{''.join(parts)}</body></html>\n")


def summary(flights: ClosedLoop) -> str:
    """Say in a line how many flights there were, and how they were simulated."""
    many = "1 flight" if flights.flights == 1 else f"{flights.flights} flights"
    if flights.flights < flights.asked:
        many += f" of {flights.asked} (--budget gives more time)"
    return f"{many} in {flights.seconds:.3g} s, {flights.engine}, corrected at {flights.rate:g} Hz"


def landing_rows(flights: ClosedLoop) -> list[Row]:
    """Return rows of (what, with corrections, without) of many flights, for reading."""
    both = (flights.corrected, flights.uncorrected)
    rows: list[Row] = [
        ("orientation, median", *(f"{_degrees(np.median(np.abs(ends.orientation)))}" for ends in both)),
        ("orientation, worst", *(_degrees(np.abs(ends.orientation).max()) for ends in both)),
        ("joints, worst", *(_degrees(ends.joints.max()) for ends in both)),
        ("peak torque, median", *(f"{np.median(ends.torque_peak.max(axis=1)):.4g} N m" for ends in both)),
    ]
    planned = flights.plan_torque_peak.max()
    rows.append(("of the plan's", *(f"{_ratio(ends, planned)}" for ends in both)))
    if np.isfinite(flights.corrected.clearance).any():
        rows.append(("least clearance", *(f"{ends.clearance.min():.4g} m" for ends in both)))
        rows.append(("touched", *(f"{(ends.clearance < 0).sum()} of {flights.flights}" for ends in both)))
    counts = ", ".join(f"{count} {status}" for status, count in sorted(flights.statuses.items()))
    median, most = flights.update_milliseconds
    return [
        *rows,
        ("corrections", counts or "none", ""),
        ("processor time of one", f"{median:.2f} ms, 99 % below {most:.2f} ms", ""),
    ]


def authority_rows(found: Authority) -> list[Row]:
    """Return rows of (begin, momentum, inertia), for reading."""
    return [
        (f"{time:.3g} s", _interval(*momentum), _interval(*inertia))
        for time, momentum, inertia in zip(
            found.times.tolist(), found.momentum.tolist(), found.inertia.tolist(), strict=True
        )
    ]


def _interval(low: float, high: float) -> str:
    if math.isnan(low):
        return "none"
    return " to ".join(f"{100 * end:+.1f} %" if abs(end) >= 5e-4 else "0 %" for end in (low, high))


def _ratio(ends: Landings, planned: float) -> str:
    return f"{np.median(ends.torque_peak.max(axis=1)) / planned:.2f} times" if planned > 0 else "-"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


def _table(titles: Row, rows: Sequence[Row]) -> str:
    head = "".join(f"<th>{html.escape(title)}</th>" for title in titles)
    body = "".join(f"<tr>{_cells(row)}</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _cells(row: Row) -> str:
    """A row's cells; the last one that says something reaches to the end of the row."""
    said = row[: max(column for column, cell in enumerate(row) if cell) + 1]
    last = f'<td colspan="{len(row) - len(said) + 1}">' if len(said) < len(row) else "<td>"
    starts = ["<td>"] * (len(said) - 1) + [last]
    return "".join(f"{start}{html.escape(cell)}</td>" for start, cell in zip(starts, said, strict=True))


def _picture(content: bytes, text: str) -> str:
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{base64.b64encode(content).decode()}">'


def closed_loop_png(plan: Plan, flights: ClosedLoop) -> bytes:
    """Return :func:`closed_loop_picture` as a PNG."""
    with styled():
        return rendered(closed_loop_picture(plan, flights), "png")


def authority_png(found: Authority) -> bytes:
    """Return :func:`authority_picture` as a PNG."""
    with styled():
        return rendered(authority_picture(found), "png")


def closed_loop_picture(plan: Plan, flights: ClosedLoop) -> Figure:
    """Draw the planned and flown motion over each other, what corrections predicted, and a histogram of landings."""
    figure = new_figure(COLUMN, HEIGHT)
    orientation, joints, predicted, landings = figure.subplots(4, 1)
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
    _corrections(predicted, flights)
    _histogram(landings, flights, (with_, without))
    orientation.set(ylabel="orientation (°)")
    joints.set(ylabel="joints (°)")
    predicted.set(ylabel="predicted miss (°)", xlabel="time (s)")
    for axes in (orientation, joints, predicted):
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
