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
from floatplan.simulation.results import ClosedLoop, JumpReplay
from floatplan.view.figures.animation import animate
from floatplan.view.report.report import asset, filled, policy, write_report
from floatplan.view.style import ALARM, COLUMN, INK, OKABE_ITO, legend_above, new_figure, palette, picture

HEIGHT = 5.6  # [in]
HISTOGRAM_HEIGHT = 2.2
FAINT = 0.45  # [-] opacity of single flights
BINS = 24
NARROWEST = 1e-3  # [deg] below which all errors are drawn as one
WITH, WITHOUT = OKABE_ITO[:2]  # corrections
MOST_LINKS = 3  # [-] that are named
LANDING_TITLES = ("", "with corrections", "without")

Cells = Sequence[str]


def write_flights_page(plan: Plan, path: str | Path, flights: ClosedLoop) -> Path:
    """Write a page about flights of a plan; it needs no network."""
    drawn = picture("png", closed_loop_picture, plan, flights)
    parts = [
        f"<p>{html.escape(summary(flights))}</p>",
        html_table("", landing_rows(flights), LANDING_TITLES),
        _embedded(drawn, "planned and flown motion, corrections, landings"),
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
    told = [Row(row[0], row[1]) for row in rows]
    paths = [write_report(motion, folder / "report.html", told, (words, tone))]
    paths.append(animate(motion, folder / "flight.gif", progress=progress))
    if flights.flights > 1:
        about = f"<p>{html.escape(summary(flights))}; {html.escape(flights.control)}</p>"
        titles = LANDING_TITLES if flights.corrected is not None else ("", "")
        drawn = _embedded(picture("png", jump_picture, flights), "histogram of landings")
        paths.append(_page(folder / "flights.html", name, [about, html_table("", rows, titles), drawn]))
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
    both = (flights.corrected, flights.uncorrected)
    planned = flights.plan_torque_peak.max()
    torques = [float(np.median(ends.torque_peak.max(axis=1))) for ends in both]
    rows: list[Cells] = [
        ("orientation, median", *(_degrees(np.median(np.abs(ends.orientation))) for ends in both)),
        ("orientation, worst", *(_degrees(np.abs(ends.orientation).max()) for ends in both)),
        ("joints, worst", *(_degrees(ends.joints.max()) for ends in both)),
        ("peak torque, median", *(f"{torque:.4g} N m" for torque in torques)),
        ("of the plan's", *(f"{torque / planned:.2f} times" if planned > 0 else "-" for torque in torques)),
    ]
    if np.isfinite(flights.corrected.clearance).any():
        rows.append(("least clearance", *(f"{ends.clearance.min():.4g} m" for ends in both)))
        rows.append(("touched", *(f"{(ends.clearance < 0).sum()} of {flights.flights}" for ends in both)))
    median, most = flights.update_milliseconds
    return [
        *rows,
        *_corrections(flights),
        ("processor time of one", f"{median:.2f} ms, 99 % below {most:.2f} ms", ""),
    ]


def jump_rows(flights: JumpReplay) -> list[Cells]:
    """Return the same of flights of a jump; a single column where none was corrected."""
    ends = [each for each in (flights.corrected, flights.uncorrected) if each is not None]
    touched = [", ".join(f"{link} {count}" for link, count in each.links.most_common(MOST_LINKS)) for each in ends]
    return [
        ("stands in the end", *(f"{each.stands.sum()} of {flights.flights}" for each in ends)),
        ("on its feet alone", *(f"{each.clean.sum()} of {flights.flights}" for each in ends)),
        ("other links that touched", *(words or "none" for words in touched)),
        ("pitch at touchdown", *(f"{_degrees(each.pitch_rms)} rms" for each in ends)),
        ("pitch, worst", *(_degrees(each.pitch_worst) for each in ends)),
        ("torque wanted", *(f"{100 * each.torque.max():.3g} % of what motors can" for each in ends)),
        ("feet slid, worst", *(f"{1e3 * each.slid.max():.3g} mm" for each in ends)),
        *_corrections(flights),
    ]


def _corrections(flights: ClosedLoop | JumpReplay) -> list[Cells]:
    """The row of how often a correction had which status, where any was asked for."""
    counts = ", ".join(f"{count} {status}" for status, count in sorted(flights.statuses.items()))
    return [] if flights.rate is None else [("corrections", counts or "none", "")]


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


def closed_loop_picture(plan: Plan, flights: ClosedLoop) -> Figure:
    """Draw the planned and flown motion over each other, what corrections predicted, and a histogram of landings."""
    figure = new_figure(COLUMN, HEIGHT)
    orientation, joints, predicted, landings = figure.subplots(4, 1)
    thin: dict[str, float] = {"alpha": FAINT, "linewidth": 0.6}
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
        predicted.plot(when, size, color=WITH, alpha=FAINT, linewidth=0.5)
        predicted.plot(when[changed == 0], size[changed == 0], ".", color=ALARM, markersize=2)
    for axes, columns, width in ((orientation, state.orientation, 1.0), (joints, state.positions, 0.8)):
        axes.plot(state.times, np.degrees(columns), color=INK, linestyle="--", linewidth=width)
    _histogram(landings, [ends.orientation for ends in (flights.corrected, flights.uncorrected)])
    orientation.set(ylabel="orientation (°)")
    joints.set(ylabel="joints (°)")
    predicted.set(ylabel="predicted miss (°)", xlabel="time (s)", yscale="log")
    _label_decades(predicted.yaxis)
    for axes in (orientation, joints, predicted):
        axes.set_xlim(0.0, plan.duration)
    entries = [
        (Line2D([], [], color=INK, linestyle="--"), "planned"),
        (Line2D([], [], color=WITH), "corrected"),
        (Line2D([], [], color=WITHOUT), "not corrected"),
        (Line2D([], [], color=ALARM, marker=".", linestyle=""), "refused"),
    ]
    legend_above(figure, entries)
    return figure


def jump_picture(flights: JumpReplay) -> Figure:
    """Draw a histogram of the errors at touchdown of flights of a jump."""
    figure = new_figure(COLUMN, HISTOGRAM_HEIGHT)
    both = [each for each in (flights.corrected, flights.uncorrected) if each is not None]
    _histogram(figure.add_subplot(), [each.pitch[np.isfinite(each.pitch)] for each in both])
    entries = [(Patch(facecolor=colour), name) for colour, name in ((WITH, "corrected"), (WITHOUT, "not corrected"))]
    legend_above(figure, entries[-len(both) :])
    return figure


def _histogram(axes: Axes, ends: Sequence[Array]) -> None:
    """Errors (F,) of the orientation, rad: with corrections, where there are such, and without."""
    errors = [_error_sizes(each) for each in ends]
    both = np.concatenate(errors)
    edges = np.geomspace(both.min() * 0.9, both.max() * 1.1, BINS + 1)
    for values, colour in zip(errors, (WITH, WITHOUT)[-len(ends) :], strict=True):
        axes.hist(values, bins=edges.tolist(), color=colour, alpha=0.7)
    axes.set(xscale="log", xlabel="error of the orientation at landing (°)", ylabel="flights")
    _label_decades(axes.xaxis)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def _label_decades(axis: Axis) -> None:
    """Label a logarithmic axis by plain numbers, a few of its decades."""
    axis.set_major_locator(LogLocator(numticks=5))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _error_sizes(angles: Array) -> Array:
    """Magnitudes (N,) of angles, deg, as drawn on a logarithmic axis."""
    return np.maximum(np.abs(np.degrees(angles)), NARROWEST)
