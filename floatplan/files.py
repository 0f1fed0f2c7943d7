"""Files: JSON read strictly, data, and files that are written whole or not at all."""

import hashlib
import json
import math
import os
import re
import stat
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

from floatplan.errors import InputError

LARGEST_PLAN = 50_000_000  # [bytes] of a plan file
LARGEST_URDF = 50_000_000  # [bytes] the largest URDF in use is a few megabytes
MADE = ("plan.json", "jump.json", "study.json")  # files of which folders of results have one
DEEPEST = 50  # [-] tables and lists within each other, of any file


def read_regular(path: str | Path, largest: int, kind: str) -> bytes:
    """Content of a regular file; devices, pipes and directories are not opened for more than a look.

    Parameters
    ----------
    largest : bytes
    kind : what it should be, for messages: "a plan file"

    Raises
    ------
    InputError
        The file is missing, not a regular one, too large, or cannot be read.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as stream:
            state = os.fstat(descriptor)
            if not stat.S_ISREG(state.st_mode):
                raise InputError(f"is not a regular file, as {kind} is", source=path)
            # read() allocates at once as much as it may return; a file may grow meanwhile
            size = min(largest, 2 * state.st_size + 65_536) + 1  # 64 kB more for a file that gives no size
            content = stream.read(size) if state.st_size <= largest else b""
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("no such file", source=path) from None
    except IsADirectoryError:
        raise InputError(f"is a directory, not {kind}", source=path) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read: {reason}", source=path) from None
    if state.st_size > largest or len(content) > largest:
        raise InputError(f"is larger than {largest // 1_000_000} MB, as no {kind.partition(' ')[2]} is", source=path)
    return content


def check_readable(path: Path, otherwise: str) -> None:
    """Refuse a file that is there and cannot be read: its content is unknown, so that it must not be lost.

    Parameters
    ----------
    path : Path
        A file, or nothing.
    otherwise : str
        What is not done to the file, for the message: "is not replaced".

    Raises
    ------
    InputError
        The system refuses to read it.
    """
    try:
        if path.is_file():
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                os.read(descriptor, 1)
            finally:
                os.close(descriptor)
    except OSError as error:
        reason = f"cannot be read: {error.strerror or error}; it {otherwise}"
        raise InputError(reason, source=path, advice="make it readable, or move it away") from None


def check_hash(content: bytes, digest: str, path: Path) -> None:
    """Refuse the content of a file whose SHA-256 is not the one that a plan recorded."""
    if hashlib.sha256(content).hexdigest() != digest:
        reason = "is not the file that was planned with: its SHA-256 differs"
        advice = "plan again, or restore the file"
        raise InputError(reason, source=path, element="robot.sha256", advice=advice)


def runs_folder(name: str, otherwise: str) -> Path:
    """Return ``runs/<name>``, the name made fit for a folder, where results go that nobody sends elsewhere."""
    return Path("runs") / (re.sub(r"[^\w.-]+", "_", name).strip("._") or otherwise)


def is_file(path: Path) -> bool:
    """Whether a path leads to a regular file; one that no file can have does not."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_text(path: str | Path, largest: int, kind: str) -> str:
    """Content of a regular text file in UTF-8, with or without a byte-order mark; errors as :func:`read_regular`."""
    try:
        return read_regular(path, largest, kind).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not a text file in UTF-8", source=path) from None


def read_json(path: Path, largest: int = LARGEST_PLAN, kind: str = "a plan file") -> Any:
    """Read a plan file, or another ``kind`` of JSON.

    Raises
    ------
    InputError
        The file cannot be read, is not JSON, is nested too deeply, or gives a key twice in one object.
    """
    if path.suffix.lower() == ".toml" and is_file(path):
        advice = f"floatplan plan {path.name} makes a plan, floatplan jump {path.name} a jump; give the file of that"
        raise InputError(f"is a TOML file, not {kind}", source=path, advice=advice)
    if path.is_dir():
        inside = next((name for name in MADE if is_file(path / name)), None)
        advice = f"did you mean {path / inside}?" if inside else f"give the file in it: {', '.join(MADE)}"
        raise InputError(f"is a directory, not {kind}", source=path, advice=advice)
    text = read_text(path, largest, kind)
    return _parsed(path, "JSON", lambda: json.loads(text, object_pairs_hook=_single_keys))


def parsed_toml(text: str, path: Path) -> dict[str, Any]:
    """Return the content of a TOML file; errors as :func:`read_json`."""
    content: dict[str, Any] = _parsed(path, "TOML", lambda: tomllib.loads(text))
    return content


