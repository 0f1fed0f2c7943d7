"""The command ``floatplan init``: a problem file for any robot, which plans as it stands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from floatplan.cli.bundled import argument
from floatplan.cli.common import Quiet, reporting_errors
from floatplan.errors import InputError


@reporting_errors
def init(
    robot: Annotated[str, argument("ROBOT", "A URDF file, or example-robot-data:PATH.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.toml", help="Left out, <robot>.toml here.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the postures tried.")] = 0,
    quiet: Quiet = False,
) -> None:
    """Write a problem file for a robot: a flip from feet at rest to feet at rest, else the largest turn found.

    The file plans as it stands: floatplan plan FILE.toml proves its flight, without warnings. It says what was found:
    plane, joints with their ranges, couplings, feet, and the limits of the URDF. Of takeoff and landing the joint rates
    at that instant are checked; whether the legs have the stroke, the force and the balance for it is not.
    """
    from floatplan.files import write_atomically
    from floatplan.initial.flight import first_flight
    from floatplan.initial.robots import chosen_robot
    from floatplan.initial.text import problem_file_text

    path = Path(f"{Path(robot).stem}.toml") if output is None else output
    if path.suffix != ".toml":
        raise InputError("a problem file ends in .toml", source=path, element="--output")
    if path.exists() and not force:
        raise InputError(
            "is there already", source=path, advice="give --force to overwrite it, or another name with -o"
        )

    def progress(message: str) -> None:
        if not quiet:
            typer.echo(message, err=True)

    chosen = chosen_robot(robot)
    text = problem_file_text(chosen, first_flight(chosen, seed=seed, progress=progress), path)
    write_atomically(path, text)
    if not quiet:
        typer.echo(f"{path}: {text.splitlines()[0].removeprefix('# ')}", err=True)
        typer.echo(f"next: floatplan plan {path}", err=True)
