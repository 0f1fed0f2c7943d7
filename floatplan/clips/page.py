"""A page on which a person sees why flights of clips fly or not; it needs no network and runs no script."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex

from floatplan.arguments import html_table
from floatplan.arrays import Array
from floatplan.clips.check import ClipCheck
from floatplan.clips.fall import Fall
from floatplan.clips.flights import FOOT_CLEARANCE, STANCE_SPAN
from floatplan.clips.judge import FlightJudgement
from floatplan.files import write_atomically
from floatplan.robot.shapes.capsules import convex_hull
from floatplan.view.report.report import asset, filled, policy
from floatplan.view.solids import rendered_solids
from floatplan.view.style import palette

MOST_FLIGHTS = 60  # [-] that have charts, the unphysical ones first; tables list all


@dataclass(frozen=True)
class ChartFrame:
    """Sizes and colours of the charts of a flight."""

    width: int = 540  # [px]
    height: int = 200  # [px]
    left: int = 52  # [px] between the chart and its frame, as the next three
    right: int = 150  # names of curves are there
    top: int = 22
    bottom: int = 26
    postures: int = 5  # [-] of the robot in a flight
    colours: tuple[str, ...] = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
    reference: str = "#808080"  # of dashed lines: to be read on light and dark paper


CHART = ChartFrame()
STYLE = """
section { margin: 18px 0 30px; }
h2 { font-size: 17px; margin: 6px 0; }
h2 .badge { background: var(--tone); }
.charts { display: flex; flex-wrap: wrap; gap: 10px 18px; }
.chart text { fill: var(--ink); font-size: 11px; }
.chart .axis { stroke: var(--line); }
.chart .air { fill: var(--air); }
.chart polyline { fill: none; stroke-width: 1.6; }
.chart .posture { stroke: var(--paper); stroke-width: 0.7; }
td, th { padding: 2px 14px 2px 0; }
"""


@dataclass(frozen=True)
class Line:
    """A curve of a chart: its points (K,), (K,), what it is called, its colour, and its style."""

    x: Array
    y: Array
    name: str
    colour: str
    dots: bool = False
    dashed: bool = False


def write_page(checks: Sequence[ClipCheck], path: str | Path) -> Path:
    """Write a page about the flights of clips: verdicts, and curves of those that are seen first.

    Parameters
    ----------
    checks : of at least one clip
    path : of the page
    """
    name = checks[0].clip.path.name if len(checks) == 1 else f"{len(checks)} clips"
    title = f"{html.escape(name)}: its flights" if len(checks) == 1 else f"{html.escape(name)}: their flights"
    flights = []
    for check in checks:
        flights += [(check, judged) for judged in check.flights]
    flights.sort(key=lambda pair: pair[1].verdict != "unphysical")
    parts = [clip_words(check) + flights_table(check) for check in checks]
    parts += [_flight_section(check, judged) for check, judged in flights[:MOST_FLIGHTS]]
    if len(flights) > MOST_FLIGHTS:
        parts.append(f"<p>{len(flights) - MOST_FLIGHTS} more flights have no charts.</p>")
    page = {
        "title": title,
        "policy": policy(()),
        "style": asset("report.css") + STYLE,
        "body": f"<header><h1>{title}</h1></header><article>{''.join(parts)}</article>",
        "scripts": "",
    }
    return write_atomically(path, filled(asset("page.html"), page))


def clip_words(check: ClipCheck) -> str:
    """A line about a clip, and what was assumed of it."""
    clip = check.clip
    words = (
        f"{clip.path.name}: {clip.frames} frames at {clip.fps:g} Hz, {check.physical} of {len(check.flights)} physical"
    )
    remarks = "".join(f"<br>{html.escape(remark)}" for remark in check.remarks)
    return f"<p><b>{html.escape(words)}</b>{remarks}</p>"


def flights_table(check: ClipCheck) -> str:
    """A table of a clip's flights; nothing where it has none."""
    rows = [_table_row(judged) for judged in check.flights]
    titles = ("flight, s", "verdict", "fall, m/s²", "off a flight, deg", "torque", "rate")
    return html_table("", rows, (*titles, "force to add, N", "feet slide, mm")) if rows else ""


def _table_row(judged: FlightJudgement) -> list[str]:
    flight = judged.flight
    rotation = "" if judged.rotation is None else f"{np.rad2deg(judged.rotation.rms):.2f}"
    fall = f"{judged.fall.fall:.2f} ± {judged.fall.interval:.2f}" if np.isfinite(judged.fall.interval) else ""
    force = f"{judged.wrench[0]:.0f}" if np.isfinite(judged.wrench[0]) else ""
    return [
        f"{flight.begin:.2f} to {flight.end:.2f}",
        judged.verdict,
        fall,
        rotation,
        percent(judged.torque_share),
        percent(judged.rate_share),
        force,
        f"{1e3 * judged.sliding:.0f}",
    ]


