"""Curves of base and joints: their angles, and what a problem may limit of their motion."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, MultipleLocator

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.problem.parts import JointState
from floatplan.tables import JOINT_LIMITS, LimitRow
from floatplan.view.figures.curves.drawing import (
    RING,
    Columns,
    column_multiples,
    curve_legend,
    draw_columns,
    draw_limits,
    draw_proved_peaks,
    time_figure,
)
from floatplan.view.figures.curves.multiples import is_crowded
from floatplan.view.figures.curves.sampled import SampledPlan
from floatplan.view.style import GREY, INK, palette


def configuration(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw orientation and joints over time, degrees, with dots where they start and rings where they should end."""
    if is_crowded(flown.plan):
        ends = [_end_angles(state) for state in (flown.plan.problem.initial, flown.plan.problem.final)]
        return column_multiples(flown, other, _angles, "deg", ends=ends)
    figure, (axes,) = time_figure(flown.plan, 1)
    draw_configuration(axes, flown, other)
    goal_mark = Line2D([], [], color=INK, markersize=4.4, markerfacecolor="white", **RING)
    curve_legend(figure, flown, other, extra=[(goal_mark, "goal")])
    return figure


def draw_configuration(axes: Axes, flown: SampledPlan, other: SampledPlan | None = None) -> None:
    """Draw the curves of :func:`configuration` onto axes."""
    draw_columns(axes, flown, other, _angles)
    ends = [_end_angles(state) for state in (flown.plan.problem.initial, flown.plan.problem.final)]
    for colour, start, goal in zip(palette(len(ends[0])), *ends, strict=True):
        axes.plot(0, start, color=colour, markersize=3.2, **RING)
        axes.plot(flown.plan.duration, goal, color=colour, markersize=4.4, markerfacecolor="white", **RING)
    axes.set_ylabel("angle (deg)")
    axes.yaxis.set_major_locator(_angle_ticks(axes))


def drawn_limits(plan: Plan) -> list[LimitRow]:
    """Return the limits of the joints' motion whose quantities are drawn: always, or where something limits them."""
    return [row for row in JOINT_LIMITS if row.always or bool(np.isfinite(plan.problem.joint_limits[row.key]).any())]


def base_limit(plan: Plan, key: str) -> float:
    """Return the limit of a quantity of the base, infinite where there is none."""
    limit = getattr(plan.problem.limits, key)
    return np.inf if limit is None else float(limit)


def limited(flown: SampledPlan, row: LimitRow, other: SampledPlan | None = None) -> Figure:
    """Draw what a row limits of the joints, with limits and proved peaks, and that of the base below."""
    plan = flown.plan
    if is_crowded(plan):
        return _limited_multiples(flown, row, other)
    figure, (joints, *below) = time_figure(plan, 1 if row.base is None else 2)
    peak = draw_columns(joints, flown, other, attrgetter(f"state.{row.quantity}"), first=1)
    limits = draw_limits(joints, flown, plan.problem.joint_limits[row.key], peak)
    joints.set_ylabel(f"joints ({row.unit})")
    for base in below:
        base_peak = draw_columns(base, flown, other, _column(row.base or ""))
        of_base = np.full(len(plan.robot.joints), base_limit(plan, row.base or ""))
        limits = draw_limits(base, flown, of_base, base_peak) or limits
        base.set_ylabel(f"orientation ({row.unit})")
    proved = None if plan.certificate is None else getattr(plan.certificate, f"{row.key}_peak", None)
    peaks = [] if proved is None else proved.tolist()
    limits = [*limits, *draw_proved_peaks(joints, peaks, palette(len(plan.robot.joints) + 1)[1:])]
    for axes in (joints, *below):
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    figure.align_ylabels()
    curve_legend(figure, flown, other, extra=limits, first=0 if below else 1)
    return figure


def _limited_multiples(flown: SampledPlan, row: LimitRow, other: SampledPlan | None) -> Figure:
    """What a row limits of the joints, and before it that of the base where it has one."""
    plan = flown.plan

    def values(flown: SampledPlan) -> Array:
        of_joints: Array = getattr(flown.state, row.quantity)
        return of_joints if row.base is None else np.column_stack((getattr(flown.state, row.base), of_joints))

    certified = None if plan.certificate is None else getattr(plan.certificate, f"{row.key}_peak", None)
    proved = np.full(len(plan.robot.joints), np.inf) if certified is None else certified
    limits = plan.problem.joint_limits[row.key]
    if row.base is not None:
        limits, proved = np.r_[base_limit(plan, row.base), limits], np.r_[np.inf, proved]
    return column_multiples(flown, other, values, row.unit, limits=limits, proved=proved)


def _end_angles(state: JointState) -> Array:
    """Orientation and joints, degrees."""
    return np.rad2deg(np.concatenate(([state.orientation], state.positions)))


def _angles(flown: SampledPlan) -> Array:
    return np.rad2deg(np.column_stack((flown.state.orientation, flown.state.positions)))


def _column(quantity: str) -> Columns:
    """The quantity (N,) of a plan's states as its only column."""

    def column(flown: SampledPlan) -> Array:
        values: Array = getattr(flown.state, quantity)
        return values[:, None]

    return column


def _angle_ticks(axes: Axes) -> Any:
    """Degrees are read in steps of 15, 30, 45, 90, 180 or 360."""
    low, high = axes.get_ylim()
    for step in (15, 30, 45, 90, 180, 360):
        if (high - low) / step <= 8:
            return MultipleLocator(step)
    return MaxNLocator(6)
