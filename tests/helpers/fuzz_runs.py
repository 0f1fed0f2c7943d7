"""Runs of the fuzzer's cases, and what floatplan promises of every one.

It ends by itself with exit code 0, 1 or 2, without a traceback or a warning, in its time and memory, and says what is
wrong in a message of at most 2000 characters.
"""

import contextlib
import io
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NoReturn
from unittest import mock

from fuzz_cases import Case
from fuzz_clips import prepare_clip
from fuzz_sources import FORMATS, PROBLEMS, plan_of
from own_process import started
from places import ROOT

from floatplan.files import write_atomically

LONGEST_MESSAGE = 2000  # characters
GRACE = 20.0  # s of CPU beyond the budget: ten times what it takes here, for machines that are slower
UNBUDGETED = 10.0  # s of CPU that other commands may take
FLYING = 60.0  # s of time, the budget of flights in closed loop that gives none
SEARCHING = 40.0  # s of CPU that the search of a first flight, or the rows of a small study may take
PATIENCE = 80  # s of CPU until a run counts as hanging
WAITING = 600  # s of time, the same
LARGEST = 2 * 1024**3  # bytes


@dataclass(frozen=True)
class Finding:
    """A promise that a case broke."""

    seed: int
    arguments: Sequence[str]
    broken: str
    detail: str

    def __str__(self) -> str:
        """One paragraph."""
        words = " ".join(word if word.isprintable() and len(word) < 200 else ascii(word) for word in self.arguments)
        return f"seed {self.seed}: {self.broken}\n  floatplan {words[:1500]}\n  {self.detail[-1500:]}"


def limit_of(arguments: Sequence[str]) -> float:
    """Seconds of CPU that a command may take."""
    budgets = [after for word, after in pairwise(arguments) if word == "--budget"]
    flying = "replay" in arguments[:1] and any(word.startswith("--replan") for word in arguments)
    if budgets and (flying or "plan" in arguments[:1]):
        with contextlib.suppress(ValueError):
            return min(max(float(budgets[-1]), 0.0), FLYING if flying else UNBUDGETED) + GRACE
    if flying:
        return FLYING + GRACE
    return (SEARCHING if arguments[:1] in (["init"], ["study"]) else UNBUDGETED) + GRACE


def judge(seed: int, arguments: Sequence[str], code: object, output: str, errors: str, seconds: float) -> list[Finding]:
    """What a run that ended has broken."""
    broken: list[tuple[str, str]] = []
    if code not in (0, 1, 2):
        broken.append((f"exit code {code}", errors))
    if "Traceback" in errors or "Traceback" in output:
        broken.append(("traceback", errors))
    if re.search(r"\w*Warning:", errors):
        broken.append(("warning", errors))
    if re.search("not enough memory|[Uu]nable to allocate|bad_alloc|MemoryError", errors):
        broken.append(("more memory than it may have", errors))
    if code == 2 and len(errors) > LONGEST_MESSAGE:
        broken.append((f"message of {len(errors)} characters", errors[:1500]))
    if code == 2 and not errors.strip():
        broken.append(("exit code 2 without a message", output))
    if any(ord(letter) < 32 and letter not in "\n\t" for letter in errors + output):
        broken.append(("control characters", errors + output))
    if seconds > limit_of(arguments):
        broken.append((f"{seconds:.1f} s of CPU", errors))
    return [Finding(seed, arguments, what, detail) for what, detail in broken]


def run_here(seed: int, folder: Path) -> list[Finding]:
    """Run a case in this process."""
    return _run_command(seed, folder, Case(seed).prepare(folder))


def run_clip(seed: int, folder: Path) -> list[Finding]:
    """Run a command on a spoiled recorded motion in this process."""
    return _run_command(seed, folder, prepare_clip(random.Random(seed), folder))


def _run_command(seed: int, folder: Path, arguments: Sequence[str]) -> list[Finding]:
    from floatplan.cli.commands import app

    output = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    errors = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="backslashreplace")
    code: object = 0
    began = time.process_time()
    with warnings.catch_warnings(record=True) as caught, _surroundings(folder), _streams(output, errors):
        warnings.simplefilter("always")
        try:
            app(prog_name="floatplan", args=list(arguments))
        except SystemExit as stopped:
            code = stopped.code or 0
        except BaseException:  # whatever comes out is what is looked for
            traceback.print_exc(file=errors)
            code = "exception"
    seconds = time.process_time() - began
    printed, said = (_content(stream) for stream in (output, errors))
    said += "".join(f"\n{each.category.__name__}: {each.message}" for each in caught)
    return judge(seed, arguments, code, printed, said, seconds)


