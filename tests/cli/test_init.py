"""``floatplan init``: from a robot to a flight that is proved and without warnings, without an edit."""

import json
import math
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from jumps import GO2, backflip, find_jumps_once
from legged_samples import quadruped

import floatplan as fp
from floatplan.initial import flight
from floatplan.jumps.setup import jump_setup
from floatplan.robot.urdf.tree import PREFIX


def planned(floatplan, path, *known):
    run = floatplan("plan", path, "--no-figures", "-o", "result")
    assert run.code == 0, run
    plan = fp.load_plan("result/plan.json")
    assert plan.certificate.proved
    assert {warning.kind for warning in plan.warnings} <= {"leak", *known}  # an arm leaves its plane
    return plan


@pytest.fixture
def jumps_once(monkeypatch):
    """What ``test_pages.py`` had it search for too is searched for once."""
    find_jumps_once(monkeypatch)


@pytest.fixture
def afloat(monkeypatch):
    """Without CasADi no jump is looked for."""
    monkeypatch.setitem(sys.modules, "casadi", None)


UR5 = "ur_description/urdf/ur5_robot.urdf"


def test_the_file_of_a_jump(floatplan, monkeypatch):
    """Nothing is edited between three commands; the flight is that of the jump, proved, and so is the jump's."""
    monkeypatch.setattr(flight, "jump", lambda problem, **_: backflip())
    run = floatplan("init", GO2)
    assert run.code == 0
    assert "next: floatplan jump go2.toml" in run.stderr
    text = Path("go2.toml").read_text()
    assert text.startswith("# go2 stands, flips backwards and stands again: floatplan jump go2.toml\n")
    assert len(text.splitlines()) < 70
    assert "# armature: no rotors are known; " in text.partition("[start]")[0]
    content = tomllib.loads(text)
    for table in ("start", "goal"):
        assert {"positions", "velocities", "accelerations"} < set(content[table])
    assert content["jump"]["takeoff"]["contacts"][1] == [content["flight"]["takeoff"]["frame"]]
    plan = planned(floatplan, Path("go2.toml"), "overlap")  # its jump was not searched for again
    assert "the flight alone" in plan.explanation
    asked = jump_setup(plan.problem, plan.problem.jump or fp.JumpRequest())
    assert [phase.side for phase in asked.phases] == ["takeoff", "takeoff", "flight", "landing", "landing"]
    assert asked.ends[1, 0] - asked.ends[0, 0] == pytest.approx(-2 * math.pi)


@pytest.mark.long
@pytest.mark.usefixtures("jumps_once")
def test_links_of_the_first_jump_do_not_overlap(floatplan, root):
    """The gymnast's jump of least torque folds its shank into its thigh: it is searched for again."""
    assert floatplan("init", root / "urdf" / "gymnast.urdf", "-q").code == 0
    problem = fp.load_problem("gymnast.toml")
    assert np.abs(problem.position_limits).max() < math.radians(175)
    found = fp.jump(problem)
    assert found.ok
    assert not [warning for warning in found.warnings if warning.kind == "overlap"]
    assert found.to_dict()["warnings"] == [warning.to_dict() for warning in found.warnings]


@pytest.mark.long
@pytest.mark.usefixtures("jumps_once")
def test_from_a_robot_to_its_jump_in_two_commands(floatplan):
    assert floatplan("init", GO2, "-q").code == 0
    planned(floatplan, Path("go2.toml"))
    run = floatplan("jump", "go2.toml", "-o", "jump")
    assert run.code == 0, run
    assert "flight proved, stances checked" in run.stdout
    found = fp.load_jump("jump/jump.json")
    assert abs(found.problem.final.orientation - found.problem.initial.orientation) > math.radians(90)
    assert [phase.kind for phase in found.phases] == ["stance", "stance", "flight", "stance", "stance"]


ASKED = {
    "gymnast": (["--turns", "1", "--duration", "0.62"], -1),
    "high_jumper": (["--degrees", "--locked", "q3=30", "--turns", "0"], 0),
}


@pytest.mark.long
@pytest.mark.usefixtures("jumps_once")
@pytest.mark.parametrize("name", ASKED)
def test_what_is_asked_plans_as_it_stands(floatplan, root, name):
    """And jumps; its daily representative, in ``tests/initial/test_options.py``, makes no jump of its own."""
    options, turns = ASKED[name]
    assert floatplan("init", root / "urdf" / f"{name}.urdf", *options, "-q").code == 0
    problem = planned(floatplan, Path(f"{name}.toml")).problem
    assert problem.flight.duration == 0.62 or "--duration" not in options
    assert dict(problem.robot.locked) == ({"q3": math.radians(30)} if "--locked" in options else {})
    assert floatplan("jump", f"{name}.toml", "-o", "jump", "--no-report").code == 0
    found = fp.load_jump("jump/jump.json")
    standing = jump_setup(found.problem, found.request).ends
    assert standing[1, 0] - standing[0, 0] == pytest.approx(turns * problem.robot.plane.turn * 2 * math.pi)


