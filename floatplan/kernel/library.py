"""The compiled kernel, loaded: the functions that ``kernel.h`` declares."""

from functools import cache
from types import SimpleNamespace
from typing import Any

from floatplan.errors import InstallationError
from floatplan.kernel.build import FOLDER, LIBRARY, is_cut_off, sources_digest
from floatplan.kernel.structs import FFI

SOURCES_DIGEST = sources_digest()  # a library that was compiled from other sources is not used
PREFIX = "floatplan_"  # of the functions' names


class Kernel(SimpleNamespace):
    """The functions of the library, and the widest set of ``instructions`` that this processor runs them with."""

    instructions: Any


@cache
def kernel() -> Kernel:
    """Return the compiled kernel.

    Raises
    ------
    InstallationError
        It is not there or cannot be loaded: the installation is not complete.
    """
    path, reason = FOLDER / LIBRARY, "not compiled"
    try:
        if path.is_file():
            reason = "damaged: python -m floatplan.kernel.build"
            if not is_cut_off(path):
                library = FFI.dlopen(str(path))
                names = [name for name in dir(library) if name.startswith(PREFIX)]
                functions = {name.removeprefix(PREFIX): getattr(library, name) for name in names}
                if FFI.string(functions["sources"]()).decode() == SOURCES_DIGEST:
                    functions["instructions"] = int(functions["instructions"]())
                    # The library is unloaded with the last reference to it, whatever becomes of its functions.
                    return Kernel(**functions, _library=library)
                reason = "compiled from other sources: python -m floatplan.kernel.build"
    except (OSError, AttributeError, KeyError) as error:
        reason = f"cannot be loaded: {error}"
    raise InstallationError(f"the kernel cannot be used: {reason}", advice="install floatplan again")


def description() -> str:
    """Say in a few words what makes plans, and with which instructions."""
    instructions = ("baseline instructions", "AVX2", "AVX-512")[kernel().instructions]
    return f"compiled kernel ({instructions})"
