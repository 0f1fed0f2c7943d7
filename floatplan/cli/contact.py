"""The command ``floatplan takeoff``: whether a flight can begin and end."""

from __future__ import annotations

from typing import Annotated

import typer

from floatplan.cli.bundled import argument
from floatplan.cli.common import DONE, FAILED, Json, print_json, reporting_errors


@reporting_errors
def takeoff(
    problem_file: Annotated[str, argument("PROBLEM.toml", "A problem file.")],
    json_output: Json = False,
) -> None:
    """Tell whether joint rates within their limits let the frame leave and meet the ground at rest.

    Looked at are the rates at these two instants, with one angular momentum for both; not how the robot gets there from
    rest, nor forces and balance. Exit code 1 where the rates are beyond their limits at one of the ends.
    """
    from floatplan.plans.contact import landing as at_landing
    from floatplan.plans.contact import no_common_momentum
    from floatplan.plans.contact import takeoff as at_takeoff
    from floatplan.problem.file import load_problem

    problem = load_problem(problem_file)
    ends = at_takeoff(problem), at_landing(problem)
    disagreement = no_common_momentum(problem)
    if json_output:
        facts = {str(contact.end): contact.to_dict() for contact in ends}
        print_json({"joints": list(problem.robot.joints), **facts, "no_common_momentum": disagreement})
    else:
        from floatplan.cli.contact_summary import contact_summary
        from floatplan.cli.summary import print_summary

        print_summary(contact_summary(ends, disagreement))
    raise typer.Exit(DONE if all(contact.ok for contact in ends) and disagreement is None else FAILED)
