"""Command lines spoiled at random: every option of every command as the program itself lists them."""

import contextlib
import os
import random
import re
import shutil
import stat
from functools import cache
from pathlib import Path
from typing import Any

from fuzz_mutations import TEXTS
from fuzz_sources import FORMATS, PROBLEMS, plan_of
from places import ROOT

MOST_OPTIONS = 3
# No whole number from 5 to 64, so that no case starts more than four processes.
NUMBERS = (
    *("0", "-0", "-0.0", "-1", "1", "2", "3", "0.5", "0.001", "1000", "100000", "1e6", "+1", " 1 ", "1_000", "1,5"),
    *("1e300", "-1e300", "1e308", "1e400", "1e-300", "5e-324", "nan", "-nan", "inf", "-inf", "0x10", "1e", "\u0663"),
    *(str(2**63), str(2**64), "1" + "0" * 400, "9" * 4300, "9" * 4301, "-" + "9" * 4301, "0." + "0" * 5000 + "1"),
)
COUNTS = (0, 1, 2, 3, 4, 7, 300)
# Nothing here leads out of the case's folder: commands may write to it.
WORDS = (*(text for text in TEXTS if not text.startswith(("/", "..")) and "\0" not in text), "\udcff", "-", "--", "~")
PLACES = (
    *("directory", "pipe", "device", "loop", "dangling", "empty", "plan.json", "plan.json/below", "gone/deep/er"),
    *("urdf/gymnast.urdf", "problem.toml", ".", "n" * 300, "n" * 300 + ".json", "a/" * 2500, "n\n.png", "\udcff.csv"),
)


def prepare_options(rng: random.Random, folder: Path) -> list[str]:
    """Write sound files and strange places, and return the arguments of a command, to be run in the folder."""
    name = rng.choice(PROBLEMS)
    shutil.copytree(ROOT / "urdf", folder / "urdf")
    text = (ROOT / "problems" / f"{name}.toml").read_text(encoding="utf-8")
    (folder / "problem.toml").write_text(text.replace("../urdf/", "urdf/"), encoding="utf-8")
    shutil.copy(plan_of(name), folder / "plan.json")
    _make_places(folder)
    command = rng.choice(sorted(_commands()))
    options = [each for each in _commands()[command] if each.param_type_name == "option"]
    spoiled = rng.sample(options, min(len(options), rng.randint(1, MOST_OPTIONS)))
    arguments = [command, *_sound(rng, command, {each.name for each in spoiled})]
    for option in spoiled:
        arguments += _given(rng, option)
    if rng.random() < 0.1:
        arguments.insert(rng.randrange(len(arguments) + 1), rng.choice((*WORDS, *PLACES, "--nosuch", "-x")))
    elif rng.random() < 0.05:
        del arguments[rng.randrange(len(arguments))]
    return arguments


@cache
def _commands() -> dict[str, list[Any]]:
    """The commands and their parameters, as the command line itself knows them; not ``studio``, which never ends."""
    import typer.main

    from floatplan.cli.commands import app

    group: Any = typer.main.get_command(app)
    return {name: list(command.params) for name, command in group.commands.items() if name != "studio"}


def _sound(rng: random.Random, command: str, spoiled: set[str]) -> list[str]:
    """What makes a command run: its arguments, the options that it must have, and a bound on its time."""
    words: list[str] = []
    for parameter in _commands()[command]:
        if parameter.param_type_name == "argument":
            if parameter.required:
                words.append("plan.json" if "PLAN" in (parameter.metavar or "") else "problem.toml")
        elif parameter.required and parameter.name not in spoiled:
            words += [parameter.opts[0], rng.choice(FORMATS)]
    if "ROBOT" in (_commands()[command][0].metavar or "") and rng.random() < 0.3:
        words[0] = "urdf/gymnast.urdf"
        if command == "plan":
            words += ["--start", "0,0,0", "--goal", "0.5,0.5,0.5", "--duration", "1"]
    if command == "plan":
        words += rng.choice((["--no-figures"], ["--json"], ["--quiet", "--no-figures"]))
        words += [] if "budget" in spoiled else ["--budget", "1"]
    return words


def _given(rng: random.Random, option: Any) -> list[str]:
    name = rng.choice([*option.opts, *option.secondary_opts])
    if option.is_flag:
        return [name if rng.random() < 0.95 else f"{name}=1"]
    value = _value(rng, option)
    return [f"{name}={value}"] if name.startswith("--") and rng.random() < 0.2 else [name, value]


def _value(rng: random.Random, option: Any) -> str:
    """Mostly a number, a list of them, or a word that the help says, alone or with a number."""
    known: list[str] = re.findall(r"\w[\w.-]*", f"{option.help} {option.metavar} hands q1")
    kind = rng.random()
    if kind < 0.35:
        return rng.choice(NUMBERS)
    if kind < 0.55:
        numbers = [
            rng.choice(NUMBERS if rng.random() < 0.3 else ("0", "0.1", "-0.5")) for _ in range(rng.choice(COUNTS))
        ]
        return rng.choice((",", " ", ", ", ";", ",,")).join(numbers)
    if kind < 0.75:
        return rng.choice(known) + rng.choice(("", "", "", "x", f"={rng.choice(NUMBERS)}", f"={rng.choice(NUMBERS)}%"))
    return rng.choice(PLACES if kind < 0.9 else WORDS)


def _make_places(folder: Path) -> None:
    """Places that are no regular files; the device is the null device, where one may be made, in this folder alone."""
    (folder / "directory").mkdir()
    (folder / "empty").touch()
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("gone")
    os.mkfifo(folder / "pipe")
    with contextlib.suppress(OSError):
        os.mknod(folder / "device", 0o600 | stat.S_IFCHR, os.makedev(1, 3))
