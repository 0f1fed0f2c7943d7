"""The command line. Heavy imports are inside the functions: ``floatplan --help`` is to answer at once."""

from __future__ import annotations

import atexit
import gc
import os
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Literal

import typer

import floatplan as fp
from floatplan.cli import ExitCode, clips, common, motions, pack, robots
from floatplan.cli.common import flag, option
from floatplan.cli.progress import log_on_stderr, progress
from floatplan.cli.study import merge, studio, study
from floatplan.errors import InputError, naming
from floatplan.files import runs_folder
from floatplan.tables import CHOICES

COMPARISON_BUDGET = 2.0  # [s] for the plan that the figures are compared with

app = typer.Typer(
    cls=common.Commands,
    help="Plan the flight phase of robots that have left the ground.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Source = Annotated[str, common.argument("PROBLEM.toml|ROBOT.urdf", "A problem file, or a robot.")]
Seed = Annotated[int, common.count_option("seed", "Of the starts after the first.")]
Starts = Annotated[int, common.count_option("starts", "How many are tried.", has_most=True)]


def main() -> None:
    """Run the command line."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # matrices are small: threads would wait for one another
    atexit.register(gc.freeze)  # what is left goes with the process: collecting it at the end takes 0.1 s
    app(prog_name="floatplan")


def _print_version(requested: bool) -> None:
    """Print the version, and which solver makes plans without inequalities."""
    if requested:
        from floatplan.kernel.library import description

        typer.echo(f"floatplan {fp.__version__}, {description()}")
        raise typer.Exit(ExitCode.DONE)


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
    figures: Annotated[bool, flag("Draw pictures too, into figures/.", "--figures/--no-figures")] = False,
    report: Annotated[bool, flag("Write report.html too: a page that plays the plan.", "--report")] = False,
    rate: Annotated[float, option("HZ", "Rows per second of trajectory.csv.")] = 1000.0,
    seed: Annotated[int, common.count_option("seed", "Of the random starts.")] = 0,
    starts: Annotated[int, common.count_option("starts", "Searches to make; the best plan is the result.")] = 1,
    budget: Annotated[float | None, option("S", "Time after which no new search begins, s.")] = None,
    method: Annotated[str, common.choice_option("method", "The planner: ")] = "kernel",
    certify: Annotated[
        bool, flag("Prove the plan, and put the certificate into its file.", "--certify/--no-certify")
    ] = True,
    prove: Annotated[bool, flag("Exit code 1 where the plan is not proved.", "--prove")] = False,
    launch: Annotated[
        bool, flag("Look for stances that reach the takeoff, and follow the landing.", "--launch")
    ] = False,
) -> None:
    """Plan a flight: from a problem file (options override it), or from a URDF and options.

    The plan is proved for every instant of the flight, unless --no-certify. Exit code 0 where there is a
    plan; with --prove only where it was proved too.
    """
    from floatplan.arguments import one_of, without
    from floatplan.cli.option_values import is_robot, requested_problem
    from floatplan.cli.results import ResultFile, check_directory, write_problem, write_results
    from floatplan.plans.trajectory import sample_times

    one_of(*CHOICES["method"])(method, "--method")
    if method == "reference" and (starts != 1 or budget is not None):
        reason = "the reference method takes no --starts or --budget"
        raise InputError(reason, element="--method", advice="leave these out")
    if prove and not certify:
        raise InputError("nothing is proved with --no-certify", element="--prove", advice="leave one of the two out")
    problem = requested_problem(source, options, choices, degrees)
    directory = runs_folder(problem.name, "flight") if output is None else output
    check_directory(directory)
    sample_times(problem.flight.duration, rate)
    if launch:
        from floatplan.jumps.launches.launch import launches

        common.needs_casadi("--launch")
    with log_on_stderr(verbose), progress("planning", quiet, tell=True) as bar:
        if method == "reference":
            result = _by_reference(problem, seed, certify, source)
        else:
            result = fp.plan(problem, seed=seed, starts=starts, budget=budget, progress=bar.say, prove=certify)
    with progress("stances", quiet, tell=True) as bar:
        stances, of_stances = launches(result, seed, progress=bar.say) if launch and result.ok else ([], {})
    with progress("writing", quiet):
        files = write_results(result, directory, rate, tell=common.tell(quiet))
        if is_robot(source):
            files.append(write_problem(result, directory))
        if figures:
            from floatplan.view.figures.figures import save_figures

            files += save_figures(result, directory / ResultFile.FIGURES, compare=_without_obstacles(result, seed))
        if report:
            from floatplan.view.report.report import write_report

            files.append(write_report(result, directory / ResultFile.REPORT, stances))
    facts = without(result.record.to_dict(), ("problem",))
    facts |= {"launch": of_stances} if launch else {}
    proved = result.certificate is not None and result.certificate.proved
    ok = result.ok and (proved or not prove)
    words = (result, files, common.program(), stances)
    common.finish(facts, json_output, lambda summary: summary.plan_summary(*words), ok, summary_shown=not quiet)


def _by_reference(problem: fp.Problem, seed: int, certify: bool, source: str) -> fp.Plan:
    """Plan by :func:`floatplan.method.plan`, and prove the plan that results; what is refused names the source."""
    from floatplan.planning.repair import judged

    with naming(source):
        result = fp.method.plan(problem, seed=seed)
    return judged(result, fp.certify(result)) if certify and result.ok else result


def _without_obstacles(result: fp.Plan, seed: int) -> fp.Plan | None:
    """Return a plan of the problem without its obstacles, for the pictures, if there soon is one and hits them."""
    from floatplan.view.figures.snapshots import worst_passage

    if not result.problem.obstacles:
        return None
    unobstructed = fp.plan(replace(result.problem, obstacles=()), seed=seed, budget=COMPARISON_BUDGET)
    return unobstructed if unobstructed.ok and worst_passage(result, unobstructed)[1] is not None else None


def jump(
    problem_file: common.ProblemFile,
    output: common.Output = None,
    seed: Seed = 0,
    starts: Starts = 4,
    report: Annotated[
        bool | None, flag("Write the page; the default unless with --json.", "--report/--no-report")
    ] = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
) -> None:
    """Plan a whole jump: from standing through a flight to standing again.

    Its flight is proved for every instant; its stances are checked 2000 times a second, which is no proof. Writes
    jump.json, the flight's plan.json, and report.html, a page that plays it. Exit code 0 only where there is a jump,
    proved and checked so.
    """
    from floatplan.cli.results import ResultFile, check_directory, write_jump

    problem = fp.load_problem(problem_file)
    directory = runs_folder(problem.name, "jump") if output is None else output
    check_directory(directory)
    start_time = time.perf_counter()
    with progress("jump", quiet, tell=True) as bar, naming(problem_file):
        planned = fp.jump(problem, seed=seed, starts=starts, progress=bar.say)
        if planned.flights:
            bar.say("proving the flight")
            planned = planned.with_certificate(*map(fp.certify, planned.flights))
    files = write_jump(planned, directory, common.tell(quiet))
    if (report or (report is None and not json_output)) and planned.flight is not None:
        files.append(planned.show(directory / ResultFile.REPORT, browse=False))
    words = (planned, files, time.perf_counter() - start_time, common.program())
    ok = planned.ok and planned.proved
    common.finish(
        planned.to_dict(), json_output, lambda summary: summary.jump_summary(*words), ok, summary_shown=not quiet
    )


def takeoff(problem_file: common.ProblemFile, json_output: common.Json = False) -> None:
    """Tell whether joint rates within their limits let the frame leave and meet the ground with zero speed.

    Looked at are the rates at these two instants, with one angular momentum for both; not how the robot gets there from
    rest, nor forces and balance. Exit code 1 where the rates are beyond their limits at one of the ends.
    """
    from floatplan.motion.flight import no_common_momentum

    problem = fp.load_problem(problem_file)
    ends = fp.takeoff(problem), fp.landing(problem)
    disagreement = no_common_momentum(problem)
    of_ends = {str(contact.end): contact.to_dict() for contact in ends}
    facts = {"joints": list(problem.robot.joints), **of_ends, "no_common_momentum": disagreement}
    ok = all(contact.ok for contact in ends) and disagreement is None
    common.finish(facts, json_output, lambda summary: summary.contact_summary(ends, disagreement), ok)


def launch(
    plan_file: common.PlanFile,
    urdf: common.Urdf = None,
    landing: Annotated[bool, flag("From the plan's landing to standing still, instead.", "--landing")] = False,
    friction: Annotated[float | None, common.key_option("MU", "jump.friction")] = None,
    seed: Seed = 0,
    starts: Starts = 3,
    json_output: common.Json = False,
) -> None:
    """Search for a stance within the limits that ends in a plan's takeoff, and tell what is to spare.

    A stance is checked 2000 times a second. Exit code 1 without one: that is no proof that there is none.
    """
    plan = fp.load_plan(plan_file, urdf)
    request = plan.problem.jump or fp.JumpRequest(feet="points")  # a flight alone knows frames, no feet
    if friction is not None:
        request = replace(request, friction=friction)
    end: Literal["takeoff", "landing"] = "landing" if landing else "takeoff"
    with progress(f"{end} stance", tell=True) as bar, naming(plan_file):
        result = fp.launch(plan, request, end=end, seed=seed, starts=starts, progress=bar.say)
    facts = {"friction": request.friction, **result.to_dict(), "figures": result.figures}
    common.finish(facts, json_output, lambda summary: summary.launch_summary(result), result.ok)


COMMANDS = (  # in the order in which --help lists them
    *(plan, robots.bounds, robots.info, motions.certify, motions.replay, robots.robots, robots.schema, motions.show),
    *(motions.export, study, merge, studio, jump, launch, takeoff, robots.init),
    *(clips.clip_check, clips.clip_repair, clips.bench, pack.motions, pack.motions_get),
)
TWO_WORDS: Mapping[object, str] = {
    merge: "study merge",
    clips.clip_check: "clip check",
    clips.clip_repair: "clip repair",
    pack.motions_get: "motions get",
}
OF_THEIR_OWN = {robots.info: robots.InfoCommand, motions.export: motions.ExportCommand}
for command in COMMANDS:
    typed = common.reporting_errors(common.with_options(command))
    app.command(TWO_WORDS.get(command), cls=OF_THEIR_OWN.get(command, common.Command))(typed)
