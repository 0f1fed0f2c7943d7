"""Curves of a flight over time: configuration, rates, torques and clearance; a second plan is drawn dashed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, MultipleLocator

from floatplan.arrays import Array
from floatplan.motion.flight_state import FlightState
from floatplan.plans.plan import Plan
from floatplan.problem.parts import JointState, Obstacle
from floatplan.tables import JOINT_LIMITS, LimitRow
from floatplan.view.figures.multiples import Panel, is_crowded, small_multiples
from floatplan.view.motors import available_torques, motor_colours, shown_motors
from floatplan.view.postures import robot_size
from floatplan.view.style import (
    ALARM,
    COLUMN,
    GREY,
    INK,
    OBSTACLES,
    faded,
    legend_above,
    new_figure,
    palette,
)

SAMPLES = 241  # [-] of a curve
HEIGHT = 2.1  # [in]
SECOND_HEIGHT = 1.25  # [in] of an axis added below
NEAR = 2.5  # [-] a limit is drawn if it is at most this many times the largest value
DASHED: dict[str, Any] = {"linestyle": (0, (2.2, 1.1)), "linewidth": 1.0}
PROVED: dict[str, Any] = {"linestyle": (0, (1, 1.6)), "linewidth": 0.9}
LIMIT: dict[str, Any] = {"linestyle": (0, (9, 3)), "linewidth": 0.7}
RING: dict[str, Any] = {"marker": "o", "linestyle": "none", "clip_on": False, "zorder": 5, "markeredgewidth": 1.0}


@dataclass(frozen=True, eq=False)
class SampledPlan:
    """A plan and its states at the instants of the curves."""

    plan: Plan
    state: FlightState

    @classmethod
    def of(cls, plan: Plan) -> SampledPlan:
        """Sample a plan."""
        return cls(plan, plan.at(np.linspace(0, plan.duration, SAMPLES)))

    @property
    def times(self) -> Array:
        """Instants (N,) of the curves, s."""
        return self.state.times


def configuration(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw orientation and joints over time, degrees, with dots where they start and rings where they should end."""
    if is_crowded(flown.plan):
        ends = [_end_angles(state) for state in (flown.plan.problem.initial, flown.plan.problem.final)]
        return _multiples(flown, other, _angles, "deg", ends=ends)
    figure, (axes,) = _time_figure(flown.plan, 1)
    draw_configuration(axes, flown, other)
    goal_mark = Line2D([], [], color=INK, markersize=4.4, markerfacecolor="white", **RING)
    _curve_legend(figure, flown, other, extra=[(goal_mark, "goal")])
    return figure


def draw_configuration(axes: Axes, flown: SampledPlan, other: SampledPlan | None = None) -> None:
    """Draw the curves of :func:`configuration` onto axes."""
    _draw_columns(axes, flown, other, _angles)
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
    figure, (joints, *below) = _time_figure(plan, 1 if row.base is None else 2)
    peak = _draw_columns(joints, flown, other, attrgetter(row.quantity), first=1)
    limits = _draw_limits(joints, flown, plan.problem.joint_limits[row.key], peak)
    joints.set_ylabel(f"joints ({row.unit})")
    for base in below:
        base_peak = _draw_columns(base, flown, other, _column(row.base or ""))
        of_base = np.full(len(plan.robot.joints), base_limit(plan, row.base or ""))
        limits = _draw_limits(base, flown, of_base, base_peak) or limits
        base.set_ylabel(f"orientation ({row.unit})")
    proved = None if plan.certificate is None else getattr(plan.certificate, f"{row.key}_peak", None)
    peaks = [] if proved is None else proved.tolist()
    limits = [*limits, *_draw_proved_peaks(joints, peaks, palette(len(plan.robot.joints) + 1)[1:])]
    for axes in (joints, *below):
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0.5)
    figure.align_ylabels()
    _curve_legend(figure, flown, other, extra=limits, first=0 if below else 1)
    return figure


