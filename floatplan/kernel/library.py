"""The compiled kernel, loaded: the functions that ``kernel.h`` declares."""

from functools import cache
from types import SimpleNamespace
from typing import Any

from floatplan.errors import InputError
from floatplan.kernel.build import FOLDER, LIBRARY, is_cut_off, sources_digest
from floatplan.kernel.structs import FFI

PREFIX = "floatplan_"  # of the functions' names
INSTRUCTIONS = ("baseline instructions", "AVX2", "AVX-512")


class Kernel(SimpleNamespace):
    """The functions of the library, and the widest set of instructions that this processor runs them with."""

    instructions: Any

    def __init__(self, library: Any) -> None:
        names = [name for name in dir(library) if name.startswith(PREFIX)]
        super().__init__(**{name.removeprefix(PREFIX): getattr(library, name) for name in names})
        self._library = library  # which is unloaded with the last reference to it, whatever becomes of its functions
        self.instructions = int(self.instructions())


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
            if not is_cut_off(path):
                loaded = Kernel(FFI.dlopen(str(path)))
                if FFI.string(loaded.sources()).decode() == sources_digest():
                    return loaded
                reason = "compiled from other sources: python -m floatplan.kernel.build"
    except (OSError, AttributeError) as error:
        reason = f"cannot be loaded: {error}"
    raise InputError(f"the kernel cannot be used: {reason}", advice="install floatplan again")


def description() -> str:
    """Say in a few words what makes plans without inequalities."""
    return f"compiled kernel ({INSTRUCTIONS[kernel().instructions]})"
