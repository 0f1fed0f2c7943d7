"""Problem files as JSON Schema 2020-12, for editors: made from the tables that check them."""

from __future__ import annotations

from typing import Any

from floatplan.problem.keys import KEYS, TABLES
from floatplan.problem.parts import OBSTACLE_KINDS
from floatplan.problem.schema import (
    CouplingTable,
    FlightTable,
    LandingTable,
    LimitsTable,
    MotionTable,
    MotorTable,
    PostureTable,
    ProblemFileTable,
    RobotTable,
    SelfClearanceTable,
    Table,
    TakeoffTable,
)
from floatplan.tables import RANGES

DIALECT = "https://json-schema.org/draft/2020-12/schema"

MODELS: dict[str, type[Table]] = {
    "": ProblemFileTable,
    "robot": RobotTable,
    "robot.coupled.*": CouplingTable,
    "start": PostureTable,
    "flight": FlightTable,
    "flight.takeoff": TakeoffTable,
    "flight.landing": LandingTable,
    "motion": MotionTable,
    "limits": LimitsTable,
    "limits.motor.*": MotorTable,
    "self_clearance[]": SelfClearanceTable,
}


def problem_schema() -> dict[str, Any]:
    """Return the JSON Schema of problem files; angles have no range there, since a file chooses their unit."""
    schema = ProblemFileTable.model_json_schema()
    definitions = schema["$defs"]
    places = {place: definitions[model.__name__] if place else schema for place, model in MODELS.items()}
    places |= {f"obstacles[{kind}]": definitions[f"{known.__name__}Table"] for kind, known in OBSTACLE_KINDS.items()}
    for place, table in places.items():
        table.pop("title", None)
        table["description"] = TABLES[place]
        for name, key in KEYS[place].items():
            described = table["properties"][name]
            described.pop("title", None)
            described["description"] = f"{key.meaning} [{key.unit}]" if key.unit else key.meaning
            _bound(described, name, key.unit)
    schema["title"] = "floatplan problem"
    for table in places.values():
        for described in table["properties"].values():
            described.pop("title", None)
    return {"$schema": DIALECT, **schema}


def _bound(described: dict[str, Any], name: str, unit: str) -> None:
    """Add the range of a number, unless a file chooses its unit or it is one of many."""
    if name in RANGES and RANGES[name].unit == unit:
        for form in (described, *described.get("anyOf", ()), *described.get("oneOf", ())):
            if form.get("type") == "number":
                form["minimum"], form["maximum"] = RANGES[name].low, RANGES[name].high