def torques(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw the motors' own torques over time, N m, with their proved peaks and the limits that are near.

    Followers that do as their leaders do are not drawn; others are dotted, in their leaders' colours.
    """
    if is_crowded(flown.plan):
        return _torque_multiples(flown, other)
    figure, (axes,) = _time_figure(flown.plan, 1)
    limits = draw_torques(axes, flown, other)
    plan, motors = flown.plan, shown_motors(flown.plan, flown.state)
    entries = [
        (Line2D([], [], color=colour, **_stroke(plan, motor)), plan.robot.motors[motor])
        for motor, colour in zip(motors, motor_colours(plan, motors), strict=True)
    ]
    legend_above(figure, [*entries, *limits, *_plan_marks(flown, other)])
    return figure


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
    return small_multiples(
        flown.times, None if other is None else other.times, panels, "N m", _plan_marks(flown, other)
    )


def _limited_multiples(flown: SampledPlan, row: LimitRow, other: SampledPlan | None) -> Figure:
    """What a row limits of the joints, and before it that of the base where it has one."""
    plan = flown.plan

    def values(state: FlightState) -> Array:
        of_joints: Array = getattr(state, row.quantity)
        return of_joints if row.base is None else np.column_stack((getattr(state, row.base), of_joints))

    certified = None if plan.certificate is None else getattr(plan.certificate, f"{row.key}_peak", None)
    proved = np.full(len(plan.robot.joints), np.inf) if certified is None else certified
    limits = plan.problem.joint_limits[row.key]
    if row.base is not None:
        limits, proved = np.r_[base_limit(plan, row.base), limits], np.r_[np.inf, proved]
    return _multiples(flown, other, values, row.unit, limits=limits, proved=proved)


def _multiples(
    flown: SampledPlan,
    other: SampledPlan | None,
    values: Callable[[FlightState], Array],
    unit: str,
    limits: Array | None = None,
    proved: Array | None = None,
    ends: Sequence[Array] | None = None,
) -> Figure:
    """Small pictures of the columns of ``values(state)``: the last of base and joints."""
    columns = values(flown.state).T
    others = None if other is None else values(other.state).T
    names = ("orientation", *flown.plan.robot.joints)[-len(columns) :]
    colours = palette(len(flown.plan.robot.joints) + 1)[-len(columns) :]
    panels = [
        Panel(
            name,
            colours[index],
            columns[index],
            None if others is None else others[index],
            np.inf if limits is None else float(limits[index]),
            np.inf if proved is None else float(proved[index]),
            None if ends is None else (float(ends[0][index]), float(ends[1][index])),
        )
        for index, name in enumerate(names)
    ]
    return small_multiples(flown.times, None if other is None else other.times, panels, unit, _plan_marks(flown, other))


def _end_angles(state: JointState) -> Array:
    """Orientation and joints, degrees."""
    return np.rad2deg(np.concatenate(([state.orientation], state.positions)))


def draw_torques(axes: Axes, flown: SampledPlan, other: SampledPlan | None = None) -> list[tuple[Any, str]]:
    """Draw the curves of :func:`torques` onto axes; return the legend's entries for limits and proved peaks."""
    plan, motors = flown.plan, shown_motors(flown.plan, flown.state)
    colours = motor_colours(plan, motors)
    peak = 0.0
    for each, style, strength in _layers(flown, other):
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
    return [*_draw_limits(axes, flown, limits, peak, colours), *_draw_proved_peaks(axes, peaks, colours)]


def _stroke(plan: Plan, motor: int) -> dict[str, Any]:
    return {"linestyle": ":"} if motor >= len(plan.robot.joints) else {}


def clearance(flown: SampledPlan, other: SampledPlan | None = None) -> Figure:
    """Draw the distance from the robot to each obstacle over time, m, above the margin to be kept.

    The proved minima are drawn across. What is far away is cut off: the picture is of the passage.
    """
    figure, (axes,) = _time_figure(flown.plan, 1)
    obstacles = flown.plan.problem.obstacles
    colours = [OBSTACLES[index % len(OBSTACLES)] for index in range(len(obstacles))]
    least, most = np.full(len(obstacles), np.inf), 0.0
    for each, style, strength in _layers(flown, other):
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
    legend_above(figure, [*entries, (margin_mark, "margin"), *proved, *_plan_marks(flown, other)])
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


def plan_names(plan: Plan, compare: Plan) -> tuple[str, str]:
    """Return names that distinguish two plans: with and without obstacles, or their problems' names."""
    many, few = len(plan.problem.obstacles), len(compare.problem.obstacles)
    if (many > 0) != (few > 0):
        names = "with obstacle", "without obstacle"
        return names if many else (names[1], names[0])
    if plan.problem.name != compare.problem.name:
        return plan.problem.name, compare.problem.name
    return "this plan", "other plan"


def _angles(state: FlightState) -> Array:
    return np.rad2deg(np.column_stack((state.orientation, state.positions)))


def _column(quantity: str) -> Callable[[FlightState], Array]:
    """The quantity (N,) of a state as its only column."""

    def column(state: FlightState) -> Array:
        values: Array = getattr(state, quantity)
        return values[:, None]

    return column


def _time_figure(plan: Plan, rows: int) -> tuple[Figure, list[Axes]]:
    """Return a figure of axes over the flight, one below the other, the first the tallest."""
    figure = new_figure(COLUMN, HEIGHT + SECOND_HEIGHT * (rows - 1))
    ratios = [HEIGHT - 0.5] + [SECOND_HEIGHT] * (rows - 1)
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})
    axes = list(grid[:, 0])
    axes[-1].set(xlim=(0, plan.duration), xlabel="time (s)")
    return figure, axes


