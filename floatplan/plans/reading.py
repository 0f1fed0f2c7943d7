"""A plan file, or a record built in Python, read: it holds what a plan has, in numbers that a flight can have.

Its robot is read again, as it was read then, and must be the same file.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from floatplan.arguments import in_short, number, without
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming
from floatplan.files import (
    check_depth,
    check_finite,
    check_hash,
    check_numbers,
    is_file,
    json_value,
    read_json,
    read_regular,
)
from floatplan.plans.record import FILES, FORMAT, FORMAT_IN_SPACE, PlanRecord, RobotRecord, check_requested
from floatplan.robot.chosen import chosen_robot
from floatplan.robot.robot import Coupling, Robot
from floatplan.robot.shapes.collisions import LARGEST_MESH
from floatplan.robot.urdf.tree import is_address

LARGEST = 1e12  # [SI] above every number of a request; limits that are placeholders are as large
LARGEST_RESULT = 1e100  # [SI] above every number that follows from those, as squares do; its own square is finite
LARGEST_ANGLE = 1e11  # [rad] of a term of p: of degree 15, the highest, terms of 3.6e10 rad cancel to 1 (Chebyshev's)
REQUESTED = ("problem", "robot", "centre", "amplitude", "orientation")
LOSSES = ("armature", "damping")  # of motors
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
    content = read_json(Path(path))
    with naming(path):
        return record_from_dict(content)


def record_from_dict(content: Any) -> PlanRecord:
    """Rebuild a record from what a plan file holds; errors as :func:`load_record`."""
    if not isinstance(content, dict):
        raise InputError("is not a plan: no JSON object")
    check_finite(content)
    return _record(content)


def checked(record: PlanRecord) -> PlanRecord:
    """Return a record as its file would be read, having seen that nothing in it would be passed over.

    Raises
    ------
    InputError
        As :func:`load_record` and :func:`~floatplan.plans.record.check_requested`; and of numbers that are not finite,
        which a file would hold as ``null``.
    """
    check_depth(vars(record))
    stated = without(vars(record), NOT_STATED)
    check_finite({**stated, "robot": vars(record.robot)})
    written = _record(record.to_dict())
    check_requested(written)
    return written


def _record(content: dict[str, Any]) -> PlanRecord:
    kind = content.get("format")
    if not isinstance(kind, str) or kind not in FILES:
        advice = "give a plan file: that of a jump's flight is plan.json, next to jump.json"
        raise InputError(f"{kind!r} is not {FORMAT!r}, nor {FORMAT_IN_SPACE!r}", element="format", advice=advice)
    FILES[kind](content, "")
    robot = RobotRecord.from_dict(content["robot"])
    values = {**content, "robot": robot}
    for name in ("centre", "amplitude", "torque_peak", "velocity_peak"):
        values[name] = _numbers(content[name], name, (len(robot.joints),))
    if not (values["amplitude"] > 0).all():
        raise InputError("is not positive", element="amplitude")
    values["coefficients"] = _numbers(content["coefficients"], "coefficients", (len(robot.joints), None))
    if not values["coefficients"].shape[1]:
        raise InputError("is empty", element="coefficients")
    if kind == FORMAT_IN_SPACE:
        values["angular_momentum"] = read_only(content["angular_momentum"])
    else:
        values["angular_momentum"] = float(content["angular_momentum"])
        low, high = values["angular_momentum_bounds"] = tuple(map(float, content["angular_momentum_bounds"]))
        if low > high:
            raise InputError(f"low {low} is above high {high}", element="angular_momentum_bounds")
    if (robot.base is None) != (kind == FORMAT):
        raise InputError(f"does not fit the format {kind!r}", element="robot.base")
    for name in ("clearance_min", "out_of_plane_leak"):
        if content.get(name) is not None:
            values[name] = float(content[name])
    if content.get("motor_torque_peak") is not None:
        values["motor_torque_peak"] = {name: float(peak) for name, peak in content["motor_torque_peak"].items()}
    _check_sizes(content, values["coefficients"])
    return PlanRecord(**values)


def _check_sizes(content: Mapping[str, Any], coefficients: Array) -> None:
    """Refuse numbers beyond what any flight has; b_k counts as ``b_k T^k``, which is an angle."""
    duration = float(content["problem"]["flight"]["duration"])
    number("duration")(duration, "problem.flight.duration")
    with np.errstate(over="ignore"):
        angles = np.abs(coefficients) * duration ** np.arange(coefficients.shape[1])
    if not (angles <= LARGEST_ANGLE).all():
        raise InputError(f"give terms of more than {LARGEST_ANGLE:g} rad", element="coefficients")
    solver = without(content["solver"], ("seed",))
    for name, value in {**content, "solver": solver}.items():
        if name not in ("coefficients", "certificate", "replay"):
            check_size(value, name, LARGEST if name in REQUESTED else LARGEST_RESULT)


def check_size(value: Any, element: str, largest: float) -> None:
    """Refuse numbers, in mappings and sequences, that are larger than the largest."""
    check_numbers(
        value,
        element,
        lambda number: not abs(number) > largest,
        lambda number: InputError(f"{number:g} is larger than anything in a flight, {largest:g}"),
    )


def _numbers(value: Any, element: str, shape: tuple[int | None, ...]) -> Array:
    array = np.array(value, dtype=object)
    if not all(type(number) in (int, float) for number in array.flat):
        raise InputError("does not hold numbers", element=element)
    if array.ndim != len(shape) or any(want not in (None, have) for have, want in zip(array.shape, shape, strict=True)):
        raise InputError(f"has shape {array.shape}, not {shape}", element=element)
    return read_only(array)


class Recorded(Protocol):
    """A plan with its record and its robot, such as :class:`floatplan.Plan`."""

    @property
    def record(self) -> PlanRecord:
        """The plan as data."""

    @property
    def robot(self) -> Robot:
        """The robot that flies."""


def recorded(plan: Recorded | PlanRecord | str | Path) -> tuple[PlanRecord, str | Path | None, Robot | None]:
    """Return a plan's record; the file that it was read from, and its robot, where there is one.

    Raises
    ------
    InputError
        It is no plan, nor the path of one; or its file is wrong.
    """
    if isinstance(plan, PlanRecord):
        return plan, None, None
    if isinstance(plan, str | Path):
        return load_record(plan), plan, None
    if not isinstance(getattr(plan, "record", None), PlanRecord):
        raise InputError(f"{in_short(plan)} is neither a Plan nor the path of one", element="plan")
    return plan.record, None, plan.robot


def recorded_robot(record: RobotRecord, plan_file: str | Path | None = None, urdf: str | Path | None = None) -> Robot:
    """Load the robot that a plan is for.

    Parameters
    ----------
    record : RobotRecord
    plan_file : path, optional
        The plan's file; the URDF may lie in its folder too.
    urdf : path, optional
        The robot's file, where it is elsewhere.

    Raises
    ------
    InputError
        The URDF is missing, or is not what it was when the plan was made.
    """
    choices: dict[str, Any] = {name: getattr(record, name) for name in ("plane", "joints", "locked", *LOSSES)}
    choices["base"] = record.base or "planar"
    choices |= {"balance_inertias": record.balance_inertias, "payload": record.payload}
    choices["coupled"] = {name: Coupling(**values) for name, values in record.coupled.items()}
    source = find_robot(record, plan_file) if urdf is None else urdf
    robot = chosen_robot(source, choices, plan_file, "robot.", record.kind)
    if robot.sha256 != record.sha256:
        raise _changed(f"the {record.kind.upper()}", f"robot.sha256 of {urdf or record.file}", plan_file)
    for name in robot.files:
        if record.meshes.get(name) != robot.files[name]:
            raise _changed("what the MJCF is read with", f"robot.meshes of {name}", plan_file)
    if not record.resting:
        return robot
    if len(record.resting) != len(robot.joints):
        raise InputError("must have a number for each joint", source=plan_file, element="robot.resting")
    return replace(robot, resting=read_only(np.clip(record.resting, *np.asarray(robot.position_limits).T)))


def _changed(what: str, element: str, source: str | Path | None) -> InputError:
    advice = "plan again, or bring the old file back"
    return InputError(f"{what} has changed since the plan was made", source=source, element=element, advice=advice)


def check_meshes(robot: Robot, record: RobotRecord, plan_file: str | Path | None = None) -> None:
    """Refuse collision meshes that are not what they were when the plan was made; those without a recorded hash pass.

    Raises
    ------
    InputError
        A mesh has changed, or is no longer there; or the collision geometry is of a kind that is not read.
    """
    try:
        robot.check_shapes()
    except InputError as error:
        raise error.within(source=plan_file or error.source) from None
    for filename, digest in record.meshes.items():
        if robot.meshes.get(filename) != digest:
            raise _changed("the collision mesh", f"robot.meshes of {filename}", plan_file)


def check_parts(record: RobotRecord, path: Path) -> None:
    """Refuse an MJCF at ``path`` if a file that it is read with is not what it was when the plan was made."""
    for name, digest in record.meshes.items():
        check_hash(
            read_regular(path.parent / name, LARGEST_MESH, "an included file of an MJCF"), digest, path.parent / name
        )


def find_robot(record: RobotRecord, plan_file: str | Path | None) -> str:
    """Return where the robot's file of a plan is: as recorded, or in the plan file's folder or relative to it.

    Raises
    ------
    InputError
        It is in none of these places.
    """
    file = record.file
    if plan_file is None or is_address(file) or is_file(Path(file)):
        return file
    for name in (Path(file).name, file):
        path = Path(plan_file).parent / name
        if is_file(path):
            return str(path)
    element = f"robot.{record.kind} {file}"
    raise InputError("no such file", source=plan_file, element=element, advice="--urdf says where it is")


def robot_record(robot: Robot) -> RobotRecord:
    """Return which robot this is and how it was read, for a plan file."""
    values: dict[str, Any] = {name: dict(getattr(robot, name)) for name in ("locked", "meshes", *LOSSES)}
    values[robot.kind] = robot.source if is_address(robot.source) else str(robot.path.resolve())
    if robot.kind == "mjcf":
        values["resolved"] = {"urdf": robot.xml, "sha256": hashlib.sha256(robot.xml.encode()).hexdigest()}
    return RobotRecord(
        sha256=robot.sha256,
        joints=robot.joints,
        plane=robot.plane.name if robot.in_plane else None,
        base=None if robot.in_plane else robot.base,
        coupled={name: json_value(vars(coupling)) for name, coupling in robot.coupled.items()},
        resting=tuple(robot.resting.tolist()),
        balance_inertias=robot.balance_inertias or None,
        payload=tuple(json_value(vars(payload)) for payload in robot.payload) or None,
        **values,
    )
