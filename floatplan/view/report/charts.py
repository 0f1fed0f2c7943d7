"""The report's curves: which columns, limits and marks each chart shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.tables import LimitRow
from floatplan.view.figures.curves.clearance import clearance_ceiling, obstacle_names
from floatplan.view.figures.curves.drawing import NEAR
from floatplan.view.figures.curves.joints import base_limit, drawn_limits
from floatplan.view.figures.curves.multiples import is_crowded
from floatplan.view.motors import available_torques, leaders, motor_colours, shown_motors
from floatplan.view.report.data import hex_colour, rounded, sample_grid
from floatplan.view.style import ALARM, GREY, INK, OBSTACLES, OKABE_ITO, palette


def charts(plan: Plan, columns: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return the charts from top to bottom, as the page reads them.

    Each has a title, a unit, a factor from SI to it, ``series`` (name, colour, key of its column) and ``lines``
    (name, colour, one value or samples): limits, margins and marks; ``beyond`` describes limits that are not drawn.
    The ``part`` of a curve or line is the robot's: 0 the base, 1 to n the joints, None where it belongs to no one.
    """
    of_joints = [_of_limit(plan, row, columns) for row in drawn_limits(plan)]
    drawn = [_angles(plan), *of_joints, _torques(plan, columns), _momentum(plan, columns), _inertia(plan)]
    return [*drawn, _clearance(plan, columns)] if plan.problem.obstacles else drawn


def _angles(plan: Plan) -> dict[str, Any]:
    keys = ["orientation", *_of_joints(plan, "positions")]
    ends = [[state.orientation, *state.positions] for state in (plan.problem.initial, plan.problem.final)]
    return _chart("Angles", "deg", _series(plan, keys), factor=180 / np.pi, starts=ends[0], goals=ends[1])


def _of_limit(plan: Plan, row: LimitRow, columns: Mapping[str, Array]) -> dict[str, Any]:
    """What a row of the table limits: that of the joints, and of the base where it has one."""
    keys = _of_joints(plan, row.quantity)
    colours = palette(len(plan.robot.joints) + 1)
    of_each = plan.problem.joint_limits[row.key]
    limits = _limits(keys, of_each, columns, colours[1:], range(1, len(keys) + 1))
    if row.base is not None:
        of_base = _limits([row.base], [base_limit(plan, row.base)], columns, colours[:1], [0])
        limits["lines"] += of_base["lines"]
        keys, of_each = [row.base, *keys], np.array([base_limit(plan, row.base), *of_each])
    return _chart(row.title, row.unit, _told(_series(plan, keys), of_each, row.unit), **limits)


def _torques(plan: Plan, columns: Mapping[str, Array]) -> dict[str, Any]:
    """The motors' own; followers that do as their leaders do are left out."""
    motors = shown_motors(plan, plan.at(sample_grid(plan.duration)))
    colours = motor_colours(plan, motors)
    keys = [f"motor_torques.{motor}" for motor in motors]
    parts = [int(leaders(plan)[motor]) + 1 for motor in motors]
    velocities = np.array([columns[key] for key in _of_joints(plan, "velocities")]).T
    limits = available_torques(plan, velocities)[:, motors].T
    series = [
        {"name": plan.robot.motors[motor], "colour": hex_colour(colour), "key": key, "part": part}
        for motor, colour, key, part in zip(motors, colours, keys, parts, strict=True)
    ]
    return _chart("Torques", "N m", _told(series, limits, "N m"), **_limits(keys, limits, columns, colours, parts))


def _momentum(plan: Plan, columns: Mapping[str, Array]) -> dict[str, Any]:
    """What base and joints have of h, and the interval (9) that holds h of joints which do not turn back."""
    base, joints = (OKABE_ITO[0], OKABE_ITO[1] if is_crowded(plan) else GREY)
    series = [
        {"name": "base", "colour": base, "key": "momentum_base", "part": None},
        {"name": "joints", "colour": joints, "key": "momentum_joints", "part": None},
        {"name": "h, constant", "colour": INK, "key": "angular_momentum", "part": None},
    ]
    low, high = plan.angular_momentum_bounds
    peak = max(float(np.abs(columns[one["key"]]).max()) for one in series)  # type: ignore[index]
    if not max(abs(low), abs(high)) <= NEAR * peak:
        return _chart("Angular momentum", "kg m²/s", series, beyond=f"monotonic joints: h from {low:.4g} to {high:.4g}")
    lines = [{"name": "h of monotonic joints", "colour": INK, "value": end, "part": None} for end in (low, high)]
    return _chart("Angular momentum", "kg m²/s", series, lines=lines)


