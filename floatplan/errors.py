"""The exceptions that floatplan raises on purpose; the command line turns :class:`InputError` into exit code 2.

Packages that floatplan can do without are imported here: a missing one is such an error.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from types import ModuleType

PACKAGE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Lengths:
    """How many characters of a text are shown."""

    name: int = 200  # of a link, a joint, a robot or a problem; a longer one is refused
    item: int = 400  # a reason, an element or an advice
    path: int = 300  # of a file
    message: int = 1700  # all that is wrong with a problem


LENGTHS = Lengths()


def escaped(text: str) -> str:
    """Text on one line, without control characters and with nothing that UTF-8 cannot say."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def printable(text: str, longest_word: int = 80) -> str:
    """Text from anywhere as it may be shown: one line without control characters, nothing in it overlong."""
    half = (longest_word - 5) // 2  # of what is left of a word, before and after what is left out
    shown = re.sub(rf"\S{{{longest_word + 1},}}", lambda word: f"{word[0][:half]} ... {word[0][-half:]}", escaped(text))
    return shown if len(shown) <= LENGTHS.item else f"{shown[: LENGTHS.item - 4]} ..."


def check_name(name: str, element: str) -> None:
    """Refuse a name that cannot be shown on one line: names go to terminals, tables and file names.

    Raises
    ------
    InputError
        It has control characters, or is longer than ``LENGTHS.name``.
    """
    if not name.isprintable():
        raise InputError(f"the name {name!a} has characters that cannot be shown", element=element)
    if len(name) > LENGTHS.name:
        raise InputError(f"the name {name!r} is longer than {LENGTHS.name} characters", element=element)


class FloatplanError(Exception):
    """Base of every exception that floatplan raises on purpose."""


class InputError(FloatplanError, ValueError):
    """Something that the user gave is wrong.

    Parameters
    ----------
    reason : str
        What is wrong, in one sentence without a full stop.
    source : path or str, optional
        The file (or argument) that holds the fault.
    element : str, optional
        Where in it: a link, a joint, a key such as ``flight.duration``.
    advice : str, optional
        What to do about it, in one sentence without a full stop.
    """

    def __init__(
        self, reason: str, *, source: str | Path | None = None, element: str | None = None, advice: str | None = None
    ) -> None:
        self.reason = printable(reason)
        self.source = None if source is None else str(source)
        self.element = None if element is None else printable(element)
        self.advice = None if advice is None else printable(advice, LENGTHS.path)  # it may be a command
        path = escaped(self.source or "")
        shown = path if len(path) <= LENGTHS.path else f"... {path[-(LENGTHS.path - 4) :]}"  # its end
        where = ": ".join(item for item in (shown, self.element) if item)
        super().__init__(f"{where}: {self.reason}" if where else self.reason)

    def __str__(self) -> str:
        message = super().__str__()
        return f"{message}; {self.advice}" if self.advice else message

    def within(self, source: str | Path | None = None, element: str | None = None) -> InputError:
        """Return the same error with its file, or the element around it, added."""
        inner = ".".join(item for item in (element, self.element) if item) or None
        return InputError(self.reason, source=source or self.source, element=inner, advice=self.advice)


class InstallationError(InputError):
    """What is installed is not complete: no file that the user gave is at fault."""

    def within(self, source: str | Path | None = None, element: str | None = None) -> InstallationError:
        """Return the same error: no file or element is added."""
        return self


class ProblemError(InputError):
    """All that is wrong with a problem, one thing a line.

    Attributes
    ----------
    errors : tuple of InputError
        At least one.
    """

    def __init__(self, errors: Sequence[InputError]) -> None:
        self.errors = flattened(errors)
        super().__init__("several things are wrong")

    def __str__(self) -> str:
        """All of them, as far as the message may be long."""
        shown, space = [], LENGTHS.message
        for error in map(str, self.errors):
            space -= len(error) + 1
            if space < 0:
                break
            shown.append(error)
        hidden = len(self.errors) - len(shown)
        return "\n".join([*shown, *([f"and {hidden} more"] if hidden else [])])

    def within(self, source: str | Path | None = None, element: str | None = None) -> ProblemError:
        """Return the same errors, each with its file, or the element around it, added."""
        return ProblemError([error.within(source, element) for error in self.errors])


def single(error: InputError) -> tuple[InputError, ...]:
    """Return an error, or each of those that it contains."""
    errors: tuple[InputError, ...] = getattr(error, "errors", (error,))
    return errors


def flattened(errors: Iterable[InputError]) -> tuple[InputError, ...]:
    """Return errors, those that others contain instead of these."""
    return tuple(chain.from_iterable(map(single, errors)))


def refuse(errors: Sequence[InputError]) -> None:
    """Raise what is wrong, if anything is: one error as it is, several as one, without repetition."""
    different = list({str(error): error for error in flattened(errors)}.values())
    if different:
        raise ProblemError(different) if len(different) > 1 else different[0]


def faults(checks: Iterable[Callable[[], None]]) -> list[InputError]:
    """Run the checks and return what they raise."""
    errors: list[InputError] = []
    for check in checks:
        try:
            check()
        except InputError as error:
            errors.append(error)
    return errors


@contextmanager
def naming(source: str | Path | None) -> Iterator[None]:
    """Add the file to errors that name none; ``None`` adds nothing."""
    try:
        yield
    except InputError as error:
        raise error if error.source else error.within(source=source) from None


def import_optional(module: str, *, name: str, element: str, extra: str) -> ModuleType:
    """Import a module.

    Parameters
    ----------
    module : str
    name : str
        What people call the package.
    element : str
        What it is needed for: the option or argument.
    extra : str
        The extra of floatplan that it belongs to.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        reason = f'{name} is not installed: it comes with the extra "{extra}"'
        raise InputError(reason, element=element, advice=install_advice(extra)) from None


def install_advice(extra: str) -> str:
    """The command that installs an extra where floatplan runs from: a clone, or an environment of its user."""
    if (PACKAGE.parent / "pyproject.toml").is_file():  # unless floatplan was installed as a wheel
        requirement = f"-e {shlex.quote(f'{near(PACKAGE.parent)}[{extra}]')}"
    else:
        requirement = f"'floatplan[{extra}]'"
    return f"install it: {shlex.quote(near(Path(sys.executable)))} -m pip install {requirement}"


def near(path: Path) -> str:
    """The path from the working directory, where it leads down from there."""
    try:
        near = path.relative_to(Path.cwd())
    except (ValueError, OSError):
        return str(path)
    return str(near) if near != Path() else "."
