"""Problem files: their tables, TOML in, TOML out, and the same tables as data for plan files."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import tomli_w

from floatplan.arguments import FINITE, attributes, by_name, in_short, made, optional, without
from floatplan.arguments import path as as_path
from floatplan.errors import InputError, naming, refuse, single
from floatplan.files import json_value, parsed_toml, read_text, write_atomically
from floatplan.keys import Keyed, json_schema, read_tables, table_of, tables
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Flight, JointState, Limits, Motion, Obstacle, Posture, SelfClearance
from floatplan.problem.problem import Problem
from floatplan.problem.reference import read_reference
from floatplan.problem.resolution import finite_limits
from floatplan.problem.spatial_obstacles import SpatialObstacle
from floatplan.robot.chosen import chosen_robot
from floatplan.robot.robot import Coupling, Robot
from floatplan.robot.urdf.inertias import Payload, payloads
from floatplan.robot.urdf.tree import is_address, refuse_bare_name
from floatplan.tables import FLIGHT_EVENTS, KEY_TABLE, ROBOT_KINDS, Base, Key, RobotKind, Unit

Angles: TypeAlias = Annotated[Unit, KEY_TABLE["angles"]]
Name: TypeAlias = Annotated[
    str | None, Key("Of the problem, and of the folder of its results; the file's name where left out")
]
LARGEST_PROBLEM = 5_000_000  # [bytes] of a problem file


@dataclass(frozen=True)
class RobotRequest(Keyed):
    """``[robot]``: the robot's file, and the choices that it leaves open."""

    urdf: Annotated[
        str | None,
        Key(
            "Path from this file's folder; or `example-robot-data:` and a path there, "
            "`package:NAME/` and a path in an installed package, or a name of robot_descriptions"
        ),
    ] = None
    mjcf: Annotated[str | None, Key("Instead of `urdf`: path or address of an MJCF file, which MuJoCo compiles")] = None
    plane: Annotated[str | None, KEY_TABLE["robot.plane"]] = None
    joints: Annotated[
        Sequence[str] | None,
        Key("Joints to plan, in the order of all lists; all that rotate about the plane's normal if left out"),
    ] = None
    coupled: Annotated[Mapping[str, str | Coupling] | Literal["mirror"], KEY_TABLE["robot.coupled"]] = field(
        default_factory=dict
    )
    locked: Annotated[Mapping[str, float], KEY_TABLE["robot.locked"].with_check(by_name(FINITE))] = field(
        default_factory=dict
    )
    reference: Annotated[str | None, KEY_TABLE["robot.reference"]] = None
    armature: Annotated[
        float | Mapping[str, float] | None,
        Key("Inertia of rotors as their joints feel it: of every motor, or by joint", "kg m^2"),
    ] = None
    damping: Annotated[
        float | Mapping[str, float] | None,
        Key("Torque lost by a joint's rate, in simulators: of every motor, or by joint", "N m s/rad"),
    ] = None
    balance_inertias: Annotated[bool | None, KEY_TABLE["robot.balance_inertias"]] = None
    payload: Annotated[
        Payload | Sequence[Payload] | None,
        Key("Point mass that a link carries, or a list of them", check=optional(payloads)),
    ] = None
    base: Annotated[Base, Key('How the base moves: in a plane, or as "free-flyer" in space')] = "planar"

    def choices(self) -> dict[str, Any]:
        """Return the keyword arguments of ``Robot.from_urdf``."""
        chosen = without(attributes(self, self.keys), ROBOT_KINDS)
        return {**chosen, "coupled": self.coupled or None, "locked": self.locked or None}

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """The robot has one file."""
        if self.urdf is None and self.mjcf is None:
            yield "urdf", "is missing: give it, or mjcf"
        if self.urdf is not None and self.mjcf is not None:
            yield "mjcf", "is given beside urdf: keep one of them"


