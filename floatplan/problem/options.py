"""A problem from the command line: a robot with options, or a problem file that options override."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from floatplan.errors import InputError, ProblemError
from floatplan.problem.file import DATA_PREFIX, load_problem, load_robot, problem_from_dict, problem_to_dict
from floatplan.problem.problem import Problem
from floatplan.robot.asked import robot_as_asked
from floatplan.robot.robot import Coupling, Robot

PLACE = "command line"
OPTIONS = {  # of floatplan plan, by the keys of a problem file that they stand for
    "start.velocities": "start_velocities",
    "start.accelerations": "start_accelerations",
    "start": "start",
    "goal.velocities": "goal_velocities",
    "goal.accelerations": "goal_accelerations",
    "goal": "goal",
    "flight.takeoff.frame": "takeoff",
    "flight.landing.frame": "landing",
    **{f"flight.{name}": name for name in ("duration", "angular_momentum", "horizontal_velocity")},
    **{f"motion.{name}": name for name in ("degree", "objective")},
}
SURELY_DEGREES = 20.0  # [rad] three full turns: who asks for more has probably forgotten --degrees


@dataclass(frozen=True)
class RobotChoices:
    """The options that say how a URDF is to be read, as typed; None where left out.

    Attributes
    ----------
    plane : "xz"
    coupled : "mirror", or ``follower=leader`` with commas between; a leader may have a minus or a ratio, ``0.5*leader``
    locked : ``joint=angle`` with commas between
    reference : the name of a posture
    degrees : whether angles are in degrees
    """

    plane: str | None = None
    coupled: str | None = None
    locked: str | None = None
    reference: str | None = None
    degrees: bool = False

    def load(self, source: str) -> Robot:
        """Load the robot; InputError where an option is wrong."""
        coupled: Mapping[str, str | Coupling] | Literal["mirror"] | None = None
        if self.coupled is not None:
            coupled = "mirror" if self.coupled.strip() == "mirror" else self._couplings(self.coupled)
        choices = {
            "plane": self.plane,
            "joints": None,
            "coupled": coupled,
            "locked": None if self.locked is None else self._locked(self.locked),
            "reference": self.reference,
        }
        return robot_as_asked(source, choices, PLACE, "--")

    def _couplings(self, text: str) -> dict[str, str | Coupling]:
        return {name: _leader(name, leader) for name, leader in _pairs("--coupled", text, "FOLLOWER=LEADER")}

    def _locked(self, text: str) -> dict[str, float]:
        pairs = {joint: _number("--locked", value) for joint, value in _pairs("--locked", text, "JOINT=ANGLE")}
        return {joint: math.radians(value) if self.degrees else value for joint, value in pairs.items()}

    def refuse_beside_a_file(self) -> None:
        """Raise InputError if one of them is given: a problem file says itself how its robot is read."""
        for name in ("plane", "coupled", "locked", "reference"):
            if getattr(self, name) is not None:
                raise InputError(
                    "a problem file says itself how its robot is read",
                    source=PLACE,
                    element=f"--{name}",
                    advice=f"set robot.{name} in the file",
                )


def _leader(follower: str, text: str) -> str | Coupling:
    """``leader``, ``-leader``, ``0.5*leader``."""
    ratio, star, leader = text.partition("*")
    if not star:
        return text
    try:
        return Coupling(leader.strip(), _number("--coupled", ratio))
    except InputError as error:
        raise error if error.source else error.within(PLACE, f"--coupled {follower}") from None


def _pairs(option: str, text: str, form: str) -> list[tuple[str, str]]:
    """``a=b,c=d`` as pairs; InputError where one is not, or a name comes twice."""
    pairs = [tuple(map(str.strip, part.split("=", 1))) for part in text.split(",") if part.strip()]
    if not pairs or any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise InputError(f"{text!r} is not {form},..", source=PLACE, element=option, advice=f"give {form}")
    names = [pair[0] for pair in pairs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{twice!r} is given twice", source=PLACE, element=option, advice="keep one of them")
    return [(name, value) for name, value in pairs]


@dataclass(frozen=True)
class Options:
    """The options of ``floatplan plan`` that say what is asked, as typed; None where left out."""

    degrees: bool = False
    start: str | None = None
    goal: str | None = None
    start_velocities: str | None = None
    goal_velocities: str | None = None
    start_accelerations: str | None = None
    goal_accelerations: str | None = None
    duration: float | None = None
    angular_momentum: str | None = None
    takeoff: str | None = None
    landing: str | None = None
    horizontal_velocity: float | None = None
    degree: str | None = None
    objective: str | None = None
    plane: str | None = None
    coupled: str | None = None
    locked: str | None = None
    reference: str | None = None

    @property
    def choices(self) -> RobotChoices:
        """How a URDF is to be read."""
        return RobotChoices(self.plane, self.coupled, self.locked, self.reference, self.degrees)

    def tables(self, joints: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Return the tables of a problem file that the options fill, in radians.

        Raises
        ------
        InputError
            A list holds what is no number, or start or goal have not one number for each joint and the orientation.
        """
        return {
            "start": _given(
                **self._posture("--start", self.start, joints),
                velocities=self._angles("--start-velocities", self.start_velocities, "takeoff"),
                accelerations=self._angles("--start-accelerations", self.start_accelerations, "free"),
            ),
            "goal": _given(
                **self._posture("--goal", self.goal, joints),
                velocities=self._angles("--goal-velocities", self.goal_velocities, "landing"),
                accelerations=self._angles("--goal-accelerations", self.goal_accelerations, "free"),
            ),
            "flight": _given(
                duration=self.duration,
                angular_momentum=_number_or_word(self.angular_momentum),
                takeoff=None if self.takeoff is None else {"frame": self.takeoff},
                landing=None if self.landing is None else {"frame": self.landing},
                horizontal_velocity=self.horizontal_velocity,
            ),
            "motion": _given(degree=_degree(self.degree), objective=self.objective),
        }

    def _posture(self, option: str, text: str | None, joints: Sequence[str]) -> dict[str, Any]:
        if text is None:
            return {}
        numbers = self._numbers(option, text)
        if len(numbers) != 1 + len(joints):
            raise InputError(
                f"{_count(numbers)} where {1 + len(joints)} are wanted",
                source=PLACE,
                element=option,
                advice=f"give orientation, {', '.join(joints)}",
            )
        return {"orientation": numbers[0], "positions": numbers[1:]}

    def _angles(self, option: str, text: str | None, word: str) -> float | list[float] | str | None:
        """One number is for all joints; or the word."""
        if text is None or text.strip() == word:
            return text and word
        numbers = self._numbers(option, text)
        return numbers[0] if len(numbers) == 1 else numbers

    def _numbers(self, option: str, text: str) -> list[float]:
        numbers = [_number(option, part) for part in _parts(text)]
        return [math.radians(number) for number in numbers] if self.degrees else numbers


