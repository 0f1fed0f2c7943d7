"""Packages that floatplan can do without: imported where they are used, with a message on how to install them."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from floatplan.errors import InputError


def import_optional(module: str, *, name: str, element: str, install: str) -> ModuleType:
    """Import a module.

    Parameters
    ----------
    module : str
    name : str
        What people call the package.
    element : str
        What it is needed for: the option or argument.
    install : str
        What pip is to install.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        advice = f"install it: pip install {install}"
        raise InputError(f"{name} is not installed", element=element, advice=advice) from None
