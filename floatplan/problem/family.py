"""Families of problems: arrays over one base problem, by the paths of a problem file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, overload

import numpy as np
import numpy.typing as npt

from floatplan.arguments import Check, Checked, Outlined, by_name, made, numbers
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.keys import in_files
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import finite_limits, motor_limits, of_motors
from floatplan.tables import JOINT_LIMITS, LIMIT_TABLE, LimitRow

MOST_PROBLEMS = 10_000_000  # [-] of a family, which are arrays in memory
BY_MOTOR: Mapping[str, LimitRow] = {row.key: row for row in (*JOINT_LIMITS, LIMIT_TABLE["torque"])}


def _column(values: npt.ArrayLike, element: str) -> npt.NDArray[Any]:
    array = numbers(values, element.removeprefix("varied.")).copy()
    if array.ndim != 1:
        raise InputError("must be an array (N,) of numbers", element=element.removeprefix("varied."))
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Family(Checked, Outlined, Sequence[Problem]):
    """N problems that differ from a base problem in a few numbers.

    ``family[i]`` is the i-th :class:`~floatplan.Problem`, made and checked on access; ``family[i:j]`` is a family.

    Parameters
    ----------
    base : Problem
    varied : mapping
        Paths of a problem file, such as ``"flight.duration"``, ``"goal.positions.q1"``, ``"obstacles.0.center.0"`` or
        ``"limits.torque.q2"``, each with its N values, in the unit of the base: rad in Python. The values of one index
        belong to one another: there is no outer product.

    Raises
    ------
    InputError
        A path leads to nothing that a problem has, or the arrays are not of one length N.
    """

    base: Problem
    varied: Mapping[str, npt.ArrayLike]
    checks: ClassVar[Mapping[str, Check]] = {"base": made(Problem), "varied": by_name(_column)}

    def __post_init__(self) -> None:
        """Check paths and shapes; numbers are checked row by row."""
        super().__post_init__()
        if not self.varied:
            raise InputError("varies nothing", element="Family", advice='give a path such as "flight.duration"')
        arrays = self.arrays
        for path in arrays:
            _with_values(self.base, {path: 0.0})
        lengths = set(map(len, arrays.values()))
        if len(lengths) > 1:
            listed = ", ".join(f"{path} has {len(array)}" for path, array in arrays.items())
            raise InputError(f"the arrays differ in length: {listed}", element="Family")
        if max(lengths) > MOST_PROBLEMS:
            raise InputError(f"{max(lengths)} problems, more than {MOST_PROBLEMS}", element="Family")

    def __len__(self) -> int:
        return len(next(iter(self.arrays.values())))

    @property
    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The values (N,) by their paths."""
        varied: Any = self.varied
        return dict(varied)

    @overload
    def __getitem__(self, index: int) -> Problem: ...
    @overload
    def __getitem__(self, index: slice) -> Family: ...
    def __getitem__(self, index: int | slice) -> Problem | Family:
        if isinstance(index, slice):
            return Family(self.base, {path: array[index] for path, array in self.arrays.items()})
        values = {path: array[index].item() for path, array in self.arrays.items()}
        return self.base.with_parts(**_with_values(self.base, values))


@lru_cache(maxsize=4096)
def obstacles_with(base: Problem, values: tuple[tuple[str, float], ...]) -> tuple[Obstacle, ...]:
    """Return a problem's obstacles with numbers set by their paths; InputError where one is wrong.

    Rows that were planned are measured next.
    """
    obstacles: tuple[Obstacle, ...] = _with_values(base, dict(values))["obstacles"]
    for obstacle in obstacles:
        obstacle.check("obstacles")
    return obstacles


