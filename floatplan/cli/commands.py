"""The command line. Heavy imports are inside the functions: ``floatplan --help`` is to answer at once."""

from __future__ import annotations

import atexit
import gc
import os
from dataclasses import replace
from typing import Annotated

import typer

import floatplan as fp
from floatplan.cli import checks, common, robots, show
from floatplan.cli.jumps import jump, launch, needs_casadi, takeoff
from floatplan.cli.progress import log_on_stderr, progress
from floatplan.cli.study import studio, study
from floatplan.files import runs_folder

GARBAGE_THRESHOLD = 100_000  # [-] objects: what a command imports stays, and collecting it again takes time
COMPARISON_BUDGET = 2.0  # [s] for the plan that the figures are compared with

app = typer.Typer(
    cls=common.Commands,
    help="Plan the flight phase of robots that have left the ground.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Source = Annotated[str, common.argument("PROBLEM.toml|ROBOT.urdf", "A problem file, or a robot.")]


def main() -> None:
    """Run the command line."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # matrices are small: threads would wait for one another
    gc.set_threshold(GARBAGE_THRESHOLD)
    atexit.register(gc.freeze)  # what is left goes with the process: collecting it at the end takes 0.1 s
    app(prog_name="floatplan")


def _print_version(wanted: bool) -> None:
    """Print the version, and which solver makes plans without inequalities."""
    if wanted:
        from floatplan.kernel.layout import description

        typer.echo(f"floatplan {fp.__version__}, {description()}")
        raise typer.Exit(common.DONE)


@app.callback()
def about(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version, and exit.")
    ] = False,
) -> None:
    """Plan the flight phase of robots that have left the ground."""


def plan(
    source: Source,
    options: common.Options,
    choices: common.RobotOptions,
    degrees: common.Degrees = False,
    output: common.Output = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
    verbose: common.Verbose = False,
    figures: Annotated[
        bool | None, typer.Option("--figures/--no-figures", help="Draw pictures; the default unless --json is given.")
    ] = None,
    report: Annotated[
        bool, typer.Option("--report", help="Write report.html too: a page that plays the plan.")
    ] = False,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Rows per second of trajectory.csv.")] = 1000.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the random starts.")] = 0,
    starts: Annotated[int, typer.Option(min=1, help="Searches to make; the best plan is kept.")] = 1,
    budget: Annotated[float | None, typer.Option(metavar="S", help="Time after which no new search begins, s.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    certify: Annotated[
        bool, typer.Option("--certify/--no-certify", help="Prove the plan, and put the certificate into its file.")
    ] = True,
    launch: Annotated[
        bool, typer.Option("--launch", help="Look for stances that reach the takeoff, and follow the landing.")
    ] = False,
) -> None:
    """Plan a flight: from a problem file (options override it), or from a URDF and options.

    The plan is proved for every instant of the flight. Exit code 0 only where a plan was found and, unless
    --no-certify is given, proved.
    """
    from floatplan.cli.asked import asked_problem, is_robot
    from floatplan.cli.results import FIGURES, REPORT, check_directory, write_problem, write_results
    from floatplan.export.table import sample_times

    problem = asked_problem(source, options, choices, degrees)
    directory = runs_folder(problem.name, "flight") if output is None else output
    check_directory(directory)
    sample_times(problem.flight.duration, rate)
    if launch:
        from floatplan.stance.launch import launches

        needs_casadi("--launch")
    with log_on_stderr(verbose), progress("planning", quiet, tell=True) as bar:
        answer = fp.plan(problem, seed=seed, starts=starts, budget=budget, jobs=jobs, progress=bar.say, prove=certify)
    with progress("stances", quiet):
        stances, of_stances = launches(answer, seed) if launch and answer.ok else ([], {})
    with progress("writing", quiet):
        files = write_results(answer, directory, rate, tell=common.tell(quiet))
        if is_robot(source):
            files.append(write_problem(answer, directory))
        if figures or (figures is None and not json_output):
            from floatplan.view.figures.figures import save_figures

            files += save_figures(answer, directory / FIGURES, compare=_without_obstacles(answer, seed))
        if report:
            from floatplan.view.report.report import write_report

            files.append(write_report(answer, directory / REPORT, stances))
    facts = {key: value for key, value in answer.record.to_dict().items() if key != "problem"}
    facts |= {"launch": of_stances} if launch else {}
    ok = answer.ok and (not certify or (answer.certificate is not None and answer.certificate.proved))
    words = (answer, files, common.program(), stances)
    common.finish(facts, json_output, lambda summary: summary.plan_summary(*words), ok, told=not quiet)


def _without_obstacles(answer: fp.Plan, seed: int) -> fp.Plan | None:
    """Return a plan of the problem without its obstacles, for the pictures, if it is found at once and hits them."""
    from floatplan.view.figures.snapshots import worst_passage

    if not answer.problem.obstacles:
        return None
    unobstructed = fp.plan(replace(answer.problem, obstacles=()), seed=seed, budget=COMPARISON_BUDGET)
    return unobstructed if unobstructed.ok and worst_passage(answer, unobstructed)[1] is not None else None


COMMANDS = (  # in the order in which --help lists them
    *(plan, robots.bounds, robots.info, checks.certify, checks.replay, robots.robots, robots.schema, show.show),
    *(show.export, study, studio, jump, launch, takeoff, robots.init),
)
OF_THEIR_OWN = {robots.info: robots.InfoCommand, show.export: show.ExportCommand}
for command in COMMANDS:
    typed = common.reporting_errors(common.with_options(command))
    app.command(cls=OF_THEIR_OWN.get(command))(typed)
