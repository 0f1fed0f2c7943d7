"""The commands of the motions that come with floatplan: ``motions`` lists them, ``motions get`` hands one on."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated

import typer

import floatplan as fp
from floatplan.cli import ExitCode, common
from floatplan.cli.common import flag, option
from floatplan.cli.progress import progress
from floatplan.errors import InputError
from floatplan.files import write_atomically

OF_PACK = "mjlab-npz"  # the format in which the pack has its motions


def motions(
    action: Annotated[str, typer.Argument(metavar="[list]", help="The same.")] = "list",
    robot: Annotated[str | None, option("NAME", "Only those of this robot.")] = None,
    json_output: common.Json = False,
) -> None:
    """List the motions that come with floatplan: flips, rolls, turns and hops of many robots.

    Each was planned, its flight proved, its stances checked; the shares are of the robot's limits, the landings those
    of floatplan bench.
    """
    if action != "list":
        raise InputError(f"there is no {action!r}", element="motions", advice="give list, or get NAME")
    rows = _index()
    chosen = [row for row in rows if robot in (None, row["robot"])]
    if not chosen:
        listed = ", ".join(dict.fromkeys(row["robot"] for row in rows))
        raise InputError(f"there is no robot {robot!r} in the pack", element="robot", advice=f"give one of {listed}")
    common.finish({"motions": chosen}, json_output, lambda summary: summary.pack_summary(chosen))


def motions_get(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of a motion, as floatplan motions lists it.")],
    form: Annotated[
        str, option("NAME", "toml, the problem file; or one of floatplan export.", "--format", "-f")
    ] = OF_PACK,
    rate: Annotated[float | None, option("HZ", "Instants per second; left out, what suits the format.")] = None,
    model: Annotated[str | None, option("FILE", common.MODEL)] = None,
    output: Annotated[
        Path | None, option("FILE", "The file; here, by its name, if left out.", "--output", "-o")
    ] = None,
    force: Annotated[bool, flag("Overwrite the file.", "--force")] = False,
    quiet: common.Quiet = False,
) -> None:
    """Write a motion of the pack to a file, in any format of floatplan export.

    toml and mjlab-npz at 50 Hz, without --model, are copies of the pack's files. For all else its problem is planned
    again, which takes some seconds, for a jump in space a minute, and the extra "jump".
    """
    names = [row["name"] for row in _index()]
    if name not in names:
        alike = [other for other in names if name.partition("_")[0] == other.partition("_")[0]]
        advice = f"give one of {', '.join(alike or names[:10])}{'' if alike else ', ..'}"
        raise InputError(f"there is no motion {name!r} in the pack", element="NAME", advice=advice)
    problem = _folder() / f"{name}.toml"
    is_problem = form == "toml"
    if is_problem and (rate is not None or model is not None):
        element = "--rate" if rate is not None else "--model"
        raise InputError("is for motions, not for problem files", element=element, advice="leave it out")
    ending = ".toml" if is_problem else _ending(form)
    path = output or Path(name + ending)
    if path.exists() and not force:
        raise InputError("exists", source=path, element="--output", advice="add --force to overwrite it")
    if is_problem:
        fp.save_problem(fp.load_problem(problem), path)  # with the path of the robot's file from there
    elif form == OF_PACK and rate in (None, 50.0) and model is None:
        write_atomically(path, problem.with_suffix(".npz").read_bytes())
    else:
        with progress("planning", quiet, tell=True) as bar:
            jump = fp.jump(fp.load_problem(problem), progress=bar.say)
        common.check_model(form, model, jump.problem.robot, quiet)
        path = jump.export(form, path, rate, model=model)
    if not quiet:
        common.print_path(path)
    raise typer.Exit(ExitCode.DONE)


def _ending(form: str) -> str:
    """The ending of files of a format; InputError where there is no such format."""
    from floatplan.export.formats import format_of

    return Path(format_of(form).file).suffix


def _folder() -> Path:
    """The folder of the pack."""
    above = common.folder()
    if above is None or not (above / "motions" / "index.csv").is_file():
        raise InputError("no motions come with this installation", advice="install floatplan from a wheel, or a clone")
    return above / "motions"


def _index() -> list[dict[str, str]]:
    """Rows of the pack's index, texts by its columns; what was not measured is empty."""
    with (_folder() / "index.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
