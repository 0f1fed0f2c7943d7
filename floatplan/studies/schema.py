"""The tables of a study file as pydantic models."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, Tag, model_validator

from floatplan.planning.search import MOST_SOLVED
from floatplan.problem.schema import DIALECT, Number, Table, Whole, any_of
from floatplan.studies.numbers import patterns

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


def study_schema() -> dict[str, Any]:
    """Return the JSON Schema of study files, for editors."""
    schema = StudyFileTable.model_json_schema()
    properties = schema["properties"]
    vary = properties["vary"]
    vary["properties"] = {key: properties[key] for key in SAMPLING_KEYS}
    vary["propertyNames"] = {"pattern": rf"^(?:{'|'.join((*SAMPLING_KEYS, *patterns()))})$"}
    for table in (schema, *schema["$defs"].values()):
        table.pop("title", None)
        for described in table["properties"].values():
            described.pop("title", None)
    return {"$schema": DIALECT, **schema, "title": "floatplan study"}
