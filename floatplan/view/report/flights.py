"""The page of many flights: with and without corrections side by side, and pictures."""

import base64
import html
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from floatplan.arguments import html_table
from floatplan.arrays import Array
from floatplan.files import write_atomically
from floatplan.plans.plan import Plan
from floatplan.plans.presentation import Row
from floatplan.plans.verdicts import Tone, verdict_in_words
from floatplan.problem.attitude import required
from floatplan.simulation.results import ClosedLoop, JumpLandings, JumpReplay
from floatplan.simulation.spatial_motion import angle_between
from floatplan.view.figures.animation import animate
from floatplan.view.jumps import flies_in_space
from floatplan.view.report.report import asset, filled, policy, write_report
from floatplan.view.style import COLUMN, PALETTE, legend_above, new_figure, palette, picture

WITH, WITHOUT = PALETTE.hues[:2]  # corrections
LANDING_TITLES = ("", "with corrections", "without")

Cells = Sequence[str]


def write_flights_page(plan: Plan, path: str | Path, flights: ClosedLoop) -> Path:
    """Write a page about flights of a plan; it needs no network."""
    image = picture("png", closed_loop_picture, plan, flights)
    parts = [
        f"<p>{html.escape(summary(flights))}</p>",
        html_table("", landing_rows(flights), LANDING_TITLES),
        _embedded(image, "planned and flown motion, corrections, landings"),
    ]
    return _page(path, plan.problem.name, parts)


def write_jump_pages(
    flights: JumpReplay, folder: Path, progress: Callable[[int, int], None] | None = None
) -> list[Path]:
    """Write a page that plays the first flight of a jump, and its film; of many flights a page with their histogram."""
    rows = jump_rows(flights)
    first = bool(flights.landings.stands[0])
    name = flights.motion.problem.name
    words = f"{'stands' if first else 'falls'} in {flights.engine}"
    motion = flights.motion
    assert motion.flight is not None
    tone: Tone = "bad"
    if first:
        tone = verdict_in_words(motion.flight.ok, motion.flight.certificate, bool(motion.warnings))[1]
    report_rows = [Row(row[0], row[1]) for row in rows]
    paths = [write_report(motion, folder / "report.html", report_rows, (words, tone))]
    paths.append(animate(motion, folder / "flight.gif", progress=progress))
    if flights.flights > 1:
        about = f"<p>{html.escape(summary(flights))}; {html.escape(flights.control)}</p>"
        titles = LANDING_TITLES if flights.corrected is not None else ("", "")
        image = _embedded(picture("png", jump_picture, flights), "histogram of landings")
        paths.append(_page(folder / "flights.html", name, [about, html_table("", rows, titles), image]))
    return paths


def _page(path: str | Path, name: str, parts: Sequence[str]) -> Path:
    title = f"{html.escape(name)}: in flight"
    body = f'<header><h1>{title}</h1></header><article class="flights">{"".join(parts)}</article>'
    page = {"title": title, "policy": policy(()), "style": asset("report.css"), "body": body, "scripts": ""}
    return write_atomically(path, filled(asset("page.html"), page))


def _embedded(content: bytes, text: str) -> str:
    return f'<img alt="{text}" src="data:image/png;base64,{base64.b64encode(content).decode()}">'


def summary(flights: ClosedLoop | JumpReplay) -> str:
    """Say in a line how many flights there were, and how they were simulated."""
    many = "1 flight" if flights.flights == 1 else f"{flights.flights} flights"
    if flights.flights < flights.asked:
        many += f" of {flights.asked} (--budget gives more time)"
    corrected = "" if flights.rate is None else f", corrected at {flights.rate:g} Hz"
    return f"{many} in {flights.seconds:.3g} s, {flights.engine}{corrected}"


def landing_rows(flights: ClosedLoop) -> list[Cells]:
    """Return rows of (what, with corrections, without) of many flights, for reading."""
    planned = flights.plan_torque_peak.max()
    columns = []
    for landings in (flights.corrected, flights.uncorrected):
        torque = float(np.median(landings.torque_peak.max(axis=1)))
        cells = {
            "orientation, median": _degrees(np.median(np.abs(landings.orientation))),
            "orientation, worst": _degrees(np.abs(landings.orientation).max()),
            "joints, worst": _degrees(landings.joints.max()),
            "peak torque, median": f"{torque:.4g} N m",
            "of the plan's": f"{torque / planned:.2f} times" if planned > 0 else "-",
        }
        if np.isfinite(flights.corrected.clearance).any():
            cells["least clearance"] = f"{landings.clearance.min():.4g} m"
            cells["touched"] = f"{(landings.clearance < 0).sum()} of {flights.flights}"
        columns.append(cells)
    median, most = flights.update_milliseconds
    return [
        *_as_rows(columns),
        *_corrections(flights),
        ("processor time of one", f"{median:.2f} ms, 99 % below {most:.2f} ms", ""),
    ]


def jump_rows(flights: JumpReplay) -> list[Cells]:
    """Return the same of flights of a jump; a single column where none was corrected."""
    columns = []
    angle = "attitude" if flies_in_space(flights.motion) else "pitch"
    for landings in _series(flights):
        links = ", ".join(f"{link} {count}" for link, count in landings.links.most_common(3))
        cells = {
            "stands in the end": f"{landings.stands.sum()} of {flights.flights}",
            "on its feet alone": f"{landings.clean.sum()} of {flights.flights}",
            "other links that touched": links or "none",
            f"{angle} at touchdown": f"{_degrees(landings.pitch_rms)} rms",
            f"{angle}, worst": _degrees(landings.pitch_worst),
            "torque wanted": f"{100 * landings.torque.max():.3g} % of what motors can",
            "feet slid, worst": f"{1e3 * landings.slid.max():.3g} mm",
        }
        columns.append(cells)
    return [*_as_rows(columns), *_corrections(flights)]


