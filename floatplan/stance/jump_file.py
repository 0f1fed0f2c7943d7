"""Files of jumps, ``jump.json``: what is needed to rebuild and check a jump without its program.

JSON, format ``floatplan.jump/1``: ``status``, ``explanation``, ``robot`` and ``problem`` as in plan files, ``request``,
``flight``, an unchanged plan file or ``null``, and ``stances``, each with ``side``, ``contacts``, ``place`` of its
first contact, and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (orientation and
joints with their derivatives), ``ratios``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import optional
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming
from floatplan.files import check_finite, plain, read_json, write_atomically
from floatplan.plans.plan_file import rebuild
from floatplan.plans.reading import record_from_dict
from floatplan.plans.record import RobotRecord
from floatplan.plans.recorded_robot import recorded_robot, robot_record
from floatplan.pool.threads import one_thread
from floatplan.problem.file import problem_from_dict, problem_to_dict
from floatplan.robot import Robot
from floatplan.stance.contacts import Contact
from floatplan.stance.grid import Grid
from floatplan.stance.jump import Jump
from floatplan.stance.motion import Stance
from floatplan.stance.request import JumpRequest

FORMAT = "floatplan.jump/1"
KEYS = ("format", "status", "explanation", "robot", "problem", "request", "flight", "stances")
ARRAYS = ("times", "y", "v", "a", "ratios")


def save_jump(jump: Jump, path: str | Path) -> Path:
    """Write a jump's file; it appears whole or not at all."""
    sides = (("takeoff", jump.before), ("landing", jump.after))
    content = {
        "format": FORMAT,
        "status": jump.status,
        "explanation": jump.explanation,
        "robot": vars(robot_record(jump.problem.robot)),
        "problem": problem_to_dict(jump.problem),
        "request": vars(jump.request),
        "flight": None if jump.flight is None else jump.flight.record.to_dict(),
        "stances": [{"side": side, **_stance(each)} for side, stances in sides for each in stances],
    }
    return write_atomically(as_path(path, "path"), json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def _stance(stance: Stance) -> dict[str, Any]:
    return {
        "contacts": [
            {
                "frames": list(each.frames),
                "suffix": each.suffix,
                "places": [[place.real, place.imag] for _, place in each.spots],
                "depth": each.depth,
                "vertical": each.vertical,
            }
            for each in stance.contacts
        ],
        "place": [stance.place.real, stance.place.imag],
        **{name: getattr(stance.grid, name) for name in ARRAYS},
    }


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
    asked = content["request"]
    request = JumpRequest(**asked)
    sides: dict[str, list[Stance]] = {"takeoff": [], "landing": []}
    for index, each in enumerate(content["stances"]):
        sides[each["side"]].append(_read_stance(each, robot, problem.flight.gravity, f"stances[{index}]"))
    if (flight is None) == all(sides.values()):
        raise InputError("do not fit the flight", element="stances")
    return Jump(
        problem,
        request,
        str(content["status"]),
        str(content["explanation"]),
        flight,
        tuple(sides["takeoff"]),
        tuple(sides["landing"]),
    )


def _read_stance(content: Mapping[str, Any], robot: Robot, gravity: float, element: str) -> Stance:
    contacts = tuple(
        Contact(
            tuple(each["frames"]),
            str(each["suffix"]),
            tuple(
                (robot.frames[frame].body, complex(*place))
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
        arrays[name] = read_only(values)
    return Stance(robot, float(gravity), contacts, complex(*content["place"]), Grid(read_only(times), **arrays))