def is_robot(source: str) -> bool:
    """Whether the argument names a robot; a problem file otherwise."""
    return source.startswith(DATA_PREFIX) or Path(source).suffix.lower() in (".urdf", ".xml")


def named_robot(source: str, choices: RobotChoices) -> Robot:
    """Load the robot that is named, or the one of the problem file that is named, which may hold no more than that."""
    if is_robot(source):
        return choices.load(source)
    choices.refuse_beside_a_file()
    return load_robot(source)


def asked_problem(source: str, options: Options) -> Problem:
    """Build the problem that the command line asks for.

    Raises
    ------
    InputError
        A file or an option is wrong.
    """
    if is_robot(source):
        robot = options.choices.load(source)
        tables = {name: table for name, table in options.tables(robot.joints).items() if table or name == "flight"}
        return _from_tables({"name": robot.name, **tables}, robot, options, PLACE)
    options.choices.refuse_beside_a_file()
    problem = load_problem(source)
    if options == Options(degrees=options.degrees):
        return problem
    content = problem_to_dict(problem)
    if problem.flight.landing is None:
        del content["flight"]["landing"]
    elif problem.flight.landing.height is None:
        del content["flight"]["landing"]["height"]
    merged = _merged(content, options.tables(problem.robot.joints))
    return _from_tables(merged, problem.robot, options, f"{source} with options")


def _as_typed(error: InputError, options: Options, place: str) -> InputError:
    """The same error, about the option that a key of a problem file stands for where it was given, or nothing else."""
    if isinstance(error, ProblemError):
        return ProblemError([_as_typed(each, options, place) for each in error.errors])
    place_in_file = error.element or ""
    for key, option in OPTIONS.items():
        beyond = place_in_file.removeprefix(key).removeprefix(".")
        if place_in_file.startswith(key) and (place == PLACE or getattr(options, option) is not None):
            element = ": ".join(filter(None, (f"--{option.replace('_', '-')}", beyond)))
            return InputError(error.reason, source=PLACE, element=element, advice=error.advice)
    return error


def _from_tables(content: Mapping[str, Any], robot: Robot, options: Options, place: str) -> Problem:
    try:
        return problem_from_dict(content, robot, place)
    except InputError as found:
        error = _as_typed(found, options, place)
        if options.degrees or not _surely_degrees(options):
            raise error from None
        hint = InputError(
            "angles are in radians here", source=PLACE, element="--radians", advice="give --degrees if they are not"
        )
        raise ProblemError([error, hint]) from None


def _surely_degrees(options: Options) -> bool:
    texts = [text for text in (options.start, options.goal) if text is not None]
    return any(abs(float(part)) > SURELY_DEGREES for text in texts for part in _parts(text))


def _parts(text: str) -> list[str]:
    return [part for part in re.split(r"[,\s]+", text.strip()) if part]


def _number(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{text!r} is not a number", source=PLACE, element=option) from None


def _count(numbers: Sequence[float]) -> str:
    return "1 number" if len(numbers) == 1 else f"{len(numbers)} numbers"


def _number_or_word(text: str | None) -> float | str | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return text


def _degree(text: str | None) -> int | list[int] | str | None:
    if text is None:
        return None
    parts = _parts(text)
    try:
        degrees = [int(part) for part in parts]
    except ValueError:
        return text
    return degrees[0] if len(degrees) == 1 else degrees


def _given(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of ``over`` laid over those of ``base``, key by key."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        merged[key] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged
