"""Packages that floatplan can do without: imported where they are used, with a message on how to install them."""

from __future__ import annotations

import shlex
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

from floatplan.errors import InputError

CLONE = Path(__file__).resolve().parents[1]  # where pyproject.toml is, unless floatplan was installed as a wheel


def import_optional(module: str, *, name: str, element: str, extra: str) -> ModuleType:
    """Import a module.

    Parameters
    ----------
    module : str
    name : str
        What people call the package.
    element : str
        What it is needed for: the option or argument.
    extra : str
        The extra of floatplan that it belongs to.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        reason = f'{name} is not installed: it comes with the extra "{extra}"'
        raise InputError(reason, element=element, advice=install_advice(extra)) from None


def install_advice(extra: str) -> str:
    """The command that installs an extra where floatplan runs from: a clone, or an environment of its user."""
    if (CLONE / "pyproject.toml").is_file():
        requirement = f"-e {shlex.quote(f'{near(CLONE)}[{extra}]')}"
    else:
        requirement = f"'floatplan[{extra}]'"
    return f"install it: {shlex.quote(near(Path(sys.executable)))} -m pip install {requirement}"


def near(path: Path) -> str:
    """The path from the working directory, where it leads down from there."""
    try:
        near = path.relative_to(Path.cwd())
    except (ValueError, OSError):
        return str(path)
    return str(near) if near != Path() else "."
