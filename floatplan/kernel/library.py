"""The compiled kernel, loaded: found beside this file."""

from __future__ import annotations

import ctypes
import struct
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from floatplan.errors import InputError
from floatplan.kernel.build import FOLDER, LIBRARY, sources_digest
from floatplan.kernel.layout import FUNCTIONS

INSTRUCTIONS = ("baseline instructions", "AVX2", "AVX-512")


class Kernel(SimpleNamespace):
    """The library, loaded: its functions as ``kernel.cpp`` exports them."""

    instructions: Any

    def __init__(self, library: ctypes.CDLL) -> None:
        super().__init__()
        for name, (returned, arguments) in FUNCTIONS.items():
            exported = getattr(library, f"floatplan_{name}")
            exported.restype, exported.argtypes = returned, arguments
            setattr(self, name, exported)
        self.instructions = int(self.instructions())


def _is_cut_off(path: Path) -> bool:
    """Whether a library for Linux ends before its contents do: whoever loads that is killed by the system."""
    with path.open("rb") as file:
        head = file.read(64)
        if len(head) < 64 or not head.startswith(b"\x7fELF"):
            return False  # the loader says what is wrong
        sections, size, count = (*struct.unpack_from("=Q", head, 40), *struct.unpack_from("=2H", head, 58))
        return bool(path.stat().st_size < sections + size * count)  # their table is what a linker writes last


@cache
def kernel() -> Kernel:
    """Return the compiled kernel.

    Raises
    ------
    InputError
        It is not there or cannot be loaded: the installation is not complete.
    """
    path, reason = FOLDER / LIBRARY, "not compiled"
    try:
        if path.is_file():
            reason = "damaged: python -m floatplan.kernel.build"
            if not _is_cut_off(path):
                loaded = Kernel(ctypes.CDLL(str(path)))
                if loaded.sources().decode() == sources_digest():
                    return loaded
                reason = "compiled from other sources: python -m floatplan.kernel.build"
    except (OSError, AttributeError) as error:
        reason = f"cannot be loaded: {error}"
    raise InputError(f"the kernel cannot be used: {reason}", advice="install floatplan again")


def description() -> str:
    """Say in a few words what makes plans without inequalities."""
    return f"compiled kernel ({INSTRUCTIONS[kernel().instructions]})"
