"""Writes docs/keys.md, the reference of problem and study files, from the JSON Schemas of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from floatplan.keys import KIND, Keyed, in_files, tables
from floatplan.problem.file import TABLES, problem_schema
from floatplan.studies.schema import StudyTables, study_schema

PAGE = Path(__file__).resolve().parents[1] / "docs" / "keys.md"
OPENING = """# Keys of a problem file

A problem file is TOML. Every key that floatplan knows is here, and any other is refused. Angles and rates are in
radians unless the file says `angles = "deg"`. [Limits](limits.md) has the ranges of numbers. `floatplan schema` prints
the same as JSON Schema 2020-12, for editors: with `floatplan schema -o floatplan.schema.json` and, as the first line of
a problem file, `#:schema ./floatplan.schema.json`. Numbers in parentheses are the paper's equations.

This page is made by `scripts/key_reference.py`.
"""


STUDIES = """# Keys of a study file

What [studies](studies.md) are asked; `floatplan schema study` prints it as JSON Schema.
"""


def page() -> str:
    """Return the page's text."""
    of_studies = {"": (StudyTables, "The whole file"), **tables(StudyTables)}
    return "\n".join([OPENING, *_sections(problem_schema(), TABLES), STUDIES, *_sections(study_schema(), of_studies)])


def _sections(schema: Mapping[str, Any], described_tables: Mapping[str, tuple[type[Keyed], str]]) -> Iterator[str]:
    for place, (table, about) in described_tables.items():
        described = schema["$defs"][f"{table.__name__}Table"] if place else schema
        keys = {in_files(name): key for name, key in table.keys.items()}
        keys = {"kind": KIND, **keys} if hasattr(table, "kind") else keys
        required = set(described.get("required", ()))
        rows = [
            f"| `{name}` | {_form(schema, form)} | {_default(form, name in required)} | {key.meaning} | {key.unit} |"
            for name, key in keys.items()
            for form in [described["properties"][name]]
        ]
        head = "| key | value | default | meaning | unit |\n| --- | --- | --- | --- | --- |"
        yield "\n".join([f"## {_heading(place)}", "", f"{about}.", "", head, *rows, ""])


def _heading(place: str) -> str:
    if not place:
        return "Top of the file"
    if place.startswith("obstacles["):
        kind, in_space, _ = place.removeprefix("obstacles[").removesuffix("]").partition(" in space")
        return f'`[[obstacles]]` with `kind = "{kind}"`{in_space}'
    if place.endswith("[]"):
        return f"`[[{place.removesuffix('[]')}]]`"
    return f"`[{place.replace('vary.*', 'vary.PATH').replace('*', 'JOINT')}]`"


def _form(schema: Mapping[str, Any], form: Mapping[str, Any]) -> str:
    """What a value may be, in words."""
    return " or ".join(dict.fromkeys(_forms(schema, form)))


def _forms(schema: Mapping[str, Any], form: Mapping[str, Any]) -> Iterator[str]:
    for alternatives in (form.get("anyOf"), form.get("oneOf")):
        for inner in alternatives or ():
            yield from _forms(schema, inner)
    if "$ref" in form:
        yield "table"
    elif "const" in form:
        yield f'`"{form["const"]}"`'
    elif "enum" in form:
        yield from (f'`"{word}"`' for word in form["enum"])
    elif "prefixItems" in form:
        yield f"[{', '.join(_form(schema, inner) for inner in form['prefixItems'])}]"
    elif form.get("type") == "array":
        yield "list"
    elif form.get("type") == "object":
        yield "table"
    elif form.get("type") in WORDS:
        yield WORDS[form["type"]]


WORDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "`true`, `false`"}


def _default(form: Mapping[str, Any], needed: bool) -> str:
    if needed:
        return "needed"
    default = form.get("default")
    if isinstance(default, str):
        return f'`"{default}"`'
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return "" if default in (None, {}, []) else f"`{default}`"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
