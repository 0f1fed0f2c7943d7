"""Compiles the kernel: at installation by ``hatch_build.py``, and by hand with ``python -m floatplan.kernel.build``.

Standard library alone, but for cffi where that is installed: an installation runs it before there is anything else.
"""

import contextlib
import fcntl
import hashlib
import importlib.util
import io
import os
import platform
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SOURCES = tuple(sorted(path.name for path in FOLDER.iterdir() if path.suffix in (".h", ".hpp", ".cpp")))
HEADER = "kernel.h"
DECLARATIONS = "_declarations.py"  # the header as cffi has read it
UNITS = ("avx512.cpp", "avx2.cpp", "baseline.cpp", "dispatch.cpp")  # compiled side by side, the longest first
LIBRARY = "_kernel.so"  # also on macOS: ctypes does not care
WHEEL = "ziglang"  # a package that is a compiler, for machines that have none
COMPILE_FLAGS = (
    "-std=c++17",
    # Of what GCC's -O3 adds, these two are all that plans notice; the rest takes as long to compile as everything else.
    "-O2",
    "-fpeel-loops",
    "-funswitch-loops",
    "-fPIC",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-exceptions",
    "-fno-rtti",
    "-fvisibility=hidden",
)
LINK_FLAGS = ("-shared", *(("-Wl,--as-needed",) if sys.platform == "linux" else ()))  # no C++ library is needed
LONGEST = 900  # [s] that compiling may take


class CompilerError(RuntimeError):
    """There is no kernel to be had: no compiler, or it failed."""


def sources_digest() -> str:
    """Digest of the sources: a library that was compiled from others is not used."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((FOLDER / name).read_bytes())
    return digest.hexdigest()[:16]


def header_digest() -> str:
    """Digest of the header: declarations that were read from another are not used."""
    return hashlib.sha256((FOLDER / HEADER).read_bytes()).hexdigest()[:16]


def declarations() -> str:
    """Return the header as cffi has read it: the text of a Python module with an ``ffi`` and the header's digest.

    Raises
    ------
    ImportError
        cffi is not installed.
    """
    from cffi import FFI

    lines = (FOLDER / HEADER).read_text(encoding="utf-8").splitlines()
    declared = FFI()
    declared.cdef("\n".join(line for line in lines if not line.startswith("#")))
    declared.set_source(Path(DECLARATIONS).stem, None)
    module = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()):  # cffi says what it writes
        declared.emit_python_code(module)
    return f'{module.getvalue()}HEADER = "{header_digest()}"\n'


def keep_declarations(folder: Path = FOLDER) -> None:
    """Write that module, so that the header, which takes 60 ms, is not read at each start.

    Where cffi is not installed yet, nothing is written.
    """
    with contextlib.suppress(ImportError), tempfile.TemporaryDirectory(dir=folder) as scratch:
        written = Path(scratch, DECLARATIONS)
        written.write_text(declarations(), encoding="utf-8")
        written.replace(folder / DECLARATIONS)


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
    if asked:
        return asked
    for name in ("c++", "g++", "clang++"):
        if _answers(name):
            return [name]
    return None


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
    compiler_command = command()
    architecture = shlex.split(os.environ.get("ARCHFLAGS", ""))  # of macOS
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        caches = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), scratch)
        environment = {**os.environ, **caches}
        digests = (f'-DFLOATPLAN_SOURCES="{sources_digest()}"', f'-DFLOATPLAN_BUILD="{_build_digest()}"')
        objects = []
        commands = []
        for unit in UNITS:
            made = str(Path(scratch, unit).with_suffix(".o"))
            objects.append(made)
            source = str(FOLDER / unit)
            commands.append([*compiler_command, *COMPILE_FLAGS, *digests, *architecture, "-c", source, "-o", made])
        _run_side_by_side(commands, environment)
        library = Path(scratch, LIBRARY)
        link = [*compiler_command, *LINK_FLAGS, *architecture, *objects, "-o", str(library)]
        _run_side_by_side([link], environment)
        if not library.is_file():
            raise CompilerError(f"{shlex.join(compiler_command)} ends without an error and without a library")
        library.replace(folder / LIBRARY)
    return folder / LIBRARY


def build_if_needed(folder: Path = FOLDER) -> Path:
    """Compile the kernel unless its library is there, of these sources and by this compiler.

    While another process does the same, wait for it and take what it has made.

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
    library = folder / LIBRARY
    with _locked(folder):
        if library.is_file() and not is_cut_off(library) and _build_digest().encode() in library.read_bytes():
            return library
        return build(folder)


def is_cut_off(library: Path) -> bool:
    """Whether a library for Linux ends before its contents do: whoever loads that is killed by the system."""
    with library.open("rb") as file:
        head = file.read(64)
        if len(head) < 64 or not head.startswith(b"\x7fELF"):
            return False  # the loader says what is wrong
        sections, size, count = (*struct.unpack_from("=Q", head, 40), *struct.unpack_from("=2H", head, 58))
        return bool(library.stat().st_size < sections + size * count)  # their table is what a linker writes last


def _build_digest() -> str:
    """Digest of all that makes a library what it is: sources, compiler, its flags, and the machine it compiles for."""
    compiler_command = command()
    version = subprocess.run([*compiler_command, "--version"], capture_output=True, text=True).stdout
    parts = (
        sources_digest(),
        *compiler_command,
        version,
        *COMPILE_FLAGS,
        *LINK_FLAGS,
        os.environ.get("ARCHFLAGS", ""),
        platform.machine(),
    )
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold a folder, so that one process at a time compiles into it; the system lets go of it when the process ends."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # not every file system has locks: then both compile, and either is taken
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _run_side_by_side(commands: Sequence[Sequence[str]], environment: dict[str, str]) -> None:
    """Run commands of the compiler at the same time; where one fails, the others end."""
    try:
        with contextlib.ExitStack() as stack:
            with _without_interrupts():  # one whose start was interrupted would not be known yet, and go on
                processes = [stack.enter_context(_running(each, environment)) for each in commands]
            for process in processes:
                _, errors = process.communicate(timeout=LONGEST)
                if process.returncode:
                    raise subprocess.CalledProcessError(process.returncode, process.args, stderr=errors)
    except (OSError, subprocess.SubprocessError) as error:
        reason = (getattr(error, "stderr", None) or str(error)).strip().splitlines()[:5]
        raise CompilerError("\n".join((f"{shlex.join(command())} cannot compile the kernel:", *reason))) from error


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let signals that end this process come after this; what starts in it inherits that, and is ended by a kill."""
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextlib.contextmanager
def _running(arguments: Sequence[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Run a command while this lasts; what is left of it then is killed, with the processes that it has started."""
    with subprocess.Popen(
        arguments,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def main(arguments: Sequence[str]) -> None:
    """Compile the kernel in place; with ``--if-needed`` only where there is none of these sources by this compiler."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that nothing is left behind
    try:
        if "--if-needed" in arguments:
            build_if_needed()
        else:
            build()
        keep_declarations()
    except CompilerError as error:
        sys.exit(f"floatplan: {error}")


if __name__ == "__main__":
    main(sys.argv[1:])
