"""Data of the report's page: samples of the motion, and the weights that place the robot's links from them.

The page places the robot as :class:`~floatplan.robot.planar.tree.PlanarTree` does, from orientation and joints, so that
a few numbers per instant move any robot. Columns are in SI units and radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_hex

from floatplan.arrays import Array, ComplexArray
from floatplan.files import plain
from floatplan.plans.plan import Plan
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.view.charts import NEAR, Chart, Curve, SampledPlan, clearance_ceiling
from floatplan.view.figures.snapshots import picture_box, snapshot_times
from floatplan.view.postures import drawn_part, drawn_radius, postures
from floatplan.view.style import ALARM, INK, OBSTACLES, TRAILS, palette
from floatplan.view.surroundings import ground_lines, obstacle_outlines

FEWEST_SAMPLES, MOST_SAMPLES = 601, 2401  # [-] samples of a flight; odd, so that its middle is one
SAMPLE_RATE = 300  # [Hz]
DIGITS = 11  # [-] of the numbers in the page, which compares with the plan to 1e-6
BOX_PAD = 0.02  # [-] room around what is drawn


def motion_data(sampled: SampledPlan) -> dict[str, Any]:
    """Return all that moves: duration, columns (names to samples), robot, frames, obstacles, ghosts, ground, box."""
    plan = sampled.plan
    placed = postures(plan, snapshot_times(plan))
    return {
        "duration": plan.duration,
        "columns": {name: rounded(values) for name, values in sampled.columns.items()},
        **scene_data(plan.problem),
        "ghosts": rounded(placed.times),
        "goal": _goal(plan),
        "ground": [[level, low.real, high.real] for level, low, high in ground_lines(placed)],
        "box": _box(plan),
    }


def sample_grid(duration: float) -> Array:
    """Instants (N,) of the columns, s: evenly spaced, the middle of the flight among them."""
    count = int(np.clip(duration * SAMPLE_RATE, FEWEST_SAMPLES - 1, MOST_SAMPLES - 1)) // 2 * 2 + 1
    return np.linspace(0.0, duration, count)


def chart_data(chart: Chart, sampled: SampledPlan) -> dict[str, Any]:
    """Return a chart as the page reads it.

    It has a title, a unit, a factor from SI to it, ``series`` (name, colour, key of its column, part) and ``lines``
    (name, colour, one value or samples, part): limits, margins and the interval of h. ``beyond`` describes limits that
    would flatten the curves.
    """
    lines, beyond = [], ""
    for panel in chart.panels:
        peak = max(float(np.abs(sampled.columns[curve.key]).max()) for curve in panel.curves)
        near, far = panel.limits(peak)
        for curve, limit in near:
            values = limit[0] if np.ptp(limit) == 0 else limit
            lines += [_line("limit", curve.colour, side * values, curve.part) for side in (1.0, -1.0)]
        if np.isfinite(far) and not beyond:
            beyond = f"limits from {far:.4g}, not drawn"
    if chart.interval is not None:
        low, high = chart.interval
        if max(abs(low), abs(high)) <= NEAR * peak:
            lines += [_line("h of monotonic joints", INK, end) for end in chart.interval]
        else:
            beyond = f"monotonic joints: h from {low:.4g} to {high:.4g}"
    data = {
        "title": chart.title,
        "unit": chart.unit,
        "factor": chart.factor,
        "series": [_series(curve, chart.unit) for curve in chart.curves],
        "lines": lines,
        "beyond": beyond,
    }
    if all(curve.ends is not None for curve in chart.curves):
        data["starts"], data["goals"] = zip(*(curve.ends for curve in chart.curves if curve.ends), strict=True)
    if chart.name == "clearance":
        margins = sorted({obstacle.margin for obstacle in sampled.plan.problem.obstacles})
        values = np.array([sampled.columns[curve.key] for curve in chart.curves])
        top = clearance_ceiling(sampled.plan, values.max(where=np.isfinite(values), initial=0.0))
        data["lines"] = [_line("margin", ALARM, margin) for margin in margins]
        data["range"] = [min(1.1 * values.min(initial=0.0), -0.04 * top), top]
    return data


def _series(curve: Curve, unit: str) -> dict[str, Any]:
    """A curve, with its least limit in words for when it is chosen."""
    data = {"name": curve.name, "colour": to_hex(curve.colour), "key": curve.key, "part": curve.part}
    if curve.limit is None:
        return data
    least = float(np.min(curve.limit))
    return {**data, "limit": f"of {least:.4g} {unit}" if np.isfinite(least) else "no limit"}


def _line(name: str, colour: Any, value: Array | float, part: int | None = None) -> dict[str, Any]:
    return {"name": name, "colour": to_hex(colour), "value": rounded(value), "part": part}


def scene_data(problem: Problem) -> dict[str, Any]:
    """Return what a page needs to place and to paint robot and obstacles, whatever the motion.

    ``robot``; ``frames`` that leave a trail, and how they are marked; the colour of the centre of mass's ``trail``;
    ``obstacles``: outlines of these and their margins where they are given, how they move, and when they exist.
    """
    robot = problem.robot
    roles = {problem.takeoff.frame: "takes off"}
    roles[problem.landing.frame] = "takes off and lands" if problem.landing.frame in roles else "lands"
    frames = [(name, role, robot.frames[name]) for name, role in roles.items()]
    return {
        "robot": _robot(problem),
        "frames": [
            {"name": name, "role": role, "colour": colour, "weights": _weights(robot, [frame.body], [frame.local])[0]}
            for (name, role, frame), colour in zip(frames, TRAILS[1:], strict=False)
        ],
        "trail": TRAILS[0],
        "obstacles": [
            {
                "bounded": obstacle.bounded,
                "colour": OBSTACLES[index % len(OBSTACLES)],
                "outlines": [rounded(each) for each in obstacle_outlines(obstacle, 0.0, 0.0)],
                "margins": [rounded(each) for each in obstacle_outlines(obstacle, 0.0, obstacle.margin)]
                if obstacle.margin > 0
                else [],
                "velocity": list(obstacle.velocity),
                "window": None if obstacle.window is None else list(obstacle.window),
            }
            for index, obstacle in enumerate(problem.obstacles)
        ],
    }


def _robot(problem: Problem) -> dict[str, Any]:
    robot = problem.robot
    bodies, moved = [shape.body for shape in robot.shapes], range(1, len(robot.tree.mass))
    starts = _weights(robot, bodies, [shape.start for shape in robot.shapes])
    ends = _weights(robot, bodies, [shape.end for shape in robot.shapes])
    links = zip(drawn_part(robot).tolist(), drawn_radius(problem).tolist(), starts, ends, strict=True)
    return {
        "joints": list(robot.joints),
        "turn": robot.tree.turn,
        "turns": rounded(robot.tree.turns),
        "offsets": rounded(robot.tree.offsets),
        "links": [{"part": part, "radius": radius, "start": start, "end": end} for part, radius, start, end in links],
        "pivots": _weights(robot, moved, [0j] * len(moved)),
        "colours": [to_hex(colour) for colour in palette(len(robot.joints) + 1)],
    }


def _weights(robot: Robot, bodies: Sequence[int], local: Sequence[complex]) -> Any:
    """Weights of points of bodies, each a list of (real, imaginary) per body."""
    return pairs(robot.tree.point_weights(np.array(bodies, dtype=np.int64), np.array(local, dtype=np.complex128)))


def pairs(values: ComplexArray) -> Any:
    """Return complex numbers as lists of (real, imaginary)."""
    return rounded(np.stack((values.real, values.imag), axis=-1))


def rounded(values: Any) -> Any:
    """Return numbers, or lists of them, of so many digits; None for what is not finite."""
    array = np.asarray(values, dtype=np.float64)
    return plain(float(f"{array:.{DIGITS}g}")) if array.ndim == 0 else [rounded(each) for each in array]


def _goal(plan: Plan) -> dict[str, Any]:
    final = plan.problem.final
    place = plan.ballistics.positions(np.array([plan.duration]))[0]
    return {"orientation": final.orientation, "positions": final.positions.tolist(), "com": place.tolist()}


def _box(plan: Plan) -> list[float]:
    """Left, low, right, high of all that is drawn at any time, m."""
    low, high = picture_box(plan, postures(plan, np.linspace(0.0, plan.duration, 65)))
    room = BOX_PAD * max((high - low).real, (high - low).imag)
    return [low.real - room, low.imag - room, high.real + room, high.imag + room]
