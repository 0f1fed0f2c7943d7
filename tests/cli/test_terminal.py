"""What a person sees of the command line: where results and progress go, bars, the log, version, completion, hints."""

import logging
import os
import pty
import re
import subprocess
import sys
import threading

import pytest
from own_process import started
from places import PROBLEMS, ROOT

import floatplan as fp
from floatplan.kernel.library import description

PROGRAM = [sys.executable, "-m", "floatplan"]
BAR = "\u2501"  # what rich draws bars of
AT_ONCE = {  # a bar and words about the progress, of a search that ends after a start
    "floatplan.cli.progress.DELAY": 0.0,
    "floatplan.planning.in_space.ANNOUNCED_EVERY": 0.0,
    "floatplan.planning.in_space.MOST_STARTS": 1,
}


def in_terminal(*arguments, cwd, **constants):
    """Run the program with a terminal for stderr; what it wrote to stdout and to the terminal."""
    ours, theirs = pty.openpty()
    seen = bytearray()

    def read():
        try:
            while piece := os.read(ours, 4096):
                seen.extend(piece)
        except OSError:  # the other end is closed
            return

    reader = threading.Thread(target=read)
    reader.start()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    with (cwd / "stdout").open("w+") as stdout:
        started(
            *arguments, stdout=stdout.fileno(), stderr=theirs, cwd=cwd, environment=environment, constants=constants
        ).wait()
        os.close(theirs)
        reader.join()
        os.close(ours)
        stdout.seek(0)
        return stdout.read(), seen.decode()


@pytest.fixture
def long_search(tmp_path):
    """A twist with hardly any torque, which nothing proves at once."""
    text = (PROBLEMS / "space/diver_half_twist.toml").read_text(encoding="utf-8")
    path = tmp_path / "long.toml"
    text = text.replace("../../urdf", str(ROOT / "urdf")).split("[limits]")[0]
    path.write_text(f"{text}\n[limits]\ntorque = 0.2\n", encoding="utf-8")
    return path


class TestBar:
    def test_a_search_has_one_in_a_terminal(self, long_search, tmp_path):
        output, seen = in_terminal("plan", long_search, "--no-figures", "--budget", "500", cwd=tmp_path, **AT_ONCE)
        assert BAR in seen
        assert re.search(r"planning: \d+ starts tried, 0 solved", seen)
        assert "no plan found" in output
        assert BAR not in output

    @pytest.mark.long
    def test_what_takes_no_time_has_none(self, tmp_path):
        output, seen = in_terminal("bounds", PROBLEMS / "handstand.toml", cwd=tmp_path)
        assert "midpoint" in output
        assert seen == ""

    @pytest.mark.long
    def test_quiet_has_none(self, long_search, tmp_path):
        asked = ("plan", long_search, "--no-figures", "-q", "--budget", "500")
        assert in_terminal(*asked, cwd=tmp_path, **AT_ONCE) == ("", "")


class TestLog:
    def test_says_what_the_search_does(self, floatplan):
        run = floatplan("plan", PROBLEMS / "obstacle.toml", "-v", "--no-figures", "--starts", "2", "-o", "out")
        lines = run.stderr.splitlines()
        assert re.search(r"start 1, degree 7, \d+ steps; optimal, coefficients [\d.]+; best violation 0$", lines[0])
        assert any("start 2, degree 7" in line for line in lines)
        assert re.search(r"proof: proved, \d+ intervals of time$", lines[-1])
        assert "obstacle: flight proved" in run.stdout
        assert not logging.getLogger("floatplan").handlers


def test_the_version(floatplan):
    run = floatplan("--version")
    solver = f"floatplan {fp.__version__}, {description()}\n"
    assert (run.code, run.stdout, run.stderr) == (0, solver, "")


def test_shells_complete_commands():
    words = {"_FLOATPLAN_COMPLETE": "complete_bash", "COMP_WORDS": "floatplan ex", "COMP_CWORD": "1"}
    run = subprocess.run(PROGRAM, capture_output=True, text=True, check=False, env={**os.environ, **words})
    assert run.stdout.split() == ["export"]


def test_objectives_have_units(floatplan):
    text = " ".join(floatplan("plan", "--help").stdout.split())
    assert "torque: integral of the squared joint torques (N^2 m^2 s);" in text
    run = floatplan("plan", PROBLEMS / "new_configuration.toml", "--objective", "torque", "--no-figures", "-o", "out")
    assert re.search(r"torque [\d.]+ N\^2 m\^2 s", run.stdout)
