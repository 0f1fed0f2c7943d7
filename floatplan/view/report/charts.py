"""The report's curves: which columns, limits and marks each chart shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.plans.plan import Plan
from floatplan.tables import LimitRow
from floatplan.view.figures.curves import NEAR, base_limit, clearance_ceiling, drawn_limits, obstacle_names
from floatplan.view.motors import available_torques, motor_colours, shown_motors
from floatplan.view.report.data import hex_colour, rounded, sample_grid
from floatplan.view.style import ALARM, GREY, INK, OBSTACLES, palette


def charts(plan: Plan, columns: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return the charts from top to bottom, as the page reads them.

    Each has a title, a unit, a factor from SI to it, ``series`` (name, colour, key of its column) and ``lines``
    (name, colour, one value or samples): limits, margins and marks; ``beyond`` describes limits that are not drawn.
    """
    of_joints = [_of_limit(plan, row, columns) for row in drawn_limits(plan)]
    drawn = [_angles(plan), *of_joints, _torques(plan, columns), _momentum(plan)]
    return [*drawn, _clearance(plan, columns)] if plan.problem.obstacles else drawn


def _angles(plan: Plan) -> dict[str, Any]:
    keys = ["orientation", *_of_joints(plan, "positions")]
    ends = [[state.orientation, *state.positions] for state in (plan.problem.initial, plan.problem.final)]
    return _chart("Angles", "deg", _series(plan, keys), factor=180 / np.pi, starts=ends[0], goals=ends[1])


def _of_limit(plan: Plan, row: LimitRow, columns: Mapping[str, Array]) -> dict[str, Any]:
    """What a row of the table limits: that of the joints, and of the base where it has one."""
    keys = _of_joints(plan, row.quantity)
    colours = palette(len(plan.robot.joints) + 1)
    limits = _limits(keys, plan.problem.joint_limits[row.key], columns, colours[1:])
    if row.base is not None:
        of_base = _limits([row.base], [base_limit(plan, row.base)], columns, colours[:1])
        limits["lines"] += of_base["lines"]
        keys = [row.base, *keys]
    return _chart(row.title, row.unit, _series(plan, keys), **limits)


def _torques(plan: Plan, columns: Mapping[str, Array]) -> dict[str, Any]:
    """The motors' own; followers that do as their leaders do are left out."""
    motors = shown_motors(plan, plan.at(sample_grid(plan.duration)))
    colours = motor_colours(plan, motors)
    keys = [f"motor_torques.{motor}" for motor in motors]
    velocities = np.array([columns[key] for key in _of_joints(plan, "velocities")]).T
    limits = available_torques(plan, velocities)[:, motors].T
    series = [
        {"name": plan.robot.motors[motor], "colour": hex_colour(colour), "key": key}
        for motor, colour, key in zip(motors, colours, keys, strict=True)
    ]
    return _chart("Torques", "N m", series, **_limits(keys, limits, columns, colours))


def _momentum(plan: Plan) -> dict[str, Any]:
    series = [
        {"name": "base", "colour": hex_colour(palette(len(plan.robot.joints) + 1)[0]), "key": "momentum_base"},
        {"name": "joints", "colour": GREY, "key": "momentum_joints"},
        {"name": "h, constant", "colour": INK, "key": "angular_momentum"},
    ]
    return _chart("Angular momentum", "kg m²/s", series)


def _clearance(plan: Plan, columns: Mapping[str, Array]) -> dict[str, Any]:
    """What is far away is cut off: the chart is of the passage."""
    obstacles = plan.problem.obstacles
    keys = [f"clearance.{index}" for index in range(len(obstacles))]
    values = np.array([columns[key] for key in keys])
    most, least = values.max(where=np.isfinite(values), initial=0.0), values.min(initial=0.0)
    top = clearance_ceiling(plan, most)
    colours = [OBSTACLES[index % len(OBSTACLES)] for index in range(len(obstacles))]
    series = [
        {"name": name, "colour": colour, "key": key}
        for name, colour, key in zip(obstacle_names(obstacles), colours, keys, strict=True)
    ]
    margins = sorted({obstacle.margin for obstacle in obstacles})
    lines = [{"name": "margin", "colour": ALARM, "value": margin} for margin in margins]
    return _chart("Clearance", "m", series, lines=lines, range=[min(1.1 * least, -0.04 * top), top])


def _chart(title: str, unit: str, series: Sequence[Mapping[str, Any]], **more: Any) -> dict[str, Any]:
    return {"title": title, "unit": unit, "factor": 1.0, "series": list(series), "lines": [], **more}


def _of_joints(plan: Plan, quantity: str) -> list[str]:
    return [f"{quantity}.{index}" for index in range(len(plan.robot.joints))]


def _series(plan: Plan, keys: Sequence[str]) -> list[dict[str, Any]]:
    """Curves of the joints, with the base's first where there is one key more."""
    names = ("orientation", *plan.robot.joints)[-len(keys) :]
    colours = palette(len(plan.robot.joints) + 1)[-len(keys) :]
    return [
        {"name": name, "colour": hex_colour(colour), "key": key}
        for name, colour, key in zip(names, colours, keys, strict=True)
    ]


def _limits(
    keys: Sequence[str], limits: Sequence[float] | Array, columns: Mapping[str, Array], of_keys: Sequence[Array]
) -> dict[str, Any]:
    """Limits on both sides, one value or (N,) each; a sentence if so far away that they would flatten the curves.

    ``of_keys`` are the colours of the keys' curves. One limit for several joints is one line.
    """
    peak = max(float(np.abs(columns[key]).max()) for key in keys)
    colours = [hex_colour(colour) for colour in of_keys]
    over_time = np.asarray(limits, dtype=np.float64).reshape(len(keys), -1)
    if len(keys) > 1 and (over_time == over_time[0, 0]).all():
        over_time, colours = over_time[:1], [INK]
    lines: list[dict[str, Any]] = []
    far = [low for low in over_time.min(axis=1) if NEAR * peak < low < np.inf]
    beyond = f"limits from {min(far):.4g}, not drawn" if far else ""
    for values, colour in zip(over_time, colours, strict=True):
        if float(values.min()) <= NEAR * peak:
            for side in (1.0, -1.0):
                value = side * float(values[0]) if np.ptp(values) == 0 else rounded(side * values)
                lines.append({"name": "limit", "colour": colour, "value": value})
    return {"lines": lines, "beyond": beyond}
