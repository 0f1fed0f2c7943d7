"""What a person sees of the command line: where results and progress go, bars, the log, version, completion, hints."""

from __future__ import annotations

import logging
import os
import pty
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import warm_process
from warm_process import WarmProcess

import floatplan as fp
from floatplan.cli import common, progress
from floatplan.kernel.library import description

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = ROOT / "problems"
PROGRAM = [sys.executable, "-m", "floatplan"]
BAR = "\u2501"  # what rich draws bars of
AT_ONCE = {  # a bar and words about the progress, of a search that ends after a start
    "floatplan.cli.progress.DELAY": 0.0,
    "floatplan.planning.in_space.ANNOUNCED_EVERY": 0.0,
    "floatplan.planning.in_space.MOST_STARTS": 1,
}


def in_terminal(*arguments: str | Path, cwd: Path, **constants: float) -> tuple[str, str]:
    """Run the program with a terminal for stderr; what it wrote to stdout and to the terminal."""
    ours, theirs = pty.openpty()
    seen = bytearray()

    def read() -> None:
        try:
            while piece := os.read(ours, 4096):
                seen.extend(piece)
        except OSError:  # the other end is closed
            return

    reader = threading.Thread(target=read)
    reader.start()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    with (cwd / "stdout").open("w+") as stdout:
        WarmProcess(
            *arguments,
            stdout=stdout.fileno(),
            stderr=theirs,
            cwd=cwd,
            environment=environment,
            constants=constants,
        ).wait()
        os.close(theirs)
        reader.join()
        os.close(ours)
        stdout.seek(0)
        return stdout.read(), seen.decode()


@pytest.fixture
def long_search(tmp_path: Path) -> Path:
    """A twist with hardly any torque, which nothing proves at once."""
    text = (PROBLEMS / "space/diver_half_twist.toml").read_text(encoding="utf-8")
    path = tmp_path / "long.toml"
    text = text.replace("../../urdf", str(ROOT / "urdf")).split("[limits]")[0]
    path.write_text(f"{text}\n[limits]\ntorque = 0.2\n", encoding="utf-8")
    return path


