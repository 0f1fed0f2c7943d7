"""Curves of the motors' torques."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from floatplan.plans.plan import Plan
from floatplan.view.figures.curves.drawing import draw_limits, draw_proved_peaks, layers, plan_marks, time_figure
from floatplan.view.figures.curves.multiples import Panel, is_crowded, small_multiples
from floatplan.view.figures.curves.sampled import SampledPlan
from floatplan.view.motors import available_torques, motor_colours, shown_motors
from floatplan.view.style import GREY, faded, legend_above


def torques(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw the motors' own torques over time, N m, with their proved peaks and the limits that are near.

    Followers that do as their leaders do are not drawn; others are dotted, in their leaders' colours.
    """
    if is_crowded(flown.plan):
        return _torque_multiples(flown, other)
    figure, (axes,) = time_figure(flown.plan, 1)
    limits = draw_torques(axes, flown, other)
    plan, motors = flown.plan, shown_motors(flown.plan, flown.state)
    entries = [
        (Line2D([], [], color=colour, **_stroke(plan, motor)), plan.robot.motors[motor])
        for motor, colour in zip(motors, motor_colours(plan, motors), strict=True)
    ]
    legend_above(figure, [*entries, *limits, *plan_marks(flown, other)])
    return figure


def draw_torques(axes: Axes, flown: SampledPlan, other: SampledPlan | None = None) -> list[tuple[Any, str]]:
    """Draw the curves of :func:`torques` onto axes; return the legend's entries for limits and proved peaks."""
    plan, motors = flown.plan, shown_motors(flown.plan, flown.state)
    colours = motor_colours(plan, motors)
    peak = 0.0
    for each, style, strength in layers(flown, other):
        torques = each.state.motor_torques
        peak = max(peak, float(np.abs(torques).max()))
        for motor, colour in zip(motors, colours, strict=True):
            column = torques[:, each.plan.robot.motors.index(plan.robot.motors[motor])]
            axes.plot(each.times, column, color=faded(colour, strength), **(_stroke(plan, motor) | style))
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    axes.set_ylabel("torque (N m)")
    limits = available_torques(plan, flown.state.velocities)[:, motors]
    proved = {} if plan.certificate is None else plan.certificate.motor_torque_peak
    peaks = [proved.get(plan.robot.motors[motor], np.inf) for motor in motors]
    return [*draw_limits(axes, flown, limits, peak, colours), *draw_proved_peaks(axes, peaks, colours)]


def _torque_multiples(flown: SampledPlan, other: SampledPlan | None) -> Figure:
    plan, motors = flown.plan, shown_motors(flown.plan, flown.state)
    names = [plan.robot.motors[motor] for motor in motors]
    proved = {} if plan.certificate is None else plan.certificate.motor_torque_peak
    limits = available_torques(plan, flown.state.velocities)[:, motors]
    panels = [
        Panel(
            name,
            colour,
            flown.state.motor_torques[:, motor],
            None if other is None else other.state.motor_torques[:, other.plan.robot.motors.index(name)],
            limit,
            proved.get(name, np.inf),
        )
        for name, motor, colour, limit in zip(names, motors, motor_colours(plan, motors), limits.T, strict=True)
    ]
    return small_multiples(flown.times, None if other is None else other.times, panels, "N m", plan_marks(flown, other))


def _stroke(plan: Plan, motor: int) -> dict[str, Any]:
    return {"linestyle": ":"} if motor >= len(plan.robot.joints) else {}
