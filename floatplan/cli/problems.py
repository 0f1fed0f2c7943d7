"""The commands about problem files: bounds of the angular momentum, takeoff and landing, and the schema."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from floatplan.cli.common import Json, ProblemFile, finish, print_path


def bounds(
    problem_file: ProblemFile,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw what joint rates reach at takeoff and landing.")
    ] = None,
    json_output: Json = False,
) -> None:
    """Tell which angular momentum suits a flight: of joints that do not turn back, and by their rates at both ends.

    For the former an interval and its midpoint; at takeoff and landing what joint rates within their limits make,
    the frame on the ground being at rest: intervals of angular momentum and velocity.
    """
    from floatplan.cli.facts import momentum_facts
    from floatplan.motion.flight import reachable_sets
    from floatplan.problem.file import load_problem

    problem = load_problem(problem_file)
    sets = reachable_sets(problem)
    facts = momentum_facts(problem, sets)
    if picture is not None:
        from floatplan.view.figures.robot_pictures import reachable_picture, save_picture

        save_picture(picture, "--picture", reachable_picture, sets)
    finish(facts, json_output, lambda summary: summary.momentum_summary(problem, facts))


def takeoff(
    problem_file: ProblemFile,
    json_output: Json = False,
) -> None:
    """Tell whether joint rates within their limits let the frame leave and meet the ground at rest.

    Looked at are the rates at these two instants, with one angular momentum for both; not how the robot gets there from
    rest, nor forces and balance. Exit code 1 where the rates are beyond their limits at one of the ends.
    """
    from floatplan.motion.flight import landing as at_landing
    from floatplan.motion.flight import no_common_momentum
    from floatplan.motion.flight import takeoff as at_takeoff
    from floatplan.problem.file import load_problem

    problem = load_problem(problem_file)
    ends = at_takeoff(problem), at_landing(problem)
    disagreement = no_common_momentum(problem)
    found = {str(contact.end): contact.to_dict() for contact in ends}
    facts = {"joints": list(problem.robot.joints), **found, "no_common_momentum": disagreement}
    ok = all(contact.ok for contact in ends) and disagreement is None
    finish(facts, json_output, lambda summary: summary.contact_summary(ends, disagreement), ok)


class File(StrEnum):
    """Files that have a schema."""

    PROBLEM = "problem"
    STUDY = "study"


def schema(
    file: Annotated[File, typer.Argument(help="Which file.")] = File.PROBLEM,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write it there: floatplan.schema.json beside problems."),
    ] = None,
) -> None:
    """Print the JSON Schema (2020-12) of problem or study files, by which editors complete and check them."""
    from floatplan.problem.file import problem_schema
    from floatplan.studies.schema import study_schema

    made = {File.PROBLEM: problem_schema, File.STUDY: study_schema}[file]
    text = json.dumps(made(), indent=2, allow_nan=False)
    if output is None:
        typer.echo(text)
        return
    from floatplan.files import write_atomically

    print_path(write_atomically(output, f"{text}\n"))
