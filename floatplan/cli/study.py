"""The command that makes many plans: ``study``."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from floatplan.cli.common import DONE, FAILED, Json, Quiet, argument, print_json, print_path, reporting_errors
from floatplan.cli.progress import ProgressBar, progress

if TYPE_CHECKING:
    from floatplan.studies.driver import Progress

EVERY = 2.0  # [s] words about the progress


@reporting_errors
def study(
    study_file: Annotated[str, argument("STUDY.toml", "A study file.")],
    restart: Annotated[bool, typer.Option("--restart", help="Discard what the folder has, and begin again.")] = False,
    engine: Annotated[
        str, typer.Option(metavar="NAME", help="'processes' of this machine, or 'dask' for many machines.")
    ] = "processes",
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of dask's scheduler; a cluster on this machine if left out.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes; as many as processors if left out.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Where results go; else as the file says.")
    ] = None,
    json_output: Json = False,
    quiet: Quiet = False,
) -> None:
    """Plan a problem for many values of its numbers, and map what was found; go on where an earlier run ended.

    Exit code 0 once every row has a status, whatever it is.
    """
    from floatplan.pool import get_ready

    began = time.perf_counter()
    try:
        if engine == "processes" and jobs != 1:
            get_ready("floatplan.studies.study")
        from floatplan.studies.study import study as run

        with progress("study", quiet, tell=True) as bar:
            done = run(
                study_file,
                folder=output,
                restart=restart,
                engine=engine,
                scheduler=scheduler,
                jobs=jobs,
                progress=_teller(bar),
            )
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on from here", err=True)
        raise typer.Exit(FAILED) from None
    if not quiet:
        for status, count in done.statuses.items():
            typer.echo(f"{count:>9} {status.replace('_', ' ')}", err=json_output)
        for path in done.files:
            print_path(path, err=json_output)
    if json_output:
        print_json(
            {
                "folder": str(done.folder),
                "rows": len(done),
                "statuses": done.statuses,
                "files": [str(path) for path in done.files],
                "seconds": time.perf_counter() - began,
            }
        )
    raise typer.Exit(DONE)


def _teller(bar: ProgressBar) -> Callable[[Progress], None]:
    """Tell a bar how far it is; a line now and then where there is no terminal."""
    told = time.monotonic()

    def tell(reached: Progress) -> None:
        nonlocal told
        bar.reach(reached.done, reached.total)
        if reached.done == reached.total or time.monotonic() - told >= EVERY:
            told = time.monotonic()
            bar.say(str(reached))

    return tell
