"""A problem from the command line: a robot with options, or a problem file that options override."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from floatplan.cli.common import OPTIONS, ROBOT_OPTIONS, Options, RobotOptions, typed_option
from floatplan.errors import InputError, ProblemError
from floatplan.problem.file import load_problem, load_robot, problem_from_dict, problem_to_dict
from floatplan.problem.problem import Problem
from floatplan.robot.chosen import chosen_robot
from floatplan.robot.robot import Coupling, Robot
from floatplan.robot.urdf.tree import is_address
from floatplan.tables import FLIGHT_EVENTS

SOURCE = "command line"
NUMBERS: dict[str, Callable[[str], Any]] = {"angular_momentum": float, "degree": int}  # or words


def robot_choices(choices: RobotOptions, degrees: bool) -> dict[str, Any]:
    """Return the keyword arguments of ``Robot.from_urdf`` that the options stand for; InputError where one is wrong."""
    settings: dict[str, Any] = dict(choices)
    if "coupled" in settings and settings["coupled"].strip() != "mirror":
        pairs = _pairs("--coupled", settings["coupled"], "FOLLOWER=LEADER")
        settings["coupled"] = {name: _leader(name, leader) for name, leader in pairs}
    if "locked" in settings:
        pairs = _pairs("--locked", settings["locked"], "JOINT=ANGLE")
        settings["locked"] = {joint: _number("--locked", value) for joint, value in pairs}
        settings["angles"] = "deg" if degrees else "rad"
    return settings


def _chosen_robot(source: str, choices: RobotOptions, degrees: bool) -> Robot:
    """Load the robot; InputError where an option is wrong."""
    settings = {"joints": None, **dict.fromkeys(ROBOT_OPTIONS), **robot_choices(choices, degrees)}
    return chosen_robot(source, settings, SOURCE, "--")


def posture(option: str, text: str | None, degrees: bool) -> dict[str, float] | None:
    """Return positions of joints, rad, as typed, ``joint=angle,..``; InputError where one is wrong."""
    if text is None:
        return None
    positions = {joint: _number(f"{option} {joint}", value) for joint, value in _pairs(option, text, "JOINT=ANGLE")}
    for joint, position in positions.items():
        if not math.isfinite(position):
            raise _wrong(option, f"{joint} = {position} is not a finite angle", "give one in its range")
    return {joint: math.radians(position) for joint, position in positions.items()} if degrees else positions


def contacts(option: str, text: str | None) -> list[tuple[str, ...]] | None:
    """Return phases of contact as typed, ``a,b;a``; InputError where one of them names nothing."""
    if text is None:
        return None
    phases = []
    for phase in text.split(";"):
        names = filter(None, map(str.strip, phase.split(",")))
        phases.append(tuple(names))
    if not all(phases):
        raise _wrong(
            option, f"{text!r} has a phase without a frame", "give frames by commas, phases by semicolons: a,b;a"
        )
    return phases


def _refuse_robot_options(choices: RobotOptions) -> None:
    """Raise InputError if there are any: a problem file says itself how its robot is read."""
    for name in choices:
        advice = f"set {ROBOT_OPTIONS[name].key} in the file"
        raise _wrong(typed_option(name), "a problem file says itself how its robot is read", advice)


def _wrong(option: str, reason: str, advice: str | None = None) -> InputError:
    return InputError(reason, source=SOURCE, element=option, advice=advice)


def _leader(follower: str, text: str) -> str | Coupling:
    """``leader``, ``-leader``, ``0.5*leader``."""
    ratio, star, leader = text.partition("*")
    if not star:
        return text
    try:
        return Coupling(leader.strip(), _number("--coupled", ratio))
    except InputError as error:
        raise error if error.source else error.within(SOURCE, f"--coupled {follower}") from None


def _pairs(option: str, text: str, form: str) -> list[tuple[str, str]]:
    """``a=b,c=d`` as pairs; InputError where one is not, or a name comes twice."""
    pairs = [tuple(map(str.strip, pair.split("=", 1))) for pair in text.split(",") if pair.strip()]
    if not pairs or any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise _wrong(option, f"{text!r} is not {form},..", f"give {form}")
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise _wrong(option, f"{name!r} is given twice", "keep one of them")
    return [(name, value) for name, value in pairs]


def _tables(options: Options, degrees: bool, joints: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the tables of a problem file that the options fill, in radians.

    Raises
    ------
    InputError
        A list holds what is no number, or start or goal have not one number for each joint and the orientation.
    """
    tables: dict[str, dict[str, Any]] = {"start": {}, "goal": {}, "flight": {}, "motion": {}}
    for name, value in options.items():
        option, (table, *inner) = f"--{name.replace('_', '-')}", OPTIONS[name].key.split(".")
        if not inner:
            numbers = _numbers(option, value, degrees)
            if len(numbers) != 1 + len(joints):
                count = "1 number" if len(numbers) == 1 else f"{len(numbers)} numbers"
                counts = f"{count} where {1 + len(joints)} are needed"
                raise _wrong(option, counts, f"give orientation, {', '.join(joints)}")
            tables[table] |= {"orientation": numbers[0], "positions": numbers[1:]}
        elif table in FLIGHT_EVENTS:
            word = FLIGHT_EVENTS[table] if inner == ["velocities"] else "free"
            tables[table][inner[0]] = word if value.strip() == word else _one_or_many(_numbers(option, value, degrees))
        else:
            read = _numbers_or_word(value, NUMBERS[name]) if name in NUMBERS else value
            tables[table][inner[0]] = {inner[1]: read} if inner[1:] else read
    return tables


