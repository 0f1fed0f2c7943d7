"""Problem files as JSON Schema 2020-12, for editors: made from the tables that check them."""

from __future__ import annotations

from typing import Any

from floatplan.problem import parts as asked
from floatplan.problem.keys import Key
from floatplan.problem.schema import CouplingTable, PartTable, ProblemFileTable, RobotTable, Table
from floatplan.tables import RANGES

DIALECT = "https://json-schema.org/draft/2020-12/schema"

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
    "obstacles[circle]": (PartTable[asked.Circle], "A disc"),
    "obstacles[half-plane]": (PartTable[asked.HalfPlane], "Ground or a wall, solid on one side of a line"),
    "obstacles[capsule]": (PartTable[asked.Bar], "A bar with round ends"),
    "self_clearance[]": (PartTable[asked.SelfClearance], "Two links to keep apart"),
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
