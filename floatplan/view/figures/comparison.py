"""Two plans in one picture, such as one that avoids an obstacle and one planned without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.view.figures.curves import plan_names
from floatplan.view.figures.snapshots import (
    draw_flight,
    draw_path,
    draw_posture,
    draw_surroundings,
    snapshot_times,
    spatial_figure,
)
from floatplan.view.postures import Postures, postures
from floatplan.view.style import INK, legend_above, palette
from floatplan.view.surroundings import obstacle_outline

TOUCH = 1e-3  # [m] standing on the ground is not running into it
SAMPLES = 513  # [-] instants among which the deepest penetration is sought
BACKGROUND = 0.3  # [-] strength of the snapshots behind the two robots compared
PAD = 0.12  # [-] room around the two robots and the obstacle, in sizes of their box


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
    times = np.linspace(0, duration, SAMPLES)
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
        points = np.concatenate((points, obstacle_outline(obstacle, time, obstacle.margin)))
    low, high = points.min(axis=0), points.max(axis=0)
    room = PAD * float(np.max(high - low))
    return complex(low[0] - room, low[1] - room), complex(high[0] + room, high[1] + room)
