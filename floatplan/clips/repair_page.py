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
from floatplan.clips.formats import continuous_signs
from floatplan.clips.page import clip_words, flights_table, percent
from floatplan.clips.repair import ClipRepair, FlightRepair
from floatplan.clips.stance_forces import StanceFigures
from floatplan.files import json_value, write_atomically
from floatplan.motion.spatial.kinematics import centre_of_mass
from floatplan.motion.spatial.rotations import quaternions_of
from floatplan.view.outlines import floor_lines
from floatplan.view.report.data import moving_robot
from floatplan.view.report.report import page
from floatplan.view.solids import rendered_solids

PLAYED_AROUND = 0.5  # [s] before the first flight that is changed, and after the last, that is played
LONGEST = 40.0  # [s] that is played
TITLES = (
    *("flight, s", "done", "duration, s", "joints, deg rms", "base, deg", "torque", "rate", "feet off, mm"),
    *("ground, weights", "friction", "pressure off, mm"),
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
    parts = ["<h2>what was changed</h2>", html_table("", [_row(flight) for flight in repair.flights], TITLES)]
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in _sentences(repair)]
    parts += ["<h2>before</h2>", clip_words(repair.before), flights_table(repair.before)]
    parts += ["<h2>after</h2>", flights_table(repair.after)]
    pair = []
    for name, shown in (("before", clip), ("after", repaired)):
        begin, end = _played(shown, repair)
        pair.append({"name": name, "motion": motion_data(shown, begin, end)})
    done = sum(flight.repaired is not None and flight.repaired.repairable for flight in repair.flights)
    data: dict[str, Any] = {
        "name": f"{clip.path.name}: repaired",
        "question": f"{clip.robot.name}, {done} of {len(repair.flights)} flights planned anew",
        "version": version("floatplan"),
        "pair": json_value(pair),
    }
    facts = {"facts": "".join(parts)}
    styles = ("report.css", "pair.css")
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


def _played(clip: Clip, repair: ClipRepair) -> tuple[float, float]:
    """From when to when a clip is played, s: its flights that were changed, and a little of the stances around them."""
    changed = [number for number, flight in enumerate(repair.flights) if flight.repaired is not None]
    if not changed or len(clip.flights) != len(repair.flights):
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
