"""Pictures of the moving robot: along the path of its centre of mass, side by side, and against another plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.view.figures.curves import plan_names
from floatplan.view.postures import Postures, com_path, posture_at, postures, robot_size, stadium
from floatplan.view.style import COLUMN, GREY, INK, faded, legend_above, new_figure, palette, round_below
from floatplan.view.surroundings import draw_ground, draw_obstacle, obstacle_corners, obstacle_outlines, obstacle_times

STEP = 0.45  # [-] path of the centre of mass from snapshot to snapshot, in sizes of the robot
FEWEST_SNAPSHOTS, MOST_SNAPSHOTS = 7, 11  # [-] snapshots along the path
PALEST = 0.30  # [-] strength of the first snapshot's colours
MARK = 0.95  # [-] size of the dots on the frames that take off and land, in radii of the link
TOUCH = 1e-3  # [m] standing on the ground is not running into it
PASSAGE_SAMPLES = 513  # [-] instants among which the deepest penetration is sought
BACKGROUND = 0.3  # [-] strength of the snapshots behind the two robots compared
CLOSE_UP = 0.12  # [-] room around two robots compared and the obstacle, in sizes of their box
FLATTEST, TALLEST = 0.45, 1.35  # [-] height of a picture over its width


def snapshots(plan: Plan) -> Figure:
    """Draw the robot along the path of its centre of mass, from light at takeoff to full colour at landing."""
    placed = postures(plan, snapshot_times(plan))
    low, high = picture_box(plan, placed)
    figure, axes = spatial_figure(low, high)
    draw_surroundings(axes, plan, placed)
    draw_flight(axes, plan, placed)
    key(figure, plan, placed.times[1])
    return figure


def snapshot_times(plan: Plan) -> Array:
    """Instants (K,) evenly spaced in time, so many that neighbours stand apart."""
    path = float(np.abs(np.diff(com_path(plan, np.linspace(0, plan.duration, 65)))).sum())
    count = int(np.clip(round(path / (STEP * robot_size(plan))) + 1, FEWEST_SNAPSHOTS, MOST_SNAPSHOTS))
    return np.linspace(0, plan.duration, count)


def draw_surroundings(axes: Axes, plan: Plan, placed: Postures, instant: float | None = None) -> None:
    """Draw ground and obstacles onto axes in metres; obstacles that move at one instant, or several."""
    draw_ground(axes, placed)
    for obstacle in plan.problem.obstacles:
        times = obstacle_times(obstacle, plan.duration) if instant is None else np.array([instant])
        draw_obstacle(axes, obstacle, times)


def draw_flight(axes: Axes, plan: Plan, placed: Postures, strengths: Sequence[float] | None = None) -> None:
    """Draw path, postures and goal onto axes in metres."""
    count = len(placed.times)
    draw_path(axes, plan, placed)
    goal = posture_at(plan, plan.problem.final, plan.duration)
    draw_posture(axes, goal, 0, strength=0.0, zorder=3 + count - 1.5, rings=((INK, 4.6), ("white", 3.2)))
    for index, strength in enumerate(strengths or np.linspace(PALEST, 1, count)):
        rings = ((INK, 1.4),) if index == 0 else (("white", 1.0),)
        rings = rings if index < count - 1 else (("white", 2.4),)
        draw_posture(axes, placed, index, strength=strength, zorder=3 + index, rings=rings)


def draw_posture(
    axes: Axes,
    placed: Postures,
    index: int,
    *,
    strength: float,
    zorder: float,
    rings: Sequence[tuple[Any, float]] = (),
    shift: complex = 0j,
    colour: Any = None,
) -> None:
    """Draw one posture: rings (colour, points of width) around the whole robot, its links, the two frames' marks."""
    offset = np.array([shift.real, shift.imag])
    outlines = [outline + offset for outline in placed.outlines(index)]
    colours = palette(int(placed.part.max()) + 1)
    fills = [faded(colours[part] if colour is None else colour, strength) for part in placed.part]
    drawn = [(outline, faded(ring, 1.0), width) for ring, width in rings for outline in outlines]
    drawn += [(outline, fill, 0.0) for outline, fill in zip(outlines, fills, strict=True)]
    for place, fill, size in _marks(placed, index):
        drawn.append((stadium(place + shift, place + shift, size), faded(fill, max(strength, 0.5)), 0.0))
    shapes, faces, widths = zip(*drawn, strict=True)
    axes.add_collection(
        PolyCollection(shapes, facecolors=faces, edgecolors=faces, linewidths=widths, joinstyle="round", zorder=zorder),
        autolim=False,
    )


def _marks(placed: Postures, index: int) -> list[tuple[complex, str, float]]:
    """Discs (place, colour, radius) that mark the frames: full where it lands, hollow where it takes off."""
    radius = MARK * float(placed.radius.min())
    takeoff, landing = complex(placed.takeoff[index]), complex(placed.landing[index])
    return [(landing, INK, radius), (takeoff, INK, radius), (takeoff, "white", 0.6 * radius)]


def draw_path(axes: Axes, plan: Plan, placed: Postures) -> None:
    """Draw the path of the centre of mass, with a dot per snapshot."""
    com = com_path(plan, np.linspace(0, plan.duration, 129))
    axes.plot(com.real, com.imag, color=GREY, linewidth=0.7, zorder=2)
    axes.plot(
        placed.com.real,
        placed.com.imag,
        linestyle="none",
        marker="o",
        markersize=2.6,
        color=INK,
        markeredgecolor="white",
        markeredgewidth=0.4,
        zorder=80,
    )