def _inertia(plan: Plan) -> dict[str, Any]:
    """D of (4): what base and joints turn with their rates."""
    keys = [f"inertia.{index}" for index in range(len(plan.robot.joints) + 1)]
    return _chart("Inertia row D", "kg m²", _series(plan, keys))


def _clearance(plan: Plan, columns: Mapping[str, Array]) -> dict[str, Any]:
    """What is far away is cut off: the chart is of the passage."""
    obstacles = plan.problem.obstacles
    keys = [f"clearance.{index}" for index in range(len(obstacles))]
    values = np.array([columns[key] for key in keys])
    most, least = values.max(where=np.isfinite(values), initial=0.0), values.min(initial=0.0)
    top = clearance_ceiling(plan, most)
    colours = [OBSTACLES[index % len(OBSTACLES)] for index in range(len(obstacles))]
    series = [
        {"name": name, "colour": colour, "key": key, "part": None}
        for name, colour, key in zip(obstacle_names(obstacles), colours, keys, strict=True)
    ]
    margins = sorted({obstacle.margin for obstacle in obstacles})
    lines = [{"name": "margin", "colour": ALARM, "value": margin, "part": None} for margin in margins]
    return _chart("Clearance", "m", series, lines=lines, range=[min(1.1 * least, -0.04 * top), top])


def _chart(title: str, unit: str, series: Sequence[Mapping[str, Any]], **more: Any) -> dict[str, Any]:
    return {"title": title, "unit": unit, "factor": 1.0, "series": list(series), "lines": [], **more}


def _of_joints(plan: Plan, quantity: str) -> list[str]:
    return [f"{quantity}.{index}" for index in range(len(plan.robot.joints))]


def _series(plan: Plan, keys: Sequence[str]) -> list[dict[str, Any]]:
    """Curves of the joints, with the base's first where there is one key more."""
    names = ("orientation", *plan.robot.joints)[-len(keys) :]
    colours = palette(len(plan.robot.joints) + 1)[-len(keys) :]
    parts = range(len(plan.robot.joints) + 1)[-len(keys) :]
    return [
        {"name": name, "colour": hex_colour(colour), "key": key, "part": part}
        for name, colour, key, part in zip(names, colours, keys, parts, strict=True)
    ]


def _told(series: Sequence[Mapping[str, Any]], limits: Array, unit: str) -> list[Mapping[str, Any]]:
    """The curves with their limits in words, for the one that is chosen."""
    least = np.asarray(limits, dtype=np.float64).reshape(len(series), -1).min(axis=1)
    return [
        {**one, "limit": f"of {limit:.4g} {unit}" if np.isfinite(limit) else "no limit"}
        for one, limit in zip(series, least, strict=True)
    ]


def _limits(
    keys: Sequence[str],
    limits: Sequence[float] | Array,
    columns: Mapping[str, Array],
    of_keys: Sequence[Array],
    parts: Sequence[int],
) -> dict[str, Any]:
    """Limits on both sides, one value or (N,) each; a sentence if so far away that they would flatten the curves.

    ``of_keys`` are the colours of the keys' curves, ``parts`` whose they are. One limit for several joints is one line.
    """
    peak = max(float(np.abs(columns[key]).max()) for key in keys)
    colours = [hex_colour(colour) for colour in of_keys]
    over_time = np.asarray(limits, dtype=np.float64).reshape(len(keys), -1)
    whose: list[int | None] = list(parts)
    if len(keys) > 1 and (over_time == over_time[0, 0]).all():
        over_time, colours, whose = over_time[:1], [INK], [None]
    lines: list[dict[str, Any]] = []
    far = [low for low in over_time.min(axis=1) if NEAR * peak < low < np.inf]
    beyond = f"limits from {min(far):.4g}, not drawn" if far else ""
    for values, colour, part in zip(over_time, colours, whose, strict=True):
        if float(values.min()) <= NEAR * peak:
            for side in (1.0, -1.0):
                value = side * float(values[0]) if np.ptp(values) == 0 else rounded(side * values)
                lines.append({"name": "limit", "colour": colour, "value": value, "part": part})
    return {"lines": lines, "beyond": beyond}
