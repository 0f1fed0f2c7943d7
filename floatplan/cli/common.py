"""Common parts of the commands: exit codes, arguments and options that mean the same everywhere, and errors."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, NoReturn, ParamSpec, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

import floatplan as fp
from floatplan.cli import ExitCode
from floatplan.errors import PACKAGE, FloatplanError, InputError, escaped, near, printable
from floatplan.files import is_file, read_json
from floatplan.tables import CHOICES, KEY_TABLE, RANGES

if TYPE_CHECKING:
    from rich.console import RenderableType


KINDS = ("urdf", "problems")

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")


def folder() -> Path | None:
    """The folder above ``urdf/`` and ``problems/``; None where they were left out."""
    for above in (PACKAGE / "data", PACKAGE.parent):  # in a wheel, in a clone
        if all((above / kind).is_dir() for kind in KINDS):
            return above
    return None


def bundled(source: str) -> str:
    """The path of a file; where there is none, that of the robot or problem of this name that comes with floatplan."""
    above = folder()
    path = Path(source)
    if above is None or path.is_absolute() or ".." in path.parts or not path.parts or path.parts[0] not in KINDS:
        return source
    return str(above / path) if not os.path.lexists(path) and is_file(above / path) else source


def argument(metavar: str, text: str) -> typer.models.ArgumentInfo:
    """An argument of a command that names a robot or a problem."""
    info: typer.models.ArgumentInfo = typer.Argument(metavar=metavar, help=text, callback=bundled)
    return info


def option(metavar: str, text: str, *names: str, **more: Any) -> Any:
    """An option of a command that takes a value; it is called as its parameter where it has no names."""
    return typer.Option(*names, metavar=metavar, help=text, **more)


def flag(text: str, *names: str) -> Any:
    """An option of a command that takes none."""
    return typer.Option(*names, help=text)


def key_help(key: str, more: str = "", left_out: str | None = None) -> str:
    """What an option says that stands for a key of files: meaning, unit or bounds, and what holds if it is left out.

    Parameters
    ----------
    key : of :data:`floatplan.tables.KEY_TABLE`
    more : sentences that only the option needs, such as how it is typed
    left_out : what holds without the option; by default the file's value, or the key's own default without a file
    """
    row = KEY_TABLE[key]
    bounds = row.bounds()
    default = f"{row.default:g}" if isinstance(row.default, float) else row.default
    if left_out is None:
        left_out = "" if default is None else f"the file's, else {default}"
    facts = [row.unit if bounds is None else str(bounds), f"left out: {left_out}" if left_out else ""]
    about = "; ".join(filter(None, facts))
    sentences = [f"{row.meaning}.", more, f"[{about}]" if about else ""]
    return " ".join(filter(None, sentences)).replace("`", "")


def key_option(metavar: str, key: str, *names: str, more: str = "", left_out: str | None = None) -> Any:
    """An option of a command that stands for a key of files; see :func:`key_help`."""
    return option(metavar, key_help(key, more, left_out), *names)


def choice_option(choices: str, lead: str = "", more: str = "", metavar: str = "NAME") -> Any:
    """An option that takes one of the names of :data:`floatplan.tables.CHOICES`."""
    *first, last = [f"'{name}' ({meaning})" for name, meaning in CHOICES[choices].items()]
    return option(metavar, f"{lead}{', '.join(first)} or {last}{more}.")


def count_option(numbers: str, text: str, *, has_most: bool = False) -> Any:
    """An option that takes a whole number in a range of :data:`floatplan.tables.RANGES`.

    More than the most is refused here where it ``has_most``; elsewhere by the function that the command calls.
    """
    allowed = RANGES[numbers]
    return typer.Option(min=int(allowed.low), max=int(allowed.high) if has_most else None, help=text)


MODEL = "URDF or MJCF of what reads the file: it has its joints, bodies and actuators, in its order."
RobotSource = Annotated[
    str,
    argument("ROBOT", "A URDF, xacro or MJCF file, example-robot-data:PATH, package:NAME/PATH, or a NAME_description."),
]
ProblemFile = Annotated[str, argument("PROBLEM.toml", "A problem file.")]
MotionFile = Annotated[str, typer.Argument(metavar="PLAN.json|JUMP.json", help="A plan or a jump file.")]
PlanFile = Annotated[str, typer.Argument(metavar="PLAN.json", help="A plan file.")]
Urdf = Annotated[str | None, option("ROBOT.urdf", "The robot, where it is no longer where the plan says.")]
Output = Annotated[Path | None, option("DIR", "Where results go; runs/<name> if left out.", "--output", "-o")]
OpenPage = Annotated[bool, flag("Open the page in the browser.", "--open")]
Save = Annotated[bool, flag("Keep the result in the plan file.", "--save")]
Json = Annotated[bool, flag("One JSON object on stdout, and nothing else there.", "--json")]
Verbose = Annotated[bool, flag("Log on stderr what the search does.", "--verbose", "-v")]
Quiet = Annotated[bool, flag("No summary, no progress: errors only.", "--quiet", "-q")]


def typed_option(name: str) -> str:
    """An option by its parameter's name, as it is typed."""
    return f"--{name.replace('_', '-')}"


