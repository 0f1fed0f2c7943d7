"""A plan file, or a record built in Python, read: it holds what a plan has, in numbers that a flight can have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.files import check_depth, check_finite, numbers_hold, read_json
from floatplan.plans.kinds import (
    POINT,
    Each,
    ListOf,
    OneOf,
    OrNull,
    Table,
    boolean,
    check_table,
    number,
    positive,
    text,
)
from floatplan.plans.record import FORMAT, PlanRecord, RobotRecord
from floatplan.tables import check_number

LARGEST = 1e12  # [SI] above every number that is asked; limits that are placeholders are as large
LARGEST_FOUND = 1e100  # [SI] above every number that follows from those, as squares do; its own square is finite
LARGEST_ANGLE = 1e6  # [rad] of a term of p
ASKED = ("problem", "robot", "centre", "amplitude", "orientation")
SOLVER = ("iterations", "evaluations", "seconds", "seed", "starts", "solved")  # numbers, where the table has them
NO_KEY = "must not be there: a plan file has no such key"


def _anything(value: Any, element: str) -> None:
    """What is checked elsewhere: arrays by their shapes, the problem's tables where they are proved."""


ROWS = OrNull(ListOf(check_table))
ROBOT = Table(
    {"urdf": text, "sha256": text, "joints": ListOf(text), "plane": text},
    {
        "coupled": Each(Table({"leader": text, "ratio": number, "offset": number}, unknown=NO_KEY)),
        "locked": Each(number),
        "meshes": Each(text),
    },
    NO_KEY,
)
FILE = Table(
    {
        "format": OneOf((FORMAT,)),
        "status": OneOf(("optimal", "feasible", "infeasible", "interrupted")),
        "ok": boolean,
        "explanation": text,
        "problem": Table({"flight": Table({"duration": positive}, unknown="")}, unknown=""),
        "robot": ROBOT,
        "angular_momentum": number,
        "angular_momentum_bounds": POINT,
        **dict.fromkeys(("centre", "amplitude", "coefficients", "torque_peak", "velocity_peak"), _anything),
        "orientation": Table(dict.fromkeys(("start", "end", "goal"), number), unknown=NO_KEY),
        "com": Table({"position0": POINT, "velocity0": POINT, "gravity": number}, unknown=NO_KEY),
        "objective": Table({"name": text, "value": number}, unknown=NO_KEY),
        "clearance_min": OrNull(number),
        "solver": Table({}, dict.fromkeys(SOLVER, OrNull(number)), unknown=""),
        "problem_file": OrNull(text),
    },
    {
        "motor_torque_peak": OrNull(Each(number)),
        "warnings": ROWS,
        "utilisation": ROWS,
        "out_of_plane_leak": OrNull(number),
        "certificate": OrNull(check_table),
        "replay": OrNull(check_table),
        "floatplan": text,
    },
    NO_KEY,
)
# What may hold numbers that are not finite: null in a file.
NOT_STATED = ("solver", "out_of_plane_leak", "problem_file", "certificate", "replay")


def load_record(path: str | Path) -> PlanRecord:
    """Read a plan file.

    Raises
    ------
    InputError
        The file is missing, is no plan file, lacks a key, gives one twice, or holds what cannot be, such as a number
        that is not finite.
    """
    path = Path(path)
    content = read_json(path)
    try:
        return record_from_dict(content)
    except InputError as error:
        raise error.within(source=path) from None


def record_from_dict(content: Any) -> PlanRecord:
    """Rebuild a record from what a plan file holds."""
    if not isinstance(content, dict):
        raise InputError("is not a plan: no JSON object")
    check_finite(content)
    return _record(content)


def _record(content: dict[str, Any]) -> PlanRecord:
    if content.get("format") != FORMAT:
        raise InputError(f"{content.get('format')!r} is not {FORMAT!r}", element="format")
    FILE(content, "")
    robot = RobotRecord(**content["robot"])
    values = {**content, "robot": replace(robot, joints=tuple(robot.joints))}
    n = len(robot.joints)
    for name in ("centre", "amplitude", "torque_peak", "velocity_peak"):
        values[name] = _numbers(content[name], name, (n,))
    if not (values["amplitude"] > 0).all():
        raise InputError("is not positive", element="amplitude")
    values["coefficients"] = _numbers(content["coefficients"], "coefficients", (n, None))
    if not values["coefficients"].shape[1]:
        raise InputError("is empty", element="coefficients")
    low, high = map(float, content["angular_momentum_bounds"])
    if low > high:
        raise InputError(f"low {low} is above high {high}", element="angular_momentum_bounds")
    values["angular_momentum_bounds"] = (low, high)
    for name in ("angular_momentum", "clearance_min", "out_of_plane_leak"):
        if content.get(name) is not None:
            values[name] = float(content[name])
    if content.get("motor_torque_peak") is not None:
        values["motor_torque_peak"] = {name: float(peak) for name, peak in content["motor_torque_peak"].items()}
    _check_sizes(content, values["coefficients"])
    return PlanRecord(**values)


def _check_sizes(content: Mapping[str, Any], coefficients: Array) -> None:
    """Refuse numbers beyond what any flight has; b_k counts as ``b_k T^k``, which is an angle."""
    duration = float(content["problem"]["flight"]["duration"])
    check_number(duration, "problem.flight.duration", "duration")
    with np.errstate(over="ignore"):
        angles = np.abs(coefficients) * duration ** np.arange(coefficients.shape[1])
    if not (angles <= LARGEST_ANGLE).all():
        raise InputError(f"give terms of more than {LARGEST_ANGLE:g} rad", element="coefficients")
    solver = {name: value for name, value in content["solver"].items() if name != "seed"}
    for name, value in {**content, "solver": solver}.items():
        if name not in ("coefficients", "certificate", "replay"):
            largest = LARGEST if name in ASKED else LARGEST_FOUND
            if not numbers_hold(value, lambda number, largest=largest: not abs(number) > largest):  # type: ignore[misc]
                _refuse_size(value, name, largest)


def _refuse_size(value: Any, element: str, largest: float) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _refuse_size(item, f"{element}.{key}", largest)
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            _refuse_size(item, f"{element}[{index}]", largest)
    elif isinstance(value, int | float) and abs(value) > largest:
        raise InputError(f"{value:g} is larger than anything in a flight, {largest:g}", element=element)


def as_written(record: PlanRecord) -> PlanRecord:
    """Return a record as its file would be read: one that was built in Python is judged no other way.

    Raises
    ------
    InputError
        As :func:`load_record`; and of numbers that are not finite, which a file would hold as ``null``.
    """
    check_depth(vars(record))
    stated = {f.name: getattr(record, f.name) for f in fields(record) if f.name not in NOT_STATED}
    check_finite({**stated, "robot": vars(record.robot)})
    return _record(record.to_dict())


def _holds_truth(value: Any) -> bool:
    """Whether there is a true or false among numbers, which NumPy takes for 1 or 0."""
    if isinstance(value, list | tuple):
        return any(map(_holds_truth, value))
    return isinstance(value, bool)


def _numbers(value: Any, element: str, shape: tuple[int | None, ...]) -> Array:
    try:
        array = np.array(value)
    except ValueError:
        raise InputError("does not hold numbers", element=element) from None
    if array.dtype.kind not in "iuf" or _holds_truth(value):
        raise InputError("does not hold numbers", element=element)
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise InputError(f"has shape {array.shape}, not {shape}", element=element)
    return read_only(array)
