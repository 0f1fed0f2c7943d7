"""The files of a plan: plan.json, trajectory.csv, figures, and problem.toml where there was no problem file."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import floatplan as fp
from floatplan.errors import InputError
from floatplan.export.table import table_text
from floatplan.files import check_readable, write_all, write_atomically
from floatplan.problem.file import problem_text
from floatplan.tables import LIMIT_TABLE

PLAN = "plan.json"
JUMP = "jump.json"
TRAJECTORY = "trajectory.csv"
PROBLEM = "problem.toml"
FIGURES = "figures"
SCHEMA_FILE = "floatplan.schema.json"  # next to problem files, where floatplan schema wrote it
OF_JUMPS = ("moments", "contacts", "forces", "friction", "torque_use", "held_use", "rate_use", "com_height")
FIGURE_NAMES = ("snapshots", "kinogram", "comparison", "configuration", "momentum", "inertia", "clearance", *OF_JUMPS)
REPORT = "report.html"
SCENE = "scene.html"
FILM = "flight"


def check_directory(directory: Path) -> None:
    """Check, before a search and without writing, that results can go there.

    Raises
    ------
    InputError
        It is a file, lies under a file, cannot be written to, or holds folders where the files should go, or files
        that cannot be read.
    """
    check_folder(directory)
    for name in (PLAN, JUMP, TRAJECTORY, PROBLEM, REPORT, SCENE, f"{FILM}.gif", f"{FILM}.mp4"):
        if (directory / name).is_dir():
            raise _unsuitable(directory, f"{name} is a directory there")
        check_readable(directory / name, "is not replaced")
    if os.path.lexists(directory / FIGURES) and not (directory / FIGURES).is_dir():
        raise _unsuitable(directory, f"{FIGURES} is not a directory there")


def check_folder(directory: Path) -> None:
    """Check, before a search and without writing, that a file can be made in a folder, or in one that is made first.

    Raises
    ------
    InputError
        It is a file, lies under a file, or cannot be written to.
    """
    existing = directory.absolute()
    while not os.path.lexists(existing):
        existing = existing.parent
    if not existing.is_dir():
        raise _unsuitable(directory, f"{existing} is not a directory")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise _unsuitable(directory, f"{existing} cannot be written to")


def _unsuitable(directory: Path, reason: str) -> InputError:
    return InputError(reason, source="--output", element=str(directory), advice="choose another directory")


def write_results(
    plan: fp.Plan, directory: Path, rate: float, tell: Callable[[str], object] | None = None
) -> list[Path]:
    """Write plan.json and trajectory.csv and replace an older run's results, and return their paths.

    Older results stay where the new ones cannot be written, and go before the first new one is renamed; ``tell``
    gets a sentence which they were.

    Raises
    ------
    InputError
        The directory cannot be written to.
    """
    contents = {directory / PLAN: plan.record.to_json(), directory / TRAJECTORY: table_text(plan, rate)}
    return write_all(contents, replacing=lambda: _remove_older(directory, tell))


def write_jump(jump: fp.Jump, directory: Path, tell: Callable[[str], object] | None = None) -> list[Path]:
    """Write jump.json and its flight's plan.json and replace an older run's results, and return their paths.

    Without a jump there is no plan, and that of an older jump goes. Errors as :func:`write_results`.
    """
    contents = {directory / JUMP: jump.to_json()}
    if jump.flight is not None:
        contents[directory / PLAN] = jump.flight.record.to_json()

    def replacing() -> None:
        was_jump = (directory / JUMP).is_file()
        _remove_older(directory, tell, except_for=(JUMP,))
        if was_jump and jump.flight is None:
            (directory / PLAN).unlink(missing_ok=True)

    return write_all(contents, replacing=replacing)


def _remove_older(directory: Path, tell: Callable[[str], object] | None, except_for: Sequence[str] = ()) -> None:
    """Remove what an older run made of its plan, so that nobody takes it for results of the new plan.

    Only files by their usual names, and only where that plan is still there; a problem file may be the user's own.
    """
    if not (directory / PLAN).is_file():
        return
    trajectory = directory / TRAJECTORY
    check_readable(trajectory, "is not removed")
    if {path.name for path in directory.glob("[!.]*")} <= {PLAN, TRAJECTORY, *except_for}:
        trajectory.unlink(missing_ok=True)
        return
    from floatplan.export.formats import FORMATS

    figure_names = {*FIGURE_NAMES, *(row.title.lower() for row in LIMIT_TABLE.values())}
    made = [directory / name for name in (JUMP, REPORT, SCENE, f"{FILM}.gif", f"{FILM}.mp4")]
    made += [directory / form.file for form in FORMATS.values()]
    for name in figure_names:
        made += [directory / FIGURES / f"{name}.png", directory / FIGURES / f"{name}.svg"]
    older = [path for path in made if path.is_file() and path.name not in (TRAJECTORY, *except_for)]
    for path in older:
        check_readable(path, "is not removed")
    for path in [trajectory, *older]:
        path.unlink(missing_ok=True)
    names = dict.fromkeys(path.relative_to(directory).parts[0] for path in older)
    if names and tell is not None:
        tell(f"{directory}: the plan there is replaced, and what was made of it removed: {', '.join(names)}")


def write_problem(plan: fp.Plan, directory: Path) -> Path:
    """Write problem.toml: the plan's problem, for one that came from no file; errors as :func:`write_results`."""
    path = directory / PROBLEM
    schema = f"#:schema ./{SCHEMA_FILE}\n" if (directory / SCHEMA_FILE).is_file() else ""
    return write_atomically(path, schema + problem_text(plan.problem, path))