def motor_limits_with(base: Problem, row: LimitRow, varied: Mapping[str, Array]) -> Array | None:
    """Return limits (N, m) of motors with numbers (N,) set by their paths, not checked; infinite where there is none.

    None where what is varied is not written motor by motor.
    """
    whole = f"limits.{row.key}"
    count = len(next(iter(varied.values())))
    if whole in varied:
        return np.tile(varied[whole][:, None], len(base.robot.motors)) if len(varied) == 1 else None
    limits = _spelt_out(base, f"{whole}.", row.key, getattr(base.limits, row.key))
    if not isinstance(limits, Mapping):
        return None
    values = {**limits, **{path.removeprefix(f"{whole}."): values for path, values in varied.items()}}
    named = of_motors(base.robot, dict(zip(values, values, strict=True)), whole, None)
    columns = [np.broadcast_to(np.inf if name is None else values[name], count) for name in named]
    return np.stack(columns, axis=1)


def _with_values(base: Problem, values: Mapping[str, float]) -> dict[str, Any]:
    """Fields of a problem with numbers set by their paths; not checked."""
    changes: dict[str, Any] = {}
    for path, value in values.items():
        head, *inner_path = path.split(".")
        tables = ("start", "goal", "flight", "motion", "limits", "obstacles", "self_clearance", "jump")
        if head not in tables or not inner_path:
            raise InputError("is no number of a problem file that can be varied", element=path)
        name = "self_clearances" if head == "self_clearance" else head
        current = changes.get(name, getattr(base, name))
        changes[name] = _set(_spelt_out(base, head, "", current), inner_path, value, base, path)
    return changes


def _set(current: Any, parts: Sequence[str], value: float, base: Problem, path: str) -> Any:
    """``current`` with the number at the end of a path set."""
    if not parts:
        return value
    key, *remaining = parts
    if isinstance(current, Mapping):
        if key not in (*current, *base.robot.joints, *base.robot.motors):
            joints = dict.fromkeys((*base.robot.joints, *base.robot.motors))
            raise InputError(f"no joint {key!r}", element=path, advice=f"joints: {', '.join(joints)}")
        if key not in current and remaining:
            raise InputError(f"the base problem gives {key!r} nothing that could be varied", element=path)
        return {**current, key: _set(current.get(key), remaining, value, base, path)}
    if isinstance(current, Checked):
        named = (name for name in current.checks if in_files(name) == key)
        field = key if key in current.checks else next(named, None)
        if field is None:
            raise InputError(f"there is no {key!r}", element=path)
        inner = _spelt_out(base, path, key, getattr(current, field))
        return current.changed(**{field: _set(inner, remaining, value, base, path)})
    if isinstance(current, tuple | list):
        names = base.robot.joints
        index = names.index(key) if key in names and len(names) == len(current) else _index(key, len(current), path)
        changed = list(current)
        changed[index] = _set(changed[index], remaining, value, base, path)
        return tuple(changed)
    raise InputError("is no number of a problem file that can be varied", element=path)


def _index(key: str, length: int, path: str) -> int:
    if not (key.isascii() and key.isdecimal() and int(key) < length):
        raise InputError(f"{key!r} is not one of 0 to {length - 1}" if length else "there is none", element=path)
    return int(key)


def _spelt_out(base: Problem, path: str, key: str, value: Any) -> Any:
    """What a path may lead into, where the base has a word, one number for all, or nothing for it."""
    head = path.split(".")[0]
    robot = base.robot
    if head in ("start", "goal") and key in ("positions", "velocities", "accelerations") and not isinstance(value, str):
        if isinstance(value, Mapping):
            return value
        return dict(zip(robot.joints, np.broadcast_to(value, len(robot.joints)).tolist(), strict=True))
    if head == "jump" and not key:
        return value or JumpRequest()
    if value == "standing":
        return {}
    if head == "flight" and key in ("takeoff", "landing"):
        return value or getattr(base, key)
    if head == "limits" and key == "position" and path.count(".") > 1:
        if isinstance(value, str):
            return dict(zip(robot.joints, map(tuple, base.position_limits.tolist()), strict=True))
        return value if isinstance(value, Mapping) else tuple(map(tuple, value))
    if head == "limits" and key in BY_MOTOR and path.count(".") > 1:
        if isinstance(value, str | int | float):
            return finite_limits(robot.motors, motor_limits(robot, BY_MOTOR[key], value))
        return value if isinstance(value, Mapping) else tuple(value)
    return value