def picture_box(plan: Plan, placed: Postures) -> tuple[complex, complex]:
    """Corners of what a picture must hold, m."""
    goal = posture_at(plan, plan.problem.final, plan.duration)
    corners = [corner for each in (placed, goal) for corner in (each.low, each.high)]
    points = [np.stack((corner.real, corner.imag), axis=1) for corner in corners]
    points += [obstacle_corners(obstacle, plan.duration) for obstacle in plan.problem.obstacles]
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    pad = 0.04 * float(np.max(high - low))
    return complex(low[0] - pad, low[1] - pad), complex(high[0] + pad, high[1] + pad)


def spatial_figure(low: complex, high: complex) -> tuple[Figure, Axes]:
    """Return a figure whose axes hold a box, m, at equal scales, widened to a shape that suits a column."""
    middle, width, height = (low + high) / 2, (high - low).real, (high - low).imag
    width, height = max(width, height / TALLEST), max(height, FLATTEST * width)
    figure = new_figure(COLUMN, 0.66 + (COLUMN - 0.5) * height / width)
    axes = figure.add_subplot()
    frame_box(axes, middle - complex(width, height) / 2, middle + complex(width, height) / 2)
    axes.grid(False)
    step = round_below(max(width, height) / 4)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    axes.set(xlabel="horizontal (m)", ylabel="vertical (m)")
    return figure, axes


def frame_box(axes: Axes, low: complex, high: complex) -> None:
    """Let axes show a box, m, at equal scales."""
    axes.set(xlim=(low.real, high.real), ylim=(low.imag, high.imag))
    axes.set_aspect("equal")


def key(figure: Figure, plan: Plan, spacing: float) -> None:
    """Tell above a picture what its marks mean."""
    problem = plan.problem
    dot: dict[str, Any] = {
        "marker": "o",
        "linestyle": "none",
        "markersize": 3.6,
        "markeredgewidth": 0.6,
        "markeredgecolor": INK,
    }
    entries: list[tuple[Any, str]] = [
        (
            Line2D([], [], color=GREY, linewidth=0.7, marker="o", markersize=2.6, markerfacecolor=INK, mew=0),
            f"CM every {spacing:.2g} s",
        ),
        (Line2D([], [], markerfacecolor="white", **dot), problem.takeoff.frame),
    ]
    if problem.landing.frame != problem.takeoff.frame:
        entries.append((Line2D([], [], markerfacecolor=INK, **dot), problem.landing.frame))
    entries.append((Patch(facecolor="white", edgecolor=INK, linewidth=0.8), "goal"))
    legend_above(figure, entries)


def comparison(plan: Plan, compare: Plan) -> Figure:
    """Draw a plan and, in black, the other plan's robot where that is deepest in an obstacle or its margin.

    Both robots are drawn at that instant, this plan's in full colour over its own faint snapshots, and the picture
    holds them and the obstacle. Where the other plan meets none it is the middle of the flight.
    """
    time, obstacle = worst_passage(plan, compare)
    placed = postures(plan, snapshot_times(plan))
    own = postures(plan, np.array([time]))
    other = replace(postures(compare, np.array([time])), radius=own.radius)
    figure, axes = spatial_figure(*_close_up(own, other, obstacle, time))
    draw_surroundings(axes, plan, placed, time)
    draw_flight(axes, plan, placed, strengths=[BACKGROUND] * len(placed.times))
    draw_path(axes, compare, other)
    draw_posture(axes, other, 0, strength=1.0, zorder=70, rings=(("white", 1.6),), colour=INK)
    draw_posture(axes, own, 0, strength=1.0, zorder=71, rings=(("white", 1.6),))
    names = plan_names(plan, compare)
    colours = tuple(Patch(facecolor=colour) for colour in palette(int(own.part.max()) + 1))
    entries = [(colours, f"{names[0]}, at {time:.2f} s"), (Patch(facecolor=INK), f"{names[1]}")]
    legend_above(figure, entries)
    return figure


def worst_passage(plan: Plan, compare: Plan) -> tuple[float, Obstacle | None]:
    """Return when the other plan is deepest in an obstacle of this one or its margin, s, and which; or mid-flight."""
    duration = min(plan.duration, compare.duration)
    times = np.linspace(0, duration, PASSAGE_SAMPLES)
    worst: tuple[float, float, Obstacle | None] = (-TOUCH, duration / 2, None)
    for obstacle in plan.problem.obstacles:
        left = compare.clearances(times, [obstacle]) - obstacle.margin
        if left.min() < worst[0]:
            worst = float(left.min()), float(times[left.argmin()]), obstacle
    return worst[1:]


def _close_up(own: Postures, other: Postures, obstacle: Obstacle | None, time: float) -> tuple[complex, complex]:
    """Corners of a box around two robots and what they pass, m."""
    corners = np.concatenate((own.low, own.high, other.low, other.high))
    points = np.stack((corners.real, corners.imag), axis=1)
    if obstacle is not None and obstacle.bounded:
        points = np.concatenate((points, *obstacle_outlines(obstacle, time, obstacle.margin)))
    low, high = points.min(axis=0), points.max(axis=0)
    room = CLOSE_UP * float(np.max(high - low))
    return complex(low[0] - room, low[1] - room), complex(high[0] + room, high[1] + room)
