"""Tests may run commands in processes that have imported them already: these do what others do."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import warm_process
from warm_process import WarmProcess

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["--version"], marks=pytest.mark.long),
        ["info", ROOT / "urdf" / "gymnast.urdf", "--json"],
        ["info", "nowhere.urdf"],
        pytest.param(["plan"], marks=pytest.mark.long),
        ["plan", ROOT / "problems" / "new_configuration.toml", "--no-figures", "--no-certify", "--quiet"],
    ],
)
def test_does_what_another_does(arguments: list[str | Path], tmp_path: Path) -> None:
    folders = [tmp_path / "warm", tmp_path / "cold"]
    for folder in folders:
        folder.mkdir()
    command = [sys.executable, "-m", "floatplan", *map(str, arguments)]
    warm = warm_process.run(*arguments, cwd=folders[0])
    cold = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folders[1])
    assert (warm.returncode, warm.stdout, warm.stderr) == (cold.returncode, cold.stdout, cold.stderr)
    left, expected = ({path.relative_to(folder) for path in folder.rglob("*")} for folder in folders)
    assert left == expected


def test_each_has_streams_and_environment_of_its_own(tmp_path: Path) -> None:
    for columns in ("60", "120"):
        with (tmp_path / columns).open("w") as stdout:
            environment = {**os.environ, "COLUMNS": columns}
            process = WarmProcess("--help", stdout=stdout.fileno(), stderr=2, environment=environment)
            assert process.wait() == 0
    narrow, wide = (max(map(len, (tmp_path / columns).read_text().splitlines())) for columns in ("60", "120"))
    assert narrow <= 60 < wide <= 120


def test_may_be_killed() -> None:
    process = WarmProcess("plan", ROOT / "problems" / "obstacle_hard.toml", stdout=2, stderr=2)
    process.kill()
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_says_which_signal_ended_it() -> None:
    process = WarmProcess("plan", ROOT / "problems" / "obstacle_hard.toml", stdout=2, stderr=2)
    with pytest.raises(TimeoutError):
        process.wait(1e-3)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
