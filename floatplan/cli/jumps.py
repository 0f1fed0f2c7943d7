"""The commands about what the ground has to do with a flight: ``jump``, ``takeoff``, ``launch``."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Annotated

import typer

import floatplan as fp
from floatplan.cli import common
from floatplan.cli.progress import progress
from floatplan.errors import InputError, naming
from floatplan.files import runs_folder

Seed = Annotated[int, typer.Option(min=0, help="Of the starts after the first.")]
Starts = Annotated[int, typer.Option(min=1, max=1000, help="How many are tried.")]


def jump(
    problem_file: common.ProblemFile,
    output: common.Output = None,
    seed: Seed = 0,
    starts: Starts = 4,
    report: Annotated[
        bool | None, typer.Option("--report/--no-report", help="Write the page; the default unless --json is given.")
    ] = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
) -> None:
    """Plan a whole jump: from standing through a flight to standing again.

    Its flight is proved for every instant; its stances are checked 2000 times a second, which is no proof. Writes
    jump.json, the flight's plan.json, and report.html, a page that plays it. Exit code 0 only where a jump was found,
    proved and checked so.
    """
    from floatplan.cli.results import REPORT, check_directory, write_jump

    problem = fp.load_problem(problem_file)
    directory = runs_folder(problem.name, "jump") if output is None else output
    check_directory(directory)
    began = time.perf_counter()
    with progress("jump", quiet, tell=True) as bar, naming(problem_file):
        found = fp.jump(problem, seed=seed, starts=starts, progress=bar.say)
        if found.flight is not None and found.flight.ok:
            bar.say("proving the flight")
            found = found.with_certificate(fp.certify(found.flight))
    files = write_jump(found, directory, common.tell(quiet))
    if (report or (report is None and not json_output)) and found.flight is not None:
        files.append(found.show(directory / REPORT, browse=False))
    words = (found, files, time.perf_counter() - began, common.program())
    proved = found.flight is not None and found.flight.certificate is not None and found.flight.certificate.proved
    ok = found.ok and proved
    common.finish(found.to_dict(), json_output, lambda summary: summary.jump_summary(*words), ok, told=not quiet)


def takeoff(
    problem_file: common.ProblemFile,
    json_output: common.Json = False,
) -> None:
    """Tell whether joint rates within their limits let the frame leave and meet the ground at rest.

    Looked at are the rates at these two instants, with one angular momentum for both; not how the robot gets there from
    rest, nor forces and balance. Exit code 1 where the rates are beyond their limits at one of the ends.
    """
    from floatplan.motion.flight import no_common_momentum

    problem = fp.load_problem(problem_file)
    ends = fp.takeoff(problem), fp.landing(problem)
    disagreement = no_common_momentum(problem)
    found = {str(contact.end): contact.to_dict() for contact in ends}
    facts = {"joints": list(problem.robot.joints), **found, "no_common_momentum": disagreement}
    ok = all(contact.ok for contact in ends) and disagreement is None
    common.finish(facts, json_output, lambda summary: summary.contact_summary(ends, disagreement), ok)


def launch(
    plan_file: common.PlanFile,
    urdf: common.Urdf = None,
    landing: Annotated[bool, typer.Option("--landing", help="From the plan's landing to rest, instead.")] = False,
    friction: Annotated[
        float | None, typer.Option(metavar="MU", help="Of the ground; the problem's, or 0.6, if left out.")
    ] = None,
    seed: Seed = 0,
    starts: Starts = 3,
    json_output: common.Json = False,
) -> None:
    """Tell whether a stance from rest that reaches a plan's takeoff is found within the limits, and what is to spare.

    What is found is checked 2000 times a second. Exit code 1 where none is found: that is no proof that there is none.
    """
    plan = fp.load_plan(plan_file, urdf)
    request = plan.problem.jump or fp.JumpRequest()
    if friction is not None:
        request = replace(request, friction=friction)
    with progress("launch"), naming(plan_file):
        found = fp.launch(plan, request, end="landing" if landing else "takeoff", seed=seed, starts=starts)
    facts = {"friction": request.friction, **found.to_dict(), "figures": found.figures}
    common.finish(facts, json_output, lambda summary: summary.launch_summary(found), found.ok)


def needs_casadi(option: str) -> None:
    """Refuse an option where CasADi is not installed."""
    from floatplan.stance.model import casadi

    try:
        casadi()
    except InputError as error:
        raise InputError(error.reason, element=option, advice=error.advice) from None
