"""The tables of a problem file as pydantic models, made from the parts of a problem and the record of their keys.

Validated with the context ``{"degrees": True}``, every angle comes out in radians. Editors get the same tables as JSON
Schema 2020-12.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from functools import cache
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Literal,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    create_model,
)

from floatplan.arguments import either
from floatplan.problem import parts as asked
from floatplan.problem.jump import JumpLanding, JumpRequest, JumpTakeoff
from floatplan.problem.keys import ANGLE, Key, Keyed, in_files
from floatplan.robot.robot import Coupling
from floatplan.tables import RANGES

Part = TypeVar("Part", bound=Keyed)
# What values of several shapes are told apart by; tags are in angle brackets, so that no path in a message shows them
SHAPES = {Mapping: "<table>", Sequence: "<list>", Literal: "<word>"}
NAMES = {float: "a number", int: "a whole number", Mapping: "a table{} by joint", Sequence: "a list{} in joint order"}
UNLIMITED = (None, "none")
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def _in_radians(value: float, info: ValidationInfo) -> float:
    return math.radians(value) if info.context and info.context["degrees"] else value


def _shape(value: Any) -> str:
    shapes = ((dict, "<table>"), (list, "<list>"), (str, "<word>"))
    return next((shape for kind, shape in shapes if isinstance(value, kind)), "<number>")


def any_of(wanted: str) -> Discriminator:
    """Tell apart by their shapes what a key may hold; else it is not ``wanted``."""
    return Discriminator(_shape, custom_error_type="wrong_shape", custom_error_message=f"is not {wanted}")


Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole: TypeAlias = Annotated[int, Field(strict=True)]
Angle: TypeAlias = Annotated[Number, AfterValidator(_in_radians)]


class Table(BaseModel):
    """A table of the file: unknown keys are refused."""

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True)


class PartTable(Table, Generic[Part]):
    """The table of a part; ``PartTable[Flight]`` has the keys of :class:`Flight`, and makes one."""

    part: ClassVar[type[Keyed]]

    def __class_getitem__(cls, part: Any) -> Any:
        """Return the table of a part."""
        return _table(part)

    def values(self) -> dict[str, Any]:
        """The fields of the part."""
        return {name: _value(getattr(self, in_files(name))) for name in self.part.keys}

    def made(self) -> Part:
        """Return the part that the table describes."""
        return self.part.unchecked(**self.values())  # type: ignore[return-value]


@cache
def _table(part: Any) -> type[PartTable[Any]]:
    hints = get_type_hints(part)
    stated: dict[str, Any] = {}
    for each in fields(part):
        key = part.keys.get(each.name)
        if key is not None:
            default = ... if each.default is MISSING else each.default
            if each.default_factory is not MISSING:
                default = Field(default_factory=each.default_factory)
            stated[in_files(each.name)] = (Annotated[_held(hints[each.name], key), key], default)
    if issubclass(part, asked.Obstacle):
        stated = {"kind": (Annotated[Literal[part.kind], Key("Which kind of obstacle")], ...), **stated}
    table: type[PartTable[Any]] = create_model(f"{part.__name__}Table", __base__=PartTable, **stated)
    table.part = part
    return table


def _held(hint: Any, key: Key) -> Any:
    """What a file may hold for a field with this type."""
    origin, inner = get_origin(hint), get_args(hint)
    if isinstance(hint, type) and issubclass(hint, Keyed):
        return _table(hint)  # type: ignore[arg-type]
    if origin in (Union, UnionType):
        return _one_of(hint, key)
    if origin is tuple:
        return tuple[tuple(_held(each, key) for each in inner)]  # type: ignore[misc]
    if origin is Mapping:
        return dict[str, _entry(inner[1], key)]  # type: ignore[misc]
    if origin is Sequence:
        return list[_entry(inner[0], key)]  # type: ignore[misc]
    return {float: Angle if " or deg" in key.unit else Number, int: Whole}.get(hint, hint)


def _entry(hint: Any, key: Key) -> Any:
    """What one entry of a table by joint or of a list may be: a sequence there is a pair."""
    held = _held(get_args(hint)[0] if get_origin(hint) is Sequence else hint, key)
    return tuple[held, held] if get_origin(hint) is Sequence else held  # type: ignore[valid-type]


def _one_of(hint: Any, key: Key) -> Any:
    """One of several shapes; in a list of limits, ``null`` and "none" are no limit."""
    kinds = [kind for kind in get_args(hint) if get_origin(kind) is not np.ndarray]
    several = {SHAPES.get(get_origin(kind), "<number>"): _held(kind, key) for kind in kinds if kind is not type(None)}
    if len(kinds) > len(several):
        return several.popitem()[1] | None
    if "<list>" in several and "none" in get_args(several.get("<word>")):
        entry = {"<word>": Literal["none"], "<number>": several["<number>"]}
        several["<list>"] = list[_shaped(entry, ["a number", "'none'"]) | None]  # type: ignore[misc]
    return _shaped(several, [name for kind in kinds for name in _names(kind)])


def _names(kind: Any) -> list[str]:
    """What a message calls what has a type."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return [repr(word) for word in inner]
    is_range = bool(inner) and get_origin(inner[-1]) is Sequence
    return [NAMES[origin or kind].format(" of [low, high]" if is_range else "")]


