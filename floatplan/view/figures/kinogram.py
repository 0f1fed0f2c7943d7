"""The kinogram: postures side by side, read like text, for flights that stay in one place or turn over and over."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.view.figures.snapshots import draw_posture
from floatplan.view.postures import Postures, posture_at, postures
from floatplan.view.style import COLUMN, INK, new_figure, round_below

COLUMNS = 5  # [-]
TURN = math.radians(60)  # [rad] of any body against the ground, from one posture to the next
ROWS = (2, 4)  # [-] fewest and most
GAP = 0.07  # [in] between neighbours
CAPTION = 0.19  # [in] for the line of text under a row
RULE = 0.16  # [in] for the scale under the last row


@dataclass(frozen=True)
class Grid:
    """Places of the postures: ``pitch`` from one to the next, lines through the centres of mass, lower ends, m.

    ``scale`` is metres per inch of paper, ``height`` that of the whole, m.
    """

    pitch: float
    lines: tuple[float, ...]
    bottoms: tuple[float, ...]
    scale: float
    height: float


def kinogram(plan: Plan) -> Figure:
    """Draw postures at even steps in time, side by side in rows; the centre of mass always on a row's line."""
    placed = postures(plan, kinogram_times(plan))
    goal = posture_at(plan, plan.problem.final, plan.duration)
    grid = _grid(placed, goal)
    figure = new_figure(COLUMN, grid.height / grid.scale)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, COLUMN * grid.scale), ylim=(-grid.height, 0))
    axes.set_aspect("equal")
    axes.set_axis_off()
    for index, time in enumerate(placed.times):
        row, column = divmod(index, COLUMNS)
        center = complex((column + 0.5) * grid.pitch, grid.lines[row])
        _draw_cell(axes, placed, index, center, goal if index == len(placed.times) - 1 else None)
        axes.text(center.real, grid.bottoms[row] - 0.03 * grid.scale, f"{time:.2f} s", ha="center", va="top", size=6.5)
    _draw_rule(axes, grid)
    return figure


def kinogram_times(plan: Plan) -> Array:
    """Instants (K,) evenly spaced in time that fill two to four rows: the more the robot turns, the more."""
    times = np.linspace(0, plan.duration, 129)
    angles = plan.robot.tree.absolute_angles(plan.orientation(times), plan.joint_motion(times)[0])
    turned = float(np.abs(np.diff(angles, axis=0)).sum(axis=0).max())
    rows = int(np.clip(math.ceil(turned / TURN / COLUMNS), *ROWS))
    return np.linspace(0, plan.duration, rows * COLUMNS)


def _grid(placed: Postures, goal: Postures) -> Grid:
    """Set the postures so near one another that none touches its neighbours."""
    low, high = placed.low - placed.com, placed.high - placed.com
    least, most = (goal.low - goal.com)[0], (goal.high - goal.com)[0]
    low[-1] = complex(min(low[-1].real, least.real), min(low[-1].imag, least.imag))
    high[-1] = complex(max(high[-1].real, most.real), max(high[-1].imag, most.imag))
    left, right = -low.real.reshape(-1, COLUMNS), high.real.reshape(-1, COLUMNS)
    widest = max(float((right[:, :-1] + left[:, 1:]).max()), 2 * float(left[:, 0].max()), 2 * float(right[:, -1].max()))
    scale = widest * COLUMNS / (COLUMN - GAP * COLUMNS)
    pitch = COLUMN * scale / COLUMNS
    above = high.imag.reshape(-1, COLUMNS).max(axis=1) + GAP / 2 * scale
    below = low.imag.reshape(-1, COLUMNS).min(axis=1) - GAP / 2 * scale
    heights = above - below + CAPTION * scale
    tops = -np.concatenate(([0.0], np.cumsum(heights)))
    lines = tops[:-1] - above
    return Grid(pitch, tuple(lines), tuple(lines + below), scale, float(-tops[-1] + RULE * scale))


def _draw_cell(axes: Axes, placed: Postures, index: int, center: complex, goal: Postures | None) -> None:
    if goal is not None:
        rings = ((INK, 3.6), ("white", 2.4))
        draw_posture(axes, goal, 0, strength=0.0, zorder=3, rings=rings, shift=center - complex(goal.com[0]))
    ring = (INK, 1.2) if index == 0 else ("white", 0.8)
    draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(ring,), shift=center - complex(placed.com[index]))
    dot: dict[str, Any] = {"markersize": 2.2, "markeredgecolor": "white", "markeredgewidth": 0.4}
    axes.plot(center.real, center.imag, marker="o", color=INK, zorder=5, **dot)


def _draw_rule(axes: Axes, grid: Grid) -> None:
    """Draw a scale: a round length, at most one cell."""
    length = round_below(0.9 * grid.pitch)
    left, tick, height = 0.1 * grid.scale, 0.025 * grid.scale, -grid.height + 0.07 * grid.scale
    axes.plot([left, left + length], [height, height], color=INK, linewidth=0.8, solid_capstyle="butt")
    for end in (left, left + length):
        axes.plot([end, end], [height - tick, height + tick], color=INK, linewidth=0.8)
    axes.text(left + length + 2 * tick, height, f"{length:g} m", ha="left", va="center", size=6.5)