def _numbers(option: str, text: str, degrees: bool) -> list[float]:
    numbers = [_number(option, number) for number in _parts(text)]
    return list(map(math.radians, numbers)) if degrees else numbers


def gain(option: str, text: str | None) -> float | dict[str, float] | None:
    """Return a gain as typed: one number for all joints, or ``joint=number,..``; InputError where it is neither."""
    if text is None:
        return None
    if "=" not in text:
        return _number(option, text)
    return {joint: _number(f"{option} {joint}", value) for joint, value in _pairs(option, text, "JOINT=GAIN")}


def is_robot(source: str) -> bool:
    """Whether the argument names a robot; a problem file otherwise."""
    return is_address(source) or Path(source).suffix.lower() in (".urdf", ".xacro", ".xml")


def named_robot(source: str, choices: RobotOptions, degrees: bool) -> Robot:
    """Load the robot that is named, or the one of the problem file that is named, which may hold no more than that."""
    if is_robot(source):
        return _chosen_robot(source, choices, degrees)
    _refuse_robot_options(choices)
    return load_robot(source)


def requested_problem(source: str, options: Options, choices: RobotOptions, degrees: bool) -> Problem:
    """Build the problem that the command line asks for.

    Raises
    ------
    InputError
        A file or an option is wrong.
    """
    if is_robot(source):
        robot = _chosen_robot(source, choices, degrees)
        filled = _tables(options, degrees, robot.joints)
        tables = {name: table for name, table in filled.items() if table or name == "flight"}
        return _from_tables({"name": robot.name, **tables}, robot, options, degrees, SOURCE)
    _refuse_robot_options(choices)
    problem = load_problem(source)
    if not options:
        return problem
    content = problem_to_dict(problem)
    if problem.flight.landing is None:
        del content["flight"]["landing"]
    elif problem.flight.landing.height is None:
        del content["flight"]["landing"]["height"]
    merged = _merged(content, _tables(options, degrees, problem.robot.joints))
    return _from_tables(merged, problem.robot, options, degrees, f"{source} with options")


def _as_typed(error: InputError, options: Options, source: str) -> InputError:
    """The same error, about the option that a key of a problem file stands for in what was typed, or unchanged."""
    if isinstance(error, ProblemError):
        return ProblemError([_as_typed(single, options, source) for single in error.errors])
    key_path = error.element or ""
    for option, row in sorted(OPTIONS.items(), key=lambda item: -len(item[1].key)):
        key = row.key
        beyond = key_path.removeprefix(key).removeprefix(".")
        if key_path.startswith(key) and (source == SOURCE or option in options):
            element = ": ".join(filter(None, (f"--{option.replace('_', '-')}", beyond)))
            return _wrong(element, error.reason, error.advice)
    return error


def _from_tables(content: Mapping[str, Any], robot: Robot, options: Options, degrees: bool, source: str) -> Problem:
    try:
        return problem_from_dict(content, robot, source)
    except InputError as original:
        error = _as_typed(original, options, source)
        postures = " ".join(options.get(end, "") for end in ("start", "goal"))
        # [rad] three full turns: who requests more has probably forgotten --degrees
        if degrees or not any(abs(float(number)) > 20.0 for number in _parts(postures)):
            raise error from None
        hint = _wrong("--radians", "angles are in radians here", "give --degrees if they are not")
        raise ProblemError([error, hint]) from None


def _parts(text: str) -> list[str]:
    return [item for item in re.split(r"[,\s]+", text.strip()) if item]


def _number(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise _wrong(option, f"{text!r} is not a number") from None


def _numbers_or_word(text: str, kind: Callable[[str], Any]) -> Any:
    try:
        return _one_or_many(list(map(kind, _parts(text))))
    except ValueError:
        return text


def _one_or_many(numbers: list[Any]) -> Any:
    """One number is for all joints."""
    return numbers[0] if len(numbers) == 1 else numbers


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of ``over`` laid over those of ``base``, key by key."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        merged[key] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged
