"""Cases of the fuzzer: a spoiled file, a command, and what floatplan promises of every run.

It ends by itself with exit code 0, 1 or 2, without a traceback or a warning, in its time and memory, and says what is
wrong in a message of at most 2000 characters.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fuzz_mutations import ROOT, spoiled

from floatplan.files import write_atomically

LONGEST_MESSAGE = 2000  # characters
GRACE = 2.0  # s of CPU beyond the budget
BUDGET = 1.0  # s, of plans
UNBUDGETED = 10.0  # s of CPU that other commands may take
LARGEST = 2 * 1024**3  # bytes

PROBLEMS = (
    "new_configuration",
    "obstacle",
    "moving_hoop",
    "torque_limited",
    "somersault_motors",
    "falling_cat",
    "handstand_ground",
)
FORMATS = ("csv", "csv-full", "parquet", "npz", "pinocchio", "mujoco", "ros", "mcap", "unitree")


@dataclass(frozen=True)
class Case:
    """A spoiled file by its seed, and the command that meets it."""

    seed: int

    def prepare(self, folder: Path) -> list[str]:
        """Write the files of the case, and return the arguments of its command."""
        rng = random.Random(self.seed)
        name = rng.choice(PROBLEMS)
        kind = rng.choice((".toml", ".urdf", ".json"))
        robots = folder / "urdf"
        if not robots.is_dir():
            shutil.copytree(ROOT / "urdf", robots)
        problem, plan = folder / "problems" / f"{name}.toml", folder / "plan.json"
        problem.parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / "problems" / problem.name, problem)
        if kind == ".toml":
            problem.write_bytes(spoiled(rng, problem))
        elif kind == ".urdf":
            urdf = robots / _robot_of(name)
            urdf.write_bytes(spoiled(rng, urdf))
            if rng.random() < 0.3:
                return _with_robot(rng, urdf, folder)
        else:
            shutil.copy(_plan_of(name), plan)
            plan.write_bytes(spoiled(rng, plan))
            return _with_plan(rng, plan, folder)
        return _with_problem(rng, problem, folder)


def _with_problem(rng: random.Random, problem: Path, folder: Path) -> list[str]:
    command = rng.choice(("plan", "plan", "info", "bounds"))
    arguments = [command, str(problem)]
    if command == "plan":
        arguments += ["--budget", f"{BUDGET:g}", "-o", str(folder / "out")]
        arguments += rng.choice(
            (["--no-figures"], ["--json"], ["--json", "--report"], ["--no-figures", "--starts", "3"])
        )
    elif rng.random() < 0.5:
        arguments.append("--json")
    return arguments


CHOICES = {  # options of a robot, right and wrong
    "--coupled": (
        "mirror",
        "q2=q1",
        "q2=-q1",
        "q2=-0.5*q1",
        "q1=q2,q2=q1",
        "q2=1e999*q1",
        "=",
        "q2=*",
        "q2=nan*q1",
        "",
    ),
    "--locked": ("q1=0.1", "q2=-1e9", "q1=nan", "q1", "q1=0.1,q1=0.2", "toe=0", ","),
    "--reference": ("standing", "", "\x1b[31m"),
    "--plane": ("xz", "zx", "xx", "", "\u2028"),
    "--shapes": ("--frames", "out.png", "out.jpg", ""),
}


def _with_robot(rng: random.Random, urdf: Path, folder: Path) -> list[str]:
    options = rng.sample(sorted(CHOICES), rng.randint(1, 2))
    chosen = [
        word for option in options for word in (option, rng.choice(CHOICES[option]).replace("out", f"{folder}/out"))
    ]
    if "--shapes" not in chosen and rng.random() < 0.5:
        motion = ["--start", "0,0,0", "--goal", "1,0,0", "--duration", "1"]
        return [
            "plan",
            str(urdf),
            *motion,
            *chosen,
            "--no-figures",
            "--budget",
            f"{BUDGET:g}",
            "-o",
            str(folder / "out"),
        ]
    return ["info", str(urdf), *chosen]


def _with_plan(rng: random.Random, plan: Path, folder: Path) -> list[str]:
    command = rng.choice(("certify", "replay", "show", "export"))
    arguments = [command, str(plan)]
    if command == "export":
        arguments += ["-f", rng.choice(FORMATS), "-o", str(folder / "exported")]
    elif command == "show":
        arguments += ["-o", str(folder / "out")]
    else:
        arguments += rng.choice(([], ["--json"], ["--save"]))
    return arguments


def _robot_of(problem: str) -> str:
    text = (ROOT / "problems" / f"{problem}.toml").read_text(encoding="utf-8")
    found = re.search(r'urdf = "\.\./urdf/([^"]+)"', text)
    assert found, f"{problem} names its robot"
    return found[1]


@cache
def _plan_of(problem: str) -> Path:
    """A plan file of a problem, made once."""
    import floatplan as fp

    folder = Path(os.environ.get("FLOATPLAN_FUZZ_PLANS") or ROOT / "build" / "fuzz")
    path = folder / f"{problem}.json"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        fp.plan(fp.load_problem(ROOT / "problems" / f"{problem}.toml"), prove=True).save(path)
    return path


def prepare_plans() -> None:
    """Make the plan files that cases begin with."""
    for problem in PROBLEMS:
        _plan_of(problem)


@dataclass(frozen=True)
class Finding:
    """A promise that a case broke."""

    seed: int
    arguments: Sequence[str]
    broken: str
    detail: str

    def __str__(self) -> str:
        """One paragraph."""
        return f"seed {self.seed}: {self.broken}\n  floatplan {' '.join(self.arguments)}\n  {self.detail[-1500:]}"


def limit_of(arguments: Sequence[str]) -> float:
    """Seconds of CPU that a command may take."""
    return (BUDGET if arguments[0] == "plan" else UNBUDGETED) + GRACE


def judge(seed: int, arguments: Sequence[str], code: object, output: str, errors: str, seconds: float) -> list[Finding]:
    """What a run that ended has broken."""
    broken: list[tuple[str, str]] = []
    if code not in (0, 1, 2):
        broken.append((f"exit code {code}", errors))
    if "Traceback" in errors or "Traceback" in output:
        broken.append(("traceback", errors))
    if re.search(r"\w*Warning:", errors):
        broken.append(("warning", errors))
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
    from floatplan.cli.commands import app

    arguments = Case(seed).prepare(folder)
    output, errors = io.StringIO(), io.StringIO()
    code: object = 0
    began = time.process_time()
    with warnings.catch_warnings(record=True) as caught, _streams(output, errors):
        warnings.simplefilter("always")
        try:
            app(prog_name="floatplan", args=arguments)
        except SystemExit as stopped:
            code = stopped.code or 0
        except BaseException:  # whatever comes out is what is looked for
            traceback.print_exc(file=errors)
            code = "exception"
    seconds = time.process_time() - began
    said = errors.getvalue() + "".join(f"\n{each.category.__name__}: {each.message}" for each in caught)
    return judge(seed, arguments, code, output.getvalue(), said, seconds)


@contextlib.contextmanager
def _streams(output: io.StringIO, errors: io.StringIO) -> Iterator[None]:
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        yield


def run_process(seed: int, folder: Path) -> list[Finding]:
    """Run a case as a process of its own, with a bound on its memory."""
    arguments = Case(seed).prepare(folder)
    limit = limit_of(arguments) + GRACE  # of CPU: the start of Python itself is not the command's
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        run = subprocess.run(
            [sys.executable, "-m", "floatplan", *arguments],
            capture_output=True,
            timeout=60,
            cwd=folder,
            check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (LARGEST, LARGEST)),
        )
    except subprocess.TimeoutExpired:
        return [Finding(seed, arguments, "60 s of time", "killed")]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    output, errors = (stream.decode("utf-8", "replace") for stream in (run.stdout, run.stderr))
    return judge(seed, arguments, run.returncode, output, errors, seconds - (limit - limit_of(arguments)))


LONGEST_LIFE = 1.3  # s, after which a process is killed at the latest


def run_killed(seed: int, folder: Path) -> list[Finding]:
    """Kill a command at a random moment: no file it leaves is half-written, and the next run cleans up after it."""
    rng = random.Random(seed)
    name = rng.choice(PROBLEMS)
    plan, out = folder / "plan.json", folder / "out"
    shutil.copy(_plan_of(name), plan)
    out.mkdir()
    arguments = rng.choice(
        (
            ["plan", str(ROOT / "problems" / f"{name}.toml"), "-o", str(out), "--report"],
            ["show", str(plan), "-o", str(out)],
            ["show", str(plan), "-o", str(out), "--png"],
            ["export", str(plan), "-f", rng.choice(FORMATS), "-o", str(out / "exported")],
            ["certify", str(plan), "--save"],
        )
    )
    command = [sys.executable, "-m", "floatplan", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment) as process:
        time.sleep(rng.uniform(0.1, LONGEST_LIFE))
        process.kill()
    half = [path for path in folder.rglob("*") if path.is_file() and not _is_left_over(path) and not _is_whole(path)]
    for place in (folder, out):
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
        json.loads(content)
        return True
    ends = {".html": b"</html>", ".png": b"IEND\xaeB`\x82", ".csv": b"\n"}
    return bool(content) and content.rstrip(b"\n \t" if path.suffix == ".html" else b"").endswith(
        ends.get(path.suffix, b"")
    )
