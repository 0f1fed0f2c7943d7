"""An MJCF goes where a URDF goes: problem files, plans, proofs, replays, exports, jumps."""

import json
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from places import URDF

import floatplan as fp
from floatplan.export.formats import FORMATS

KANGAROO = URDF / "kangaroo.xml"
FLIGHT = """
angles = "deg"
[robot]
mjcf = "parts/kangaroo.xml"
reference = "standing"
[start]
orientation = 0
positions = { hip = 0, knee = 40, ankle = 0, shoulder = -40, tail = 0 }
[goal]
orientation = -30
positions = { hip = -60, knee = 80, ankle = -20, shoulder = 20, tail = 40 }
[flight]
duration = 0.5
angular_momentum = 0
gravity = 9.81
takeoff = { frame = "foot" }
[[obstacles]]
kind = "circle"
center = [3.0, 3.0]
radius = 0.1
"""


@pytest.fixture
def problem(tmp_path, monkeypatch):
    """A problem file; its robot's leg is in a file that the robot's includes."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts").mkdir()
    before, thigh, after = KANGAROO.read_text().partition('<body name="thigh">')
    leg, actuators, after = after.partition("</body>\n  </worldbody>")
    (tmp_path / "parts" / "leg.xml").write_text(f"<mujocoinclude>{thigh}{leg}</mujocoinclude>")
    (tmp_path / "parts" / "kangaroo.xml").write_text(f'{before}<include file="leg.xml"/>{actuators}{after}')
    path = tmp_path / "kangaroo.toml"
    path.write_text(FLIGHT)
    return path


def test_a_plan_is_of_an_mjcf_and_what_it_includes(floatplan, problem):
    assert floatplan("plan", problem, "--no-figures", "-o", "result").code == 0
    robot = json.loads(Path("result/plan.json").read_text())["robot"]
    assert "urdf" not in robot
    assert Path(robot["mjcf"]) == problem.parent / "parts" / "kangaroo.xml"
    assert list(robot["meshes"]) == ["leg.xml"]
    plan = fp.load_plan("result/plan.json")
    assert plan.certificate.proved
    assert fp.certify("result/plan.json").proved
    assert fp.replay(plan, engine="mujoco").orientation_error < 1e-6
    assert plan.q([0.0, 0.5]).shape == (2, 12)
    for kind in set(FORMATS) - {"parquet", "mcap", "unitree", "unitree-sdk"}:
        assert plan.export(kind, f"result/{kind}").stat().st_size > 0
    fp.save_problem(fp.load_problem(problem), "parts/saved.toml")
    saved = tomllib.loads(Path("parts/saved.toml").read_text())["robot"]
    assert (saved["mjcf"], saved["reference"]) == ("kangaroo.xml", "standing")
    assert fp.load_problem("parts/saved.toml").robot.kind == "mjcf"
    moved = problem.parent / "moved"
    shutil.copytree(problem.parent / "parts", moved)
    shutil.copy("result/plan.json", moved)
    shutil.rmtree(problem.parent / "parts")
    assert fp.load_plan(moved / "plan.json").robot.path == moved / "kangaroo.xml"
    (moved / "leg.xml").write_text((moved / "leg.xml").read_text().replace("250", "251").replace('"0.06"', '"0.061"'))
    changed = floatplan("certify", moved / "plan.json")
    assert (changed.code, "leg.xml" in changed.stderr) == (2, True)
    with pytest.raises(fp.InputError, match=r"what the MJCF is read with has changed.*|.*leg\.xml"):
        fp.load_plan(moved / "plan.json")


def test_a_problem_names_one_file_of_its_kind(floatplan, problem):
    for robot, reason in {
        "": "robot.urdf: is missing: give it, or mjcf",
        'urdf = "a.urdf"\nmjcf = "a.xml"': "robot.mjcf: is given beside urdf: keep one of them",
        'urdf = "parts/kangaroo.xml"': "is not a URDF: its root element is <mujoco>; read it as one: [robot] mjcf = ..",
        'mjcf = "no.xml"': "robot.mjcf: there is no file",
    }.items():
        problem.write_text(FLIGHT.replace('mjcf = "parts/kangaroo.xml"', robot))
        run = floatplan("plan", problem)
        assert (run.code, reason in " ".join(run.stderr.split())) == (2, True), run.stderr


def test_commands_tell_an_mjcf_by_what_it_is(floatplan, problem):
    shutil.move("parts/kangaroo.xml", "parts/kangaroo.urdf")
    facts = json.loads(floatplan("info", "parts/kangaroo.urdf", "--json").stdout)
    assert facts["joints"] == ["hip", "knee", "ankle", "shoulder", "tail"]
    assert facts["armature"] == dict.fromkeys(facts["joints"], 0.02)


def test_a_first_problem_is_of_an_mjcf(floatplan, problem, monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)  # no jump is looked for
    assert floatplan("init", "parts/kangaroo.xml", "-o", "first.toml").code == 0
    content = tomllib.loads(Path("first.toml").read_text())
    assert content["robot"] == {"mjcf": "parts/kangaroo.xml", "plane": "xz", "reference": "standing"}
    assert fp.load_problem("first.toml").robot.kind == "mjcf"


@pytest.mark.long
def test_a_first_problem_is_a_flip_that_is_proved(floatplan, problem):
    assert floatplan("init", "parts/kangaroo.xml", "--force").code == 0
    assert floatplan("jump", "kangaroo.toml", "-o", "result").code == 0
    jump = fp.load_jump("result/jump.json")
    assert jump.ok
    assert json.loads(Path("result/jump.json").read_text())["robot"]["mjcf"].endswith("kangaroo.xml")
    assert fp.certify(jump.flight).proved
    assert abs(jump.flight.problem.final.orientation - jump.flight.problem.initial.orientation) > 3
