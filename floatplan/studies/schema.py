"""The tables of a study file as pydantic models, and the numbers of a problem file that a study can vary."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

from pydantic import Field, Tag, model_validator

from floatplan.errors import InputError
from floatplan.planning.search import MOST_SOLVED
from floatplan.problem.keys import Key, Keyed
from floatplan.problem.parts import OBSTACLE_KINDS, Flight, Limits, Motion, Posture, SelfClearance
from floatplan.problem.schema import DIALECT, Number, Table, Whole, any_of
from floatplan.tables import RANGES, Range

SAMPLING_KEYS = ("sampling", "samples", "seed")


class RangeTable(Table):
    """From one value to another: ``{ from = 1.0, to = 6.0, count = 200 }``."""

    low: Number = Field(alias="from", description="least value, in the problem file's unit")
    high: Number = Field(alias="to", description="largest value")
    count: Annotated[Whole, Field(ge=1)] | None = Field(
        default=None, description="values of a grid, both ends among them"
    )


Varied: TypeAlias = Annotated[
    Annotated[RangeTable, Tag("<table>")] | Annotated[list[Number], Tag("<list>")],
    any_of("a table with from, to, count, or a list of numbers"),
]


class PlanTable(Table):
    """How hard to try."""

    starts: Annotated[Whole, Field(ge=1, le=MOST_SOLVED)] = Field(
        default=1, description="solved starts to choose the best from"
    )
    prove: Annotated[bool, Field(strict=True)] = Field(default=False, description="prove each plan")
    search: Annotated[bool, Field(strict=True)] = Field(
        default=False, description="search longer, up to 10 s, for rows that are not solved soon"
    )


class ResultTable(Table):
    """Where results go, and which map is drawn."""

    folder: Annotated[str, Field(min_length=1)] | None = Field(
        default=None, description="from the working directory; runs/<name of this file> if left out"
    )
    map: tuple[str, str, str] | None = Field(
        default=None, description="keys that vary across and up, and a column as colour"
    )


class StudyFileTable(Table):
    """A problem, and the values for which it is planned; how rows are drawn may stand in ``[vary]`` too."""

    problem: str = Field(description="a problem file, relative to this one")
    vary: dict[str, Varied] = Field(description="numbers of the problem file by their paths")
    sampling: Literal["grid", "random", "sobol"] = Field(
        default="grid", description="all combinations, or points drawn"
    )
    samples: Annotated[Whole, Field(ge=1)] | None = Field(default=None, description="rows to draw")
    seed: Annotated[Whole, Field(ge=0)] = Field(default=0, description="of the rows drawn, and of random starts")
    plan: PlanTable = Field(default_factory=PlanTable)
    result: ResultTable = Field(default_factory=ResultTable)

    @model_validator(mode="before")
    @classmethod
    def _lift(cls, content: Any) -> Any:
        """Take what is about sampling out of ``[vary]``: no number of a problem file is called that."""
        vary = content.get("vary") if isinstance(content, dict) else None
        if not isinstance(vary, dict):
            return content
        lifted = {key: vary[key] for key in SAMPLING_KEYS if key in vary and key not in content}
        return {**content, **lifted, "vary": {key: value for key, value in vary.items() if key not in lifted}}


_JOINT, _INDEX, _AXIS = r"\.[^.]+", r"\.\d+", r"\.[01]"
_PARTS = (
    *((r"(?:start|goal)", Posture), ("flight", Flight), ("motion", Motion), ("limits", Limits)),
    *((rf"obstacles{_INDEX}", kind) for kind in OBSTACLE_KINDS.values()),
    (rf"self_clearance{_INDEX}", SelfClearance),
)
DEGREE = Range(0, 100, "")  # the problem itself refuses what it cannot have


@dataclass(frozen=True)
class VariedNumber:
    """A number of a problem file.

    Attributes
    ----------
    unit : in the file
    factor : from the file's unit to SI and radians
    whole : whether it is an integer
    allowed : in SI units and radians
    """

    unit: str
    factor: float
    whole: bool
    allowed: Range

    def check(self, value: float, element: str) -> None:
        """Refuse a number, in the file's unit, out of its range, or not whole where it must be."""
        if self.whole and value != math.floor(value):
            raise InputError(f"{value:g} is not a whole number", element=element)
        low, high = self.allowed.low / self.factor, self.allowed.high / self.factor
        if not low <= value <= high:
            raise InputError(f"{value:g} is outside {Range(low, high, self.unit)}", element=element)


def varied_number(path: str, degrees: bool) -> VariedNumber:
    """Return what a path of a problem file names; ``degrees`` is the file's unit of angles.

    Raises
    ------
    InputError
        It is no number that can be varied.
    """
    for pattern, (unit, allowed, whole) in _numbers().items():
        if re.fullmatch(pattern, path, flags=re.ASCII):
            in_radians, _, in_degrees = unit.partition(" or ")
            turned = degrees and in_degrees
            return VariedNumber(
                in_degrees if turned else in_radians, math.radians(1.0) if turned else 1.0, whole, allowed
            )
    raise InputError(
        "is no number of a problem file that can be varied",
        element=path,
        advice='give a path such as "flight.duration", "goal.positions.q1" or "obstacles.0.center.0"',
    )


@cache
def _numbers() -> Mapping[str, tuple[str, Range, bool]]:
    """Unit, range, and whether it is whole, of every number of a problem file, by the pattern of its paths."""
    found: dict[str, tuple[str, Range, bool]] = {}
    for head, part in _PARTS:
        for pattern, key, name, whole in _below(head, part, Key(""), ""):
            found[pattern] = key.unit, DEGREE if whole else RANGES[name], whole
    return found


def _below(path: str, hint: Any, key: Key, name: str) -> Iterator[tuple[str, Key, str, bool]]:
    """Paths of the numbers in what has a type, each with its key, the name of its range, and whether it is whole."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in (float, int):
        yield path, key, name, hint is int
    elif isinstance(hint, type) and issubclass(hint, Keyed):
        hints = get_type_hints(hint)
        for field, each in hint.keys.items():
            yield from _below(rf"{path}\.{field}", hints[field], each, each.numbers or field)
    elif origin in (Union, UnionType):
        for kind in inner:
            yield from _below(path, kind, key, name)
    elif origin is tuple:
        yield from _below(path + _AXIS, inner[0], key, name if name in RANGES else "place")
    elif origin in (Mapping, Sequence):
        pair = get_origin(inner[-1]) is Sequence
        entry = get_args(inner[-1])[0] if pair else inner[-1]
        yield from _below(path + _JOINT + (_AXIS if pair else ""), entry, key, name)


def study_schema() -> dict[str, Any]:
    """Return the JSON Schema of study files, for editors."""
    schema = StudyFileTable.model_json_schema()
    properties = schema["properties"]
    vary = properties["vary"]
    vary["properties"] = {key: properties[key] for key in SAMPLING_KEYS}
    vary["propertyNames"] = {"pattern": rf"^(?:{'|'.join((*SAMPLING_KEYS, *_numbers()))})$"}
    for table in (schema, *schema["$defs"].values()):
        table.pop("title", None)
        for described in table["properties"].values():
            described.pop("title", None)
    return {"$schema": DIALECT, **schema, "title": "floatplan study"}