@dataclass(frozen=True, kw_only=True)
class ProblemTables(Keyed):
    """A problem file less its ``[robot]``."""

    name: Name = None
    angles: Angles = KEY_TABLE["angles"].default
    ground: Annotated[bool, Key("Whether the robot stays above the line that it takes off from")] = False
    start: Annotated[Posture, KEY_TABLE["start"]]
    goal: Annotated[Posture, KEY_TABLE["goal"]]
    flight: Annotated[Flight, Key("The flight")]
    motion: Annotated[Motion, Key("How joints may move, and what is best")] = field(default_factory=Motion)
    limits: Annotated[Limits, Key("What motors and joints can do, at all times")] = field(default_factory=Limits)
    obstacles: Annotated[Sequence[Obstacle], Key("What to keep clear of")] = ()
    self_clearance: Annotated[Sequence[SelfClearance], Key("Two links to keep apart")] = ()
    jump: Annotated[JumpRequest | None, Key("A whole jump around the flight, [jumps](jump.md)")] = None


@dataclass(frozen=True, kw_only=True)
class ProblemFile(ProblemTables):
    """A whole problem file."""

    robot: Annotated[RobotRequest, Key("The robot: its file, and the choices that it leaves open")]


@dataclass(frozen=True, kw_only=True)
class SpatialTables(ProblemTables):
    """The same of a flight in space."""

    obstacles: Annotated[Sequence[SpatialObstacle], Key("What to keep clear of")] = ()


@dataclass(frozen=True, kw_only=True)
class SpatialProblemFile(ProblemFile):
    """A whole problem file of a flight in space."""

    obstacles: Annotated[Sequence[SpatialObstacle], Key("What to keep clear of")] = ()


@dataclass(frozen=True, kw_only=True)
class AnyProblemFile(ProblemFile):
    """A whole problem file of a flight in a plane or in space, as its keys describe it."""

    obstacles: Annotated[Sequence[Obstacle | SpatialObstacle], Key("What to keep clear of")] = ()


@dataclass(frozen=True, kw_only=True)
class RobotFile(Keyed):
    """A file that names a robot, and asks nothing of it yet."""

    name: Name = None
    angles: Angles = KEY_TABLE["angles"].default
    robot: Annotated[RobotRequest, Key("The robot")]


ABOUT = "The whole file"
TABLES: dict[str, tuple[type[Keyed], str]] = {  # by their places, with what they are about; the robot's first
    "": (AnyProblemFile, ABOUT),
    **dict(sorted(tables(AnyProblemFile).items(), key=lambda table: not table[0].startswith("robot"))),
}


def problem_schema() -> dict[str, Any]:
    """Return the JSON Schema of problem files, for editors."""
    return json_schema(AnyProblemFile, "floatplan problem", ABOUT)


def load_problem(path: str | Path) -> Problem:
    """Read a problem file.

    Parameters
    ----------
    path : path
        A TOML file. The path of its robot's file is taken from the folder of this file.

    Raises
    ------
    InputError
        The file is missing or no TOML; or keys are unknown, missing or wrong: all of these in one message, a line each.
    """
    path = as_path(path, "path")
    refuse_bare_name(path)
    text = read_text(path, LARGEST_PROBLEM, "a problem file")
    content = parsed_toml(text, path)
    with naming(path):
        wrong: list[InputError] = []
        tables = read_tables(SpatialProblemFile if _in_space(content) else ProblemFile, content, wrong)
        robot = _robot(tables.robot, path, tables.angles)
        if tables.motion.clip is not None and tables.motion.clip.file is not None:
            clip = read_reference(tables.motion.clip, path.parent, robot)
            tables = tables.changed(motion=tables.motion.changed(clip=clip))
        return _problem(tables, wrong, robot, path.stem, text)


def _in_space(content: Mapping[str, Any]) -> bool:
    """Whether a problem file is of a flight in space, where obstacles have other keys."""
    robot = content.get("robot")
    return isinstance(robot, Mapping) and robot.get("base") == "free-flyer"


def as_problem(problem: Problem | str | Path, element: str = "problem") -> Problem:
    """Return the problem that is a function's argument, or read its file; errors as :func:`load_problem`."""
    if isinstance(problem, Problem):
        return problem
    if not isinstance(problem, str | Path):
        raise InputError(f"{in_short(problem)} is neither a Problem nor the path of one", element=element)
    return load_problem(problem)


def load_robot(path: str | Path) -> Robot:
    """Read the robot of a problem file, which may hold only ``[robot]``; errors as :func:`load_problem`."""
    path = Path(path)
    refuse_bare_name(path)
    content = read_toml(path)
    if not set(content) <= set(RobotFile.keys):
        return load_problem(path).robot
    with naming(path):
        tables = read_tables(RobotFile, content)
        return _robot(tables.robot, path, tables.angles)


