"""Compiles the kernel: at installation by ``hatch_build.py``, and by hand with ``python -m floatplan.kernel.build``.

Standard library alone: an installation runs it before there is anything else.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SOURCES = (
    *("kernel.hpp", "all.hpp", "lanes.hpp", "doubles.hpp", "planner.hpp", "scaling.hpp", "momentum.hpp", "sqp.hpp"),
    *("starts.hpp", "batch.hpp", "rest.hpp", "law.hpp", "flight.hpp", "peaks.hpp"),
    *("watch_kernel.hpp", "distances.hpp", "watch.hpp", "watch_slopes.hpp", "minima.hpp"),
    *("quadratic_kernel.hpp", "quadratic.hpp", "kernel.cpp"),
)
LIBRARY = "_kernel.so"  # also on macOS: ctypes does not care
COMPILERS = ("c++", "g++", "clang++")
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
LONGEST = 300  # [s] that compiling may take


def sources_digest() -> str:
    """Digest of the sources: a library that was compiled from others is not used."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((FOLDER / name).read_bytes())
    return digest.hexdigest()[:16]


def compiler() -> list[str] | None:
    """Command of the C++ compiler: that of the variable CXX, or one of the usual ones; None where there is none."""
    asked = shlex.split(os.environ.get("CXX", ""))
    if asked:
        return asked if shutil.which(asked[0]) else None
    return next(([name] for name in COMPILERS if shutil.which(name)), None)


def build(folder: Path = FOLDER) -> Path | None:
    """Compile the kernel into a folder, whole or not at all.

    Parameters
    ----------
    folder : path

    Returns
    -------
    Path or None
        The library; None, with a line on stderr, where no compiler is or it fails: floatplan then does without.
    """
    command = compiler()
    if command is None:
        print("floatplan: no C++ compiler found, so plans are made by the Python solver", file=sys.stderr)
        return None
    flags = [*FLAGS, f'-DFLOATPLAN_SOURCES="{sources_digest()}"', *shlex.split(os.environ.get("ARCHFLAGS", ""))]
    if sys.platform == "linux":
        flags.append("-Wl,--as-needed")  # nothing of the C++ library is used
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        made = Path(scratch) / LIBRARY
        try:
            subprocess.run(
                [*command, *flags, str(FOLDER / "kernel.cpp"), "-o", str(made)],
                check=True,
                capture_output=True,
                text=True,
                timeout=LONGEST,
            )
        except (OSError, subprocess.SubprocessError) as error:
            said = (getattr(error, "stderr", None) or str(error)).strip().splitlines()
            print(f"floatplan: {command[0]} failed, so plans are made by the Python solver:", file=sys.stderr)
            print(*said[:5], sep="\n", file=sys.stderr)
            return None
        made.replace(folder / LIBRARY)
    return folder / LIBRARY


if __name__ == "__main__":
    sys.exit(build() is None)