def percent(share: tuple[float, str] | None) -> str:
    """A share of a limit for a table, with whose it is; nothing where there are no limits."""
    return "" if share is None else f"{100 * share[0]:.0f} % ({share[1]})"


def _flight_section(check: ClipCheck, judged: FlightJudgement) -> str:
    flight = judged.flight
    when = html.escape(f"{check.clip.path.name}, {flight.begin:.2f} to {flight.end:.2f} s")
    tone = {"physical": "good", "unphysical": "bad"}.get(judged.verdict, "open")
    badge = f'<span class="badge {tone}">{judged.verdict}</span>'
    faults = "".join(f"<li>{html.escape(fault)}</li>" for fault in judged.faults)
    charts = [_height_chart(judged, check.gravity), _turning_chart(judged), _feet_chart(check, judged)]
    charts.append(_postures(check, judged))
    return f'<section><h2>{when} {badge}</h2><ul>{faults}</ul><div class="charts">{"".join(charts)}</div></section>'


def _height_chart(judged: FlightJudgement, gravity: float) -> str:
    """The centre of mass in the frames, the parabola nearest to it, and one between the same ends that falls at g."""
    fall = judged.fall
    lines = [Line(fall.times, fall.places[:, 2], "frames", CHART.colours[0], dots=True)]
    if len(fall.times) > 2:
        times = np.linspace(fall.times[0], fall.times[-1], 60)
        nearest = fall.at(times)[:, 2]
        lines.append(Line(times, nearest, f"falls at {fall.fall:.2f} m/s²", CHART.colours[0]))
        lines.append(
            Line(times, nearest + _missing_height(fall, times, gravity), "falls at g", CHART.reference, dashed=True)
        )
    return _chart("height of the centre of mass, m", lines)


def _missing_height(fall: Fall, times: Array, gravity: float) -> Array:
    """How much higher (K,), m, than the nearest parabola one with the same ends and the right fall is."""
    middle = 0.5 * (fall.times[0] + fall.times[-1])
    half = 0.5 * (fall.times[-1] - fall.times[0])
    return np.asarray(0.5 * (gravity - fall.fall) * (half**2 - (times - middle) ** 2))


def _turning_chart(judged: FlightJudgement) -> str:
    """By how much the attitude in each frame is off the nearest flight with a constant momentum."""
    title = "attitude off a flight, degrees"
    if judged.rotation is None:
        return _chart(title, [])
    times = judged.fall.times
    off = np.rad2deg(np.linalg.norm(judged.rotation.residuals, axis=1))
    tolerance = np.rad2deg(judged.rotation.tolerance)
    lines = [
        Line(times, off, "frames", CHART.colours[1], dots=True),
        Line(times[[0, -1]], np.array([tolerance, tolerance]), "limit of their rms", CHART.reference, dashed=True),
    ]
    return _chart(title, lines, least=0.0)


def _feet_chart(check: ClipCheck, judged: FlightJudgement) -> str:
    """Heights of the feet over the ground, in the flight, before and after it."""
    scene = check.clip.scene
    flight = judged.flight
    near = (scene.times >= flight.begin - STANCE_SPAN) & (scene.times <= flight.end + STANCE_SPAN)
    times = scene.times[near]
    heights = scene.foot_heights[near] - scene.ground.heights[near, None]
    lines = []
    for column, name in enumerate(scene.foot_names):
        lines.append(Line(times, heights[:, column], name, CHART.colours[column % len(CHART.colours)]))
    level = np.full(2, FOOT_CLEARANCE)
    lines.append(Line(times[[0, -1]], level, "in the air", CHART.reference, dashed=True))
    return _chart("feet over the ground, m", lines, span=(flight.begin, flight.end))


