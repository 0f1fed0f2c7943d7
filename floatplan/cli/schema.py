"""The command that prints the JSON Schema of files."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from floatplan.cli.common import print_path, reporting_errors


class File(StrEnum):
    """Files that have a schema."""

    PROBLEM = "problem"
    STUDY = "study"


@reporting_errors
def schema(
    file: Annotated[File, typer.Argument(help="Which file.")] = File.PROBLEM,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write it there: floatplan.schema.json beside problems."),
    ] = None,
) -> None:
    """Print the JSON Schema (2020-12) of problem or study files, by which editors complete and check them."""
    from floatplan.problem.schema import problem_schema
    from floatplan.studies.schema import study_schema

    made = {File.PROBLEM: problem_schema, File.STUDY: study_schema}[file]
    text = json.dumps(made(), indent=2, allow_nan=False)
    if output is None:
        typer.echo(text)
        return
    from floatplan.files import write_atomically

    print_path(write_atomically(output, f"{text}\n"))
