"""What is answered, as data: exactly what a plan file holds. No physics.

The file is JSON, format ``floatplan.plan/1``. Numbers are written so that they read back bit for bit; a number that
does not exist (no obstacle, no limit) is ``null``.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError

FORMAT = "floatplan.plan/1"
STATUSES = ("optimal", "feasible", "infeasible")
TABLES = {  # with the keys that hold numbers
    "problem": (),
    "orientation": ("start", "end", "goal"),
    "com": ("position0", "velocity0", "gravity"),
    "objective": ("value",),
    "solver": (),
}


@dataclass(frozen=True)
class RobotRecord:
    """Which robot the plan is for, and how it was read: the arguments of ``Robot.from_urdf``.

    ``urdf`` is the path (or ``example-robot-data:`` address) as resolved when planned, ``sha256`` that of the file.
    """

    urdf: str
    sha256: str
    joints: tuple[str, ...]
    plane: str
    coupled: Mapping[str, Any] = field(default_factory=dict)
    locked: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PlanRecord:
    """A plan as data. Arrays are read-only, lists follow ``robot.joints``.

    Attributes
    ----------
    status : "optimal", "feasible" or "infeasible"
    ok : whether every constraint holds
    explanation : one or more sentences; empty where there is nothing to explain
    problem : the problem as resolved: the tables of a problem file, in rad, lists in joint order
    angular_momentum : kg m^2/s
    angular_momentum_bounds : (low, high) of (9), kg m^2/s
    centre, amplitude : (n,) rad, of ``q_i = centre_i + amplitude_i sin(p_i(t))``
    coefficients : (n, k+1), powers of t in seconds of p_i
    orientation : {"start", "end", "goal"}, rad
    com : {"position0": (2,) m, "velocity0": (2,) m/s, "gravity": m/s^2}
    objective : {"name", "value"}
    torque_peak, velocity_peak : (n,) N m, rad/s; largest magnitudes over the flight
    clearance_min : m, surface to surface, margin not subtracted; None without obstacles
    solver : {"iterations", "evaluations", "seconds", "seed", ...}
    motor_torque_peak : motor's joint -> N m, the largest magnitude of its own torque; None in files without it
    warnings : what the plan does beside what was asked: {"kind", "subject", "value", "limit", "unit", "instant",
        "message"} each; None in files without it
    utilisation : how much of its limits each motor uses, worst first; None in files without it
    out_of_plane_leak : largest angular momentum out of the plane over that in it; None in files without it
    certificate, replay : what the checks found, None where they were not run
    """

    status: str
    ok: bool
    explanation: str
    problem: Mapping[str, Any]
    robot: RobotRecord
    angular_momentum: float
    angular_momentum_bounds: tuple[float, float]
    centre: Array
    amplitude: Array
    coefficients: Array
    orientation: Mapping[str, float]
    com: Mapping[str, Any]
    objective: Mapping[str, Any]
    torque_peak: Array
    velocity_peak: Array
    clearance_min: float | None
    solver: Mapping[str, Any]
    motor_torque_peak: Mapping[str, float] | None = None
    warnings: Sequence[Mapping[str, Any]] | None = None
    utilisation: Sequence[Mapping[str, Any]] | None = None
    out_of_plane_leak: float | None = None
    certificate: Mapping[str, Any] | None = None
    replay: Mapping[str, Any] | None = None
    format: str = FORMAT
    floatplan: str = ""

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return float(self.problem["flight"]["duration"])

    def with_checks(
        self, certificate: Mapping[str, Any] | None = None, replay: Mapping[str, Any] | None = None
    ) -> PlanRecord:
        """Return the record with the findings of its checks."""
        return replace(self, certificate=certificate or self.certificate, replay=replay or self.replay)

    def to_dict(self) -> dict[str, Any]:
        """Return what the file holds, as plain lists, numbers and ``None``."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        values["robot"] = asdict(self.robot)
        ordered = ["format", "floatplan", *(name for name in values if name not in ("format", "floatplan"))]
        return {name: plain(values[name]) for name in ordered}

    def save(self, path: str | Path) -> Path:
        """Write the plan file; it appears whole or not at all."""
        return write_whole(path, json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """Turn arrays, tuples and mappings into what JSON holds; numbers that are not finite become ``None``."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_whole(path: str | Path, content: str | bytes) -> Path:
    """Write to a temporary name beside ``path`` and rename, so that nobody ever sees half a file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        mask = os.umask(0)
        os.umask(mask)
        Path(temporary).chmod(0o666 & ~mask)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def load_record(path: str | Path) -> PlanRecord:
    """Read a plan file.

    Raises
    ------
    InputError
        The file is missing, is no plan file, lacks a key, or holds what cannot be.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except FileNotFoundError:
        raise InputError("no such file", source=path) from None
    except IsADirectoryError:
        raise InputError("is a directory", source=path, advice="name its plan.json") from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=path) from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", source=path) from None
    except InputError as error:
        raise error.within(source=path) from None
    try:
        return record_from_dict(content)
    except InputError as error:
        raise error.within(source=path) from None


def record_from_dict(content: Any) -> PlanRecord:
    """Rebuild a record from what a plan file holds."""
    if not isinstance(content, dict):
        raise InputError("is not a plan: no JSON object")
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
        raise InputError("is no key of a plan file", element=unknown[0])
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
    for name in ("warnings", "utilisation"):
        for row in content.get(name) or []:
            _table(row, name)
    _check_verdict(content)
    _check_tables(content)
    return PlanRecord(**values)


def _robot_record(content: Any) -> RobotRecord:
    table = _table(content, "robot")
    try:
        record = RobotRecord(**table)
    except TypeError as error:
        raise InputError(f"does not describe a robot: {error}", element="robot") from None
    for name in ("urdf", "sha256", "plane"):
        _text(table[name], f"robot.{name}")
    if not isinstance(record.joints, list) or not all(isinstance(name, str) for name in record.joints):
        raise InputError("is no list of names", element="robot.joints")
    for name, value in _table(record.locked, "robot.locked").items():
        _number(value, f"robot.locked.{name}")
    for name, coupling in _table(record.coupled, "robot.coupled").items():
        element = f"robot.coupled.{name}"
        if set(_table(coupling, element)) != {"leader", "ratio", "offset"}:
            raise InputError("is no coupling: it has other keys than leader, ratio and offset", element=element)
        _text(coupling["leader"], f"{element}.leader")
        _numbers([coupling["ratio"], coupling["offset"]], element, (2,))
    return replace(record, joints=tuple(record.joints))


def _check_verdict(content: Mapping[str, Any]) -> None:
    if content["status"] not in STATUSES:
        raise InputError(f"{content['status']!r} is none of {', '.join(STATUSES)}", element="status")
    if not isinstance(content["ok"], bool):
        raise InputError(f"{content['ok']!r} is neither true nor false", element="ok")
    _text(content["explanation"], "explanation")
    _text(content.get("floatplan", ""), "floatplan")


def _check_tables(content: Mapping[str, Any]) -> None:
    for name, keys in TABLES.items():
        table = _table(content[name], name)
        for key in keys:
            if key not in table:
                raise InputError("is missing", element=f"{name}.{key}")
            _numbers(table[key], f"{name}.{key}", (2,) if key in ("position0", "velocity0") else ())
    _text(content["objective"].get("name"), "objective.name")
    for name in ("certificate", "replay"):
        if content.get(name) is not None:
            _table(content[name], name)
    flight = _table(content["problem"].get("flight"), "problem.flight")
    if not _number(flight.get("duration"), "problem.flight.duration") > 0:
        raise InputError(f"{flight['duration']} s is not positive", element="problem.flight.duration")


def _table(value: Any, element: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError("is no table", element=element)
    return value


def _text(value: Any, element: str) -> None:
    if not isinstance(value, str):
        raise InputError("is no text", element=element)


def _number(value: Any, element: str) -> float:
    return float(_numbers(value, element, ()))


def _numbers(value: Any, element: str, shape: tuple[int | None, ...]) -> Array:
    try:
        array = np.array(value)
    except ValueError:
        raise InputError("does not hold numbers", element=element) from None
    if array.dtype.kind not in "iuf":
        raise InputError("does not hold numbers", element=element)
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise InputError(f"has shape {array.shape}, not {shape}", element=element)
    if not np.isfinite(array).all():
        raise InputError("holds a number that is not finite", element=element)
    return read_only(array)


def _refuse_constant(name: str) -> None:
    raise InputError(f"holds {name}, which is no JSON number")