@pytest.mark.usefixtures("afloat")
def test_without_casadi_it_is_afloat_and_says_so(floatplan, root):
    run = floatplan("init", root / "urdf" / "gymnast.urdf")
    assert run.code == 0
    assert "next: floatplan plan gymnast.toml" in run.stderr
    for said in (run.stderr, Path("gymnast.toml").read_text().replace("\n# ", " ")):
        assert "CasADi is not installed" in said
        assert "floatplan[jump]" in said or "[jump]" in said
    assert planned(floatplan, Path("gymnast.toml")).problem.flight.gravity == 0


LINK = '<inertial><mass value="{0}"/><inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial>'
LIGHT_ARM = f"""<robot name="light">
<link name="hull">{LINK.format(10)}</link> <link name="arm">{LINK.format(0.02)}</link>
<joint name="shoulder" type="revolute"><parent link="hull"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="3" effort="5"/></joint></robot>"""


def test_where_there_is_no_flight(floatplan):
    """With a light arm that cannot turn the base afloat: one sentence, and no file."""
    Path("light.urdf").write_text(LIGHT_ARM)
    run = floatplan("init", "light.urdf")
    assert run.code == 1
    assert "no flight was found" in run.stderr
    assert "No feet" in run.stderr
    assert "Afloat" in run.stderr
    assert not Path("light.toml").exists()


def test_an_arm_turns_its_base_afloat(floatplan):
    assert floatplan("init", PREFIX + UR5, "-o", "arm.toml").code == 0
    text = Path("arm.toml").read_text()
    assert "afloat" in text.splitlines()[0]
    assert "No feet" in text
    plan = planned(floatplan, Path("arm.toml"))
    assert plan.angular_momentum == 0
    assert abs(plan.problem.final.orientation) > math.radians(10)


@pytest.mark.usefixtures("afloat")
def test_the_same_file_again(floatplan, root):
    for name in ("one.toml", "two.toml"):
        assert floatplan("init", root / "urdf" / "gymnast.urdf", "-o", name).code == 0
    assert Path("one.toml").read_bytes() == Path("two.toml").read_bytes()


@pytest.mark.usefixtures("afloat")
def test_files_are_kept_unless_forced(floatplan, root):
    acrobat = root / "urdf" / "acrobat.urdf"
    Path("acrobat.toml").write_text("mine")
    run = floatplan("init", acrobat)
    assert run.code == 2
    assert "--force" in run.stderr
    assert Path("acrobat.toml").read_text() == "mine"
    assert floatplan("init", acrobat, "--force").code == 0
    assert json.dumps(tomllib.loads(Path("acrobat.toml").read_text())["angles"]) == '"deg"'


MESH = '<collision><geometry><mesh filename="package://nowhere/part.stl"/></geometry></collision>'


def test_a_missing_mesh_leaves_a_turn_afloat(floatplan):
    """Which needs no shapes; what is missing is said, and that no jump was looked for."""
    text = quadruped()
    before = text.index("</inertial>", text.index('<link name="fl_shank">')) + len("</inertial>")
    Path("robot.urdf").write_text(text[:before] + MESH + text[before:])
    run = floatplan("init", "robot.urdf")
    assert run.code == 0, run
    assert "No jump was looked for, since that takes all shapes" in run.stderr
    assert 'collision mesh "package://nowhere/part.stl" not found' in run.stderr
    planned(floatplan, Path("robot.toml"))
    refused = floatplan("init", "robot.urdf", "--turns", "0", "-o", "other.toml")
    assert refused.code == 2
    assert "--turns: it is about a jump" in refused.stderr


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("fl_knee", "'fl_knee' is not JOINT=ANGLE"),
        ("fl_knee=high", "--posture fl_knee: 'high' is not a number"),
        ("fl_knee=nan", "--posture: fl_knee = nan is not a finite angle"),
        ("tail=0.1", "--posture: 'tail' is not a planned joint"),
        ("fl_knee=3", "--posture: fl_knee = 3 rad is outside its range"),
    ],
)
def test_a_wrong_posture_is_refused_by_its_option(floatplan, typed, words):
    Path("robot.urdf").write_text(quadruped())
    run = floatplan("init", "robot.urdf", "--posture", typed)
    assert run.code == 2
    assert words in run.stderr
