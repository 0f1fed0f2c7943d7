"""What a plan shows and writes of itself: pictures and exports, loaded by name when they are asked for.

The one place where a lower room calls upper ones: whoever has a plan wants to look at it, and who only plans need not
load what draws.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

PLACES = {
    "figures": "floatplan.view.figures.figures",
    "animate": "floatplan.view.figures.animation",
    "write_report": "floatplan.view.report.report",
    "notebook_frame": "floatplan.view.report.report",
    "export": "floatplan.export.formats",
}


def output(name: str) -> Callable[..., Any]:
    """Return the function of that name; :data:`PLACES` has all of them."""
    function: Callable[..., Any] = getattr(import_module(PLACES[name]), name)
    return function
