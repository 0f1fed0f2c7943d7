"""A page that plays a clip and its repair side by side, and says what was changed; it needs no network."""

from __future__ import annotations

import html
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import html_table
from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.flights import STANCE_SPAN
from floatplan.clips.formats import continuous_signs
from floatplan.clips.page import MOST_FLIGHTS, badge, clip_words, flights_table, percent
from floatplan.clips.repair import ClipRepair, FlightRepair
from floatplan.clips.stance_forces import StanceFigures
from floatplan.files import json_value, write_atomically
from floatplan.motion.spatial.kinematics import centre_of_mass
from floatplan.motion.spatial.rotations import quaternions_of
from floatplan.view.outlines import floor_lines
from floatplan.view.report.data import moving_robot
from floatplan.view.report.report import page
from floatplan.view.report.svg_charts import CHART, Line, chart
from floatplan.view.solids import rendered_solids

PLAYED_AROUND = 0.5  # [s] before the first flight that is changed, and after the last, that is played
LONGEST = 40.0  # [s] that is played
TITLES = (
    *("flight, s", "done", "duration, s", "joints, deg rms", "base, deg", "torque", "rate", "feet off, mm"),
    *("least ground force, weights", "friction", "pressure off, mm"),
)


def write_repair_page(repaired: Clip, repair: ClipRepair, path: str | Path) -> Path:
    """Write a page about a clip that was repaired.

    Parameters
    ----------
    repaired : Clip
    repair : ClipRepair
        What was done, with the clip as it was.
    path : of the page
    """
    clip = repair.before.clip
    parts = ["<h2>What was changed</h2>", html_table("", [_row(flight) for flight in repair.flights], TITLES)]
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in _sentences(repair)]
    parts += _flight_sections(repair)
    parts += ["<h2>Before</h2>", clip_words(repair.before), flights_table(repair.before)]
    parts += ["<h2>After</h2>", flights_table(repair.after)]
    pair = []
    for name, shown in (("before", clip), ("after", repaired)):
        begin, end = _played(shown, repair)
        flights = [[flight.begin - begin, flight.end - begin] for flight in shown.flights]
        pair.append({"name": name, "motion": motion_data(shown, begin, end), "flights": flights})
    done = sum(flight.repaired is not None and flight.repaired.repairable for flight in repair.flights)
    data: dict[str, Any] = {
        "name": f"{clip.path.name}: repaired",
        "question": f"{clip.robot.name}, {done} of {len(repair.flights)} flights planned anew",
        "version": version("floatplan"),
        "pair": json_value(pair),
    }
    facts = {"facts": "".join(parts)}
    styles = ("report.css", "clip.css", "pair.css")
    made = page(
        "pair.html",
        data["name"],
        styles,
        ("theme.js", "motion.js", "camera.js", "stage.js", "player.js", "pair.js"),
        data,
        facts,
    )
    return write_atomically(path, made)


def _row(flight_repair: FlightRepair) -> list[str]:
    flight = flight_repair.flight
    when = f"{flight.begin:.2f} to {flight.end:.2f}"
    repaired = flight_repair.repaired
    if repaired is None:
        return [when, "left as it is", *[""] * (len(TITLES) - 2)]
    changes = ["", ""]
    if repaired.plan is not None:
        changes = [f"{np.rad2deg(value):.2g}" for value in (repaired.joints_rms, repaired.base_largest)]
    return [
        when,
        str(repaired.choice) if repaired.repairable else "not repairable",
        f"{flight.duration:.3f} to {repaired.duration:.3f}",
        *changes,
        percent(repaired.torque_share),
        percent(repaired.rate_share),
        f"{1e3 * flight_repair.seam_foot:.2f}",
        *_stance_cells(flight_repair.stance),
    ]


def _stance_cells(stance: StanceFigures | None) -> list[str]:
    if stance is None:
        return ["", "", ""]
    friction = f"{stance.friction:.2f}" if np.isfinite(stance.friction) else "none would do"
    return [f"{stance.vertical_least:.2f}", friction, f"{1e3 * stance.pressure_outside:.0f}"]


def _sentences(repair: ClipRepair) -> list[str]:
    """What a reader should know besides the numbers: why flights are not repaired, and what stances would take."""
    sentences = []
    for flight_repair in repair.flights:
        repaired = flight_repair.repaired
        if repaired is not None and not repaired.repairable:
            flight = flight_repair.flight
            sentences.append(f"{flight.begin:.2f} to {flight.end:.2f} s is not repairable: {repaired.reason}.")
        sentences += [f"{flight_repair.flight.begin:.2f} s, {stance.sentence}." for stance in flight_repair.stances]
    stances = [flight for flight in repair.flights if flight.stance is not None]
    adhesive = sum(flight.is_adhesive for flight in stances)
    if adhesive:
        sentences.append(
            f"Stances are bent, not planned: next to {adhesive} of {len(stances)} repaired flights the ground would "
            "have to be adhesive."
        )
    return sentences


