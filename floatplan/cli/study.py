"""The command that makes many plans: ``study``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from floatplan.cli.common import DONE, FAILED, Json, Quiet, print_json, reporting_errors

if TYPE_CHECKING:
    from floatplan.studies.driver import Progress

LINE_EVERY = 5.0  # [s] of progress, where it is no terminal


@reporting_errors
def study(
    study_file: Annotated[str, typer.Argument(metavar="STUDY.toml", help="A study file.")],
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
    from floatplan.studies.study import study as run

    began = time.perf_counter()
    try:
        with _progress(quiet) as progress:
            done = run(
                study_file,
                folder=output,
                restart=restart,
                engine=engine,
                scheduler=scheduler,
                jobs=jobs,
                progress=progress,
            )
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on from here", err=True)
        raise typer.Exit(FAILED) from None
    if not quiet:
        for status, count in done.statuses.items():
            typer.echo(f"{count:>9} {status.replace('_', ' ')}", err=True)
        for path in done.files:
            typer.echo(str(path), err=True)
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


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[Progress], None] | None]:
    """Show the progress on stderr: one line that changes in a terminal, elsewhere a line now and then."""
    if quiet or sys.stderr is None:
        yield None
        return
    if sys.stderr.isatty():
        from rich.console import Console

        with Console(stderr=True).status("study") as status:
            yield lambda progress: status.update(f"study: {progress}")
        return
    told = time.monotonic()

    def tell(progress: Progress) -> None:
        nonlocal told
        if progress.done == progress.total or time.monotonic() - told >= LINE_EVERY:
            told = time.monotonic()
            typer.echo(f"study: {progress}", err=True)

    yield tell
