"""Robots of other packages: a file in one, one of robot_descriptions by its name, and the URDF that a xacro file makes.

The latter two run code that is not floatplan's: a module that may clone a repository, and the expressions of a file. So
they run in a process of their own, for ``LONGEST`` seconds at most, with 2 GB, and Git brings nothing from other
machines. A file in a package is only looked up: the package is not imported.
"""

import difflib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from floatplan.errors import InputError, install_advice
from floatplan.files import LARGEST_URDF, is_file, read_regular
from floatplan.pool import same_modules
from floatplan.tables import ROBOT_KINDS, RobotKind

PACKAGE = "robot_descriptions"
ADDRESS = re.compile(rf"package:.*|(?:{PACKAGE}:)?\w+_description")  # a file in a package, or a robot of PACKAGE
LONGEST = 60.0  # [s] of a file that is expanded, or a module that is imported


def robot_content(path: Path) -> bytes:
    """Return the content of a robot's file; of a ``.xacro``, the URDF that it makes.

    Raises
    ------
    InputError
        The file cannot be read; xacrodoc is not installed, or refuses it.
    """
    content = read_regular(path, LARGEST_URDF, "a URDF file")
    if path.suffix.lower() != ".xacro":
        return content
    if find_spec("xacrodoc") is None:
        reason = 'is a xacro file, and xacrodoc is not installed: it comes with the extra "xacro"'
        raise InputError(reason, source=path, advice=install_advice("xacro"))
    try:
        content = _run("xacro", str(path.resolve()), path.resolve().parent)
    except InputError as error:
        raise InputError(f"xacro refuses it: {error.reason}", source=path) from None
    if len(content) > LARGEST_URDF:
        raise InputError(f"makes a URDF of more than {LARGEST_URDF // 1_000_000} MB, as no robot has", source=path)
    return content


def file_inside(folder: Path, name: str) -> Path | None:
    """Return the file that has a path in a folder; None where that leads out of the folder, or to no file."""
    path = folder / name
    if Path(name).is_absolute() or ".." in Path(name).parts or not is_file(path):
        return None
    return path


def package_path(address: str) -> Path:
    """Return the file that an address means: ``package:``, the import name of an installed package, and a path in it.

    Raises
    ------
    InputError
        It is no such address, the package is not installed, or has no such file.
    """
    package, _, name = address.partition(":")[2].partition("/")
    if not package.isidentifier() or not name:
        form = "write package:NAME/PATH: the name by which Python imports the package, and a path in its folder"
        raise InputError("does not name a file in a package", source=address, advice=form)
    try:
        spec = find_spec(package)
    except ValueError:  # a module that runs as a script has no specification
        spec = None
    if spec is None:
        install = f"{sys.executable} -m pip install {package}"
        advice = f"install it: {install} (or the distribution that has it, where that has another name)"
        raise InputError(f"the package {package} is not installed", source=address, advice=advice)
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]  # a module that is one file has none
    for folder in folders:
        path = file_inside(folder, name)
        if path is not None:
            return path
    raise InputError(f"{package} has no file {name!r}", source=address, advice=_similar_files(folders, name))


def _similar_files(folders: Sequence[Path], name: str) -> str:
    """Which robots' files of a package are nearly called so; else where its files are, or that it has none."""
    if not folders:
        return "it is a module, and has no files"
    paths: dict[str, str] = {}  # by the file's name alone, as the folders are the same for many
    for folder in folders:
        for path in sorted(folder.rglob("*.*")):
            if path.suffix.lower() in (".urdf", ".xacro", ".xml"):
                paths.setdefault(path.name, path.relative_to(folder).as_posix())
    close = [paths[file] for file in difflib.get_close_matches(Path(name).name, paths, n=3, cutoff=0.5)]
    return f"it has {', '.join(close)}" if close else f"its files are in {folders[0]}"


@cache
def description_path(address: str, kind: RobotKind | None) -> Path:
    """Return the file of a robot of robot_descriptions, of one kind or of either.

    Raises
    ------
    InputError
        The package is not installed, has no such robot, or not of this kind; or the robot is not on this machine yet.
    """
    name = address.rpartition(":")[2]
    spec = find_spec(PACKAGE)
    if spec is None:
        pip = f"{sys.executable} -m pip install {PACKAGE}"
        advice = f"install it: {pip}; or name a robot of example-robot-data, which `floatplan robots` lists"
        raise InputError(f"the package {PACKAGE} is not installed", source=address, advice=advice)
    if find_spec(f"{PACKAGE}.{name}") is None:
        folders = spec.submodule_search_locations or []
        modules = []
        for folder in folders:
            modules += [file.stem for file in Path(folder).glob("*_description.py")]
        close = ", ".join(difflib.get_close_matches(name, modules))
        raise InputError(f"{PACKAGE} has no {name}", source=address, advice=f"it has {close}" if close else None)
    try:
        files = json.loads(_run("description", name, Path.cwd()))
    except InputError as error:
        advice = f"bring it here first: {sys.executable} -m {PACKAGE} pull {name}"
        raise InputError(f"{PACKAGE} does not give it: {error.reason}", source=address, advice=advice) from None
    for kind_of_file in ROBOT_KINDS if kind is None else (kind,):
        path = files.get(f"{kind_of_file.upper()}_PATH")
        if path and is_file(Path(path)):
            return Path(path)
    listed = ", ".join(f"{key} {path}" for key, path in files.items()) or "nothing"
    reason = f"{PACKAGE} gives no {'URDF or MJCF' if kind is None else kind.upper()} of it"
    raise InputError(reason, source=address, advice=f"it gives {listed}")


def _run(what: str, subject: str, folder: Path) -> bytes:
    """The output of another process, which runs in a folder; InputError in a line where it fails."""
    memory = 2_000_000_000  # [bytes]
    script = Path(__file__).with_name("other_process.py")
    command = [sys.executable, str(script), what, subject, str(memory)]
    with tempfile.TemporaryFile() as output:
        with same_modules():
            git = {"GIT_ALLOW_PROTOCOL": "file", "GIT_TERMINAL_PROMPT": "0"}
            process = subprocess.Popen(
                command,
                cwd=folder,
                env={**os.environ, **git},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        try:
            code = process.wait(LONGEST)
        except subprocess.TimeoutExpired:
            raise InputError(f"it took more than {LONGEST:g} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with what it started
            process.wait()
        output.seek(0)
        content = output.read(LARGEST_URDF + 1)
    if code or not content:
        reason = " ".join(content[:1000].decode("utf-8", "replace").split())  # one line of a message
        raise InputError(reason or f"it ended with {code}, and said nothing")
    return content
