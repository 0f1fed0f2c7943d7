"""Compiles the kernel: at installation by ``hatch_build.py``, and by hand with ``python -m floatplan.kernel.build``.

Standard library alone: an installation runs it before there is anything else.
"""

import hashlib
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SOURCES = tuple(sorted(path.name for kind in ("*.hpp", "*.cpp") for path in FOLDER.glob(kind)))
LIBRARY = "_kernel.so"  # also on macOS: ctypes does not care
COMPILERS = ("c++", "g++", "clang++")
WHEEL = "ziglang"  # a package that is a compiler, for machines that have none
FLAGS = (
    "-std=c++17",
    "-O3",
    "-fPIC",
    "-shared",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-exceptions",
    "-fno-rtti",
    "-fvisibility=hidden",
)
LONGEST = 900  # [s] that compiling may take


class CompilerError(RuntimeError):
    """There is no kernel to be had: no compiler, or it failed."""


def sources_digest() -> str:
    """Digest of the sources: a library that was compiled from others is not used."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((FOLDER / name).read_bytes())
    return digest.hexdigest()[:16]


def compiler() -> list[str] | None:
    """Command of this machine's C++ compiler: that of the variable CXX, or a usual one; None where there is none.

    Raises
    ------
    CompilerError
        CXX names no command.
    """
    asked = shlex.split(os.environ.get("CXX", ""))
    if asked and not shutil.which(asked[0]):
        raise CompilerError(f"CXX names no C++ compiler: there is no command {asked[0]}")
    return asked or next(([name] for name in COMPILERS if _answers(name)), None)


def _answers(name: str) -> bool:
    """Whether a command is one: that of macOS only says where a compiler is to be had."""
    return bool(shutil.which(name)) and subprocess.run([name, "--version"], capture_output=True).returncode == 0


def command() -> list[str]:
    """Command that compiles: this machine's compiler, or that of the package ``ziglang``.

    Raises
    ------
    CompilerError
        There is neither.
    """
    found = compiler()
    if found is None and importlib.util.find_spec(WHEEL) is None:
        raise CompilerError(f"there is no C++ compiler: install one, as g++ or clang++, or the Python package {WHEEL}")
    return found or [sys.executable, "-m", WHEEL, "c++", "-mcpu=baseline", "-s"]


def build(folder: Path = FOLDER) -> Path:
    """Compile the kernel into a folder, whole or not at all.

    Parameters
    ----------
    folder : path

    Returns
    -------
    Path
        The library.

    Raises
    ------
    CompilerError
        There is no compiler, or it fails.
    """
    compile_ = command()
    flags = [*FLAGS, f'-DFLOATPLAN_SOURCES="{sources_digest()}"', *shlex.split(os.environ.get("ARCHFLAGS", ""))]
    if sys.platform == "linux":
        flags.append("-Wl,--as-needed")  # nothing of the C++ library is used
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        made = Path(scratch) / LIBRARY
        caches = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), scratch)
        try:
            subprocess.run(
                [*compile_, *flags, str(FOLDER / "kernel.cpp"), "-o", str(made)],
                check=True,
                capture_output=True,
                text=True,
                timeout=LONGEST,
                env={**os.environ, **caches},
            )
        except (OSError, subprocess.SubprocessError) as error:
            said = (getattr(error, "stderr", None) or str(error)).strip().splitlines()[:5]
            raise CompilerError("\n".join((f"{shlex.join(compile_)} cannot compile the kernel:", *said))) from error
        made.replace(folder / LIBRARY)
    return folder / LIBRARY


if __name__ == "__main__":
    try:
        build()
    except CompilerError as error:
        sys.exit(f"floatplan: {error}")
