"""The search from the command line: budget, processes, Ctrl-C, progress, pictures beside a plan without obstacles."""

import json
import math
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from own_process import started
from places import PROBLEMS

import floatplan as fp
from floatplan.planning import search

PATIENCE = 300.0  # s until a process that should have ended is given up; less than the budgets here
ENDLESS = 100_000  # starts
IMPOSSIBLE = """
[limits]
position = "full"
torque = 0.2
"""


@pytest.fixture
def hopeless(tmp_path):
    """Example A with a tenth of the torque that it needs: nothing proves that at once."""
    text = (PROBLEMS / "new_configuration.toml").read_text(encoding="utf-8")
    text = text.replace("../urdf", str(PROBLEMS.parent / "urdf")).split("[limits]")[0] + IMPOSSIBLE
    path = tmp_path / "hopeless.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def endless(tmp_path):
    """Ten joints with hardly any torque."""
    robot = fp.Robot.from_urdf(PROBLEMS.parent / "urdf" / "chain10.urdf")
    path = tmp_path / "endless.toml"
    fp.save_problem(
        fp.Problem(
            robot=robot,
            start=fp.Posture(0.3, np.zeros(10)),
            goal=fp.Posture(-1.0, np.linspace(0.5, 1.0, 10)),
            flight=fp.Flight(duration=1.0, angular_momentum=0.1),
            limits=fp.Limits(position="full", torque=0.02),
        ),
        path,
    )
    return path


def interrupted(wanted, folder, *arguments):
    """Run the program and press Ctrl-C once the search reports what is wanted; its exit code and what it told."""
    ours, theirs = os.pipe()
    with os.fdopen(ours) as told:
        constants = {"floatplan.planning.search.ANNOUNCED_EVERY": 0.0, "floatplan.planning.search.ATTEMPTS": ENDLESS}
        words = ("plan", *arguments, "-o", folder, "--no-figures")
        process = started(*words, stdout=theirs, stderr=theirs, constants=constants)
        os.close(theirs)
        before = []
        for line in told:
            before.append(line)
            if wanted in line:
                os.killpg(process.pid, signal.SIGINT)
                break
        return process.wait(PATIENCE), "".join([*before, *told])


class TestInterrupt:
    def test_the_nearest_motion_is_kept(self, endless, tmp_path):
        code, told = interrupted("0 solved", tmp_path / "out", endless, "--budget", "500")
        assert code == 1, told
        assert "planning: " in told
        assert "Traceback" not in told
        content = json.loads((tmp_path / "out" / "plan.json").read_text())
        assert content["ok"] is False
        assert content["status"] == "interrupted"
        assert content["explanation"].startswith("The search was interrupted")
        assert "freedom" not in content["explanation"]
        assert "(interrupted, after" in told
        assert fp.load_plan(tmp_path / "out" / "plan.json").status == "interrupted"
        assert (tmp_path / "out" / "trajectory.csv").is_file()

    @pytest.mark.long
    def test_the_best_plan_is_kept(self, tmp_path):
        words = (PROBLEMS / "obstacle_hard.toml", "--budget", "500", "--starts", "1000")
        code, told = interrupted("1 solved", tmp_path / "out", *words)
        assert code == 0, told
        assert "Traceback" not in told
        content = json.loads((tmp_path / "out" / "plan.json").read_text())
        assert content["ok"] is True
        assert 0 < content["solver"]["solved"] < 1000


class TestBudget:
    def test_search_ends_with_the_budget(self, hopeless, floatplan):
        run = floatplan("plan", hopeless, "-o", "out", "--no-figures", "--budget", "1e-9")
        assert run.code == 1
        content = json.loads(Path("out/plan.json").read_text())
        assert "ran out of time" in content["explanation"]
        assert "violated by" in content["explanation"]


@pytest.mark.usefixtures("little_work")
class TestProgress:
    @pytest.fixture(params=[0.0])
    def every(self, request, floatplan, monkeypatch):
        """So many seconds lie between words about the progress."""
        monkeypatch.setattr(search, "ANNOUNCED_EVERY", request.param)

    @pytest.mark.parametrize(("every", "told"), [(0.0, True), (math.inf, False)], indirect=["every"])
    @pytest.mark.usefixtures("every")
    def test_is_told_on_stderr(self, told, hopeless, floatplan):
        run = floatplan("plan", hopeless, "-o", "out", "--no-figures", "--json")
        lines = [line for line in run.stderr.splitlines() if line.startswith("planning: ")]
        answer = json.loads(run.stdout)
        said = [re.fullmatch(r"planning: (\d+) starts tried, 0 solved, degree \d+", line) for line in lines]
        tried = [int(words[1]) for words in said if words]
        assert tried == sorted(set(tried))
        assert len(tried) == len(lines)
        assert tried[-1:] == [answer["solver"]["starts"]] * told
        assert answer["ok"] is False

    @pytest.mark.usefixtures("every")
    def test_quiet(self, hopeless, floatplan):
        run = floatplan("plan", hopeless, "-o", "out", "--no-figures", "--quiet")
        assert (run.code, run.stdout, run.stderr) == (1, "", "")
