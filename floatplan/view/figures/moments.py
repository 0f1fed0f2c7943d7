"""Moments of a jump side by side, with the forces on its feet inside their friction cones."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from floatplan.arrays import Array, ComplexArray
from floatplan.view.figures.snapshots import draw_posture, frame_box
from floatplan.view.jumps import JumpView
from floatplan.view.outlines import Postures, pairs, postures
from floatplan.view.style import COLUMN, INK, PALE, faded, legend_above, new_figure, round_below

WIDTH = 2 * COLUMN + 0.3  # [in] both columns of a paper
GAP = 0.12  # [-] room between moments, in widths of the widest
BESIDE, ABOVE = 0.06, 0.04  # [-] room around them, in their height
CAPTION = 0.22  # [in] for times under the ground
SHORTEST = 0.01  # [m] of an arrow
LEGEND = 0.25  # [in]
ARROW: dict[str, Any] = {
    "arrowstyle": "-|>,head_width=0.13,head_length=0.28",
    "linewidth": 1.2,
    "shrinkA": 0,
    "shrinkB": 0,
    "path_effects": [withStroke(linewidth=2.8, foreground="white")],
}


def moments(view: JumpView, flying: int = 2) -> Figure:
    """Draw a strip of a jump's moments, ``4 + flying`` of them, over the ground."""
    placed = postures(view, view.moments(flying))
    figure = new_figure(WIDTH, LEGEND + strip_height(view, placed))
    axes = figure.add_subplot()
    draw_moments(axes, view, placed)
    force = round_below(0.3 / view.metres_per_newton)
    entries: list[tuple[Any, str]] = [
        (Line2D([], [], color=colour, linewidth=1.2), f"force on {name}")
        for name, colour in zip(view.contacts, view.colours, strict=True)
    ]
    entries.append((Patch(facecolor=PALE), f"friction cone, μ = {view.jump.request.friction:g}"))
    entries.append((Line2D([], [], linestyle="none"), f"{force:g} N drawn as {force * view.metres_per_newton:.2g} m"))
    legend_above(figure, entries)
    return figure


def strip_height(view: JumpView, placed: Postures, width: float = WIDTH) -> float:
    """Height, in, of a strip of a width, in."""
    low, high = strip_box(view, placed)
    return width * (high - low).imag / (high - low).real


def strip_box(view: JumpView, placed: Postures) -> tuple[complex, complex]:
    """Corners of a strip, m, with room for forces and for captions under the ground."""
    shifts = _shifts(placed)
    low, high = placed.low + shifts, placed.high + shifts
    tall = float(high.imag.max() - view.ground)
    left, right = low.real.min() - BESIDE * tall, high.real.max() + BESIDE * tall
    below = CAPTION * (right - left) / WIDTH
    return complex(left, view.ground - below), complex(right, high.imag.max() + ABOVE * tall)


def _shifts(placed: Postures) -> ComplexArray:
    """Shifts (K,) m that put postures side by side, none touching its neighbours, at their heights."""
    low, high = (np.real(corner - placed.com) for corner in (placed.low, placed.high))
    room = GAP * float(np.max(high - low))
    centres = np.cumsum(np.append(0.0, high[:-1] - low[1:] + room))
    return np.asarray(centres - placed.com.real + 0j)


def draw_moments(axes: Axes, view: JumpView, placed: Postures) -> None:
    """Draw moments from left to right over the ground onto axes in metres, with forces, and times below."""
    shifts, (low, high) = _shifts(placed), strip_box(view, placed)
    frame_box(axes, low, high)
    axes.set_axis_off()
    axes.axhspan(low.imag, view.ground, color=PALE, alpha=0.5, linewidth=0, zorder=0)
    axes.axhline(view.ground, color=INK, linewidth=0.9, zorder=1)
    for index, time in enumerate(placed.times):
        draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(("white", 1.0),), shift=shifts[index])
        at = float((placed.com[index] + shifts[index]).real)
        axes.text(at, low.imag, f"{time:.2f} s", ha="center", va="bottom", size=6.5)
    draw_forces(axes, view, placed.times, shifts)


def draw_forces(axes: Axes, view: JumpView, times: Array, shifts: ComplexArray) -> None:
    """Draw the forces on what stands at times (K,), s, and their friction cones, moved by shifts (K,), m."""
    pushes = view.forces(view.jump.at(times)).values()
    for colour, feet, forces in zip(view.colours, view.feet(times), pushes, strict=True):
        standing = np.flatnonzero(np.isfinite(forces.real))
        cones = [pairs(feet[each] + shifts[each] + view.cone) for each in standing]
        cone = PolyCollection(cones, facecolors=[faded(colour, 0.35)], alpha=0.55, zorder=3.5)
        axes.add_collection(cone, autolim=False)
        for each in standing:
            foot, push = feet[each] + shifts[each], forces[each] * view.metres_per_newton
            if abs(push) > SHORTEST:
                tip, base = (tuple(pairs(place).tolist()) for place in (foot + push, foot))
                axes.annotate("", tip, base, arrowprops={**ARROW, "color": colour}, zorder=6)
