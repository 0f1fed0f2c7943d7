"""Robots of the package ``example-robot-data``, named ``example-robot-data:<path of the URDF in it>``."""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

from floatplan.errors import InputError, install_advice
from floatplan.files import is_file

PREFIX = "example-robot-data:"
FOLDER = Path("share", "example-robot-data", "robots")
FOLDER_VARIABLE = "EXAMPLE_ROBOT_DATA_MODEL_DIR"  # of the environment: the folder "robots" itself
INSTALL_PREFIXES = ("/usr", "/usr/local", "/opt/openrobots")


def urdf_path(source: str | Path) -> Path:
    """Return the file that ``source`` means: a path, or ``example-robot-data:`` and a path in that package.

    Raises
    ------
    InputError
        If the package is not installed, or holds no such file.
    """
    if not isinstance(source, str) or not source.startswith(PREFIX):
        return Path(source)
    folder = robots_folder()
    if folder is None:
        advice = f'{install_advice("robots")}, or set {FOLDER_VARIABLE} to its folder "robots"'
        raise InputError("the package example-robot-data is not installed", source=source, advice=advice)
    name = source.removeprefix(PREFIX)
    path = folder / name
    if Path(name).is_absolute() or ".." in Path(name).parts or not is_file(path):
        raise InputError(f"example-robot-data has no file {name!r}", source=source, advice=_similar(folder, name))
    return path


def robots_folder() -> Path | None:
    """Return the folder ``robots`` of example-robot-data, None where it is not installed.

    Looked for in the environment variable, in the installed package's list of files, and in the share folders of the
    interpreter, of ROS and of the system.
    """
    return next((folder for folder in _candidates() if folder.is_dir()), None)


def example_urdfs() -> tuple[str, ...]:
    """Names, without the prefix, of all URDFs in the package; empty where it is not installed."""
    folder = robots_folder()
    if folder is None:
        return ()
    return tuple(sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.urdf")))


def _candidates() -> Iterator[Path]:
    if given := os.environ.get(FOLDER_VARIABLE):
        yield Path(given)
    if (folder := _of_distribution()) is not None:
        yield folder
    prefixes = [sys.prefix, *os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), *INSTALL_PREFIXES]
    yield from (Path(prefix) / FOLDER for prefix in prefixes if prefix)


@cache
def _of_distribution() -> Path | None:
    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        return None
    for file in files:
        if file.suffix == ".urdf" and "robots" in file.parts:
            depth = len(file.parts) - 1 - file.parts.index("robots")
            return Path(str(file.locate())).parents[depth - 1]
    return None


def _similar(folder: Path, name: str) -> str | None:
    names = example_urdfs()
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    stem = Path(name).stem.lower()
    close += [known for known in names if stem in known.lower() and known not in close][:3]
    return f"it has {', '.join(close)}" if close else f"its robots are in {folder}"
