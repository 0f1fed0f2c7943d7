"""The commands that make many plans: ``study`` by itself, ``studio`` by hand, on a local page."""

from __future__ import annotations

import time
import webbrowser
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

import floatplan as fp
from floatplan.cli import ExitCode, common
from floatplan.cli.common import MODEL, choice_option, flag, key_option, option
from floatplan.cli.progress import progress
from floatplan.errors import InputError, escaped, import_optional
from floatplan.files import runs_folder

if TYPE_CHECKING:
    from floatplan.studies.driver import Progress

Output = Annotated[Path | None, key_option("DIR", "result.folder", "--output", "-o", more="It overrides the file's.")]


def study(
    study_file: Annotated[str, common.argument("STUDY.toml", "A study file.")],
    restart: Annotated[bool, flag("Discard what the folder has, and begin again.", "--restart")] = False,
    engine: Annotated[str, choice_option("workers")] = "processes",
    scheduler: Annotated[
        str | None, option("ADDRESS", "Of dask's scheduler; a cluster on this machine if left out.")
    ] = None,
    jobs: Annotated[int | None, option("N", "Processes; as many as processors if left out.", min=1)] = None,
    output: Output = None,
    shard: Annotated[
        str | None,
        option("K/N", "Plan the K-th of N shares of the rows alone, into a folder of its own: see study merge."),
    ] = None,
    export: Annotated[
        str | None,
        option(
            "NAME",
            "Write the motion of each row too, in a format of floatplan export, with an index. Jumps are planned "
            "again.",
        ),
    ] = None,
    rate: Annotated[float | None, option("HZ", "Of these files; left out, what suits the format.")] = None,
    model: Annotated[str | None, option("FILE", MODEL)] = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
) -> None:
    """Plan a problem for many values of its numbers, and map the results; go on where an earlier run stopped.

    Exit code 0 once every row has a status, whatever it is.
    """
    from floatplan.pool import start_server
    from floatplan.studies.driver import started
    from floatplan.studies.file import load_study_file
    from floatplan.studies.study import planned_study

    start_time = time.perf_counter()
    if export is not None and shard is not None:
        raise InputError("is for the whole study", element="export", advice="merge the shards first")
    if export is not None:  # before hours of work
        common.check_model(export, model, load_study_file(study_file).base.robot, quiet)
    elif rate is not None or model is not None:
        raise InputError("is for --export", element="--rate" if model is None else "--model", advice="add it")
    try:
        if engine == "processes" and jobs != 1:
            start_server("floatplan.studies.study")
        with progress("study", quiet, tell=True) as bar:
            chosen = started(engine, jobs, scheduler)

            def say(progress: Progress) -> None:
                bar.say_now_and_then(str(progress), progress.done, progress.total)

            done = planned_study(Path(study_file), output, restart, chosen, say, shard)
        if export is not None:
            with progress("exporting", quiet) as bar:
                done.files.append(done.export(export, rate, model=model, jobs=jobs, progress=bar.reach))
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on from here", err=True)
        raise typer.Exit(ExitCode.FAILED) from None
    _tell(done, start_time, json_output, quiet)


def merge(
    study_file: Annotated[str, common.argument("STUDY.toml", "A study file.")],
    shards: Annotated[
        list[Path] | None, typer.Argument(metavar="DIR", help="Of shards; those in the study's if left out.")
    ] = None,
    output: Output = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
) -> None:
    """Put the rows of all shards of a study into its table, and map the results.

    Exit code 2 where a shard is missing, not done, of another study, or there twice.
    """
    from floatplan.studies.shards import merged

    start_time = time.perf_counter()
    with progress("study", quiet):
        done = merged(Path(study_file), output, shards or [])
    _tell(done, start_time, json_output, quiet)


def _tell(done: fp.Study, start_time: float, json_output: bool, quiet: bool) -> NoReturn:
    """Print the results of a study and where it is, and exit."""
    if not quiet:
        for status, count in done.statuses.items():
            typer.echo(f"{count:>9} {status.replace('_', ' ')}", err=json_output)
        for path in done.files:
            common.print_path(path, err=json_output)
    if json_output:
        common.print_json(
            {
                "folder": str(done.folder),
                "rows": len(done),
                "statuses": done.statuses,
                "files": list(map(str, done.files)),
                "seconds": time.perf_counter() - start_time,
            }
        )
    raise typer.Exit(ExitCode.DONE)


def studio(
    source: Annotated[str, common.argument("PROBLEM.toml|ROBOT", "A problem file, or a robot.")],
    output: Annotated[
        Path | None, option("DIR", "Where to save; runs/<name>/studio if left out.", "--output", "-o")
    ] = None,
    port: Annotated[int, typer.Option(min=1024, max=65535, help="Of the page; the next free one.")] = 8080,
    around: Annotated[bool, flag("Plan around the present point too.", "--map/--no-map")] = True,
    open_page: common.OpenPage = False,
    quiet: common.Quiet = False,
) -> None:
    """Make a flight by hand: a page on this machine that plans anew at each change.

    Drag the robot at takeoff and landing, obstacles, sliders; Ctrl-C ends it. A robot without a problem file begins
    with the flight that floatplan init finds.
    """
    from floatplan.cli.option_values import is_robot
    from floatplan.studio.page import Studio

    import_optional("viser", name="viser", element="studio", extra="view")
    if is_robot(source):
        from floatplan.initial.flight import first_flight
        from floatplan.initial.robots import chosen_robot

        problem = first_flight(chosen_robot(source), seed=0, progress=common.tell(quiet)).problem
    else:
        problem = fp.load_problem(source)
    directory = runs_folder(problem.name, "flight") / "studio" if output is None else output
    with closing(Studio(problem, folder=str(directory), port=port, with_map=around)) as page:
        typer.echo(f"{escaped(problem.name)}: {page.address} (Ctrl-C ends it)", err=True)
        if open_page:
            webbrowser.open(page.address)
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            raise typer.Exit(ExitCode.DONE) from None