class TestBar:
    def test_a_search_has_one_in_a_terminal(self, long_search: Path, tmp_path: Path) -> None:
        output, seen = in_terminal("plan", long_search, "--no-figures", "--budget", "500", cwd=tmp_path, **AT_ONCE)
        assert BAR in seen
        assert re.search(r"planning: \d+ starts tried, 0 solved", seen)
        assert "no plan found" in output
        assert BAR not in output

    def test_what_takes_no_time_has_none(self, tmp_path: Path) -> None:
        output, seen = in_terminal("bounds", PROBLEMS / "handstand.toml", cwd=tmp_path)
        assert "midpoint" in output
        assert seen == ""

    def test_quiet_has_none(self, long_search: Path, tmp_path: Path) -> None:
        asked = ("plan", long_search, "--no-figures", "-q", "--budget", "500")
        assert in_terminal(*asked, cwd=tmp_path, **AT_ONCE) == ("", "")

    def test_it_counts_and_goes_away(self, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
        monkeypatch.setattr(progress, "DELAY", 0.0)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        with progress.progress("drawing") as bar:
            for timer in threading.enumerate():
                if isinstance(timer, threading.Timer):
                    timer.join()
            bar.reach(3, 12)
            assert bar._bar is not None
            (task,) = bar._bar.tasks
            assert (task.completed, task.total, task.description) == (3, 12, "drawing")
            bar.say("[red]half")  # text, no markup
            assert bar._bar.tasks[0].description == "drawing: [red]half"
        assert not bar._bar.live.is_started

    def test_work_that_ends_before_never_shows_it(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(progress, "DELAY", 600.0)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        with progress.progress("drawing") as bar:
            assert bar._bar is not None
        assert not any(isinstance(thread, threading.Timer) for thread in threading.enumerate())
        assert not bar._bar.live.is_started

    def test_films_tell_how_far_they_are(self, tmp_path: Path, planned: Callable[[str], fp.Plan]) -> None:
        told: list[tuple[int, int]] = []
        planned("handstand").animate(
            tmp_path / "film.gif", speed=4.0, progress=lambda done, total: told.append((done, total))
        )
        assert told == [(number, len(told)) for number in range(1, len(told) + 1)]
        assert len(told) > 3


class TestLog:
    def test_says_what_the_search_does(self, floatplan: Callable[..., Any]) -> None:
        run = floatplan("plan", PROBLEMS / "obstacle.toml", "-v", "--no-figures", "--starts", "2", "-o", "out")
        lines = run.stderr.splitlines()
        assert re.search(r"start 1, degree 7, \d+ steps; optimal, coefficients [\d.]+; best violation 0$", lines[0])
        assert any("start 2, degree 7" in line for line in lines)
        assert re.search(r"proof: proved, \d+ intervals of time$", lines[-1])
        assert "obstacle: flight proved" in run.stdout
        assert not logging.getLogger("floatplan").handlers

    @pytest.mark.usefixtures("little_work")
    def test_names_what_is_violated(self, floatplan: Callable[..., Any], tmp_path: Path) -> None:
        text = (PROBLEMS / "torque_limited.toml").read_text(encoding="utf-8").replace("../urdf", str(ROOT / "urdf"))
        path = tmp_path / "weak.toml"
        path.write_text(re.sub(r"torque = .*", "torque = 0.2", text), encoding="utf-8")
        run = floatplan("plan", path, "-v", "--no-figures", "-o", "out")
        assert run.code == 1
        first = run.stderr.splitlines()[0]
        assert re.search(r"violation [\d.]+ of torque of q\d at [\d.]+ s; best violation [\d.]+$", first), first
        assert "planning: " not in run.stderr

    def test_is_not_there_unasked(self, floatplan: Callable[..., Any]) -> None:
        assert floatplan("plan", PROBLEMS / "obstacle.toml", "--no-figures", "-o", "out").stderr == ""


def test_the_version(floatplan: Callable[..., Any]) -> None:
    run = floatplan("--version")
    solver = f"floatplan {fp.__version__}, {description()}\n"
    assert (run.code, run.stdout, run.stderr) == (0, solver, "")


def test_shells_complete_commands() -> None:
    words = {"_FLOATPLAN_COMPLETE": "complete_bash", "COMP_WORDS": "floatplan ex", "COMP_CWORD": "1"}
    run = subprocess.run(PROGRAM, capture_output=True, text=True, check=False, env={**os.environ, **words})
    assert run.stdout.split() == ["export"]


def test_objectives_have_units(floatplan: Callable[..., Any]) -> None:
    text = " ".join(floatplan("plan", "--help").stdout.split())
    assert "torque: integral of the squared joint torques, N^2 m^2 s;" in text
    run = floatplan("plan", PROBLEMS / "new_configuration.toml", "--objective", "torque", "--no-figures", "-o", "out")
    assert re.search(r"torque [\d.]+ N\^2 m\^2 s", run.stdout)


class TestHint:
    """The command that the summary says to type next is one that the shell finds."""

    def hint(self, monkeypatch: pytest.MonkeyPatch, called: Path | str, path: Path | str = "") -> str:
        monkeypatch.setattr(sys, "argv", [str(called)])
        monkeypatch.setenv("PATH", str(path))
        return common.program()

    @pytest.fixture
    def script(self, tmp_path: Path) -> Path:
        path = tmp_path / ".venv" / "bin" / "floatplan"
        path.parent.mkdir(parents=True)
        path.write_text("#!/bin/sh\n")
        path.chmod(0o755)
        return path

    def test_on_the_path(self, monkeypatch: pytest.MonkeyPatch, script: Path) -> None:
        assert self.hint(monkeypatch, script, script.parent) == "floatplan"

    def test_in_a_clone(self, monkeypatch: pytest.MonkeyPatch, script: Path, tmp_path: Path) -> None:
        monkeypatch.chdir(tmp_path)
        assert self.hint(monkeypatch, script) == ".venv/bin/floatplan"
        assert self.hint(monkeypatch, ".venv/bin/floatplan") == ".venv/bin/floatplan"
        monkeypatch.chdir("/")
        assert self.hint(monkeypatch, script).endswith("/.venv/bin/floatplan")

    def test_another_one_on_the_path(self, monkeypatch: pytest.MonkeyPatch, script: Path, tmp_path: Path) -> None:
        other = tmp_path / "other" / "floatplan"
        other.parent.mkdir()
        other.write_text("#!/bin/sh\n")
        other.chmod(0o755)
        monkeypatch.chdir(tmp_path)
        assert self.hint(monkeypatch, script, other.parent) == ".venv/bin/floatplan"

    def test_as_a_module(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "executable", "/opt/python")
        assert self.hint(monkeypatch, "/x/floatplan/__main__.py") == "/opt/python -m floatplan"

    def test_is_in_the_summary(self, tmp_path: Path) -> None:
        run = warm_process.run("plan", PROBLEMS / "new_configuration.toml", "--no-figures", cwd=tmp_path)
        text = "".join(run.stdout.split())
        assert "-mfloatplanshowruns/new_configuration/plan.json" in text
