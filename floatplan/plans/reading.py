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
from floatplan.plans.record import FORMAT, PlanRecord, RobotRecord
from floatplan.tables import check_number

LARGEST = 1e12  # [SI] above every number that is asked; limits that are placeholders are as large
LARGEST_FOUND = (
    1e100  # [SI] above every number that follows from those: squares of torques are; its own square is finite
)
LARGEST_ANGLE = 1e6  # [rad] of a term of p
ASKED = ("problem", "robot", "centre", "amplitude", "orientation")
STATUSES = ("optimal", "feasible", "infeasible", "interrupted")
TABLES = ("problem", "solver")
SOLVER = ("iterations", "evaluations", "seconds", "seed", "starts", "solved")  # numbers, where the table has them
NUMBERS = {  # tables without further keys but the objective's name, with those that hold numbers
    "orientation": ("start", "end", "goal"),
    "com": ("position0", "velocity0", "gravity"),
    "objective": ("value",),
}
NOT_STATED = (
    "solver",
    "out_of_plane_leak",
    "problem_file",
    "certificate",
    "replay",
)  # may hold what is not finite: null in a file


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
    known = {f.name for f in fields(PlanRecord)}
    optional = {
        "motor_torque_peak", "warnings", "utilisation", "out_of_plane_leak", "certificate", "replay", "floatplan"
    }  # fmt: skip
    for name in sorted(known - optional):
        if name not in content:
            raise InputError("is missing", element=name)
    unknown = sorted(set(content) - known)
    if unknown:
        raise InputError("must not be there: a plan file has no such key", element=unknown[0])
    values = dict(content)
    values["robot"] = _robot_record(content["robot"])
    n = len(values["robot"].joints)
    for name, shape in (("centre", (n,)), ("amplitude", (n,)), ("torque_peak", (n,)), ("velocity_peak", (n,))):
        values[name] = _numbers(content[name], name, shape)
    if not (values["amplitude"] > 0).all():
        raise InputError("is not positive", element="amplitude")
    values["coefficients"] = _numbers(content["coefficients"], "coefficients", (n, None))
    if not values["coefficients"].shape[1]:
        raise InputError("is empty", element="coefficients")
    values["angular_momentum"] = _number(content["angular_momentum"], "angular_momentum")
    low, high = _numbers(content["angular_momentum_bounds"], "angular_momentum_bounds", (2,)).tolist()
    if low > high:
        raise InputError(f"low {low} is above high {high}", element="angular_momentum_bounds")
    values["angular_momentum_bounds"] = (low, high)
    for name in ("clearance_min", "out_of_plane_leak"):
        if content.get(name) is not None:
            values[name] = _number(content[name], name)
    if content.get("motor_torque_peak") is not None:
        peaks = _table(content["motor_torque_peak"], "motor_torque_peak")
        values["motor_torque_peak"] = {name: _number(peak, f"motor_torque_peak.{name}") for name, peak in peaks.items()}
    if not isinstance(content.get("problem_file"), str | None):
        raise InputError("is not a text", element="problem_file")
    for name in ("warnings", "utilisation"):
        if content.get(name) is not None:
            _rows(content[name], name)
    _check_verdict(content)
    _check_tables(content)
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


def _robot_record(content: Any) -> RobotRecord:
    table = _table(content, "robot")
    try:
        record = RobotRecord(**table)
    except TypeError as error:
        raise InputError(f"does not describe a robot: {error}", element="robot") from None
    for name in ("urdf", "sha256", "plane"):
        _text(table[name], f"robot.{name}")
    if not isinstance(record.joints, list) or not all(isinstance(name, str) for name in record.joints):
        raise InputError("must be a list of names", element="robot.joints")
    for name, value in _table(record.locked, "robot.locked").items():
        _number(value, f"robot.locked.{name}")
    for name, coupling in _table(record.coupled, "robot.coupled").items():
        element = f"robot.coupled.{name}"
        if set(_table(coupling, element)) != {"leader", "ratio", "offset"}:
            raise InputError(f"must have leader, ratio and offset, not {', '.join(coupling)}", element=element)
        _text(coupling["leader"], f"{element}.leader")
        _numbers([coupling["ratio"], coupling["offset"]], element, (2,))
    for name, digest in _table(record.meshes, "robot.meshes").items():
        _text(digest, f"robot.meshes.{name}")
    return replace(record, joints=tuple(record.joints))


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


def _check_verdict(content: Mapping[str, Any]) -> None:
    if content["status"] not in STATUSES:
        raise InputError(f"must be {' or '.join(map(repr, STATUSES))}, not {content['status']!r}", element="status")
    if not isinstance(content["ok"], bool):
        raise InputError(f"{content['ok']!r} is neither true nor false", element="ok")
    _text(content["explanation"], "explanation")
    _text(content.get("floatplan", ""), "floatplan")


def _check_tables(content: Mapping[str, Any]) -> None:
    for name in TABLES:
        _table(content[name], name)
    for name, keys in NUMBERS.items():
        table = _table(content[name], name)
        for key in keys:
            if key not in table:
                raise InputError("is missing", element=f"{name}.{key}")
            if key in ("position0", "velocity0"):
                _numbers(table[key], f"{name}.{key}", (2,))
            else:
                _number(table[key], f"{name}.{key}")
        unknown = sorted(set(table) - {*keys, *(("name",) if name == "objective" else ())})
        if unknown:
            raise InputError("must not be there: a plan file has no such key", element=f"{name}.{unknown[0]}")
    for name in SOLVER:
        if content["solver"].get(name) is not None:
            _number(content["solver"][name], f"solver.{name}")
    _text(content["objective"].get("name"), "objective.name")
    for name in ("certificate", "replay"):
        if content.get(name) is not None:
            _table(content[name], name)
    flight = _table(content["problem"].get("flight"), "problem.flight")
    if not _number(flight.get("duration"), "problem.flight.duration") > 0:
        raise InputError(f"{flight['duration']} s is not positive", element="problem.flight.duration")


def _table(value: Any, element: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError("must be a table", element=element)
    return value


def _rows(value: Any, element: str) -> None:
    if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
        raise InputError("is not a list of tables", element=element)


def _text(value: Any, element: str) -> None:
    if not isinstance(value, str):
        raise InputError("must be a text", element=element)


def _number(value: Any, element: str) -> float:
    return value if type(value) is float else float(_numbers(value, element, ()))


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