def _flight_sections(repair: ClipRepair) -> list[str]:
    """Curves before and after the repair of each flight that was changed; of so many as pages of checks have."""
    if not _same_flights(repair):
        return []
    sections = []
    for number, flight_repair in enumerate(repair.flights):
        repaired = flight_repair.repaired
        if repaired is None or not repaired.repairable:
            continue
        verdicts = [check.flights[number].verdict for check in (repair.before, repair.after)]
        flight = flight_repair.flight
        title = f"{flight.begin:.2f} to {flight.end:.2f} s {badge(verdicts[0])} → {badge(verdicts[1])}"
        charts = "".join(_pair_of_charts(repair, number))
        sections.append(f'<section><h2>{title}</h2><div class="charts">{charts}</div></section>')
    return sections[:MOST_FLIGHTS]


def _pair_of_charts(repair: ClipRepair, number: int) -> tuple[str, str]:
    """Heights of the centre of mass, and forces of the ground, of both clips, each from its takeoff on."""
    apart = 0.005  # [s] between the points of the curves
    span = 0.02  # [s] to either side, of second differences: as the forces of bent stances have it
    heights = []
    forces = []
    for index, (name, clip) in enumerate((("before", repair.before.clip), ("after", repair.result))):
        flight = clip.flights[number]
        begin = max(flight.begin - STANCE_SPAN, span)
        end = min(flight.end + STANCE_SPAN, clip.duration - span)
        times = np.arange(begin, end, apart)
        early, now, late = (_com_heights(clip, times + shift) for shift in (-span, 0.0, span))
        force = (early - 2.0 * now + late) / span**2 / repair.before.gravity + 1.0
        since = times - flight.begin
        heights.append(Line(since, now, name, CHART.colours[index]))
        forces.append(Line(since, force, name, CHART.colours[index]))
    ends = forces[0].x[[0, -1]]
    forces.append(Line(ends, np.zeros(2), "none", CHART.reference, dashed=True))
    in_air = (0.0, repair.result.flights[number].duration)
    return (
        chart("height of the centre of mass, m; from takeoff on", heights, span=in_air),
        chart("vertical force of the ground, weights", forces, span=in_air),
    )


def _com_heights(clip: Clip, times: Array) -> Array:
    """Heights (K,) of a clip's centre of mass, m."""
    return np.asarray(centre_of_mass(clip.robot, clip.curve.poses(times))[:, 2])


def _same_flights(repair: ClipRepair) -> bool:
    """Whether the result has as many flights as the clip: then those with the same number are pairs."""
    return len(repair.result.flights) == len(repair.flights)


def _played(clip: Clip, repair: ClipRepair) -> tuple[float, float]:
    """From when to when a clip is played, s: its flights that were changed, and a little of the stances around them."""
    changed = [number for number, flight in enumerate(repair.flights) if flight.repaired is not None]
    if not changed or not _same_flights(repair):
        return 0.0, min(clip.duration, LONGEST)
    begin = max(clip.flights[changed[0]].begin - PLAYED_AROUND, 0.0)
    return begin, min(clip.flights[changed[-1]].end + PLAYED_AROUND, clip.duration, begin + LONGEST)


def motion_data(clip: Clip, begin: float, end: float) -> dict[str, Any]:
    """Return an interval of a clip as the page's moving robot has it: columns at equal steps of time, and the floor."""
    robot = clip.robot
    times = np.linspace(begin, end, max(int((end - begin) * 60.0), 4) + 1)  # played at 60 Hz
    poses = clip.curve.poses(times)
    positions = clip.curve.positions(times)[:, [robot.model_joints.index(joint) for joint in robot.joints]]
    com = centre_of_mass(robot, poses)
    quaternions = continuous_signs(quaternions_of(clip.curve.attitudes(times)))
    columns: dict[str, Array] = {f"com_{axis}": column for axis, column in zip("xyz", com.T, strict=True)}
    columns |= {f"base_{axis}": column for axis, column in zip("xyz", poses.places[:, 1].T, strict=True)}
    columns |= {f"quaternion.{index}": column for index, column in enumerate(quaternions.T)}
    columns |= {f"positions.{index}": column for index, column in enumerate(positions.T)}
    placed = np.concatenate([poses.points(solid.body, solid.points) for solid in rendered_solids(robot)], axis=1)
    low = placed.min(axis=(0, 1))
    high = placed.max(axis=(0, 1))
    return moving_robot(
        robot,
        columns,
        duration=end - begin,
        ball=((low + high) / 2, float(np.linalg.norm(high - low)) / 2),
        floor=floor_lines(low, high, float(clip.ground.at(times[:1])[0])),
        goal={
            "base": [*poses.places[-1, 1], *quaternions[-1]],
            "positions": positions[-1],
            "com": com[-1],
        },
    )