def _shaped(forms: Mapping[str, Any], names: Sequence[str]) -> Any:
    tagged = [Annotated[forms[tag], Tag(tag)] for tag in (*SHAPES.values(), "<number>") if tag in forms]
    return Annotated[Union[tuple(tagged)], any_of(either(names))]  # noqa: UP007


def _value(value: Any) -> Any:
    """What a part is given for what its table holds."""
    if isinstance(value, PartTable):
        return value.made()
    if isinstance(value, dict):
        return {name: _value(each) for name, each in value.items()}
    return [math.inf if each in UNLIMITED else each for each in value] if isinstance(value, list) else value


class CouplingTable(Table):
    """``{ leader = "q1", ratio = -1, offset = 0 }``."""

    leader: Annotated[str, Key("The planned joint that it follows")]
    ratio: Annotated[Number, Key("Its position over the leader's")] = 1.0
    offset: Annotated[Angle, Key("Its position where the leader's is zero", ANGLE)] = 0.0

    def coupling(self) -> Coupling:
        """Return what the table says."""
        return Coupling(self.leader, self.ratio, self.offset)


CoupledJoint: TypeAlias = Annotated[
    Annotated[CouplingTable, Tag("<table>")] | Annotated[str, Tag("<word>")],
    any_of("the name of the joint that leads, or a table with leader, ratio, offset"),
]
CoupledJoints: TypeAlias = Annotated[
    Annotated[dict[str, CoupledJoint], Tag("<table>")] | Annotated[Literal["mirror"], Tag("<word>")],
    any_of("a table of joints and their leaders, or 'mirror'"),
]


OfMotors: TypeAlias = Annotated[
    Annotated[dict[str, Number], Tag("<table>")] | Annotated[Number, Tag("<number>")],
    any_of("a number, or a table of numbers by joint"),
]