class KeyOption(NamedTuple):
    """An option that stands for a key of problem files: how its value is shown, the key, its type, what is its own.

    One of type ``bool`` is a flag.
    """

    metavar: str
    key: str
    kind: type = str
    more: str = ""

    @property
    def help(self) -> str:
        """What the key's row says, and the option's own sentence."""
        return key_help(self.key, self.more)


OPTIONS = {
    "start": KeyOption("O,Q1,..", "start", more="Typed in this order: -90,0,0 or '-90 0 0'."),
    "goal": KeyOption("O,Q1,..", "goal", more="Typed as --start."),
    "duration": KeyOption("S", "flight.duration", float),
    "start_velocities": KeyOption("V1,..", "start.velocities"),
    "goal_velocities": KeyOption("V1,..", "goal.velocities"),
    "start_accelerations": KeyOption("A1,..", "start.accelerations"),
    "goal_accelerations": KeyOption("A1,..", "goal.accelerations"),
    "angular_momentum": KeyOption("H", "flight.angular_momentum"),
    "takeoff": KeyOption("FRAME", "flight.takeoff.frame"),
    "landing": KeyOption("FRAME", "flight.landing.frame"),
    "horizontal_velocity": KeyOption("V", "flight.horizontal_velocity", float),
    "degree": KeyOption("K", "motion.degree"),
    "objective": KeyOption("NAME", "motion.objective"),
}
ROBOT_OPTIONS = {
    "plane": KeyOption("XZ", "robot.plane"),
    "coupled": KeyOption("F=L,..", "robot.coupled", more="Typed F=L, F=-L or F=0.5*L."),
    "locked": KeyOption("J=A,..", "robot.locked"),
    "reference": KeyOption("NAME", "robot.reference"),
    "balance_inertias": KeyOption("", "robot.balance_inertias", bool),
}
Options = Annotated[Mapping[str, Any], OPTIONS]  # the options of the command line, as typed
RobotOptions = Annotated[Mapping[str, Any], ROBOT_OPTIONS]
Degrees = Annotated[bool, flag(f"{KEY_TABLE['angles'].meaning} on this command line.", "--degrees/--radians")]


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of the tables that parameters of its are annotated with."""
    hints = get_type_hints(command, include_extras=True)
    tables: dict[str, dict[str, KeyOption]] = {}
    for name, hint in hints.items():
        note = getattr(hint, "__metadata__", (None,))[0]
        if isinstance(note, dict):
            tables[name] = note
    parameters: list[Parameter] = []
    for parameter in signature(command).parameters.values():
        if parameter.name not in tables:
            parameters.append(parameter.replace(annotation=hints[parameter.name]))
        for name, row in tables.get(parameter.name, {}).items():
            asks = flag(row.help, typed_option(name)) if row.kind is bool else option(row.metavar, row.help)
            hint = Annotated[row.kind | None, asks]
            parameters.append(Parameter(name, parameter.kind, default=None, annotation=hint))

    @functools.wraps(command)
    def run(**words: Any) -> None:
        arguments: dict[str, Any] = {}
        for table, rows in tables.items():
            arguments[table] = {}
            for name in rows:
                value = words.pop(name)
                if value is not None:
                    arguments[table][name] = value
        command(**words, **arguments)

    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def reporting_errors(command: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Turn the errors that floatplan raises on purpose into one message on stderr and an exit code."""

    @functools.wraps(command)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Returned:
        try:
            return command(*args, **kwargs)
        except InputError as error:
            _complain(str(_as_typed(error, command)).replace("\n", "\nerror: "))
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        except FloatplanError as error:
            _complain(str(error))
            raise typer.Exit(ExitCode.FAILED) from None
        except OSError as error:  # of whatever the system refuses: a full disk, a closed pipe, a name too long
            file = "" if error.filename is None else f"{printable(str(error.filename))}: "
            _complain(f"{file}{error.strerror or error}")
            _drop_what_is_left()
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        except KeyboardInterrupt:
            _complain("interrupted")
            raise typer.Exit(ExitCode.INTERRUPTED) from None
        except MemoryError:
            _complain("there is not enough memory for this")
            raise typer.Exit(ExitCode.BAD_INPUT) from None

    return run


def _as_typed(error: InputError, command: Callable[..., object]) -> InputError:
    """The same error; one about an option of the command names it as it is typed, with its dashes."""
    option = f"--{error.element}"
    options = set[str]()
    name_of = option.partition(":")[0]  # that of one of its parts: "perturb: mass"
    for name, hint in get_type_hints(command, include_extras=True).items():
        for info in getattr(hint, "__metadata__", ()):
            if isinstance(info, typer.models.OptionInfo):
                options |= {str(info.default), *(info.param_decls or (f"--{name.replace('_', '-')}",))}
    is_own = error.source is None and name_of in options
    return InputError(error.reason, element=option, advice=error.advice) if is_own else error


