"""What a new user asks first: which robots there are, what one is, and what a problem file may hold."""

import json
import tomllib
from dataclasses import fields
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from places import PROBLEMS, URDF
from robot_samples import GYMNAST, PAIR, inertial, robot_text

import floatplan as fp
from floatplan.robot.urdf import tree as urdf


@pytest.fixture
def pair(tmp_path):
    path = tmp_path / "pair.urdf"
    path.write_text(robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', PAIR))
    return path


class TestRobots:
    def test_each_can_be_named_as_it_is_listed(self, floatplan, monkeypatch):
        listed = json.loads(floatplan("robots", "--json").stdout)
        told = {facts["robot"]: facts for facts in (*listed["robots"], *listed["unusable"])}
        monkeypatch.setattr("floatplan.cli.robots._facts", told.__getitem__)  # each is read once
        own = [facts for facts in listed["robots"] if "example-robot-data" not in facts["robot"]]
        left_open = {"cat.urdf", "diver.urdf"}  # in which plane; they are for flights in space
        assert {Path(facts["robot"]).name for facts in own} == {path.name for path in URDF.iterdir()} - left_open
        for number, facts in enumerate(own):
            assert number % 4 or floatplan("info", facts["robot"]).code == 0
            read = fp.Robot.from_mjcf if facts["robot"].endswith(".xml") else fp.Robot.from_urdf
            assert read(URDF.parent / facts["robot"]).joints == tuple(facts["joints"])
        for line, facts in zip(floatplan("robots").stdout.splitlines()[1:], listed["robots"], strict=False):
            assert line.removesuffix(" --coupled mirror").endswith(facts["robot"])
            assert line.endswith("--coupled mirror") == (facts["coupled"] == "mirror")
        go2 = told["example-robot-data:go2_description/urdf/go2.urdf"]
        assert (len(go2["joints"]), len(go2["followers"]), go2["coupled"]) == (4, 4, "mirror")
        assert all(facts["reason"] for facts in listed["unusable"])
        assert {urdf.PREFIX + name for name in urdf.example_urdfs()} <= told.keys()

    def test_a_file_here_comes_before_one_of_the_same_name_that_comes_with_floatplan(self, floatplan):
        own = floatplan("info", "urdf/gymnast.urdf", "--json")
        assert own.code == 0
        Path("urdf").mkdir()
        Path("urdf/gymnast.urdf").write_text("no URDF")
        assert floatplan("info", "urdf/gymnast.urdf").code == 2
        for name in ("urdf/nobody.urdf", "urdf/../urdf/acrobat.urdf", "problems", "problems/" + 300 * "a"):
            assert floatplan("info", name).code == 2

    def test_problems_that_come_with_floatplan_plan_anywhere(self, floatplan):
        run = floatplan("plan", "problems/handstand.toml", "--quiet", "--no-figures")
        assert run.code == 0, run
        assert fp.load_plan("runs/handstand/plan.json").ok


class TestInfo:
    def test_joints_come_first_and_the_rest_when_asked_for(self, floatplan):
        run = floatplan("info", URDF / "gymnast.urdf")
        lines = run.stdout.splitlines()
        assert [line.split()[0] for line in lines[:5]] == ["robot", "plane", "joint", "q1", "q2"]
        assert "body1" not in run.stdout
        assert "hand" in floatplan("info", URDF / "gymnast.urdf", "--frames").stdout
        assert "body1 0.4 m" in floatplan("info", URDF / "gymnast.urdf", "--shapes").stdout
        assert "body1 0.4 m" in floatplan("info", "--shapes", URDF / "gymnast.urdf", "--frames").stdout
        assert floatplan("info", URDF / "gymnast.urdf", "--shapes", "links.png").code == 0
        assert Path("links.png").is_file()

    def test_followers_are_said_in_words(self, floatplan, pair):
        text = floatplan("info", pair, "--coupled", "mirror").stdout
        assert "right_hip follows left_hip\n" in text
        text = floatplan("info", pair, "--coupled", "right_hip=-left_hip,right_knee=0.5*left_knee").stdout
        assert "right_hip follows -left_hip\n" in text
        assert "right_knee follows 0.5 left_knee\n" in text

    def test_a_file_with_the_robot_alone(self, floatplan, pair):
        file = pair.with_name("robot.toml")
        file.write_text('angles = "deg"\n[robot]\nurdf = "pair.urdf"\nlocked = { left_knee = 90, right_knee = 90 }\n')
        facts = json.loads(floatplan("info", file, "--json").stdout)
        assert facts["locked"] == {"left_knee": np.pi / 2, "right_knee": np.pi / 2}
        run = floatplan("info", file, "--coupled", "mirror")
        assert (run.code, "set robot.coupled in the file" in run.stderr) == (2, True)


class TestChoices:
    def test_are_those_of_python(self, floatplan, pair):
        run = floatplan(
            *("info", pair, "--coupled", "right_hip = left_hip", "--degrees", "--json"),
            *("--locked", "left_knee=90, right_knee=45"),
        )
        facts = json.loads(run.stdout)
        assert facts["joints"] == ["left_hip"]
        assert facts["coupled"] == {"right_hip": {"leader": "left_hip", "ratio": 1.0, "offset": 0.0}}
        assert facts["locked"] == {"left_knee": np.pi / 2, "right_knee": np.pi / 4}

    @pytest.mark.parametrize(
        ("arguments", "naming"),
        [
            (["--coupled", "left"], ["--coupled", "'left' is not FOLLOWER=LEADER"]),
            (["--coupled", ""], ["--coupled", "FOLLOWER=LEADER"]),
            (["--coupled", "right_hip=x*left_hip"], ["--coupled", "'x' is not a number"]),
            (["--coupled", "right_hip=nan*left_hip"], ["coupled", "right_hip"]),
            (["--coupled", "right_hip=toe"], ["toe"]),
            (["--coupled", "right_hip=left_hip,right_hip=left_knee"], ["right_hip", "given twice"]),
            (["--locked", "left_hip"], ["--locked", "JOINT=ANGLE"]),
            (["--locked", "left_hip=nan"], ["left_hip"]),
            (["--locked", "toe=1"], ["toe"]),
            (["--locked", "left_hip=9"], ["left_hip"]),
            (["--reference", "standing"], ["standing"]),
        ],
    )
    def test_wrong_ones(self, floatplan, pair, arguments, naming):
        run = floatplan("info", pair, *arguments)
        assert (run.code, run.stdout) == (2, ""), run
        assert all(part in run.stderr for part in naming), run.stderr

    @pytest.mark.parametrize("option", ["coupled", "locked", "reference", "plane"])
    def test_beside_a_problem_file(self, floatplan, option):
        for command in ("info", "plan"):
            run = floatplan(command, PROBLEMS / "handstand.toml", f"--{option}", "xz")
            assert run.code == 2
            assert f"set robot.{option} in the file" in run.stderr


@pytest.fixture(scope="module")
def validator():
    from floatplan.problem.file import problem_schema

    schema = problem_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


class TestSchema:
    @pytest.mark.parametrize("path", sorted(PROBLEMS.rglob("*.toml")), ids=lambda path: path.stem)
    def test_admits_every_problem(self, validator, path):
        content = tomllib.loads(path.read_text())
        assert "vary" in content or list(validator.iter_errors(content)) == []

    @pytest.mark.parametrize(
        ("old", "new", "place"),
        [
            ("duration = 1.4", "duration = -1", "flight.duration"),
            ("duration = 1.4", 'duration = "long"', "flight.duration"),
            ("duration = 1.4", "", "flight"),
            ("duration = 1.4", "duration = 1.4\nwings = 2", "flight"),
            ("[motion]", "[motions]", ""),
            ('kind = "circle"', 'kind = "blob"', "obstacles.0"),
            ("radius = 0.2", "radius = [1]", "obstacles.0"),
            ("orientation = 72", "orientation = true", "start.orientation"),
        ],
    )
    def test_refuses_what_the_program_refuses(self, validator, tmp_path, old, new, place):
        text = (PROBLEMS / "obstacle.toml").read_text().replace("../urdf", str(URDF))
        assert old in text
        path = tmp_path / "problem.toml"
        path.write_text(text.replace(old, new, 1))
        places = {
            ".".join(map(str, error.absolute_path)) for error in validator.iter_errors(tomllib.loads(path.read_text()))
        }
        assert place in places
        with pytest.raises(fp.InputError):
            fp.load_problem(path)

    def test_every_key_is_described(self):
        """A key that a table gets has to get its meaning too, and a meaning goes with its key."""
        from floatplan.problem.file import TABLES

        for table, about in TABLES.values():
            assert about
            assert {each.name for each in fields(table)} - {"settled"} == set(table.keys)
            assert all(key.meaning for key in table.keys.values())

    def test_the_command(self, floatplan):
        from floatplan.problem.file import problem_schema

        for arguments in (("schema",), ("schema", "problem")):
            assert json.loads(floatplan(*arguments).stdout) == problem_schema()
        assert floatplan("schema", "horoscope").code == 2
        run = floatplan("schema", "-o", "out/floatplan.schema.json")
        assert json.loads(Path(run.stdout.strip()).read_text()) == problem_schema()

    def test_the_reference_is_in_step(self):
        from key_reference import PAGE, page

        assert PAGE.read_text(encoding="utf-8") == page(), "run scripts/key_reference.py"


def test_byte_order_marks_are_read(tmp_path, floatplan):
    mark = b"\xef\xbb\xbf"
    (tmp_path / "robot.urdf").write_bytes(mark + GYMNAST.encode())
    text = (PROBLEMS / "handstand.toml").read_text().replace("../urdf/gymnast.urdf", "robot.urdf")
    (tmp_path / "problem.toml").write_bytes(mark + text.encode())
    assert floatplan("info", tmp_path / "robot.urdf").code == 0
    run = floatplan("plan", tmp_path / "problem.toml", "--no-figures", "-o", tmp_path / "out")
    assert run.code == 0, run
    assert floatplan("certify", tmp_path / "out" / "plan.json").code == 0
    assert floatplan("replay", tmp_path / "out" / "plan.json").code == 0
    plan = tmp_path / "out" / "plan.json"
    plan.write_bytes(mark + plan.read_bytes())
    assert floatplan("certify", plan).code == 0
