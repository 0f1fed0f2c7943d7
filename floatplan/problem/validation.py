"""Whether the content of a file fits its tables: every error of pydantic's in the words of the file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from floatplan.errors import InputError, ProblemError

AnyTable = TypeVar("AnyTable", bound=BaseModel)

WANTED = {  # by pydantic's errors
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text",
    "model_type": "a table",
    "dict_type": "a table",
    "list_type": "a list",
    "tuple_type": "a list",
}


def validated(model: type[AnyTable], content: Mapping[str, Any]) -> AnyTable:
    """Check the content of a file.

    Raises
    ------
    ProblemError
        All that is wrong with it, each with its path.
    """
    try:
        return model.model_validate(content, context={"degrees": content.get("angles") == "deg"})
    except ValidationError as error:
        raise ProblemError([_input_error(model, details) for details in error.errors(include_url=False)]) from None


def _input_error(model: type[BaseModel], details: Mapping[str, Any]) -> InputError:
    location: tuple[str | int, ...] = details["loc"]
    element = _dotted(location)
    match details["type"]:
        case "extra_forbidden":
            return InputError("unknown key", element=element, advice=_nearest_key(model, location))
        case "missing":
            return InputError("is missing", element=element)
        case "wrong_shape" | "wrong_kind":
            wrong = details["msg"]
        case "literal_error":
            wrong = f"is not {details['ctx']['expected']}"
        case kind if kind in WANTED:
            wrong = f"is not {WANTED[kind]}"
        case _:
            return InputError(details["msg"][:1].lower() + details["msg"][1:], element=element)
    value = repr(details["input"])
    return InputError(f"{value if len(value) <= 60 else f'{value[:56]} ...'} {wrong}", element=element)


def _dotted(location: Sequence[str | int]) -> str:
    """``("obstacles", 0, "<circle>", "radius")`` is ``obstacles[0].radius``; tags of unions are not shown."""
    parts = [part for part in location if not _is_tag(part)]
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).lstrip(".")


def _is_tag(part: str | int) -> bool:
    return isinstance(part, str) and part.startswith("<") and part.endswith(">")


def _nearest_key(model: type[BaseModel], location: Sequence[str | int]) -> str:
    """Advice for an unknown key: the known one that it looks like, or all of its table."""
    *table, key = location
    known = _keys(model, table)
    close = difflib.get_close_matches(str(key), known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known are {', '.join(known)}"


def _keys(model: type[BaseModel], table: Sequence[str | int]) -> list[str]:
    """Keys of the table at a location, found by walking the models' fields."""
    candidates = [model]
    for part in table:
        fields = [candidate.model_fields[str(part)] for candidate in candidates if part in candidate.model_fields]
        if fields:
            candidates = [inner for field in fields for inner in _models(field.annotation)]
        elif _is_tag(part):
            kind = str(part).strip("<>")
            candidates = [c for c in candidates if "kind" not in c.model_fields or kind in _kinds(c)] or candidates
    return sorted({field.alias or name for candidate in candidates for name, field in candidate.model_fields.items()})


def _kinds(model: type[BaseModel]) -> tuple[Any, ...]:
    return get_args(model.model_fields["kind"].annotation)


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]
