"""Ground and obstacles, drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D

from floatplan.arrays import Array
from floatplan.problem.parts import Bar, Circle, HalfPlane, Obstacle
from floatplan.view.postures import Postures, stadium
from floatplan.view.style import INK, faded

STANDING = 0.02  # [-] of the robot's size: how far it may reach below the ground that it stands on
SINKING = 0.15  # [-] of the robot's size: a flight that goes deeper is drawn without ground
SOLID = "#9a9a9a"
WIDE = 1e3  # [m] half-planes end outside every picture


def ground_lines(placed: Postures) -> list[tuple[float, complex, complex]]:
    """Find the ground that a flight leaves and comes back to.

    There is ground where the robot stands on the frame that takes off or lands and nothing of it is below. Ends at one
    height have one ground, and must both stand on it. What flies far below the ground has none.

    Returns
    -------
    list of (height, low, high)
        m; the ground is drawn below the box between the corners.
    """
    low, high = placed.low, placed.high
    size = float(np.abs(high - low).max())
    slack = STANDING * size + float(placed.radius.min())
    heights = float(placed.takeoff[0].imag), float(placed.landing[-1].imag)
    stands = [
        low[end].imag >= height - slack and low.imag.min() >= height - SINKING * size
        for end, height in zip((0, -1), heights, strict=True)
    ]
    if abs(heights[0] - heights[1]) <= STANDING * size:
        level = float(min(low[0].imag, low[-1].imag))
        corners = complex(low.real.min(), level), complex(high.real.max(), level)
        return [(level, *corners)] if all(stands) else []
    ends = zip(stands, (0, -1), strict=True)
    return [(float(low[end].imag), complex(low[end]), complex(high[end])) for stand, end in ends if stand]


def draw_ground(axes: Axes, placed: Postures, whole_width: bool = True) -> None:
    """Draw the ground line, through the whole picture where it is the same at takeoff and landing."""
    lines = ground_lines(placed)
    for height, low, high in lines:
        if whole_width and len(lines) == 1:
            axes.axhline(height, color=INK, linewidth=0.9, zorder=1)
        else:
            reach = 0.15 * (high - low).real
            axes.add_line(Line2D([low.real - reach, high.real + reach], [height] * 2, color=INK, linewidth=0.9))


def draw_obstacle(axes: Axes, obstacle: Obstacle, times: Array) -> None:
    """Draw an obstacle and its margin at some instants (K,), s, from light to full where there are several."""
    for index, time in enumerate(times):
        strength = 0.35 + 0.65 * (index + 1) / len(times)
        edge = faded(INK, strength)
        body = obstacle_outlines(obstacle, time, 0.0)
        solid = PolyCollection(body, facecolors=[faded(SOLID, strength)], edgecolors=[edge], linewidths=0.6)
        axes.add_collection(solid, autolim=False)
        solid.set_zorder(1.5)
        if obstacle.margin > 0:
            ring = PolyCollection(
                obstacle_outlines(obstacle, time, obstacle.margin),
                facecolors="none",
                edgecolors=[edge],
                linewidths=0.6,
                linestyles=[(0, (2, 1.5))],
                zorder=90,
            )
            axes.add_collection(ring, autolim=False)


def obstacle_times(obstacle: Obstacle, duration: float) -> Array:
    """Return the instants at which to draw an obstacle: one where it stands still, else five."""
    low, high = obstacle.window or (0.0, duration)
    if not any(obstacle.velocity):
        return np.array([low])
    return np.linspace(max(low, 0.0), min(high, duration), 5)


def obstacle_outlines(obstacle: Obstacle, time: float, margin: float) -> list[Array]:
    """Outlines (points, 2) of an obstacle's pieces grown by a margin, at a time, m."""
    shift = complex(*obstacle.velocity) * time
    return [OUTLINES[piece.kind](piece, shift, margin) for piece in obstacle.pieces]


def _circle(obstacle: Circle, shift: complex, margin: float) -> Array:
    angles = np.linspace(0, 2 * np.pi, 97)
    points = complex(*obstacle.center) + shift + (obstacle.radius + margin) * np.exp(1j * angles)
    return np.stack((points.real, points.imag), axis=1)


def _bar(obstacle: Bar, shift: complex, margin: float) -> Array:
    return stadium(complex(*obstacle.start) + shift, complex(*obstacle.end) + shift, obstacle.radius + margin)


def _half_plane(obstacle: HalfPlane, shift: complex, margin: float) -> Array:
    normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
    edge = complex(*obstacle.point) + shift + margin * normal
    corners = edge + WIDE * np.array([-1j, 1j, 1j - 1, -1j - 1]) * normal
    return np.stack((corners.real, corners.imag), axis=1)


OUTLINES: dict[str, Callable[[Any, complex, float], Array]] = {
    "circle": _circle,
    "half-plane": _half_plane,
    "capsule": _bar,
}


def obstacle_corners(obstacle: Obstacle, duration: float) -> Array:
    """Points (points, 2) that a picture must hold to show an obstacle, m; none for one without bounds."""
    if not obstacle.bounded:
        return np.empty((0, 2))
    return np.concatenate(
        [
            outline
            for time in obstacle_times(obstacle, duration)
            for outline in obstacle_outlines(obstacle, time, obstacle.margin)
        ]
    )