def problem_from_dict(
    content: Mapping[str, Any], robot: Robot, source: str | Path | None = None, written: str | None = None
) -> Problem:
    """Rebuild a problem from the tables of a problem file less ``[robot]``, as data.

    Parameters
    ----------
    content : mapping
        As :func:`problem_to_dict` makes it; ``None`` is no limit.
    robot : Robot
    source : path, optional
        What error messages name as the file.
    written : str, optional
        The problem file that the content comes from, as text.

    Raises
    ------
    InputError
        As :func:`load_problem`.
    """
    content = dict(content)
    words = {}
    for end in FLIGHT_EVENTS:
        words[end] = _popped(content, end, ("velocities_asked", "accelerations_asked"))
    (own,) = _popped(content, "limits", ["motor_torque"])
    if own is not None:  # contains the limits of the generalised torques
        content["limits"] = {**content["limits"], "torque": own}
    with naming(source):
        wrong: list[InputError] = []
        tables = read_tables(ProblemTables if robot.in_plane else SpatialTables, content, wrong)
        for end, event_words in words.items():
            posture = getattr(tables, end)
            if any(event_words):
                velocities, accelerations = posture.velocities, posture.accelerations
                settled = tuple(None if isinstance(values, str) else values for values in (velocities, accelerations))
                posture = posture.changed(
                    velocities=event_words[0] or velocities,
                    accelerations=event_words[1] or accelerations,
                    settled=settled,
                )
                tables = tables.changed(**{end: posture})
        return _problem(tables, wrong, robot, "flight", written)


def _popped(content: dict[str, Any], table: str, keys: Sequence[str]) -> list[Any]:
    """Values of keys that a table has only in plan files, None where it has not, taken out of it."""
    content_there = content.get(table)
    if not isinstance(content_there, Mapping):
        return [None] * len(keys)
    content[table] = without(content_there, keys)
    return list(map(content_there.get, keys))


def problem_to_dict(problem: Problem) -> dict[str, Any]:
    """Return the resolved problem as data: radians, lists in joint order, ``None`` for no limit.

    The keys are those of a problem file less ``[robot]``, and :func:`problem_from_dict` reads it back bit for bit.
    """
    limits: dict[str, Any] = {
        "position": problem.position_limits,
        **{str(key): values for key, values in problem.joint_limits.items()},
        "torque": problem.torque_limits,
        **_of_motors(problem),
        "orientation_rate": problem.limits.orientation_rate,
    }
    content = {
        "name": problem.name,
        "ground": problem.ground,
        "start": _posture(problem.initial, FLIGHT_EVENTS["start"]),
        "goal": _posture(problem.final, FLIGHT_EVENTS["goal"]),
        "flight": {**asdict(problem.flight), "takeoff": asdict(problem.takeoff), "landing": asdict(problem.landing)},
        "motion": {
            "degree": "auto" if problem.raises_degree else problem.degrees,
            "objective": problem.motion.objective,
            **({} if problem.reference is None else {"clip": {"positions": problem.reference}}),
        },
        "limits": limits,
        "obstacles": [{"kind": obstacle.kind, **asdict(obstacle)} for obstacle in problem.obstacles],
        "self_clearance": list(map(asdict, problem.self_clearances)),
        **({} if problem.jump is None else {"jump": table_of(problem.jump)}),
    }
    values: dict[str, Any] = json_value(content)
    return values


def _of_motors(problem: Problem) -> dict[str, Any]:
    """The motors' curves; and where a joint has several motors, the limits of each one's own torque."""
    motors = problem.robot.motors
    curves = {}
    for motor, stall, slope in zip(motors, problem.motor_stall, problem.motor_slope, strict=True):
        if math.isfinite(stall):
            curves[motor] = {"stall": stall, "slope": slope}
    if len(motors) <= len(problem.robot.joints) or not np.isfinite(problem.motor_torque_limits).any():
        return {"motor": curves}
    return {"motor": curves, "motor_torque": finite_limits(motors, problem.motor_torque_limits)}


def save_problem(problem: Problem, path: str | Path) -> Path:
    """Write a problem file, in radians, with the path of the robot's file relative to it.

    Raises
    ------
    InputError
        The robot was not read from a file.
    """
    path = as_path(path, "path")
    return write_atomically(path, problem_text(made(Problem)(problem, "problem"), path))


