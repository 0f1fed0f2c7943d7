"""Common parts of the commands: exit codes, options that mean the same everywhere, and how errors are reported."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar, get_type_hints

import typer
from typer.core import TyperGroup

from floatplan.cli import INTERRUPTED
from floatplan.errors import FloatplanError, InputError, escaped, near, printable

DONE, FAILED, BAD_INPUT = 0, 1, 2

P = ParamSpec("P")
R = TypeVar("R")

PlanFile = Annotated[str, typer.Argument(metavar="PLAN.json", help="A plan file.")]
Urdf = Annotated[
    str | None, typer.Option(metavar="ROBOT.urdf", help="The robot, where it is no longer where the plan says.")
]
PlaneName = Annotated[str | None, typer.Option(metavar="XZ", help="The plane's axes, where the URDF leaves a choice.")]
Coupled = Annotated[
    str | None,
    typer.Option(metavar="F=L,..", help="Joints that follow others: F=L, F=-L, F=0.5*L; or 'mirror': left and right."),
]
Locked = Annotated[str | None, typer.Option(metavar="J=A,..", help="Joints that stay at an angle.")]
Reference = Annotated[
    str | None, typer.Option(metavar="NAME", help="Posture of the SRDF file beside the URDF, for other joints.")
]
Save = Annotated[bool, typer.Option("--save", help="Keep the result in the plan file.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on stdout, and nothing else there.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Log on stderr what the search does.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No summary, no progress: errors only.")]


def reporting_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Turn the errors that floatplan raises on purpose into one message on stderr and an exit code."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except InputError as error:
            _complain(str(_as_typed(error, command)).replace("\n", "\nerror: "))
            raise typer.Exit(BAD_INPUT) from None
        except FloatplanError as error:
            _complain(str(error))
            raise typer.Exit(FAILED) from None
        except OSError as error:  # of whatever the system refuses: a full disk, a closed pipe, a name too long
            place = "" if error.filename is None else f"{printable(str(error.filename))}: "
            _complain(f"{place}{error.strerror or error}")
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            _complain("interrupted")
            raise typer.Exit(INTERRUPTED) from None
        except MemoryError:
            _complain("there is not enough memory for this")
            raise typer.Exit(BAD_INPUT) from None

    return run


def _as_typed(error: InputError, command: Callable[..., object]) -> InputError:
    """The same error; one about an option of the command names it as it is typed, with its dashes."""
    option = f"--{error.element}"
    if error.source is None and option in _options(command):
        return InputError(error.reason, element=option, advice=error.advice)
    return error


def _options(command: Callable[..., object]) -> Iterator[str]:
    for name, hint in get_type_hints(command, include_extras=True).items():
        for info in getattr(hint, "__metadata__", ()):
            if isinstance(info, typer.models.OptionInfo):
                yield from info.param_decls or (f"--{name.replace('_', '-')}",)


class Commands(TyperGroup):
    """The commands; what is wrong with the words of a command line is said on one short line, as all else is."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the words before the command."""
        with _shortly():
            return super().make_context(*args, **kwargs)

    def invoke(self, *args: Any, **kwargs: Any) -> Any:
        """Read the words after it, and run it."""
        with _shortly():
            return super().invoke(*args, **kwargs)


@contextlib.contextmanager
def _shortly() -> Iterator[None]:
    """Shorten the message of an error of the command line's parser, which quotes what it was given."""
    try:
        yield
    except Exception as error:
        if hasattr(error, "format_message"):
            error.message = printable(error.message)  # type: ignore[attr-defined]
        raise


def _complain(message: str) -> None:
    """Print an error on stderr, where there is one that takes it."""
    with contextlib.suppress(OSError):
        typer.echo(f"error: {message}", err=True)


def program() -> str:
    """The command to type for this program, where it was started from: ``floatplan``, or its path if it is on none."""
    called = Path(sys.argv[0])
    if called.parts[-2:] == ("floatplan", "__main__.py"):
        return f"{shlex.quote(near(Path(sys.executable)))} -m floatplan"
    found = shutil.which("floatplan")
    if called.name != "floatplan" or (found is not None and os.path.realpath(found) == os.path.realpath(called)):
        return "floatplan"
    return shlex.quote(near(called.absolute()))


def print_path(path: Path, *, err: bool = False) -> None:
    """Print the path of a file that was written, on one line, whatever its name is made of."""
    typer.echo(escaped(str(path)), err=err)


def print_json(content: Mapping[str, Any]) -> None:
    """Print one JSON object, which has no number that is not finite."""
    typer.echo(json.dumps(content, indent=1, allow_nan=False))
