"""How problems, plans, replays and certificates show themselves at a prompt and in notebooks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

import floatplan as fp

Planned = Callable[[str], fp.Plan]
HOSTILE = "<script>alert(1)</script>"


class Cells(HTMLParser):
    """The texts of a table's cells, and the tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.add(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_a_plan_s_representation_is_short(planned: Planned, root: Path) -> None:
    for plan in (
        planned("handstand"),
        planned("obstacle_hard"),
        fp.plan(fp.load_problem(root / "problems" / "obstacle.toml"), prove=True),
    ):
        lines = repr(plan).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) <= 400
        assert plan.status in lines[0]
        assert plan.problem.name in repr(plan)


def test_so_is_one_of_many_joints(root: Path) -> None:
    robot = fp.Robot.from_urdf(root / "urdf" / "chain10.urdf")
    problem = fp.Problem(robot, fp.Posture(1.2, 0.15), fp.Posture(-1.5, -0.1), fp.Flight(1.3))
    assert len(repr(problem).splitlines()) == 3
    assert "... (2 more)" in repr(problem)
    plan = fp.plan(problem, prove=True)
    for shown in (plan, plan.certificate, fp.replay(plan)):
        assert len(repr(shown).splitlines()) <= 10
        assert len(repr(shown)) < 2000


def test_notebooks_show_tables(planned: Planned) -> None:
    plan = planned("obstacle")
    certificate = fp.certify(plan)
    for shown, expected in (
        (
            plan.problem,
            [plan.problem.name, "1.4 s", "foot at (0, 0) m", "start", "circle at (1.485, 3.342) m, radius 0.2 m"],
        ),
        (fp.replay(plan), ["orientation", "off by"]),
        (certificate, ["constraint", *(finding.label for finding in certificate.findings)]),
    ):
        cells = Cells(shown._repr_html_())
        assert {"table", "td"} <= cells.tags
        for text in expected:
            assert any(text in cell for cell in cells.texts), (text, cells.texts)


@pytest.mark.parametrize("name", ["handstand", "space/cat"])
def test_notebooks_draw_robots(root: Path, name: str) -> None:
    """A polygon for each solid, and a table; short enough to be kept in the notebook."""
    robot = fp.load_problem(root / "problems" / f"{name}.toml").robot
    text = robot._repr_html_()
    cells = Cells(text)
    assert {"table", "svg", "polygon"} <= cells.tags
    assert robot.name in cells.texts
    assert ", ".join(robot.joints) in cells.texts
    assert 2 <= text.count("<polygon") <= len(robot.solids)
    assert "nan" not in text
    assert len(text) < 10_000


def test_a_robot_whose_shapes_cannot_be_read_is_shown_without_a_drawing(root: Path, tmp_path: Path) -> None:
    text = (root / "urdf" / "gymnast.urdf").read_text()
    shape = '<collision><geometry><mesh filename="broken.stl"/></geometry></collision>'
    (tmp_path / "broken.stl").write_text("no mesh")
    (tmp_path / "robot.urdf").write_text(text.replace("</link>", f"{shape}</link>", 1))
    cells = Cells(fp.Robot.from_urdf(tmp_path / "robot.urdf")._repr_html_())
    assert "svg" not in cells.tags
    assert any("broken.stl" in each for each in cells.texts)


def test_notebooks_show_the_first_of_many_plans(planned: Planned) -> None:
    problem = planned("handstand").problem
    impossible = replace(problem, limits=fp.Limits(position="full", velocity=1e-3))
    cells = Cells(fp.plan_many([problem, impossible])._repr_html_())
    assert "2 plans: 1 impossible, 1 optimal" in cells.texts
    assert cells.texts[cells.texts.index("0") :][:2] == ["0", "optimal"]
    assert "1" in cells.texts
    many = fp.plan_many([problem] * 30)
    cells = Cells(many._repr_html_())
    assert "10 more" in cells.texts


def test_what_is_not_proved_comes_first(planned: Planned) -> None:
    record = planned("handstand").record
    certificate = fp.certify(replace(record, angular_momentum=record.angular_momentum + 1e-3))
    assert certificate.unproved[0].label in repr(certificate).splitlines()[1]
    texts = [text for text in Cells(certificate._repr_html_()).texts if text.strip()]
    assert texts[texts.index("at, s") + 2] == "refuted"


def test_names_are_text(planned: Planned) -> None:
    problem = replace(planned("handstand").problem, name=HOSTILE)
    cells = Cells(problem._repr_html_())
    assert "script" not in cells.tags
    assert HOSTILE in cells.texts


class TestProblemFile:
    def test_goes_with_the_plan(self, planned: Planned, root: Path, tmp_path: Path) -> None:
        plan = planned("handstand")
        text = (root / "problems" / "handstand.toml").read_text()
        assert plan.problem.file_text == text
        assert fp.load_plan(plan.save(tmp_path / "plan.json")).problem.file_text == text

    def test_is_dropped_where_the_problem_is_another(self, planned: Planned) -> None:
        problem = planned("handstand").problem
        assert replace(problem, ground=True).file_text is None
        robot_only = fp.Problem(problem.robot, problem.start, problem.goal, problem.flight)
        assert robot_only.file_text is None

    def test_options_on_the_command_line_make_it_another(self, floatplan: Callable[..., object], root: Path) -> None:
        file = root / "problems" / "handstand.toml"
        floatplan("plan", file, "--duration", "1.5", "--no-figures", "-o", "out")
        assert fp.load_plan("out/plan.json").problem.file_text is None
        floatplan("plan", file, "--no-figures", "-o", "out")
        assert fp.load_plan("out/plan.json").problem.file_text == file.read_text()

    @pytest.mark.parametrize("value", [3, ["a"], {}])
    def test_is_a_text(self, planned: Planned, tmp_path: Path, value: object) -> None:
        record = replace(planned("handstand").record, problem_file=value)  # type: ignore[arg-type]
        with pytest.raises(fp.InputError, match="problem_file"):
            fp.load_plan(record.save(tmp_path / "plan.json"))