def _content(stream: io.TextIOWrapper) -> str:
    stream.seek(0)
    return stream.read()


@contextlib.contextmanager
def _streams(output: io.TextIOWrapper, errors: io.TextIOWrapper) -> Iterator[None]:
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        yield


class _HangError(BaseException):
    """Nothing that the program catches."""


@contextlib.contextmanager
def _surroundings(folder: Path) -> Iterator[None]:
    """The case's folder as working directory, nothing written elsewhere, no browser, and an end of waiting."""

    def stop(number: int, _: object) -> NoReturn:
        raise _HangError("it works on and on" if number == signal.SIGPROF else "it waits for something")

    clocks = {  # a busy machine makes a command slow, not long
        signal.SIGPROF: (signal.ITIMER_PROF, PATIENCE),
        signal.SIGALRM: (signal.ITIMER_REAL, WAITING),
    }
    before = {number: signal.signal(number, stop) for number in clocks}
    for clock, seconds in clocks.values():
        signal.setitimer(clock, seconds)
    try:
        with (
            contextlib.chdir(folder),
            mock.patch.dict(os.environ, _environment(folder)),
            mock.patch("webbrowser.open", return_value=True),
        ):
            yield
    finally:
        for number, (clock, _) in clocks.items():
            signal.setitimer(clock, 0)
            signal.signal(number, before[number])


def _environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache"), "BROWSER": "true"}


def run_process(seed: int, folder: Path) -> list[Finding]:
    """Run a case as a process of its own, with a bound on its memory."""
    arguments = Case(seed).prepare(folder)
    limit = limit_of(arguments) + GRACE  # of CPU: the start of Python itself is not the command's
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        run = subprocess.run(
            [sys.executable, "-m", "floatplan", *arguments],
            capture_output=True,
            timeout=WAITING,
            cwd=folder,
            check=False,
            env=_environment(folder),
            stdin=subprocess.DEVNULL,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (LARGEST, LARGEST)),
        )
    except subprocess.TimeoutExpired:
        return [Finding(seed, arguments, f"{WAITING} s of time", "killed")]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    output, errors = (stream.decode("utf-8", "replace") for stream in (run.stdout, run.stderr))
    return judge(seed, arguments, run.returncode, output, errors, seconds - (limit - limit_of(arguments)))


LONGEST_LIFE = 2.0  # s, after which a process is killed at the latest


def run_killed(seed: int, folder: Path) -> list[Finding]:
    """Kill a command at a random moment: no file it leaves is half-written, and the next run cleans up after it."""
    rng = random.Random(seed)
    name = rng.choice(PROBLEMS)
    plan, out = folder / "plan.json", folder / "out"
    shutil.copy(plan_of(name), plan)
    out.mkdir()
    arguments = rng.choice(
        (
            ["plan", str(ROOT / "problems" / f"{name}.toml"), "-o", str(out), "--report", "--figures"],
            ["show", str(plan), "-o", str(out)],
            ["show", str(plan), "-o", str(out), "--png"],
            ["export", str(plan), "-f", rng.choice(FORMATS), "-o", str(out / "exported")],
            ["certify", str(plan), "--save"],
            ["study", str(ROOT / "problems" / "studies" / "first.toml"), "-o", str(out), "-q", "--jobs", "2"],
        )
    )
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123
        process = started(
            *arguments, stdout=nowhere.fileno(), stderr=nowhere.fileno(), environment=_environment(folder)
        )
        time.sleep(rng.uniform(0, LONGEST_LIFE))
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    kept = [path for path in (plan, *out.rglob("*")) if path.is_file()]  # not Matplotlib's cache of fonts, beside them
    half = [path for path in kept if not _is_left_over(path) and not _is_whole(path)]
    for place in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        write_atomically(place / "next", "")
    left = [path for path in folder.rglob("*") if _is_left_over(path)]
    return [
        *(Finding(seed, arguments, "half a file", str(path)) for path in half),
        *(Finding(seed, arguments, "a temporary file stays", str(path)) for path in left),
    ]


def _is_left_over(path: Path) -> bool:
    return path.name.startswith(".floatplan-")


def _is_whole(path: Path) -> bool:
    """Whether a file ends as its kind does."""
    content = path.read_bytes()
    if path.suffix == ".json":
        with contextlib.suppress(ValueError):
            json.loads(content)
            return True
        return False
    if path.name == ".lock":
        return not content
    ends = {".html": b"</html>", ".svg": b"</svg>", ".png": b"IEND\xaeB`\x82", ".csv": b"\n", ".parquet": b"PAR1"}
    written = content.rstrip() if path.suffix in (".html", ".svg") else content
    return bool(content) and written.endswith(ends.get(path.suffix, b""))