class _PlainTree(ElementTree.TreeBuilder):
    """Refuses a document type: it is where entities (and entity bombs) are declared, and a URDF needs none."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> NoReturn:
        raise InputError("declares a document type (<!DOCTYPE>), which may hide entities", advice="remove that line")


def parsed_xml(content: bytes, path: Path) -> ElementTree.Element:
    """Return the root element of an XML file that declares no document type; errors as :func:`read_json`."""
    try:
        root: ElementTree.Element = ElementTree.fromstring(content, ElementTree.XMLParser(target=_PlainTree()))
        check_depth(root, ElementTree.Element)
    except InputError as error:
        raise error.within(path) from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"is not well-formed XML: {error}", source=path) from None
    return root


def _parsed(path: Path, form: str, parse: Callable[[], Any]) -> Any:
    try:
        content = parse()
        check_depth(content)
    except InputError as error:
        raise error.within(source=path) from None
    except RecursionError:
        raise _too_deep().within(source=path) from None
    except ValueError as error:
        raise InputError(f"is not {form}: {error}", source=path) from None
    return content


def check_depth(content: Any, kinds: Any = Mapping | list | tuple) -> None:
    """Refuse mappings and sequences, or other ``kinds``, nested deeper than in any file: others walk them recursively.

    Raises
    ------
    InputError
        They are, or hold themselves.
    """
    level: list[Any] = [(content,)]
    for _ in range(DEEPEST + 1):
        inner: dict[int, Any] = {}  # each object once, however often it is there
        for item in level:
            for entry in item.values() if isinstance(item, Mapping) else item:
                if isinstance(entry, kinds):
                    inner[id(entry)] = entry
        level = list(inner.values())
        if not level:
            return
    raise _too_deep()


def _too_deep() -> InputError:
    return InputError("is nested too deeply", advice=f"no file has more than {DEEPEST} levels")


def check_finite(content: Any) -> None:
    """Refuse numbers in nested mappings and sequences that are not finite, or too large for a double.

    Raises
    ------
    InputError
        Its element is the path of the first such number.
    """
    check_numbers(content, "", lambda number: abs(number) <= sys.float_info.max, _not_finite)


def check_numbers(
    content: Any, element: str, holds: Callable[[float], bool], refusal: Callable[[float], InputError]
) -> None:
    """Raise the refusal, with its path, of the first number in mappings and sequences that does not hold."""
    for path, number in _numbers_of(content, element):
        if not holds(number):
            raise refusal(number).within(element=path)


def _numbers_of(content: Any, element: str) -> Iterator[tuple[str, float]]:
    """The numbers in nested mappings and sequences, each with its path."""
    if hasattr(content, "tolist"):
        content = content.tolist()
    if isinstance(content, Mapping):
        for key, item in content.items():
            yield from _numbers_of(item, f"{element}.{key}".lstrip("."))
    elif isinstance(content, list | tuple):
        for index, item in enumerate(content):
            yield from _numbers_of(item, f"{element}[{index}]")
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield element, content


def _not_finite(number: float) -> InputError:
    shown = json.dumps(number) if isinstance(number, float) else f"an integer of {number.bit_length()} bits"
    return InputError(f"is not finite: {shown}", advice="give a finite number")


def json_value(value: Any) -> Any:
    """Convert arrays, tuples and mappings into what JSON holds; numbers that are not finite become ``None``."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return list(map(json_value, value))
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_atomically(path: str | Path, content: str | bytes) -> Path:
    """Write to a temporary name in the same folder and rename, so that nobody ever sees half a file.

    Raises
    ------
    InputError
        The system refuses it, such as on a full disk, or there is something else than a file, or a file that cannot be
        read.
    """
    return write_all({Path(path): content})[0]


def write_all(contents: Mapping[Path, str | bytes], replacing: Callable[[], object] | None = None) -> list[Path]:
    """Write several files, each whole: all are on the disk before the first is renamed.

    Parameters
    ----------
    contents : what to write, by path
    replacing : called once everything is written and nothing is renamed yet

    Raises
    ------
    InputError
        As :func:`write_atomically`; it names the file that was to be written.
    """
    written: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            with _refusals_of(path):
                written[path] = _temporary_file(path, content)
        if replacing is not None:
            replacing()
        for path, temporary in written.items():
            with _refusals_of(path):
                temporary.replace(path)
    except BaseException:
        for temporary in written.values():
            temporary.unlink(missing_ok=True)
        raise
    return list(contents)


@contextmanager
def _refusals_of(path: Path) -> Iterator[None]:
    """Name the file, not its temporary name, in what the system refuses, or what no text file can hold."""
    try:
        yield
    except UnicodeEncodeError as error:
        # Python holds the bytes of file names that are not UTF-8 as lone surrogates
        reason = f"cannot be written: it would hold {error.object[error.start : error.end]!a}, which is not UTF-8"
        raise InputError(reason, source=path, advice="rename the file or folder that is named so") from None
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=path) from None


def _temporary_file(path: Path, content: str | bytes) -> Path:
    """A new file under a temporary name in the folder of ``path``."""
    if path.exists() and not path.is_file():
        raise InputError("is not a regular file, and is not replaced", source=path, advice="choose another name")
    check_readable(path, "is not replaced")
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(path.parent)
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f"{_temporary_of_here()}{os.getpid()}-")
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        mask = os.umask(0)
        os.umask(mask)
        Path(temporary).chmod(0o666 & ~mask)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return Path(temporary)


def _temporary_of_here() -> str:
    """How the names of this machine's temporary files begin; the process and a random word follow."""
    return f".floatplan-{re.sub('[^A-Za-z0-9]', '', os.uname().nodename)[:40]}-"


def _remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of processes of this machine that were killed."""
    for path in folder.glob(f"{_temporary_of_here()}*"):
        process = path.name.split("-")[-2]
        if process.isdecimal() and not _is_alive(int(process)):
            path.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _single_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError("is given twice in one object", element=twice, advice="keep one of them")
    return content