def _layers(flown: SampledPlan, other: SampledPlan | None) -> list[tuple[SampledPlan, dict[str, Any], float]]:
    """What to draw, the lowest layer first: flight, line style, strength of its colours."""
    own: tuple[SampledPlan, dict[str, Any], float] = (flown, {}, 1.0)
    return [own] if other is None else [(other, DASHED, 0.75), own]


def _draw_columns(axes: Axes, flown: SampledPlan, other: SampledPlan | None, values: Any, first: int = 0) -> float:
    """Draw one curve per column of ``values(state)`` in its part's colour; return the largest magnitude."""
    colours = palette(len(flown.plan.robot.joints) + 1)[first:]
    peak = 0.0
    for each, style, strength in _layers(flown, other):
        columns = values(each.state)
        peak = max(peak, float(np.abs(columns).max()))
        for column, colour in zip(columns.T, colours, strict=False):
            axes.plot(each.times, column, color=faded(colour, strength), **style)
    return peak


def _draw_limits(
    axes: Axes, flown: SampledPlan, limits: Array, peak: float, colours: Sequence[Any] | None = None
) -> list[tuple[Any, str]]:
    """Draw limits (r,), or (N, r) over time, on both sides, unless so far away that they would flatten the curves.

    Returns the legend's entries.
    """
    mark: list[tuple[Any, str]] = []
    over_time = np.broadcast_to(limits, (len(flown.times), limits.shape[-1]))
    same = bool(np.all(over_time == over_time[:1, :1]))
    colours = palette(over_time.shape[1] + 1)[1:] if colours is None else colours
    for column, colour in zip(over_time.T[:1] if same else over_time.T, [INK] if same else colours, strict=False):
        if float(column.min()) <= NEAR * peak:
            for sign in (1, -1):
                axes.plot(flown.times, sign * column, color=colour, zorder=1.5, **LIMIT)
            mark = [(Line2D([], [], color=INK, **LIMIT), "limit")]
    return mark


def _draw_proved_peaks(axes: Axes, peaks: Sequence[float], colours: Sequence[Any]) -> list[tuple[Any, str]]:
    """Draw, on both sides, the peaks that the certificate proves; return the legend's entry."""
    known = [(peak, colour) for peak, colour in zip(peaks, colours, strict=False) if np.isfinite(peak)]
    for peak, colour in known:
        for sign in (1, -1):
            axes.axhline(sign * peak, color=faded(colour, 0.6), zorder=1.4, **PROVED)
    return [(Line2D([], [], color=INK, **PROVED), "proved peak")] if known else []


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


def _angle_ticks(axes: Axes) -> Any:
    """Degrees are read in steps of 15, 30, 45, 90, 180 or 360."""
    low, high = axes.get_ylim()
    for step in (15, 30, 45, 90, 180, 360):
        if (high - low) / step <= 8:
            return MultipleLocator(step)
    return MaxNLocator(6)


def _plan_marks(flown: SampledPlan, other: SampledPlan | None) -> list[tuple[Any, str]]:
    if other is None:
        return []
    names = plan_names(flown.plan, other.plan)
    return [(Line2D([], [], color=INK), names[0]), (Line2D([], [], color=faded(INK, 0.75), **DASHED), names[1])]


def _curve_legend(
    figure: Figure, flown: SampledPlan, other: SampledPlan | None, extra: Sequence[tuple[Any, str]] = (), first: int = 0
) -> None:
    names = ("orientation", *flown.plan.robot.joints)[first:]
    colours = palette(len(flown.plan.robot.joints) + 1)[first:]
    entries = [(Line2D([], [], color=colour), name) for colour, name in zip(colours, names, strict=True)]
    legend_above(figure, [*entries, *extra, *_plan_marks(flown, other)])