def _series(flights: JumpReplay) -> list[JumpLandings]:
    """Landings with corrections, where there are such, and without."""
    return [landings for landings in (flights.corrected, flights.uncorrected) if landings is not None]


def _as_rows(columns: Sequence[dict[str, str]]) -> list[Cells]:
    """Rows of (what, its cell in each column)."""
    rows: list[Sequence[str]] = []
    for name in columns[0]:
        cells = [column[name] for column in columns]
        rows.append((name, *cells))
    return rows


def _corrections(flights: ClosedLoop | JumpReplay) -> list[Cells]:
    """The row of the numbers of corrections by status, where there were corrections."""
    counts = ", ".join(f"{count} {status}" for status, count in sorted(flights.statuses.items()))
    return [] if flights.rate is None else [("corrections", counts or "none", "")]


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


def closed_loop_picture(plan: Plan, flights: ClosedLoop) -> Figure:
    """Draw planned and simulated motion over each other, the landings that corrections predict, and their histogram."""
    figure = new_figure(COLUMN, 5.6)  # [in] four axes
    orientation, joints, predicted, landings = figure.subplots(4, 1)
    faint = 0.45  # [-] opacity: many flights lie over one another
    thin: dict[str, float] = {"alpha": faint, "linewidth": 0.6}
    state = plan.at(np.linspace(0.0, plan.duration, 201))
    for paths, colour in ((flights.uncorrected_paths, WITHOUT), (flights.paths, WITH)):
        for path in paths:
            orientation.plot(path.times, np.degrees(path.orientation), color=colour, **thin)
    colours = palette(state.positions.shape[1] + 2)[2:]  # not those of the flights
    for path in flights.paths:
        for column, hue in zip(path.positions.T, colours, strict=True):
            joints.plot(path.times, np.degrees(column), color=hue, **thin)
        when, miss, changed = path.corrections.T
        size = _error_sizes(miss)
        predicted.plot(when, size, color=WITH, alpha=faint, linewidth=0.5)
        predicted.plot(when[changed == 0], size[changed == 0], ".", color=PALETTE.alarm, markersize=2)
    planned = state.orientation
    if planned.ndim > 1:
        goal = required(plan.problem.final.attitude).quaternion
        planned = np.array([angle_between(quaternion, goal) for quaternion in state.orientation])
    for axes, columns, width in ((orientation, planned, 1.0), (joints, state.positions, 0.8)):
        axes.plot(state.times, np.degrees(columns), color=PALETTE.ink, linestyle="--", linewidth=width)
    _histogram(landings, [flights.corrected.orientation, flights.uncorrected.orientation])
    orientation.set(ylabel="orientation (°)" if state.orientation.ndim == 1 else "from the goal (°)")
    joints.set(ylabel="joints (°)")
    predicted.set(ylabel="predicted miss (°)", xlabel="time (s)", yscale="log")
    _label_decades(predicted.yaxis)
    for axes in (orientation, joints, predicted):
        axes.set_xlim(0.0, plan.duration)
    entries = [
        (Line2D([], [], color=PALETTE.ink, linestyle="--"), "planned"),
        (Line2D([], [], color=WITH), "corrected"),
        (Line2D([], [], color=WITHOUT), "not corrected"),
        (Line2D([], [], color=PALETTE.alarm, marker=".", linestyle=""), "refused"),
    ]
    legend_above(figure, entries)
    return figure


def jump_picture(flights: JumpReplay) -> Figure:
    """Draw a histogram of the errors at touchdown of flights of a jump."""
    figure = new_figure(COLUMN, 2.2)
    series = _series(flights)
    _histogram(figure.add_subplot(), [landings.pitch[np.isfinite(landings.pitch)] for landings in series])
    entries = [(Patch(facecolor=WITH), "corrected"), (Patch(facecolor=WITHOUT), "not corrected")]
    legend_above(figure, entries[-len(series) :])
    return figure


def _histogram(axes: Axes, angles: Sequence[Array]) -> None:
    """Errors (F,) of the orientation, rad: with corrections, where there are such, and without."""
    errors = list(map(_error_sizes, angles))
    both = np.concatenate(errors)
    edges = np.geomspace(both.min() * 0.9, both.max() * 1.1, 25)
    for values, colour in zip(errors, (WITH, WITHOUT)[-len(angles) :], strict=True):
        axes.hist(values, bins=edges.tolist(), color=colour, alpha=0.7)
    axes.set(xscale="log", xlabel="error of the orientation at landing (°)", ylabel="flights")
    _label_decades(axes.xaxis)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def _label_decades(axis: Axis) -> None:
    """Label a logarithmic axis by numbers without exponents, a few of its decades."""
    axis.set_major_locator(LogLocator(numticks=5))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _error_sizes(angles: Array) -> Array:
    """Magnitudes (N,) of angles, deg, for a logarithmic axis: at least 1e-3, since 0 is on none."""
    return np.maximum(np.abs(np.degrees(angles)), 1e-3)
