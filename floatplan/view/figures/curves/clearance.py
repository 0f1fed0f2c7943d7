"""Curves of the distance from the robot to each obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.view.figures.curves.drawing import LIMIT, PROVED, layers, plan_marks, time_figure
from floatplan.view.figures.curves.sampled import SampledPlan
from floatplan.view.postures import robot_size
from floatplan.view.style import ALARM, INK, OBSTACLES, faded, legend_above


def clearance(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw the distance from the robot to each obstacle over time, m, above the margin to be kept.

    The proved minima are drawn across. What is far away is cut off: the picture is of the passage.
    """
    figure, (axes,) = time_figure(flown.plan, 1)
    obstacles = flown.plan.problem.obstacles
    colours = [OBSTACLES[index % len(OBSTACLES)] for index in range(len(obstacles))]
    least, most = np.full(len(obstacles), np.inf), 0.0
    for each, style, strength in layers(flown, other):
        for index, (obstacle, colour) in enumerate(zip(obstacles, colours, strict=True)):
            distances = each.plan.clearances(each.times, [obstacle])
            axes.plot(each.times, distances, color=faded(colour, strength), **style)
            least[index] = min(least[index], distances.min())
            most = distances.max(where=np.isfinite(distances), initial=most)
    top = clearance_ceiling(flown.plan, most)
    bottom = min(1.1 * least.min(), -0.06 * top)
    axes.set(ylim=(bottom, top), ylabel="clearance (m)")
    axes.axhspan(bottom, 0, color=faded(ALARM, 0.12), linewidth=0, zorder=0.4)
    for margin in {obstacle.margin for obstacle in obstacles}:
        axes.axhline(margin, color=ALARM, zorder=1.5, **LIMIT)
    curves = zip(colours, obstacle_names(obstacles), least <= top, strict=True)
    entries: list[tuple[Any, str]] = [(Line2D([], [], color=colour), name) for colour, name, shown in curves if shown]
    margin_mark = Line2D([], [], color=ALARM, **LIMIT)
    proved = _draw_proved_clearances(axes, flown, colours)
    legend_above(figure, [*entries, (margin_mark, "margin"), *proved, *plan_marks(flown, other)])
    return figure


def clearance_ceiling(plan: Plan, largest: float) -> float:
    """Return the upper end of a clearance axis, m: what is far away is cut off."""
    margins = (4 * obstacle.margin for obstacle in plan.problem.obstacles)
    return min(1.05 * largest, max([robot_size(plan) / 2, *margins])) or 1.0


def obstacle_names(obstacles: tuple[Obstacle, ...]) -> list[str]:
    """Return a name for each obstacle: its kind, numbered where several are of one kind."""
    kinds = [obstacle.kind for obstacle in obstacles]
    return [
        kind if kinds.count(kind) == 1 else f"{kind} {kinds[: index + 1].count(kind)}"
        for index, kind in enumerate(kinds)
    ]


def _draw_proved_clearances(axes: Axes, flown: SampledPlan, colours: Sequence[str]) -> list[tuple[Any, str]]:
    """Draw the distance from each obstacle that the certificate proves, if any; return the legend's entry."""
    findings = () if flown.plan.certificate is None else flown.plan.certificate.findings
    bounds = {
        finding.subject: finding.bound
        for finding in findings
        if finding.kind == "obstacle" and finding.verdict == "proved"
    }
    top, drawn = axes.get_ylim()[1], False
    for index, (obstacle, colour) in enumerate(zip(flown.plan.problem.obstacles, colours, strict=True)):
        least = bounds.get((index, obstacle.kind))
        if least is not None and least <= top:
            axes.axhline(least, color=colour, zorder=1.6, **PROVED)
            drawn = True
    return [(Line2D([], [], color=INK, **PROVED), "proved minimum")] if drawn else []
