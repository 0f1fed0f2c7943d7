"""The command ``floatplan studio``: a local page on which a flight is made by hand."""

from __future__ import annotations

import time
import webbrowser
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from floatplan.cli.common import DONE, Quiet, argument, reporting_errors, tell
from floatplan.errors import escaped

if TYPE_CHECKING:
    from floatplan.problem.problem import Problem

PORT = 8080


@reporting_errors
def studio(
    source: Annotated[str, argument("PROBLEM.toml|ROBOT", "A problem file, or a robot.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Where to save; runs/<name>/studio if left out."),
    ] = None,
    port: Annotated[int, typer.Option(min=1024, max=65535, help="Of the page; the next free one.")] = PORT,
    around: Annotated[bool, typer.Option("--map/--no-map", help="Plan around the present point too.")] = True,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    quiet: Quiet = False,
) -> None:
    """Make a flight by hand: a page on this machine that plans anew at each change.

    Drag the robot at takeoff and landing, obstacles, sliders; Ctrl-C ends it. A robot without a problem file begins
    with the flight that floatplan init finds.
    """
    from floatplan.errors import import_optional
    from floatplan.files import runs_folder
    from floatplan.studio.page import Studio

    import_optional("viser", name="viser", element="studio", extra="view")
    problem = _problem(source, quiet)
    directory = runs_folder(problem.name, "flight") / "studio" if output is None else output
    with closing(Studio(problem, folder=str(directory), port=port, with_map=around)) as page:
        typer.echo(f"{escaped(problem.name)}: {page.address} (Ctrl-C ends it)", err=True)
        if open_page:
            webbrowser.open(page.address)
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            raise typer.Exit(DONE) from None


def _problem(source: str, quiet: bool) -> Problem:
    """The problem of a file, or the first flight of a robot."""
    from floatplan.cli.asked import is_robot

    if not is_robot(source):
        from floatplan.problem.file import load_problem

        return load_problem(source)
    from floatplan.initial.flight import first_flight
    from floatplan.initial.robots import chosen_robot

    return first_flight(chosen_robot(source), seed=0, progress=tell(quiet)).problem
