"""Whole processes, imports, and certificates."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from measuring import PROBLEMS, Counts, example, heading, in_turns, table

import floatplan as fp
from floatplan.certificate.certificate import certify

IMPORTED = ("numpy", "pinocchio", "pydantic", "typer")  # what a command line of this kind takes at least
MOST = 2.0  # [-] times the imports' processor time, for a plan and its proof


def startup(counts: Counts) -> None:
    """Processes from their beginning to their end, imports, and certificates."""
    heading("startup: whole processes, which take turns")
    program = [sys.executable, "-m", "floatplan"]
    imports = f"import {', '.join(name for name in IMPORTED if find_spec(name))}"
    with tempfile.TemporaryDirectory() as folder:
        commands = {
            imports: [sys.executable, "-c", imports],
            "floatplan --help": [*program, "--help"],
            "floatplan plan .. --quiet": [*program, "plan", str(PROBLEMS / "handstand.toml"), "--quiet", "-o", folder],
        }
        turns = [{label: _run(command) for label, command in commands.items()} for _ in range(counts.subprocesses)]
    rows = []
    for label in commands:
        wall, processor = (statistics.median(turn[label][index] for turn in turns) for index in (0, 1))
        ratio = statistics.median(turn[label][1] / turn[imports][1] for turn in turns)
        rows.append([label, wall, processor, ratio])
    table(["command", "wall s", "processor s", "of the imports'"], rows)
    print(f"  Bar: --help in 0.2 s, a plan in {MOST} times the processor time of the imports.\n")
    _imports()
    _certificates(counts)


def _run(command: Sequence[str]) -> tuple[float, float]:
    """Wall and processor seconds of a process."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=_environment())
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _environment() -> dict[str, str]:
    """Environment of this process, with the floatplan that is imported here in front, where bytecode is kept."""
    home = str(Path(fp.__file__).resolve().parents[1])
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPATH": os.pathsep.join(filter(None, (home, os.environ.get("PYTHONPATH"))))}


def _imports() -> None:
    """Seconds of the dearest packages that planning from a file imports, each with what only it brings."""
    code = "import floatplan.planning.planner, floatplan.problem.file, floatplan.cli.results"
    command = [sys.executable, "-X", "importtime", "-c", code]
    report = subprocess.run(command, check=True, capture_output=True, text=True, env=_environment()).stderr
    spent: dict[str, float] = {}
    for line in report.splitlines():
        own, _, name = (part.strip() for part in line.removeprefix("import time:").split("|"))
        if own.isdigit():
            package = name.split(".")[0]
            spent[package] = spent.get(package, 0.0) + int(own) / 1e3
    dearest = sorted(spent.items(), key=lambda pair: -pair[1])[:10]
    table(["imported package", "own ms"], [*dearest, ("all", sum(spent.values()))])


def _certificates(counts: Counts) -> None:
    rows = []
    for name, bar in (("A", 50), ("B, obstacle", 100)):
        timed = in_turns({"certify": partial(certify, fp.plan(example(name)))}, counts.slow_turns)
        rows.append([name, timed.results["certify"].verdict, timed.median_ms("certify"), bar])
    table(["certificate", "verdict", "ms", "bar ms"], rows)
