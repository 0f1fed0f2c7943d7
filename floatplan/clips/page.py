"""A page on which a person sees why flights of clips fly or not; it needs no network and runs no script."""

from __future__ import annotations

import html
from collections.abc import Sequence
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
from floatplan.view.report.svg_charts import CHART, Line, chart, picture, points
from floatplan.view.solids import rendered_solids
from floatplan.view.style import palette

POSTURES = 5  # [-] of the robot that are shown of a flight
MOST_FLIGHTS = 60  # [-] that have charts, the unphysical ones first; tables list all


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
        "style": asset("report.css") + asset("clip.css"),
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
    faults = "".join(f"<li>{html.escape(fault)}</li>" for fault in judged.faults)
    charts = [_height_chart(judged, check.gravity), _turning_chart(judged), _feet_chart(check, judged)]
    charts.append(_postures(check, judged))
    title = f"<h2>{when} {badge(judged.verdict)}</h2>"
    return f'<section>{title}<ul>{faults}</ul><div class="charts">{"".join(charts)}</div></section>'


def badge(verdict: str) -> str:
    """A verdict as HTML, with the colour of what it says."""
    tone = {"physical": "good", "unphysical": "bad"}.get(verdict, "open")
    return f'<span class="badge {tone}">{verdict}</span>'


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
    return chart("height of the centre of mass, m", lines)


def _missing_height(fall: Fall, times: Array, gravity: float) -> Array:
    """How much higher (K,), m, than the nearest parabola one with the same ends and the right fall is."""
    middle = 0.5 * (fall.times[0] + fall.times[-1])
    half = 0.5 * (fall.times[-1] - fall.times[0])
    return np.asarray(0.5 * (gravity - fall.fall) * (half**2 - (times - middle) ** 2))


def _turning_chart(judged: FlightJudgement) -> str:
    """By how much the attitude in each frame is off the nearest flight with a constant momentum."""
    title = "attitude off a flight, degrees"
    if judged.rotation is None:
        return chart(title, [])
    times = judged.fall.times
    off = np.rad2deg(np.linalg.norm(judged.rotation.residuals, axis=1))
    tolerance = np.rad2deg(judged.rotation.tolerance)
    lines = [
        Line(times, off, "frames", CHART.colours[1], dots=True),
        Line(times[[0, -1]], np.array([tolerance, tolerance]), "limit of their rms", CHART.reference, dashed=True),
    ]
    return chart(title, lines, least=0.0)


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
    return chart("feet over the ground, m", lines, span=(flight.begin, flight.end))


def _postures(check: ClipCheck, judged: FlightJudgement) -> str:
    """The robot at equal steps of the flight, side by side over the ground, seen from its right."""
    clip = check.clip
    times = np.linspace(judged.flight.begin, judged.flight.end, POSTURES)
    poses = clip.curve.poses(times)
    forward = poses.rotations[0, 1, :2, 0]
    length = float(np.linalg.norm(forward))
    forward = forward / length if length > 1e-6 else np.array([1.0, 0.0])
    right = np.array([forward[1], -forward[0]])
    solids = rendered_solids(clip.robot)
    outlines = []  # of each solid its corners (K, k) in the picture, m
    nearness = np.empty((len(solids), POSTURES))  # [m] to the viewer
    for index, solid in enumerate(solids):
        corners = poses.points(solid.body, solid.points)
        corners[..., :2] -= poses.places[:, 1, None, :2]
        outlines.append(corners[..., :2] @ forward + 1j * corners[..., 2])
        nearness[index] = (corners[..., :2] @ right).mean(axis=1)
    ground = float(clip.ground.at(times[:1])[0])
    shown = np.concatenate(outlines, axis=1)
    low, high = min(float(shown.imag.min()), ground), float(shown.imag.max())
    apart = 1.1 * float(np.ptp(shown.real))
    scale = min((CHART.width - 20) / (apart * POSTURES), (CHART.height - CHART.top - 20) / (high - low))
    colours = palette(len(clip.robot.joints) + 1)
    parts = [f'<text x="10" y="13">the robot, {times[1] - times[0]:.2f} s from one to the next</text>']
    level = CHART.height - 14 - scale * (ground - low)
    parts.append(f'<line class="axis" x1="0" x2="{CHART.width}" y1="{level:.1f}" y2="{level:.1f}"/>')
    for posture in range(POSTURES):
        left = 10 + scale * (apart * posture - shown.real.min())
        for index in nearness[:, posture].argsort():  # what is nearer is painted over what is farther
            link = convex_hull(outlines[index][posture])
            x = left + scale * link.real
            y = CHART.height - 14 - scale * (link.imag - low)
            fill = to_hex(colours[solids[index].segment])
            parts.append(f'<polygon class="posture" points="{points(x, y)}" style="--colour:{fill}"/>')
    return picture("".join(parts))
