"""The tables of a study file, and the numbers of a problem file that a study can vary."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin

from floatplan.arguments import attributes, without
from floatplan.errors import InputError
from floatplan.keys import Keyed, entry_of, in_files, json_schema
from floatplan.planning.many import UNSOLVED
from floatplan.planning.options import ATTEMPTS
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import OBSTACLE_KINDS, Flight, Limits, Motion, Posture, SelfClearance
from floatplan.problem.spatial_obstacles import SPATIAL_OBSTACLE_KINDS
from floatplan.tables import KEY_TABLE, RANGES, Key, Range

SAMPLING_KEYS = ("sampling", "samples", "seed")
VALUES = Range(-math.inf, math.inf, "")  # the number that varies has a range of its own
Kind: TypeAlias = Literal["grid", "random", "sobol"]


@dataclass(frozen=True)
class RangeTable(Keyed):
    """From one value to another: ``{ from = 1.0, to = 6.0, count = 200 }``."""

    from_: Annotated[float, Key("Least value, in the problem file's unit", numbers=VALUES)]
    to: Annotated[float, Key("Largest value", numbers=VALUES)]
    count: Annotated[int | None, Key("Values of a grid, both ends among them")] = None


@dataclass(frozen=True)
class PlanTable(Keyed):
    """How hard to try."""

    starts: Annotated[int, Key("Solved starts to choose the best from; of jumps, starts at most")] = 1
    prove: Annotated[bool, Key("Whether to prove each plan")] = False
    attempts: Annotated[
        int, Key("Unsolved starts at a degree, after which a row is abandoned", numbers=Range(1, ATTEMPTS, ""))
    ] = UNSOLVED
    search: Annotated[bool, Key("Whether to search longer, up to 10 s, for rows that are not solved soon")] = False
    jump: Annotated[bool, Key("Whether rows are whole jumps, instead of only their flights")] = False

    @property
    def effort(self) -> dict[str, Any]:
        """Options of :func:`floatplan.plan_many`."""
        return attributes(self, ("starts", "prove", "attempts", "search"))


@dataclass(frozen=True)
class ResultTable(Keyed):
    """Where results go, and which map to draw."""

    folder: Annotated[str | None, KEY_TABLE["result.folder"]] = None
    map: Annotated[tuple[str, str, str] | None, Key("Keys that vary across and up, and a column as colour")] = None


@dataclass(frozen=True)
class StudyTables(Keyed):
    """A problem, and the values for which it is planned; how rows are sampled may stand in ``[vary]`` too."""

    problem: Annotated[str, Key("A problem file, relative to this one")]
    vary: Annotated[
        Mapping[str, RangeTable | Sequence[float]], Key("Numbers of the problem file by their paths", numbers=VALUES)
    ]
    sampling: Annotated[Kind, Key("All combinations, or sampled points")] = "grid"
    samples: Annotated[int | None, Key("Rows to draw", numbers="count")] = None
    seed: Annotated[int, Key("Of the sampled rows, and of random starts")] = 0
    plan: Annotated[PlanTable, Key("How hard to try")] = field(default_factory=PlanTable)
    result: Annotated[ResultTable, Key("Where results go, and which map is plotted")] = field(
        default_factory=ResultTable
    )


def with_sampling(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a study's tables with the keys of sampling out of ``[vary]``: no number has such a name."""
    vary = content.get("vary")
    if not isinstance(vary, Mapping):
        return content
    lifted = {}
    for key in SAMPLING_KEYS:
        if key in vary and key not in content:
            lifted[key] = vary[key]
    numbers = without(vary, lifted)
    return {**content, **lifted, "vary": numbers}


INDEX = r"\.\d+"  # in patterns of paths


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
        low = self.allowed.low / self.factor
        high = self.allowed.high / self.factor
        if not low <= value <= high:
            raise InputError(f"{value:g} is outside {Range(low, high, self.unit)}", element=element)


def varied_number(path: str, degrees: bool) -> VariedNumber:
    """Return the number at a path of a problem file; ``degrees`` is the file's unit of angles.

    Raises
    ------
    InputError
        It is no number that can be varied.
    """
    for pattern, (unit, allowed, whole) in _numbers().items():
        if re.fullmatch(pattern, path, flags=re.ASCII):
            in_radians, _, in_degrees = unit.partition(" or ")
            if degrees and in_degrees:
                return VariedNumber(in_degrees, math.radians(1.0), whole, allowed)
            return VariedNumber(in_radians, 1.0, whole, allowed)
    raise InputError(
        "is no number of a problem file that can be varied",
        element=path,
        advice='give a path such as "flight.duration", "goal.positions.q1" or "obstacles.0.center.0"',
    )


@cache
def _numbers() -> Mapping[str, tuple[str, Range, bool]]:
    """Unit, range, and whether it is whole, of every number of a problem file, by the pattern of its paths."""
    numbers: dict[str, tuple[str, Range, bool]] = {}
    for head, table in (  # of a problem file, by the patterns of their paths
        ("(?:start|goal)", Posture),
        ("flight", Flight),
        ("motion", Motion),
        ("limits", Limits),
        ("jump", JumpRequest),
        *((rf"obstacles{INDEX}", kind) for kind in (*OBSTACLE_KINDS.values(), *SPATIAL_OBSTACLE_KINDS.values())),
        (rf"self_clearance{INDEX}", SelfClearance),
    ):
        for pattern, key, name, whole in _below(head, table, Key(""), ""):
            numbers[pattern] = key.unit, _range(name, whole), whole
    return numbers


def _range(name: str | Range, whole: bool) -> Range:
    if whole:
        return Range(0, 100, "")  # the problem itself has narrower ones
    return name if isinstance(name, Range) else RANGES[name]


def _below(path: str, hint: Any, key: Key, name: str | Range) -> Iterator[tuple[str, Key, str | Range, bool]]:
    """Paths of the numbers in what has a type, each with its key, its range or that's name, and whether it is whole."""
    origin = get_origin(hint)
    inner = get_args(hint)
    if hint in (float, int):
        yield path, key, name, hint is int
    elif isinstance(hint, type) and issubclass(hint, Keyed):
        for name, inner_key in hint.keys.items():
            yield from _below(rf"{path}\.{in_files(name)}", hint.hints[name], inner_key, inner_key.numbers or name)
    elif origin in (Union, UnionType):
        for kind in inner:
            yield from _below(path, kind, key, name)
    elif origin is tuple:
        pattern = rf"{path}\.[0-{len(inner) - 1}]"
        yield from _below(pattern, inner[0], key, name if name in RANGES else "place")
    elif origin in (Mapping, Sequence):
        yield from _below(rf"{path}\.[^.]+", entry_of(hint), key, name)  # of a joint


def study_schema() -> dict[str, Any]:
    """Return the JSON Schema of study files, for editors."""
    schema = json_schema(StudyTables, "floatplan study", "A problem, and the values for which it is planned")
    properties = schema["properties"]
    properties["vary"]["properties"] = {key: properties[key] for key in SAMPLING_KEYS}
    properties["vary"]["propertyNames"] = {"pattern": rf"^(?:{'|'.join((*SAMPLING_KEYS, *_numbers()))})$"}
    return schema
