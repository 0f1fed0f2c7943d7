"""The compiled kernel, loaded: found beside this file."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.kernel.build import FOLDER, LIBRARY, sources_digest
from floatplan.kernel.layout import FUNCTIONS

INSTRUCTIONS = ("baseline instructions", "AVX2", "AVX-512")


class Kernel:
    """The library, loaded: its functions as ``kernel.cpp`` exports them."""

    plan: Callable[..., int]
    flight: Callable[..., None]
    peaks: Callable[..., int]
    motion_room: Callable[..., int]
    rows: Callable[..., None]
    flight_room: Callable[..., int]
    minima: Callable[..., int]
    quadratic: Callable[..., int]

    def __init__(self, library: ctypes.CDLL) -> None:
        exported: dict[str, Any] = {}
        for name, (returned, arguments) in FUNCTIONS.items():
            exported[name] = getattr(library, f"floatplan_{name}")
            exported[name].restype, exported[name].argtypes = returned, arguments
        vars(self).update(exported)
        self.instructions = int(exported["instructions"]())


def _is_cut_off(path: Path) -> bool:
    """Whether a library for Linux ends before its contents do: whoever loads that is killed by the system."""
    with path.open("rb") as file:
        head = file.read(64)
        if len(head) < 64 or not head.startswith(b"\x7fELF"):
            return False  # the loader says what is wrong
        sections, size, count = (*struct.unpack_from("=Q", head, 40), *struct.unpack_from("=2H", head, 58))
        return bool(path.stat().st_size < sections + size * count)  # their table is what a linker writes last


@cache
def _loaded() -> tuple[Kernel | None, str]:
    """The kernel, and why it is not there."""
    path = FOLDER / LIBRARY
    if not path.is_file():
        return None, "not compiled"
    try:
        if _is_cut_off(path):
            return None, "damaged: python -m floatplan.kernel.build"
        library = ctypes.CDLL(str(path))
        library.floatplan_sources.restype = ctypes.c_char_p
        if library.floatplan_sources().decode() != sources_digest():
            return None, "compiled from other sources: python -m floatplan.kernel.build"
        return Kernel(library), ""
    except (OSError, AttributeError) as error:
        return None, f"cannot be loaded: {error}"


def kernel() -> Kernel:
    """Return the compiled kernel.

    Raises
    ------
    InputError
        It is not there or cannot be loaded: the installation is not complete.
    """
    found, reason = _loaded()
    if found is None:
        raise InputError(f"the kernel cannot be used: {reason}", advice="install floatplan again")
    return found


def description() -> str:
    """Say in a few words what makes plans without inequalities."""
    return f"compiled kernel ({INSTRUCTIONS[kernel().instructions]})"