def problem_text(problem: Problem, path: str | Path) -> str:
    """Return what :func:`save_problem` writes to ``path``; the same errors."""
    content = {
        "robot": _robot_table(problem.robot, Path(path)),
        "name": problem.name,
        "ground": problem.ground,
        "start": table_of(problem.start),
        "goal": table_of(problem.goal),
        "flight": table_of(problem.flight),
        "motion": table_of(problem.motion),
        "limits": table_of(problem.limits),
        "obstacles": list(map(table_of, problem.obstacles)),
        "self_clearance": list(map(table_of, problem.self_clearances)),
        "jump": problem.jump and table_of(problem.jump),
    }
    return tomli_w.dumps(_without_gaps(content))


def read_toml(path: Path, kind: str = "a problem file") -> dict[str, Any]:
    """Read a problem file, or another ``kind`` of no larger TOML files.

    Raises
    ------
    InputError
        It cannot be read, or is not TOML.
    """
    return parsed_toml(read_text(path, LARGEST_PROBLEM, kind), path)


def _robot(request: RobotRequest, path: Path, angles: Unit) -> Robot:
    request.check("robot")
    kind: RobotKind = "urdf" if request.mjcf is None else "mjcf"
    file = request.urdf or request.mjcf or ""
    source = file if is_address(file) else path.parent / file
    if isinstance(source, Path) and not source.exists():
        advice = "paths begin at this file's folder; floatplan robots lists robots of installed packages"
        raise InputError(f"there is no file {str(source)!r}", source=path, element=f"robot.{kind}", advice=advice)
    return chosen_robot(source, request.choices() | {"angles": angles}, path, "robot.", kind)


def _problem(
    tables: ProblemTables, wrong: Sequence[InputError], robot: Robot, default_name: str, written: str | None
) -> Problem:
    """The problem; or all that is wrong, in its tables and with what they ask of the robot."""
    values: dict[str, Any] = {}
    for name in ProblemTables.keys:
        if name in Problem.checks:
            values[name] = getattr(tables, name)
    values |= {"name": tables.name or default_name, "self_clearances": tables.self_clearance}
    try:
        problem = Problem(robot, **values, written=written)
    except InputError as error:
        elements = {error.element for error in wrong}
        further = [of_robot for of_robot in single(error) if of_robot.element not in elements]
        wrong = [*wrong, *further]
    refuse(wrong)
    return problem


def _posture(state: JointState, event: str) -> dict[str, Any]:
    values: dict[str, Any] = attributes(state, ("orientation", "positions", "velocities", "accelerations"))
    if state.attitude is not None:
        values["orientation"] = table_of(state.attitude)
    words = {"velocities": event if state.frame_rests else None}
    words["accelerations"] = "free" if state.free_accelerations else None
    for key, word in words.items():
        if word:
            values[f"{key}_asked" if np.isfinite(values[key]).all() else key] = word
    return values


def file_of(robot: Robot, path: Path) -> str:
    """The robot's file as a file at a path names it: relative to its folder, or in another package."""
    if is_address(robot.source):
        return robot.source
    return Path(os.path.relpath(robot.path.resolve(), path.resolve().parent)).as_posix()


def _robot_table(robot: Robot, path: Path) -> dict[str, Any]:
    return {
        robot.kind: file_of(robot, path),
        **({"plane": robot.plane.name} if robot.in_plane else {"base": robot.base}),
        "joints": list(robot.joints),
        "coupled": {joint: asdict(coupling) for joint, coupling in robot.coupled.items()},
        "locked": dict(robot.locked),
        "reference": robot.reference_name,
        "armature": dict(robot.armature),
        "damping": dict(robot.damping),
        "balance_inertias": robot.balance_inertias or None,
        "payload": list(map(table_of, robot.payload)),
    }


def _without_gaps(value: Any) -> Any:
    """Leave out of tables what is empty, and what is None: TOML knows no null."""
    if isinstance(value, list):
        return list(map(_without_gaps, value))
    if not isinstance(value, dict):
        return value
    filled = {}
    for key, item in value.items():
        content = _without_gaps(item)
        if content is not None and content not in ({}, []):
            filled[key] = content
    return filled