def _chart(
    title: str, lines: Sequence[Line], least: float | None = None, span: tuple[float, float] | None = None
) -> str:
    """Curves over time as a picture; of no curve a note that there are too few frames.

    Parameters
    ----------
    title : the quantity, with its unit
    lines : the curves
    least : the lowest value that the axis has at least
    span : s, when the flight is, shaded behind the curves
    """
    heading = f'<text x="{CHART.left}" y="13">{html.escape(title)}</text>'
    if not lines:
        return _picture(heading + f'<text x="{CHART.left}" y="{CHART.height / 2}">too few frames</text>')
    x = np.concatenate([line.x for line in lines])
    y = np.concatenate([line.y for line in lines])
    low = float(y.min()) if least is None else min(least, float(y.min()))
    high = max(float(y.max()), low + 1e-3)
    low, high = low - 0.04 * (high - low), high + 0.04 * (high - low)
    first, last = float(x.min()), max(float(x.max()), float(x.min()) + 1e-3)

    def across(values: Array) -> Array:
        return CHART.left + (values - first) / (last - first) * (CHART.width - CHART.left - CHART.right)

    def up(values: Array) -> Array:
        return CHART.height - CHART.bottom - (values - low) / (high - low) * (CHART.height - CHART.top - CHART.bottom)

    parts = [heading]
    if span is not None:
        begin, end = across(np.array(span))
        height = CHART.height - CHART.top - CHART.bottom
        parts.append(f'<rect class="air" x="{begin:.1f}" y="{CHART.top}" width="{end - begin:.1f}" height="{height}"/>')
    for value in _ticks(low, high):
        pixel = float(up(np.array(value)))
        parts.append(
            f'<line class="axis" x1="{CHART.left}" x2="{CHART.width - CHART.right}" y1="{pixel:.1f}" y2="{pixel:.1f}"/>'
        )
        parts.append(f'<text x="{CHART.left - 5}" y="{pixel + 4:.1f}" text-anchor="end">{value:g}</text>')
    for value in _ticks(first, last):
        pixel = float(across(np.array(value)))
        parts.append(f'<text x="{pixel:.1f}" y="{CHART.height - 10}" text-anchor="middle">{value:g} s</text>')
    for number, line in enumerate(lines):
        parts.append(_curve(across(line.x), up(line.y), line))
        parts.append(
            f'<text x="{CHART.width - CHART.right + 8}" y="{CHART.top + 12 + 14 * number}" style="fill:{line.colour}">'
            f"{html.escape(line.name)}</text>"
        )
    return _picture("".join(parts))


def _curve(x: Array, y: Array, line: Line) -> str:
    if line.dots:
        dots = ""
        for a, b in zip(x, y, strict=True):
            dots += f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.2" fill="{line.colour}"/>'
        return dots
    dashes = ' stroke-dasharray="5 4"' if line.dashed else ""
    return f'<polyline points="{_points(x, y)}" stroke="{line.colour}"{dashes}/>'


def _points(x: Array, y: Array) -> str:
    """Corners (K,), (K,) px, as SVG lists them."""
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two others."""
    rough = (high - low) / 6  # six of them at most
    power = 10.0 ** np.floor(np.log10(rough))
    steps = power * np.array([1.0, 2.0, 5.0, 10.0])
    step = steps[steps >= rough][0]
    numbers = np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    return [round(float(number * step), 10) + 0.0 for number in numbers]


def _postures(check: ClipCheck, judged: FlightJudgement) -> str:
    """The robot at equal steps of the flight, side by side over the ground, seen from its right."""
    clip = check.clip
    times = np.linspace(judged.flight.begin, judged.flight.end, CHART.postures)
    poses = clip.curve.poses(times)
    forward = poses.rotations[0, 1, :2, 0]
    length = float(np.linalg.norm(forward))
    forward = forward / length if length > 1e-6 else np.array([1.0, 0.0])
    right = np.array([forward[1], -forward[0]])
    solids = rendered_solids(clip.robot)
    outlines = []  # of each solid its corners (K, k) in the picture, m
    nearness = np.empty((len(solids), CHART.postures))  # [m] to the viewer
    for index, solid in enumerate(solids):
        corners = poses.points(solid.body, solid.points)
        corners[..., :2] -= poses.places[:, 1, None, :2]
        outlines.append(corners[..., :2] @ forward + 1j * corners[..., 2])
        nearness[index] = (corners[..., :2] @ right).mean(axis=1)
    ground = float(clip.ground.at(times[:1])[0])
    shown = np.concatenate(outlines, axis=1)
    low, high = min(float(shown.imag.min()), ground), float(shown.imag.max())
    apart = 1.1 * float(np.ptp(shown.real))
    scale = min((CHART.width - 20) / (apart * CHART.postures), (CHART.height - CHART.top - 20) / (high - low))
    colours = palette(len(clip.robot.joints) + 1)
    parts = [f'<text x="10" y="13">the robot, {times[1] - times[0]:.2f} s from one to the next</text>']
    level = CHART.height - 14 - scale * (ground - low)
    parts.append(f'<line class="axis" x1="0" x2="{CHART.width}" y1="{level:.1f}" y2="{level:.1f}"/>')
    for posture in range(CHART.postures):
        left = 10 + scale * (apart * posture - shown.real.min())
        for index in nearness[:, posture].argsort():  # what is nearer is painted over what is farther
            link = convex_hull(outlines[index][posture])
            x = left + scale * link.real
            y = CHART.height - 14 - scale * (link.imag - low)
            fill = to_hex(colours[solids[index].segment])
            parts.append(f'<polygon class="posture" points="{_points(x, y)}" fill="{fill}"/>')
    return _picture("".join(parts))


def _picture(content: str) -> str:
    width, height = CHART.width, CHART.height
    return f'<svg class="chart" width="{width}" height="{height}" viewBox="0 0 {width} {height}">{content}</svg>'