class RobotTable(Table):
    """``[robot]``: the URDF and the choices that it leaves open."""

    urdf: Annotated[str, Key("Path from this file's folder, or `example-robot-data:` and a path in that package")]
    plane: Annotated[
        str | None, Key('Horizontal and vertical axis, such as "xz"; found from the joints where left out')
    ] = None
    joints: Annotated[
        list[str] | None,
        Key("Joints to plan, in the order of all lists; all that turn about the plane's normal if left out"),
    ] = None
    coupled: Annotated[
        CoupledJoints,
        Key('Joints that follow others: a leader\'s name (with a minus, mirrored), a table, or "mirror"'),
    ] = Field(default_factory=dict)
    locked: Annotated[
        dict[str, Angle], Key("Joints that stay where they are, by name", f"{ANGLE}, m of those that slide")
    ] = Field(default_factory=dict)
    reference: Annotated[
        str | None, Key("Posture of an SRDF file beside the URDF, where joints that are not planned are locked")
    ] = None

    armature: Annotated[
        OfMotors | None, Key("Inertia of rotors as their joints feel it: of every motor, or by joint", "kg m^2")
    ] = None
    damping: Annotated[
        OfMotors | None, Key("Torque lost by a joint's rate, in simulators: of every motor, or by joint", "N m s/rad")
    ] = None

    def choices(self) -> dict[str, Any]:
        """Return the keyword arguments of ``Robot.from_urdf``."""
        coupled: Any = self.coupled
        if not isinstance(coupled, str):
            coupled = {name: each if isinstance(each, str) else each.coupling() for name, each in coupled.items()}
        said = {"joints": self.joints, "coupled": coupled or None, "locked": dict(self.locked) or None}
        return {"plane": self.plane, **said, **self.model_dump(include={"reference", "armature", "damping"})}


class RecordedPostureTable(PartTable[asked.Posture]):
    """``start`` or ``goal`` of a plan file: with the words that its numbers stand for, where words were asked for."""

    velocities_asked: Literal["takeoff", "landing"] | None = None
    accelerations_asked: Literal["free"] | None = None

    def values(self) -> dict[str, Any]:
        """The fields of the posture."""
        values = super().values()
        words = {"velocities": self.velocities_asked, "accelerations": self.accelerations_asked}
        if not any(words.values()):
            return values
        settled = tuple(None if isinstance(values[name], str) else values[name] for name in words)
        return values | {name: word for name, word in words.items() if word} | {"settled": settled}


class RecordedLimitsTable(PartTable[asked.Limits]):
    """``limits`` of a plan file: where a joint has several motors, with the limit of each one's own torque."""

    motor_torque: dict[str, Number] | None = None

    def values(self) -> dict[str, Any]:
        """The fields of the limits; the motors' own contain those of the generalised torques."""
        values = super().values()
        return values if self.motor_torque is None else values | {"torque": self.motor_torque}


def _obstacle_kind(value: Any) -> str | None:
    kind = value.get("kind") if isinstance(value, dict) else None
    return f"<{kind}>" if isinstance(kind, str) else None


def _any_obstacle() -> Any:
    """The tables of all kinds, told apart by their kind."""
    tagged = [
        Annotated[_table(known), Tag(f"<{kind}>")]  # type: ignore[arg-type]
        for kind, known in asked.OBSTACLE_KINDS.items()
    ]
    message = f"is not a table with kind = {either(map(repr, asked.OBSTACLE_KINDS))}"
    told = Discriminator(_obstacle_kind, custom_error_type="wrong_kind", custom_error_message=message)
    return Annotated[Union[tuple(tagged)], told]  # noqa: UP007


if TYPE_CHECKING:
    AnyObstacle: TypeAlias = PartTable[asked.Obstacle]
else:
    AnyObstacle = _any_obstacle()

Unit: TypeAlias = Annotated[Literal["rad", "deg"], Key("Unit of all angles and rates in this file")]


class ProblemTable(Table):
    """A problem file less its ``[robot]``."""

    name: Annotated[
        Annotated[str, Field(min_length=1)] | None,
        Key("Of the problem, and of the folder of its results; the file's name where left out"),
    ] = None
    angles: Unit = "rad"
    ground: Annotated[
        bool, Field(strict=True), Key("Whether the robot stays above the line that it takes off from")
    ] = False
    start: PartTable[asked.Posture]
    goal: PartTable[asked.Posture]
    flight: PartTable[asked.Flight]
    motion: PartTable[asked.Motion] = Field(default_factory=PartTable[asked.Motion])
    limits: PartTable[asked.Limits] = Field(default_factory=PartTable[asked.Limits])
    obstacles: list[AnyObstacle] = Field(default_factory=list)
    self_clearance: list[PartTable[asked.SelfClearance]] = Field(default_factory=list)
    jump: PartTable[JumpRequest] | None = None


