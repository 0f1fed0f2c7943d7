"""The robots and problems that come with floatplan, by the same names wherever it is installed and is called."""

from __future__ import annotations

import os
from pathlib import Path

import typer

from floatplan.files import is_file

PACKAGE = Path(__file__).resolve().parents[1]
ABOVE = (PACKAGE / "data", PACKAGE.parent)  # folders that hold those of KINDS: in a wheel, in a clone
KINDS = ("urdf", "problems")


def folder() -> Path | None:
    """The folder above ``urdf/`` and ``problems/``; None where they were left out."""
    return next((place for place in ABOVE if all((place / kind).is_dir() for kind in KINDS)), None)


def own_urdfs() -> list[str]:
    """The URDFs that come with floatplan, as commands take them."""
    place = folder()
    return [] if place is None else sorted(f"urdf/{path.name}" for path in place.glob("urdf/*.urdf"))


def found(source: str) -> str:
    """The path of a file; where there is none, that of the robot or problem of this name that comes with floatplan."""
    place, path = folder(), Path(source)
    if place is None or path.is_absolute() or ".." in path.parts or path.parts[:1] not in [(kind,) for kind in KINDS]:
        return source
    return str(place / path) if not os.path.lexists(path) and is_file(place / path) else source


def argument(metavar: str, text: str) -> typer.models.ArgumentInfo:
    """An argument of a command that names a robot or a problem."""
    info: typer.models.ArgumentInfo = typer.Argument(metavar=metavar, help=text, callback=found)
    return info
