"""Packages that floatplan does without until something needs them."""

from __future__ import annotations

import importlib
from types import ModuleType

from floatplan.errors import InputError


def optional_module(module: str, name: str, *, element: str, install: str) -> ModuleType:
    """Import a module that may not be there.

    Parameters
    ----------
    module, name : str
        What to import, and what people call it.
    element : str
        What asked for it.
    install : str
        What ``pip install`` is told.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        advice = f"install it: pip install {install}"
        raise InputError(f"{name} is not installed", element=element, advice=advice) from None
