"""What somebody reads who comes for the first time: what is wrong says where it belongs, nothing is 0 % of no limit."""

import re
from pathlib import Path

import pytest

from floatplan.arguments import in_line, percent, short, shortened
from floatplan.jumps.check import FIGURES

NEGATIVE_ZERO = re.compile(r"(?<![\w.])-0(?:\.0+)?(?![\w.])")
PROBLEM = """angles = "deg"
{top}
[robot]
{robot}
[start]
orientation = 75
positions = {{ q1 = 15, q2 = 5 }}
{start}
[goal]
orientation = -85
positions = {{ q1 = 5, q2 = -5 }}
[flight]
duration = 1.2
angular_momentum = "midpoint"
[limits]
position = "full"
{limits}
"""


def written(root, **parts):
    """A problem of the gymnast in this folder, with more in its tables."""
    blank = {"top": "", "start": "", "limits": "", "robot": f'urdf = "{root / "urdf" / "gymnast.urdf"}"'}
    path = Path("asked.toml")
    path.write_text(PROBLEM.format(**blank | parts))
    return path


class TestMisplacedKeys:
    @pytest.mark.parametrize(
        ("table", "line", "told"),
        [
            ("limits", "ground = true", ["limits.ground", "at the top of the file"]),
            ("limits", "gravity = 1.6", ["limits.gravity", "in [flight]"]),
            ("start", "duration = 0.9", ["start.duration", "in [flight]"]),
            ("top", "objective = 'torque'", ["objective", "in [motion]"]),
            ("top", "friction = 0.4", ["friction", "in [jump]"]),
            ("limits", "center = [0, 1]", ["limits.center", "in [[obstacles]]"]),
            ("start", "position = { q1 = 3 }", ["start.position", "did you mean 'positions'?", "in [limits]"]),
            ("start", "nonsense = 1", ["start.nonsense", "known are"]),
        ],
    )
    def test_say_where_they_belong(self, floatplan, root, table, line, told):
        run = floatplan("plan", written(root, **{table: line}), "-o", "result")
        assert run.code == 2
        for part in ("asked.toml", "unknown key", *told):
            assert part in run.stderr


class TestWrongFiles:
    @pytest.mark.parametrize("kind", ["urdf", "mjcf"])
    def test_a_robot_that_is_not_there(self, floatplan, root, kind):
        run = floatplan("plan", written(root, robot=f'{kind} = "not/there.xml"'))
        assert run.code == 2
        for part in ("asked.toml", f"robot.{kind}", "not/there.xml", "floatplan robots"):
            assert part in run.stderr

    def test_a_plane_in_which_nothing_turns(self, floatplan, root):
        urdf = root / "urdf" / "gymnast.urdf"
        for name in ("xy", "zy"):
            run = floatplan("plan", written(root, robot=f'urdf = "{urdf}"\nplane = "{name}"'))
            assert run.code == 2
            for part in ("asked.toml", "robot.plane", name, 'joints turn in "xz"'):
                assert part in run.stderr

    @pytest.mark.parametrize("command", ["certify", "show", "replay", "launch"])
    def test_a_problem_where_a_plan_is_to_be(self, floatplan, root, command):
        run = floatplan(command, written(root))
        assert run.code == 2
        assert "is a TOML file, not a plan" in run.stderr
        assert "floatplan plan asked.toml makes a plan" in run.stderr

    def test_a_folder_where_a_plan_is_to_be(self, floatplan, root):
        Path("empty").mkdir()
        run = floatplan("show", "empty")
        assert run.code == 2
        assert "give the file in it: plan.json" in run.stderr
        assert floatplan("plan", written(root), "--no-figures", "-o", "made").code == 0
        run = floatplan("show", "made")
        assert run.code == 2
        assert "did you mean made/plan.json?" in run.stderr

    def test_a_problem_where_a_robot_is_to_be(self, floatplan, root):
        run = floatplan("init", written(root), "-o", "new.toml")
        assert run.code == 2
        assert "is a TOML file, not a robot's" in run.stderr

    @pytest.mark.parametrize(
        ("name", "meant"),
        [("go2", "go2_description/urdf/go2.urdf"), ("Talos", "talos_data/"), ("hyq", "hyq_description/")],
    )
    def test_a_robots_bare_name(self, floatplan, name, meant):
        for command in (("info", name), ("init", name, "-o", "new.toml")):
            run = floatplan(*command)
            assert run.code == 2
            assert f"example-robot-data:{meant}" in run.stderr


class TestNumbers:
    @pytest.mark.parametrize("value", [-0.0, -1e-300, -4e-9])
    def test_no_zero_has_a_sign(self, value):
        """Nor what is rounded to one."""
        words = [short(value), shortened([value]), in_line(value), percent(value)]
        words += [figure.sentence.format(-0.0) for figure in FIGURES.values()]
        assert not [word for word in words if NEGATIVE_ZERO.search(word)]

    def test_words_of_the_paper_are_not_in_tables(self, floatplan, root):
        """D_i, leak, monotonic: what they mean is said instead."""
        path = written(root)
        for command in (("info", root / "urdf" / "gymnast.urdf"), ("bounds", path), ("plan", path, "-o", "made")):
            run = floatplan(*command)
            assert run.code == 0
            for word in ("D_0", "D_1", "D_i", "leak", "monotonic"):
                assert word not in run.stdout
