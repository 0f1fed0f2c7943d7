"""Files of jumps, read: a jump brought back to life beside the URDF that it names, without its program."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import optional
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming
from floatplan.files import check_finite, read_json
from floatplan.plans.plan import rebuild
from floatplan.plans.reading import LARGEST, check_size, record_from_dict, recorded_robot
from floatplan.plans.record import RobotRecord
from floatplan.pool import one_thread
from floatplan.problem.file import problem_from_dict
from floatplan.problem.jump import JumpRequest
from floatplan.robot import Robot
from floatplan.stance.contacts import Contact
from floatplan.stance.jump import FORMAT, Jump
from floatplan.stance.model import Spot
from floatplan.stance.motion import Grid, Stance

KEYS = ("format", "status", "explanation", "robot", "problem", "flight", "stances")


@one_thread
def load_jump(path: str | Path, urdf: str | Path | None = None) -> Jump:
    """Read a jump's file and the URDF that it names, or another place of the same file.

    Raises
    ------
    InputError
        Either is missing, damaged, or does not belong to the other.
    """
    path = as_path(path, "path")
    content = read_json(path, kind="a jump file")
    with naming(path):
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise InputError(f"is no jump file: its format is not {FORMAT!r}", element="format")
        check_finite(content)
        missing = [name for name in KEYS if name not in content]
        if missing:
            raise InputError("is missing", element=missing[0])
    try:
        return _read(content, path, optional(as_path)(urdf, "urdf"))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise error.within(source=path) from None
        raise InputError(f"is damaged: {error}", source=path) from None


def _read(content: Mapping[str, Any], path: Path, urdf: str | Path | None) -> Jump:
    flight = None if content["flight"] is None else rebuild(record_from_dict(content["flight"]), path, urdf)
    record = content["robot"]
    found = RobotRecord(**{**record, "joints": tuple(record["joints"])})
    robot = recorded_robot(found, path, urdf) if flight is None else flight.robot
    if robot.sha256 != found.sha256:
        raise InputError("is not the robot of the flight", element="robot.sha256")
    problem = problem_from_dict(content["problem"], robot, path)
    request = problem.jump or JumpRequest()
    check_size(content["stances"], "stances", LARGEST)
    sides: dict[str, list[Stance]] = {"takeoff": [], "landing": []}
    for index, each in enumerate(content["stances"]):
        sides[each["side"]].append(_read_stance(each, robot, problem.flight.gravity, f"stances[{index}]"))
    rolls = {each.radius > 0 for stances in sides.values() for stance in stances for each in stance.contacts}
    if rolls - {request.feet == "rolling"}:
        raise InputError(f"do not fit problem.jump.feet, {request.feet!r}", element="stances")
    if (flight is None) == all(sides.values()):
        raise InputError("do not fit the flight", element="stances")
    answer = {"status": str(content["status"]), "explanation": str(content["explanation"])}
    return Jump(problem, request, flight, tuple(sides["takeoff"]), tuple(sides["landing"]), **answer)


def _read_stance(content: Mapping[str, Any], robot: Robot, gravity: float, element: str) -> Stance:
    if not content["contacts"] or not all(each["frames"] for each in content["contacts"]):
        raise InputError("must name what stands", element=f"{element}.contacts")
    contacts = tuple(
        Contact(
            tuple(each["frames"]),
            str(each["suffix"]),
            tuple(
                Spot(robot.frames[frame].body, complex(*place), each["depth"] if each.get("rolls") is True else 0.0)
                for frame, place in zip(each["frames"], each["places"], strict=True)
            ),
            float(each["depth"]),
            bool(each["vertical"]),
        )
        for each in content["contacts"]
    )
    times = np.asarray(content["times"], dtype=np.float64)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0).all():
        raise InputError("must be increasing instants", element=f"{element}.times")
    rows = {"y": 1 + len(robot.joints), "ratios": len(contacts) - 1}
    arrays: dict[str, Array] = {}
    for name in ("y", "v", "a", "ratios"):
        shape = (rows.get(name, rows["y"]), len(times))
        values = np.asarray(content[name], dtype=np.float64).reshape(-1, len(times))
        if values.shape != shape:
            raise InputError(f"has shape {values.shape}, not {shape}", element=f"{element}.{name}")
        if not np.isfinite(values).all():
            raise InputError("must be finite numbers", element=f"{element}.{name}")
        arrays[name] = read_only(values)
    return Stance(robot, float(gravity), contacts, complex(*content["place"]), Grid(read_only(times), **arrays))