class RecordedProblemTable(ProblemTable):
    """The problem in a plan file."""

    start: RecordedPostureTable
    goal: RecordedPostureTable
    limits: RecordedLimitsTable = Field(default_factory=RecordedLimitsTable)


class ProblemFileTable(ProblemTable):
    """A whole problem file."""

    robot: RobotTable


class RobotFileTable(Table):
    """A file that names a robot, and asks nothing of it yet."""

    name: str | None = None
    angles: Unit = "rad"
    robot: RobotTable


TABLES: dict[str, tuple[type[Table], str]] = {  # by their places in a file, with what they are about
    "": (ProblemFileTable, "The whole file"),
    "robot": (RobotTable, "The robot: its URDF, and the choices that it leaves open"),
    "robot.coupled.*": (CouplingTable, "How a joint follows another"),
    "start": (PartTable[asked.Posture], "Takeoff"),
    "goal": (PartTable[asked.Posture], "Landing"),
    "flight": (PartTable[asked.Flight], "The flight"),
    "flight.takeoff": (PartTable[asked.Takeoff], "What leaves the ground"),
    "flight.landing": (PartTable[asked.Landing], "What lands"),
    "motion": (PartTable[asked.Motion], "How joints may move, and what is best"),
    "limits": (PartTable[asked.Limits], "What motors and joints can do, at all times"),
    "limits.motor.*": (
        PartTable[asked.Motor],
        "A motor's torque falls with its rate: at most `stall - slope |rate|`",
    ),
    **{f"obstacles[{kind}]": (PartTable[known], known.about) for kind, known in asked.OBSTACLE_KINDS.items()},  # type: ignore[valid-type]
    "self_clearance[]": (PartTable[asked.SelfClearance], "Two links to keep apart"),
    "jump": (PartTable[JumpRequest], "A whole jump around the flight, [jumps](jump.md)"),
    "jump.takeoff": (PartTable[JumpTakeoff], "What stands before the flight"),
    "jump.landing": (PartTable[JumpLanding], "What stands after the flight"),
}


def keys_of(table: type[Table]) -> dict[str, Key]:
    """The keys of a table that say what they mean; a test finds those that do not."""
    noted = [(name, note) for name, field in table.model_fields.items() for note in field.metadata]
    return {name: note for name, note in noted if isinstance(note, Key)}


def problem_schema() -> dict[str, Any]:
    """Return the JSON Schema of problem files; angles have no range there, since a file chooses their unit."""
    schema = ProblemFileTable.model_json_schema()
    definitions = schema["$defs"]
    for table, meaning in reversed(
        TABLES.values()
    ):  # what starts and ends a flight has one table, told of as the first
        described = schema if table is ProblemFileTable else definitions[table.__name__]
        described.pop("title", None)
        described["description"] = meaning
        for name, key in keys_of(table).items():
            property_ = described["properties"][name]
            property_["description"] = f"{key.meaning} [{key.unit}]" if key.unit else key.meaning
            _bound(property_, name, key.unit)
        for property_ in described["properties"].values():
            property_.pop("title", None)
    return {"$schema": DIALECT, **schema, "title": "floatplan problem"}


def _bound(described: dict[str, Any], name: str, unit: str) -> None:
    """Add the range of a number, unless a file chooses its unit or it is one of many."""
    if name in RANGES and RANGES[name].unit == unit:
        for form in (described, *described.get("anyOf", ()), *described.get("oneOf", ())):
            if form.get("type") == "number":
                form["minimum"], form["maximum"] = RANGES[name].low, RANGES[name].high
