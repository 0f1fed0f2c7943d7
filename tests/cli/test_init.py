"""``floatplan init``: from a robot to a flight that is proved and without warnings, without an edit."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_cases import cases

import floatplan as fp
from floatplan.robot.urdf.example_robots import PREFIX, robots_folder

Command = Callable[..., Any]


def planned(floatplan: Command, path: Path) -> fp.Plan:
    run = floatplan("plan", path, "--no-figures", "-o", "result")
    assert run.code == 0, run
    plan = fp.load_plan("result/plan.json")
    assert plan.certificate is not None
    assert plan.certificate.proved
    assert plan.warnings == ()
    return plan


def turned(plan: fp.Plan) -> float:
    return plan.problem.final.orientation - plan.problem.initial.orientation


def full_turn(plan: fp.Plan) -> bool:
    return abs(turned(plan)) > math.radians(270)


BAR = {
    "gymnast": "gymnast.urdf",
    "go2": PREFIX + "go2_description/urdf/go2.urdf",
    "a1": PREFIX + "a1_description/urdf/a1.urdf",
    "solo12": PREFIX + "solo_description/robots/solo12.urdf",
}
LONG = {"go2", "a1", "solo12"}  # planned as that of the gymnast is
UR5, G1, TALOS = (
    "ur_description/urdf/ur5_robot.urdf",
    "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos_data/robots/talos_reduced.urdf",
)


@pytest.mark.parametrize("name", cases(BAR, LONG))
def test_from_a_robot_to_its_flight_in_three_commands(floatplan: Command, root: Path, name: str) -> None:
    """Nothing is edited between them; the flight begins and ends at rest on a foot, within limits."""
    source = BAR[name]
    if source.startswith(PREFIX) and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    assert floatplan("init", source if source.startswith(PREFIX) else root / "urdf" / source, "-q").code == 0
    content = tomllib.loads(Path(f"{name}.toml").read_text())
    assert content["start"]["velocities"] == "takeoff"
    assert content["goal"]["velocities"] == "landing"
    assert content["limits"]["velocity"] in ("urdf", 2000)
    plan = planned(floatplan, Path(f"{name}.toml"))
    assert plan.problem.ground
    assert full_turn(plan)
    assert [contact.end for contact in plan.contacts] == ["takeoff", "landing"]
    assert all(contact.ratio is not None and contact.ratio <= 0.95 for contact in plan.contacts)
    assert floatplan("show", "result/plan.json").code == 0
    assert Path("result/report.html").exists()


@pytest.mark.skipif(robots_folder() is None, reason="example-robot-data is not installed")
def test_where_there_is_no_flight(floatplan: Command) -> None:
    """On wheels, with light arms that cannot turn the base afloat: one sentence, and no file."""
    run = floatplan("init", PREFIX + "tiago_description/robots/tiago.urdf")
    assert run.code == 2
    assert "no flight was found" in run.stderr
    assert "No feet" in run.stderr
    assert "Afloat" in run.stderr
    assert not Path("tiago.toml").exists()


@pytest.mark.skipif(robots_folder() is None, reason="example-robot-data is not installed")
@pytest.mark.parametrize("urdf", cases((UR5, G1, TALOS), {G1, TALOS}))
def test_a_robot_that_cannot_take_off_turns_its_base_afloat(floatplan: Command, urdf: str) -> None:
    """An arm has no feet; for a G1 and a Talos with flat soles no motion is found on them."""
    assert floatplan("init", PREFIX + urdf, "-o", "arm.toml").code == 0
    first = Path("arm.toml").read_text().splitlines()[0]
    assert "afloat" in first
    plan = planned(floatplan, Path("arm.toml"))
    assert plan.angular_momentum == 0
    assert abs(plan.problem.final.orientation) > math.radians(10)


def test_one_joint(floatplan: Command, root: Path) -> None:
    """It can neither push off nor choose where it ends: what its swing makes of the base is the goal."""
    assert floatplan("init", root / "urdf" / "acrobat.urdf").code == 0
    text = Path("acrobat.toml").read_text()
    assert "flip" in " ".join(text.split())
    planned(floatplan, Path("acrobat.toml"))


def test_the_same_file_again(floatplan: Command, root: Path) -> None:
    for name in ("one.toml", "two.toml"):
        assert floatplan("init", root / "urdf" / "gymnast.urdf", "-o", name).code == 0
    assert Path("one.toml").read_bytes() == Path("two.toml").read_bytes()


def test_files_are_kept_unless_forced(floatplan: Command, root: Path) -> None:
    acrobat = root / "urdf" / "acrobat.urdf"
    Path("acrobat.toml").write_text("mine")
    run = floatplan("init", acrobat)
    assert run.code == 2
    assert "--force" in run.stderr
    assert Path("acrobat.toml").read_text() == "mine"
    assert floatplan("init", acrobat, "--force").code == 0
    assert json.dumps(tomllib.loads(Path("acrobat.toml").read_text())["angles"]) == '"deg"'


@pytest.mark.parametrize(("robot", "output"), [("nowhere.urdf", "a.toml"), ("gymnast.urdf", "a.urdf")])
def test_bad_input(floatplan: Command, root: Path, robot: str, output: str) -> None:
    run = floatplan("init", root / "urdf" / robot, "-o", output)
    assert run.code == 2
    assert not Path(output).exists()


def test_round_numbers(floatplan: Command, root: Path) -> None:
    assert floatplan("init", root / "urdf" / "high_jumper.urdf").code == 0
    content = tomllib.loads(Path("high_jumper.toml").read_text())
    for table in ("start", "goal"):
        angles = [content[table]["orientation"], *content[table]["positions"].values()]
        assert all(isinstance(angle, int) for angle in angles)
    assert np.isclose(content["flight"]["duration"], round(content["flight"]["duration"], 2))
