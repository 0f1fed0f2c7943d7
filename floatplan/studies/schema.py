"""The tables of a study file as pydantic models."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, Tag, model_validator

from floatplan.problem.schema import Number, Table, Whole, any_of

SAMPLING_KEYS = ("sampling", "samples", "seed")


class RangeTable(Table):
    """``{ from = 1.0, to = 6.0, count = 200 }``; ``count`` is for grids."""

    low: Number = Field(alias="from")
    high: Number = Field(alias="to")
    count: Annotated[Whole, Field(ge=1)] | None = None


Varied: TypeAlias = Annotated[
    Annotated[RangeTable, Tag("<table>")] | Annotated[list[Number], Tag("<list>")],
    any_of("a table with from, to, count, or a list of numbers"),
]


class PlanTable(Table):
    """``[plan]``: how hard to try."""

    starts: Annotated[Whole, Field(ge=1)] = 1
    prove: Annotated[bool, Field(strict=True)] = False
    search: Annotated[bool, Field(strict=True)] = False


class ResultTable(Table):
    """``[result]``: where results go, and which map is drawn: horizontal key, vertical key, colour."""

    folder: Annotated[str, Field(min_length=1)] | None = None
    map: tuple[str, str, str] | None = None


class StudyFileTable(Table):
    """A whole study file; sampling may stand in ``[vary]`` too."""

    problem: str
    vary: dict[str, Varied]
    sampling: Literal["grid", "random", "sobol"] = "grid"
    samples: Annotated[Whole, Field(ge=1)] | None = None
    seed: Annotated[Whole, Field(ge=0)] = 0
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