class AsTyped:
    """A command that takes texts, paths and defaults as they are: to look at them typer would load pydantic."""

    def parse_args(self: Any, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        hints = getattr(self.callback, "__annotations__", {})
        for parameter in self.get_params(ctx):
            kind = _plain_type(getattr(hints.get(parameter.name), "__origin__", None))
            vars(parameter).setdefault(
                "process_value", functools.partial(_value, parameter, kind, parameter.process_value)
            )
        return super().parse_args(ctx, args)  # type: ignore[misc, no-any-return]


def _plain_type(hint: Any) -> type | None:
    """The type of a text or a path that may be left out; None of all others."""
    if hint in (Path, Path | None):
        return Path
    return str if hint in (str, str | None) else None


def _value(parameter: Any, kind: type | None, read: Callable[..., Any], ctx: Any, value: Any) -> Any:
    """The value of a parameter from a word, or from its default; what is a number, or missing, is left to typer."""
    if isinstance(value, str) and kind is not None:
        value = kind(value)
    elif not isinstance(value, bool | int | float | Path | None) or (value is None and parameter.required):
        return read(ctx, value)
    return value if parameter.callback is None else parameter.callback(ctx, parameter, value)


class Command(AsTyped, TyperCommand):
    """A command."""


class Commands(AsTyped, TyperGroup):
    """The commands; what is wrong with the words of a command line is one short message, as all errors are."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; some have two words."""
        both = " ".join(args[:2])
        return super().resolve_command(ctx, [both, *args[2:]] if both in self.commands else args)

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
    """Shorten the message of an error of the command line's parser, which quotes the command line."""
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


def _drop_what_is_left() -> None:
    """Let the interpreter not try to print it once more as it ends: its exit code would be 120."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def program() -> str:
    """The command to type for this program, where it was started from: ``floatplan``, or its path if it is on none."""
    called = Path(sys.argv[0])
    if called.parts[-2:] == ("floatplan", "__main__.py"):
        return f"{shlex.quote(near(Path(sys.executable)))} -m floatplan"
    installed = shutil.which("floatplan")
    if called.name != "floatplan" or (
        installed is not None and os.path.realpath(installed) == os.path.realpath(called)
    ):
        return "floatplan"
    return shlex.quote(near(called.absolute()))


def read_motion(path: str, urdf: str | None) -> fp.Plan | fp.Jump:
    """Read a plan or a jump, whichever the file says that it holds."""
    from floatplan.jumps.jump import FORMAT
    from floatplan.jumps.spatial.jump import FORMAT_IN_SPACE

    content = read_json(Path(path), kind="a plan or jump file")
    is_jump = isinstance(content, dict) and content.get("format") in (FORMAT, FORMAT_IN_SPACE)
    return fp.load_jump(path, urdf) if is_jump else fp.load_plan(path, urdf)


def tell(quiet: bool) -> Callable[[str], None]:
    """What prints words on stderr, in a line each, or nothing."""
    return lambda words: None if quiet else typer.echo(escaped(words), err=True)


def check_model(form: str, model: str | None, robot: fp.Robot, quiet: bool) -> None:
    """Refuse a format, or a model that is not the robot's; say whether that has another order."""
    from floatplan.export.formats import names_of_model

    names = names_of_model(form, model, robot)
    if names is not None and model is not None:
        tell(quiet)(f"{model}: {names.order_note(robot)}")


def print_path(path: Path, *, err: bool = False) -> None:
    """Print the path of a file that was written, on one line, whatever its name is made of."""
    typer.echo(escaped(str(path)), err=err)


def print_json(content: Mapping[str, Any]) -> None:
    """Print one JSON object, which has no number that is not finite."""
    typer.echo(json.dumps(content, indent=1, allow_nan=False))


def finish(
    facts: Mapping[str, Any],
    json_output: bool,
    readable: Callable[[Any], RenderableType],
    ok: bool = True,
    summary_shown: bool | None = None,
) -> NoReturn:
    """Print a command's result and end it: exit code 0 where ``ok``, else 1.

    Parameters
    ----------
    facts : printed as JSON with ``json_output``
    readable : what is printed for a person, made with the functions of :mod:`floatplan.cli.summary`
    summary_shown : whether that is printed, with JSON on stderr; the default is where there is no JSON
    """
    if summary_shown or (summary_shown is None and not json_output):
        from rich.console import Console

        from floatplan.cli import summary

        Console(stderr=json_output, highlight=False).print(readable(summary))  # in colours where somebody sees them
    if json_output:
        print_json(facts)
    raise typer.Exit(ExitCode.DONE if ok else ExitCode.FAILED)


def needs_casadi(option: str) -> None:
    """Refuse an option where CasADi is not installed."""
    from floatplan.jumps.model import casadi

    try:
        casadi()
    except InputError as error:
        raise InputError(error.reason, element=option, advice=error.advice) from None
